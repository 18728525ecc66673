"""`crowdfence model`: what a detector model is, and whether it can be used."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray

from crowdfence.atomic_file import atomic_path, replaceable_file
from crowdfence.cli import console, options
from crowdfence.cli.calibrate import require_onnx
from crowdfence.cli.refusals import warn_of_data
from crowdfence.cli.unused_options import refuse_unused
from crowdfence.cli.wording import counted

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract, Validity
    from crowdfence.detector.model_check import ModelCheck
    from crowdfence.evaluation.model_quality import ModelQuality

app = typer.Typer(help="Detector models: check one, and measure it, before it flies.", no_args_is_help=True)


@app.callback()
def _group() -> None:
    pass


@app.command("check")
def check(
    model: Annotated[
        Path | None, typer.Argument(help="ONNX model. Default: the shipped one.", show_default=False)
    ] = None,
    image: Annotated[
        Path | None,
        typer.Option("--image", help="Picture to try. Default: a frame of the bundled recording."),
    ] = None,
    contract: Annotated[
        Path | None, typer.Option("--contract", help="Contract (.json) instead of the model's own.")
    ] = None,
    gsd_m: Annotated[
        float | None,
        typer.Option(
            "--gsd-m",
            min=1e-6,
            max=1e3,
            help="Metres per pixel of the picture. Default: 0.1 for density, points and boxes, else unknown.",
        ),
    ] = None,
    threads: Annotated[int, typer.Option("--threads", min=1, max=1024, help="Threads of the model.")] = 1,
    device: options.DeviceOption = options.DeviceChoice.cpu,
    overlay: Annotated[
        Path | None, typer.Option("--overlay", help="Write the picture with its heatmap (.png).")
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Run a model on one picture: its contract, its heatmap, its latency.

    Fails with one line when the model cannot be loaded, its contract is missing or ambiguous, or its output
    is NaN, out of range or of another shape.
    """
    from crowdfence.detector.model_check import check_model
    from crowdfence.detector.shipped import model_path

    _require_png("--overlay", overlay)
    with ExitStack() as stack:
        if overlay is not None:
            stack.enter_context(replaceable_file(overlay, force=force, reads=[image]))
        tell = stack.enter_context(console.working())
        tell("running the model")
        report = check_model(model_path(model, device.value), contract, image, gsd_m, threads, device.value)
        if overlay is not None:
            _write_overlay(overlay, report)
    for warning in report.warnings:
        console.warn(warning)
    if as_json:
        console.print_json(report.to_json())
        return
    out = console.stdout()
    out.print(
        console.facts(f"{report.path}: usable", _contract_facts(report.contract, report.contract_source))
    )
    out.print()
    out.print(console.facts("On one picture", _run_facts(report)))
    if overlay is not None:
        out.print(console.facts("", {"overlay": str(overlay)}))


@app.command("evaluate")
def evaluate(
    context: typer.Context,
    data: Annotated[
        list[Path],
        typer.Option(
            "--data",
            help="Labelled recording that the model was not trained on, a folder of missions, or one of "
            "pictures with COCO annotations; repeat.",
        ),
    ],
    models: Annotated[
        list[str] | None,
        typer.Argument(
            help="ONNX model, or several to combine. Default, of the shipped ones: crowdnet-s, and for "
            "pictures alone crowdnet-s-wide.",
            show_default=False,
        ),
    ] = None,
    contract: Annotated[
        Path | None, typer.Option("--contract", help="Contract (.json) instead of the model's own.")
    ] = None,
    enlarge: options.EnlargeOption = options.EnlargeChoice.always,
    device: options.DeviceOption = options.DeviceChoice.cpu,
    target: Annotated[
        options.LabelTarget | None,
        typer.Option(
            "--target", help="What the heatmap should mark. Default: the contract's, else silhouettes."
        ),
    ] = None,
    target_height_m: options.TargetHeightM = None,
    max_range_m: options.MaxRangeM = options.DEFAULT.projection.max_range_m,
    every: options.EveryFrame = 1,
    origin: options.Origin = None,
    assume_local: options.AssumeLocal = False,
    examples: Annotated[
        Path | None, typer.Option("--examples", help="Write a page of example pictures (.png).")
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Measure a model on labelled missions: IoU, rates, calibration, by distance, tilt and mission.

    Intervals are 95 %, over missions. The page of examples shows the frame with most crowd and the one with
    most errors of every mission: heatmap in magenta, truth outlined in cyan.
    """
    from crowdfence.calibration.calibrate import plan_for
    from crowdfence.detector.combination import combination_warnings
    from crowdfence.detector.shipped import PHOTOGRAPH_MODEL, SHIPPED_MODEL
    from crowdfence.evaluation.labelled_missions import MeasurementPlan, frames_looked_at
    from crowdfence.evaluation.model_quality import model_quality
    from crowdfence.labelled_pictures.picture_recording import is_labelled_pictures
    from crowdfence.pipeline import named_detector

    _require_png("--examples", examples)
    paths = options.recordings_in(data)
    only_pictures = all(map(is_labelled_pictures, paths))
    if only_pictures:
        refuse_unused(context, _OF_MISSIONS, "for annotated pictures, which have neither poses nor a map")
    default = PHOTOGRAPH_MODEL if only_pictures else SHIPPED_MODEL
    detector = named_detector(
        models or [default], contract=contract, device=device.value, enlarge=enlarge.value
    )
    for warning in combination_warnings(detector.contract):
        console.warn(warning)
    map_options = options.terrain_options(origin=origin, assume_local=assume_local)
    plan = MeasurementPlan(max_range_m=max_range_m, every=every, terrain_options=map_options)
    given: dict[str, Any] = {} if target is None else {"target": target.value}
    if target_height_m is not None:
        given["target_height_m"] = target_height_m
    plan = plan_for(detector.contract, replace(plan, **given), **dict.fromkeys(given, True))
    with ExitStack() as stack:
        if examples is not None:
            stack.enter_context(replaceable_file(examples, force=force, reads=data))
        frames = frames_looked_at(paths, every)
        advance = stack.enter_context(console.progress("evaluating", frames, "frames"))
        result = model_quality(detector, paths, plan, on_frame=advance)
        if examples is not None:
            _write_picture(examples, result.examples)
    warn_of_data(result.warnings, result.refused)
    if as_json:
        console.print_json({"contract": detector.contract.name, **result.to_json()})
    else:
        _print_quality(detector.contract, result)


@app.command("quantize")
def quantize(
    model: Annotated[
        Path, typer.Argument(help="Model (.onnx, or a shipped one's name) to bring to eight bits.")
    ],
    data: Annotated[
        list[Path],
        typer.Option(
            "--data",
            help="Recording with pictures such as the model will see, a folder of recordings, or one of "
            "pictures with COCO annotations; repeat.",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Model to write (.onnx).")],
    contract: Annotated[
        Path | None, typer.Option("--contract", help="Contract (.json) instead of the model's own.")
    ] = None,
    pictures: Annotated[
        int, typer.Option("--pictures", min=1, help="Pictures to take the ranges of the layers from.")
    ] = 64,
    every: Annotated[
        int, typer.Option("--every", help="Measure rates on every n-th frame of each drone only.", min=1)
    ] = 1,
    origin: options.Origin = None,
    assume_local: options.AssumeLocal = False,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Write a model that computes in eight bits: twice as fast and more on a CPU, and a quarter of the size.

    As many other pictures tell what that changes. On labelled missions with maps, such as those that the
    model was calibrated on, its rates are measured anew; else it states the old ones, and whose they are.
    """
    from crowdfence.calibration.quantization import quantize_model
    from crowdfence.detector.detector import Detector
    from crowdfence.detector.shipped import model_path
    from crowdfence.evaluation.labelled_missions import MeasurementPlan, frames_looked_at

    paths, model = options.recordings_in(data), model_path(model)
    detector = Detector(model, contract)
    with ExitStack() as stack:
        stack.enter_context(replaceable_file(output, force=force, reads=[model, *data]))
        map_options = options.terrain_options(origin=origin, assume_local=assume_local)
        plan = MeasurementPlan(every=every, terrain_options=map_options)
        count = 2 * pictures + frames_looked_at(paths, every)
        advance = stack.enter_context(console.progress("looking", count, "pictures"))
        result = quantize_model(
            detector, model, paths, output, pictures=pictures, plan=plan, on_picture=advance
        )
    warn_of_data(result.warnings, result.refused)
    if as_json:
        console.print_json(asdict(result))
        return
    (before_ms, after_ms), (before, after) = result.cpu_ms, result.size_bytes
    facts = {
        "ranges from": counted(result.pictures, "picture"),
        "called crowd by both": f"{result.agreement:.1%} of what either calls"
        if result.agreement == result.agreement
        else "unknown: neither calls any of these pictures crowd",
        "heatmaps differ by": f"{result.mean_difference:.2g} on average",
        "CPU time of a picture": f"{before_ms:.1f} -> {after_ms:.1f} ms",
        "size": f"{before / 1e6:.2f} -> {after / 1e6:.2f} MB",
        "rates": _rates(result.rates) if result.rates else "none",
    }
    if result.rates_not_measured:
        facts["rates not measured"] = result.rates_not_measured
    console.stdout().print(console.facts(f"{output}: {detector.contract.name} in eight bits", facts))


@app.command("finer")
def finer(
    model: Annotated[Path, typer.Argument(help="Calibrated model (.onnx, or a shipped one's name).")],
    data: Annotated[
        list[Path],
        typer.Option(
            "--data",
            help="Labelled recording with a map, of cameras finer than those of the calibration, or a folder "
            "of missions; repeat.",
        ),
    ],
    output: Annotated[Path, typer.Option("--output", "-o", help="Model to write (.onnx).")],
    every: options.EveryFrame = 1,
    origin: options.Origin = None,
    assume_local: options.AssumeLocal = False,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Measure what a model is worth behind finer cameras, and write that into it.

    A camera with more pixels, or a longer lens, finds more of a crowd as far away, and more that is none.
    Method evidence goes by what is measured here, and for cameras between these and those of the calibration
    by what lies between. Nothing else of the model changes.
    """
    require_onnx()
    from crowdfence.calibration.finer_cameras import with_rates_of_finer
    from crowdfence.calibration.model_file import write_with_contract
    from crowdfence.detector.detector import Detector
    from crowdfence.detector.shipped import model_path
    from crowdfence.evaluation.labelled_missions import MeasurementPlan, frames_looked_at

    paths, model = options.recordings_in(data), model_path(model)
    detector = Detector(model)
    with replaceable_file(output, force=force, reads=[model, *data]):
        map_options = options.terrain_options(origin=origin, assume_local=assume_local)
        plan = MeasurementPlan(every=every, terrain_options=map_options)
        with console.progress("looking", frames_looked_at(paths, every), "frames") as advance:
            result = with_rates_of_finer(detector, paths, plan, advance)
        write_with_contract(model, result.contract, output)
    warn_of_data(result.warnings, result.refused)
    rates = (result.contract.rates or {})["finer"]
    if as_json:
        console.print_json(rates)
        return
    facts = {
        "focal length": f"{result.focal_px:g} px",
        "missions": str(result.rates.missions),
        "rates": _rates(rates),
        "valid for": _spans(
            None if result.contract.finer_cameras is None else result.contract.finer_cameras.validity
        ),
    }
    console.stdout().print(console.facts(f"{output}: {detector.contract.name} behind finer cameras", facts))


def _contract_facts(contract: Contract, source: str) -> dict[str, str]:
    model, output = contract.input, contract.output
    size = "any size" if model.size is None else f"{model.size[0]} x {model.size[1]}"
    multiple = f", sides multiples of {model.multiple_of}" if model.size is None else ""
    channel = "" if output.class_index is None else f", class {output.class_index}"
    rows = {
        "contract": source,
        "model": " ".join(filter(None, (contract.name, contract.version)))
        + f", {contract.licence or 'no licence stated'}",
        "input": f"{model.name}: {model.dtype} {model.layout} {model.color}, {size}{multiple}, "
        f"resize {model.resize}",
        "normalisation": "none: the pixels as they are"
        if model.is_raw
        else f"(pixel * {model.scale:.6g} - {_listed(model.mean)}) / {_listed(model.std)}",
        "output": f"{output.name}: {output.kind} {output.layout}{channel}, stride {output.stride}",
    }
    if model.vibrance != 1.0:
        rows["colours"] = f"pale ones up to {model.vibrance:g} times as strong (vibrance)"
    if output.rule is not None:
        rows["crowd from"] = ", ".join(f"{name} {value:g}" for name, value in output.rule.to_json().items())
    if (contract.about or {}).get("arithmetic") is not None:
        rows["arithmetic"] = str((contract.about or {})["arithmetic"])
    rows["calibration"] = _plain(contract.calibration) or "none: probabilities as the model gives them"
    rows["rates"] = _rates(contract.rates or {})
    rows["valid for"] = _spans(contract.validity)
    if contract.finer_cameras is not None:
        rows["finer cameras"] = (
            f"{contract.finer_cameras.focal_px:g} px, {_spans(contract.finer_cameras.validity)}"
        )
    rows["on photographs"] = _photographs(contract)
    if contract.sizes is not None and contract.sizes.gsd_m is not None:
        low_m, high_m = contract.sizes.gsd_m
        rows["shown at"] = f"{low_m:g} to {high_m:g} m per pixel where pose and map tell, else at sizes " + (
            ", ".join(f"{size:g}" for size in contract.sizes.without_gsd)
        )
    if contract.target_height_m is not None:
        rows["marks"] = f"what is {contract.target_height_m:g} m above the ground"
    return rows


def _photographs(contract: Contract) -> str:
    """What was measured on photographs, if anything."""
    measured = (contract.about or {}).get("photographs")
    if not isinstance(measured, dict):
        return "not stated: nobody says how it does on them"
    return ", ".join(
        f"{name.replace('_', ' ')} {value:g}" if isinstance(value, (int, float)) else f"{value}"
        for name, value in measured.items()
    )


def _run_facts(report: ModelCheck) -> dict[str, str]:
    height, width = report.image.shape[:2]
    rows, columns = report.heatmap.shape
    facts = {"picture": f"{report.image_source}, {width} x {height}"}
    if report.gsd_m is not None:
        facts["metres per pixel"] = f"{report.gsd_m:g}"
    return facts | {
        "heatmap": f"{columns} x {rows}, {report.heatmap.min():.3f} to {report.heatmap.max():.3f}, "
        f"{(report.heatmap > 0.5).mean():.1%} above 0.5",
        "latency": f"p50 {report.latency_ms_p50:.1f} ms, p95 {report.latency_ms_p95:.1f} ms "
        f"({report.runs} runs)",
    }


def _rates(rates: dict[str, Any]) -> str:
    parts = []
    for name in ("true_positive", "false_positive"):
        if isinstance(rates.get(name), dict):
            rate = rates[name]
            parts.append(
                f"{name.replace('_', ' ')} {rate['rate']:.4g} ({rate.get('low', rate['rate']):.4g} to "
                f"{rate.get('high', rate['rate']):.4g})"
            )
    if rates.get("arithmetic") == "float32":
        parts.append("measured in floating point, not in eight bits")
    return ", ".join(parts) or _plain(rates) or "none: equation 1 takes the defaults of the run"


def _spans(validity: Validity | None) -> str:
    units = {"gsd_m": "m per pixel", "distance_m": "m away", "tilt_deg": "degrees below the horizon"}
    spans = {unit: getattr(validity, name, None) for name, unit in units.items()}
    stated = [f"{span[0]:g} to {span[1]:g} {unit}" for unit, span in spans.items() if span is not None]
    return ", ".join(stated) or "not stated"


def _plain(values: dict[str, object] | None) -> str:
    """The short entries of a JSON object on one line."""
    shown = {
        name: f"{value:.4g}" if isinstance(value, float) else str(value)
        for name, value in (values or {}).items()
        if not isinstance(value, (dict, list))
    }
    return ", ".join(f"{name} {value}" for name, value in shown.items())


def _listed(values: tuple[float, ...]) -> str:
    return (
        f"{values[0]:.6g}" if len(set(values)) == 1 else f"[{', '.join(f'{value:.6g}' for value in values)}]"
    )


def _print_quality(contract: Contract, result: ModelQuality) -> None:
    from crowdfence.evaluation.quality_table import quality_text
    from crowdfence.evaluation.text_table import aligned, interval

    plan, rates = result.plan, result.rates
    print(f"{contract.name} on {result.frames} frames, as a detector that marks {plan.target}\n")
    print(quality_text(result.quality))
    if rates is not None:
        rows = [(f"Per voxel observation, projected at {plan.target_height_m:g} m", "TPR", "FPR")]
        for label, pair in (("all", rates.rates), ("away from edges", rates.away_from_edges)):
            rows.append((label, interval(pair.true_positive), interval(pair.false_positive, 4)))
        print(f"\n{aligned(rows)}")
    for line in (*_people_lines(contract, result), *_picture_lines(result)):
        print(f"\n{line}")


def _people_lines(contract: Contract, result: ModelQuality) -> Iterator[str]:
    people, validity = result.people, contract.validity
    if people.people:
        span = None if validity is None else validity.gsd_m
        where = "" if span is None else f" at {span[0]:g} to {span[1]:g} m per pixel"
        found = (
            f"One view{where}: {people.share_found():.1%} of {people.people:,} people of crowds seen stand "
            "in a called cell"
        )
        if not people.empty_cells:
            yield f"{found}; no empty ground was seen there, so nobody knows how much of it is called."
            return
        yield (
            f"{found}, {people.share_called():.2%} of the empty ground is called; "
            f"{people.share_found(people.affordable_threshold()):.1%} at the threshold that calls 1 %."
        )


def _picture_lines(result: ModelQuality) -> Iterator[str]:
    pictures = result.pictures.to_json()
    if pictures["mean_recall"] is not None:
        count, recall = pictures["pictures_with_crowd"], pictures["mean_recall"]
        yield f"{count} pictures with crowd: {recall:.1%} of it marked, the mean of the pictures."
    if pictures["mean_share_marked"] is not None:
        yield (
            f"{pictures['pictures_without_crowd']} without: {pictures['mean_share_marked']:.2%} of the cells "
            f"marked, more than 1 % in {pictures['share_with_more_than_one_percent']:.0%} of them."
        )


_OF_MISSIONS = ("target", "target_height_m", "max_range_m", "origin", "assume_local")


def _require_png(option: str, path: Path | None) -> None:
    if path is not None and path.suffix.lower() != ".png":
        raise ValueError(f"{option} {path} must end in .png")


def _write_overlay(path: Path, report: ModelCheck) -> None:
    from crowdfence.detector.overlay import overlay

    _write_picture(path, overlay(report.image, report.heatmap))


def _write_picture(path: Path, picture: NDArray[np.uint8]) -> None:
    from PIL import Image

    with atomic_path(path) as temporary:
        Image.fromarray(picture).save(temporary, "PNG")
