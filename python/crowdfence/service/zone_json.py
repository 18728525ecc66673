"""A zone for JSON: what it closes, what it rests on and why it is still closed."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from crowdfence.service.stamps import moment_json
from crowdfence.zones import Zone
from crowdfence.zones.history import rings_of
from crowdfence.zones.reasons import REASONS

Marks = Mapping[str, Mapping[str, Any]]
"""What operators did to zones, by id: "locked", "operator" (name, reason), "dismissed" (until_ns), "kind"."""


def zone_json(zone: Zone, mark: Mapping[str, Any]) -> dict[str, Any]:
    """One zone; `mark` is what operators did to it."""
    is_crowd = zone.kind == "crowd"
    return {
        "id": zone.id,
        "name": zone.name,
        "kind": mark.get("kind", zone.kind),
        "restriction": zone.restriction,
        "reason": zone.reason,
        "why": _why(zone, mark),
        "polygon": rings_of(zone.polygon),
        "crowd_outline": None if zone.crowd_outline is None else rings_of(zone.crowd_outline),
        "closed_m2": zone.polygon.area,
        "crowd_m2": zone.area_m2 if is_crowd else 0.0,
        "probability_max": zone.probability_max if is_crowd else None,
        "probability_mean": zone.probability_mean if is_crowd else None,
        "interval": None if zone.interval is None else list(zone.interval),
        **moment_json("last_seen", zone.last_seen_ns if is_crowd else None),
        **moment_json("oldest_look", zone.oldest_look_ns if is_crowd else None),
        **moment_json("created", zone.created_ns),
        **moment_json("valid_until", zone.valid_until_ns),
        "seen_by": list(zone.seen_by),
        "band": {"lower_m": zone.band.lower_m, "upper_m": zone.band.upper_m, "datum": zone.band.datum},
        "ground": {
            "lower_m": zone.lower_m,
            "upper_m": zone.upper_m,
            "is_known": zone.ground_is_known,
        },
        "evidence": _evidence(zone),
        "locked": bool(mark.get("locked", False)),
        "operator": mark.get("operator"),
        "dismissed": mark.get("dismissed"),
    }


def _why(zone: Zone, mark: Mapping[str, Any]) -> str:
    sentence = REASONS.get(zone.reason or "", "not known")
    operator = mark.get("operator")
    if operator is None:
        return sentence
    if mark.get("kind") == "operator":
        return f"{operator['name']} closed it: {operator['reason']}"
    if mark.get("dismissed"):
        return f"{sentence}; {operator['name']} lets drones pass for a while: {operator['reason']}"
    return f"{sentence}; {operator['name']} locked it: {operator['reason']}"


def _evidence(zone: Zone) -> Sequence[dict[str, Any]]:
    return [
        {
            "drone": look.drone,
            **moment_json("last_look", look.last_look_ns),
            "value": look.value,
            "seen_share": look.seen_share,
            "range_m": look.range_m,
            "looks": look.looks,
        }
        for look in zone.evidence
    ]
