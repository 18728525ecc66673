"""Things that stand on the ground and are not part of the known map: trees, rocks, cars, tents, flags, ..."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray

PropKind = Literal[
    "conifer",
    "broadleaf",
    "birch",
    "bush",
    "rock",
    "tent",
    "marquee",
    "car",
    "van",
    "barrier",
    "flag",
    "post",
    "lamp",
    "parasol",
    "towel",
    "boat",
    "statue",
    "scarecrow",
    "cow",
    "stage",
    "bale",
]
PROP_KINDS: tuple[PropKind, ...] = get_args(PropKind)


@dataclass(frozen=True, slots=True)
class Props:
    """Many things of one kind."""

    kind: PropKind
    position: NDArray[np.float64]
    """[N, 3] foot on the ground, local ENU metres."""
    heading_rad: NDArray[np.float64]
    """[N] direction of the thing's front, counter-clockwise from east."""
    scale: NDArray[np.float64]
    """[N] factor on the mesh, which is drawn in metres."""
    colour: NDArray[np.uint8]
    """[N, 3] sRGB main colour."""
