"""The quality of a detector as a table of plain text."""

from __future__ import annotations

from crowdfence.evaluation.detector_quality import QualityReport
from crowdfence.evaluation.quality_scores import Quality
from crowdfence.evaluation.unit_bootstrap import Estimate

_HEADINGS = ("", "cells", "crowd", "IoU", "PR-AUC", "TPR", "FPR", "false area", "ECE", "ECE > 0.05")


def quality_text(report: QualityReport) -> str:
    """One row for everything and one for each member of each breakdown; intervals of 95 % in brackets."""
    rows = [_HEADINGS, _row("all", report.overall)]
    for name, members in report.by.items():
        rows += [_row(f"{name} {member}", one) for member, one in members.items()]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADINGS))]
    lines = [
        row[0].ljust(widths[0])
        + "".join(f"  {cell.rjust(width)}" for cell, width in zip(row[1:], widths[1:], strict=True))
        for row in rows
    ]
    return "\n".join(line.rstrip() for line in lines)


def interval_text(estimate: Estimate, digits: int = 3) -> str:
    """Such as "0.912 [0.880, 0.931]"; "-" for unknown, no brackets without an interval."""
    if estimate.value != estimate.value:
        return "-"
    text = f"{estimate.value:.{digits}f}"
    if estimate.low != estimate.low:
        return text
    return f"{text} [{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"


def _row(label: str, one: Quality) -> tuple[str, ...]:
    return (
        label,
        str(one.cells),
        f"{one.crowd_cells / one.cells:.4f}" if one.cells else "-",
        interval_text(one.iou),
        interval_text(one.pr_auc),
        interval_text(one.true_positive_rate),
        interval_text(one.false_positive_rate, 4),
        interval_text(one.false_crowd_share, 4),
        interval_text(one.calibration_error, 4),
        interval_text(one.calibration_error_above),
    )
