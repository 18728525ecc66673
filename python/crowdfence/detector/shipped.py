"""The models that come with the package: a network in eight bits and as it was trained, and a second one."""

from os import PathLike
from pathlib import Path

from crowdfence.detector.execution_device import Device

SHIPPED_MODEL = "crowdnet-s"
"""What looks where nobody names a detector and the pictures look like those that it was tested on."""
PHOTOGRAPH_MODEL = "crowdnet-s-wide"
"""... and what looks where they do not (`pipeline.suitable_model`), and at pictures and films without poses:
most of them are a camera's, and of rendered ones shown without their poses it finds as much as the other
(training/README.md)."""
FILES = {
    SHIPPED_MODEL: "crowdnet-s-int8.onnx",
    "crowdnet-s-float32": "crowdnet-s.onnx",
    "crowdnet-s-wide": "crowdnet-s-wide-int8.onnx",
}
"""By the names that `Detector` and `--detector` take. In eight bits it is two and a half times as fast on a
CPU and finds the same crowds (training/README.md); as it was trained it can be trained further, and is what
looks by the first name on a GPU. The wide one, which is shown pictures vibrant, does better on photographs
and worse on far and loose crowds of rendered missions."""

_FASTER_ON_A_GPU = {SHIPPED_MODEL: "crowdnet-s-float32"}
"""The same networks in floating point: eight bits only cost a GPU time."""


def shipped_model(name: str = SHIPPED_MODEL, device: Device = "cpu") -> Path:
    """Path of a shipped model, as it suits the device. FileNotFoundError when this copy of the package lacks
    it."""
    if device != "cpu":
        name = _FASTER_ON_A_GPU.get(name, name)
    path = Path(__file__).parent / "models" / FILES[name]
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: the shipped model is missing; name a model, or install the package again"
        )
    return path


def model_path(model: str | PathLike[str] | None, device: Device = "cpu") -> Path:
    """A shipped model by its name, the default for None; any other model is its file. FileNotFoundError where
    there is none."""
    if model is None:
        return shipped_model(device=device)
    if str(model) in FILES:
        return shipped_model(str(model), device)
    path = Path(model)
    if not path.is_file():
        raise FileNotFoundError(
            f"{path} is no file: no model there; those that come along: {', '.join(FILES)}"
        )
    return path
