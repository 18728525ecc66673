"""Recordings that a command has reason to doubt: what it takes of them, and what it says."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import rasterio
from PIL import Image

from support.command_line import FEW_FILES, crowdfence
from support.small_recordings import EPOCH_NS, write_hovering

SECOND = 1_000_000_000
HOUR = 3600 * SECOND
CROWD = np.full((6, 8), 0.9, np.float32)
FIRST = [EPOCH_NS + k * SECOND for k in range(4)]


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    """80 x 80 m at height 0 around the origin of the local frame."""
    path = tmp_path / "plain.tif"
    transform = rasterio.Affine(1.0, 0.0, -40.0, 0.0, -1.0, 40.0)
    with rasterio.open(
        path, "w", driver="GTiff", width=80, height=80, count=1, dtype="float32", transform=transform
    ) as raster:
        raster.write(np.zeros((80, 80), np.float32), 1)
    return path


def test_a_drone_that_comes_back_after_charging_has_its_newest_frames_in_the_map(
    plain: Path, tmp_path: Path
) -> None:
    flown = write_hovering(tmp_path / "rec", {"uav1": [*FIRST, EPOCH_NS + 2 * HOUR, EPOCH_NS + 2 * HOUR + 1]})
    done = crowdfence("run", flown, *FEW_FILES, "-t", plain, "--assume-local", "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["refused"] == [] and summary["frames"] == {"uav1": 6}
    assert summary["duration_s"] == pytest.approx(7200.0, abs=1e-6)


def test_frames_days_later_are_left_out_until_an_option_takes_them(plain: Path, tmp_path: Path) -> None:
    late = [EPOCH_NS + 48 * HOUR, EPOCH_NS + 48 * HOUR + SECOND]
    flown = write_hovering(tmp_path / "rec", {"uav1": [*FIRST, *late]})
    command = ("run", flown, *FEW_FILES, "-t", plain, "--assume-local", "-o", tmp_path / "out", "--force")
    done = crowdfence(*command)
    assert done.returncode == 0, done.stderr
    assert "jumps 48.00 h away from the 4 frames of this drone" in done.stderr
    assert "(limit --max-jump-s 3600 s)" in done.stderr
    done = crowdfence(*command, "--max-jump-s", 200_000)
    assert done.returncode == 0, done.stderr
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["frames"] == {"uav1": 6}


def test_two_drones_hours_apart_may_have_two_clocks(plain: Path, tmp_path: Path) -> None:
    flown = write_hovering(tmp_path / "rec", {"uav1": FIRST, "uav2": [EPOCH_NS + 2 * HOUR]})
    command = ("run", flown, *FEW_FILES, "-t", plain, "--assume-local", "-o", tmp_path / "out")
    done = crowdfence(*command)
    (said,) = done.stderr.strip().splitlines()
    assert done.returncode == 1
    # The last of uav1 is 3 s after its first.
    assert f"uav2 at {EPOCH_NS + 2 * HOUR} ns comes 7197 s after uav1, the last frame before it" in said
    assert "the bound --max-jump-s is 3600 s. Is a clock wrong?" in said
    assert crowdfence(*command, "--max-jump-s", 7200).returncode == 0


def test_two_drones_an_hour_apart_with_a_pause_below_the_bound_are_doubted(
    plain: Path, tmp_path: Path
) -> None:
    # A frame a minute for 20 minutes; the pause is 40 min, which the bound of an hour lets pass.
    flights = {f"uav{n}": [EPOCH_NS + n * HOUR + k * 60 * SECOND for k in range(21)] for n in (1, 2)}
    flown = write_hovering(tmp_path / "rec", flights)
    done = crowdfence("run", flown, *FEW_FILES, "-t", plain, "--assume-local", "-o", tmp_path / "out")
    assert done.returncode == 0
    assert (
        "uav2 begins 40 min after uav1 has ended; had they flown together, one clock would be 1 h off"
        in " ".join(done.stderr.split())
    )


def written_map(path: Path, heights: np.ndarray) -> Path:
    """Pixels of 1 m, the middle at the origin of the local frame."""
    rows, columns = heights.shape
    transform = rasterio.Affine(1.0, 0.0, -columns / 2, 0.0, -1.0, rows / 2)
    with rasterio.open(
        path, "w", driver="GTiff", width=columns, height=rows, count=1, dtype="float32", transform=transform
    ) as raster:
        raster.write(heights.astype(np.float32), 1)
    return path


def with_crowd(recording: Path) -> Path:
    """Every heatmap shows crowd everywhere."""
    for heatmap in (recording / "heatmaps").iterdir():
        heatmap.unlink()
        np.save(heatmap.with_suffix(".npy"), CROWD)
    return recording


def test_cameras_below_the_map_are_told_as_such(tmp_path: Path) -> None:
    # The drone hangs at 40 m; the map says that the ground is at 50 m, as a geoid that was left out would.
    flown = with_crowd(write_hovering(tmp_path / "rec", {"uav1": FIRST}))
    ground = written_map(tmp_path / "high.tif", np.full((80, 80), 50.0))
    done = crowdfence("run", flown, *FEW_FILES, "-t", ground, "--assume-local", "-o", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.strip() == (
        "error: no view saw the terrain within --max-range-m 300 m: the camera is below the map's ground in "
        "4 of 4 frames: heights of poses and map must count from the same level (for maps: --terrain-option "
        "height_offset_m=...)"
    )
    told = json.loads(crowdfence("inspect", flown, "-t", ground, "--assume-local", "--json").stdout)
    flight = told["drones"][0]["flight"]
    assert (flight["frames_under_terrain"], flight["frames_beside_terrain"]) == (4, 0)


def test_a_camera_in_a_house_of_the_map_sees_nothing_and_fell_through_no_hole(tmp_path: Path) -> None:
    """Its rays would leave the house from inside and mark the ground around it."""
    flown = with_crowd(write_hovering(tmp_path / "rec", {"uav1": FIRST}))
    heights = np.zeros((80, 80))
    heights[30:50, 30:50] = 60.0
    house = written_map(tmp_path / "house.tif", heights)
    done = crowdfence("run", flown, *FEW_FILES, "-t", house, "--assume-local", "-o", tmp_path / "out")
    assert done.returncode == 1
    assert "no view saw the terrain" in done.stderr and "holes of the map" not in done.stderr
    assert "the camera is below the map's ground in 4 of 4 frames" in done.stderr


@pytest.fixture(scope="module")
def doubtful(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A recording with pictures, heatmaps and labels, one of whose rows cannot be read, and a map whose datum
    is not known."""
    folder = write_hovering(tmp_path_factory.mktemp("doubtful") / "rec", {"uav1": FIRST})
    (folder / "poses.csv").open("a").write("uav1,soon,0,0,40,0,1,0,0\n")
    random = np.random.default_rng(5)
    for inside in ("images", "truth/regions"):
        (folder / inside).mkdir(parents=True)
    for stamp_ns in FIRST:
        picture = random.integers(0, 256, (24, 32, 3), dtype=np.uint8)
        Image.fromarray(picture).save(folder / "images" / f"uav1_{stamp_ns}.png")
        labels = np.zeros((24, 32), np.uint8)
        labels[8:16, 8:16] = 1
        Image.fromarray(labels).save(folder / "truth" / "regions" / f"uav1_{stamp_ns}.png")
    ground = folder.with_name("datum.tif")
    profile = {"driver": "GTiff", "width": 100, "height": 100, "count": 1, "dtype": "float32"}
    crs = "+proj=tmerc +lon_0=12 +x_0=4500000 +ellps=GRS80 +units=m"
    corner = rasterio.transform.from_origin(4_594_996.0, 5_820_000.0, 1.0, 1.0)
    with rasterio.open(ground, "w", **profile, crs=crs, transform=corner) as raster:
        raster.write(np.zeros((100, 100), np.float32), 1)
    return folder, ground


@pytest.mark.parametrize("as_json", [False, True])
@pytest.mark.parametrize("command", ["run", "evaluate", "align", "detect"])
def test_every_command_says_what_is_doubtful_about_recording_and_map(
    doubtful: tuple[Path, Path], tmp_path: Path, command: str, as_json: bool
) -> None:
    recording, ground = doubtful
    output = {"run": "out", "align": "offsets.json", "detect": "seen.mcap"}.get(command)
    where = () if output is None else ("-o", tmp_path / output)
    where += FEW_FILES if command == "run" else ()
    told = ("--json",) if as_json else ()
    done = crowdfence(command, recording, "-t", ground, "--assume-local", *where, *told)
    assert done.returncode == (3 if command == "align" else 0), done.stderr  # a hover tells nothing
    said = json.loads(done.stdout)["warnings"] if as_json else done.stderr.splitlines()
    for doubt in ("poses.csv: 1 rows cannot be read", "is taken as WGS84"):
        assert [doubt in line for line in said].count(True) == 1, said


@pytest.mark.parametrize("command", ["run", "evaluate"])
def test_masks_of_zero_and_one_are_doubted_by_whoever_reads_them(
    doubtful: tuple[Path, Path], tmp_path: Path, command: str
) -> None:
    masks = tmp_path / "rec"
    shutil.copytree(doubtful[0], masks)
    for heatmap in (masks / "heatmaps").iterdir():
        mask = np.zeros((6, 8), np.uint8)
        mask[2:4, 2:4] = 1
        Image.fromarray(mask).save(heatmap)
    where = (*FEW_FILES, "-o", tmp_path / "out") if command == "run" else ()
    common = ("-t", doubtful[1], "--assume-local", "--detector", "recorded", "--json")
    done = crowdfence(command, masks, *common, *where)
    assert done.returncode == 0, done.stderr
    (said,) = [line for line in json.loads(done.stdout)["warnings"] if "look like masks" in line]
    assert "multiply them by 255" in said


def labelled(recording: Path, heights_m: list[float]) -> Path:
    """`with_crowd`, labelled so too, at these heights instead, one per picture."""
    with_crowd(recording)
    (recording / "truth" / "regions").mkdir(parents=True)
    for stamp_ns in FIRST:
        labels = Image.fromarray(np.ones((24, 32), np.uint8))
        labels.save(recording / "truth" / "regions" / f"uav1_{stamp_ns}.png")
    poses = recording / "poses.csv"
    head, *rows = poses.read_text().splitlines()
    at = head.split(",").index("z")
    for number, height_m in enumerate(heights_m):
        row = rows[number].split(",")
        rows[number] = ",".join([*row[:at], str(height_m), *row[at + 1 :]])
    poses.write_text("\n".join([head, *rows, ""]))
    return recording


@pytest.mark.parametrize("command", ["run", "evaluate"])
def test_heights_that_the_map_settles_are_told(plain: Path, tmp_path: Path, command: str) -> None:
    flown = labelled(write_hovering(tmp_path / "rec", {"uav1": FIRST}), [5.0, 45.0, 45.0, 45.0])
    where = (*FEW_FILES, "-o", tmp_path / "out") if command == "run" else ()
    common = (flown, "-t", plain, "--assume-local", "--detector", "recorded", "--ground-start", "--json")
    done = crowdfence(command, *common, *where)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)["warnings"]
    told = "uav1: heights moved by -5.0 m: its first pose is put on the map's ground"
    assert [told in line for line in said].count(True) == 1, said


@pytest.mark.parametrize("command", ["run", "evaluate"])
def test_a_coarse_map_and_cameras_under_its_ground_are_told(
    plain: Path, tmp_path: Path, command: str
) -> None:
    flown = labelled(write_hovering(tmp_path / "rec", {"uav1": FIRST}), [40.0, 40.0, 40.0, -30.0])
    where = (*FEW_FILES, "-o", tmp_path / "out") if command == "run" else ()
    common = (flown, "-t", plain, "--assume-local", "--voxel-size-m", 4, "--detector", "recorded", "--json")
    done = crowdfence(command, *common, *where)
    assert done.returncode == 0, done.stderr
    said = json.loads(done.stdout)["warnings"]
    for doubt in ("voxels of 4 m are coarse for people", "the camera is below the map's ground in 1 of 4"):
        assert [doubt in line for line in said].count(True) == 1, said


def test_a_replay_says_what_is_doubtful_before_it_begins(doubtful: tuple[Path, Path], tmp_path: Path) -> None:
    words = ["serve", doubtful[0], "-t", doubtful[1], "--assume-local", "--port", 0, "--json"]
    with (tmp_path / "log").open("w") as errors:
        process = subprocess.Popen(
            [sys.executable, "-m", "crowdfence", *map(str, words)], stdout=subprocess.PIPE, stderr=errors
        )
    try:
        assert process.stdout is not None and process.stdout.readline()  # it serves
    finally:
        process.terminate()
        process.communicate(timeout=60)
    said = (tmp_path / "log").read_text()
    for doubt in ("warning: poses.csv: 1 rows cannot be read", "is taken as WGS84"):
        assert said.count(doubt) == 1, said


def test_a_conversion_says_what_is_doubtful_too(doubtful: tuple[Path, Path], tmp_path: Path) -> None:
    """Of what was lost on the way into the file nobody hears again."""
    done = crowdfence("convert", doubtful[0], "-o", tmp_path / "copy.mcap")
    assert done.returncode == 0 and "warning: poses.csv: 1 rows cannot be read" in done.stderr
    done = crowdfence("convert", doubtful[0], "-o", tmp_path / "again.mcap", "--json")
    assert len(json.loads(done.stdout)["warnings"]) == 1


def turned_up(recording: Path, drone: str) -> Path:
    """The camera of a drone looks straight up, as where 90 was taken for straight down."""
    poses = recording / "poses.csv"
    rows = [
        row.replace(",0,1,0,0", ",1,0,0,0") if row.startswith(f"{drone},") else row
        for row in poses.read_text().splitlines()
    ]
    poses.write_text("\n".join(rows) + "\n")
    return recording


def test_cameras_that_look_at_the_sky_are_told_as_such(plain: Path, tmp_path: Path) -> None:
    flown = turned_up(write_hovering(tmp_path / "rec", {"uav1": FIRST}), "uav1")
    done = crowdfence("run", flown, *FEW_FILES, "-t", plain, "--assume-local", "-o", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.strip() == (
        "error: no view saw the terrain within --max-range-m 300 m: the camera looks above the horizon in 4 "
        "of 4 views; straight down is a pitch of -90 degrees"
    )


def test_a_drone_that_saw_no_ground_is_told_though_another_saw_some(plain: Path, tmp_path: Path) -> None:
    """Nothing of it is refused, and it shows no crowd that could be missed. The third has a pose only."""
    flown = turned_up(write_hovering(tmp_path / "rec", {"uav1": FIRST, "uav2": FIRST}), "uav2")
    with (flown / "poses.csv").open("a") as poses:
        poses.write(f"uav3,{FIRST[0]},0,0,40,0,1,0,0\n")
    done = crowdfence("run", flown, *FEW_FILES, "-t", plain, "--assume-local", "-o", tmp_path / "out")
    assert done.returncode == 0, done.stderr
    told = json.loads((tmp_path / "out" / "summary.json").read_text())["warnings"]
    assert [one for one in told if one.startswith("uav1")] == []
    assert (
        "uav2: none of its 4 views shows ground of the map within 300 m: the camera looks above the horizon "
        "in 4 of 4 views; straight down is a pitch of -90 degrees" in told
    )
    assert "uav3: no frame of it was used" in told


@pytest.mark.parametrize("detector", ["recorded", "crowdnet-s"])
def test_an_evaluation_doubts_all_that_a_run_doubts(plain: Path, tmp_path: Path, detector: str) -> None:
    """The second drone sees nobody where the first shows a crowd, and the third looks at the sky; no ground
    reaches the threshold of 1. The pictures are noise."""
    stamps_ns = [EPOCH_NS + k * SECOND // 2 for k in range(12)]
    drones = ("uav1", "uav2", "uav3")
    flown = turned_up(write_hovering(tmp_path / "rec", dict.fromkeys(drones, stamps_ns)), "uav3")
    camera = {"width": 320, "height": 240, "fx": 240.0, "fy": 240.0, "cx": 160.0, "cy": 120.0}
    (flown / "recording.json").write_text(json.dumps({"cameras": {"*": camera}}))
    shown, random = np.zeros((6, 8), np.uint8), np.random.default_rng(3)
    shown[2:4, 2:4] = 242
    for inside in ("images", "truth/regions"):
        (flown / inside).mkdir(parents=True)
    for stamp_ns in stamps_ns:
        Image.fromarray(shown).save(flown / "heatmaps" / f"uav1_{stamp_ns}.png")
        labels = Image.fromarray(np.kron(shown > 0, np.ones((40, 40), np.uint8)))
        labels.save(flown / "truth" / "regions" / f"uav1_{stamp_ns}.png")
        for drone in drones:
            picture = Image.fromarray(random.integers(0, 256, (240, 320, 3), dtype=np.uint8))
            picture.save(flown / "images" / f"{drone}_{stamp_ns}.png")
    common = (flown, "-t", plain, "--assume-local", "--detector", detector, "--json")
    said = {}
    for threshold in (None, 1.0):
        told = () if threshold is None else ("--threshold", threshold)
        ran = crowdfence("run", *common, *told, *FEW_FILES, "-o", tmp_path / f"out{threshold}")
        scored = crowdfence("evaluate", *common, *told, "--method", "evidence")
        assert ran.returncode == scored.returncode == 0, ran.stderr + scored.stderr
        run, said[threshold] = (set(json.loads(done.stdout)["warnings"]) for done in (ran, scored))
        of_method = {line.removeprefix("evidence: ") for line in said[threshold]}
        assert run - of_method == set()
    expected = {
        "recorded": [(None, "uav2 saw nobody in 12 looks"), (1.0, "evidence: pictures of uav1 show crowd")],
        "crowdnet-s": [(None, "crowdnet-s was not tested"), (None, "look unlike everything")],
    }
    for threshold, doubt in [(None, "uav3: none of its 12 views shows ground"), *expected[detector]]:
        assert any(doubt in line for line in said[threshold]), said


@pytest.mark.parametrize("command", ["inspect", "run", "convert"])
def test_every_command_that_reads_a_recording_tells_its_warnings(
    plain: Path, tmp_path: Path, command: str
) -> None:
    """A mission file holds no word of the rows that could not be read: who converts must hear of them."""
    flown = write_hovering(tmp_path / "rec", {"uav1": FIRST})
    with (flown / "poses.csv").open("a") as poses:
        poses.write("uav1,x,0,0,40,0,1,0,0\n")
    options = {
        "run": (*FEW_FILES, "-o", tmp_path / "out"),
        "convert": ("-o", tmp_path / "flight.mcap"),
    }.get(command, ())
    local = () if command == "convert" else ("--assume-local",)
    done = crowdfence(command, flown, "-t", plain, *local, *options)
    assert done.returncode == 0, done.stderr
    said = "poses.csv: 1 rows cannot be read, first: line 6: stamp_ns is 'x', expected a whole number"
    assert f"warning: {said}" in done.stderr.splitlines()


@pytest.mark.parametrize("command", ["inspect", "run"])
def test_ten_bytes_of_a_recording_are_one_line(plain: Path, tmp_path: Path, command: str) -> None:
    cut = tmp_path / "flight.mcap"
    cut.write_bytes(b"\x89MCAP0\r\n\x01\x00")
    done = crowdfence(command, cut, *(("-t", plain, "-o", tmp_path / "out") if command == "run" else ()))
    assert done.returncode == 1 and done.stderr.strip() == (
        f"error: {cut} is damaged: the file ends at byte 8 without its closing records; no message was read. "
        "Copy it again, or record it again"
    )


def test_an_offset_with_its_unit_is_one_line(plain: Path, tmp_path: Path) -> None:
    flown = write_hovering(tmp_path / "rec", {"uav1": FIRST})
    options = ("--assume-local", "--terrain-option", "height_offset_m=48 m", "-o", tmp_path / "out")
    done = crowdfence("run", flown, *FEW_FILES, "-t", plain, *options)
    assert done.returncode == 1
    assert done.stderr.strip() == f"error: {plain}: height_offset_m is '48 m'; it must be a number"


def test_a_mission_file_that_finds_no_room_is_named(plain: Path, tmp_path: Path) -> None:
    """Files of this process may have 8 KiB: room for the proof that the folder can be written, not for the
    map of 25 KiB."""
    flown = write_hovering(tmp_path / "rec", {"uav1": FIRST})
    target = tmp_path / "flight.mcap"
    words = [sys.executable, "-m", "crowdfence", "convert", flown, "-t", plain, "-o", target]
    done = subprocess.run(
        ["bash", "-c", 'ulimit -f 8; exec "$@"', "bash", *map(str, words)], capture_output=True, text=True
    )
    assert done.returncode == 1
    assert done.stderr.strip() == f"error: cannot write {target}: File too large; nothing of it is left"
    assert not target.exists()


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--fps", 5), "is no film: --fps does not apply"),
        (("--geoid-m", 48), "is no film or folder of photographs: --geoid-m does not apply"),
        (("--clock-offset", 2), "is no film: --clock-offset does not apply"),
        # Nought is said like any other number: it was taken for nothing said.
        (("--clock-offset", 0), "is no film: --clock-offset does not apply"),
        (("--geoid-m", 0), "is no film or folder of photographs: --geoid-m does not apply"),
    ],
)
def test_options_of_other_recordings_are_named_as_they_were_given(
    plain: Path, tmp_path: Path, given: tuple[str, int], said: str
) -> None:
    flown = write_hovering(tmp_path / "rec", {"uav1": FIRST})
    done = crowdfence("run", flown, *FEW_FILES, "-t", plain, "--assume-local", *given, "-o", tmp_path / "out")
    assert done.returncode == 1
    assert done.stderr.strip() == f"error: {flown} {said}"
