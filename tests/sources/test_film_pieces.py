"""Flights whose film the drone split into files: one drone again."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from crowdfence import open_recording
from support.foreign_recordings import frames, write_film, write_subtitles

PARTS = (slice(0, 2), slice(2, 4), slice(4, 6))


def split(folder: Path, pause_ns: int = 100_000_000) -> list[Path]:
    """A flight in three films, each with its subtitles, which end a pause before the next begins."""
    folder.mkdir(exist_ok=True)
    begun = [write_film(folder / f"DJI_000{number}.MP4", part=part) for number, part in enumerate(PARTS, 1)]
    ends_ns = [start_ns - pause_ns for _, start_ns in begun[1:]]
    for (film, start_ns), end_ns in zip(begun, [*ends_ns, None], strict=True):
        write_subtitles(film.with_suffix(".SRT"), start_ns, end_ns=end_ns)
    return [film for film, _ in begun]


@pytest.mark.parametrize("order", [(0, 1, 2), (2, 0, 1)])
def test_the_pieces_of_a_flight_are_one_drone(tmp_path: Path, order: tuple[int, ...]) -> None:
    films = split(tmp_path)
    found = open_recording([films[at] for at in order], frames_per_s=np.inf)
    assert found.drones == ("DJI_0001",) and set(found.tracks()) == {"DJI_0001"}
    told = [one for one in found.warnings if "same flight" in one]
    assert sorted(one.partition(" begins")[0] for one in told) == ["DJI_0002", "DJI_0003"]
    assert all("0.1 s after DJI_0001 ends" in one for one in told)
    assert {frame.drone for frame in found.frames} == {"DJI_0001"}
    stamps_ns = [frame.stamp_ns for frame in found.frames]
    assert stamps_ns == sorted(stamps_ns)
    for picture in frames():
        assert min(abs(picture.stamp_ns - stamp_ns) for stamp_ns in stamps_ns) < 2_000_000
    # The heights of all count from the take-off of the first, whose place is said to be not known.
    first = open_recording(films[0])
    assert found.georeference is not None and first.georeference is not None
    here, there = (
        one.georeference.geodetic_from_local([one.ground_contacts["DJI_0001"].place])[:2]
        for one in (found, first)
    )
    np.testing.assert_allclose(here, there, rtol=0, atol=1e-7)
    assert len([one for one in found.warnings if "whose place is not recorded" in one]) == 1


def test_films_that_do_not_go_on_are_drones_of_their_own(tmp_path: Path) -> None:
    """A piece is missing; another drone at the same time; two that could both be what goes on."""
    films, others = split(tmp_path / "a"), split(tmp_path / "b")
    for fleet in ([films[0], films[2]], [films[0], others[0]], [films[0], others[0], films[1]]):
        found = open_recording(fleet)
        assert len(found.drones) == len(fleet)
        assert not [one for one in found.warnings if "same flight" in one]
