"""The page: a summary and its zones put into `page.html`. Nothing is loaded from elsewhere, nothing runs."""

from __future__ import annotations

from base64 import b64encode
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib.resources import files
from string import Template
from typing import TYPE_CHECKING, Any

from crowdfence.exports.colours import STATE_COLOURS
from crowdfence.voxel_state import VoxelState
from crowdfence.zones.belief import FOR_GOOD
from crowdfence.zones.reasons import REASONS

if TYPE_CHECKING:
    from crowdfence.zones import Zone, ZoneSet

STATES = {
    VoxelState.CROWD: ("crowd", "Closed: people stand here, or may."),
    VoxelState.NOT_CLEARED: (
        "looked at, not cleared",
        "A drone looked, but too far, too flat or too briefly to rule a crowd out. Not safe.",
    ),
    VoxelState.EMPTY: ("empty", "Seen well and lately, without a crowd."),
    VoxelState.STALE: ("stale", "Was empty, but too long ago to count. Not safe."),
    VoxelState.OCCLUDED: ("hidden", "Inside the pictures, but behind something. Not safe."),
    VoxelState.NEVER_SEEN: ("never seen", "No camera looked. Not safe."),
}
"""What each state is called, and what it means for a pilot."""

_MOST_REFUSALS = 200
_TOLD_ABOVE = ("threshold", "min_area_m2")
"""Of the rules of zones; among the parameters `threshold` is the method's own, whatever was given."""


def report_page(
    summary: Mapping[str, Any], zones: ZoneSet, stamp_ns: int, picture: bytes, version: str
) -> str:
    """HTML of a run: its summary (`run_summary.summarise`), the zones at its last instant, the picture of the
    map (PNG)."""
    frames, refused = sum(summary["frames"].values()), list(summary["refused"])
    return Template(files(__package__).joinpath("page.html").read_text(encoding="utf-8")).substitute(
        title=escape(summary["recording"]),
        when=escape(f"{_moment(summary['first_instant'])} to {_moment(summary['last_instant'])} UTC"),
        fleet=escape(", ".join(summary["frames"])),
        cards=_cards(summary, zones, frames, refused),
        picture=b64encode(picture).decode("ascii"),
        zones=_zones(zones, stamp_ns, summary["method"]),
        left_out=_left_out(summary),
        states=_states(summary["area_m2"]),
        warnings=_items(summary["warnings"], "Nothing was doubtful."),
        refused=_refused(refused),
        parameters=_rows(_parameters(summary)),
        version=escape(version),
    )


def _cards(summary: Mapping[str, Any], zones: ZoneSet, frames: int, refused: Sequence[str]) -> str:
    cards = (
        (f"{len(zones.closed)}", "closed zone" if len(zones.closed) == 1 else "closed zones", "closed"),
        (f"{zones.closed_m2:,.0f} m²", "closed ground", "closed"),
        (f"{summary['area_m2']['empty']:,.0f} m²", "known to be empty", "empty"),
        (f"{frames:,}", f"pictures used, {len(refused)} refused", ""),
        (f"{len(summary['warnings'])}", "warnings", "warned" if summary["warnings"] else ""),
    )
    return "".join(
        f'<div class="card {kind}"><b>{escape(value)}</b><span>{escape(what)}</span></div>'
        for value, what, kind in cards
    )


def _zones(zones: ZoneSet, stamp_ns: int, method: str) -> str:
    if not zones.closed:
        return '<p class="quiet">No zone is closed. Ground that nobody saw is not known to be safe.</p>'
    head = "".join(
        f"<th{' class=number' if number else ''}>{name}</th>"
        for name, number in (
            ("zone", False),
            ("why it is closed", False),
            ("crowd", True),
            ("closed", True),
            ("largest P", True),
            ("last look", True),
            ("ends", True),
            ("seen by", False),
        )
    )
    rows = "".join(f"<tr>{_zone(zone, stamp_ns, method)}</tr>" for zone in zones.closed)
    return f'<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>'


def _zone(zone: Zone, stamp_ns: int, method: str) -> str:
    crowd = zone.kind == "crowd"
    ends = "by a look only" if zone.valid_until_ns is None else f"in {_s(zone.valid_until_ns - stamp_ns)}"
    if method == FOR_GOOD:
        ends = "never"
    why = REASONS.get(zone.reason or "", zone.kind)
    called = "" if zone.name is None else f"<br>{escape(zone.name)}"
    cells = (
        (f"<b>{escape(zone.id)}</b>{called}", ""),
        (escape(why), ""),
        (f"{zone.area_m2:,.0f} m²" if crowd else "-", "number"),
        (f"{zone.polygon.area:,.0f} m²", "number"),
        (f"{_bar(zone.probability_max)}{_probability(zone.probability_max)}" if crowd else "-", "number"),
        (f"{_s(stamp_ns - zone.last_seen_ns)} ago" if crowd else "-", "number"),
        (ends if crowd else "-", "number"),
        (escape(", ".join(zone.seen_by)) or "-", ""),
    )
    return "".join(f'<td class="{kind}">{text}</td>' for text, kind in cells)


def _probability(value: float) -> str:
    """As the service's page writes it: never as 0 or 1 unless it is."""
    if 0 < value < 0.001:
        return "&lt; 0.001"
    if 0.999 < value < 1:
        return "&gt; 0.999"
    return f"{value:.{3 if value < 0.1 else 2}f}"


def _bar(share: float) -> str:
    return f'<i class="bar"><i style="width:{100 * share:.0f}%"></i></i>'


def _s(duration_ns: int) -> str:
    return f"{duration_ns / 1e9:.1f} s"


def _left_out(summary: Mapping[str, Any]) -> str:
    """Crowd that no zone covers is never left out in silence."""
    regions = summary["dropped_regions"]
    if not regions:
        return ""
    where = "1 region" if regions == 1 else f"{regions} regions"
    covered = (
        "closed as ground that is not known to be empty" if summary["unseen_closed_m2"] else "in no zone"
    )
    return (
        f'<p class="note">{summary["dropped_area_m2"]:.0f} m² of crowd lie in {where} smaller than '
        f"{summary['min_area_m2']:g} m²: {covered}.</p>"
    )


def _states(area_m2: Mapping[str, float]) -> str:
    rows = []
    for state, (name, meaning) in STATES.items():
        area = area_m2.get(state.name.lower())
        shown = "-" if area is None else f"{area:,.0f} m²"
        colour = "#{:02x}{:02x}{:02x}".format(*STATE_COLOURS[state])
        rows.append(
            f'<tr><td><i class="swatch" style="background:{colour}"></i><b>{escape(name)}</b></td>'
            f'<td>{escape(meaning)}</td><td class="number">{shown}</td></tr>'
        )
    return f'<div class="wide"><table><tbody>{"".join(rows)}</tbody></table></div>'


def _items(sentences: Iterable[str], none: str) -> str:
    items = "".join(f"<li>{escape(sentence)}</li>" for sentence in sentences)
    return f"<ul>{items}</ul>" if items else f'<p class="quiet">{none}</p>'


def _refused(refused: Sequence[str]) -> str:
    shown = _items(refused[:_MOST_REFUSALS], "Every picture was used.")
    more = len(refused) - _MOST_REFUSALS
    return shown + (f'<p class="quiet">and {more} more, all in summary.json</p>' if more > 0 else "")


def _parameters(summary: Mapping[str, Any]) -> dict[str, str]:
    terrain, detector = summary["terrain"], summary["detector"]
    why = f", {terrain['voxel_size_why']}" if terrain.get("voxel_size_why") else ""
    model = "as recorded"
    if "name" in detector:
        model = " ".join(filter(None, (detector["name"], detector["version"])))
        model += f", sha256 {detector['sha256']}" if detector["sha256"] else ""
        model = f"as recorded, by {model}" if detector["heatmaps"] == "recorded" else model
    used = {name: _value(value) for name, value in summary["parameters"].items() if name not in _TOLD_ABOVE}
    rules = {name: _value(value) for name, value in summary["zone_rules"].items() if name not in _TOLD_ABOVE}
    return {
        "map": f"{terrain['voxels']:,} cells of {terrain['voxel_size_m']:g} m{why}; "
        f"{terrain['seen_voxels']:,} of them seen",
        "heatmaps": model,
        "poses": _poses(summary),
        **_masks(summary),
        "method": summary["method"],
        "threshold": f"{summary['threshold']:.4g}",
        "smallest zone": f"{summary['min_area_m2']:g} m²",
        **used,
        **rules,
    }


def _value(value: object) -> str:
    if value is None:
        return "no limit"
    return f"{value:g}" if isinstance(value, float) else f"{value}"


def _poses(summary: Mapping[str, Any]) -> str:
    """What was done to them: whoever looks for a zone in the wrong place asks that first."""
    righted = summary["alignment"]  # of a file that may say anything
    done = [f"{drone} put right by an alignment" for drone in righted] if isinstance(righted, Mapping) else []
    for drone, noise in sorted((summary["pose_noise"] or {}).items()):
        done.append(f"{drone} smoothed by {noise['position_m']:.2g} m and {noise['attitude_deg']:.2g} deg")
    return "; ".join(done) or "as recorded"


def _masks(summary: Mapping[str, Any]) -> dict[str, str]:
    hidden = summary.get("hidden_by_camera_mask", {})
    told = "; ".join(f"{share:.1%} of those of {drone}" for drone, share in hidden.items())
    return {"pictures": f"a camera mask hides {told}"} if told else {}


def _rows(facts: Mapping[str, str]) -> str:
    rows = (f"<tr><td>{escape(name)}</td><td>{escape(value)}</td></tr>" for name, value in facts.items())
    return f'<div class="wide"><table><tbody>{"".join(rows)}</tbody></table></div>'


def _moment(iso: str) -> str:
    """To the second, as people write it."""
    return iso[:19].replace("T", " ")
