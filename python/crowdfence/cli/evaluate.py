"""`crowdfence evaluate`: score methods on a recording that holds truth."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.cli import console, options, source_options
from crowdfence.cli.detector_choice import chosen_detector
from crowdfence.cli.exit_codes import GATE_NOT_MET
from crowdfence.cli.made_by import all_digits, heatmaps_line
from crowdfence.cli.option_sets import (
    DetectorOptions,
    EvidenceOptions,
    FlightOptions,
    LayerOptions,
    LookOptions,
    MapOptions,
    MaskOptions,
    ProjectionOptions,
    SourceOptions,
    map_options,
    takes,
)
from crowdfence.cli.options import DEFAULT, OR, PAPER
from crowdfence.cli.refusals import refusal_lines
from crowdfence.cli.unused_options import refuse_options_of_other_methods, refuse_unused
from crowdfence.cli.wording import counted, in_options
from crowdfence.config import (
    LinearPoolConfig,
    LogPoolConfig,
    MethodConfig,
    OrConfig,
    PaperConfig,
    RunConfig,
)
from crowdfence.evaluation.text_table import number, percent, threshold_number
from crowdfence.zones.square_metres import square_metres

if TYPE_CHECKING:
    from rich.console import Group
    from rich.table import Table

    from crowdfence.evaluation.cells.rates import Confusion
    from crowdfence.evaluation.knobs import Turned
    from crowdfence.evaluation.replay import Score
    from crowdfence.evaluation.safety import Safety
    from crowdfence.sources.recording import Instant, InstantViews


@takes(
    MapOptions,
    LayerOptions,
    SourceOptions,
    FlightOptions,
    MaskOptions,
    DetectorOptions,
    LookOptions,
    EvidenceOptions,
    ProjectionOptions,
    before="method",
)
def evaluate(
    context: typer.Context,
    recording: options.RecordingPaths,
    method: Annotated[
        list[options.MethodName] | None,
        typer.Option("--method", "-m", help="Method to score; may be repeated. Default: all."),
    ] = None,
    alpha: Annotated[
        list[float] | None, typer.Option("--alpha", help="Weight of the newest instant; may be repeated.")
    ] = None,
    decay: options.Decay = PAPER.decay,
    decay_unit: options.DecayUnitOption = options.DecayUnit.second,
    unseen: options.UnseenOption = options.Unseen.fleet,
    normalise: options.Normalise = False,
    initial: options.InitialOption = options.Initial.zero,
    true_positive_rate: options.TruePositiveRate = None,
    false_positive_rate: options.FalsePositiveRate = None,
    fleet_size: options.FleetSize = None,
    measured_rates: Annotated[
        bool,
        typer.Option(
            "--measured-rates",
            help="Use the rates per heatmap cell that the truth shows, above --b-threshold.",
        ),
    ] = False,
    b_threshold: options.BThreshold = PAPER.b_threshold,
    or_b_threshold: Annotated[
        float,
        typer.Option("--or-b-threshold", help="Mean heatmap value above which `or` calls a voxel crowd."),
    ] = OR.b_threshold,
    threshold: options.Threshold = None,
    off_threshold: options.OffThreshold = None,
    opening_looks: options.OpeningLooks = DEFAULT.zones.opening_looks,
    min_area_m2: options.MinAreaM2 = None,
    stale_after_s: options.StaleAfterS = DEFAULT.zones.stale_after_s,
    truth: Annotated[
        options.TruthChoice,
        typer.Option(
            help="Score against the labels of the images, projected (the paper's), or against where the "
            "recorded people stand: fairer to a detector that marks the ground."
        ),
    ] = options.TruthChoice.projected,
    min_iou: Annotated[
        float | None,
        typer.Option(
            "--min-iou", min=0.0, max=1.0, help="Exit with 3 unless every row reaches this mean IoU."
        ),
    ] = None,
    sweep: Annotated[
        bool,
        typer.Option(
            "--sweep", help="Turn every knob of the methods too, one at a time: some ten times slower."
        ),
    ] = False,
    report: Annotated[
        Path | None,
        typer.Option("--report", help="Folder for a page with tables and plots (index.html)."),
    ] = None,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Mean IoU (equation 4) of the methods against the truth that the recording holds, and who stands in a
    zone."""
    paper = options.part(PaperConfig, context.params, alpha=PAPER.alpha)
    if measured_rates:
        refuse_unused(
            context, ["true_positive_rate", "false_positive_rate"], "with --measured-rates, which measures it"
        )
    if method is not None:
        _refuse_unused(context, method, paper)
    from crowdfence.atomic_folder import replaceable_folder
    from crowdfence.evaluation.beside_map import beside_map_warning
    from crowdfence.evaluation.knobs import turned, turns
    from crowdfence.evaluation.replay import CellCounter, score, unrecorded_warning
    from crowdfence.evaluation.replay import measured_rates as count_rates
    from crowdfence.evaluation.report import CONTENTS, write_report
    from crowdfence.evaluation.safety import states_range
    from crowdfence.evaluation.untold_truth import UntoldTruth
    from crowdfence.maps.voxel_size import coarse_voxels_warning
    from crowdfence.pipeline import heatmap_source, lost_crowd_warnings, read_map, review_detector
    from crowdfence.pipeline.under_ground import under_ground_line
    from crowdfence.sources.ground_contact import on_ground
    from crowdfence.sources.layers import CROWD, checked_layer
    from crowdfence.truth.crowd_masks import unlabelled_warning
    from crowdfence.truth.recorded_people import require_people

    if report is not None:
        with replaceable_folder(report, contents=CONTENTS, force=force):
            pass  # known before the work
    layer = checked_layer(context.params["layer"])
    if layer != CROWD:
        refuse_unused(context, _OF_ZONES, f"with --layer {layer}, of which no zones are counted")
    source = source_options.open_source(recording, context.params).of_layer(layer)
    if report is not None and layer == CROWD:
        require_people(source, "--report needs it")
    told = context.params
    chosen = chosen_detector(source, told)
    reading = read_map(source, told["terrain"], **map_options(told))
    ground = reading.terrain
    source = on_ground(source, ground)  # before anything is looked at: a detector looks at its scale
    heatmaps = heatmap_source(chosen, ground, told["max_range_m"], layer=layer, recording=source)
    untold = UntoldTruth()
    cells = CellCounter(paper.b_threshold, untold)
    if measured_rates:
        with console.progress("measuring the detector", len(source.frames), "frames") as advance:
            cells.counts = count_rates(
                source,
                # Every picture is looked at twice.
                heatmap_source(chosen, ground, told["max_range_m"], layer=layer, recording=source),
                b_threshold=paper.b_threshold,
                untold=untold,
                on_instant=lambda instant, _: advance(len(instant.frames)),
            )
        rates = cells.counts.rates()
        paper = replace(
            paper, true_positive_rate=rates.true_positive, false_positive_rate=rates.false_positive
        )
    doubts: tuple[str, ...] = ()
    if method is None or options.MethodName.paper in method:
        paper, doubts = paper.with_terrain(ground)  # once for every alpha
    methods = [
        one
        for name in options.MethodName
        if method is None or name in method
        for one in _methods(context.params, name, paper, alpha)
    ]
    configs = [options.run_config(context.params, one) for one in methods]
    review = review_detector(heatmaps, source, ground, *configs)
    tolerance_ms = configs[0].grouping.tolerance_ms
    beside = beside_map_warning(source, ground, tolerance_ms) if layer == CROWD else None
    turned_ones = [(number, turn) for number, one in enumerate(methods) for turn in turns(one) if sweep]
    with console.progress("scoring", len(source.frames), "frames") as advance:

        def count(instant: Instant, found: InstantViews) -> None:
            if not measured_rates:
                cells.add(instant, found)
            advance(len(instant.frames))

        scores, refused, crowd_mass, swept, of_flight, stamps_ns = score(
            source,
            ground,
            configs,
            heatmaps,
            truth=truth.value,
            on_instant=count,
            untold=untold,
            with_measures=report is not None,
            swept=[options.run_config(context.params, turn.method) for _, turn in turned_ones],
        )
    pairs = list(zip(turned_ones, swept, strict=True))
    knobs = [
        turned(row, [(turn, one) for (of, turn), one in pairs if of == number])
        for number, row in enumerate(scores if sweep else [])
    ]
    lost = lost_crowd_warnings(crowd_mass) if layer == CROWD else []
    by_labels = truth is options.TruthChoice.projected
    of_labels = (unlabelled_warning(source), cells.nothing_shown_warning(layer)) if by_labels else ()
    unrecorded = unrecorded_warning(source, tolerance_ms, truth.value)
    warnings = [
        *source.warnings,
        *(one for one in (*of_labels, unrecorded, beside) if one is not None),
        *untold.warnings,
        *reading.doubts,
        *filter(None, (coarse_voxels_warning(ground.voxel_size_m), under_ground_line(ground, source.frames))),
        *doubts,
        *of_flight,
        *([] if review is None else review.warnings),
        *heatmaps.warnings,
        *lost,
        *(f"{_label(row.config)}: {one}" for row in scores for one in row.unheeded),
    ]
    counts = cells.counts
    if by_labels and counts.positives + counts.negatives == 0:
        nothing = "no frame has both a label and a usable heatmap"
        raise ValueError("; ".join([nothing, *refusal_lines(refused)]))
    summary = {
        "detector": {**heatmaps.to_json(), **_rates(counts), "rates_above": cells.b_threshold},
        "layer": layer,
        "truth": truth.value,
        "stamps_ns": list(stamps_ns),  # of each figure in every `per_frame`
        "scores": [_as_json(row) for row in scores],
        **_knobs_json(scores, knobs),
        "refused": [str(frame) for frame in refused],
        "warnings": warnings,
    }
    made_by = heatmaps_line(summary["detector"])
    range_known = states_range(None if heatmaps.contract is None else heatmaps.contract.validity)
    if report is not None:
        labels = [_label(row.config) for row in scores]
        against = _against(truth, layer)
        write_report(
            report,
            source.name,
            against,
            made_by,
            labels,
            scores,
            summary,
            knobs,
            range_known=range_known,
            force=force,
        )
    if as_json:
        console.print_json(summary)
    else:
        _print(source.name, _against(truth, layer), made_by, counts, cells.b_threshold, scores, range_known)
        if sweep:
            console.stdout().print(_knob_table(scores, knobs))
        for reason in [*map(in_options, warnings), *refusal_lines(refused)]:
            console.warn(reason)
    if min_iou is not None and not all(row.iou.mean >= min_iou for row in scores):
        unknown = any(_known(row.iou.mean) is None for row in scores)
        why = "no crowd was in view, so there is no mean IoU for" if unknown else "a mean IoU is below"
        console.fail(f"{why} --min-iou {min_iou:g}")
        raise typer.Exit(GATE_NOT_MET)


def _refuse_unused(context: typer.Context, names: list[options.MethodName], paper: PaperConfig) -> None:
    """`or` has an option of its own for what a view must show."""
    if options.MethodName.or_ not in names:
        refuse_unused(context, ["or_b_threshold"], "without --method or")
    elif len(set(names)) == 1:
        for name in ("b_threshold", "threshold", "off_threshold"):
            refuse_unused(context, [name], "with --method or; --or-b-threshold does")
    configs = [_methods(context.params, name, paper, None)[0] for name in names]
    refuse_options_of_other_methods(context, configs)
    if not any(hasattr(config, "true_positive_rate") for config in configs):
        refuse_unused(context, ["measured_rates"], f"with --method {', '.join(sorted(set(names)))}")


def _methods(
    parameters: dict[str, Any], name: options.MethodName, paper: PaperConfig, alphas: list[float] | None
) -> list[MethodConfig]:
    """One per alpha where the method has one."""
    if name is options.MethodName.or_:
        return [OrConfig(b_threshold=parameters["or_b_threshold"])]
    rates = {
        rate: getattr(paper, rate) for rate in ("true_positive_rate", "false_positive_rate")
    }  # those that were measured, where that was asked for
    given = {**parameters, **rates, "alpha": PAPER.alpha}
    one = paper if name is options.MethodName.paper else options.method_config(given, name)
    if isinstance(one, (PaperConfig, LinearPoolConfig, LogPoolConfig)):
        return [replace(one, alpha=alpha) for alpha in dict.fromkeys(alphas or [PAPER.alpha])]
    return [one]


_AGAINST = {
    options.TruthChoice.projected: "the labels of the images",
    options.TruthChoice.world: "where the crowds stand",
}


def _against(truth: options.TruthChoice, layer: str) -> str:
    """What the truth is, in words."""
    if layer == "crowd" or truth is options.TruthChoice.projected:
        return _AGAINST[truth]
    return f"where {layer} is in the world"


def _rates(counts: Confusion) -> dict[str, Any]:
    estimates = {
        "true_positive_rate": counts.true_positive_rate(),
        "false_positive_rate": counts.false_positive_rate(),
    }
    return {
        name: {part: _known(value) for part, value in estimate._asdict().items()}
        for name, estimate in estimates.items()
    }


def _as_json(row: Score) -> dict[str, Any]:
    best, best_iou = row.sweep.best()
    return {
        "config": row.config.to_json(),
        "threshold": row.threshold,
        "mean_iou": _known(row.iou.mean),
        "std_iou": _known(row.iou.std),
        "best_knob": _knob(row.config),
        "best_threshold": _known(best),
        "best_mean_iou": _known(best_iou.mean),
        "safety": None if row.safety is None else _safety_json(row.safety),
        **({} if row.measures is None else {"measures": row.measures.to_json()}),
        **({} if row.layer is None else {"measures": row.layer.to_json()}),
        "per_frame": [_known(iou) for iou in row.iou.per_frame.tolist()],
    }


def _known(value: float) -> float | None:
    """NaN is no JSON."""
    return None if value != value else value


def _knobs_json(scores: list[Score], knobs: list[list[Turned]]) -> dict[str, Any]:
    """Nothing where no knob was turned."""
    if not knobs:
        return {}
    worth = [
        {one.knob: [[value, _known(iou)] for value, iou in one.values] for one in ones} for ones in knobs
    ]
    rows = zip(scores, worth, strict=True)
    return {"knobs": [{"method": _label(row.config), "best_mean_iou": one} for row, one in rows]}


def _knob(config: RunConfig) -> str:
    """What is turned for the best IoU."""
    return "b_threshold" if isinstance(config.method, OrConfig) else "threshold"


def _safety_json(safety: Safety) -> dict[str, Any]:
    from crowdfence.evaluation.safety import BUFFERS_M

    per_buffer = {
        "in_zone": safety.share_in_zone,
        "in_zone_in_range": safety.share_in_zone_in_range,
        "blocked_per_own": safety.blocked_per_own,
        "closed_m2": safety.closed_m2,
    }
    return {
        "buffers_m": list(BUFFERS_M),
        **{name: [_known(share) for share in shares.tolist()] for name, shares in per_buffer.items()},
        "on_empty": _known(safety.share_on_empty),
        "moments": safety.moments,
        "people": safety.people,
        "people_in_range": safety.people_in_range,
    }


def _print(
    name: str,
    against: str,
    made_by: str,
    counts: Confusion,
    above: float,
    scores: list[Score],
    range_known: bool,
) -> None:
    """`counts` are those of heatmap cells, called crowd `above` that value."""
    from rich.table import Table

    from crowdfence.evaluation.iou import instants_left_out

    out = console.stdout()
    table = Table(
        title=f"{console.escaped(name)}: mean IoU inside what was seen so far, against {against}",
        title_justify="left",
        title_style="bold",
        box=None,
    )
    table.add_column("method", no_wrap=True)
    for column in ("threshold", "mean IoU", "std", "best threshold", "mean IoU there"):
        table.add_column(column, justify="right")  # narrow: a heading of two lines, never half a figure
    for row in scores:
        best_threshold, best = row.sweep.best()
        table.add_row(
            _label(row.config),
            threshold_number(row.knob),
            number(row.iou.mean),
            number(row.iou.std),
            "-" if best_threshold != best_threshold else _value(best_threshold),
            number(best.mean),
        )
    out.print(table)
    if skipped := instants_left_out([(_label(row.config), row.iou) for row in scores]):
        out.print(skipped)
    out.print(_safety_table(scores))
    if any(row.layer is not None for row in scores):
        out.print(_layer_table(scores))
        out.print(_LAYER_LEGEND)
    if any(row.safety is not None and row.safety.people for row in scores):
        out.print((_IN_RANGE if range_known else _ANY_RANGE) + _LEGEND)
    rates = ""
    if counts.positives + counts.negatives:
        tpr, fpr = counts.true_positive_rate(), counts.false_positive_rate()
        rates = (
            f"; per heatmap cell of labelled images, above {above:g}: TPR {number(tpr.rate)}, "
            f"FPR {number(fpr.rate, 4)}"
        )
    out.print(f"Heatmaps: {console.escaped(made_by)}{rates}.")
    out.print(
        "The threshold of `or` is its b_threshold. The best threshold is chosen on this very recording."
    )


def _knob_table(scores: list[Score], knobs: list[list[Turned]]) -> Table:
    """What the best value of each knob reaches."""
    from rich.table import Table

    table = Table(
        title="\nOne knob turned at a time: mean IoU at the best threshold of this recording",
        title_justify="left",
        title_style="bold",
        box=None,
    )
    for column in ("method", "knob", "values tried"):
        table.add_column(column, no_wrap=column != "values tried")
    for row, ones in zip(scores, knobs, strict=True):
        for one in ones:
            tried = ", ".join(f"{_value(value)}: {number(iou)}" for value, iou in one.values)
            table.add_row(_label(row.config), one.knob, tried)
    return table


def _value(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _safety_table(scores: list[Score]) -> Table | Group | str:
    """Who stands in a zone; nothing where nobody knows where people are."""
    from rich.table import Table

    from crowdfence.evaluation.safety import BUFFERS_M

    asked = scores[0].safety  # all methods are asked about the same people
    if asked is None:
        return ""
    if (people := asked.people) == 0:
        return _closed_for_nobody(scores, asked.moments)
    table = Table(
        title=f"\nPeople of crowds in view, {people:,} counts at {counted(asked.moments, 'moment')}: who "
        "stands in a zone and its buffer",
        title_justify="left",
        title_style="bold",
        box=None,
    )
    table.add_column("method", no_wrap=True)
    for column in (*(f"{buffer_m:g} m" for buffer_m in _SHOWN_M), "in range", "on empty", "closed"):
        table.add_column(column, justify="right", no_wrap=True)
    for row in scores:
        safety = row.safety
        assert safety is not None
        in_zone = [safety.share_in_zone[BUFFERS_M.index(buffer_m)] for buffer_m in _SHOWN_M]
        shares = [*in_zone, safety.share_in_zone_in_range[_AT], safety.share_on_empty]
        table.add_row(
            _label(row.config),
            *map(percent, shares),
            f"{safety.blocked_per_own[_AT]:.2f} x",
        )
    return table


def _closed_for_nobody(scores: list[Score], moments: int) -> Group | str:
    """Where no crowd was in view: the ground that is closed all the same."""
    from rich.console import Group
    from rich.table import Table

    from crowdfence.evaluation.safety import BUFFERS_M

    nobody = "\nNobody of a crowd stood on ground in view: how many would be missed is not known."
    if not moments:
        return nobody
    table = Table(box=None)
    table.add_column("method", no_wrap=True)
    for buffer_m in _SHOWN_M:
        table.add_column(f"{buffer_m:g} m", justify="right", no_wrap=True)
    for row in scores:
        assert row.safety is not None
        closed = [row.safety.closed_m2[BUFFERS_M.index(buffer_m)] for buffer_m in _SHOWN_M]
        table.add_row(_label(row.config), *map(square_metres, closed))
    return Group(
        f"{nobody}\nGround closed for nobody, with its buffer, on the mean of {counted(moments, 'moment')}:",
        table,
    )


def _layer_table(scores: list[Score]) -> Table:
    """Whether the probability of a layer means what it says, and what its ground really is."""
    from rich.table import Table

    table = Table(
        title="\nThe probability, and the ground at or above the threshold",
        title_justify="left",
        title_style="bold",
        box=None,
    )
    table.add_column("method", no_wrap=True)
    for column in ("AP", "Brier", "ECE", "true", "found", "people on it"):
        table.add_column(column, justify="right", no_wrap=True)
    for row in scores:
        if row.layer is None:
            continue
        quality, called = row.layer.quality, row.layer
        means = [f"{one:.3f}" for one in (quality.average_precision, quality.brier)]
        shares = [called.precision, called.recall, called.share_of_people_on_called]
        table.add_row(_label(row.config), *means, f"{quality.calibration_error:.4f}", *map(percent, shares))
    return table


_OF_ZONES = ("off_threshold", "opening_looks", "min_area_m2", "stale_after_s")
_SHOWN_M = (0.0, 2.0, 5.0)
_AT = 2
"""5 m among the buffers."""
_LAYER_LEGEND = (
    "AP, ECE: average precision, expected calibration error. True: of the ground\n"
    "at or above the threshold. Found: of the ground of the class that was seen.\n"
    "People: of everybody on ground that was seen."
)
_IN_RANGE = "In range: with 5 m, on ground seen within the detector's tested range. On empty:\n"
_ANY_RANGE = "In range: as 5 m, for no range is known that the heatmaps are good in. On empty:\n"
_LEGEND = (
    "on ground that the map calls empty. Closed: ground in zones per ground of crowds\n"
    "that was seen, both with 5 m around."
)


def _label(config: RunConfig) -> str:
    method = config.method
    if isinstance(method, (PaperConfig, LinearPoolConfig, LogPoolConfig)):
        return f"{method.name}, alpha {all_digits(method.alpha)}"
    return method.name
