"""Try a model: load it, find its contract, run one picture, time it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.detector import AnyContract, Detector
from crowdfence.detector.execution_device import Device
from crowdfence.detector.same_answer import SameAnswer
from crowdfence.detector.validity import height_warning, shrunk_warning, silence_warning
from crowdfence.errors import DetectorError

ASSUMED_GSD_M = 0.1
"""For kinds that need metres per pixel, when the picture comes without."""
TEST_FRAME_SIZE = (640, 480)

_DEMO_RECORDING = Path(__file__).parent.parent / "demo_data" / "race.mcap"
_WARM_UPS, _RUNS, _LONGEST_S = 3, 50, 10.0


@dataclass(frozen=True, slots=True, eq=False)
class ModelCheck:
    """What came out. Arrays are as `Detector` takes and gives them."""

    path: Path
    contract: Contract
    contract_source: str
    image: NDArray[np.uint8]
    image_source: str
    gsd_m: float | None
    """Metres per pixel that were used; None: the model does without."""
    heatmap: NDArray[np.float32]
    latency_ms_p50: float
    latency_ms_p95: float
    runs: int

    @property
    def warnings(self) -> list[str]:
        """What is doubtful about the heatmap, the size of the picture, the stated height and rates, one
        sentence each."""
        answer = SameAnswer(self.contract)
        answer.add(self.heatmap)
        height, width = self.image.shape[:2]
        shrunk = shrunk_warning(self.contract, width, height)
        stated = (height_warning(self.contract), silence_warning(self.contract))
        return [warning for warning in (answer.warning, shrunk, *stated) if warning]

    def to_json(self) -> dict[str, Any]:
        """Everything but the pixels."""
        return {
            "model": str(self.path),
            "contract_source": self.contract_source,
            "contract": self.contract.to_json(),
            "image": {"source": self.image_source, "size": [self.image.shape[1], self.image.shape[0]]},
            "gsd_m": self.gsd_m,
            "heatmap": {
                "size": [self.heatmap.shape[1], self.heatmap.shape[0]],
                "lowest": float(self.heatmap.min()),
                "highest": float(self.heatmap.max()),
                "share_above_half": float((self.heatmap > 0.5).mean()),
            },
            "latency_ms": {"p50": self.latency_ms_p50, "p95": self.latency_ms_p95, "runs": self.runs},
            "warnings": self.warnings,
        }


def check_model(
    model: Path,
    contract: AnyContract | None = None,
    image: Path | None = None,
    gsd_m: float | None = None,
    threads: int = 1,
    device: Device = "cpu",
) -> ModelCheck:
    """Run a model on `image`, or on a frame of the bundled recording at 640 x 480.

    DetectorError or ValueError when model, contract or output cannot be used; OSError for unreadable files.
    """
    detector = Detector(model, contract, threads=threads, device=device)
    pixels, source = (read_picture(image), str(image)) if image else _test_frame(detector.contract)
    scale = gsd_m if detector.uses_gsd else None
    if scale is None and detector.needs_gsd:
        scale = ASSUMED_GSD_M
    heatmap = detector(pixels, scale)
    seconds = _timed(detector, pixels, scale)
    p50, p95 = (float(value) for value in np.percentile(np.array(seconds) * 1e3, (50, 95)))
    return ModelCheck(
        model,
        detector.contract,
        detector.contract_source,
        pixels,
        source,
        scale,
        heatmap,
        p50,
        p95,
        len(seconds),
    )


def read_picture(path: Path) -> NDArray[np.uint8]:
    """Picture file -> uint8 [H, W, 3] RGB, turned as its EXIF data say. OSError names the file."""
    from crowdfence.sources.pictures.decoding import read_rgb

    try:
        return read_rgb(path)
    except FileNotFoundError:
        raise
    except (OSError, ValueError) as error:
        raise OSError(f"{path} cannot be read as a picture: {error}") from None


def _test_frame(contract: Contract) -> tuple[NDArray[np.uint8], str]:
    """A frame with a crowd in it, at the size that the model takes if it takes one only."""
    from PIL import Image

    from crowdfence.sources import open_recording

    frames = [frame for frame in open_recording(_DEMO_RECORDING).frames if frame.pixels.image]
    if not frames:
        raise DetectorError(f"{_DEMO_RECORDING} holds no picture to try the model on: name one")
    fixed_size = contract.input.size if contract.input.resize == "none" else None
    picture = Image.fromarray(frames[len(frames) // 2].image())
    resized = picture.resize(fixed_size or TEST_FRAME_SIZE, Image.Resampling.BICUBIC)
    return np.array(resized), "a frame of the bundled recording, resized"


def _timed(detector: Detector, image: NDArray[np.uint8], gsd_m: float | None) -> list[float]:
    """Seconds of each run: up to 50, fewer when they would take longer than 10 s."""
    seconds: list[float] = []
    started = perf_counter()
    for run in range(_WARM_UPS + _RUNS):
        before = perf_counter()
        detector(image, gsd_m)
        after = perf_counter()
        if run >= _WARM_UPS or after - started > _LONGEST_S:
            seconds.append(after - before)
        if after - started > _LONGEST_S:
            break
    return seconds
