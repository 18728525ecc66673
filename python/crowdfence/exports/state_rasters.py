"""The state band of a run's `crowd_map.tif` in two more forms: with a colour table, and as a map for
navigation (`map_server` of ROS: a PGM picture and a YAML file beside it).

In the navigation map only ground that is known to be empty is free; crowd and all that a zone touches is
occupied, the rest is unknown.
"""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path, write_bytes
from crowdfence.exports.colours import STATE_COLOURS
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
"""Grey values of `map_server`."""
_STATE_BAND = 2
_OPAQUE = 255


def write_state_geotiff(path: str | PathLike[str], crowd_map: str | PathLike[str]) -> None:
    """Bytes with the states as values and their colours as the file's colour table. OSError."""
    import rasterio

    state, profile = _state_of(crowd_map)
    profile |= {"driver": "GTiff", "count": 1, "dtype": "uint8", "nodata": None, "compress": "deflate"}
    profile |= {"photometric": "palette"}
    with atomic_path(path) as temporary, rasterio.open(temporary, "w", **profile) as raster:
        # The colours first: a file whose pixels are begun keeps them where only GDAL looks.
        raster.write_colormap(1, {known.value: (*STATE_COLOURS[known], _OPAQUE) for known in VoxelState})
        raster.write(state, 1)
        raster.set_band_description(1, "state")
        raster.update_tags(1, VALUES=", ".join(f"{known.value} = {known.name}" for known in VoxelState))


def write_costmap(path: str | PathLike[str], crowd_map: str | PathLike[str], zones: Sequence[Zone]) -> None:
    """A YAML file, and a picture of the same name beside it. OSError."""
    from rasterio.features import rasterize

    path = Path(path)
    state, profile = _state_of(crowd_map)
    transform = profile["transform"]
    grey = np.full(state.shape, UNKNOWN, dtype=np.uint8)
    grey[state == VoxelState.EMPTY] = FREE
    grey[state == VoxelState.CROWD] = OCCUPIED
    if zones:
        # Cells are placed to a few centimetres: what a zone touches, a hair around it too, is closed.
        shapes = [zone.polygon.buffer(0.1) for zone in zones]
        grey[rasterize(shapes, state.shape, transform=transform, all_touched=True) > 0] = OCCUPIED
    picture = path.with_suffix(".pgm")
    height, width = state.shape
    write_bytes(picture, f"P5\n{width} {height}\n255\n".encode() + grey.tobytes())
    south = transform.f + height * transform.e
    text = (
        f"image: {picture.name}\nresolution: {transform.a!r}\n"
        f"origin: [{transform.c!r}, {south!r}, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    write_bytes(path, text.encode())


def _state_of(crowd_map: str | PathLike[str]) -> tuple[NDArray[np.uint8], dict[str, Any]]:
    import rasterio

    with rasterio.open(crowd_map) as raster:
        state = raster.read(_STATE_BAND).astype(np.uint8)
        return state, {name: raster.profile[name] for name in ("width", "height", "crs", "transform")}
