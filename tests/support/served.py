"""`crowdfence serve` in a process of its own, on level ground in the Alps."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import rasterio

ORIGIN = "46.5,8.0,1200"
"""Of the views' (0, 0, 0), on the ground."""


class Served(NamedTuple):
    url: str
    process: subprocess.Popen[str]
    log: Path


def write_level_ground(path: Path) -> Path:
    """300 x 300 m, (0, 0, 0) of the views in the middle and on the ground."""
    crs = "+proj=aeqd +lat_0=46.5 +lon_0=8 +datum=WGS84"
    place = rasterio.transform.from_origin(-150.0, 150.0, 1.0, 1.0)
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": crs, "transform": place}
    with rasterio.open(path, "w", width=300, height=300, **profile) as raster:
        raster.write(np.full((300, 300), 1200.0, np.float32), 1)
    return path


@contextmanager
def serving(folder: Path, *arguments: object) -> Iterator[Served]:
    """Live views of any stamp, until the block ends; what it logs is in `log`."""
    words = ["serve", "--terrain", write_level_ground(folder / "ground.tif"), "--voxel-size-m", 1]
    words += ["--origin", ORIGIN, "--data", folder / "data", "--clock", "views", "--port", 0, "--json"]
    words += ["--terrain-option", "height_offset_m=0"]  # it counts from the ellipsoid
    log = folder / "log"
    with log.open("w") as errors:
        process = subprocess.Popen(
            [sys.executable, "-W", "ignore", "-m", "crowdfence", *map(str, [*words, *arguments])],
            stdout=subprocess.PIPE,
            stderr=errors,
            text=True,
            env={**os.environ, "NO_COLOR": "1"},
        )
    try:
        assert process.stdout is not None
        told = ""
        while not told.rstrip().endswith("}"):
            line = process.stdout.readline()
            assert line, log.read_text()
            told += line
        yield Served(json.loads(told)["url"], process, log)
    finally:
        process.terminate()
        process.wait(20)
        process.stdout.close()
