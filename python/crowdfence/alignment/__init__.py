"""What the poses of a flight are constantly off, from its pictures and the map."""

from crowdfence.alignment.estimate import Alignment, DroneAlignment, Estimate, align

__all__ = ["Alignment", "DroneAlignment", "Estimate", "align"]
