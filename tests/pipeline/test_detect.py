"""From pictures to the map: which heatmaps a run takes, whose rates, and what happens to frames that fail.

The pictures of the recordings are grey, 60 times the crowd number of the pixel; the model's heatmap is the
red of each 4 x 4 cell, over which the crowd number is constant.
"""

import hashlib
import io
import json
import shutil
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image
from typer.testing import CliRunner

from crowdfence import Terrain, _core, open_recording, pipeline
from crowdfence.cli.app import app
from crowdfence.config import OrConfig, PaperConfig, ProjectionConfig, RunConfig
from crowdfence.detector.detector import Detector
from crowdfence.detector.model_check import check_model
from crowdfence.errors import FrameError
from crowdfence.evaluation.replay import measured_rates, score
from crowdfence.georeference import Georeference
from crowdfence.heatmap_files import detect_recording
from crowdfence.pipeline import choose_detector, heatmap_source
from crowdfence.pipeline.detector_review import review_detector
from crowdfence.run_summary import heatmaps_of
from crowdfence.sources.convert import convert
from crowdfence.sources.fleet import joined
from crowdfence.sources.layers import LayerPixels
from crowdfence.sources.recording import Frame, Recording
from support.onnx_models import contract, write_map_model, write_pixel_people_model
from support.small_recordings import STARTS, flight, heatmap, write_airsim, write_folder

CONFIG = RunConfig(PaperConfig(prior=0.2))
DEFAULTS = {"true_positive_rate": 0.9, "false_positive_rate": 0.02, "target_height_m": 0.0}
RATES = {
    "true_positive": {"rate": 0.8, "low": 0.7, "high": 0.9},
    "false_positive": {"rate": 0.01, "low": 0.0, "high": 0.02},
}


def ground() -> Terrain:
    """A level plain 25 m below the fleet's start, wide enough for every view."""
    north, east, _ = np.array(list(STARTS.values())).mean(axis=0)
    side = np.arange(-250.0, 250.0, 2.0)
    x, y = np.meshgrid(east + side, north + side)
    return Terrain.from_points(np.column_stack([x.ravel(), y.ravel(), np.full(x.size, -24.5)]), 2.0)


@pytest.fixture(scope="module")
def terrain() -> Terrain:
    return ground()


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory, terrain: Terrain) -> Path:
    folder = write_airsim(tmp_path_factory.mktemp("flight") / "recording", flight())
    bt = _core.write_octomap_binary(terrain, np.arange(terrain.voxel_count))
    (folder / "terrain" / "terrain.bt").write_bytes(bt)
    return folder


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    document = contract(rates=RATES, target_height_m=1.5, validity={"gsd_m": [0.001, 0.002]})
    return write_map_model(tmp_path_factory.mktemp("model") / "red.onnx", document)


def red(frame: Frame) -> NDArray[np.float32]:
    """What the model computes, in numpy."""
    cells = frame.image()[..., 0].reshape(6, 4, 8, 4).mean(axis=(1, 3))
    return (cells / 255.0).astype(np.float32)


def test_a_detector_and_its_copy_of_the_recording_give_the_same_map(
    recorded: Path, model: Path, terrain: Terrain, tmp_path: Path
) -> None:
    """The drones are detected side by side, one after the other by a function, or beforehand."""
    detector = Detector(model)
    # Everything that the contract would say otherwise.
    config = RunConfig(
        PaperConfig(prior=0.2, true_positive_rate=0.9, false_positive_rate=0.1),
        ProjectionConfig(target_height_m=0.0),
    )
    recording = open_recording(recorded)
    side_by_side = pipeline.run(recording, terrain, config, detector=detector)
    assert not side_by_side.refused
    in_a_row = pipeline.run(
        open_recording(recorded), terrain, config, detector=lambda frame: detector(frame.image())
    )
    detect_recording(recording, heatmap_source(detector, None, 300.0), tmp_path / "seen.mcap")
    beforehand = pipeline.run(open_recording(tmp_path / "seen.mcap"), terrain, config)
    assert side_by_side.crowd_map.seen().sum() > 100
    maps = [run.crowd_map.to_bytes() for run in (side_by_side, in_a_row, beforehand)]
    assert maps[0] == maps[1] == maps[2]
    assert maps[0] != pipeline.run(open_recording(recorded), terrain, config).crowd_map.to_bytes()


def test_heatmaps_made_before_count_for_what_the_calibration_of_their_detector_says(
    recorded: Path, terrain: Terrain, tmp_path: Path
) -> None:
    """Taken for those of a detector that states nothing, looks from afar cleared ground like near ones: of
    the demo twice as much was called empty as where the detector looked at the pictures itself."""
    table = {
        "distance_m": [0.0, 30.0, 300.0],
        "tilt_deg": [0.0, 90.0],
        "mean": [0.0, 0.5, 1.0],
        "log10_ratio": [[[-2.0, 2.0]], [[-0.2, 0.5]]],
    }
    rates = {**RATES, "likelihood_ratio": table, "crowd_observations": 30, "empty_observations": 970}
    validity = {"gsd_m": [0.1, 0.5], "distance_m": [5.0, 200.0]}
    detector = Detector(write_map_model(tmp_path / "red.onnx", contract(rates=rates, validity=validity)))
    recording = open_recording(recorded)
    expected = pipeline.run(recording, terrain, detector=detector)
    plain = pipeline.run(recording, terrain, detector=red)
    assert expected.threshold != plain.threshold

    def run_of(path: Path) -> pipeline.Run:
        return pipeline.run(open_recording(path), terrain)

    detect_recording(recording, heatmap_source(detector, None, 300.0), tmp_path / "seen.mcap")
    found = run_of(tmp_path / "seen.mcap")
    assert found.crowd_map.to_bytes() == expected.crowd_map.to_bytes()
    assert found.config == expected.config and found.threshold == expected.threshold
    assert found.warnings == expected.warnings
    assert heatmaps_of(found)["heatmaps"] == "recorded" and heatmaps_of(found)["name"] == "test model"
    # Whoever converts it keeps that; a function that makes them anew states nothing.
    convert(open_recording(tmp_path / "seen.mcap"), tmp_path / "again.mcap")
    assert run_of(tmp_path / "again.mcap").crowd_map.to_bytes() == expected.crowd_map.to_bytes()
    convert(open_recording(tmp_path / "seen.mcap"), tmp_path / "anew.mcap", heatmap_of=red)
    assert run_of(tmp_path / "anew.mcap").crowd_map.to_bytes() == plain.crowd_map.to_bytes()
    bare = Detector.from_callable(lambda image: image[::4, ::4, 0] / 255.0, stride=4)
    detect_recording(recording, heatmap_source(bare, None, 300.0), tmp_path / "function.mcap")
    assert run_of(tmp_path / "function.mcap").threshold == plain.threshold
    (row,) = score(found.recording, terrain, [RunConfig()]).rows
    assert row.config.method == expected.config.method


def test_heatmaps_of_several_detectors_are_told(tmp_path: Path) -> None:
    place = Georeference(46.5, 8.0, 1200.0)  # else their frames would be told too
    recording = Recording("a", ("a",), (), place, None, (), (), {"detector": {"name": "one"}}, {})
    others = [replace(recording, name="b", drones=("b",), manifest=told) for told in ({}, recording.manifest)]
    fleet = joined([recording, others[0]])
    (said,) = fleet.warnings
    assert "not all heatmaps were made by one detector (one)" in said and "detector" not in fleet.manifest
    fleet = joined([recording, others[1]])
    assert not fleet.warnings and fleet.manifest["detector"] == {"name": "one"}
    assert not joined([others[0], replace(others[0], drones=("c",))]).warnings
    with pytest.raises(ValueError, match="a: what it says of the detector.*schema.*crowdfence detect"):
        heatmap_source(None, None, 300.0, recording=recording)


def test_a_model_looks_ahead_by_one_instant(recorded: Path, model: Path, terrain: Terrain) -> None:
    """While the caller works on an instant the next one is looked at, and none after it."""
    first, second, third, *_ = instants = list(open_recording(recorded).instants())
    looked_at = {instant.stamp_ns: threading.Event() for instant in instants}
    frames = [(instant.stamp_ns, frame) for instant in instants for frame in instant.frames]
    instant_of = {(frame.drone, frame.stamp_ns): stamp_ns for stamp_ns, frame in frames}

    def noticed(frame: Frame) -> NDArray[np.float32]:
        looked_at[instant_of[frame.drone, frame.stamp_ns]].set()
        return red(frame)

    plain = heatmap_source(Detector(model), terrain, 300.0)
    detected = replace(plain, heatmap_of=noticed).detected(instants, 3)
    assert next(detected)[0] is first and looked_at[second.stamp_ns].wait(60.0)
    assert not looked_at[third.stamp_ns].is_set()
    assert next(detected)[0] is second and looked_at[third.stamp_ns].wait(60.0)
    assert [instant for instant, _ in detected] == instants[2:]


def test_a_function_beside_a_model_looks_at_one_picture_at_a_time(
    recorded: Path, model: Path, terrain: Terrain
) -> None:
    """Many keep something from picture to picture, an output or a graph, and are not safe for threads."""
    looking = threading.Lock()

    def alone(image: NDArray[np.uint8]) -> NDArray[np.float32]:
        assert looking.acquire(blocking=False)
        time.sleep(0.01)
        looking.release()
        return np.zeros((image.shape[0] // 4, image.shape[1] // 4), np.float32)

    both = Detector.combined([Detector(model), Detector.from_callable(alone, stride=4)])
    heatmaps = heatmap_source(both, terrain, 300.0)
    found = list(heatmaps.detected(open_recording(recorded).instants(), 3))
    assert sum(len(views.views) for _, views in found) == 18


def test_the_pictures_decide_not_the_recorded_heatmaps(recorded: Path, model: Path, terrain: Terrain) -> None:
    recording = open_recording(recorded)
    frames = {(frame.drone, frame.stamp_ns): frame for frame in recording.frames}
    heatmaps = heatmap_source(Detector(model), terrain, 300.0)
    views = [view for _, found in heatmaps.detected(recording.instants(), 3) for view in found.views]
    assert len(views) == 18
    for view in views:
        assert view.heatmap == pytest.approx(red(frames[view.drone, view.stamp_ns]), abs=1e-6)


@pytest.mark.parametrize("tone", [0, 128, 255])
def test_a_camera_that_shows_nothing_clears_no_ground(
    recorded: Path, model: Path, terrain: Terrain, tone: int
) -> None:
    """From the third instant on the lens is covered: the map stays as if those frames had never been taken,
    whoever looks, and the frames are told."""
    recording = open_recording(recorded)
    begun = sorted({frame.stamp_ns for frame in recording.frames_of("uav1")})[2]
    seeing = tuple(frame for frame in recording.frames if frame.stamp_ns < begun)
    flat = [
        replace(frame, pixels=replace(frame.pixels, image=lambda: covered(tone)))
        for frame in recording.frames
        if frame.stamp_ns >= begun
    ]
    assert len(seeing) == 6 and len(flat) == 12
    sure = Detector.from_callable(lambda image: (image[::4, ::4, 0] > 0).astype(np.float32), stride=4)
    for detector in (Detector(model), sure):
        dead = pipeline.run(
            replace(recording, frames=(*seeing, *flat)), terrain, RunConfig(), detector=detector
        )
        assert len(dead.refused) == 12
        assert all(f"nothing but one tone (red {tone}" in one.reason for one in dead.refused)
        stopped = pipeline.run(replace(recording, frames=seeing), terrain, RunConfig(), detector=detector)
        now_ns = dead.stamp_ns
        assert stopped.crowd_map.seen().sum() > 100
        assert (dead.crowd_map.state(now_ns) == stopped.crowd_map.state(now_ns)).all()


@pytest.mark.parametrize("made_by", ["recorded", "function"])
def test_recorded_heatmaps_and_those_of_functions_clear_no_ground_beside_dead_pictures(
    recorded: Path, terrain: Terrain, made_by: str
) -> None:
    """Whoever made them saw nothing in the picture. Heatmaps that show crowd are of another sensor: kept."""
    recording = open_recording(recorded)
    begun = sorted({frame.stamp_ns for frame in recording.frames_of("uav1")})[2]

    def told(frame: Frame) -> NDArray[np.float32]:
        """Nobody in dead pictures, but for those of uav3."""
        values = np.full((6, 8), 0.4, np.float32)
        values[2, 3] = 0.5 if frame.drone == "uav3" or frame.stamp_ns < begun else 0.49
        return values

    def dead(frame: Frame) -> Frame:
        return replace(frame, pixels=replace(frame.pixels, image=lambda: covered(0)))

    def heatmap_kept(frame: Frame) -> Frame:
        return replace(frame, pixels=replace(frame.pixels, heatmap=lambda: told(frame)))

    frames = [heatmap_kept(frame if frame.stamp_ns < begun else dead(frame)) for frame in recording.frames]
    run = pipeline.run(
        replace(recording, frames=tuple(frames)),
        terrain,
        RunConfig(),
        detector=told if made_by == "function" else None,
    )
    late = {(frame.drone, frame.stamp_ns) for frame in frames if frame.stamp_ns >= begun}
    assert {(one.drone, one.stamp_ns) for one in run.refused} == {one for one in late if one[0] != "uav3"}
    reason = "its heatmap shows nobody, and the picture shows nothing but one tone (red 0, green 0, blue 0)"
    assert all(reason in one.reason for one in run.refused) and len(run.refused) == 8


@pytest.mark.parametrize("made_by", ["recorded", "function"])
@pytest.mark.parametrize("value", [0.0, 0.9])
def test_nothing_is_a_landing_site_beside_a_picture_that_shows_nothing(
    recorded: Path, terrain: Terrain, made_by: str, value: float
) -> None:
    """One tone looks like a field: what says that one could land there saw nothing either."""
    recording = open_recording(recorded)
    begun = recording.frames[len(recording.frames) // 2].stamp_ns

    def told(frame: Frame) -> np.ndarray:
        fit = np.full((6, 8), value, np.float32)
        fit[frame.stamp_ns % 6, ord(frame.drone[-1]) % 8] = 0.1  # no video that stands still
        return fit

    def of_fields(frame: Frame) -> Frame:
        dead = {"image": lambda: covered(128)} if frame.stamp_ns >= begun else {}
        layers = {"landing-site": LayerPixels(heatmap=lambda: told(frame))}
        return replace(frame, pixels=replace(frame.pixels, layers=layers, **dead))

    fields = replace(recording, frames=tuple(map(of_fields, recording.frames))).of_layer("landing-site")
    run = pipeline.run(fields, terrain, RunConfig(), detector=told if made_by == "function" else None)
    late = {(frame.drone, frame.stamp_ns) for frame in fields.frames if frame.stamp_ns >= begun}
    dead = {(one.drone, one.stamp_ns) for one in run.refused if "shows nothing but one tone" in one.reason}
    assert dead == late and late


def test_a_picture_that_cannot_be_read_takes_no_recorded_heatmap_with_it(
    recorded: Path, terrain: Terrain
) -> None:
    def broken() -> bytes:
        raise OSError("gone")

    recording = open_recording(recorded)
    nobody = np.zeros((6, 8), np.uint8)
    frames = [
        replace(frame, pixels=replace(frame.pixels, image=broken, heatmap=lambda: nobody))
        for frame in recording.frames
    ]
    assert not pipeline.run(replace(recording, frames=tuple(frames)), terrain, RunConfig()).refused


def covered(tone: int) -> bytes:
    file = io.BytesIO()
    Image.fromarray(np.full((24, 32, 3), tone, np.uint8)).save(file, "PNG")
    return file.getvalue()


def test_a_contract_fills_in_what_the_configuration_leaves_open(
    recorded: Path, model: Path, terrain: Terrain
) -> None:
    def used(config: RunConfig, detector: Any) -> dict[str, Any]:
        run = pipeline.run(open_recording(recorded), terrain, config, detector=detector)
        return {name: run.config.parameters(run.crowd_map)[name] for name in DEFAULTS}

    stated = {"true_positive_rate": 0.8, "false_positive_rate": 0.01, "target_height_m": 1.5}
    assert used(CONFIG, Detector(model)) == stated
    assert used(CONFIG, None) == used(CONFIG, red) == DEFAULTS
    own = RunConfig(PaperConfig(prior=0.2, true_positive_rate=0.7), ProjectionConfig(target_height_m=0.0))
    assert used(own, Detector(model)) == {**stated, "true_positive_rate": 0.7, "target_height_m": 0.0}
    run = pipeline.run(open_recording(recorded), terrain, RunConfig(OrConfig()), detector=Detector(model))
    assert run.config.parameters(run.crowd_map) == {
        "b_threshold": 0.5,
        "max_range_m": 300.0,
        "target_height_m": 1.5,
        "coverage": "full",
        "surface": "planes",
        "tolerance_ms": 100.0,
    }


def test_a_stated_rate_that_equation_1_cannot_use(model: Path) -> None:
    sure = {**RATES, "false_positive": {"rate": 0.0, "low": 0.0, "high": 0.1}}
    stated = Detector(model, contract=contract(rates=sure)).contract
    with pytest.raises(ValueError, match="states a false_positive_rate of 0; equation 1"):
        CONFIG.with_detector(stated)
    assert PaperConfig(false_positive_rate=0.02).with_detector(stated).false_positive_rate == 0.02
    assert RunConfig(OrConfig()).with_detector(stated).method == OrConfig()


def test_frames_that_fail_are_refused_and_the_rest_is_fused(
    recorded: Path, model: Path, terrain: Terrain, tmp_path: Path
) -> None:
    damaged = tmp_path / "damaged"
    shutil.copytree(recorded, damaged)
    victim = sorted((damaged / "images").glob("img_uav1_*_0_*.png"))[2]
    victim.write_bytes(victim.read_bytes()[:60])
    recording = open_recording(damaged)
    run = pipeline.run(recording, terrain, CONFIG, detector=Detector(model))
    (refused,) = run.refused
    assert recording.refused == ()  # its pixels were not read when it was opened
    assert refused.drone == "uav1" and "image cannot be read" in refused.reason
    assert sum(len(row.drones) for row in run.rows) == 17

    def fails_for_uav3(frame: Frame) -> NDArray[np.float32]:
        if frame.drone == "uav3":
            raise RuntimeError("out of memory")
        return np.full((6, 8), np.nan if frame.drone == "uav_2" else 0.5, np.float32)

    refused_frames = pipeline.run(open_recording(recorded), terrain, CONFIG, detector=fails_for_uav3).refused
    reasons = {refused.drone: refused.reason for refused in refused_frames}
    assert set(reasons) == {"uav_2", "uav3"} and len(refused_frames) == 12
    assert reasons["uav3"] == "the detector failed: out of memory"
    assert "nan" in reasons["uav_2"].lower()

    def mistaken(frame: Frame) -> NDArray[np.float32]:
        return frame.no_such_thing  # type: ignore[attr-defined]

    with pytest.raises(AttributeError):
        pipeline.run(open_recording(recorded), terrain, CONFIG, detector=mistaken)

    def without_return(frame: Frame) -> NDArray[np.float32]:
        return None  # type: ignore[return-value]

    with pytest.raises(TypeError, match=r"heatmap made for uav\w+ at \d+ is None; it must be"):
        pipeline.run(open_recording(recorded), terrain, CONFIG, detector=without_return)

    made = iter([np.zeros((6, 8), np.float32)] * 7)
    with pytest.raises(RuntimeError, match=r"no heatmap was made for uav\w+ at \d+: .* StopIteration"):
        pipeline.run(open_recording(recorded), terrain, CONFIG, detector=lambda _: next(made))


def test_automatic_choice(
    recorded: Path, model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with_pictures = open_recording(recorded)
    without = open_recording(write_folder(tmp_path / "plain", flight()))
    some_missing = tmp_path / "some"
    shutil.copytree(recorded, some_missing)
    monkeypatch.setattr("crowdfence.detector.shipped.shipped_model", lambda _, device: model)
    chosen = choose_detector(with_pictures, "auto")
    assert chosen is not None and chosen.path == model
    assert choose_detector(with_pictures, "recorded") is None
    assert choose_detector(without, "auto") is None
    with pytest.raises(ValueError, match="belongs to a model"):
        choose_detector(without, "auto", contract=Path("contract.json"))
    with pytest.raises(ValueError, match="--device cuda is for a model"):
        choose_detector(with_pictures, "recorded", device="cuda")
    with pytest.raises(ValueError, match="--enlarge never is for a model"):
        choose_detector(with_pictures, "recorded", enlarge="never")
    with pytest.raises(FileNotFoundError, match="nowhere.onnx"):
        choose_detector(with_pictures, "nowhere.onnx")

    def missing(_: str, device: str) -> Path:
        raise FileNotFoundError("no model")

    monkeypatch.setattr("crowdfence.detector.shipped.shipped_model", missing)
    with pytest.raises(ValueError, match="is missing .* --detector recorded"):
        choose_detector(with_pictures, "auto")
    assert choose_detector(without, "auto") is None


def test_people_are_brought_to_scale_by_pose_and_map(
    recorded: Path, terrain: Terrain, tmp_path: Path
) -> None:
    detector = Detector(write_pixel_people_model(tmp_path / "people.onnx", contract("points")))
    with pytest.raises(ValueError, match="metres per pixel: give a map"):
        heatmap_source(detector, None, 300.0)
    recording = open_recording(recorded)
    run = pipeline.run(recording, terrain, CONFIG, detector=detector)
    assert not run.refused
    # Nothing in these pictures is as red as a person.
    assert all(view.heatmap.max() < 0.1 for view in run.last_views.values())
    out_of_range = heatmap_source(detector, terrain, 5.0)
    with pytest.raises(FrameError, match="sees no ground of the map"):
        out_of_range.heatmap_of(recording.frames[0])


@pytest.mark.parametrize("combined", [False, True])
def test_a_model_that_sees_pictures_far_smaller_is_told(
    recorded: Path, model: Path, terrain: Terrain, tmp_path: Path, combined: bool
) -> None:
    document = contract(name="small", input__size=[8, 8], input__resize="letterbox")
    detector = Detector(write_map_model(tmp_path / "small.onnx", document))
    if combined:
        detector = Detector.combined([Detector(model), detector])
    review = pipeline.run(open_recording(recorded), terrain, CONFIG, detector=detector).review
    assert review is not None
    (warning,) = (one for one in review.warnings if "shrunk" in one)
    assert warning.startswith("the detector small is shown pictures of 32 x 24 pixels shrunk to 8 x 6, half")


@pytest.mark.parametrize(("stated_m", "given_m", "told"), [(90, None, 1), (90, 0.9, 0), (2.5, None, 0)])
def test_a_height_in_centimetres_is_told(
    recorded: Path, terrain: Terrain, tmp_path: Path, stated_m: float, given_m: float | None, told: int
) -> None:
    """Crowds lay tens of metres beside where they stood, and nothing said so."""
    detector = Detector(write_map_model(tmp_path / "m.onnx", contract(target_height_m=stated_m)))
    config = replace(CONFIG, projection=replace(CONFIG.projection, target_height_m=given_m))
    review = review_detector(
        heatmap_source(detector, terrain, 300.0), open_recording(recorded), terrain, config
    )
    assert review is not None
    assert (
        sum("marks what is 90 m above the ground (target_height_m)" in one for one in review.warnings) == told
    )
    assert len(check_model(tmp_path / "m.onnx").warnings) == (stated_m == 90)


@pytest.mark.parametrize("people_first", [False, True])
def test_a_combination_is_brought_to_scale_whichever_of_its_members_needs_it(
    recorded: Path, model: Path, terrain: Terrain, tmp_path: Path, people_first: bool
) -> None:
    """The first says what a combination was tested on; it need not be the one that asks for metres."""
    people = Detector(write_pixel_people_model(tmp_path / "people.onnx", contract("points", name="people")))
    both = [people, Detector(model)] if people_first else [Detector(model), people]
    combined = Detector.combined(both)
    with pytest.raises(ValueError, match="people gives points, which become a heatmap only with metres"):
        heatmap_source(combined, None, 300.0)
    assert not pipeline.run(open_recording(recorded), terrain, CONFIG, detector=combined).refused


def test_run_says_which_detector_it_used(recorded: Path, model: Path, tmp_path: Path) -> None:
    command = ["run", str(recorded), "-o", str(tmp_path / "out"), "-m", "paper", "--prior", "0.2"]
    command += ["--detector", str(model)]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    used = summary["detector"]
    assert (used["heatmaps"], used["name"], used["version"]) == ("model", "test model", "1.0")
    assert used["sha256"] == hashlib.sha256(model.read_bytes()).hexdigest()
    assert used["ranges"]["gsd_m"]["tested"] == [0.001, 0.002]
    assert used["ranges"]["gsd_m"]["share_above"] == 1.0
    assert summary["parameters"]["true_positive_rate"] == 0.8
    calibration, rates, gsd = summary["warnings"][:3]
    assert "states no calibration" in calibration
    assert "were measured with surface voxels; this run has surface planes" in rates
    assert "metres per pixel: 100% of the ground seen lies above 0.002 m" in gsd
    assert "lies above 0.002 m" in " ".join(done.stderr.split())

    plain = CliRunner().invoke(app, [*command[:-2], "--force", "--detector", "recorded"])
    assert plain.exit_code == 0, plain.output
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["detector"] == {"heatmaps": "recorded"}
    assert all("is not on the map" in warning for warning in summary["warnings"])  # noise up to the sky
    assert summary["parameters"]["true_positive_rate"] == 0.9


def test_evaluate_measures_the_chosen_detector(recorded: Path, model: Path) -> None:
    command = ["evaluate", str(recorded), "--prior", "0.2", "--json", "--detector", str(model)]
    done = CliRunner().invoke(app, command)
    assert done.exit_code == 0, done.output
    report = json.loads(done.stdout)
    assert report["detector"]["name"] == "test model" and report["refused"] == []
    # Crowd is region 1 to 3; the picture is 60, 120, 180 there, so the model calls only region 3 crowd.
    flown = flight()
    crowd = np.concatenate(
        [heatmap(drone, stamp).ravel() // 64 for drone in STARTS for stamp in flown.frame_stamps_ns[drone]]
    )
    expected = (crowd == 3).sum() / (crowd > 0).sum()
    assert report["detector"]["true_positive_rate"]["rate"] == pytest.approx(expected)
    assert report["detector"]["false_positive_rate"]["rate"] == 0.0
    assert {row["config"]["target_height_m"] for row in report["scores"]} == {1.5}
    counts = measured_rates(open_recording(recorded), heatmap_source(Detector(model), None, 300.0))
    assert counts.true_positives == (crowd == 3).sum()
