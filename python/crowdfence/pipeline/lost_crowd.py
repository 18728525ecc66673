"""Crowd that a detector showed and that no zone speaks of: it met no ground of the map, or became no crowd
there. It must not vanish without a word."""

from __future__ import annotations

from collections.abc import Mapping

from crowdfence._core import CrowdMass

MAX_LOST_SHARE = 0.01
"""A drone that loses more of its crowd than this is warned of."""

LEAST_NAMED_SHARE = 0.0005
"""What rounds to 0.0 % is not worth a word."""

LOST = {
    "out_of_range": ("meets ground beyond the range", "raise --max-range-m"),
    "hole": ("falls through holes of the map", "fill them or take a map without"),
    "off_map": (
        "lies beside the map",
        "take a map that reaches further; map and poses must share one frame",
    ),
    "sky": ("lies above the horizon", "false alarms of the detector, or a wrong attitude"),
    "unusable": (
        "has no ray to the ground",
        "the lens model ends before the image does, or the camera is below the map's ground: heights of "
        "poses and map must count from the same level",
    ),
}
"""What became of the crowd of each fate but `ground`, and what to do about it."""


def shares(mass: CrowdMass) -> dict[str, float | None]:
    """Share of each fate in a crowd mass, ground first; None where there is no crowd."""
    total = mass.total
    return {fate: part / total if total > 0.0 else None for fate, part in mass.by_fate().items()}


def lost_crowd_warnings(masses: Mapping[str, CrowdMass]) -> list[str]:
    """One sentence for each drone of which more than `MAX_LOST_SHARE` of the crowd met no ground. Where no
    drone is above that, all of them together are not."""
    warnings = (lost_crowd_warning(drone, mass) for drone, mass in masses.items())
    return [warning for warning in warnings if warning is not None]


def lost_crowd_warning(drone: str, mass: CrowdMass) -> str | None:
    """The sentence for one drone; None where no more than `MAX_LOST_SHARE` of its crowd met no ground."""
    if not mass.lost > MAX_LOST_SHARE * mass.total:
        return None
    lost = {fate: part / mass.total for fate, part in mass.by_fate().items() if fate in LOST}
    parts = (
        f"{lost[fate]:.1%} {what} ({advice})"
        for fate, (what, advice) in sorted(LOST.items(), key=lambda entry: -lost[entry[0]])
        if lost[fate] >= LEAST_NAMED_SHARE
    )
    everything = mass.lost / mass.total
    return f"{drone}: {everything:.1%} of the crowd it shows is not on the map: {', '.join(parts)}"


def unheeded_crowd_warning(masses: Mapping[str, CrowdMass], threshold: float) -> str | None:
    """The sentence for a run in which no ground ever was crowd, though pictures showed some on the map: its
    files look like those of a flight over empty ground. None where they showed none."""
    drones = [drone for drone, mass in masses.items() if mass.ground > 0.0]
    if not drones:
        return None
    return (
        f"pictures of {', '.join(drones)} show crowd on the map, and no ground ever reached P >= "
        f"{threshold:.3g}: nothing was closed for it. False alarms, or a threshold or setting out of reach?"
    )
