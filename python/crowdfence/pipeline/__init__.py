"""From a recording to a crowd map and zones, one step per file:

- `clocks`           whether the drones count time alike
- `terrain`          the map to project onto
- `choose_detector`  which detector looks
- `detect`           frames -> heatmaps -> views
- `frame_loop`       the views of one instant -> what happened, zones included
- `flight_doubts`    what all views of a flight tell of one another
- `nobody_shown`     heatmaps that are 0 everywhere, of a whole flight
- `denied_crowd`     drones that see nobody where others clearly show a crowd
- `lost_crowd`       crowd that met no ground, or became none anywhere: shares and warnings
- `unheeded_crowd`   crowd that every look at a place shows, and that never becomes any there
- `detector_review`  what a model states about itself beside the flight
- `untested_ground`  ground of newest looks that the detector was not tested on
- `still_video`      the same picture again and again from a camera that moves
- `under_ground`     cameras below the map
- `run`              a whole recording through these
"""

from crowdfence.pipeline.choose_detector import choose_detector, named_detector, suitable_model
from crowdfence.pipeline.clocks import check_clocks
from crowdfence.pipeline.detect import (
    HeatmapFunction,
    HeatmapSource,
    describe_model,
    heatmap_source,
)
from crowdfence.pipeline.detector_review import (
    DetectorReview,
    review_detector,
    review_flight,
    review_statement,
)
from crowdfence.pipeline.frame_loop import FrameLoop, Step
from crowdfence.pipeline.lost_crowd import lost_crowd_warning, lost_crowd_warnings, shares
from crowdfence.pipeline.picture_watch import PictureWatch
from crowdfence.pipeline.run import Run, run
from crowdfence.pipeline.terrain import check_overlap, open_terrain, read_map

__all__ = [
    "DetectorReview",
    "FrameLoop",
    "HeatmapFunction",
    "HeatmapSource",
    "PictureWatch",
    "Run",
    "Step",
    "check_clocks",
    "check_overlap",
    "choose_detector",
    "describe_model",
    "heatmap_source",
    "lost_crowd_warning",
    "lost_crowd_warnings",
    "named_detector",
    "open_terrain",
    "read_map",
    "review_detector",
    "review_flight",
    "review_statement",
    "run",
    "shares",
    "suitable_model",
]
