"""The zones of a crowd map from instant to instant.

    what the map says -> columns of crowd -> regions -> zones with ids that last -> what is closed

Ground is opened by a look, not by forgetting: where a method forgets crowd towards what is not known, its
ground stays closed until somebody looks again.

An instant costs what was seen at it and what is closed, and not what was seen before; outlines, buffers and
fewer corners are worked out again only for zones whose columns changed. The same instants give the same
zones, to the bit.
"""

from __future__ import annotations

import io
import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import CrowdColumns, CrowdMap, Observation, Terrain
from crowdfence.zones.belief import ColumnBelief, forgotten_ns, require_above_prior
from crowdfence.zones.evidence import DroneEvidence, joined, looks_at, with_looks
from crowdfence.zones.find import by_region, zones_of_regions
from crowdfence.zones.ground_heights import GroundHeights
from crowdfence.zones.grow import grown, without_small_holes
from crowdfence.zones.outline import outlines
from crowdfence.zones.regions import Runs
from crowdfence.zones.rules import ZoneRules
from crowdfence.zones.simplify import simplified
from crowdfence.zones.sorted_keys import are_among
from crowdfence.zones.tracker import Track, ZoneEvent, column_keys, column_places
from crowdfence.zones.unseen import UnseenGround
from crowdfence.zones.zone import Reason, Zone, ZoneSet, closed_of
from crowdfence.zones.zone_ground import ZoneGround

if TYPE_CHECKING:
    from shapely import MultiPolygon, Polygon

UNSEEN_ID = "UNSEEN"


@dataclass(frozen=True, slots=True, eq=False)
class _Shape:
    """What a zone closed at the instant before, and the columns that it follows from."""

    columns: NDArray[np.int64]
    crowd: Polygon | MultiPolygon
    closed: Polygon | MultiPolygon
    ground_m: tuple[float, float] | None
    """Lowest and highest ground of all that is closed, where that is more than crowd and the map has any."""
    leaves_map: bool
    """Whether the map lacks ground of what is closed."""


class ZoneEngine:
    """Follows the zones of one crowd map; `step` after every instant, in order."""

    def __init__(self, crowd_map: CrowdMap, rules: ZoneRules, static: Sequence[Zone] = ()) -> None:
        """`static` are zones that somebody else drew: they are part of every set, and never end. ValueError
        for a threshold at or below the prior of a method that forgets towards it."""
        require_above_prior(crowd_map, rules.threshold)
        self.rules = rules
        self._crowd_map = crowd_map
        self._static = closed_of(static)
        self._ground = ZoneGround(crowd_map, rules)
        self._shapes = _Shapes(crowd_map.terrain, rules)
        self._unseen = UnseenGround(crowd_map.terrain) if rules.close_unseen else None
        self.crowd_voxel_ids = np.empty(0, dtype=np.int64)
        """Voxels at or above the threshold at the last step, sorted."""
        # A method without this parameter weighs values in its own way.
        self._shows_crowd = float(crowd_map.method.parameters.get("b_threshold", 0.5))
        self._evidence: dict[str, dict[str, DroneEvidence]] = {}
        self._looks_now: dict[str, list[DroneEvidence]] = {}

    @property
    def shown_ids(self) -> NDArray[np.int64]:
        """Voxels that one look clearly showed as crowd by itself, as of the last step, sorted."""
        return self._ground.closed.shown_ids

    def step(self, stamp_ns: int, observations: Iterable[Observation] = ()) -> ZoneSet:
        """The zones at the newest instant, or later if nothing came. `observations` are those of the instant:
        what the drones saw becomes the zones' evidence."""
        rules = self.rules
        ground = self._ground.step(stamp_ns)
        belief, keys, region, tracks = ground.belief, ground.keys, ground.region, ground.tracks
        columns = belief.columns
        self.crowd_voxel_ids = self._at_threshold(columns, stamp_ns)
        shapes, updated = self._shapes.step(tracks, stamp_ns)
        events = [*ground.events, *updated]
        self._follow_evidence(tracks, events, columns, region, list(observations))
        order, first = by_region(region, len(tracks))
        inside = np.split(order, first[1:]) if tracks else []
        zones = zones_of_regions(self._crowd_map, columns, region, [shape.crowd for shape in shapes])
        known_until_ns = forgotten_ns(self._crowd_map, columns, stamp_ns, rules.off_threshold)
        return ZoneSet(
            zones=tuple(
                self._told(zone, track, shape, belief, known_until_ns, members)
                for zone, track, shape, members in zip(zones, tracks, shapes, inside, strict=True)
            ),
            threshold=rules.threshold,
            min_area_m2=rules.min_area_m2,
            dropped_count=len(ground.dropped),
            dropped_area_m2=float(sum(ground.dropped)) * self._crowd_map.terrain.voxel_size_m**2,
            unseen=self._unknown_ground(stamp_ns, keys[region >= 0], keys[region < 0]),
            static=self._static,
            events=tuple(events),
        )

    def to_bytes(self) -> bytes:
        """What the next step depends on beside the crowd map, to go on from."""
        arrays = {
            "closed_voxels": self._ground.closed.voxel_ids,
            "closed_looked_ns": self._ground.closed.looked_ns,
            "closed_below": self._ground.closed.below,
            "crowd_voxel_ids": self.crowd_voxel_ids,
            **self._ground.tracker.arrays(),
        }
        told = {
            "rules": asdict(self.rules),
            "evidence": {
                name: {drone: asdict(look) for drone, look in looks.items()}
                for name, looks in self._evidence.items()
            },
            **self._ground.tracker.to_json(),
            "outlines": self._shapes.to_json(self._ground.tracker.alive),
        }
        file = io.BytesIO()
        np.savez(file, allow_pickle=False, told=np.frombuffer(json.dumps(told).encode(), np.uint8), **arrays)
        return file.getvalue()

    def restore(self, data: bytes) -> None:
        """What `to_bytes` gave, for an engine on the crowd map of that moment. Of other rules than before, a
        larger buffer, its own hold at once. ValueError for anything else."""
        try:
            with np.load(io.BytesIO(data), allow_pickle=False) as arrays:
                told = json.loads(arrays["told"].tobytes())
                if "closed_voxels" in arrays:
                    closed, below = arrays["closed_voxels"], arrays["closed_below"]
                else:  # a build that kept columns: all that was seen of them
                    closed, below = self._seen_in(arrays["closed"]), None
                if "closed_looked_ns" in arrays:
                    looked_ns = arrays["closed_looked_ns"]
                else:  # a build that took for new what was seen after the last step
                    looked_ns = np.full(len(closed), told["stepped_ns"], np.int64)
                if (self._crowd_map.last_seen_ns(closed) < 0).any():
                    raise ValueError(
                        "that is no state of zones on this map: it closes what nobody has seen here"
                    )
                self._ground.closed.restore(closed, looked_ns, below)
                self.crowd_voxel_ids = arrays["crowd_voxel_ids"]
                self._evidence = {
                    name: {drone: DroneEvidence(**look) for drone, look in looks.items()}
                    for name, looks in told["evidence"].items()
                }
                self._ground.tracker.restore(told, arrays)
                alive = self._ground.tracker.alive
                # Builds of before did not say which rules they kept: those of now, as they asked for.
                if told.get("rules", asdict(self.rules)) == asdict(self.rules):
                    self._shapes.restore(told["outlines"], alive)
                else:
                    self._shapes.draw(alive)
        except (KeyError, TypeError, EOFError, OSError, RuntimeError, BadZipFile) as error:
            raise ValueError(f"that is no state of zones: {type(error).__name__} {error}") from error

    def _seen_in(self, keys: NDArray[np.int64]) -> NDArray[np.int64]:
        """Voxels of columns that somebody has seen, sorted."""
        seen = self._crowd_map.seen_ids()
        indices = self._crowd_map.terrain.voxel_indices(seen)[:, :2]
        return seen[are_among(column_keys(indices), keys)]

    def _at_threshold(self, columns: CrowdColumns, stamp_ns: int) -> NDArray[np.int64]:
        ids = np.sort(columns.voxel_ids)
        return ids[self._crowd_map.probability(stamp_ns, ids) >= self.rules.threshold]

    def _follow_evidence(
        self,
        tracks: Sequence[Track],
        events: Sequence[ZoneEvent],
        columns: CrowdColumns,
        region: NDArray[np.int64],
        observations: list[Observation],
    ) -> None:
        before, after = self._evidence, {}
        self._looks_now = {}
        origins: dict[str, list[str]] = {}
        for event in events:
            if event.other is not None:
                old, new = (event.other, event.id) if event.kind == "split" else (event.id, event.other)
                origins.setdefault(new, []).append(old)
        order, first = by_region(np.repeat(region, columns.crowd_count), len(tracks))
        voxels = np.split(columns.voxel_ids[order], first[1:])
        looks = looks_at(voxels[: len(tracks)], observations, self._shows_crowd)
        for track, looks_now in zip(tracks, looks, strict=True):
            known = joined(before.get(name, {}) for name in (track.id, *origins.get(track.id, [])))
            after[track.id] = with_looks(known, looks_now)
            self._looks_now[track.id] = looks_now
        self._evidence = after

    def _told(
        self,
        zone: Zone,
        track: Track,
        shape: _Shape,
        belief: ColumnBelief,
        known_until_ns: NDArray[np.int64] | None,
        inside: NDArray[np.int64],
    ) -> Zone:
        """The zone with its name, what it closes and what it rests on; `inside` are its columns."""
        evidence = self._evidence[track.id]
        until_ns, interval = belief.valid_until_ns, belief.interval
        lower_m, upper_m = shape.ground_m or (zone.lower_m, zone.upper_m)
        return replace(
            zone,
            id=track.id,
            polygon=shape.closed,
            crowd_outline=None if shape.closed is shape.crowd else shape.crowd,
            lower_m=min(zone.lower_m, lower_m),
            upper_m=max(zone.upper_m, upper_m),
            restriction=self.rules.restriction,
            band=self.rules.band,
            leaves_map=shape.leaves_map,
            created_ns=track.created_ns,
            valid_until_ns=None if until_ns is None else int(until_ns[inside].max()),
            forgotten_ns=None if known_until_ns is None else int(known_until_ns[inside].max()),
            interval=None if interval is None else _largest(interval[inside]),
            evidence=tuple(evidence[drone] for drone in sorted(evidence)),
            reason=self._reason(zone, self._looks_now[track.id]),
        )

    def _reason(self, zone: Zone, looks_now: Sequence[DroneEvidence]) -> Reason:
        if any(look.value > self._shows_crowd for look in looks_now):
            return "seen"
        if zone.probability_max < self.rules.threshold:
            return "held" if looks_now or not self._ground.closed.forgets_to_unknown else "not_looked_at"
        return "not_cleared" if looks_now else "not_looked_at"

    def _unknown_ground(
        self, stamp_ns: int, in_zones: NDArray[np.int64], in_no_zone: NDArray[np.int64]
    ) -> tuple[Zone, ...]:
        """One zone of many parts, as it lies: a buffer around ground that nobody knows would mean nothing.
        `in_zones` are keys of crowd in a zone, `in_no_zone` those whose regions are too small for one."""
        if self._unseen is None:
            return ()
        rules, terrain = self.rules, self._crowd_map.terrain
        runs = self._unseen.at(
            self._crowd_map, stamp_ns, rules.threshold, rules.stale_after_s, in_zones, in_no_zone
        )
        if not len(runs):
            return ()
        (outline,) = outlines(runs, np.zeros(len(runs), dtype=np.int64), terrain)
        zone = Zone.of_no_look(
            UNSEEN_ID,
            outline,
            "unseen",
            "never_cleared",
            ground_m=(float(terrain.bounds[0, 2]), float(terrain.bounds[1, 2])),
            leaves_map=self._unseen.has_holes,
            restriction=rules.restriction,
            band=rules.band,
        )
        return (zone,)


class _Shapes:
    """What the zones that are alive close, outlined anew only where their columns changed."""

    def __init__(self, terrain: Terrain, rules: ZoneRules) -> None:
        self._terrain = terrain
        self._rules = rules
        self._heights = GroundHeights(terrain) if rules.closes_more_than_crowd else None
        self._shapes: dict[str, _Shape] = {}

    def to_json(self, alive: Sequence[Track]) -> list[list[str | None]]:
        """Outlines of the zones that are alive: the crowd's, and what is closed where that is more."""
        shapes = [self._shapes[track.id] for track in alive]
        return [
            [shape.crowd.wkb_hex, None if shape.closed is shape.crowd else shape.closed.wkb_hex]
            for shape in shapes
        ]

    def restore(self, outlines_hex: Sequence[Sequence[str | None]], alive: Sequence[Track]) -> None:
        """What `to_json` gave, for the same zones."""
        import shapely

        self._shapes = {}
        for track, (crowd_hex, closed_hex) in zip(alive, outlines_hex, strict=True):
            crowd = shapely.from_wkb(crowd_hex)
            closed = crowd if closed_hex is None else shapely.from_wkb(closed_hex)
            self._shapes[track.id] = self._shape(track.columns, crowd, closed)

    def draw(self, alive: Sequence[Track]) -> None:
        """Their outlines anew: those of before were drawn by other rules, and only columns that change are
        outlined at a step."""
        outlined = self._outlined([track.columns for track in alive])
        self._shapes = {track.id: shape for track, shape in zip(alive, outlined, strict=True)}

    def step(self, tracks: Sequence[Track], stamp_ns: int) -> tuple[list[_Shape], list[ZoneEvent]]:
        """The shape of each zone, and which of them close other ground than before."""
        before = self._shapes
        changed = [
            track
            for track in tracks
            if track.id not in before or not np.array_equal(before[track.id].columns, track.columns)
        ]
        outlined = self._outlined([track.columns for track in changed])
        fresh = {track.id: shape for track, shape in zip(changed, outlined, strict=True)}
        self._shapes = {track.id: fresh.get(track.id) or before[track.id] for track in tracks}
        updated = [ZoneEvent(stamp_ns, "updated", track.id) for track in changed if track.id in before]
        return [self._shapes[track.id] for track in tracks], updated

    def _outlined(self, regions: Sequence[NDArray[np.int64]]) -> list[_Shape]:
        if not regions:
            return []
        keys = np.concatenate(list(regions))
        region = np.repeat(np.arange(len(regions)), [len(columns) for columns in regions])
        order = np.argsort(keys)
        runs, run_region = _runs_of_regions(column_places(keys[order]), region[order])
        shapes = outlines(runs, run_region, self._terrain)
        return [
            self._shape(columns, shape, self._closing(shape))
            for columns, shape in zip(regions, shapes, strict=True)
        ]

    def _shape(
        self, columns: NDArray[np.int64], crowd: Polygon | MultiPolygon, closed: Polygon | MultiPolygon
    ) -> _Shape:
        if self._heights is None or closed is crowd:
            return _Shape(columns, crowd, closed, None, leaves_map=False)
        ground_m, leaves_map = self._heights.within(closed), not self._heights.hold(closed)
        return _Shape(columns, crowd, closed, ground_m, leaves_map)

    def _closing(self, crowd: Polygon | MultiPolygon) -> Polygon | MultiPolygon:
        """Holes, then the buffer, then fewer corners: each step covers what it was given."""
        rules = self._rules
        closed = grown(without_small_holes(crowd, rules.max_hole_m2), rules.buffer_m)
        closed = without_small_holes(closed, rules.max_hole_m2)
        return simplified(closed, tolerance_m=rules.simplify_m, max_vertices=rules.max_vertices)


def _runs_of_regions(columns: NDArray[np.int64], region: NDArray[np.int64]) -> tuple[Runs, NDArray[np.int64]]:
    """Runs of columns (i, j) [C, 2], sorted, and the region of each run. No two regions touch, so that a run
    has one."""
    runs = Runs.of(columns)
    first = np.cumsum(runs.length) - runs.length
    return runs, region[first]


def _largest(interval: NDArray[np.float64]) -> tuple[float, float]:
    """Bounds of the largest of several probabilities [C, 2]."""
    low, high = interval.max(axis=0)
    return float(low), float(high)
