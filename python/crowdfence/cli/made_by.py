"""What made a map, in a line: the heatmaps, the method with its parameters."""

from __future__ import annotations

from typing import Any


def heatmaps_line(detector: dict[str, Any]) -> str:
    if "name" not in detector:
        return "as recorded"
    version = f" {detector['version']}" if detector["version"] else ""
    checksum = f", sha256 {detector['sha256'][:12]}" if detector["sha256"] else ""
    return f"{detector['name']}{version} on the pictures{checksum}"


_KNOBS = ("alpha", "decay", "memory_s", "prior", "b_threshold", "clamp_low", "clamp_high")
"""Of the methods for comparison."""


def method_line(summary: dict[str, Any]) -> str:
    used = summary["parameters"]
    if summary["method"] == "or":
        return f"or, b > {used['b_threshold']:g}"
    if summary["method"] == "evidence":
        return (
            f"evidence, memory {used['memory_s']:g} s, prior {used['prior']:.4f}, "
            f"empty up to P = {used['cleared']:.2g}"
        )
    if summary["method"] != "paper":
        knobs = [f"{name} {used[name]:.4g}" for name in _KNOBS if name in used]
        return ", ".join([summary["method"], *knobs])
    return (
        f"paper, alpha {used['alpha']:g}, lambda {used['decay']:g} per {used['decay_unit']}, prior "
        f"{used['prior']:.3f}, TPR {used['true_positive_rate']:g}, FPR {used['false_positive_rate']:g}, "
        f"N {used['fleet_size']}"
    )
