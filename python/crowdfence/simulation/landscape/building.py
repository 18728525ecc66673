"""A building: a solid that every map knows."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.triangle_mesh import TriangleMesh


@dataclass(frozen=True, slots=True)
class Building:
    """Closed mesh with a colour and a window flag per triangle."""

    mesh: TriangleMesh
    colour: NDArray[np.uint8]
    """[M, 3] sRGB per triangle."""
    windows: NDArray[np.bool_]
    """[M] whether the face is a wall with windows."""
    foot_m: float
    """Height of the ground floor."""
