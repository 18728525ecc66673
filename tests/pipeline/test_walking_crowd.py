"""How much of a group that walks stands in its zone: the figures of docs/zones.md."""

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from crowdfence import Camera, CrowdMap, Terrain, View
from crowdfence.config import EvidenceConfig, ZoneConfig
from crowdfence.pipeline import FrameLoop
from crowdfence.voxel_state import VoxelState

SECOND_NS = 1_000_000_000
START_NS = 1_760_000_000 * SECOND_NS
SIDE = 120
CAMERA = Camera.pinhole(320, 240, 250.0, 250.0, 160.0, 120.0)
STEEP = np.sqrt(0.5)
POSE = np.array([[1, 0, 0, 60], [0, -STEEP, STEEP, 0], [0, -STEEP, -STEEP, 60], [0, 0, 0, 1]], float)
"""60 m up at the southern rim, at 45 degrees down to the middle of the map."""


def shown(x: float, radius_m: float) -> NDArray[np.float32]:
    """Heatmap of a round group in the middle row of the map."""
    row, column = np.mgrid[0:60, 0:80]
    rays = np.stack([(4 * column + 2 - 160) / 250, (4 * row + 2 - 120) / 250, np.ones_like(row)], axis=-1)
    down = rays @ POSE[:3, :3].T
    with np.errstate(divide="ignore"):
        ground = POSE[:2, 3] + (-60.0 / down[..., 2:]) * down[..., :2]
    hit = (down[..., 2] < 0.0) & (np.hypot(ground[..., 0] - x, ground[..., 1] - 60.0) < radius_m)
    return np.where(hit, np.float32(0.9), np.float32(0.02))


@pytest.mark.parametrize(
    ("radius_m", "speed_mps", "buffer_m", "memory_s", "share"),
    [
        (4.0, 1.5, 0.0, 5.0, 0.61),
        (4.0, 1.5, 3.0, 5.0, 1.0),
        (4.0, 3.0, 0.0, 5.0, 0.21),
        (4.0, 3.0, 3.0, 5.0, 0.77),
        (4.0, 3.0, 7.5, 5.0, 1.0),
        (4.0, 1.5, 0.0, 1.0, 0.93),
        (4.0, 3.0, 0.0, 1.0, 0.85),
        (8.0, 1.5, 0.0, 5.0, 0.78),
    ],
)
def test_a_group_that_walks_stands_in_its_zone(
    radius_m: float, speed_mps: float, buffer_m: float, memory_s: float, share: float
) -> None:
    terrain = Terrain.from_height_map(np.zeros((SIDE, SIDE)), cell_size_m=1.0)
    method = EvidenceConfig(memory_s=memory_s).fusion_method(terrain, drones=1)
    loop = FrameLoop(CrowdMap(terrain, method), ZoneConfig(buffer_m=buffer_m))
    places = terrain.voxel_centers(np.arange(terrain.voxel_count))[:, :2]
    closed = []
    for half_second in range(min(60, int(2 * (100 - 2 * radius_m) / speed_mps))):
        x = 15.0 + radius_m + speed_mps * half_second / 2
        stamp_ns = START_NS + half_second * SECOND_NS // 2
        step = loop.step([View("a", stamp_ns, CAMERA, POSE, shown(x, radius_m))], stamp_ns)
        stands = np.hypot(places[:, 0] - x, places[:, 1] - 60.0) < radius_m
        assert (loop.crowd_map.state(stamp_ns)[stands] != VoxelState.EMPTY).all()
        if half_second >= 10:
            ground = shapely.union_all([zone.polygon for zone in step.zones])
            closed.append(shapely.intersects(ground, shapely.points(places[stands])).mean())
    assert np.mean(closed) == pytest.approx(share, abs=0.025)


@pytest.mark.parametrize("value", [0.6, 0.8])
def test_ground_on_which_the_last_look_shows_a_crowd_is_not_called_empty(value: float) -> None:
    """A drone 110 m above saw it empty for 10 s before: on the whole the looks speak against crowd."""
    terrain = Terrain.from_height_map(np.zeros((SIDE, SIDE)), cell_size_m=1.0)
    camera = Camera.pinhole(640, 480, 480.0, 480.0, 320.0, 240.0)
    pose = np.diag([1.0, -1.0, -1.0, 1.0])
    pose[:3, 3] = (60.0, 60.0, 110.0)
    crowd_map = CrowdMap(terrain, EvidenceConfig().fusion_method(terrain, drones=1))
    for half_second in range(21):
        shown = np.zeros((60, 80), np.float32)
        if half_second == 20:
            shown[28:32, 38:42] = value
        stamp_ns = START_NS + half_second * SECOND_NS // 2
        crowd_map.integrate([View("a", stamp_ns, camera, pose, shown)], stamp_ns)
    places = terrain.voxel_centers(np.arange(terrain.voxel_count))[:, :2]
    state = crowd_map.state(stamp_ns)
    assert not (state[np.abs(places - 60.0).max(axis=1) < 3.0] == VoxelState.EMPTY).any()
    # Beside the crowd, where nobody was ever shown, nothing changes.
    assert (state[np.abs(places - (75.0, 75.0)).max(axis=1) < 3.0] == VoxelState.EMPTY).all()
