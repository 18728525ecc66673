"""The states of a run's `crowd_map.tif`, and everything that is closed, in two more forms: with a colour
table, and as a map for navigation (`map_server` of ROS: a PGM picture and a YAML file beside it).

In the navigation map only ground that is known to be empty and in no zone is free; crowd and all that a zone
reaches into is occupied, the rest is unknown.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path
from crowdfence.exports.closed_cells import CLOSED, reach_beyond, state_values, with_closed
from crowdfence.exports.colours import CLOSED_COLOUR, STATE_COLOURS
from crowdfence.exports.geotiff import LOCAL_TAG
from crowdfence.voxel_state import VoxelState
from crowdfence.zones import Zone
from crowdfence.zones.zone import closed_of

if TYPE_CHECKING:
    from affine import Affine

OCCUPIED, UNKNOWN, FREE = 0, 205, 254
"""Grey values of `map_server`."""
_STATE_BAND = 2
_OPAQUE = 255


def write_state_geotiff(
    path: str | PathLike[str], crowd_map: str | PathLike[str], zones: Sequence[Zone]
) -> list[str]:
    """Bytes with the states as values, 6 where a zone reaches into a cell without crowd, and their colours as
    the file's colour table. The ids of zones that do not lie within it, all of them or in part. OSError."""
    import rasterio

    zones = closed_of(zones)
    state, local, profile = _states_of(crowd_map)
    profile |= {"driver": "GTiff", "count": 1, "dtype": "uint8", "nodata": None, "compress": "deflate"}
    profile |= {"photometric": "palette"}
    colours = {known.value: STATE_COLOURS[known] for known in VoxelState} | {CLOSED: CLOSED_COLOUR}
    with atomic_path(path) as temporary, rasterio.open(temporary, "w", **profile) as raster:
        # The colours first: a file whose pixels are begun keeps them where only GDAL looks.
        raster.write_colormap(1, {value: (*colour, _OPAQUE) for value, colour in colours.items()})
        raster.write(with_closed(state, zones, local), 1)
        raster.set_band_description(1, "state, and what zones close")
        raster.update_tags(VALUES=state_values())
    return reach_beyond(zones, state.shape, local)


def write_costmap(
    path: str | PathLike[str], crowd_map: str | PathLike[str], zones: Sequence[Zone]
) -> list[str]:
    """A YAML file, and a picture of the same name beside it. What it gives back is the same. OSError.

    Metres are those of the local frame, in which vehicles fly: such a map has no projection, and those of one
    are shorter on high ground, by 38 cm at 2 km and 1200 m.
    """
    path, zones = Path(path), closed_of(zones)
    state, local, _ = _states_of(crowd_map)
    shown = with_closed(state, zones, local)
    grey = np.full(state.shape, UNKNOWN, dtype=np.uint8)
    grey[shown == VoxelState.EMPTY] = FREE
    grey[(shown == VoxelState.CROWD) | (shown == CLOSED)] = OCCUPIED
    picture = path.with_suffix(".pgm")
    height, width = state.shape
    south = local.f + height * local.e
    text = (
        f"image: {_in_yaml(picture.name)}\nresolution: {local.a!r}\n"
        f"origin: [{local.c!r}, {south!r}, 0.0]\nnegate: 0\n"
        "occupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
    # Both or none: cells of one map at the place of another are free where people stand.
    with atomic_path(picture) as cells, atomic_path(path) as description:
        cells.write_bytes(f"P5\n{width} {height}\n255\n".encode() + grey.tobytes())
        description.write_bytes(text.encode())
    return reach_beyond(zones, state.shape, local)


def _in_yaml(name: str) -> str:
    """As it is where YAML takes it for text, else in quotes, as JSON has them."""
    return name if re.fullmatch(r"[A-Za-z][\w.-]*", name, re.ASCII) else json.dumps(name, ensure_ascii=False)


def _states_of(crowd_map: str | PathLike[str]) -> tuple[NDArray[np.uint8], Affine, dict[str, Any]]:
    """States, where their cells lie in local metres, and how the file is placed."""
    import rasterio
    from affine import Affine

    with rasterio.open(crowd_map) as raster:
        state = raster.read(_STATE_BAND).astype(np.uint8)
        placed = {name: raster.profile[name] for name in ("width", "height", "crs", "transform")}
        if LOCAL_TAG not in raster.tags() and raster.crs is not None:
            raise ValueError(
                f"{crowd_map} does not say where its cells lie in the local frame, in which zones are drawn: "
                "it was written before it held zones; run again"
            )
        told = raster.tags().get(LOCAL_TAG)
        return state, placed["transform"] if told is None else Affine(*json.loads(told)), placed
