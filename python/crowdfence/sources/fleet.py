"""Several recordings as one fleet, in the local frame of the one whose map is used, else of the first."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

from crowdfence.sources.moved_frame import in_frame
from crowdfence.sources.pose_noise import smoothed_by
from crowdfence.sources.pose_offset import alignments_of
from crowdfence.sources.recorded_truth import PeopleLog, RecordedPeople
from crowdfence.sources.recording import Recording
from crowdfence.sources.ros_bag.own_frame import COUNTED_FROM

_SAME_PLACE_M = 0.01


def joined(recordings: Sequence[Recording]) -> Recording:
    """One recording of all drones, those with other local frames moved into one.

    ValueError when two have a drone of the same name, or some say where on Earth they are and others do not.
    """
    recordings = _in_one_frame(recordings)
    first = recordings[0]
    drones = [drone for one in recordings for drone in one.drones]
    if twice := {drone for drone in drones if drones.count(drone) > 1}:
        raise ValueError(f"two of the recordings have a drone {min(twice)!r}")
    with_map = _with_map(recordings)
    people, manifest = _people(recordings), _manifest(recordings)
    of_detectors = "" if "detector" in manifest else _detectors_doubt(recordings)
    doubts = [told for told in (people.unreadable, _frame_doubt(recordings), of_detectors) if told]
    return replace(
        first,
        name="+".join(one.name for one in recordings),
        drones=tuple(sorted(drones)),
        frames=tuple(
            sorted((frame for one in recordings for frame in one.frames), key=lambda f: (f.stamp_ns, f.drone))
        ),
        terrain=with_map.terrain,
        terrain_options=with_map.terrain_options,
        refused=tuple(refusal for one in recordings for refusal in one.refused),
        warnings=tuple(dict.fromkeys([*(said for one in recordings for said in one.warnings), *doubts])),
        manifest=manifest,
        pose_tracks={drone: track for one in recordings for drone, track in one.tracks().items()},
        ground_contacts={
            drone: contact for one in recordings for drone, contact in one.ground_contacts.items()
        },
        longest_gap_s=max(one.longest_gap_s for one in recordings),
        people=people,
        layer_grounds={
            layer: ground for one in reversed(recordings) for layer, ground in one.layer_grounds.items()
        },
    )


def _in_one_frame(recordings: Sequence[Recording]) -> list[Recording]:
    somewhere = [one for one in recordings if one.georeference is not None]
    nowhere = [one for one in recordings if one.georeference is None]
    if not somewhere:
        return nowhere
    if nowhere:
        raise ValueError(
            f"{somewhere[0].name} says where on Earth its local frame lies and {nowhere[0].name} does not: "
            "nobody knows how one lies to the other; record the place in it too (origin= or fix= in --topics "
            "of a bag), or leave it out"
        )
    # A map without a place on Earth lies in the frame of its own recording.
    common = _with_map(recordings).georeference
    assert common is not None
    return [in_frame(one, common) for one in recordings]


def _with_map(recordings: Sequence[Recording]) -> Recording:
    """The one whose map is that of all, if any has one."""
    return next((one for one in recordings if one.terrain is not None), recordings[0])


def _detectors_doubt(recordings: Sequence[Recording]) -> str:
    """Of recordings that one detector did not make all heatmaps of: these are weighed by what its calibration
    says only where it did; empty where none says who made them."""
    told = (one.manifest["detector"] for one in recordings if one.manifest.get("detector") is not None)
    made = {str(one.get("name")) if isinstance(one, dict) else "no contract" for one in told}
    if not made:
        return ""
    return (
        f"not all heatmaps were made by one detector ({', '.join(sorted(made))}): taken as recorded, none "
        "counts for what its calibration says, and far and flat looks count like near ones, so that more "
        "ground is called empty; make all by one (crowdfence detect), or let it look at the pictures"
    )


def _frame_doubt(recordings: Sequence[Recording]) -> str:
    """Why what one of the recordings saw may lie elsewhere beside another; empty where they have a place."""
    if recordings[0].georeference is not None:
        return ""
    known = [frames for one in recordings if (frames := _local_frames(one)) is not None]
    if len(known) == len(recordings) and (doubt := _bags_doubt(known)):
        return doubt
    return (
        f"{', '.join(one.name for one in recordings)} do not say where on Earth their (0, 0, 0) lies: it is "
        "taken to be one; where each counts from a place of its own, as its take-off, what one drone sees is "
        "put far from what another sees there: record the place in each, or count all from one point"
    )


def _bags_doubt(told: Sequence[Mapping[str, tuple[str, str]]]) -> str:
    """Of bags, each as its drone recorded it, whose poses may count from another place in each. `told`: for
    each bag what its drones count from, and whose that is."""
    # A robot's own frame is another one in each bag, whatever it and its topic are called.
    origins = {
        (frame, whose and (number, whose))
        for number, frames in enumerate(told)
        for frame, whose in frames.values()
    }
    if len(origins) < 2:
        return ""
    named = (f"{drone} in {frame or '(no frame)'}" for frames in told for drone, (frame, _) in frames.items())
    return (
        "nothing in the recordings says how the frames of their poses lie to each other "
        f"({', '.join(named)}): all are taken to count from the same place, and what one drone sees may be "
        "put far from what another sees there; record /tf_static in each bag, from one frame of all to that "
        "of its poses, or all drones in one bag with origin= or fix= of each in --topics"
    )


def _local_frames(one: Recording) -> dict[str, tuple[str, str]] | None:
    """By drone what its poses count from, and whose that is; None for what counts from a place on Earth, or
    from where whoever made it says."""
    if one.georeference is not None:
        return None
    if COUNTED_FROM in one.manifest:
        return dict(one.manifest[COUNTED_FROM])
    if str(one.manifest.get("source", "")).startswith("ROS "):  # a bag that was converted
        return {drone: (f"that of {one.manifest['source']}", drone) for drone in one.drones}
    return None


def _people(recordings: Sequence[Recording]) -> PeopleLog:
    """Everybody in the world, whichever of the recordings tells of them."""
    logs = [(one.name, one.people) for one in recordings if len(one.people.stamps_ns)]
    if not logs:
        return PeopleLog(unreadable="; ".join(filter(None, (one.people.unreadable for one in recordings))))
    told: dict[int, tuple[str, PeopleLog]] = {}
    for name, log in logs:
        both = next((int(stamp_ns) for stamp_ns in log.stamps_ns if int(stamp_ns) in told), None)
        if both is not None and not _same_people(log, told[both][1], both):
            return PeopleLog(
                unreadable=f"{name} and {told[both][0]} tell of different people at one time, {both}: they "
                "are of two worlds"
            )
        told = {int(stamp_ns): (name, log) for stamp_ns in log.stamps_ns} | told
    return PeopleLog(sorted(told), lambda stamp_ns: _read(told[stamp_ns][1], stamp_ns))


def _same_people(log: PeopleLog, other: PeopleLog, stamp_ns: int) -> bool:
    try:
        one, two = _read(log, stamp_ns), _read(other, stamp_ns)
    except ValueError:  # said where it is read
        return True
    if not np.array_equal(one.crowd, two.crowd):
        return False
    # Rounded to single precision before one of them was moved into the frame of the other.
    return np.allclose(one.position, two.position, rtol=0.0, atol=_SAME_PLACE_M)


def _read(log: PeopleLog, stamp_ns: int) -> RecordedPeople:
    assert log.read is not None
    return log.read(stamp_ns)


def _manifest(recordings: Sequence[Recording]) -> dict[str, Any]:
    """What each says, by what the poses of any drone were put right: that goes with the poses; and what is
    the same of all: which detector made the heatmaps, and of which simulation they are, which says what a
    crowd is."""
    manifest: dict[str, Any] = {"kind": "fleet", "recordings": [one.manifest for one in recordings]}
    righted = {
        drone: offsets
        for one in recordings
        for drone in one.drones
        if (offsets := alignments_of(one.manifest, drone))
    }
    told: dict[str, Any] = {"alignment": righted} if righted else {}
    for what in ("detector", "simulation"):
        first, *others = (one.manifest.get(what) for one in recordings)
        if first is not None and all(one == first for one in others):
            told[what] = first
    smoothed = {
        drone: asdict(noise) for one in recordings for drone, noise in smoothed_by(one.manifest).items()
    }
    return {**manifest, **told, **({"pose_noise": smoothed} if smoothed else {})}


def names_of(paths: Sequence[Path]) -> list[str]:
    """A name for what each file holds: its stem, with its folder where stems repeat."""
    stems = [path.stem for path in paths]
    return [
        stem if stems.count(stem) == 1 else f"{path.resolve().parent.name}_{stem}"
        for path, stem in zip(paths, stems, strict=True)
    ]
