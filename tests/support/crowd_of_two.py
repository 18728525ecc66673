"""One crowd that two drones see from above, where the poses of one may be wrong."""

from collections.abc import Iterable

import numpy as np

from crowdfence import Camera, View
from support.small_service import START_NS


def seen_by_two(off_m: float, seconds: Iterable[int] = range(8)) -> list[View]:
    """uav1 and uav2 30 m above a crowd of 4 m radius; the poses of uav2 say that it is so far to the east."""
    camera = Camera.pinhole(160, 120, 120.0, 120.0, 80.0, 60.0)
    u, v = np.meshgrid(np.arange(16) + 0.5, np.arange(12) + 0.5)
    below = np.hypot(u - 8.0, v - 6.0) * 2.5 < 4.0  # a cell is 2.5 m of ground
    views = []
    for second in seconds:
        for drone, east_m in (("uav1", 25.0), ("uav2", 25.0 + off_m)):
            pose = np.diag([1.0, -1.0, -1.0, 1.0])
            pose[:3, 3] = east_m, 30.0, 30.0
            heatmap = np.where(below, np.float32(0.95), np.float32(0.0))
            views.append(View(drone, START_NS + second * 10**9, camera, pose, heatmap))
    return views
