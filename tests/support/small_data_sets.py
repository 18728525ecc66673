"""Small folders in the layouts of Wildtrack and MultiviewX, worked out from points and matrices alone."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

SIZE = (480, 270)
FOCAL_PX = 300.0
MIDDLE_PX = (239.5, 134.5)
"""From the middle of the first pixel, as OpenCV counts."""
BODY_M = (0.5, 1.75)
"""Width and height of a person."""


class DataSet(NamedTuple):
    wildtrack: bool
    eyes: list[tuple[float, float, float]]
    """Where the cameras stand, metres."""
    towards: tuple[float, float, float]
    """What all of them look at."""
    people: list[list[tuple[float, float]]]
    """Per frame, on cells of the grid."""


def camera_from_world(eye: tuple[float, float, float], towards: tuple[float, float, float]) -> NDArray:
    """[4, 4], metres."""
    forward = np.subtract(towards, eye)
    forward = forward / np.linalg.norm(forward)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(forward, right), forward])
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = axes, -axes @ eye
    return transform


def write_data_set(folder: Path, data: DataSet, *, pictures: bool = False) -> Path:
    for name in ("annotations_positions", "calibrations/extrinsic"):
        (folder / name).mkdir(parents=True)
    intrinsics = folder / "calibrations" / ("intrinsic_zero" if data.wildtrack else "intrinsic")
    intrinsics.mkdir()
    names = ["CVLab1", "CVLab2", "IDIAP1"] if data.wildtrack else ["Camera1", "Camera2", "Camera3"]
    transforms = [camera_from_world(eye, data.towards) for eye in data.eyes]
    matrix = [[FOCAL_PX, 0, MIDDLE_PX[0]], [0, FOCAL_PX, MIDDLE_PX[1]], [0, 0, 1]]
    for name, transform in zip(names, transforms, strict=False):
        (intrinsics / f"intr_{name}.xml").write_text(_storage(camera_matrix=_matrix(matrix)))
        rvec = Rotation.from_matrix(transform[:3, :3]).as_rotvec()
        tvec = transform[:3, 3] * (100.0 if data.wildtrack else 1.0)
        plain = " ".join if data.wildtrack else lambda numbers: _matrix([[one] for one in numbers])
        poses = {
            key: plain([repr(float(x)) for x in values]) for key, values in (("rvec", rvec), ("tvec", tvec))
        }
        (folder / "calibrations" / "extrinsic" / f"extr_{name}.xml").write_text(_storage(**poses))
    for number, people in enumerate(data.people):
        frame = number * (5 if data.wildtrack else 1)
        annotated = [_annotated(data, person, place, transforms) for person, place in enumerate(people)]
        digits = 8 if data.wildtrack else 5
        path = folder / "annotations_positions" / f"{frame:0{digits}}.json"
        path.write_text(json.dumps(annotated))
        for at in range(len(transforms) if pictures else 0):
            place = folder / "Image_subsets" / f"C{at + 1}"
            place.mkdir(parents=True, exist_ok=True)
            Image.new("RGB", SIZE, (at, number, 0)).save(place / f"{frame:0{8 if data.wildtrack else 4}}.png")
    return folder


def _annotated(data: DataSet, person: int, place: tuple[float, float], transforms: list[NDArray]) -> dict:
    corner, columns = ((-3.0, -9.0), 480) if data.wildtrack else ((0.0, 0.0), 1000)
    column, row = (round((x - low) / 0.025) for x, low in zip(place, corner, strict=True))
    views = []
    for number, transform in enumerate(transforms):
        across = transform[0, :2] / np.linalg.norm(transform[0, :2]) * BODY_M[0] / 2.0
        body = [(*(place + side * across), z) for side in (-1, 1) for z in (0.0, BODY_M[1])]
        points = np.array(body) @ transform[:3, :3].T + transform[:3, 3]
        box = [-1, -1, -1, -1]
        if (points[:, 2] > 0.1).all():
            pixels = points[:, :2] / points[:, 2:] * FOCAL_PX + MIDDLE_PX
            low, high = pixels.min(axis=0), pixels.max(axis=0)
            if (high > 0.0).all() and (low < SIZE).all():
                box = [round(float(one)) for one in (*low, *high)]
        sides = dict(zip(("xmin", "ymin", "xmax", "ymax"), box, strict=True))
        views.append({"viewNum": number, **sides})
    return {"personID": person, "positionID": row * columns + column, "views": views}


def _storage(**nodes: str) -> str:
    inside = "".join(f"<{name}>{text}</{name}>" for name, text in nodes.items())
    return f'<?xml version="1.0"?><opencv_storage>{inside}</opencv_storage>'


def _matrix(rows: list) -> str:
    data = " ".join(str(number) for row in rows for number in row)
    return f"<rows>{len(rows)}</rows><cols>{len(rows[0])}</cols><dt>d</dt><data>\n{data}</data>"
