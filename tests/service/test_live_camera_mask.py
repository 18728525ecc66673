"""Parts of a drone in its own pictures: live views leave out what `--camera-mask` hides, as recordings do."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from crowdfence import CrowdMap
from crowdfence.cli.app import app
from crowdfence.pipeline import FrameLoop
from crowdfence.service import opening
from crowdfence.service.gate import Refused
from crowdfence.service.inputs import Inputs
from crowdfence.service.opening import replayed
from crowdfence.service.watch import Watch
from crowdfence.sources.camera_mask import CameraMask
from crowdfence.sources.masked_drones import with_camera_masks
from support.served import ORIGIN, write_level_ground
from support.small_service import (
    CONFIG,
    asked,
    message,
    picture_message,
    plain,
    recording,
    running,
    settle,
    sharp,
    view,
    views,
    wait_for_end,
)

LEFT = CameraMask(np.arange(16)[None, :].repeat(12, axis=0) < 8)
MASKED = Inputs(camera_masks={"uav1": LEFT})


def seen_by_run(drones: dict[str, CameraMask]) -> np.ndarray:
    """Of the same views in a recording."""
    flown = with_camera_masks(recording(views(9)), drones)
    crowd_map = CrowdMap(plain(), CONFIG.method.fusion_method(plain(), 3), max_range_m=80.0)
    loop = FrameLoop(crowd_map, CONFIG.zones)
    for instant in flown.instants(CONFIG.grouping.tolerance_ms):
        loop.step(instant.views().views, instant.stamp_ns)
    return crowd_map.seen()


def test_live_views_leave_out_what_is_hidden_also_after_a_restart(tmp_path: Path) -> None:
    with running(tmp_path, inputs=MASKED) as service:
        assert service.live is not None
        for one in views(9):
            service.live.intake.give_view(message(one))
        settle(service)
        service.live.finish()
        seen = service.mission.loop.crowd_map.seen()
        before = service.mission.loop.crowd_map.to_bytes()
    np.testing.assert_array_equal(seen, seen_by_run({"uav1": LEFT}))
    assert seen.sum() < seen_by_run({}).sum()
    with running(tmp_path, inputs=MASKED) as service:
        assert service.mission.loop.crowd_map.to_bytes() == before


def test_a_view_that_the_mask_does_not_fit_is_refused(tmp_path: Path) -> None:
    """And so is what a drone projected itself: nobody can take out of it what hides ground there."""
    crowd_map = CrowdMap(plain(), CONFIG.method.fusion_method(plain(), 3), max_range_m=80.0)
    (own,) = crowd_map.integrate([view("uav1", 0)], view("uav1", 0).stamp_ns).observations
    square = Inputs(camera_masks={"uav1": CameraMask(np.eye(10, dtype=bool))})
    with running(tmp_path, inputs=square) as service:
        assert service.live is not None
        for given in (message(view("uav1", 0)), picture_message(sharp(view("uav1", 0)))):
            with pytest.raises(
                Refused, match=r"camera mask is 10 x 10, and pictures of \d+ x \d+ have other"
            ):
                service.live.intake._checked(given)
        with pytest.raises(Refused, match="uav1 projects itself: its pictures must be masked there"):
            service.live.intake.give_observation(own.to_bytes())
        service.live.intake.give_view(message(view("uav2", 0)))
        settle(service)


def test_another_mask_after_a_restart_costs_no_other_view(tmp_path: Path) -> None:
    """Views in the journal that the mask of now does not fit are refused, and the service goes on."""
    with running(tmp_path) as service:
        assert service.live is not None
        service.live.intake.give_view(message(view("uav1", 0)))
        service.live.intake.give_view(message(view("uav2", 0)))
        settle(service)
        service.store.flush()
        service.live.applying._since_snapshot = 0  # as if it were killed: no snapshot of them is left
    square = Inputs(camera_masks={"uav1": CameraMask(np.eye(10, dtype=bool))})
    with running(tmp_path, inputs=square) as service:
        assert service.live is not None
        service.live.finish()
        assert service.live.heard.refused == {"uav1": 1}
        assert service.mission.loop.crowd_map.seen().any()


def test_a_mask_for_a_drone_that_never_comes_is_told(tmp_path: Path) -> None:
    with running(tmp_path, inputs=Inputs(camera_masks={"UAV1": LEFT})) as service:
        assert service.live is not None
        watch = Watch(service)
        for number in (0, 400):
            service.live.intake.give_view(message(view("uav1", number)))
            settle(service)
            watch.look()
        (told,) = (one for one in service.alerts.all() if one.kind == "mask_unused")
        assert told.drone == "UAV1" and told.text == (
            "--camera-mask names UAV1, of which no view was taken; there are uav1: under a misspelled name "
            "ground behind a drone's own parts is called empty"
        )


def test_the_page_shows_the_pictures_of_a_masked_drone(tmp_path: Path) -> None:
    flown = with_camera_masks(recording(views(9)), {"uav1": LEFT})
    with replayed(flown, plain(), CONFIG, speed=float("inf")) as service:
        wait_for_end(service)
        with asked(service) as http:
            for drone in ("uav1", "uav2"):
                assert http.get(f"/api/v1/drones/{drone}/heatmap").status_code == 200, drone


def test_serve_reads_the_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Opened(Exception):
        pass

    def opened(*_: object, inputs: Inputs, **__: object) -> None:
        raise Opened(json.dumps({drone: mask.share for drone, mask in inputs.camera_masks.items()}))

    monkeypatch.setattr(opening, "live", opened)
    Image.fromarray(np.where(LEFT.hidden, 0, 255).astype(np.uint8)).save(tmp_path / "legs.png")
    words = ["serve", "--terrain", str(write_level_ground(tmp_path / "ground.tif")), "--origin", ORIGIN]
    words += ["--data", str(tmp_path / "data"), "--camera-mask", f"uav1={tmp_path / 'legs.png'}"]
    finished = CliRunner().invoke(app, words).exception
    assert isinstance(finished, Opened) and json.loads(str(finished)) == {"uav1": 0.5}
