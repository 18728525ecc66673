"""A flight against what a detector states about itself: where it was tested, its rates, its calibration.

A detector that flies higher, or looks flatter, than it was tested sees crowds that nobody has measured it on.
Nothing is refused for that: a warning states the share of the ground that it concerns.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.ground_sampling import GroundSampling, ground_sampling
from crowdfence.sources.recording import Frame

MOST_FRAMES = 120
"""Frames that are looked at, evenly over the flight."""
TOLERATED_SHARE = 0.01
"""This share of the ground may lie outside without a warning."""
QUANTILES = (0.05, 0.5, 0.95)
MOST_VOXEL_RATIO = 1.5
MOST_SHRUNK = 0.5
"""Pictures that a model is shown at less than this share of their width or height are worth a warning."""
HIGHEST_PEOPLE_M = 3.0
"""Nothing of people who stand on the ground is higher."""

Quantity = Literal["gsd_m", "distance_m", "tilt_deg"]
_NAMES: dict[Quantity, tuple[str, str]] = {
    "gsd_m": ("metres per pixel", "m"),
    "distance_m": ("distance", "m"),
    "tilt_deg": ("tilt below the horizon", "deg"),
}


@dataclass(frozen=True, slots=True, eq=False)
class FlightSample:
    """Rays of a flight that hit the ground; arrays [N], every ray stands for the same share of an image."""

    gsd_m: NDArray[np.float64]
    distance_m: NDArray[np.float64]
    tilt_deg: NDArray[np.float64]

    @classmethod
    def of(cls, looks: Sequence[GroundSampling]) -> FlightSample:
        """All rays of them that hit the ground."""

        def seen(quantity: Quantity) -> NDArray[np.float64]:
            values = np.concatenate([np.empty(0), *(getattr(look, quantity).ravel() for look in looks)])
            return values[np.isfinite(values)]

        return cls(seen("gsd_m"), seen("distance_m"), seen("tilt_deg"))


@dataclass(frozen=True, slots=True)
class RangeCheck:
    """One quantity of a flight beside the range that the detector was tested in."""

    quantity: Quantity
    tested: tuple[float, float] | None
    """None: the contract does not say."""
    quantiles: tuple[float, float, float]
    """Of the flight, at `QUANTILES`."""
    share_below: float
    """Share of the ground seen that lies below the tested range, 0 when there is none."""
    share_above: float

    def to_json(self) -> dict[str, Any]:
        return {
            "tested": None if self.tested is None else list(self.tested),
            "flight_quantiles": {
                f"{quantile:g}": value for quantile, value in zip(QUANTILES, self.quantiles, strict=True)
            },
            "share_below": self.share_below,
            "share_above": self.share_above,
        }

    def warnings(
        self, name: str, *, of: str = "this flight", tolerated: float = TOLERATED_SHARE
    ) -> list[str]:
        """One sentence for each side on which more than a tolerated share of the ground lies outside."""
        if self.tested is None:
            return []
        what, unit = _NAMES[self.quantity]
        low, middle, high = self.quantiles
        flight = f"the middle 90 % of {of}: {low:.3g} to {high:.3g} {unit}, median {middle:.3g}"
        sides = (
            (self.share_below, "below", self.tested[0]),
            (self.share_above, "above", self.tested[1]),
        )
        return [
            f"{what}: {_percent(share)} of the ground seen lies {side} {bound:.3g} {unit}, where the "
            f"detector {name} was not tested ({flight})"
            for share, side, bound in sides
            if share > tolerated
        ]


def sample_flight(frames: Sequence[Frame], terrain: Terrain, *, max_range_m: float) -> FlightSample:
    """Rays from up to `MOST_FRAMES` frames, evenly over the sequence."""
    chosen = np.unique(np.linspace(0, len(frames) - 1, min(MOST_FRAMES, len(frames))).round().astype(int))
    return FlightSample.of(
        [
            ground_sampling(
                frames[index].camera, frames[index].world_from_camera, terrain, max_range_m=max_range_m
            )
            for index in chosen
        ]
    )


def check_ranges(contract: Contract, flight: FlightSample) -> list[RangeCheck]:
    """GSD, distance and tilt of the flight beside the tested ranges; empty when the flight sees no ground."""
    if flight.gsd_m.size == 0:
        return []
    checks = []
    for quantity in _NAMES:
        values: NDArray[np.float64] = getattr(flight, quantity)
        tested = tested_range(contract, quantity)
        low, high = (-np.inf, np.inf) if tested is None else tested
        p05, p50, p95 = (float(value) for value in np.quantile(values, QUANTILES))
        checks.append(
            RangeCheck(
                quantity, tested, (p05, p50, p95), float(np.mean(values < low)), float(np.mean(values > high))
            )
        )
    return checks


def tested_range(contract: Contract, quantity: Quantity) -> tuple[float, float] | None:
    """Where the detector was tested, behind the cameras of its calibration or finer ones; None where its
    contract does not say."""
    tested = None if contract.validity is None else getattr(contract.validity, quantity)
    finer = None if contract.finer_cameras is None else getattr(contract.finer_cameras.validity, quantity)
    if tested is None or finer is None:
        return tested
    return min(tested[0], finer[0]), max(tested[1], finer[1])


def statement_warnings(
    contract: Contract,
    *,
    voxel_size_m: float,
    b_threshold: float,
    coverage: str,
    surface: str,
    rates_given: bool,
    weighed_as: str | None = None,
) -> list[str]:
    """What the contract leaves open, and rates that were measured in another setting than this run's.

    `rates_given`: the run has rates of its own, so those of the contract do not matter. `weighed_as`: for a
    method that goes by likelihood ratios, whose count where the contract states none.
    """
    name = contract.name
    warnings = []
    if contract.calibration is None:
        warnings.append(f"the detector {name} states no calibration: 0.7 need not mean 70 percent")
    if contract.validity is None:
        warnings.append(f"the detector {name} does not state at which metres per pixel it was tested")
    if rates_given:
        return warnings
    rates = contract.rates or {}
    if weighed_as is not None and "likelihood_ratio" not in rates:
        warnings.append(
            f"the detector {name} states no likelihood ratios per voxel observation: what it says is taken "
            f"to be as sure as {weighed_as}; `crowdfence calibrate` measures its own"
        )
        return warnings
    if weighed_as is None and ("true_positive" not in rates or "false_positive" not in rates):
        warnings.append(
            f"the detector {name} states no rates per voxel observation: the run uses its defaults; "
            "measure yours or give --tpr and --fpr"
        )
        return warnings
    differences = []
    measured_m = rates.get("voxel_size_m")
    if isinstance(measured_m, (int, float)) and measured_m > 0:
        ratio = voxel_size_m / measured_m
        if max(ratio, 1 / ratio) > MOST_VOXEL_RATIO:
            differences.append((f"voxels of {measured_m:g} m", f"voxels of {voxel_size_m:g} m"))
    if (rates.get("arithmetic"), (contract.about or {}).get("arithmetic")) == ("float32", "int8"):
        differences.append(("the model in floating point", "it in eight bits"))
    # Rates that name no surface are from before there was another one than the voxels.
    for key, used, unnamed in (
        ("b_threshold", b_threshold, b_threshold),
        ("coverage", coverage, coverage),
        ("surface", surface, "voxels"),
    ):
        stated = rates.get(key, unnamed)
        if stated != used:
            differences.append((f"{key} {stated}", f"{key} {used}"))
    if differences:
        measured, here = (", ".join(settings) for settings in zip(*differences, strict=True))
        warnings.append(f"the rates of {name} were measured with {measured}; this run has {here}")
    if weighed_as is not None and (silent := silence_warning(contract)):
        warnings.append(silent)
    return warnings


def shrunk_warning(contract: Contract, width: int, height: int, gsd_m: float | None = None) -> str | None:
    """One sentence where pictures of `width` x `height` pixels are shrunk to the one size that a model takes:
    people whom it would find at theirs are nobody then, and their ground is called empty. `gsd_m`: metres per
    pixel that half of the ground in these pictures has at most."""
    across, down = _shown_at(contract, width, height)
    if min(across, down) >= MOST_SHRUNK:
        return None
    ground = (
        "" if gsd_m is None else f", half of the ground at {gsd_m / min(across, down):.2g} m a pixel or more"
    )
    return (
        f"the detector {contract.name} is shown pictures of {width} x {height} pixels shrunk to "
        f"{round(width * across)} x {round(height * down)}{ground}: where people are too small for it then, "
        "ground is called empty; input.resize 'tile' of its contract shows it pixels as they are"
    )


def shrunk_warnings(
    contracts: Sequence[Contract], sizes: Collection[tuple[int, int]], gsd_m: float | None = None
) -> list[str]:
    """The same of several models that look together at pictures of these sizes: each of those that it is
    shown smallest, which need not be the largest ones."""
    told = (
        shrunk_warning(contract, *min(sizes, key=lambda size: min(_shown_at(contract, *size))), gsd_m)
        for contract in contracts
    )
    return [text for text in told if text is not None]


def _shown_at(contract: Contract, width: int, height: int) -> tuple[float, float]:
    """Pixels that a model sees for one of a picture, across and down."""
    resize, size = contract.input.resize, contract.input.size
    if size is None or resize not in ("stretch", "letterbox"):
        return 1.0, 1.0
    across, down = size[0] / width, size[1] / height
    return (across, down) if resize == "stretch" else (min(across, down), min(across, down))


def silence_warning(contract: Contract) -> str | None:
    """One sentence where, by what the contract states, no look can ever speak for crowd: whatever the model
    sees, nothing would be closed. That is what a calibration on data whose crowds lie elsewhere than their
    labels writes. A table that cannot be read is left to the method to refuse."""
    rates = contract.rates or {}
    statement = f"by the rates of {contract.name} no look speaks for crowd, whatever it shows"
    advice = "nothing would be closed; calibrate it again on missions whose labels fit"
    try:
        ratios = np.asarray(rates["likelihood_ratio"]["log10_ratio"], np.float64)
        if ratios.size and not (ratios > 0.0).any():
            return f"{statement} (largest likelihood ratio {10.0 ** ratios.max():.2g}): {advice}"
    except (KeyError, TypeError, ValueError):
        pass
    found, false = (rates.get(name) for name in ("true_positive", "false_positive"))
    if found and false and found["rate"] <= false["rate"]:
        return f"{statement} (TPR {found['rate']:g}, FPR {false['rate']:g}): {advice}"
    return None


def height_warning(contract: Contract) -> str | None:
    """One sentence where a contract puts what the heatmap marks higher above the ground than people reach, as
    their height in centimetres: crowds would lie as much too near to the drones as it is too high."""
    height_m = contract.target_height_m
    if height_m is None or height_m <= HIGHEST_PEOPLE_M:
        return None
    return (
        f"the contract of {contract.name} says that its heatmap marks what is {height_m:g} m above the "
        f"ground (target_height_m): no people are, and seen at 45 degrees a crowd is put {height_m:g} m "
        "nearer to the drone than it stands; is it in metres?"
    )


def _percent(share: float) -> str:
    return f"{share:.0%}" if share >= 0.1 else f"{share:.1%}"
