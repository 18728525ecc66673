"""The quality of a detector as a table of plain text."""

from __future__ import annotations

from typing import Literal

from crowdfence.evaluation.cells.quality import QualityReport
from crowdfence.evaluation.cells.scores import Quality
from crowdfence.evaluation.text_table import aligned, number

_COLUMNS = (
    ("IoU", "iou", 3),
    ("PR-AUC", "pr_auc", 3),
    ("TPR", "true_positive_rate", 3),
    ("FPR", "false_positive_rate", 4),
    ("TPR at FPR .01", "true_positive_rate_at_one_percent", 3),
    ("false area", "false_crowd_share", 4),
    ("ECE", "calibration_error", 4),
    ("ECE > 0.05", "calibration_error_above", 3),
)


def quality_text(report: QualityReport) -> str:
    """One row for everything, with the ends of its 95 % intervals below, and one for each member of each
    breakdown (their intervals are in `QualityReport.to_json`)."""
    rows = [("", "cells", "crowd", *(heading for heading, *_ in _COLUMNS))]
    rows.append(_row("all", report.overall, "value"))
    rows += [("  95 %", "from" if end == "low" else "to", "", *_scores(report.overall, end)) for end in _ENDS]
    for name, members in report.by.items():
        rows += [_row(f"{name} {member}", one, "value") for member, one in members.items()]
    return aligned(rows)


_ENDS: tuple[Literal["low", "high"], ...] = ("low", "high")


def _row(label: str, one: Quality, part: Literal["value", "low", "high"]) -> tuple[str, ...]:
    share = f"{one.crowd_cells / one.cells:.4f}" if one.cells else "-"
    return (label, str(one.cells), share, *_scores(one, part))


def _scores(one: Quality, part: Literal["value", "low", "high"]) -> list[str]:
    return [number(getattr(getattr(one, field), part), digits) for _, field, digits in _COLUMNS]
