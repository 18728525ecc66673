"""The ways of projecting that the benchmarks compare: arguments of `project` and `CrowdMap`."""

from typing import Any

COVERAGES = ("rays", "full")
SURFACES = ("voxels", "planes")


def projections() -> dict[str, dict[str, Any]]:
    """By name."""
    return {
        f"{surface} {coverage}": {"surface": surface, "coverage": coverage}
        for surface in SURFACES
        for coverage in COVERAGES
    }
