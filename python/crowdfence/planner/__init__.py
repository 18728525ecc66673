"""What a planner asks of the zones: is a place clear, is a path, is there a way round.

- `clear_air`  points and paths in space and time against the zones that were known then
- `route`      the shortest way round the zones of one moment
- `corners`    where a way may turn, and which of these places see each other
- `open_ground`  a way where there are too many of them to look along
- `zones_met`  of thousands of zones those that a way has to do with
- `way_out`    the nearest clear place
- `timed_way`  the earliest one where zones have an end
- `seen_ground`  how much of a way lies over ground that nobody has seen empty, and such ground as a zone
- `told_in_degrees`  how far from zones a way is kept where both are told in degrees
"""

from crowdfence.planner.clear_air import ClearAir, Conflict
from crowdfence.planner.route import NoRoute, Route, safe_route
from crowdfence.planner.way_out import way_out

__all__ = ["ClearAir", "Conflict", "NoRoute", "Route", "safe_route", "way_out"]
