"""A model in eight bits against itself in floating point, and what of it stays in floating point."""

import json
import shutil
from pathlib import Path

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper, numpy_helper
from PIL import Image

from crowdfence import Detector, open_recording
from crowdfence.calibration.quantization import quantize_model
from crowdfence.detector.combination import COMBINATIONS
from crowdfence.errors import DetectorError
from crowdfence.labelled_pictures.annotated_picture import AnnotatedPicture, rectangle
from crowdfence.labelled_pictures.coco import ANNOTATIONS, write_coco
from support.command_line import crowdfence
from support.onnx_models import contract, write_map_model
from support.small_recordings import (
    HEIGHT,
    WIDTH,
    flight,
    write_airsim,
    write_labelled_missions,
    write_walled_map,
)

CHANNELS = 8
MODELS = COMBINATIONS.parent


def write_convolutions(path: Path, bias: float = 0.0, loud: float = 1.0) -> Path:
    """Three convolutions: the cells of 4 x 4 pixels, 8 channels on 8, and the logits, to which `bias` is
    added. The third channel is `loud` times as strong behind the first, which the second makes up for."""
    rng = np.random.default_rng(3)
    weights = {
        "first": rng.normal(0, 0.3, (CHANNELS, 3, 4, 4)),
        "middle": rng.normal(0, 0.5, (CHANNELS, CHANNELS, 1, 1)),
        "last": rng.normal(0, 0.5, (1, CHANNELS, 1, 1)),
    }
    weights["first"][2] *= loud
    weights["middle"][:, 2] /= loud
    constants = {**weights, "full": np.array(255.0), "bias": np.array([bias])}
    nodes = [
        helper.make_node("Cast", ["image"], ["float"], name="cast", to=TensorProto.FLOAT),
        helper.make_node("Transpose", ["float"], ["planes"], name="planes", perm=[0, 3, 1, 2]),
        helper.make_node("Div", ["planes", "full"], ["scaled"], name="scale"),
        helper.make_node("Conv", ["scaled", "first"], ["a"], name="conv_first", strides=[4, 4]),
        helper.make_node("Relu", ["a"], ["b"], name="relu_first"),
        helper.make_node("Conv", ["b", "middle"], ["c"], name="conv_middle"),
        helper.make_node("Relu", ["c"], ["d"], name="relu_middle"),
        helper.make_node("Conv", ["d", "last", "bias"], ["logits"], name="conv_last"),
        helper.make_node("Sigmoid", ["logits"], ["heatmap"], name="sigmoid"),
    ]
    graph = helper.make_graph(
        nodes,
        "convolutions",
        [helper.make_tensor_value_info("image", TensorProto.UINT8, ["N", "H", "W", 3])],
        [helper.make_tensor_value_info("heatmap", TensorProto.FLOAT, ["N", 1, "h", "w"])],
        [numpy_helper.from_array(value.astype(np.float32), name) for name, value in constants.items()],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=9)
    onnx.save_model(model, str(path))
    return path


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_airsim(tmp_path_factory.mktemp("flight") / "flight", flight(6))
    shutil.rmtree(folder / "terrain")
    return folder


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_convolutions(tmp_path_factory.mktemp("model") / "float.onnx")


def test_eight_bits_stay_within_their_steps(model: Path, recording: Path, tmp_path: Path) -> None:
    """The logits may differ by what rounding to the steps can add up to: half a step of every input of the
    middle layer times its weights, half a step of every weight times its input, and the same of the last."""
    before = Detector(model, contract())
    result = quantize_model(before, model, [recording], tmp_path / "int8.onnx", pictures=4)
    after = Detector(tmp_path / "int8.onnx")
    image = open_recording(recording).frames[0].image()
    weights = onnx.load(model).graph.initializer
    first, middle, last = (numpy_helper.to_array(of_layer).astype(float) for of_layer in weights[:3])
    cells = image[:24, :32].reshape(6, 4, 8, 4, 3).transpose(0, 2, 4, 1, 3) / 255.0
    b = np.maximum(np.einsum("yxcij,ocij->yxo", cells, first), 0.0)
    d = np.maximum(b @ middle[..., 0, 0].T, 0.0)
    step_b, step_d = b.max() / 255.0, d.max() / 255.0
    step_w = np.abs(middle).max(axis=(1, 2, 3)) / 63.0
    error_c = 2 * step_b * np.abs(middle[..., 0, 0]).sum(axis=1) + 0.5 * step_w * b.sum(axis=-1).max()
    error = ((error_c + 2 * step_d) * np.abs(last[0, :, 0, 0])).sum()
    logits = [np.log(p) - np.log1p(-p) for p in (before(image), after(image))]
    assert 0 < np.abs(logits[0] - logits[1]).max() <= error
    assert result.pictures == 4 and result.mean_difference <= error


def test_first_and_last_layer_stay_in_floating_point(model: Path, recording: Path, tmp_path: Path) -> None:
    output = tmp_path / "int8.onnx"
    quantize_model(Detector(model, contract()), model, [recording], output, pictures=4)
    kinds = {t.name: t.data_type for t in onnx.load(output).graph.initializer if t.dims and len(t.dims) == 4}
    assert kinds["first"] == kinds["last"] == TensorProto.FLOAT
    assert [kind for name, kind in kinds.items() if "middle" in name] == [TensorProto.INT8]
    written = Detector(output).contract
    assert written.output.stride == 4 and (written.about or {})["arithmetic"] == "int8"


def test_by_command(model: Path, recording: Path, tmp_path: Path) -> None:
    (tmp_path / "c.json").write_text(json.dumps(contract()))
    output = tmp_path / "int8.onnx"
    told = crowdfence(
        "model", "quantize", model, "--contract", tmp_path / "c.json", "--data", recording, "-o", output
    )
    assert "in eight bits" in told.stdout and output.is_file()
    assert "arithmetic" in crowdfence("model", "check", output).stdout


RATES = {
    "true_positive": {"rate": 0.999, "low": 0.99, "high": 1.0},
    "false_positive": {"rate": 0.001, "low": 0.0, "high": 0.01},
}


def quantized(folder: Path, model: Path, data: list[Path], **told: object) -> tuple[dict, dict]:
    """What the command says of a model whose contract tells more, and the rates in what it wrote."""
    (folder / "c.json").write_text(json.dumps({**contract(), **told}))
    words = ["--contract", folder / "c.json", *(word for path in data for word in ("--data", path))]
    done = crowdfence("model", "quantize", model, *words, "-o", folder / "int8.onnx", "--json")
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), Detector(folder / "int8.onnx").contract.to_json()


@pytest.fixture(scope="module")
def labelled(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two missions over a plane."""
    return write_labelled_missions(tmp_path_factory.mktemp("labelled"))


def test_rates_are_measured_in_eight_bits(model: Path, labelled: list[Path], tmp_path: Path) -> None:
    """As `model evaluate` measures the model that was written; not those of the model in floating point."""
    told, written = quantized(tmp_path, model, labelled, rates={**RATES, "missions": 2})
    measured = crowdfence(
        "model", "evaluate", tmp_path / "int8.onnx", *(w for p in labelled for w in ("--data", p)), "--json"
    )
    rates = json.loads(measured.stdout)["rates"]
    assert rates["true_positive"]["rate"] not in (None, 0.999)
    for stated in (told["rates"], written["rates"]):
        assert {name: stated[name] for name in rates} == rates
        assert stated["missions"] == 2 and stated["arithmetic"] == "int8"
    assert "likelihood_ratio" in written["rates"] and told["rates_not_measured"] is None
    assert "floating point" not in crowdfence("model", "check", tmp_path / "int8.onnx").stdout


def test_what_is_doubtful_about_rates_measured_anew_is_told(
    model: Path, labelled: list[Path], tmp_path: Path
) -> None:
    """A label of no frame, a frame that is no picture, and a wall of 100 m beside a square of ground."""
    mission = tmp_path / "mission"
    shutil.copytree(labelled[0], mission)
    labels = sorted((mission / "truth" / "regions").iterdir())
    shutil.copyfile(labels[0], labels[0].with_name("region_uav1_1760000000999999999.png"))
    write_walled_map(mission)
    picture = sorted((mission / "images").glob("img_uav3_front_center_0_*"))[1]
    picture.write_bytes(b"no picture")
    told, _ = quantized(tmp_path, model, [mission])
    assert told["rates"]["arithmetic"] == "int8"
    for words in ("belong", "a wall and", "one mission only"):
        assert len([one for one in told["warnings"] if words in one]) == 1, words
    assert len(told["refused"]) == 1 and told["refused"][0].startswith("mission: uav3 at ")


def test_rates_that_are_not_measured_say_whose_they_are(
    model: Path, recording: Path, labelled: list[Path], tmp_path: Path
) -> None:
    photographs = {"mean_recall": 0.5}
    told, written = quantized(tmp_path, model, [recording], rates=RATES, about={"photographs": photographs})
    assert told["rates_not_measured"] == "no recording comes with a map"
    assert told["rates"] == written["rates"] == {**RATES, "arithmetic": "float32"}
    assert written["about"]["photographs"] == {**photographs, "arithmetic": "float32"}
    shown = crowdfence("model", "check", tmp_path / "int8.onnx", columns=300).stdout
    assert "true positive 0.999 (0.99 to 1), " in shown
    assert "measured in floating point, not in eight bits" in shown
    (tmp_path / "int8.onnx").unlink()
    told, _ = quantized(tmp_path, model, labelled, rates={**RATES, "missions": 9})
    assert told["rates_not_measured"] == "they rest on 9 missions, --data has 2"
    assert told["rates"]["arithmetic"] == "float32"
    (tmp_path / "int8.onnx").unlink()
    assert quantized(tmp_path, model, [recording])[0]["rates"] is None


@pytest.mark.parametrize("name", ["crowdnet-s-int8.onnx", "crowdnet-s-wide-int8.onnx"])
def test_shipped_models_in_eight_bits_say_whose_rates_they_state(name: str) -> None:
    contract = Detector(MODELS / name).contract
    assert (contract.about or {})["arithmetic"] == "int8"
    assert (contract.rates or {})["arithmetic"] in ("int8", "float32")


def test_a_share_of_nothing_is_null_and_said(recording: Path, tmp_path: Path) -> None:
    """A model that calls nothing crowd: how much of it both call is no number, and NaN is no JSON."""
    model = write_convolutions(tmp_path / "float.onnx", bias=-50.0)
    (tmp_path / "c.json").write_text(json.dumps(contract()))
    given = ("model", "quantize", model, "--contract", tmp_path / "c.json", "--data", recording)
    assert "unknown: neither calls any" in crowdfence(*given, "-o", tmp_path / "a.onnx").stdout

    def refuse(constant: str) -> float:
        raise AssertionError(constant)

    told = crowdfence(*given, "-o", tmp_path / "b.onnx", "--json").stdout
    assert json.loads(told, parse_constant=refuse)["agreement"] is None


@pytest.mark.parametrize("labels", [False, True])
def test_pictures_that_cannot_be_read_are_told_and_not_counted(
    model: Path, recording: Path, tmp_path: Path, labels: bool
) -> None:
    """Of a recording, and of pictures with COCO annotations."""
    data = tmp_path / "data"
    if labels:
        data.mkdir()
        for number, frame in enumerate(open_recording(recording).frames[:6]):
            (data / f"{number}.png").write_bytes(frame.encoded_image())
        marked = [
            AnnotatedPicture(
                data / f"{number}.png", WIDTH, HEIGHT, np.empty((0, 4)), (rectangle(0, 0, 9, 9),)
            )
            for number in range(6)
        ]
        write_coco(marked, data / ANNOTATIONS)
        pictures = sorted(data.glob("*.png"))
    else:
        shutil.copytree(recording, data)
        pictures = sorted((data / "images").glob("img_*_0_*.png"), key=lambda path: path.stem.split("_")[-1])
    pictures[0].write_bytes(b"no picture")
    detector = Detector(model, contract())
    told = quantize_model(detector, model, [data], tmp_path / "int8.onnx", pictures=3)
    assert told.pictures == 2 and told.rates is None
    assert len(told.refused) == 1 and told.refused[0].startswith("data: ")
    for picture in pictures:
        picture.write_bytes(b"no picture")
    with pytest.raises(ValueError, match=r"none of 3 pictures can be read, the last: data: "):
        quantize_model(detector, model, [data], tmp_path / "int8.onnx", pictures=3)


def test_eight_bits_that_make_another_model_of_it_are_told(recording: Path, tmp_path: Path) -> None:
    """Steps that reach up to a channel which is a million times as strong as the others leave nothing of
    those; in floating point it is the same model."""
    told = {}
    for loud in (1.0, 1e6):
        source = write_convolutions(tmp_path / "float.onnx", bias=-0.2, loud=loud)
        detector = Detector(source, contract())
        told[loud] = quantize_model(detector, source, [recording], tmp_path / "int8.onnx", pictures=4)
    assert told[1.0].agreement > 0.9 and told[1.0].warnings == ()
    (warning,) = told[1e6].warnings
    assert told[1e6].agreement < 0.8
    assert warning.startswith("in eight bits it is another model: ") and "model evaluate" in warning


def test_pictures_of_several_sizes(model: Path, tmp_path: Path) -> None:
    """As photographs have them. Eight bits reach up to the brightest of those that tell the ranges, the first
    and the last, to within one of the runtime's 2048 bins on both sides of zero."""
    marked = []
    for level, width, height in ((90, 64, 48), (255, 32, 32), (180, 52, 100)):
        path = tmp_path / f"{len(marked)}.png"
        Image.new("RGB", (width, height), (level, level, level)).save(path)
        marked.append(AnnotatedPicture(path, width, height, np.empty((0, 4)), (rectangle(0, 0, 9, 9),)))
    write_coco(marked, tmp_path / ANNOTATIONS)
    told = quantize_model(Detector(model, contract()), model, [tmp_path], tmp_path / "int8.onnx", pictures=2)
    assert (told.pictures, told.refused) == (2, ())
    written, given = (onnx.load(path).graph.initializer for path in (tmp_path / "int8.onnx", model))
    step = next(float(numpy_helper.to_array(one)) for one in written if one.name == "b_scale")
    brightest = (numpy_helper.to_array(given[0]).sum(axis=(1, 2, 3)) * 180 / 255).max()
    assert step * 255 == pytest.approx(brightest, rel=2 / 2048)


def test_a_model_that_needs_metres_per_pixel(model: Path, recording: Path, tmp_path: Path) -> None:
    people = Detector(model, contract("density", output__count_scale=0.01))
    quantize_model(people, model, [recording], tmp_path / "int8.onnx", pictures=2)
    assert Detector(tmp_path / "int8.onnx").contract.output == people.contract.output


def test_layers_without_names(model: Path, recording: Path, tmp_path: Path) -> None:
    """Names are optional in ONNX: that of the first and the last layer, which stay, was that of all."""
    changed = onnx.load(model)
    for node in changed.graph.node:
        node.name = ""
    nameless, outputs = tmp_path / "nameless.onnx", [tmp_path / "a.onnx", tmp_path / "b.onnx"]
    onnx.save_model(changed, str(nameless))
    for source, output in zip((model, nameless), outputs, strict=True):
        quantize_model(Detector(source, contract()), source, [recording], output, pictures=4)
    operators, expected = ([node.op_type for node in onnx.load(path).graph.node] for path in outputs)
    assert operators == expected and operators.count("QuantizeLinear") == 2


def test_shipped_models_go_by_their_names(recording: Path, tmp_path: Path) -> None:
    """They did for all commands but this one and calibrate."""
    done = crowdfence("model", "quantize", "crowdnet-s", "--data", recording, "-o", tmp_path / "int8.onnx")
    assert done.returncode == 1 and "computes in eight bits already" in done.stderr


def test_what_cannot_be_quantized(model: Path, recording: Path, tmp_path: Path) -> None:
    flat = write_map_model(tmp_path / "flat.onnx", contract())
    old, short = tmp_path / "old.onnx", tmp_path / "short.onnx"
    changed = onnx.load(model)
    changed.opset_import[0].version = 12
    onnx.save_model(changed, str(old))
    changed = onnx.load(model)
    kept = [node for node in changed.graph.node if "middle" not in node.name]
    next(node for node in kept if node.name == "conv_last").input[0] = "b"
    del changed.graph.node[:]
    changed.graph.node.extend(kept)
    onnx.save_model(changed, str(short))
    for refused, message in (
        (flat, "no convolutions"),
        (MODELS / "crowdnet-s-int8.onnx", "computes in eight bits already: take the one in floating point"),
        (old, "operator set is 12; eight bits need 13 or newer: export it again"),
        (short, "between its first and its last convolution.* nothing that could compute in eight bits"),
    ):
        with pytest.raises(DetectorError, match=message):
            quantize_model(
                Detector(refused, contract()), refused, [recording], tmp_path / "int8.onnx", pictures=2
            )
        assert not (tmp_path / "int8.onnx").exists()
