"""What made a map, in a line: the heatmaps, the method with its parameters."""

from __future__ import annotations

from typing import Any


def heatmaps_line(detector: dict[str, Any]) -> str:
    if "name" not in detector:
        return "as recorded"
    version = f" {detector['version']}" if detector["version"] else ""
    if detector["heatmaps"] == "recorded":
        return f"as recorded, by {detector['name']}{version}"
    checksum = f", sha256 {detector['sha256'][:12]}" if detector["sha256"] else ""
    return f"{detector['name']}{version} on the pictures{checksum}"


_KNOBS = ("alpha", "decay", "memory_s", "b_threshold", "clamp_low", "clamp_high")
"""Of the methods for comparison, beside their prior."""


def all_digits(value: float) -> str:
    """What was given, so that 0.3 and 0.30000001 are two."""
    return repr(float(value)).removesuffix(".0")


def method_line(summary: dict[str, Any]) -> str:
    used = summary["parameters"]
    if summary["method"] == "or":
        return f"or, b > {all_digits(used['b_threshold'])}"
    if summary["method"] == "evidence":
        return (
            f"evidence, memory {all_digits(used['memory_s'])} s, prior {used['prior']:.4g}, "
            f"empty up to P = {used['cleared']:.2g}"
        )
    if summary["method"] != "paper":
        knobs = [f"{name} {all_digits(used[name])}" for name in _KNOBS if name in used]
        return ", ".join([summary["method"], *knobs, f"prior {used['prior']:.4g}"])
    alpha, decay, true_positive, false_positive = (
        all_digits(used[name]) for name in ("alpha", "decay", "true_positive_rate", "false_positive_rate")
    )
    # The share of a map, unless it is given, has more digits than say anything.
    return (
        f"paper, alpha {alpha}, lambda {decay} per {used['decay_unit']}, prior {used['prior']:.4g}, "
        f"TPR {true_positive}, FPR {false_positive}, N {used['fleet_size']}"
    )
