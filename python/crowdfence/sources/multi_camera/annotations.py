"""annotations_positions: where everybody stood, and the box around each in each camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from crowdfence.sources.multi_camera.layout import POSITIONS, Layout, place_m


class Annotated(NamedTuple):
    """One frame, of all cameras."""

    person: NDArray[np.uint32]
    """[P] numbers of the people, from 1."""
    position: NDArray[np.float32]
    """[P, 3] their feet, metres."""
    boxes: list[NDArray[np.float64]]
    """One array [B, 4] per camera: left, top, right, bottom in pixels, of the people that it shows."""


def annotation_files(folder: Path) -> dict[int, Path]:
    """By number of the frame, increasing. ValueError when there is none."""
    files = {int(path.stem): path for path in (folder / POSITIONS).glob("*.json") if path.stem.isdecimal()}
    if not files:
        raise ValueError(f"{folder / POSITIONS} holds no annotations (<number>.json)")
    return dict(sorted(files.items()))


def read_annotations(path: Path, layout: Layout, cameras: int) -> Annotated:
    """ValueError for a file that is no annotation of this layout."""
    try:
        listed = json.loads(path.read_text(encoding="utf-8"))
        # Who is listed twice at one place would make a crowd of a couple.
        people = list({(int(one["personID"]), int(one["positionID"])): one for one in listed}.values())
        position = [(*place_m(layout, int(one["positionID"])), 0.0) for one in people]
        person = [int(one["personID"]) + 1 for one in people]
        boxes: list[list[list[float]]] = [[] for _ in range(cameras)]
        for one in people:
            for view in one["views"]:
                box = _box(view)
                if box is not None:
                    boxes[_camera(view, cameras)].append(box)
        return Annotated(
            np.array(person, np.uint32),
            np.array(position, np.float32).reshape(-1, 3),
            [np.array(some, np.float64).reshape(-1, 4) for some in boxes],
        )
    except (ValueError, KeyError, TypeError, IndexError, OverflowError, RecursionError) as error:
        raise ValueError(f"{path} is no annotation of {layout.name}: {error!r}") from error


def _camera(view: dict[str, Any], cameras: int) -> int:
    number = int(view["viewNum"])
    if not 0 <= number < cameras:
        raise ValueError(f"viewNum is {number}; there are {cameras} cameras")
    return number


def _box(view: dict[str, Any]) -> list[float] | None:
    """None where the camera does not show the person: all are -1 then."""
    box = [float(view[side]) for side in ("xmin", "ymin", "xmax", "ymax")]
    return box if box[2] > box[0] and box[3] > box[1] else None
