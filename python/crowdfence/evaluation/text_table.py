"""Rows of text as aligned columns, whatever the width of the terminal."""

from __future__ import annotations

from collections.abc import Sequence

from crowdfence.evaluation.statistics.unit_bootstrap import Estimate


def aligned(rows: Sequence[Sequence[str]]) -> str:
    """Lines of text; the first column starts on the left, the others end on the right."""
    widths = [max(len(row[column]) for row in rows) for column in range(len(rows[0]))]
    lines = (
        row[0].ljust(widths[0])
        + "".join(f"  {cell.rjust(width)}" for cell, width in zip(row[1:], widths[1:], strict=True))
        for row in rows
    )
    return "\n".join(line.rstrip() for line in lines)


def number(value: float, digits: int = 3) -> str:
    """ "-" for unknown."""
    return "-" if value != value else f"{value:.{digits}f}"


def threshold_number(value: float) -> str:
    """Those of a rare class are small: three digits after the point would make 0.000 of them."""
    return f"{value:.3f}" if value >= 0.01 else f"{value:.3g}"


def percent(share: float) -> str:
    """Such as "97.3%"; "-" for unknown. Nobody who is missed is rounded away: what is not all is ">99.9%" at
    most, and what is not nothing "<0.1%" at least."""
    if share != share:
        return "-"
    if 0.9995 <= share < 1.0:
        return ">99.9%"
    return "<0.1%" if 0.0 < share < 0.0005 else f"{share:.1%}"


def interval(estimate: Estimate, digits: int = 3) -> str:
    """Such as "0.912 [0.880, 0.931]"; "-" for unknown, no brackets without an interval."""
    if estimate.value != estimate.value or estimate.low != estimate.low:
        return number(estimate.value, digits)
    return f"{estimate.value:.{digits}f} [{estimate.low:.{digits}f}, {estimate.high:.{digits}f}]"
