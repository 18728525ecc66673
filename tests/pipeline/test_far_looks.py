"""Far ground is looked at a few times a second, whatever the rate of pictures, and not seen in between."""

from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from crowdfence import Detector, Recording, Run, pipeline
from crowdfence.config import OrConfig, PaperConfig, RunConfig
from crowdfence.pipeline import heatmap_source
from crowdfence.pipeline.far_looks import FarLooks
from crowdfence.sources.recording import Frame
from support.onnx_models import contract, write_map_model
from support.small_service import CONFIG, DRONES, pictured, plain

TENTH_NS = 100_000_000


def taken(far: FarLooks, drone: str, tenths: Iterable[int]) -> list[int]:
    """Those of the stamps, in tenths of a second, at which a drone looks far."""
    return [tenth for tenth in tenths if far.takes(drone, tenth * TENTH_NS)]


def test_a_drone_of_ten_pictures_a_second_looks_far_in_every_third() -> None:
    assert taken(FarLooks(0.25), "uav1", range(12)) == [0, 3, 6, 9]
    assert taken(FarLooks(0.3), "uav1", range(12)) == [0, 3, 6, 9]
    assert taken(FarLooks(0.05), "uav1", range(12)) == list(range(12))
    assert taken(FarLooks(0.0), "uav1", range(12)) == list(range(12))


def test_the_drones_of_a_fleet_take_turns() -> None:
    """The second one begins .618 of .3 s ahead, .185 s, the third .236 of it, .071 s."""
    far = FarLooks(0.3)
    looks = {drone: taken(far, drone, range(9)) for drone in DRONES}
    assert looks == {"uav1": [0, 3, 6], "uav2": [0, 2, 5, 8], "uav3": [0, 3, 6]}


def test_a_clock_that_is_set_back_begins_anew() -> None:
    assert taken(FarLooks(0.25), "uav1", (50, 51, 2, 3, 4, 5)) == [50, 2, 5]


def test_the_turns_go_on_after_a_restart() -> None:
    """One that began anew would look far at once."""
    far, other = FarLooks(0.3), FarLooks(0.3)
    for drone in DRONES:
        taken(far, drone, range(5))
    other.restore(far.to_json())
    for drone in DRONES:
        assert taken(far, drone, range(5, 20)) == taken(other, drone, range(5, 20)) != [], drone
    assert taken(FarLooks(0.3), "uav1", range(5, 8)) == [5]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The red of a picture; knows .17 m a pixel, which is what 18 m are at 106 focal lengths: of the fleet's
    pictures the middle is nearer, the corners are farther."""
    document = contract(sizes={"gsd_m": [0.05, 0.17]})
    return write_map_model(tmp_path_factory.mktemp("model") / "red.onnx", document)


@pytest.fixture(scope="module")
def flown() -> Recording:
    """Five pictures a second, three drones."""
    return pictured(9)


def test_looks_in_between_leave_far_ground_out(flown: Recording, model: Path) -> None:
    detector, terrain = Detector(model, far_every_s=0.25), plain()
    heatmaps = heatmap_source(detector, terrain, 80.0, whole=False)
    whole = heatmap_source(detector, terrain, 80.0)
    assert heatmaps.to_json()["far_every_s"] == 0.25 and "far_every_s" not in whole.to_json()
    looks: dict[str, list[bool]] = {drone: [] for drone in DRONES}
    pairs = zip(
        heatmaps.detected(flown.instants(60.0), 3), whole.detected(flown.instants(60.0), 3), strict=True
    )
    for (_, found), (_, of_whole) in pairs:
        for view, complete in zip(found.views, of_whole.views, strict=True):
            looks[view.drone].append(view.looked_at is None)
            assert complete.looked_at is None
            if view.looked_at is not None:
                assert 0.3 < view.looked_at.mean() < 0.9
                assert view.looked_at[12:18, 16:24].all() and not view.looked_at[0, 0]
                assert (view.heatmap == complete.heatmap * view.looked_at).all()
    assert looks["uav1"] == [True, False, True, False, True, False, True, False, True]
    assert [sum(of_drone) for of_drone in looks.values()] == [5, 5, 5]
    assert looks["uav2"] != looks["uav1"], "they take turns"


def test_what_no_look_was_at_is_no_more_empty_than_before(flown: Recording, model: Path) -> None:
    """A run sees no voxel and shows no crowd that looks at whole pictures would not, and what is near it sees
    as often."""
    terrain = plain()
    often = pipeline.run(flown, terrain, CONFIG, detector=Detector(model, far_every_s=0.0))
    seldom = pipeline.run(flown, terrain, CONFIG, detector=Detector(model, far_every_s=5.0))
    assert (often.crowd_map.seen() | ~seldom.crowd_map.seen()).all()
    seen = [sum(row.voxels_seen for row in run.rows) for run in (often, seldom)]
    assert 0.4 * seen[0] < seen[1] < 0.9 * seen[0]
    assert seldom.zones.area_m2 > 0.5 * often.zones.area_m2 > 0.0


def test_a_function_may_mask_what_it_did_not_look_at(flown: Recording, model: Path) -> None:
    """A blind half of the picture, such as the drone's own leg: what is seen of the ground is seen by the
    other half."""
    terrain, detector = plain(), Detector(model, far_every_s=0.0)
    left = np.zeros((30, 40), bool)
    left[:, :20] = True

    def flown_with(mask: NDArray[np.bool_]) -> Run:
        def look(frame: Frame) -> NDArray[np.float32]:
            return np.ma.MaskedArray(detector(frame.image()), mask)

        return pipeline.run(flown, terrain, CONFIG, detector=look)

    runs = [flown_with(mask) for mask in (np.zeros((30, 40), bool), left, ~left)]
    whole, right, other = (run.crowd_map.seen() for run in runs)
    assert (whole == (right | other)).all() and right.sum() < 0.9 * whole.sum()
    assert len(runs[0].zones) > 0


@pytest.mark.parametrize("method", [PaperConfig(prior=0.2), OrConfig()])
def test_methods_to_which_unseen_means_something_get_whole_looks(
    flown: Recording, model: Path, method: PaperConfig | OrConfig
) -> None:
    config, terrain = RunConfig(method, CONFIG.projection, CONFIG.grouping), plain()
    maps = [
        pipeline.run(
            flown, terrain, config, detector=Detector(model, far_every_s=seconds)
        ).crowd_map.to_bytes()
        for seconds in (0.0, 5.0)
    ]
    assert maps[0] == maps[1]
