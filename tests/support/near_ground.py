"""The bundled mission's map without what is far from its flight: a tenth of it, read in a tenth of the time.

For tests that are about something else; those of maps and of the demo itself take the whole one.
"""

from functools import cache
from pathlib import Path

import numpy as np

import crowdfence
from crowdfence import _core

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
    whole = _WHOLE.read_bytes()
    terrain = _core.Terrain.from_octomap(whole)
    away_m = np.abs(terrain.voxel_centers(np.arange(terrain.voxel_count))[:, :2] - _MIDDLE_M)
    near = _core.write_octomap_binary(terrain, np.flatnonzero((away_m < _REACH_M).all(axis=1)))
    # Where it lies on Earth is said by comments in the header of the whole one.
    comments = [
        line for line in whole[:1000].split(b"\nid ")[0].split(b"\n") if line.startswith(b"# crowdfence")
    ]
    first, rest = near.split(b"\n", 1)
    return b"\n".join([first, *comments, rest])
