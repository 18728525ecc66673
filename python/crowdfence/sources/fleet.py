"""Several recordings as one fleet, in the local frame of the first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from crowdfence.georeference import Georeference
from crowdfence.sources.pose_offset import alignments_of
from crowdfence.sources.recording import Recording


def joined(recordings: Sequence[Recording]) -> Recording:
    """One recording of all drones.

    ValueError when two have a drone of the same name, or local frames that are not one.
    """
    first = recordings[0]
    drones = [drone for one in recordings for drone in one.drones]
    if twice := {drone for drone in drones if drones.count(drone) > 1}:
        raise ValueError(f"two of the recordings have a drone {min(twice)!r}")
    for one in recordings:
        if one.georeference != first.georeference:
            raise ValueError(
                f"{one.name} and {first.name} have local frames of their own ({_place(one.georeference)}, "
                f"{_place(first.georeference)}): only recordings of one frame make a fleet"
            )
    with_map = next((one for one in recordings if one.terrain is not None), first)
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
        warnings=tuple(warning for one in recordings for warning in one.warnings),
        manifest=_manifest(recordings),
        pose_tracks={drone: track for one in recordings for drone, track in one.tracks().items()},
        ground_contacts={
            drone: contact for one in recordings for drone, contact in one.ground_contacts.items()
        },
        longest_gap_s=max(one.longest_gap_s for one in recordings),
    )


def _manifest(recordings: Sequence[Recording]) -> dict[str, Any]:
    """What each says, and by what the poses of any drone were put right: that goes with the poses."""
    manifest: dict[str, Any] = {"kind": "fleet", "recordings": [one.manifest for one in recordings]}
    righted = {
        drone: offsets
        for one in recordings
        for drone in one.drones
        if (offsets := alignments_of(one.manifest, drone))
    }
    return {**manifest, "alignment": righted} if righted else manifest


def names_of(paths: Sequence[Path]) -> list[str]:
    """A name for what each file holds: its stem, with its folder where stems repeat."""
    stems = [path.stem for path in paths]
    return [
        stem if stems.count(stem) == 1 else f"{path.resolve().parent.name}_{stem}"
        for path, stem in zip(paths, stems, strict=True)
    ]


def _place(georeference: Georeference | None) -> str:
    if georeference is None:
        return "nowhere on Earth"
    return f"{georeference.latitude_deg:.6f}, {georeference.longitude_deg:.6f}"
