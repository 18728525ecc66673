"""One picture of the map for people: relief, probability, what was not seen, zones, drones."""

from crowdfence.exports.picture.composition import interesting_extent, write_picture
from crowdfence.exports.picture.drone_track import DroneTrack
from crowdfence.exports.picture.footprint import ground_footprint

__all__ = ["DroneTrack", "ground_footprint", "interesting_extent", "write_picture"]
