"""Which meshes stand for which kind of thing, and how they are drawn."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import IntEnum
from functools import partial

from crowdfence.simulation.landscape.props import PropKind
from crowdfence.simulation.rendering.meshes import (
    creatures,
    cycles,
    fairground,
    figures,
    plants,
    stones,
    vehicles,
)
from crowdfence.simulation.rendering.meshes.shape import Shape


class Material(IntEnum):
    """How shaders/thing.frag colours a mesh."""

    PLAIN = 0
    FOLIAGE = 1
    STONE = 2
    CLOTHED = 3


class Motion(IntEnum):
    """How shaders/thing.glsl moves a mesh."""

    STILL = 0
    PERSON = 1
    CYCLIST = 2
    CLOTH = 3


@dataclass(frozen=True, slots=True)
class MeshFamily:
    """Variants of one kind of thing, each in three levels of detail (0 = far)."""

    variants: tuple[tuple[Shape, Shape, Shape], ...]
    material: Material = Material.PLAIN
    motion: Motion = Motion.STILL
    near_m: float = 55.0
    """Closer than this: level 2."""
    middle_m: float = 130.0
    """Closer than this: level 1."""
    closed: bool = False
    """No face is ever seen from behind."""
    on_slope: bool = False
    """Stands aslant on sloping ground."""

    @property
    def radius_m(self) -> float:
        """Of a sphere around the foot that holds every variant at scale 1."""
        return float(
            max((shape.position**2).sum(axis=1).max() ** 0.5 for levels in self.variants for shape in levels)
        )


def _levels(make: Callable[[int], Shape]) -> tuple[Shape, Shape, Shape]:
    return make(0), make(1), make(2)


def _seeded(make: Callable[[int, int], Shape], variants: int) -> tuple[tuple[Shape, Shape, Shape], ...]:
    return tuple((make(0, seed), make(1, seed), make(2, seed)) for seed in range(variants))


def _plain(make: Callable[[int], Shape], *, on_slope: bool = False) -> MeshFamily:
    return MeshFamily((_levels(make),), on_slope=on_slope)


def prop_families() -> dict[PropKind, MeshFamily]:
    """The meshes of everything that stands in a landscape."""
    leafy = partial(MeshFamily, material=Material.FOLIAGE, near_m=60.0, middle_m=150.0, closed=True)
    return {
        "conifer": leafy(_seeded(plants.conifer, 3)),
        "broadleaf": leafy(_seeded(plants.broadleaf, 3)),
        "birch": leafy(_seeded(plants.birch, 2)),
        "bush": leafy(_seeded(plants.bush, 3), near_m=32.0, middle_m=80.0),
        "rock": MeshFamily(_seeded(stones.rock, 4), Material.STONE, near_m=40.0, closed=True),
        "tent": _plain(fairground.tent, on_slope=True),
        "marquee": _plain(fairground.marquee, on_slope=True),
        "car": _plain(vehicles.car, on_slope=True),
        "van": _plain(vehicles.van, on_slope=True),
        "boat": _plain(vehicles.boat, on_slope=True),
        "barrier": _plain(fairground.barrier, on_slope=True),
        "flag": MeshFamily((_levels(fairground.flag),), motion=Motion.CLOTH),
        "post": _plain(fairground.post),
        "lamp": _plain(fairground.lamp),
        "parasol": _plain(fairground.parasol),
        "towel": _plain(fairground.towel, on_slope=True),
        "statue": MeshFamily((_levels(creatures.statue),), Material.STONE),
        "scarecrow": _plain(fairground.scarecrow),
        "cow": _plain(creatures.cow, on_slope=True),
        "stage": _plain(fairground.stage),
        "bale": _plain(fairground.bale, on_slope=True),
    }


def people_family() -> MeshFamily:
    """One variant per kind of person."""
    variants = tuple(_levels(partial(figures.figure, style)) for style in figures.FIGURE_STYLES)
    return MeshFamily(variants, Material.CLOTHED, Motion.PERSON, near_m=32.0, middle_m=75.0, closed=True)


def cyclist_family() -> MeshFamily:
    """Rider and bicycle."""
    rider = cycles.cyclist()
    return MeshFamily(((rider, rider, rider),), Material.CLOTHED, Motion.CYCLIST)
