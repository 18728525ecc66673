"""`crowdfence calibrate` on small recordings with truth, and what it leaves in the model."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from PIL import Image

from crowdfence import Terrain, _core, open_recording
from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.detector import Detector
from crowdfence.evaluation.labelled_missions import MeasurementPlan
from crowdfence.evaluation.model_quality import model_quality
from crowdfence.labelled_pictures.annotated_picture import AnnotatedPicture, rectangle
from crowdfence.labelled_pictures.coco import ANNOTATIONS, write_coco
from support.command_line import crowdfence
from support.onnx_models import STRIDE, contract, write_map_model
from support.small_recordings import (
    HEIGHT,
    WIDTH,
    Flight,
    flight,
    ground,
    write_airsim,
    write_folder,
    write_walled_map,
)

FAILED = 1
ROWS, COLUMNS = HEIGHT // 4, WIDTH // 4


def later(flown: Flight, delay_ns: int) -> Flight:
    frames = {
        drone: [stamp + delay_ns for stamp in stamps] for drone, stamps in flown.frame_stamps_ns.items()
    }
    return replace(flown, frame_stamps_ns=frames)


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Three AirSim recordings over a plane; a pixel's grey says whether it is crowd (0: no, 60-180: yes)."""
    terrain = Terrain.from_points(ground(), 2.0)
    bt = _core.write_octomap_binary(terrain, np.arange(terrain.voxel_count))
    folders = []
    for number in range(3):
        place = tmp_path_factory.mktemp(f"place{number}") / f"mission-{number}"
        folders.append(write_airsim(place, later(flight(frames=4), number * 20_000_001)))
        (folders[-1] / "terrain" / "terrain.bt").write_bytes(bt)
    return folders


def noisy_model(path: Path, *, sharpness: float, kind: str = "probability", **contract: object) -> Path:
    """A detector that sees grey: its logit is `sharpness` times (grey in steps of 60 - 1.5 + noise that is
    fixed for every cell of the image)."""
    noise = np.random.default_rng(5).logistic(0.0, 2.0, (1, 1, ROWS, COLUMNS)).astype(np.float32)
    weights = {
        "scale": np.array(sharpness / 60.0, np.float32),
        "offset": (sharpness * (noise - 1.5)).astype(np.float32),
    }
    last = "heatmap" if kind == "logits" else "logits"
    nodes = [
        helper.make_node("Cast", ["image"], ["colour"], to=TensorProto.FLOAT),
        helper.make_node("Transpose", ["colour"], ["planes"], perm=[0, 3, 1, 2]),
        helper.make_node("AveragePool", ["planes"], ["cells"], kernel_shape=[4, 4], strides=[4, 4]),
        helper.make_node("ReduceMean", ["cells"], ["grey"], axes=[1], keepdims=1),
        helper.make_node("Mul", ["grey", "scale"], ["scaled"]),
        helper.make_node("Add", ["scaled", "offset"], [last]),
    ]
    if kind == "probability":
        nodes.append(helper.make_node("Sigmoid", ["logits"], ["heatmap"]))
    graph = helper.make_graph(
        nodes,
        "noisy",
        [helper.make_tensor_value_info("image", TensorProto.UINT8, [1, HEIGHT, WIDTH, 3])],
        [helper.make_tensor_value_info("heatmap", TensorProto.FLOAT, [1, 1, ROWS, COLUMNS])],
        [numpy_helper.from_array(value, name) for name, value in weights.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8)
    document = {
        "schema": 1,
        "name": "noisy",
        "input": {
            "name": "image",
            "layout": "NHWC",
            "dtype": "uint8",
            "color": "RGB",
            "size": [WIDTH, HEIGHT],
            "resize": "stretch",
        },
        "output": {"name": "heatmap", "kind": kind, "layout": "NCHW", "stride": 4},
        **contract,
    }
    model.metadata_props.add(key="crowdfence", value=json.dumps(document))
    model.metadata_props.add(key="author", value="somebody")
    onnx.save_model(model, str(path))
    return path


def calibrate(model: Path, data: list[Path], output: Path, *more: object) -> subprocess.CompletedProcess[str]:
    return crowdfence(
        "calibrate", model, *(word for path in data for word in ("--data", path)), "-o", output, *more
    )


@pytest.fixture(scope="module")
def calibrated(data: list[Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path, dict]:
    """An overconfident model, the same calibrated, and what the command said."""
    folder = tmp_path_factory.mktemp("models")
    model, output = noisy_model(folder / "noisy.onnx", sharpness=4.0), folder / "calibrated.onnx"
    done = calibrate(model, data, output, "--json")
    assert done.returncode == 0, done.stderr
    return model, output, json.loads(done.stdout)


def test_an_overconfident_model_is_calibrated_and_described(
    data: list[Path], calibrated: tuple[Path, Path, dict]
) -> None:
    model, output, report = calibrated
    held_out = report["candidates"][report["chosen"]]["held_out"]
    assert report["before"]["calibration_error_above"]["value"] > 0.1
    assert (
        held_out["calibration_error_above"]["value"]
        < 0.6 * report["before"]["calibration_error_above"]["value"]
    )
    assert report["frames"] == 3 * 12 and report["missions"] == 3 and report["refused"] == []
    assert set(report["quality"]["by"]["mission"]) == {"mission-0", "mission-1", "mission-2"}

    after = Detector(output)
    rates = after.contract.rates or {}
    assert (rates["per"], rates["voxel_size_m"], rates["missions"]) == ("voxel observation", 2.0, 3)
    assert 0.0 < rates["false_positive"]["rate"] < rates["true_positive"]["rate"] < 1.0
    assert after.contract.calibration is not None and after.contract.calibration["method"] == report["chosen"]
    assert after.contract.validity is not None and after.contract.target_height_m == 0.6
    assert {entry.key for entry in onnx.load(str(output)).metadata_props} == {"author", "crowdfence"}

    image = open_recording(data[0]).frames[0].image()
    confidence = [np.abs(Detector(path)(image) - 0.5).mean() for path in (model, output)]
    assert confidence[1] < confidence[0]


def test_a_model_that_resizes_is_measured_as_it_is_written(data: list[Path], tmp_path: Path) -> None:
    """Its heatmap lies between its cells, and the correction of what lies between two of them is not what
    lies between two that are corrected: rates and figures are those of the file, to the last digit."""
    described = contract(
        "logits", input__size=[WIDTH // 2, HEIGHT // 2], input__multiple_of=4, input__resize="stretch"
    )
    model = write_map_model(tmp_path / "half.onnx", described, scale=0.2, offset=-9.0, blur_cells=1)
    done = calibrate(model, data, tmp_path / "calibrated.onnx", "--json")
    assert done.returncode == 0, done.stderr
    report, after = json.loads(done.stdout), Detector(tmp_path / "calibrated.onnx")
    assert report["chosen"] != "none"
    plan = MeasurementPlan(target_height_m=report["contract"]["target_height_m"])
    written = model_quality(after, data, plan).to_json()
    assert written["rates"] == report["rates"]["all"]
    assert written["quality"]["overall"] == report["quality"]["overall"]


def test_a_model_whose_correction_does_not_hold_is_not_written(data: list[Path], tmp_path: Path) -> None:
    """One that rolls dice; what was there before stays, also where it may be replaced."""
    model, output = noisy_model(tmp_path / "dice.onnx", sharpness=1.0), tmp_path / "calibrated.onnx"
    changed = onnx.load(str(model))
    last = changed.graph.node.pop()
    changed.graph.node.append(helper.make_node("RandomNormalLike", [last.input[0]], ["dice"]))
    changed.graph.node.append(helper.make_node("Add", [last.input[0], "dice"], ["thrown"]))
    changed.graph.node.append(helper.make_node("Sigmoid", ["thrown"], ["heatmap"]))
    onnx.save_model(changed, str(model))
    output.write_bytes(b"an earlier model")
    done = calibrate(model, data, output, "--force")
    assert done.returncode == FAILED and "differs from its calibration" in done.stderr
    assert "Nothing is written" in done.stderr and output.read_bytes() == b"an earlier model"
    assert {path.name for path in tmp_path.iterdir()} == {"dice.onnx", "calibrated.onnx"}


def test_the_table_says_what_was_measured(data: list[Path], tmp_path: Path) -> None:
    done = calibrate(
        noisy_model(tmp_path / "m.onnx", sharpness=4.0), data[:2], tmp_path / "out.onnx", "--every", 6
    )
    assert done.returncode == 0, done.stderr
    for part in ("NLL per cell", "ECE > 0.05", "TPR", "FPR", "before", "after", "mission mission-1"):
        assert part in done.stdout
    assert "(chosen)" in done.stdout


def test_logits_are_corrected_in_the_graph_and_not_twice(data: list[Path], tmp_path: Path) -> None:
    """A contract that divides logits by 2 becomes one whose graph has all in it, temperature 1."""
    model = noisy_model(tmp_path / "m.onnx", sharpness=4.0, kind="logits", calibration={"temperature": 2.0})
    output = tmp_path / "out.onnx"
    done = calibrate(model, data[:2], output, "--every", 4)
    assert done.returncode == 0, done.stderr
    calibration = Detector(output).contract.calibration or {}
    assert calibration["temperature"] == 1.0
    assert calibration["earlier"] == {"temperature": 2.0}
    probability = noisy_model(tmp_path / "p.onnx", sharpness=2.0)
    assert calibrate(probability, data[:2], tmp_path / "p-out.onnx", "--every", 4).returncode == 0
    image = open_recording(data[1]).frames[3].image()
    same = Detector(tmp_path / "p-out.onnx")(image)
    np.testing.assert_allclose(Detector(output)(image), same, atol=1e-3)


def test_one_mission_gives_a_temperature_and_warnings(data: list[Path], tmp_path: Path) -> None:
    done = calibrate(noisy_model(tmp_path / "m.onnx", sharpness=4.0), data[:1], tmp_path / "out.onnx")
    assert done.returncode == 0, done.stderr
    assert "only a temperature was fitted" in done.stderr and "one mission only" in done.stderr
    assert "no picture of a flight will be told to be unlike them" in done.stderr.replace("\n", " ")
    assert (Detector(tmp_path / "out.onnx").contract.calibration or {})["temperature"] > 1.5


def test_doubts_about_a_map_are_told(data: list[Path], tmp_path: Path) -> None:
    """A square of ground of 100 m by 100 m below a wall of 1000 m by 100 m: which of them is the ground?"""
    mission = tmp_path / "mission"
    shutil.copytree(data[0], mission)
    write_walled_map(mission)
    told = "mission: it shows 100,000 m2 of surface from the south and 10,000 m2 from above, a wall and"
    model = noisy_model(tmp_path / "m.onnx", sharpness=4.0)
    done = calibrate(model, [mission], tmp_path / "out.onnx", "--every", "4", "--json")
    assert done.returncode == 0, done.stderr
    assert len([one for one in json.loads(done.stdout)["warnings"] if one.startswith(told)]) == 1
    quality = model_quality(Detector(model), [mission], MeasurementPlan(every=4))
    assert quality.warnings[0].startswith(told)


def test_what_a_recording_warns_of_and_refuses_is_told_once(data: list[Path], tmp_path: Path) -> None:
    """A frame 500 hours after the others of its drone, a label of no frame, and a file that is no picture."""
    flown = flight(frames=4)
    stamps = flown.frame_stamps_ns["uav1"]
    flown = flown.with_frames("uav1", [*stamps[:3], stamps[3] + 500 * 3_600_000_000_000])
    mission = write_airsim(tmp_path / "mission", flown)
    shutil.copyfile(data[0] / "terrain" / "terrain.bt", mission / "terrain" / "terrain.bt")
    labels = sorted((mission / "truth" / "regions").iterdir())
    shutil.copyfile(labels[0], labels[0].with_name("region_uav1_1760000000999999999.png"))
    damaged = f"img_uav3_front_center_0_{flown.frame_stamps_ns['uav3'][2]}.png"
    (mission / "images" / damaged).write_bytes(b"no picture")
    warned, refused = open_recording(mission).warnings, open_recording(mission).refused
    assert "belong" in warned[0] and "jumps 500.00 h away" in refused[0].reason
    model = noisy_model(tmp_path / "m.onnx", sharpness=4.0)
    commands = {
        "calibrate": ("calibrate", model, "--data", mission, "-o", tmp_path / "out.onnx"),
        "evaluate": ("model", "evaluate", model, "--data", mission),
    }
    for name, words in commands.items():
        done = crowdfence(*words, "--every", "2", "--json")
        assert done.returncode == 0, done.stderr
        report = json.loads(done.stdout)
        assert report["warnings"].count(f"mission: {warned[0]}") == 1, name
        assert report["refused"].count(f"mission: {refused[0]}") == 1, name
        assert len([one for one in report["refused"] if "uav3" in one]) == 1, name


def test_a_model_that_needs_metres_per_pixel_says_what_pictures_lack(tmp_path: Path) -> None:
    """`model evaluate` has no --terrain, and `detect` has --gsd-m."""
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    Image.fromarray(noise).save(pictures / "a.png")
    marked = AnnotatedPicture(pictures / "a.png", WIDTH, HEIGHT, np.empty((0, 4)), (rectangle(0, 0, 9, 9),))
    write_coco([marked], pictures / ANNOTATIONS)
    model = write_map_model(tmp_path / "m.onnx", contract("density"))
    told = crowdfence("model", "evaluate", model, "--data", pictures, columns=400).stderr
    assert "needs metres per pixel, and pictures comes without a map that tells them" in told
    assert "--terrain" not in told
    detect = ("detect", pictures, "--detector", model, "-o", tmp_path / "out")
    assert "give them with --gsd-m" in crowdfence(*detect, columns=400).stderr
    assert crowdfence(*detect, "--gsd-m", "0.1").returncode == 0


def test_metres_per_pixel_of_pictures_are_those_of_their_annotations(tmp_path: Path) -> None:
    """A model of density counts people per square metre: .01 a pixel are 1 to the square metre at .1 m per
    pixel, a crowd, and .0625 at .4 m, none (3 people in a disc of 2 m are .24)."""
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    everywhere, nowhere = (rectangle(0, 0, WIDTH, HEIGHT),), ()
    marked = []
    for name, gsd_m, crowds in (("near", 0.1, everywhere), ("far", 0.4, nowhere), ("unknown", None, nowhere)):
        noise = np.random.default_rng(0).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
        Image.fromarray(noise).save(pictures / f"{name}.png")
        one = AnnotatedPicture(pictures / f"{name}.png", WIDTH, HEIGHT, np.empty((0, 4)), crowds, gsd_m=gsd_m)
        marked.append(one)
    write_coco(marked, pictures / ANNOTATIONS)
    model = write_map_model(tmp_path / "m.onnx", contract("density"), scale=0.0, offset=0.01 * STRIDE**2)
    done = crowdfence("model", "evaluate", model, "--data", pictures, "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["frames"] == 2 and report["quality"]["overall"]["iou"]["value"] == 1.0
    (refused,) = report["refused"]
    assert "unknown" in refused and "metres per pixel of its picture are unknown" in refused


def test_a_map_beside_the_cameras_is_refused(data: list[Path], tmp_path: Path) -> None:
    """5 km to the east, as `run` refuses it: pictures were of unknown scale, and no rate rested on them."""
    mission = tmp_path / "mission"
    shutil.copytree(data[0], mission)
    aside = Terrain.from_points(ground() + np.array([5000.0, 0.0, 0.0]), 2.0)
    written = _core.write_octomap_binary(aside, np.arange(aside.voxel_count))
    (mission / "terrain" / "terrain.bt").write_bytes(written)
    model = noisy_model(tmp_path / "m.onnx", sharpness=4.0)
    done = calibrate(model, [mission, data[1]], tmp_path / "out.onnx")
    assert done.returncode == FAILED and not (tmp_path / "out.onnx").exists()
    assert "error: mission: terrain and poses do not overlap: the nearest camera is 4" in done.stderr
    done = crowdfence("model", "evaluate", model, "--data", mission)
    assert done.returncode == FAILED and "mission: terrain and poses do not overlap" in done.stderr


def test_a_correction_that_finds_fewer_people_says_so(tmp_path: Path) -> None:
    """Of the red cells 100 are crowd and 300 are not: what is red is crowd with probability 1/4, below 0.5,
    where the model called all of it."""
    folders = []
    for number in range(3):
        folders.append(tmp_path / f"pictures-{number}")
        folders[-1].mkdir()
        pixels = np.full((120, 160, 3), number, np.uint8)
        pixels[:40, :40] = pixels[80:, :120] = (255, 0, 0)
        place = folders[-1] / "a.png"
        Image.fromarray(pixels).save(place)
        crowd = rectangle(0.0, 0.0, 40.0, 40.0)
        write_coco([AnnotatedPicture(place, 160, 120, np.empty((0, 4)), (crowd,))], folders[-1] / ANNOTATIONS)
    model = write_map_model(tmp_path / "m.onnx", contract("logits"), scale=8.0 / 255.0, offset=-4.0)
    done = calibrate(model, folders, tmp_path / "out.onnx", "--json")
    assert done.returncode == 0, done.stderr
    warnings = json.loads(done.stdout)["warnings"]
    assert any("call 0.0% of the crowd cells, the model's own 100.0%" in warning for warning in warnings)
    assert "finds fewer people" in done.stderr.replace("\n", " ")


def test_what_the_model_stated_and_the_calibrated_one_does_not_is_told(
    calibrated: tuple[Path, Path, dict], tmp_path: Path
) -> None:
    """Rates, and what tested pictures look like: two pictures without a map measure neither anew."""
    _, output, report = calibrated
    assert not any("left out" in one or "unlike them" in one for one in report["warnings"])
    stated = Detector(output).contract
    assert stated.rates is not None and stated.pictures is not None
    folders = [tmp_path / name for name in ("a", "b")]
    for number, folder in enumerate(folders):
        folder.mkdir()
        pixels = np.random.default_rng(number).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
        Image.fromarray(pixels).save(folder / "a.png")
        crowd = rectangle(0.0, 0.0, WIDTH / 2.0, HEIGHT)
        marked = AnnotatedPicture(folder / "a.png", WIDTH, HEIGHT, np.empty((0, 4)), (crowd,))
        write_coco([marked], folder / ANNOTATIONS)
    done = calibrate(output, folders, tmp_path / "again.onnx", "--json")
    assert done.returncode == 0, done.stderr
    again, warnings = Detector(tmp_path / "again.onnx").contract, json.loads(done.stdout)["warnings"]
    assert again.rates is None and again.pictures is None
    for words in ("those that it stated, of other heatmaps, are left out", "told to be unlike them"):
        assert len([one for one in warnings if one.endswith(words)]) == 1, words


def test_a_correction_that_keeps_one_half_says_nothing_of_people(calibrated: tuple[Path, Path, dict]) -> None:
    assert not any("fewer people" in warning for warning in calibrated[2]["warnings"])


def test_a_model_no_better_than_chance_is_told(
    data: list[Path], calibrated: tuple[Path, Path, dict], tmp_path: Path
) -> None:
    """One that takes empty cells for crowd: its precision never exceeds the share of crowd."""
    done = calibrate(noisy_model(tmp_path / "m.onnx", sharpness=-4.0), data, tmp_path / "out.onnx", "--json")
    report = json.loads(done.stdout)
    overall = report["quality"]["overall"]
    assert overall["pr_auc"]["value"] < overall["crowd_cells"] / overall["cells"]
    assert any(warning.startswith("the model does not tell crowd") for warning in report["warnings"])
    assert not any("does not tell crowd" in warning for warning in calibrated[2]["warnings"])


def test_intervals_over_three_missions_are_called_too_narrow(calibrated: tuple[Path, Path, dict]) -> None:
    assert any("3 missions only: intervals" in warning for warning in calibrated[2]["warnings"])


def test_two_kinds_of_truth_in_one_table_are_told(data: list[Path], tmp_path: Path) -> None:
    """Of one mission it is known where people stood, of the other what the pictures show of them."""
    world = Path(shutil.copytree(data[0], tmp_path / "world"))
    east, north, up = ground()[0]
    rows = [
        f"{stamp_ns},{person},{east + person},{north},{up},0"
        for stamp_ns in sorted({frame.stamp_ns for frame in open_recording(world).frames})
        for person in range(1, 4)
    ]
    (world / "truth" / "world.csv").write_text("\n".join(["stamp_ns,person,x,y,z,crowd", *rows]) + "\n")
    model = noisy_model(tmp_path / "noisy.onnx", sharpness=1.0)
    told = "two truths of voxels in one table: where people stood in world, the labels of pictures in mission"
    done = calibrate(model, [world, data[1]], tmp_path / "a.onnx", "--json")
    assert done.returncode == 0, done.stderr
    assert sum(warning.startswith(told) for warning in json.loads(done.stdout)["warnings"]) == 1
    done = calibrate(model, [world, data[1]], tmp_path / "b.onnx", "--truth", "labels")
    assert done.returncode == 0 and "two truths" not in done.stderr


def test_a_folder_of_recordings_without_truth_is_refused(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "plain", flight(frames=2))
    done = calibrate(noisy_model(tmp_path / "m.onnx", sharpness=1.0), [folder], tmp_path / "out.onnx")
    assert done.returncode == FAILED
    assert "no frame of plain can be used" in done.stderr and "has no truth" in done.stderr
    assert not (tmp_path / "out.onnx").exists()


def test_what_cannot_work_is_said_before_the_long_run(data: list[Path], tmp_path: Path) -> None:
    density = noisy_model(tmp_path / "m.onnx", sharpness=1.0)
    sidecar = json.loads(onnx.load(str(density)).metadata_props[0].value)
    sidecar["output"] |= {"kind": "density", "count_scale": 1.0}
    (tmp_path / "m.crowdfence.json").write_text(json.dumps(sidecar))
    done = calibrate(density, data, tmp_path / "out.onnx")
    assert done.returncode == FAILED and "puts out density" in done.stderr

    good = noisy_model(tmp_path / "good.onnx", sharpness=1.0)
    done = calibrate(good, [data[0], data[0]], tmp_path / "out.onnx")
    assert done.returncode == FAILED and "is given twice" in done.stderr

    done = calibrate(good, data, good, "--force")
    assert done.returncode == FAILED and "is read for this, and would be lost" in done.stderr

    (tmp_path / "out.crowdfence.json").write_text("{}")
    for model in (good, Path("crowdnet-s")):  # a shipped one goes by its name, as everywhere
        done = calibrate(model, data, tmp_path / "out.onnx")
        assert done.returncode == FAILED and "would hide the contract" in done.stderr


def test_without_the_package_onnx_the_message_says_how_to_get_it(tmp_path: Path) -> None:
    blocked = (
        "import sys, importlib.util as u; found = u.find_spec; "
        "u.find_spec = lambda name, *more: None if name == 'onnx' else found(name, *more); "
        "import crowdfence.cli as cli; "
        "sys.argv = ['crowdfence', 'calibrate', 'm.onnx', '--data', 'd', '-o', 'o.onnx']; cli.main()"
    )
    done = subprocess.run(
        [sys.executable, "-c", blocked], capture_output=True, text=True, cwd=tmp_path, check=False
    )
    assert done.returncode == FAILED
    assert "pip install 'crowdfence[train]'" in done.stderr


def test_the_contract_written_reads_back(calibrated: tuple[Path, Path, dict]) -> None:
    _, output, report = calibrated
    (entry,) = [entry for entry in onnx.load(str(output)).metadata_props if entry.key == "crowdfence"]
    contract = Contract.from_json(json.loads(entry.value))
    assert contract == Detector(output).contract
    assert contract.to_json() == report["contract"]
