"""GeoTIFF and LAS files whose keys are exactly those that a test names, which no library writes."""

import struct
from pathlib import Path

import laspy
import numpy as np
from numpy.typing import ArrayLike


def directory(keys: dict[int, int | str]) -> tuple[bytes, bytes]:
    """The directory of GeoTIFF 1.0 keys, numbers or texts, and the texts."""
    text, entries = b"", []
    for key, value in sorted(keys.items()):
        if isinstance(value, str):
            entries.append((key, 34737, len(value) + 1, len(text)))
            text += value.encode() + b"|"
        else:
            entries.append((key, 0, 1, value))
    numbers = [1, 1, 0, len(entries), *(number for entry in entries for number in entry)]
    return struct.pack(f"<{len(numbers)}H", *numbers), text


def write_tiff(
    path: Path, heights: ArrayLike, keys: dict[int, int | str], *, west: float, north: float
) -> Path:
    """A TIFF of one strip of float32 heights [rows, columns], with pixels of 1."""
    pixels = np.asarray(heights, "<f4")
    rows, columns = pixels.shape
    numbers, text = directory(keys)
    scale, tie = struct.pack("<3d", 1.0, 1.0, 0.0), struct.pack("<6d", 0.0, 0.0, 0.0, west, north, 0.0)
    tags = [(256, 4, 1, columns), (257, 4, 1, rows), (258, 3, 1, 32), (259, 3, 1, 1), (262, 3, 1, 1)]
    tags += [(273, 4, 1, 8), (277, 3, 1, 1), (278, 4, 1, rows), (279, 4, 1, pixels.nbytes), (339, 3, 1, 3)]
    body = pixels.tobytes()
    for tag, kind, size, data in ((33550, 12, 8, scale), (33922, 12, 8, tie), (34735, 3, 2, numbers)):
        tags.append((tag, kind, len(data) // size, 8 + len(body)))
        body += data
    if text:
        tags.append((34737, 2, len(text) + 1, 8 + len(body)))
        body += text + b"\0"
    entries = b"".join(struct.pack("<HHII", *tag) for tag in tags)
    head = b"II*\0" + struct.pack("<I", 8 + len(body))
    path.write_bytes(head + body + struct.pack("<H", len(tags)) + entries + bytes(4))
    return path


def write_las(path: Path, points: ArrayLike, keys: dict[int, int | str]) -> Path:
    """A LAS 1.2 file of ground points [N, 3], to the millimetre."""
    x, y, z = np.asarray(points, np.float64).T
    header = laspy.LasHeader(point_format=1, version="1.2")
    header.offsets, header.scales = np.floor([x.min(), y.min(), z.min()]), np.full(3, 0.001)
    numbers, text = directory(keys)
    header.vlrs.append(laspy.VLR("LASF_Projection", 34735, record_data=numbers))
    if text:
        header.vlrs.append(laspy.VLR("LASF_Projection", 34737, record_data=text + b"\0"))
    cloud = laspy.LasData(header)
    cloud.x, cloud.y, cloud.z = x, y, z
    cloud.classification = np.full(len(x), 2)
    cloud.write(path)
    return path
