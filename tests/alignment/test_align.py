"""Known errors of poses are found again, and what a flight cannot show is not guessed."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from crowdfence import open_recording
from crowdfence.alignment import Alignment, DroneAlignment, Estimate, align, estimate
from support.command_line import crowdfence
from support.foreign_recordings import ground, mission
from support.painted_flights import (
    Flown,
    Way,
    circling,
    hovering,
    level,
    opposite,
    paint,
    passing,
    shaped,
    write_fleet,
    write_flight,
    write_level,
)

TURNED_DEG, LATE_S = (0.4, -0.3, 0.25), 0.1


@pytest.fixture(scope="module")
def wrong_flight(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("circle") / "flight"
    return write_flight(folder, circling, paint(), turned_deg=TURNED_DEG, late_s=LATE_S)


def beside(way: Way, metres: float) -> Way:
    """The same so far to the east and to the north."""

    def moved(t_s: float) -> tuple[np.ndarray, Rotation]:
        eye, turn = way(t_s)
        return eye + np.array([metres, metres, 0.0]), turn

    return moved


def only(folder: Path) -> DroneAlignment:
    (drone,) = align(open_recording(folder), level()).drones
    return drone


@pytest.fixture(scope="module")
def found(wrong_flight: Path) -> DroneAlignment:
    return only(wrong_flight)


def test_a_known_error_is_found_again(found: DroneAlignment) -> None:
    true = dict(zip(("pitch", "yaw", "roll", "time"), (*TURNED_DEG, LATE_S), strict=True))
    for one in found.estimates[:4]:
        assert one.told, one
        assert abs(one.value - true[one.quantity]) < max(4 * one.error, 0.02), one
    offset = found.offset
    left = np.array([offset.pitch_deg, offset.yaw_deg, offset.roll_deg]) - TURNED_DEG
    assert np.linalg.norm(left) < 0.5 * np.linalg.norm(TURNED_DEG)
    assert abs(offset.time_s - LATE_S) < 0.2 * LATE_S


def test_pictures_agree_better_by_offsets_that_they_had_no_part_in(found: DroneAlignment) -> None:
    assert found.after_px < 0.5 * found.before_px


def test_a_row_of_a_clock_that_was_not_set_yet_is_no_matter(
    wrong_flight: Path, found: DroneAlignment, tmp_path: Path
) -> None:
    """A first row of 2001: years of poses would not fit into memory."""
    folder = tmp_path / "flight"
    shutil.copytree(wrong_flight, folder)
    head, first, *rows = (folder / "poses.csv").read_text().splitlines()
    drone, _, pose = first.split(",", 2)
    early = f"{drone},1000000000000000000,{pose}"
    (folder / "poses.csv").write_text("\n".join([head, early, first, *rows]) + "\n")
    for one, before in zip(only(folder).estimates, found.estimates, strict=True):
        assert one.value == pytest.approx(before.value, abs=1e-4)


def test_a_lone_drone_cannot_tell_east_and_north(found: DroneAlignment) -> None:
    """Level ground looks the same from a place beside; only its height shows."""
    east, north, up = found.estimates[4:]
    assert not east.told and not north.told and "other drones" in east.why_not
    assert up.told and abs(up.value) < 0.2
    assert found.offset.position_m == (0.0, 0.0, up.value)


def test_nothing_is_found_where_nothing_is_wrong(tmp_path: Path) -> None:
    right = only(write_flight(tmp_path / "flight", circling, paint()))
    for one in right.estimates[:4]:
        assert abs(one.value) < (0.02 if one.unit == "s" else 0.1), one


def test_a_map_far_too_high_is_told_in_full_or_not_at_all() -> None:
    """By 12 m, at 30 m above the ground: of two drones 7.4 m and a degree of pitch were told, to 0.3 m and
    0.2 degrees, by the few places that fit by chance where the pictures were compared."""
    found = align(mission(), ground(np.array([0.0, 0.0, 12.0])))
    right = {"pitch": (0.15, 0.25, 0.45), "up": (12.1, 12.1, 12.1)}  # with the map where it is: 0.1 more
    told = 0
    for number, drone in enumerate(found.drones):
        for one in drone.estimates:
            if one.told and one.quantity in right:
                assert abs(one.value - right[one.quantity][number]) < 3 * one.error, (drone.drone, one)
                told += 1
    assert told >= 2


def one_told(up_m: float, error_m: float, *, px: float = 12.0, why_not: str = "") -> DroneAlignment:
    up = Estimate("up", "m", up_m, error_m, True)
    return DroneAlignment("uav1", 24, 24, 500, px, 0.7, () if why_not else (up,), why_not)


def test_what_pictures_tell_beyond_it_is_added_until_they_tell_no_more(
    monkeypatch: pytest.MonkeyPatch, wrong_flight: Path
) -> None:
    def aligned(*rounds: DroneAlignment) -> DroneAlignment:
        left = iter(rounds)
        monkeypatch.setattr(estimate, "_aligned", lambda *_: Alignment((next(left),), 24, 60))
        (drone,) = align(open_recording(wrong_flight), level()).drones
        assert next(left, None) is None
        return drone

    near = aligned(one_told(3.0, 0.2, px=4.0))
    held = aligned(one_told(3.0, 0.2), one_told(0.3, 0.2, px=0.7))
    assert near.offset.position_m[2] == held.offset.position_m[2] == 3.0
    added = aligned(one_told(7.4, 0.3), one_told(4.7, 0.2, px=6.0), one_told(0.1, 0.2, px=0.7))
    assert added.offset.position_m[2] == pytest.approx(12.1) and added.before_px == 12.0
    refused = aligned(one_told(7.4, 0.3), one_told(0.0, 0.2, why_not="the poses jump"))
    assert not refused.told and refused.why_not == "the poses jump"
    endless = aligned(*(one_told(2.0, 0.2) for _ in range(5)))
    assert not endless.told and "these tell +2.00 m of up more: it is too far off" in endless.why_not


@pytest.mark.parametrize("haze", [0.0, 0.75])
def test_places_are_told_against_each_other(haze: float, tmp_path: Path) -> None:
    """Two drones over the same level ground, 1.2 m apart from what they say: half of it each, since what both
    are off shows nowhere. What one is too high shows in how large it sees the ground. One looks against the
    light, or has another exposure: its ground is paler, with a quarter of the contrast."""
    east_m, up_m = 1.2, 0.8
    drones = {"uav1": Flown(circling), "uav2": Flown(opposite, moved_m=(east_m, 0.0, up_m), haze=haze)}
    folder = write_fleet(tmp_path / "flight", drones, paint(), frames=14)
    first, second = align(open_recording(folder), level()).drones
    for one, true in ((first, (-east_m / 2, 0.0, 0.0)), (second, (east_m / 2, 0.0, up_m))):
        assert all(e.told for e in one.estimates), one.estimates
        assert np.abs(np.subtract(one.offset.position_m, true)).max() < 0.15, one.estimates


def test_drones_over_other_ground_do_not_tell_their_places(tmp_path: Path) -> None:
    drones = {"uav1": Flown(beside(circling, -38.0)), "uav2": Flown(beside(circling, 38.0))}
    folder = write_fleet(tmp_path / "flight", drones, paint(), frames=14)
    for one in align(open_recording(folder), level()).drones:
        east, north, up = one.estimates[4:]
        assert not east.told and not north.told and up.told, one.estimates
        assert "other drones" in east.why_not


def test_a_drone_over_other_ground_moves_nobody(tmp_path: Path) -> None:
    """uav3 is 2 m off above a hill of its own, which shows it. It sees nothing of what uav1 and uav2 see, and
    their poses are right: they stay where they are."""

    def hill(east: np.ndarray, north: np.ndarray) -> np.ndarray:
        return np.asarray(4.0 * np.exp(-((east - 38.0) ** 2 + (north - 38.0) ** 2) / (2 * 6.0**2)))

    drones = {
        "uav1": Flown(beside(circling, -30.0)),
        "uav2": Flown(beside(opposite, -30.0)),
        "uav3": Flown(beside(circling, 38.0), moved_m=(2.0, 0.0, 0.0)),
    }
    folder = write_fleet(tmp_path / "flight", drones, paint(), frames=12, relief=hill)
    *pair, alone = align(open_recording(folder), shaped(hill)).drones
    for one in pair:
        assert all(e.told for e in one.estimates), one.estimates
        assert np.abs(one.offset.position_m).max() < 0.15, one.estimates
    assert alone.offset.position_m[:2] == (0.0, 0.0)


@pytest.mark.parametrize("pictures", [1, 5])
def test_a_drone_of_too_few_pictures_moves_nobody(pictures: int, tmp_path: Path) -> None:
    """Its own poses, which are wrong, are put right by nothing: nobody else is laid on them, nor told a place
    against it. Telemetry of a single row, as of one photograph, is no trouble."""
    wrong = Flown(opposite, turned_deg=(1.0, 0.0, 0.0), moved_m=(0.8, 0.0, 0.8))
    folder = write_fleet(tmp_path / "flight", {"uav1": Flown(circling), "uav2": wrong}, paint(), frames=14)
    taken = sorted((folder / "images").glob("uav2_*"))
    for picture in [*taken[:3], *taken[3 + pictures :]]:
        picture.unlink()
    if pictures == 1:
        stamp = taken[3].stem.removeprefix("uav2_")
        rows = (folder / "poses.csv").read_text().splitlines()
        kept = [row for row in rows if not row.startswith("uav2") or stamp in row]
        (folder / "poses.csv").write_text("\n".join(kept) + "\n")
    first, second = align(open_recording(folder), level()).drones
    assert not second.told and "pictures, 6 are needed" in second.why_not
    off = first.offset
    assert first.told and np.abs([off.pitch_deg, off.yaw_deg, off.roll_deg, *off.position_m]).max() < 0.03
    assert "other drones" in first.estimates[4].why_not


JUMPS = {
    "heading": Flown(opposite, turned_deg=(0.0, 2.0, 0.0)),
    "place": Flown(opposite, moved_m=(2.0, 0.0, 0.0)),
    "height": Flown(opposite, moved_m=(0.0, 0.0, -1.5)),
    "clock": Flown(opposite, late_s=0.2),
}


@pytest.mark.parametrize("jump", JUMPS)
def test_a_drone_whose_poses_jump_is_refused_alone(jump: str, tmp_path: Path) -> None:
    """From its eighth picture on, 5.6 s later, uav2 is off: no constant is right for it. uav1, whose poses
    are right all the time, is not laid on it, and is not refused for it."""
    folder, later = (
        write_fleet(tmp_path / name, {"uav1": Flown(circling), "uav2": second}, paint(), frames=14)
        for name, second in (("flight", Flown(opposite)), ("later", JUMPS[jump]))
    )
    for picture in sorted((later / "images").glob("uav2_*"))[7:]:
        picture.replace(folder / "images" / picture.name)
    first, second = align(open_recording(folder), level()).drones
    assert not second.told and "jump between 2025-10-09T08:53:25.800Z and 2025-10-09T08:53:26.600Z" in (
        second.why_not
    )
    assert first.told and not first.why_not
    off = first.offset
    assert np.abs([off.pitch_deg, off.yaw_deg, off.roll_deg, *off.position_m]).max() < 0.05


def test_what_a_jump_spoils_for_others_is_told_without_it(tmp_path: Path) -> None:
    """5 m down are too far for half of its pictures to be found again in those before, so that no step is
    sure; what is left spoiled all three drones, and nothing was told of any."""
    fleet = {"uav1": Flown(circling), "uav2": Flown(opposite), "uav3": Flown(beside(circling, 6.0))}
    sunk = {**fleet, "uav2": Flown(opposite, moved_m=(0.0, 0.0, -5.0))}
    folder, later = (
        write_fleet(tmp_path / name, drones, paint(), frames=14)
        for name, drones in (("flight", fleet), ("later", sunk))
    )
    for picture in sorted((later / "images").glob("uav2_*"))[7:]:
        picture.replace(folder / "images" / picture.name)
    first, second, third = align(open_recording(folder), level()).drones
    assert not second.told and "does not hold for the rest" in second.why_not
    for one in (first, third):
        assert one.told and not one.why_not, one
        off = one.offset
        assert np.abs([off.pitch_deg, off.yaw_deg, off.roll_deg, *off.position_m]).max() < 0.05


def circled_with_a_jump(tmp_path: Path, yaw_deg: float, *, frames: int, before: int) -> Path:
    """A flight whose heading is off by so much behind its first pictures."""
    folder, later = (
        write_flight(tmp_path / name, circling, paint(), turned_deg=(0.0, off_deg, 0.0), frames=frames)
        for name, off_deg in (("flight", 0.0), ("later", yaw_deg))
    )
    for picture in sorted((later / "images").iterdir())[before:]:
        picture.replace(folder / "images" / picture.name)
    return folder


def test_a_heading_that_jumps_is_told_by_the_command(tmp_path: Path) -> None:
    folder = circled_with_a_jump(tmp_path, 2.0, frames=14, before=7)
    output = tmp_path / "offsets.json"
    done = crowdfence("align", folder, "-t", write_level(tmp_path / "level.tif"), "-o", output, columns=300)
    assert done.returncode == 3 and not output.exists()
    assert "uav1: cannot tell: its poses, or its clock, jump between 2025-10-09T08:53:25.800Z" in done.stdout
    assert "(yaw by +1." in done.stdout


def test_pictures_that_nothing_is_found_again_in_are_told(tmp_path: Path) -> None:
    """A compass that is reset by 60 degrees leaves nothing that could be compared from there on: the rest
    agrees, and that says nothing of half of the flight."""
    folder = circled_with_a_jump(tmp_path, 60.0, frames=16, before=9)
    output = tmp_path / "offsets.json"
    ground = write_level(tmp_path / "level.tif")
    done = crowdfence("align", folder, "-t", ground, "-o", output, columns=300)
    assert "places in 9 of 16 pictures, apart by" in done.stdout
    assert "nothing is known of the other 7: their poses may be far off" in done.stdout
    told = json.loads(output.read_text())["found"]["drones"]["uav1"]
    assert (told["pictures"], told["pictures_matched"]) == (16, 9)


def test_drones_that_are_left_out_are_named_where_too_little_is_left(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of six pictures of uav2 most places are found again in those of uav1, whose poses jump."""
    monkeypatch.setattr("crowdfence.alignment.estimate.FEWEST_MATCHES", 300)
    folder, later = (
        write_fleet(
            tmp_path / name,
            {"uav1": Flown(circling, turned_deg=(0.0, yaw_deg, 0.0)), "uav2": Flown(opposite)},
            paint(),
            frames=14,
        )
        for name, yaw_deg in (("flight", 0.0), ("later", 2.0))
    )
    for picture in sorted((later / "images").glob("uav1_*"))[7:]:
        picture.replace(folder / "images" / picture.name)
    for k, picture in enumerate(sorted((folder / "images").glob("uav2_*"))):
        if k not in (0, 2, 5, 7, 10, 13):
            picture.unlink()
    first, second = align(open_recording(folder), level()).drones
    assert "jump" in first.why_not
    assert "places could be found again in another picture without those of uav1, which are refused" in (
        second.why_not
    )


def test_water_that_flows_is_refused(tmp_path: Path) -> None:
    """All that is seen drifts eastwards by 0.3 m/s, as a river does. To a camera that circles this looks like
    one that is turned, though by no constant angle."""

    def upstream(t_s: float) -> tuple[np.ndarray, Rotation]:
        eye, turn = circling(t_s)
        return eye - np.array([0.3 * t_s, 0.0, 0.0]), turn

    flown, shown = (
        write_flight(tmp_path / name, way, paint())
        for name, way in (("flight", circling), ("shown", upstream))
    )
    for picture in (shown / "images").iterdir():
        picture.replace(flown / "images" / picture.name)
    assert not only(flown).told


def test_what_stands_on_the_ground_does_not_lift_it(tmp_path: Path) -> None:
    """A market's parasols at 1.5 m, which no map knows, hide a quarter of the ground: the drone is not put
    lower for it, nor turned."""
    one = only(write_flight(tmp_path / "flight", circling, paint(), parasols_m=1.5))
    assert one.told and abs(one.offset.position_m[2]) < 0.3, one.estimates
    assert np.abs([one.offset.pitch_deg, one.offset.yaw_deg, one.offset.roll_deg]).max() < 0.15


def test_a_hover_tells_nothing(tmp_path: Path) -> None:
    """The same picture again and again agrees with itself, whatever the pose."""
    hover = only(write_flight(tmp_path / "flight", hovering, paint(), turned_deg=TURNED_DEG))
    assert hover.matches > 100 and not hover.told
    assert all(one.why_not for one in hover.estimates)


def test_a_straight_line_does_not_tell_the_time(tmp_path: Path) -> None:
    """At a steady speed over level ground, a late clock and a place further on make the same pictures."""
    straight = only(write_flight(tmp_path / "flight", passing, paint(), late_s=LATE_S, frames=12))
    time = next(one for one in straight.estimates if one.quantity == "time")
    assert not time.told and time.why_not and straight.offset.time_s == 0.0


def test_ground_without_features_is_refused(tmp_path: Path) -> None:
    grey = np.full_like(paint(), 128.0)
    bare = write_flight(tmp_path / "flight", circling, grey, turned_deg=TURNED_DEG, frames=8)
    ground = write_level(tmp_path / "level.tif")
    output = tmp_path / "offsets.json"
    done = crowdfence("align", bare, "-t", ground, "-o", output)
    assert done.returncode == 3 and not output.exists()
    assert "uav1: cannot tell: 0 places could be found again" in done.stdout
    assert "nothing was written" in done.stderr


def test_what_was_found_is_used_by_every_command(wrong_flight: Path, tmp_path: Path) -> None:
    ground = write_level(tmp_path / "level.tif")
    output = tmp_path / "offsets.json"
    done = crowdfence("align", wrong_flight, "-t", ground, "-o", output, "--json")
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)["drones"]["uav1"]["estimates"]
    assert told["time"]["told"] and told["time"]["value"] == pytest.approx(LATE_S, abs=0.03)
    righted = tmp_path / "righted.mcap"
    done = crowdfence("convert", wrong_flight, "--alignment", output, "-o", righted)
    assert done.returncode == 0, done.stderr
    off_deg = []
    for frame in open_recording(righted).frames:
        _, true = circling(
            (frame.stamp_ns - open_recording(wrong_flight).frames[0].stamp_ns) / 1e9 + 1 + LATE_S
        )
        forward = true.apply(turned([0.0, 0.0, 1.0]))
        off_deg.append(np.degrees(np.arccos(np.clip(forward @ frame.world_from_camera[:3, 2], -1, 1))))
    # Uncorrected: 0.5 degrees of attitude, and 2.4 degrees that it turns in a tenth of a second.
    assert np.median(off_deg) < 0.3


def turned(axis: list[float]) -> np.ndarray:
    return Rotation.from_rotvec(np.radians(TURNED_DEG)).apply(axis)


def test_an_alignment_that_is_there_is_not_replaced(wrong_flight: Path, tmp_path: Path) -> None:
    output = tmp_path / "offsets.json"
    output.write_text("mine")
    done = crowdfence("align", wrong_flight, "-o", output)
    assert done.returncode == 1 and "--force" in done.stderr
    assert output.read_text() == "mine"
