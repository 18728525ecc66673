"""The ways of projecting that the benchmarks compare: arguments of `project` and `CrowdMap`."""

import inspect
from typing import Any

from crowdfence import project

COVERAGES = ("rays", "full")
SURFACES = ("voxels", "true")


def projections() -> dict[str, dict[str, Any]]:
    """By name. A build whose only surface is that of the voxels knows no `surface`."""
    surfaces = [{"surface": name} for name in SURFACES] if _knows_surfaces() else [{}]
    return {
        " ".join([*surface.values(), coverage]): {**surface, "coverage": coverage}
        for surface in surfaces
        for coverage in COVERAGES
    }


def _knows_surfaces() -> bool:
    return "surface" in inspect.signature(project).parameters
