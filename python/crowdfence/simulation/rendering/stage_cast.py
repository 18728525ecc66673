"""Rows for the GPU from what stands and moves in a scene."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from crowdfence.simulation.landscape.landscape import Landscape
from crowdfence.simulation.landscape.props import Props
from crowdfence.simulation.people.bodies import Bodies
from crowdfence.simulation.rendering.instances import (
    COLOURS,
    LABEL,
    PLACE,
    POSE,
    TURN,
    instance_rows,
    packed_colours,
    seeds,
)
from crowdfence.simulation.rendering.mesh_catalogue import MeshFamily
from crowdfence.simulation.rendering.meshes.figures import FIGURE_HEIGHT_M
from crowdfence.simulation.rendering.season_palette import SeasonPalette
from crowdfence.simulation.rendering.thing_painter import Batch
from crowdfence.simulation.scene_class import SceneClass

_STRIDE_PER_M_S = 0.42
_MAX_STRIDE_RAD = 0.62
_JERSEYS = np.array(
    [[214, 40, 44], [240, 200, 40], [40, 110, 200], [240, 240, 240], [60, 160, 80], [230, 110, 170]], np.uint8
)


def prop_batches(
    landscape: Landscape, families: dict[str, MeshFamily], palette: SeasonPalette
) -> list[Batch]:
    """Everything that stands in the landscape, sorted by mesh."""
    batches = []
    for kind in sorted({props.kind for props in landscape.props}):
        rows = np.concatenate(
            [
                _prop_rows(props, landscape, families[kind], palette)
                for props in landscape.props
                if props.kind == kind
            ]
        )
        variants = len(families[kind].variants)
        batches += [
            Batch(kind, variant, rows[variant::variants])
            for variant in range(variants)
            if len(rows) > variant
        ]
    return batches


def _prop_rows(
    props: Props, landscape: Landscape, family: MeshFamily, palette: SeasonPalette
) -> NDArray[np.float32]:
    rows = instance_rows(len(props.position))
    rows[:, PLACE] = np.column_stack([props.position, props.scale])
    rows[:, TURN.start] = props.heading_rad
    if family.on_slope:
        x, y = props.position[:, 0], props.position[:, 1]
        rows[:, TURN.start + 1] = (landscape.height_m(x + 1, y) - landscape.height_m(x - 1, y)) / 2
        rows[:, TURN.start + 2] = (landscape.height_m(x, y + 1) - landscape.height_m(x, y - 1)) / 2
    rows[:, TURN.stop - 1] = seeds(len(rows))
    rows[:, COLOURS.start] = packed_colours(palette.things(props.kind, props.colour))
    rows[:, LABEL.start] = SceneClass.GROUND
    return rows


def people_rows(
    position: NDArray[np.float64],
    heading_rad: NDArray[np.float64],
    speed_m_s: NDArray[np.float64],
    phase: NDArray[np.float64],
    arms: NDArray[np.float64],
    in_crowd: NDArray[np.bool_],
    colours: NDArray[np.uint8],
    height_m: NDArray[np.float64],
    bodies: Bodies,
) -> NDArray[np.float32]:
    """All people [P] of an instant; person p has instance id p + 1."""
    count = len(position)
    rows = instance_rows(count)
    rows[:, PLACE] = np.column_stack([position, height_m / FIGURE_HEIGHT_M])
    rows[:, TURN] = np.column_stack([heading_rad, bodies.girth, bodies.stance_rad, seeds(count)])
    stride = np.minimum(_STRIDE_PER_M_S * speed_m_s, _MAX_STRIDE_RAD)
    which_arms = 1 + np.arange(count) * 7 % 3
    rows[:, POSE] = np.column_stack([phase, stride, arms, which_arms])
    rows[:, COLOURS] = packed_colours(colours)
    rows[:, LABEL.start] = np.where(in_crowd, SceneClass.CROWD, SceneClass.GROUND)
    rows[:, LABEL.stop - 1] = np.arange(1, count + 1)
    return rows


def people_batches(rows: NDArray[np.float32], kind: NDArray[np.uint8], kinds: int) -> list[Batch]:
    """People sorted by kind of body."""
    return [Batch("person", k, rows[kind == k]) for k in range(kinds) if (kind == k).any()]


def cyclist_batches(
    position: NDArray[np.float64],
    heading_rad: NDArray[np.float64],
    pitch_rad: NDArray[np.float64],
    pedal_phase: NDArray[np.float64],
    first_instance_id: int,
) -> list[Batch]:
    """All cyclists of an instant, each in a jersey of its own."""
    count = len(position)
    if not count:
        return []
    rows = instance_rows(count)
    rows[:, PLACE] = np.column_stack([position, np.ones(count)])
    rows[:, TURN] = np.column_stack([heading_rad, pitch_rad, np.zeros(count), 0.3 + 0.6 * seeds(count)])
    rows[:, POSE.start] = pedal_phase
    jersey = _JERSEYS[np.arange(count) % len(_JERSEYS)]
    helmet = _JERSEYS[(np.arange(count) + 3) % len(_JERSEYS)]
    skin = np.broadcast_to(np.array([214, 164, 128], np.uint8), (count, 3))
    shorts = np.broadcast_to(np.array([30, 30, 34], np.uint8), (count, 3))
    rows[:, COLOURS] = packed_colours(np.stack([skin, shorts, jersey, shorts, helmet, helmet], axis=1))
    rows[:, LABEL.start] = SceneClass.CYCLIST
    rows[:, LABEL.stop - 1] = first_instance_id + np.arange(count)
    return [Batch("cyclist", 0, rows)]
