"""The model that comes with the package."""

from pathlib import Path

SHIPPED_MODEL = "crowdnet-s"


def shipped_model() -> Path:
    """Path of the shipped model. FileNotFoundError when this copy of the package lacks it."""
    path = Path(__file__).parent / "models" / f"{SHIPPED_MODEL}.onnx"
    if not path.is_file():
        raise FileNotFoundError(
            f"{path}: the shipped model is missing; name a model, or install the package again"
        )
    return path
