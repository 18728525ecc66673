"""Draws many instances of meshes: culls what is out of view, picks the level of detail, one call per mesh."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.rendering.clip_space import inside
from crowdfence.simulation.rendering.instances import COLUMNS, LAYOUT, NAMES, PLACE, Rows
from crowdfence.simulation.rendering.mesh_catalogue import MeshFamily
from crowdfence.simulation.rendering.meshes.shape import Shape

if TYPE_CHECKING:
    import moderngl

_FLOAT_BYTES = 4
_MESH_LAYOUT = "3f 3f 4f1 1f1 3x1"
_MESH_NAMES = ("in_position", "in_normal", "in_colour", "in_limb")
_MESH_VERTEX = np.dtype(
    [("position", np.float32, 3), ("normal", np.float32, 3), ("colour", np.uint8, 4), ("limb", np.uint8, 4)]
)


@dataclass(slots=True)
class _Mesh:
    """One mesh on the GPU, drawn by the picture's and by the shadow's program."""

    picture: moderngl.VertexArray
    shadow: moderngl.VertexArray


@dataclass(frozen=True, slots=True)
class Batch:
    """Instances of one variant of one family."""

    family: str
    variant: int
    rows: Rows


class ThingPainter:
    """Meshes of all families, and the two programs that draw them."""

    def __init__(
        self,
        context: moderngl.Context,
        picture: moderngl.Program,
        shadow: moderngl.Program,
        families: dict[str, MeshFamily],
        capacity: int,
    ) -> None:
        self._context, self._picture, self._shadow = context, picture, shadow
        self._families = families
        self._radius_m = {name: family.radius_m for name, family in families.items()}
        self._instances = context.buffer(reserve=max(capacity, 1) * COLUMNS * _FLOAT_BYTES, dynamic=True)
        self._capacity = max(capacity, 1)
        self._meshes = {
            (name, variant, level): self._upload(shape)
            for name, family in families.items()
            for variant, levels in enumerate(family.variants)
            for level, shape in enumerate(levels)
        }

    def _upload(self, shape: Shape) -> _Mesh:
        vertices = np.zeros(len(shape.position), _MESH_VERTEX)
        vertices["position"], vertices["normal"], vertices["colour"] = (
            shape.position,
            shape.normal,
            shape.colour,
        )
        vertices["limb"][:, 0] = shape.limb
        mesh = self._context.buffer(vertices.tobytes())
        index = self._context.buffer(shape.triangles.astype(np.uint32).tobytes())
        arrays = [
            self._context.vertex_array(
                program,
                [(mesh, _MESH_LAYOUT, *_MESH_NAMES), (self._instances, LAYOUT, *NAMES)],
                index,
                skip_errors=True,
            )
            for program in (self._picture, self._shadow)
        ]
        return _Mesh(*arrays)

    def paint(self, batches: list[Batch], planes: NDArray[np.float64], eye: NDArray[np.float64]) -> None:
        """Draw into the current picture what lies inside `planes`, in detail that fits its distance."""
        for batch in batches:
            family = self._families[batch.family]
            place = batch.rows[:, PLACE].astype(np.float64)
            radius = self._radius_m[batch.family] * place[:, 3]
            seen = inside(planes, place[:, :3], radius)
            if not seen.any():
                continue
            rows, distance = batch.rows[seen], np.linalg.norm(place[seen, :3] - eye, axis=1) / place[seen, 3]
            level = np.where(distance < family.near_m, 2, np.where(distance < family.middle_m, 1, 0))
            self._set_family(self._picture, family)
            if family.closed:
                self._context.enable(self._context.CULL_FACE)
            else:
                self._context.disable(self._context.CULL_FACE)
            for detail in (2, 1, 0):
                mesh = self._meshes[batch.family, batch.variant, detail]
                self._draw(mesh.picture, rows[level == detail])

    def cast(self, batches: list[Batch], planes: NDArray[np.float64], level: int) -> None:
        """Draw into the current shadow map, in one level of detail."""
        for batch in batches:
            family = self._families[batch.family]
            place = batch.rows[:, PLACE].astype(np.float64)
            seen = inside(planes, place[:, :3], self._radius_m[batch.family] * place[:, 3])
            if seen.any():
                self._set_family(self._shadow, family)
                self._draw(self._meshes[batch.family, batch.variant, level].shadow, batch.rows[seen])

    @staticmethod
    def _set_family(program: moderngl.Program, family: MeshFamily) -> None:
        for name, value in (("u_motion", int(family.motion)), ("u_material", int(family.material))):
            if name in program:
                program[name].value = value  # type: ignore[union-attr]

    def _draw(self, array: moderngl.VertexArray, rows: Rows) -> None:
        for start in range(0, len(rows), self._capacity):
            part = np.ascontiguousarray(rows[start : start + self._capacity])
            self._instances.orphan()
            self._instances.write(part.tobytes())
            array.render(instances=len(part))
