"""Wildtrack and MultiviewX: small folders in their layouts, read back and mapped."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from crowdfence import FrameError, OrConfig, ProjectionConfig, RunConfig, open_terrain
from crowdfence.evaluation.replay import score
from crowdfence.sources import is_recording, open_recording
from support.command_line import crowdfence
from support.small_data_sets import FOCAL_PX, MIDDLE_PX, SIZE, DataSet, camera_from_world, write_data_set

GROUP = [(4.0, 6.0), (4.8, 6.2), (4.4, 6.9), (5.2, 6.8)]
EYES = [(0.5, 1.0, 2.6), (9.0, 2.0, 2.6)]
TOWARDS = (4.5, 6.5, 0.8)


def data_set(*, wildtrack: bool, frames: int = 2) -> DataSet:
    return DataSet(wildtrack, EYES, TOWARDS, [GROUP] * frames)


@pytest.fixture(params=[True, False], ids=["Wildtrack", "MultiviewX"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return write_data_set(tmp_path / "data", data_set(wildtrack=request.param), pictures=True)


def test_cameras_people_and_pictures(folder: Path) -> None:
    assert is_recording(folder)
    recording = open_recording(folder)
    assert recording.drones == ("C1", "C2") and recording.refused == ()
    assert len(recording.frames) == 4
    for number, frame in enumerate(recording.frames):
        at = number % 2
        expected = np.linalg.inv(camera_from_world(EYES[at], TOWARDS))
        np.testing.assert_allclose(frame.world_from_camera, expected, atol=1e-9)
        assert (frame.camera.width, frame.camera.height) == SIZE
        assert (frame.camera.fx, frame.camera.cx) == (FOCAL_PX, MIDDLE_PX[0] + 0.5)
        assert frame.image()[0, 0].tolist() == [at, number // 2, 0]
        people = recording.people_truth(frame.exposure_ns())
        assert people is not None and people.person.tolist() == [1, 2, 3, 4]
        np.testing.assert_allclose(people.position[:, :2], GROUP, atol=0.0126)
        assert (people.position[:, 2] == 0.0).all()
    first, second = (recording.frames[at].stamp_ns for at in (0, 2))
    assert second - first == 500_000_000  # twice a second, in either numbering


def edit_first_annotations(folder: Path, change: Callable[[list[dict]], object]) -> None:
    path = min((folder / "annotations_positions").iterdir())
    people = json.loads(path.read_text())
    change(people)
    path.write_text(json.dumps(people))


def test_people_who_are_annotated_twice_are_there_once(folder: Path) -> None:
    edit_first_annotations(folder, lambda people: people.extend(people[:2]))
    recording = open_recording(folder)
    people = recording.people_truth(recording.frames[0].exposure_ns())
    assert people is not None and people.person.tolist() == [1, 2, 3, 4]


def test_a_view_of_no_camera_is_refused_and_not_counted_from_the_last(folder: Path) -> None:
    edit_first_annotations(folder, lambda people: people[0]["views"][0].update(viewNum=-1))
    recording = open_recording(folder)
    with pytest.raises(FrameError, match="viewNum is -1; there are 2 cameras"):
        recording.frames[0].heatmap()


def test_a_picture_that_is_missing_is_told_and_its_spelling_is_free(tmp_path: Path) -> None:
    """The heatmaps are those of the annotations: that they are taken for all must not go unheard, as they
    would be judged for a detector."""
    folder = write_data_set(tmp_path / "data", data_set(wildtrack=True), pictures=True)
    upper = folder / "Image_subsets" / "C1" / "00000000.png"
    upper.rename(upper.with_suffix(".PNG"))
    whole = open_recording(folder)
    assert all(frame.pixels.image for frame in whole.frames) and len(whole.warnings) == 1
    (folder / "Image_subsets" / "C2" / "00000005.png").unlink()
    told = "1 of 4 pictures are not there, the first C2 of number 5"
    assert told in open_recording(folder).warnings
    done = crowdfence("run", folder, "--assume-local", "-o", tmp_path / "out")
    assert done.returncode == 0 and told in done.stderr
    assert "1 of 4 frames hold a heatmap and no picture, so the recorded heatmaps are taken" in done.stderr
    done = crowdfence(
        "run", folder, "--assume-local", "--detector", "recorded", "-o", tmp_path / "out", "--force"
    )
    assert done.returncode == 0 and "hold a heatmap and no picture" not in done.stderr


def test_feet_are_marked_where_people_stand(folder: Path) -> None:
    for frame in open_recording(folder).frames[:2]:
        heatmap = frame.heatmap()
        for x, y in GROUP:
            seen = np.linalg.inv(frame.world_from_camera)[:3] @ [x, y, 0.0, 1.0]
            (column, row), *_ = frame.camera.project([seen]) / 4.0
            assert heatmap[int(row), int(column)] == 255
        bodies = next(
            one for one in open_recording(folder, boxes="bodies").frames if one.drone == frame.drone
        )
        assert np.count_nonzero(bodies.heatmap()) > np.count_nonzero(heatmap)


def test_the_ground_is_what_is_annotated(folder: Path) -> None:
    terrain = open_terrain(open_recording(folder), voxel_size_m=0.5)
    wildtrack = "intrinsic_zero" in {path.name for path in (folder / "calibrations").iterdir()}
    low, high = ([-3.0, -9.0], [9.0, 27.0]) if wildtrack else ([0.0, 0.0], [25.0, 16.0])
    centres = terrain.voxel_centers(np.arange(terrain.voxel_count))
    assert (centres[:, :2].min(axis=0) < np.add(low, 0.5)).all()
    assert (centres[:, :2].max(axis=0) > np.subtract(high, 0.5)).all()


def test_the_ground_that_people_stand_on_makes_the_map(tmp_path: Path) -> None:
    """With low cameras, what is back-projected decides more than how it is fused."""
    folder = write_data_set(tmp_path / "data", data_set(wildtrack=True))
    config = RunConfig(OrConfig(), ProjectionConfig(target_height_m=0.0))
    iou = {}
    for boxes in ("contact", "bodies"):
        recording = open_recording(folder, boxes=boxes)
        (row,) = score(recording, open_terrain(recording, voxel_size_m=0.25), [config], truth="world").rows
        iou[boxes] = row.iou.mean
    assert iou["contact"] > 0.5 > 3.0 * iou["bodies"]


@pytest.mark.parametrize(
    ("file", "change", "said"),
    [
        ("annotations_positions/00000000.json", lambda text: "{", "is no annotation of Wildtrack"),
        (
            "annotations_positions/00000000.json",
            lambda text: json.dumps([{**json.loads(text)[0], "positionID": 480 * 1440}]),
            "positionID is 691200; Wildtrack has 691200 cells",
        ),
        ("calibrations/extrinsic/extr_CVLab1.xml", lambda text: text[:40], "cannot be read"),
        (
            "calibrations/extrinsic/extr_CVLab1.xml",
            lambda text: "<!DOCTYPE a []>" + text,
            "declares entities",
        ),
        (
            "calibrations/intrinsic_zero/intr_CVLab1.xml",
            lambda text: text.replace("camera_matrix", "other"),
            "it has no camera_matrix",
        ),
        (
            "calibrations/intrinsic_zero/intr_CVLab1.xml",
            lambda text: text.replace("300.0", "nan"),
            "9 finite numbers",
        ),
    ],
)
def test_what_cannot_be_read_is_said(tmp_path: Path, file: str, change, said: str) -> None:
    folder = write_data_set(tmp_path / "data", data_set(wildtrack=True, frames=1))
    (folder / file).write_text(change((folder / file).read_text()))
    with pytest.raises(ValueError, match=said):
        recording = open_recording(folder)
        recording.people_truth(recording.frames[0].exposure_ns())


def test_a_camera_without_a_pose_is_refused(tmp_path: Path) -> None:
    folder = write_data_set(tmp_path / "data", data_set(wildtrack=False, frames=1))
    (folder / "calibrations" / "extrinsic" / "extr_Camera2.xml").unlink()
    with pytest.raises(ValueError, match="2 camera matrices and 1 poses"):
        open_recording(folder)


def test_a_camera_below_the_ground_is_refused(tmp_path: Path) -> None:
    upside_down = DataSet(True, [(0.5, 1.0, -2.6), EYES[1]], TOWARDS, [GROUP])
    with pytest.raises(ValueError, match="stands 2.6 m below the ground"):
        open_recording(write_data_set(tmp_path / "data", upside_down))


def test_only_a_data_set_has_boxes(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="boxes is 'heads'; it must be contact or bodies"):
        open_recording(folder, boxes="heads")
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "poses.csv").write_text("drone,stamp_ns\n")
    with pytest.raises(ValueError, match="is no data set of fixed cameras: boxes does not apply"):
        open_recording(tmp_path / "other", boxes="bodies")
