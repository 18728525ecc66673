"""Where a camera was: what comes out is what went in, and a day of flight does not fill the memory."""

import tracemalloc

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from crowdfence import Camera
from crowdfence.service.track import Sighting, Track
from support.small_service import CAMERA, START_NS, pose

ZOOMED = Camera.pinhole(16, 12, 24.0, 24.0, 8.0, 6.0)


def sighting(number: int, *, zoomed: bool = False) -> Sighting:
    return Sighting(START_NS + number, ZOOMED if zoomed else CAMERA, pose("uav1", number), zoomed, True)


def numbers_in(track: Track, numbers: range) -> list[int]:
    """Of the stamps asked for, those that are there themselves."""
    found = [(number, track.at(START_NS + number)) for number in numbers]
    return [number for number, one in found if one is not None and one.stamp_ns == START_NS + number]


@given(st.lists(st.integers(0, 60), max_size=60), st.integers(-1, 61), st.integers(1, 9))
@settings(max_examples=60)
def test_it_tells_the_newest_until_a_stamp_and_the_way_there(
    given_in: list[int], asked: int, points: int
) -> None:
    """Against lists: what is not newer than the newest is left out."""
    track, kept = Track(100), []
    for number in given_in:
        track.add(sighting(number, zoomed=number % 3 == 0))
        if not kept or number > kept[-1]:
            kept.append(number)
    until = [number for number in kept if number <= asked]
    found = track.at(START_NS + asked)
    assert (found is None) == (not until) and len(track) == len(kept)
    if found is not None:
        expected = sighting(until[-1], zoomed=until[-1] % 3 == 0)
        assert (found.stamp_ns, found.picture, found.heatmap) == (
            expected.stamp_ns,
            expected.picture,
            expected.heatmap,
        )
        assert found.camera == expected.camera
        assert np.array_equal(found.world_from_camera, expected.world_from_camera)
    trail = track.trail(START_NS + asked, points)
    assert len(trail) <= points and len(trail) >= min(len(until), (points + 1) // 2)
    if until:
        assert np.array_equal(trail[-1], pose("uav1", until[-1])[:3, 3])
    ways = [pose("uav1", number)[:3, 3].tolist() for number in until]
    places = [ways.index(place) for place in trail.tolist()]
    assert len(set(np.diff(places).tolist())) <= 1, "evenly thinned"


def test_it_knows_whether_it_holds_all() -> None:
    track = Track(4)
    for number in range(5):
        assert not track.has_forgotten
        track.add(sighting(number))
    assert track.has_forgotten and track.at(START_NS) is None


def test_beyond_its_room_the_older_half_goes() -> None:
    track = Track(100)
    for number in range(1000):
        track.add(sighting(number))
        assert min(number + 1, 50) <= len(track) <= 100
    there = numbers_in(track, range(1000))
    assert there == list(range(there[0], 1000)) and len(there) == len(track)
    assert track.at(START_NS + there[0] - 1) is None


def test_a_sighting_takes_less_than_200_bytes() -> None:
    """They took 900: 48 drones could fill 800 MB."""
    track, place = Track(20_000), pose("uav1", 0.0)
    tracemalloc.start()
    before, _ = tracemalloc.get_traced_memory()
    for number in range(20_000):
        same = Camera.pinhole(16, 12, 12.0, 12.0, 8.0, 6.0)
        track.add(Sighting(START_NS + number, same, place.copy(), False, True))
    after, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert len(track) == 20_000 and after - before < 200 * 20_000
