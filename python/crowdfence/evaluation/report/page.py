"""The page of a report: tables, plots and what they mean."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from html import escape
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np

from crowdfence.atomic_folder import whole_folder
from crowdfence.evaluation.iou import instants_left_out
from crowdfence.evaluation.report.plots import DRAWN, MOST_COST, OF_LAYERS, closed_words, write_plots
from crowdfence.evaluation.safety import BUFFERS_M
from crowdfence.evaluation.text_table import percent, threshold_number

if TYPE_CHECKING:
    from crowdfence.evaluation.knobs import Turned
    from crowdfence.evaluation.replay import Score

CONTENTS = ("index.html", "scores.json", *DRAWN)

MOST_REFUSALS = 200

Rows = Sequence[Sequence[str]]
_UNKNOWN = "&ndash;"


def write_report(
    folder: str | PathLike[str],
    name: str,
    against: str,
    heatmaps: str,
    names: list[str],
    scores: list[Score],
    summary: Mapping[str, Any],
    knobs: Sequence[Sequence[Turned]] = (),
    *,
    range_known: bool = True,
    force: bool = False,
) -> None:
    """Write the report of a recording into a folder, which is whole or absent; an older report is replaced
    with `force`.

    against      what the truth is, in words
    heatmaps     what made them, in words
    names        of the methods, one per score
    summary      goes into scores.json as it is; its "warnings" and "refused" stand on the page too
    knobs        of each method, where they were turned; else nothing
    range_known  whether it is stated in which range the detector was tested

    The scores hold measures and safety, or what is counted of a layer. FileExistsError where the folder holds
    anything else or may not be replaced, OSError where it cannot be written.
    """
    page = _page(name, against, heatmaps, names, scores, knobs, _doubts(summary), range_known)
    with whole_folder(folder, contents=CONTENTS, force=force) as beside:
        write_plots(beside, names, scores)
        (beside / "scores.json").write_text(json.dumps(summary, indent=1, allow_nan=False), encoding="utf-8")
        (beside / "index.html").write_text(page, encoding="utf-8")


def _page(
    name: str,
    against: str,
    heatmaps: str,
    names: list[str],
    scores: list[Score],
    knobs: Sequence[Sequence[Turned]],
    doubts: list[str],
    range_known: bool,
) -> str:
    if scores[0].layer is not None:
        return _layer_page(name, against, heatmaps, names, scores, knobs, doubts)
    pictures = "".join(f'<img src="{file}" alt="">' for file in DRAWN)
    parts = [
        f"<h1>{escape(name)}</h1>",
        _paragraph(
            f"Mean IoU against {escape(against)}. Heatmaps: {escape(heatmaps)}. People, delays and ways are "
            "counted once a second, by where everybody stood."
        ),
        _table("Who stands in a zone", _people(names, scores)),
        _paragraph(
            f"Of {_counted(scores, range_known)} of people of crowds on ground that some drone has had in "
            f"view. A zone is what is held closed, with the buffer around it. In range: "
            f"{_IN_RANGE[range_known]}. On empty: on ground that the map calls empty. "
            "Closed: ground in zones, times the crowds' own, both with 5 m around; where no ground of crowds "
            "was in view, the ground in zones and 5 m around them, on the mean of the moments."
        ),
        f'<div class="plots">{pictures}</div>',
        _table("Zones", _zones(names, scores)),
        _paragraph(
            "Missed ground: what crowds stand on, in view and in no zone with 5 m around it. For "
            "nothing: ground farther than 5 m from any crowd that is closed, times the crowds' own, "
            "where the threshold misses 5 or 1 % of the people; a dash where none misses so few. Its plot "
            f"ends at {MOST_COST:g} times; the legend there says whose curve goes on above. To "
            "mark: from when a crowd's ground is in view until it is in a zone. To clear: from when "
            "the crowd left it until it is open. Both are medians, with the share where that had not "
            "come by the end. Over a crowd: ways of a planner that goes round the zones with 5 m to "
            "spare, across each of the largest crowds in view."
        ),
        _table("Map", _map(names, scores)),
        _paragraph(_map_legend(names, scores)),
        *_knobs(names, knobs),
        *doubts,
    ]
    return _HEAD.replace("TITLE", escape(name)) + "\n".join(parts) + "\n</main></body></html>\n"


def _doubts(summary: Mapping[str, Any]) -> list[str]:
    """What was doubtful and which pictures took no part: figures mean little without it."""
    refused = list(summary["refused"])
    more = len(refused) - MOST_REFUSALS
    return [
        "<h2>Warnings</h2>",
        _list(summary["warnings"], "Nothing was doubtful."),
        "<h2>Refused pictures</h2>",
        _list(refused[:MOST_REFUSALS], "Every picture was used."),
        *([_paragraph(f"and {more:,} more, all in scores.json")] if more > 0 else []),
    ]


def _list(sentences: Sequence[str], none: str) -> str:
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else _paragraph(none)


_IN_RANGE = {
    True: "on ground seen within the range that the detector was tested in, 5 m buffer",
    False: "as 5 m, for no range is known that the heatmaps are good in",
}


def _counted(scores: list[Score], range_known: bool) -> str:
    """How many people the shares are of: everybody once a second."""
    safety = scores[0].safety
    assert safety is not None
    in_range = f" ({safety.people_in_range:,} of them in range)" if range_known else ""
    moments = f"{safety.moments:,} moment{'' if safety.moments == 1 else 's'}"
    return f"{safety.people:,} counts{in_range}, at {moments},"


def _layer_page(
    name: str,
    against: str,
    heatmaps: str,
    names: list[str],
    scores: list[Score],
    knobs: Sequence[Sequence[Turned]],
    doubts: list[str],
) -> str:
    """Of a layer other than crowds, which closes nothing."""
    pictures = "".join(f'<img src="{file}" alt="">' for file in OF_LAYERS)
    parts = [
        f"<h1>{escape(name)}</h1>",
        _paragraph(
            f"Mean IoU against {escape(against)}. Heatmaps: {escape(heatmaps)}. The rest is counted once a "
            "second."
        ),
        _table("Map", _map(names, scores)),
        _paragraph(_map_legend(names, scores)),
        f'<div class="plots">{pictures}</div>',
        _table("Ground at or above the threshold", _found(names, scores)),
        _paragraph(
            "Of it true: the share of this ground that is of the class. Found: of the ground of the class "
            "that some drone has had in view, the share that is called so. People on it: of everybody on "
            "ground that was seen, in a crowd or not."
        ),
        *_knobs(names, knobs),
        *doubts,
    ]
    return _HEAD.replace("TITLE", escape(name)) + "\n".join(parts) + "\n</main></body></html>\n"


def _found(names: list[str], scores: list[Score]) -> Rows:
    rows = [["method", "of it true", "found", "people on it"]]
    for name, row in zip(names, scores, strict=True):
        assert row.layer is not None
        shares = [row.layer.precision, row.layer.recall, row.layer.share_of_people_on_called]
        rows.append([name, *map(_percent, shares)])
    return rows


def _paragraph(text: str) -> str:
    return f"<p>{text}</p>"


def _knobs(names: list[str], knobs: Sequence[Sequence[Turned]]) -> list[str]:
    """Nothing where no knob was turned."""
    if not knobs:
        return []
    rows = [["method", "knob", "best value", "mean IoU there", "values tried"]]
    for name, ones in zip(names, knobs, strict=True):
        for one in ones:
            value, iou = one.best
            tried = [f"{_setting(each)}:&nbsp;{_number(worth, '{:.3f}')}" for each, worth in one.values]
            rows.append([name, one.knob, _setting(value), _number(iou, "{:.3f}"), ", ".join(tried)])
    return [
        _table("Knobs", rows),
        _paragraph(
            "One knob turned at a time, the others as above; mean IoU at the threshold that is best on "
            "this very recording. <code>or</code> has no other knob than the one in the table above."
        ),
    ]


def _setting(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _people(names: list[str], scores: list[Score]) -> Rows:
    rows = [["method", *(f"{buffer:g} m" for buffer in BUFFERS_M), "in range", "on empty", "closed"]]
    at = BUFFERS_M.index(5.0)
    for name, row in zip(names, scores, strict=True):
        assert row.safety is not None
        shares = [*row.safety.share_in_zone, row.safety.share_in_zone_in_range[at], row.safety.share_on_empty]
        rows.append([name, *map(_percent, shares), escape(closed_words(row.safety, at))])
    return rows


def _zones(names: list[str], scores: list[Score]) -> Rows:
    rows = [
        [
            "method",
            "missed ground",
            "for nothing at 5 %",
            "at 1 %",
            "to mark",
            "never",
            "to clear",
            "never",
            "ways over a crowd",
            "no way",
        ]
    ]
    at = BUFFERS_M.index(5.0)
    for name, row in zip(names, scores, strict=True):
        assert row.safety is not None and row.measures is not None
        cost = row.measures.cost.curve(np.array([0.05, 0.01]))
        mark, clear, routes = row.measures.delay.to_mark, row.measures.delay.to_clear, row.measures.routes
        rows.append(
            [
                name,
                _percent(row.safety.share_missed_m2[at]),
                *(_number(one, "{:.2f} x") for one in cost),
                _number(mark.median_s, "{:.1f} s"),
                _percent(mark.never),
                _number(clear.median_s, "{:.1f} s"),
                _percent(clear.never),
                f"{routes.crossing} of {routes.asked}",
                str(routes.without),
            ]
        )
    return rows


def _map(names: list[str], scores: list[Score]) -> Rows:
    rows = [
        [
            "method",
            "own threshold",
            "mean IoU",
            "best threshold",
            "mean IoU there",
            "average precision",
            "Brier",
            "calibration error",
        ]
    ]
    for name, row in zip(names, scores, strict=True):
        assert row.quality is not None
        best, best_iou = row.sweep.best()
        quality = row.quality
        own = [_threshold(row.knob), _number(row.iou.mean, "{:.3f}")]
        there = [_threshold(best), _number(best_iou.mean, "{:.3f}")]
        means_it = [_number(one, "{:.3f}") for one in (quality.average_precision, quality.brier)]
        rows.append([name, *own, *there, *means_it, _number(quality.calibration_error, "{:.4f}")])
    return rows


def _threshold(value: float) -> str:
    return threshold_number(value) if np.isfinite(value) else _UNKNOWN


def _percent(share: float) -> str:
    return escape(percent(share)).replace("%", " %") if np.isfinite(share) else _UNKNOWN


def _number(value: float, form: str) -> str:
    return form.format(value) if np.isfinite(value) else _UNKNOWN


def _table(title: str, rows: Rows) -> str:
    head, *body = rows
    cells = "".join(f"<th>{cell}</th>" for cell in head)
    lines = "".join(
        f"<tr><th>{escape(first)}</th>{''.join(f'<td>{cell}</td>' for cell in rest)}</tr>"
        for first, *rest in body
    )
    return f"<h2>{title}</h2><table><thead><tr>{cells}</tr></thead><tbody>{lines}</tbody></table>"


_MAP_LEGEND = (
    "Own threshold: the method's, for <code>or</code> its b threshold. Best: the one that is best on this "
    "very recording, so an upper bound. Average precision ranks by the probability, for <code>or</code> by "
    "the highest value so far. The calibration error is that of 15 equal bins."
)


def _map_legend(names: list[str], scores: list[Score]) -> str:
    skipped = instants_left_out([(name, row.iou) for name, row in zip(names, scores, strict=True)])
    return f"{_MAP_LEGEND} {escape(skipped)}".rstrip()


_HEAD = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>TITLE</title>
<meta name="viewport" content="width=device-width, initial-scale=1"><style>
body { font: 15px/1.5 system-ui, sans-serif; color: #1f2933; margin: 0; }
main { max-width: 1080px; margin: 2rem auto; padding: 0 1.2rem; }
h1 { font-size: 1.5rem; } h2 { font-size: 1.1rem; margin-top: 2rem; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { padding: .35rem .6rem; text-align: right; border-bottom: 1px solid #e4e7eb; }
th:first-child { text-align: left; } thead th { color: #52606d; font-weight: 500; font-size: .85rem; }
p, li { color: #52606d; font-size: .9rem; max-width: 75ch; overflow-wrap: anywhere; }
.plots { display: grid; grid-template-columns: repeat(auto-fit, minmax(420px, 1fr)); gap: 1rem; }
.plots img { width: 100%; border: 1px solid #e4e7eb; border-radius: 6px; }
</style></head><body><main>
"""
