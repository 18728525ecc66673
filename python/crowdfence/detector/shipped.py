"""The models that come with the package: one network, in eight bits and as it was trained."""

from pathlib import Path

SHIPPED_MODEL = "crowdnet-s"
FILES = {SHIPPED_MODEL: "crowdnet-s-int8.onnx", "crowdnet-s-float32": "crowdnet-s.onnx"}
"""By the names that `--detector` takes. In eight bits it is two and a half times as fast on a CPU and finds
the same crowds (training/README.md); as it was trained it can be trained further, and suits a GPU."""


def shipped_model(name: str = SHIPPED_MODEL) -> Path:
    """Path of a shipped model. FileNotFoundError when this copy of the package lacks it."""
    path = Path(__file__).parent / "models" / FILES[name]
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: the shipped model is missing; name a model, or install the package again"
        )
    return path
