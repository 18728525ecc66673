"""`crowdfence explain`: why a zone is closed."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.cli import console, options
from crowdfence.cli.asked_stamp import asked_stamp
from crowdfence.cli.export import At, RunFolder
from crowdfence.cli.wording import counted
from crowdfence.iso_time import iso_utc
from crowdfence.legible import first_of
from crowdfence.zones.belief import FOR_GOOD
from crowdfence.zones.reasons import REASONS
from crowdfence.zones.square_metres import square_metres

if TYPE_CHECKING:
    from crowdfence.zones import Zone, ZoneEvent, ZoneSet
    from crowdfence.zones.history import ZoneHistory

_MOST_NAMED = 12
"""A national file has thousands of zones."""
_HAPPENED = {
    "created": "appeared",
    "split": "came out of {other}",
    "merged": "went into {other}",
    "expired": "ended",
}


def explain(
    run: RunFolder,
    zone: Annotated[str, typer.Option("--zone", "-z", help="Id of the zone, such as Z1.")],
    at: At = "last",
    as_json: options.Json = False,
) -> None:
    """What a no-fly zone of a run rests on: who saw it, when, how sure, until when it holds, and why it is
    still closed."""
    from crowdfence.result_folder import open_history

    history = open_history(run)
    index = history.index_at(asked_stamp(at, history))
    stamp_ns, zones = history.stamps_ns[index], history.sets[index]
    found = next((one for one in zones.closed if one.id == zone), None)
    if found is None:
        raise ValueError(_absent(zone, stamp_ns, zones, history))
    events = [event for event in history.events if _concerns(event, zone) and event.stamp_ns <= stamp_ns]
    if as_json:
        console.print_json(_json(found, stamp_ns, events))
        return
    out = console.stdout()
    facts = _facts(found, zones, stamp_ns, history.description.get("method"))
    out.print(console.facts(f"zone {found.id} at {iso_utc(stamp_ns)}", facts))
    if found.evidence:
        out.print(_evidence_table(found, stamp_ns))
    for event in events:
        if event.kind in _HAPPENED:
            other = event.other if event.id == zone else event.id
            verb = _HAPPENED[event.kind] if event.id == zone else _of_others(event)
            out.print(console.escaped(f"{iso_utc(event.stamp_ns)}  {verb.format(other=other)}"))


def _concerns(event: ZoneEvent, zone: str) -> bool:
    return zone in (event.id, event.other)


def _of_others(event: ZoneEvent) -> str:
    return "{other} came out of it" if event.kind == "split" else "{other} went into it"


def _absent(zone: str, stamp_ns: int, zones: ZoneSet, history: ZoneHistory) -> str:
    there = first_of([one.id for one in zones.closed], _MOST_NAMED) or "none"
    past = [event for event in history.events if event.id == zone and event.kind != "updated"]
    story = "; ".join(
        f"{iso_utc(event.stamp_ns)} {_HAPPENED[event.kind].format(other=event.other)}" for event in past
    )
    return f"there is no zone {zone} at {iso_utc(stamp_ns)}; zones then: {there}" + (
        f"; zone {zone}: {story}" if story else ""
    )


def _facts(zone: Zone, zones: ZoneSet, stamp_ns: int, method: str | None) -> dict[str, str]:
    band = zone.band
    facts = {
        **({} if zone.name is None else {"called": zone.name}),
        "why closed": REASONS.get(zone.reason or "", "not known"),
        "what": f"{zone.kind}, {zone.restriction.replace('_', ' ')}",
        "closed": f"{square_metres(zone.polygon.area)}, {band.lower_m:g} to {band.upper_m:g} m {band.datum}",
    }
    if zone.kind != "crowd":
        return facts
    facts |= {
        "crowd": f"{square_metres(zone.area_m2)} in {counted(zone.cell_count, 'column')}",
        "probability": f"up to {zone.probability_max:.3f}, mean {zone.probability_mean:.3f}; "
        f"crowd from {zones.threshold:.3f}",
        "interval": _interval(zone),
        "last look": f"{_ago(zone.last_seen_ns, stamp_ns)}; at its oldest part "
        f"{_ago(zone.oldest_look_ns, stamp_ns)}",
        "since": "not known" if zone.created_ns is None else f"{_ago(zone.created_ns, stamp_ns)}",
        "until": _until(zone, stamp_ns, method),
        "seen by": ", ".join(zone.seen_by) or "not known",
    }
    return facts


def _interval(zone: Zone) -> str:
    if zone.interval is None:
        return "none: the method's probability is no rate that was measured"
    low, high = zone.interval
    return f"{low:.3f} to {high:.3f}: of ten such places the share of crowd lies in it nine times"


def _until(zone: Zone, stamp_ns: int, method: str | None = None) -> str:
    if method == FOR_GOOD:
        return "never: the method or opens nothing that it called crowd once"
    if zone.valid_until_ns is not None:
        return f"{iso_utc(zone.valid_until_ns)} if nobody looks again"
    text = "none of its own: only a look can open it"
    if zone.forgotten_ns is None:
        return text
    if zone.forgotten_ns <= stamp_ns:
        if zone.reason in ("seen", "held"):  # drones look at it now; that they disagree is no forgetting
            return text
        return f"{text}; it is not known any more whether anybody is there"
    return f"{text}; if nobody looks, not known from {iso_utc(zone.forgotten_ns)} on"


def _ago(then_ns: int, now_ns: int) -> str:
    return f"{(now_ns - then_ns) / 1e9:.1f} s ago"


def _evidence_table(zone: Zone, stamp_ns: int) -> Any:
    from rich.table import Table

    table = Table(title="what the drones showed", title_justify="left", title_style="bold", box=None)
    for name in ("drone", "last look", "largest value", "of the zone", "from", "looks"):
        table.add_column(name, justify="left" if name == "drone" else "right")
    for look in zone.evidence:
        table.add_row(
            console.escaped(look.drone),
            _ago(look.last_look_ns, stamp_ns),
            f"{look.value:.2f}",
            f"{look.seen_share:.0%}",
            f"{look.range_m:.0f} m",
            str(look.looks),
        )
    return table


def _json(zone: Zone, stamp_ns: int, events: list[ZoneEvent]) -> dict[str, Any]:
    is_crowd = zone.kind == "crowd"
    return {
        "zone": zone.id,
        "name": zone.name,
        "kind": zone.kind,
        "restriction": zone.restriction,
        "stamp_ns": stamp_ns,
        "reason": zone.reason,
        "why": REASONS.get(zone.reason or ""),
        "closed_m2": zone.polygon.area,
        "crowd_m2": zone.area_m2 if is_crowd else None,
        "probability_max": zone.probability_max if is_crowd else None,
        "probability_mean": zone.probability_mean if is_crowd else None,
        "interval": zone.interval,
        "last_seen_ns": zone.last_seen_ns if is_crowd else None,
        "oldest_look_ns": zone.oldest_look_ns if is_crowd else None,
        "created_ns": zone.created_ns,
        "valid_until_ns": zone.valid_until_ns,
        "forgotten_ns": zone.forgotten_ns,
        "seen_by": list(zone.seen_by),
        "evidence": [asdict(look) for look in zone.evidence],
        "events": [asdict(event) for event in events],
    }
