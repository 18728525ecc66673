"""The bundled mission's map without what is far from its flight: a tenth of it, read in a tenth of the time.

For tests that are about something else; those of maps and of the demo itself take the whole one.
"""

from functools import cache
from pathlib import Path

import numpy as np

import crowdfence
from crowdfence import _core
from crowdfence.octomap_frame import annotated, described

_WHOLE = Path(crowdfence.__file__).parent / "demo_data" / "race.bt"
_MIDDLE_M = (-625.0, 80.0)
"""Of the flight, which is 90 m long; its cameras look 200 m far."""
_REACH_M = 300.0


def write_near_ground(folder: Path) -> Path:
    path = folder / "near_race.bt"
    path.write_bytes(_near_ground())
    return path


@cache
def _near_ground() -> bytes:
    terrain = crowdfence.Terrain.open(_WHOLE)
    away_m = np.abs(terrain.voxel_centers(np.arange(terrain.voxel_count))[:, :2] - _MIDDLE_M)
    near = np.flatnonzero((away_m < _REACH_M).all(axis=1))
    return annotated(_core.write_octomap_binary(terrain, near), described(terrain))
