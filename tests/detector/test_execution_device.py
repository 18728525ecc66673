"""Models on a GPU: nobody gets a processor in its place without a word, and heatmaps are the same."""

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest

import crowdfence as package
from crowdfence import Detector
from crowdfence.detector import execution_device
from crowdfence.detector.inference.picture_parts import near_parts, parts_by_gsd
from crowdfence.detector.onnx_session import reason
from crowdfence.detector.session_per_shape import SessionPerShape
from crowdfence.detector.shipped import SHIPPED_MODEL, shipped_model
from crowdfence.errors import DetectorError
from crowdfence.pipeline import describe_model
from crowdfence.sources import open_recording
from support.command_line import crowdfence

DEMO = Path(package.__file__).parent / "demo_data" / "race.mcap"


def cuda_is_usable() -> bool:
    try:
        execution_device.providers("cuda")
    except DetectorError:
        return False
    return True


on_a_gpu = pytest.mark.skipif(not cuda_is_usable(), reason="no GPU, or no ONNX Runtime for one")
"""They ran on an H200; figures: benchmarks/README.md."""


def test_a_device_of_another_name_is_refused() -> None:
    with pytest.raises(ValueError, match="device is 'tpu'; allowed: cpu, cuda"):
        Detector(device="tpu")  # type: ignore[arg-type]


def test_an_onnx_runtime_for_processors_says_which_one_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CPUExecutionProvider"])
    with pytest.raises(DetectorError, match=r"for processors alone; .* 'onnxruntime-gpu\[cuda,cudnn\]'"):
        Detector(device="cuda")


def test_a_machine_without_a_driver_is_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider"])
    monkeypatch.setattr(execution_device, "_DRIVER", "libcuda-that-nobody-has.so.1")
    with pytest.raises(
        DetectorError, match="no driver of an NVIDIA GPU on this machine: libcuda-that-nobody"
    ):
        Detector(device="cuda")


def test_a_library_of_cuda_that_is_missing_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """In ONNX Runtime's own words, which it prints."""

    def preload() -> None:
        print("Failed to load libcublas.so.13: libcublas.so.13: cannot open shared object file")
        print("Please follow the instructions")

    monkeypatch.setattr(onnxruntime, "get_available_providers", lambda: ["CUDAExecutionProvider"])
    monkeypatch.setattr(onnxruntime, "preload_dlls", preload)
    monkeypatch.setattr(execution_device, "_DRIVER", None)  # what this process has loaded already
    with pytest.raises(DetectorError, match=r"Failed to load libcublas\.so\.13: .*; pip uninstall"):
        Detector(device="cuda")


@pytest.mark.skipif(
    "CUDAExecutionProvider" in onnxruntime.get_available_providers(), reason="it would not fall back"
)
def test_a_session_that_fell_back_to_the_processor_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(execution_device, "_require_cuda", lambda: None)
    with warnings.catch_warnings(), pytest.raises(DetectorError, match="would use CPUExecutionProvider"):
        warnings.simplefilter("ignore")  # ONNX Runtime says so and goes on
        Detector(device="cuda")


@pytest.mark.skipif(cuda_is_usable(), reason="there is one")
def test_the_command_fails_with_one_line_where_there_is_no_gpu() -> None:
    result = crowdfence("model", "check", "--device", "cuda")
    assert result.returncode == 1
    assert result.stdout == ""
    assert result.stderr.startswith("error: device cuda: ") and result.stderr.count("\n") == 1


def test_a_gpu_looks_with_the_network_in_floating_point() -> None:
    assert shipped_model(SHIPPED_MODEL, "cpu").name == "crowdnet-s-int8.onnx"
    assert shipped_model(SHIPPED_MODEL, "cuda").name == "crowdnet-s.onnx"


def test_a_summary_tells_a_device_that_is_no_processor() -> None:
    detector = Detector()
    assert detector.device == "cpu"
    assert "device" not in describe_model(detector.contract, detector.path, device="cpu")
    assert describe_model(detector.contract, detector.path, device="cuda")["device"] == "cuda"


def test_what_a_gpu_says_of_itself_is_told_without_its_source_lines() -> None:
    """As CUDA and ONNX Runtime 1.31 said it on a machine whose GPU was hidden."""
    error = RuntimeError(
        "[ONNXRuntimeError] : 1 : FAIL : /onnxruntime_src/core/providers/cuda/cuda_call.cc:146 void "
        "onnxruntime::CudaCall(ERRTYPE) [with ERRTYPE = cudaError; bool THRW = true] CUDA failure 100: no "
        "CUDA-capable device is detected ; GPU=-1 ; hostname=one ; file=cuda.cc ; line=312 ; expr=x();"
    )
    assert reason(error) == "CUDA failure 100: no CUDA-capable device is detected"


@pytest.fixture
def as_on_a_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    """All that is done for a GPU, on a processor."""
    monkeypatch.setattr(execution_device, "_require_cuda", lambda: None)
    on_cpu = execution_device._PROVIDERS["cpu"]
    monkeypatch.setattr(execution_device, "_PROVIDERS", {"cpu": on_cpu, "cuda": on_cpu})


@pytest.mark.usefixtures("as_on_a_gpu")
def test_a_model_that_is_replaced_while_it_looks_stays_what_it_was(tmp_path: Path) -> None:
    """A session for another shape is opened when a picture has it."""
    model = tmp_path / "model.onnx"
    model.write_bytes(shipped_model("crowdnet-s-float32").read_bytes())
    image = open_recording(DEMO).frames[0].image()
    expected = [Detector("crowdnet-s-float32")(one, as_it_is=True) for one in (image, image[:120])]
    detector = Detector(model, device="cuda")
    np.testing.assert_array_equal(detector(image, as_it_is=True), expected[0])
    model.write_bytes(b"no model")
    np.testing.assert_array_equal(detector(image[:120], as_it_is=True), expected[1])


@pytest.mark.usefixtures("as_on_a_gpu")
def test_what_is_affordable_on_a_gpu_is_all() -> None:
    """The looks again at what is suspicious would each have a shape of their own."""
    image = open_recording(DEMO).frames[0].image()
    gsd_m = np.linspace(0.6, 0.1, 12, dtype=np.float32)[:, None]
    affordable, always = (Detector(device="cuda", enlarge=one) for one in ("affordable", "always"))
    np.testing.assert_array_equal(affordable(image, gsd_m), always(image, gsd_m))
    assert affordable.coarsest_gsd_m == always.coarsest_gsd_m


@pytest.mark.usefixtures("as_on_a_gpu")
def test_weights_in_a_file_beside_the_model_are_found(tmp_path: Path) -> None:
    parts = onnx.load(shipped_model("crowdnet-s-float32"))
    onnx.save_model(parts, tmp_path / "model.onnx", save_as_external_data=True, location="weights.bin")
    assert (tmp_path / "weights.bin").stat().st_size > 2e6
    image = open_recording(DEMO).frames[0].image()
    expected = Detector("crowdnet-s-float32")(image, 0.1)
    np.testing.assert_array_equal(Detector(tmp_path / "model.onnx", device="cuda")(image, 0.1), expected)


def test_every_shape_of_a_picture_has_a_session_of_its_own_and_the_latest_are_kept() -> None:
    opened: list[list[tuple[int, ...]]] = []

    class Session:
        def __init__(self) -> None:
            self.seen: list[tuple[int, ...]] = []
            opened.append(self.seen)

        def run(self, outputs: Any, inputs: Any, options: Any) -> list[Any]:
            self.seen.append(inputs["image"].shape)
            return []

    sessions = SessionPerShape(Session)
    shapes = [(side, 4) for side in range(1, 9)]
    for shape in [*shapes, *shapes]:
        sessions.run(["heatmap"], {"image": np.zeros(shape)}, None)  # type: ignore[arg-type]
    assert opened == [[shape, shape] for shape in shapes]  # eight fit
    for shape in [(1, 4), (9, 4), (1, 4), (2, 4)]:  # the ninth takes the place of (2, 4), the oldest
        sessions.run(["heatmap"], {"image": np.zeros(shape)}, None)  # type: ignore[arg-type]
    assert opened[8:] == [[(9, 4)], [(2, 4)]]
    assert opened[0] == [(1, 4)] * 4


def test_a_gpu_is_shown_whole_pictures_at_every_size() -> None:
    """So that those of a camera have few shapes: near ground below, far ground above, sky over it."""
    gsd_m = np.array([[np.nan] * 4, [0.4] * 4, [0.1] * 4, [0.02] * 4], np.float32)
    image = np.zeros((480, 640, 3), np.uint8)
    parts = parts_by_gsd(gsd_m, (0.05, 0.3), image, 4, "always", whole=True)
    assert [part.shown(image).shape[:2] for part in parts] == [(120, 160), (480, 640), (960, 1280)]
    owners = sum(part.own.astype(int) for part in parts if part.own is not None)
    assert (owners == 1).all()
    near_ground, ground, far_ground = (part.own for part in parts)
    assert near_ground is not None and near_ground[100].all() and not near_ground[70].any()
    assert ground is not None and ground[70].all()
    assert far_ground is not None and far_ground[40].all()
    near, far = near_parts(gsd_m, (0.05, 0.3), image, 4, whole=True)
    assert [part.size for part in near] == [0.25, 1.0] and far[40].all() and not far[70].any()


@on_a_gpu
def test_heatmaps_are_those_of_the_processor() -> None:
    """Other sums of the same products; whole pictures, of which both are shown the same pixels."""
    on_cpu, on_gpu = Detector("crowdnet-s-float32"), Detector(device="cuda")
    for image in various_pictures():
        assert 0.0 < np.abs(on_cpu(image, 0.1) - on_gpu(image, 0.1)).max() < 1e-5


@on_a_gpu
def test_a_model_in_eight_bits_finds_the_same_crowds() -> None:
    """Steps between its layers are taken a little earlier or later."""
    on_cpu, on_gpu = Detector("crowdnet-s-wide"), Detector("crowdnet-s-wide", device="cuda")
    called = [(on_cpu(image, 0.1) >= 0.5, on_gpu(image, 0.1) >= 0.5) for image in various_pictures()]
    both, either = (sum(int(join(*one).sum()) for one in called) for join in (np.logical_and, np.logical_or))
    assert both > 0.95 * either > 100


def various_pictures() -> list[Any]:
    frames = open_recording(DEMO).frames
    images = [frame.image() for frame in frames[:: len(frames) // 8]]
    return [
        cut for image in images for cut in (image, image[:231, 57:], np.ascontiguousarray(image[::2, ::2]))
    ]
