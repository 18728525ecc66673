"""`crowdfence calibrate`: make a model's probabilities and rates true on labelled missions."""

from __future__ import annotations

from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_file import replaceable_file
from crowdfence.cli import console, options
from crowdfence.cli.options import DEFAULT, PAPER
from crowdfence.cli.refusals import warn_of_data
from crowdfence.cli.wording import counted
from crowdfence.evaluation.text_table import aligned, interval, number

if TYPE_CHECKING:
    from crowdfence.calibration.calibrate import ModelCalibration
    from crowdfence.calibration.choice import Calibration
    from crowdfence.calibration.correction import LogitMap
    from crowdfence.evaluation.voxels.rates import VoxelRates


class TruthName(str, Enum):
    """Where the truth of voxels comes from."""

    auto = "auto"
    world = "world"
    labels = "labels"


def calibrate(
    model: Annotated[
        Path,
        typer.Argument(help="Model to calibrate (.onnx, or a shipped one's name), probability or logits."),
    ],
    data: Annotated[
        list[Path],
        typer.Option(
            "--data",
            help="Labelled recording that the model was not trained on, or a folder of missions; repeat.",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Calibrated model to write (.onnx).")],
    target: Annotated[
        options.LabelTarget | None,
        typer.Option(
            "--target", help="What the heatmap should mark. Default: the contract's, else silhouettes."
        ),
    ] = None,
    truth: Annotated[
        TruthName,
        typer.Option("--truth", help="Truth of voxels: where people stood (world), or the frame's label."),
    ] = TruthName.auto,
    every: options.EveryFrame = 1,
    b_threshold: options.BThreshold = PAPER.b_threshold,
    max_range_m: options.MaxRangeM = DEFAULT.projection.max_range_m,
    target_height_m: options.TargetHeightM = None,
    coverage: options.CoverageOption = options.Coverage.full,
    surface: options.SurfaceOption = options.Surface.planes,
    origin: options.Origin = None,
    assume_local: options.AssumeLocal = False,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Fit a model's probabilities to labelled missions and write the measured rates into it.

    Chooses between no change, a temperature, scale and bias, and a curve on missions held out; measures TPR,
    FPR and likelihood ratios per voxel observation, with 95 % intervals over missions. Needs the package onnx
    (`pip install crowdfence\\[train]`).
    """
    require_onnx()
    from crowdfence.calibration.calibrate import calibrate_model, plan_for
    from crowdfence.detector.detector import Detector
    from crowdfence.detector.shipped import model_path
    from crowdfence.evaluation.labelled_missions import MeasurementPlan, frames_looked_at

    chosen = {
        "target": None if target is None else target.value,
        "target_height_m": target_height_m,
    }
    given: dict[str, Any] = {name: value for name, value in chosen.items() if value is not None}
    plan = MeasurementPlan(
        max_range_m=max_range_m,
        coverage=coverage.value,
        surface=surface.value,
        b_threshold=b_threshold,
        truth=truth.value,
        every=every,
        terrain_options=options.terrain_options(origin=origin, assume_local=assume_local),
        **given,
    )
    model = model_path(model)
    detector = Detector(model)
    plan = plan_for(detector.contract, plan, **dict.fromkeys(given, True))
    with replaceable_file(output, force=force, reads=[model, *data]):
        paths = options.recordings_in(data)
        frames = frames_looked_at(paths, every)
        with console.progress("calibrating", 2 * frames, "frames") as advance:
            result = calibrate_model(detector, model, paths, output, plan, on_frame=advance)
    warn_of_data(result.warnings, result.refused)
    if as_json:
        console.print_json(_as_json(result))
    else:
        _print(result, output)


def require_onnx() -> None:
    """ValueError without the package, which is asked before minutes of work."""
    from importlib.util import find_spec

    if find_spec("onnx") is None:
        raise ValueError(
            "models are written with the package onnx: pip install 'crowdfence[train]', or onnx alone"
        )


def _as_json(result: ModelCalibration) -> dict[str, Any]:
    calibration, contract = result.calibration, result.contract.to_json()
    return {
        "contract": contract,
        "frames": result.frames,
        "missions": calibration.missions,
        "chosen": calibration.chosen.method,
        "before": calibration.before.to_json(),
        "candidates": {
            name: {
                "map": one.fitted.to_json(),
                "held_out_nll": [_number(value) for value in one.held_out_nll.tolist()],
                "held_out": None if one.held_out is None else one.held_out.to_json(),
            }
            for name, one in calibration.candidates.items()
        },
        "rates_before": None if result.rates_before is None else _rates_json(result.rates_before),
        "rates": None if result.rates is None else _rates_json(result.rates),
        "quality": result.quality.to_json(),
        "refused": list(result.refused),
        "warnings": list(result.warnings),
    }


def _rates_json(rates: VoxelRates) -> dict[str, Any]:
    return {"all": rates.rates.to_json(), "away_from_edges": rates.away_from_edges.to_json()}


def _number(value: float) -> float | None:
    return None if value != value else value


def _print(result: ModelCalibration, output: Path) -> None:
    from crowdfence.evaluation.quality_table import quality_text

    calibration, overall = result.calibration, result.quality.overall
    print(f"{output}: {calibration.chosen.method}, {_map_text(calibration.chosen)}")
    print(
        f"{counted(result.frames, 'frame')} of {counted(calibration.missions, 'mission')}; the heatmap marks "
        f"{result.plan.target}, projected at {result.plan.target_height_m:g} m above ground"
    )
    print(f"\nCorrections, on missions held out\n{_candidates_text(calibration)}")
    if result.rates is not None and result.rates_before is not None:
        print(f"\n{_rates_text(result.rates_before, result.rates)}")
    error = interval(overall.calibration_error_above)
    print(f"\nCalibrated heatmaps on the same missions (error above 0.05: {error})")
    print(quality_text(result.quality))


def _map_text(chosen: LogitMap) -> str:
    if not chosen.is_line:
        return f"{len(chosen.knots)} knots"
    bias = f", bias {chosen.bias:+.3f}" if chosen.bias else ""
    return f"temperature {1.0 / chosen.scale:.3f}{bias}"


def _candidates_text(calibration: Calibration) -> str:
    rows = [("", "NLL per cell", "ECE", "ECE > 0.05", "Brier")]
    for name, one in calibration.candidates.items():
        label = f"{name} (chosen)" if name == calibration.chosen.method else name
        quality = calibration.before if name == "none" else one.held_out
        errors = ("-", "-", "-")
        if quality is not None:
            errors = (
                interval(quality.calibration_error, 4),
                interval(quality.calibration_error_above),
                interval(quality.brier, 4),
            )
        rows.append((label, number(float(one.held_out_nll.mean()), 5), *errors))
    return aligned(rows)


def _rates_text(before: VoxelRates, after: VoxelRates) -> str:
    rows = [(f"Per voxel observation, m > {after.b_threshold:g}", "TPR", "FPR")]
    for label, pair in (
        ("before", before.rates),
        ("after", after.rates),
        ("after, away from edges", after.away_from_edges),
    ):
        rows.append((label, interval(pair.true_positive), interval(pair.false_positive, 4)))
    table = after.likelihood_ratio
    for name, edges, pairs in (
        ("distance_m", table.distance_m, after.by_distance),
        ("tilt_deg", table.tilt_deg, after.by_tilt),
    ):
        for low, high, pair in zip(edges[:-1], edges[1:], pairs, strict=True):
            label = f"  {name} {low:g} to {high:g}"
            rows.append((label, interval(pair.true_positive), interval(pair.false_positive, 4)))
    ranges = ", ".join(f"{name} {span[0]:g} to {span[1]:g}" for name, span in after.validity.items() if span)
    return (
        f"{aligned(rows)}\n{after.crowd_observations} observations of crowd voxels, "
        f"{after.empty_observations} of others; 98 % of the crowd: {ranges}"
    )
