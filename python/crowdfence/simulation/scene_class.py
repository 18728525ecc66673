"""What a pixel of a simulated image shows."""

from __future__ import annotations

from enum import IntEnum


class SceneClass(IntEnum):
    """Classes of the paper's dataset; the numbers are also the AirSim palette ids of the segmentation.

    Plants, rocks, buildings, cars and tents are ground, and so is a person who is in no crowd: such a
    person keeps an instance id.
    """

    SKY = 0
    GROUND = 1
    ROAD = 2
    CROWD = 3
    CYCLIST = 4
