"""Truth of a simulated mission, from the world itself and not from any image or map."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera
from crowdfence.simulation.scene import Scene
from crowdfence.truth.crowd_regions import crowd_regions
from crowdfence.truth.world import truth_from_positions

if TYPE_CHECKING:
    from crowdfence._core import Terrain

CLOSING_M = 1.0
"""Gaps up to twice this wide between the silhouettes of one crowd belong to its region."""

_CHEST_OF_HEIGHT = 0.6


class Sight(IntEnum):
    """What one image shows of one person."""

    OUTSIDE = 0
    """Not in the image."""
    HIDDEN = 1
    """In the field of view, but something stands in front, or the person is too far away to fill a pixel."""
    VISIBLE = 2


@dataclass(frozen=True, slots=True)
class PeopleTruth:
    """All people at one instant (person p has instance id p + 1)."""

    position: NDArray[np.float64]
    """[P, 3] feet, local ENU metres."""
    crowd: NDArray[np.int64]
    """[P] 0 for people in no crowd by the scenario's definition; others have the number 1, 2, ... of their
    planned crowd, or the next number after those when they belong to none of them."""


def people_truth(scene: Scene, t_s: float) -> PeopleTruth:
    """Where everybody is, and who is in a crowd, at `t_s` seconds after the start of the mission."""
    people = scene.people
    position = people.positions(t_s)
    planned = np.where(people.crowd_id > 0, people.crowd_id, len(people.crowds) + 1)
    return PeopleTruth(position, np.where(people.in_crowd(position), planned, 0))


def crowd_ground(scene: Scene, terrain: Terrain, t_s: float) -> NDArray[np.bool_]:
    """Voxels [V] of `terrain` that are crowd at `t_s`, by the scenario's definition of a crowd.

    ValueError when a person in a crowd stands on no voxel: the terrain is of another scene.
    """
    definition = scene.scenario.crowd_definition
    return truth_from_positions(
        scene.people.positions(t_s), terrain, definition.radius_m, definition.min_people
    )


def visible_pixels(instance_id: NDArray[np.integer], people: int) -> NDArray[np.int64]:
    """Pixels [P] that show each person in an image of instance ids [H, W]."""
    counts = np.bincount(np.asarray(instance_id).ravel(), minlength=people + 1)
    return np.asarray(counts[1 : people + 1].astype(np.int64))


def sight_of_people(
    scene: Scene,
    truth: PeopleTruth,
    instance_id: NDArray[np.integer],
    camera: Camera,
    world_from_camera: NDArray[np.float64],
    *,
    min_pixels: int = 1,
) -> NDArray[np.uint8]:
    """`Sight` of each person [P] in an image of instance ids [H, W]: visible with at least `min_pixels`
    pixels, hidden when fewer show although the person's chest projects into the image."""
    if min_pixels < 1:
        raise ValueError(f"min_pixels must be at least 1, got {min_pixels}")
    chest = truth.position + np.array([0.0, 0.0, _CHEST_OF_HEIGHT]) * scene.people.height_m[:, None]
    in_camera = (chest - world_from_camera[:3, 3]) @ world_from_camera[:3, :3]
    pixel = camera.project(in_camera)
    inside = (
        (in_camera[:, 2] > 0.0)
        & (pixel >= 0.0).all(axis=1)
        & (pixel[:, 0] < camera.width)
        & (pixel[:, 1] < camera.height)
    )
    shown = visible_pixels(instance_id, len(truth.position)) >= min_pixels
    return np.where(shown, Sight.VISIBLE, np.where(inside, Sight.HIDDEN, Sight.OUTSIDE)).astype(np.uint8)


def region_mask(
    truth: PeopleTruth,
    instance_id: NDArray[np.integer],
    depth_m: NDArray[np.floating],
    focal_px: float,
    *,
    closing_m: float = CLOSING_M,
) -> NDArray[np.uint16]:
    """Crowd regions [H, W] of one image: number of the crowd, 0 for none.

    The silhouettes of one crowd's visible people are closed with a disc of `closing_m` at their depth and
    filled. Where regions overlap, the crowd that is nearer (by the median depth of its people) is kept.
    """
    crowd_of_id = np.zeros(max(int(np.max(instance_id, initial=0)), len(truth.crowd)) + 1, np.uint16)
    crowd_of_id[1 : len(truth.crowd) + 1] = truth.crowd
    crowd = crowd_of_id[instance_id]
    regions = np.zeros(crowd.shape, np.uint16)
    numbers = np.unique(crowd[crowd > 0])
    for number in sorted(numbers, key=lambda one: -float(np.median(depth_m[crowd == one]))):
        silhouettes = crowd == number
        region = crowd_regions(silhouettes, closing_m=closing_m, depth_m=depth_m, focal_px=focal_px)
        regions[region] = number
    return regions
