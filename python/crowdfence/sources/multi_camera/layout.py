"""The folder layouts of Wildtrack and MultiviewX, and what differs between them.

    Image_subsets/C1/00000000.png ...           pictures of each camera, by number of the frame
    annotations_positions/00000000.json ...     where everybody stood, and the box around each in each camera
    calibrations/intrinsic_zero/intr_*.xml      (Wildtrack) camera matrices, without distortion
    calibrations/intrinsic/intr_*.xml           (MultiviewX) the same
    calibrations/extrinsic/extr_*.xml           rotation vector and translation, world -> camera

The n-th calibration by name belongs to camera Cn. The world has z up and its ground at 0; Wildtrack counts it
in centimetres. Places are the cells of a grid of 2.5 cm, numbered along x first.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

PICTURES, POSITIONS, CALIBRATIONS = "Image_subsets", "annotations_positions", "calibrations"


class Layout(NamedTuple):
    name: str
    intrinsics: str
    """Folder of the camera matrices, in `CALIBRATIONS`."""
    unit_m: float
    """Of the translations."""
    columns: int
    """Cells of the grid along x."""
    rows: int
    corner_m: tuple[float, float]
    """x and y of the first cell."""
    frames_per_s: float
    """How fast the numbers of frames run."""


CELL_M = 0.025
WILDTRACK = Layout("Wildtrack", "intrinsic_zero", 0.01, 480, 1440, (-3.0, -9.0), 10.0)
MULTIVIEWX = Layout("MultiviewX", "intrinsic", 1.0, 1000, 640, (0.0, 0.0), 2.0)


def layout_of(folder: Path) -> Layout | None:
    """Which of them a folder has; None for neither."""
    if not (folder / POSITIONS).is_dir():
        return None
    calibrations = folder / CALIBRATIONS
    return next((one for one in (WILDTRACK, MULTIVIEWX) if (calibrations / one.intrinsics).is_dir()), None)


def place_m(layout: Layout, position: int) -> tuple[float, float]:
    """x and y of a cell by its number. ValueError for one outside the grid."""
    row, column = divmod(position, layout.columns)
    if not 0 <= row < layout.rows:
        raise ValueError(f"positionID is {position}; {layout.name} has {layout.columns * layout.rows} cells")
    return layout.corner_m[0] + CELL_M * column, layout.corner_m[1] + CELL_M * row
