"""Triangles in local ENU metres."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class TriangleMesh:
    """Indexed triangles, counter-clockwise seen from outside."""

    vertices: NDArray[np.float64]
    """[N, 3] local ENU metres."""
    triangles: NDArray[np.int32]
    """[M, 3] indices into `vertices`."""


def merged(meshes: Sequence[TriangleMesh]) -> TriangleMesh:
    """All triangles of several meshes as one mesh."""
    if not meshes:
        return TriangleMesh(np.zeros((0, 3)), np.zeros((0, 3), np.int32))
    starts = np.cumsum([0] + [len(mesh.vertices) for mesh in meshes[:-1]])
    return TriangleMesh(
        np.concatenate([mesh.vertices for mesh in meshes]),
        np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=True)]).astype(
            np.int32
        ),
    )
