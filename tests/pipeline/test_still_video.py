"""Views of a video that stands still while the drone flies on are refused; what may be is used."""

import io
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from scipy.spatial.transform import Rotation

import crowdfence as cf
from crowdfence.pipeline.detect import heatmap_source
from crowdfence.pipeline.still_video import StillVideo
from crowdfence.sources.recording import Frame, PixelSources, Recording
from support.onnx_models import contract, write_map_model
from support.small_recordings import flight, write_folder

CAMERA = cf.Camera.pinhole(64, 48, 40.0, 40.0, 32.0, 24.0)
BEGIN_NS = 1_760_000_000_000_000_000


def picture(seed: int) -> NDArray[np.float32]:
    return np.random.default_rng(seed).uniform(0.0, 0.3, (12, 16)).astype(np.float32)


def views(heatmaps: list[NDArray[np.float32]], *, east_m: float, turned_deg: float = 0.0) -> list[cf.View]:
    """Straight down, so far apart from one to the next."""
    flown = []
    for number, heatmap in enumerate(heatmaps):
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, :3] = Rotation.from_euler("z", turned_deg * number, degrees=True).as_matrix() @ pose[:3, :3]
        pose[:3, 3] = (east_m * number, 0.0, 30.0)
        flown.append(cf.View("uav1", BEGIN_NS + number * 200_000_000, CAMERA, pose, heatmap))
    return flown


def refused(video: StillVideo, flown: list[cf.View]) -> list[int]:
    """Numbers of the views that are refused."""
    return [number for number, view in enumerate(flown) if video.refusal_of(view) is not None]


@pytest.mark.parametrize(
    ("east_m", "turned_deg", "why", "first"),
    [
        (0.6, 0.0, "moved by 0.6 m", 5),
        (0.0, 1.1, "turned by 1.1 degrees", 5),
        (0.2, 0.4, "moved by 0.6 m", 7),  # 0.2 m and 0.4 degrees a view are enough with the third one
    ],
)
def test_the_same_picture_of_a_camera_that_moves_is_refused(
    east_m: float, turned_deg: float, why: str, first: int
) -> None:
    video = StillVideo()
    flown = views(
        [picture(number) for number in range(5)] + [picture(4)] * 8, east_m=east_m, turned_deg=turned_deg
    )
    refusals = [video.refusal_of(view) for view in flown]
    assert [refusal is None for refusal in refusals] == [True] * first + [False] * (13 - first)
    told = refusals[first]
    assert told is not None and (told.drone, told.stamp_ns) == ("uav1", flown[first].stamp_ns)
    assert "is that of the picture before" in told.reason and f"the camera has {why} since" in told.reason
    assert f"the last {13 - first} heatmaps of uav1 are the same" in (video.standing()["uav1"] or "")


def test_a_video_that_goes_on_counts_again() -> None:
    video = StillVideo()
    assert refused(video, views([picture(1)] * 6 + [picture(2)], east_m=1.0)) == [1, 2, 3, 4, 5]
    assert video.standing() == {"uav1": None}


def test_a_hiccup_is_refused_and_is_no_video_that_stands_still() -> None:
    video = StillVideo()
    assert refused(video, views([picture(number // 2) for number in range(6)], east_m=1.0)) == [1, 3, 5]
    assert video.standing() == {"uav1": None}


@pytest.mark.parametrize(
    ("heatmaps", "east_m"),
    [
        ([picture(number) for number in range(10)], 1.0),
        ([picture(1)] * 10, 0.0),  # a hover in a simulation without noise
        ([np.zeros((12, 16), np.float32)] * 10, 1.0),  # nobody anywhere
        ([np.eye(12, 16, dtype=np.float32) / 255] * 10, 1.0),  # and next to nothing
    ],
)
def test_what_may_be_is_used(heatmaps: list[NDArray[np.float32]], east_m: float) -> None:
    video = StillVideo()
    assert refused(video, views(heatmaps, east_m=east_m)) == []
    assert video.standing() == {"uav1": None}


NOBODY = np.zeros((12, 16), np.float32)


def png(seed: int, camera: cf.Camera = CAMERA, *, brightest: int = 256) -> bytes:
    """A picture of noise."""
    file = io.BytesIO()
    pixels = (
        np.random.default_rng(seed).integers(0, brightest, (camera.height, camera.width, 3)).astype(np.uint8)
    )
    Image.fromarray(pixels).save(file, format="PNG")
    return file.getvalue()


def test_masks_that_cannot_be_told_apart_are_told_by_their_pictures() -> None:
    flown = views([NOBODY] * 8, east_m=1.0)
    shown = [png(number) for number in (1, 2, 2, 2, 2, 3, 4, 4)]
    for restart_before in range(len(flown) + 1):
        video, still = StillVideo(), []
        for number, (view, picture_bytes) in enumerate(zip(flown, shown, strict=True)):
            if number == restart_before:
                kept, video = video.to_json(), StillVideo()
                video.restore(kept)
            refusal = video.refusal_of(view, lambda encoded=picture_bytes: encoded)
            if refusal is not None:
                assert "its picture is the one before" in refusal.reason
                still.append(number)
        assert still == [2, 3, 4, 7]
    hover, dark, broken = StillVideo(), StillVideo(), StillVideo()
    black = png(0, brightest=1)
    assert [hover.refusal_of(view, lambda: shown[0]) for view in views([NOBODY] * 4, east_m=0.0)] == [
        None
    ] * 4
    assert [dark.refusal_of(view, lambda: black) for view in flown] == [None] * 8, "of another sensor"
    assert [broken.refusal_of(view, lambda: b"none") for view in flown] == [None] * 8


def test_no_picture_is_read_where_the_heatmap_tells() -> None:
    def unread() -> bytes:
        raise AssertionError("read")

    video = StillVideo()
    assert all(
        video.refusal_of(view, unread) is None for view in views([picture(n) for n in range(4)], east_m=1.0)
    )


def test_a_run_refuses_masks_of_pictures_that_stand_still(tmp_path: Path) -> None:
    recording = cf.open_recording(write_folder(tmp_path / "flight", flight()))
    drone, camera = recording.drones[0], recording.frames[0].camera

    def used(is_still: bool) -> int:
        frames = [
            replace(frame, pixels=PixelSources(image=lambda n=0 if is_still else number: png(n, camera)))
            for number, frame in enumerate(recording.frames_of(drone))
        ]
        instants = replace(recording, frames=tuple(frames), drones=(drone,)).instants()
        source = heatmap_source(lambda frame: np.zeros((12, 16), np.uint8), None, 100.0)
        return sum(len(found.views) for _, found in source.detected(instants, 1))

    assert used(is_still=False) == len(recording.frames_of(drone)) > 2
    assert used(is_still=True) == 1


def test_a_picture_that_stands_still_is_known_from_any_height(tmp_path: Path) -> None:
    """A drone climbs from 6 m to 30 m: the detector is shown its picture at another size from 10.2 m on, of
    which it leaves the far corners out now and then, so that heatmaps of the same picture differ."""
    terrain = cf.Terrain.from_height_map(np.zeros((120, 60)), cell_size_m=1.0)
    model = write_map_model(tmp_path / "red.onnx", contract(sizes={"gsd_m": [0.2, 0.4]}))
    frames = []
    for number in range(24):
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = (60.0, 30.0, 6.0 + number)
        shown = PixelSources(image=lambda: png(1))
        frames.append(Frame("uav1", BEGIN_NS + number * 100_000_000, CAMERA, pose, shown))
    flown = Recording("climb", ("uav1",), tuple(frames), None, None, (), (), {}, {})
    source = heatmap_source(cf.Detector(model, far_every_s=0.25), terrain, 100.0, whole=False)
    found = [views for _, views in source.detected(flown.instants(), 1)]
    assert [len(views.views) for views in found] == [1] + [0] * 23
    assert all("its picture is the one before" in views.refused[0].reason for views in found[1:])
    by_heatmaps = [
        cf.View("uav1", one.stamp_ns, CAMERA, one.world_from_camera, source.heatmap_of(one)) for one in frames
    ]
    assert len(refused(StillVideo(), by_heatmaps)) < 23


def test_a_picture_that_stands_still_is_known_in_other_bytes() -> None:
    """A relay that writes the time into each picture that it sends again: the heatmaps are the same."""
    flown, video = views([picture(1)] * 4, east_m=1.0), StillVideo()
    sent = [png(1) + bytes([number]) for number in range(4)]
    refusals = [
        video.refusal_of(view, lambda encoded=encoded: encoded, of_picture=True)
        for view, encoded in zip(flown, sent, strict=True)
    ]
    assert [refusal is None for refusal in refusals] == [True, False, False, False]
    assert "heatmap is that of the picture before" in (refusals[1].reason if refusals[1] else "")


def test_what_was_seen_is_known_after_a_restart() -> None:
    """The first view after it may be the one that the video stands still at."""
    flown = views([picture(1), picture(2), picture(2), picture(2), picture(2), picture(3)], east_m=1.0)
    for before in range(len(flown)):
        first, second = StillVideo(), StillVideo()
        begun = refused(first, flown[:before])
        second.restore(first.to_json())
        assert second.to_json() == first.to_json() and second.standing() == first.standing()
        assert begun + [before + number for number in refused(second, flown[before:])] == [2, 3, 4]


def test_a_picture_that_stands_still_opens_no_zone() -> None:
    """A camera sees a crowd, then free ground beside it, and flies back above the crowd; its video still
    shows the free ground."""
    terrain = cf.Terrain.from_height_map(np.zeros((120, 60)), cell_size_m=1.0)
    crowd, free = picture(1) / 30, picture(2) / 30
    crowd[4:8, 6:10] = 0.98
    path = [(crowd + picture(10 + n) / 100, 30.0) for n in range(6)]
    path += (
        [(free, 90.0)]
        + [(free, 90.0 - 12.0 * (n + 1)) for n in range(5)]
        + [(free, 30.0 + n) for n in range(20)]
    )
    frames = []
    for number, (heatmap, east_m) in enumerate(path):
        pose = np.diag([1.0, -1.0, -1.0, 1.0])
        pose[:3, 3] = (east_m, 30.0, 30.0)
        frames.append((BEGIN_NS + number * 200_000_000, pose, np.clip(heatmap, 0.0, 1.0)))

    def zones(drones: list[tuple[int, NDArray[np.float64], NDArray[np.float32]]]) -> list[str]:
        method = cf.EvidenceConfig().fusion_method(terrain, drones=1)
        loop = cf.FrameLoop(cf.CrowdMap(terrain, method, max_range_m=100.0), cf.ZoneConfig())
        video, step = StillVideo(), None
        for stamp_ns, pose, heatmap in drones:
            view = cf.View("uav1", stamp_ns, CAMERA, pose, heatmap)
            if video.refusal_of(view) is None:
                step = loop.step([view], stamp_ns)
        assert step is not None
        return [zone.id for zone in step.zones]

    assert zones(frames) == ["Z1"]
    moving = [
        (stamp_ns, pose, heatmap + picture(n) / 100) for n, (stamp_ns, pose, heatmap) in enumerate(frames)
    ]
    assert zones(moving) == [], "who really sees the ground free opens it"
