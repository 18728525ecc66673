"""The plain folder, and what all recordings share: instants, refusals, damaged pixels."""

import json
import re

import numpy as np
import pytest
from PIL import Image

from crowdfence.cli.wording import in_options
from crowdfence.georeference import Georeference
from crowdfence.sources import FrameError, RefusedFrame, open_recording
from crowdfence.sources.convert import convert
from support.small_recordings import (
    EPOCH_NS,
    HEIGHT,
    ORIGIN,
    WIDTH,
    camera_enu,
    flight,
    heatmap,
    write_airsim,
    write_folder,
    write_hovering,
)

MS = 1_000_000


@pytest.fixture
def recorded(tmp_path):
    return write_folder(tmp_path / "rec", flight())


def edit_description(folder, change):
    path = folder / "recording.json"
    description = json.loads(path.read_text())
    change(description)
    path.write_text(json.dumps(description))


def heatmap_file(folder, frame, suffix="png"):
    return folder / "heatmaps" / f"{frame.drone}_{frame.stamp_ns}.{suffix}"


def test_what_is_in_it(recorded):
    recording = open_recording(recorded)
    assert recording.drones == ("uav1", "uav3", "uav_2") and len(recording.frames) == 18
    assert recording.georeference.height_m == 1200.0 and recording.terrain is None
    for frame in recording.frames:
        np.testing.assert_array_equal(frame.heatmap(), heatmap(frame.drone, frame.stamp_ns))
        np.testing.assert_allclose(
            frame.world_from_camera, camera_enu(frame.drone, frame.stamp_ns), atol=1e-3
        )


@pytest.mark.parametrize("swapped", [False, True])
def test_positions_in_degrees_are_refused(recorded, swapped):
    """As metres all of them are one point: every picture of the flight was put there, without a word."""
    path = recorded / "poses.csv"
    header, *rows = path.read_text().splitlines()
    place = Georeference(*ORIGIN)
    lines = [header]
    for row in rows:
        drone, stamp, x, y, z, *turn = row.split(",")
        if drone == "uav3":
            latitude, longitude, _ = place.geodetic_from_local([[float(x), float(y), float(z)]])
            x, y = (latitude[0], longitude[0]) if swapped else (longitude[0], latitude[0])
        lines.append(",".join(map(str, [drone, stamp, x, y, z, *turn])))
    path.write_text("\n".join(lines) + "\n")
    with pytest.raises(ValueError, match=r"poses\.csv: x [\d.]+ and y [\d.]+ of 'uav3' are degrees"):
        open_recording(recorded)
    edit_description(recorded, lambda told: told["georeference"].update(latitude_deg=-33.0))
    assert len(open_recording(recorded).drones) == 3  # of another place they may be metres


def test_the_same_flight_as_airsim_and_as_folder(recorded, tmp_path):
    """Two descriptions of one flight, through two readers: poses agree to rounding."""
    airsim = open_recording(write_airsim(tmp_path / "airsim", flight()))
    for a, b in zip(airsim.frames, open_recording(recorded).frames, strict=True):
        assert (a.drone, a.stamp_ns) == (b.drone, b.stamp_ns)
        np.testing.assert_allclose(a.world_from_camera, b.world_from_camera, atol=1e-9)
        assert a.camera.fx == pytest.approx(b.camera.fx, rel=1e-14)


def test_folder_to_mission(recorded, tmp_path):
    convert(open_recording(recorded), tmp_path / "m.mcap")
    for a, b in zip(open_recording(recorded).frames, open_recording(tmp_path / "m.mcap").frames, strict=True):
        assert a.view().world_from_camera.tobytes() == b.view().world_from_camera.tobytes()
        assert a.view().heatmap.tobytes() == b.view().heatmap.tobytes()


def test_npy_and_sixteen_bit_heatmaps(recorded):
    frames = open_recording(recorded).frames
    for frame in frames[:2]:
        heatmap_file(recorded, frame).unlink()
    np.save(heatmap_file(recorded, frames[0], "npy"), np.full((HEIGHT, WIDTH), 0.25))
    Image.fromarray(np.full((6, 8), 13107, dtype=np.uint16)).save(heatmap_file(recorded, frames[1]))
    frames = open_recording(recorded).frames
    assert frames[0].view().heatmap[5, 5] == np.float32(0.25)
    assert frames[1].view().heatmap[0, 0] == pytest.approx(0.2, abs=1e-7)  # 13107 / 65535


def bad_heatmaps():
    rgb = np.zeros((6, 8, 3), dtype=np.uint8)
    return [
        (lambda path: path.write_bytes(path.read_bytes()[:-30]), "heatmap cannot be read: .* is damaged"),
        (lambda path: path.write_bytes(b""), "heatmap cannot be read: .* is damaged"),
        (lambda path: Image.fromarray(rgb).save(path), "has mode RGB: a heatmap is a grey picture"),
        (
            lambda path: Image.new("L", (WIDTH * 2, HEIGHT * 2)).save(path),
            "declares 64x48 pixels, more than 32x24",
        ),
        (lambda path: Image.new("L", (6, 8)).save(path), "8 x 6"),
        (lambda path: save_npy(path, np.full((6, 8), np.nan)), "NaN"),
        (lambda path: save_npy(path, np.full((6, 8), 1.5)), r"1\.5"),
        (lambda path: save_npy(path, np.full((6, 8), -np.inf)), "-inf"),
        (lambda path: save_npy(path, np.zeros((6, 8, 1))), r"shape \[6, 8, 1\]"),
        (lambda path: save_npy(path, np.zeros((0, 8))), "0 x 8"),
        (
            lambda path: save_npy(path, np.zeros((6, 8), dtype=np.int32)),
            "holds int32: a heatmap is uint8 or float",
        ),
        (lambda path: save_npy(path, np.array([[{}]])), "holds object"),
        (
            lying_npy,
            r"holds 384 bytes of values, its shape \(1073741824, 1073741824\) asks for 9223372036854775808",
        ),
    ]


def save_npy(path, values):
    path.unlink()
    np.save(path.with_suffix(".npy"), values)


def lying_npy(path):
    """A header that claims 2^60 values."""
    save_npy(path, np.zeros((6, 8)))
    npy = path.with_suffix(".npy")
    content = npy.read_bytes()
    shape = b"'shape': (6, 8), }"
    claim = b"'shape': (1073741824, 1073741824), }"
    npy.write_bytes(content.replace(shape + b" " * (len(claim) - len(shape)), claim))


@pytest.mark.parametrize(("damage", "message"), bad_heatmaps())
def test_a_bad_heatmap_costs_one_view_and_is_reported(recorded, damage, message):
    bad = open_recording(recorded).frames[4]
    damage(heatmap_file(recorded, bad))
    recording = open_recording(recorded)
    found = [instant.views() for instant in recording.instants()]
    views = [view for one in found for view in one.views]
    assert len(views) == 17 and (bad.drone, bad.stamp_ns) not in {(v.drone, v.stamp_ns) for v in views}
    (refused,) = (refused for one in found for refused in one.refused)
    assert (refused.drone, refused.stamp_ns) == (bad.drone, bad.stamp_ns)
    with pytest.raises(FrameError, match=message) as error:
        recording.frames[4].view()
    assert refused.reason == error.value.reason
    assert recording.refused == ()  # nothing was wrong when it was opened


def test_two_heatmaps_for_one_frame_are_ambiguous(recorded):
    frame = open_recording(recorded).frames[0]
    np.save(heatmap_file(recorded, frame, "npy"), np.zeros((6, 8)))
    recording = open_recording(recorded)
    assert len(recording.frames) == 17
    assert "2 heatmaps for one frame" in recording.refused[0].reason


def test_two_pictures_for_one_frame_are_ambiguous(recorded):
    """The shot and, say, an exported mask beside it: which of them the detector should see, nobody knows."""
    (recorded / "images").mkdir()
    first, second = open_recording(recorded).frames[:2]
    for frame, suffixes in ((first, ("jpg", "png")), (second, ("jpg",))):
        for suffix in suffixes:
            name = f"{frame.drone}_{frame.stamp_ns}.{suffix}"
            Image.new("RGB", (WIDTH, HEIGHT)).save(recorded / "images" / name)
    recording = open_recording(recorded)
    assert len(recording.frames) == 17
    (refused,) = recording.refused
    name = f"{first.drone}_{first.stamp_ns}"
    assert refused.reason == f"2 pictures for one frame: {name}.jpg, {name}.png"


def test_images_alone_make_frames_for_a_detector(recorded):
    frame = open_recording(recorded).frames[0]
    heatmap_file(recorded, frame).unlink()
    (recorded / "images").mkdir()
    Image.new("RGB", (WIDTH, HEIGHT), (1, 2, 3)).save(
        recorded / "images" / f"{frame.drone}_{frame.stamp_ns}.png"
    )
    recording = open_recording(recorded)
    assert len(recording.frames) == 18 and recording.frames[0].image()[0, 0].tolist() == [1, 2, 3]
    with pytest.raises(FrameError, match="has no heatmap"):
        recording.frames[0].view()
    assert recording.frames[0].view(np.full((6, 8), 0.5)).heatmap[0, 0] == 0.5


@pytest.mark.parametrize("size", [(WIDTH, HEIGHT - 1), (3000, 3000)])
def test_an_image_of_another_size_than_its_camera(recorded, size):
    frame = open_recording(recorded).frames[0]
    (recorded / "images").mkdir()
    Image.new("L", size).save(recorded / "images" / f"{frame.drone}_{frame.stamp_ns}.png")
    with pytest.raises(FrameError, match=f"is {size[0]}x{size[1]}, the camera is 32x24"):
        open_recording(recorded).frames[0].image()


def test_strange_files_and_rows_are_reported(recorded):
    (recorded / "heatmaps" / "readme.txt").write_text("x")
    poses = recorded / "poses.csv"
    poses.write_text(poses.read_text() + "uav1,12,1,2\nuav1,1.5,0,0,0,1,0,0,0\n")
    recording = open_recording(recorded)
    assert any("1 files in heatmaps/ are not named <drone>_<stamp_ns>" in line for line in recording.warnings)
    assert any(
        "poses.csv: 2 rows cannot be read, first: line 167 has 4 columns" in line
        for line in recording.warnings
    )


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda d: d.pop("cameras"), 'must be an object with "cameras"'),
        (lambda d: d.update(cameras={"other": {}}), "has no camera for drone 'uav1'"),
        (lambda d: d["cameras"]["*"].pop("fy"), "the camera of 'uav1' has no 'fy'"),
        (lambda d: d["cameras"]["*"].update(fx=-1), "the camera of 'uav1' cannot be used"),
        (lambda d: d["cameras"]["*"].update(width="wide"), "the camera of 'uav1' cannot be used"),
        (lambda d: d["cameras"]["*"].update(model="mirror"), "unknown model 'mirror'"),
        (
            lambda d: d["cameras"]["*"].update(distortions=[0.1, 0, 0, 0]),
            "the camera of 'uav1' has an unknown key 'distortions'; known are width, height, fx, fy, cx, cy, "
            "model, distortion",
        ),
        (lambda d: d["cameras"]["*"].update(k1=0.1), "has an unknown key 'k1'"),
        (
            lambda d: d["cameras"].update({"*": 5}),
            "the camera of 'uav1' is 5; it must be an object with width",
        ),
        (
            lambda d: d["cameras"]["*"].update(fx="24"),
            "the camera of 'uav1' cannot be used: fx is '24'; it must be a number, without quotes",
        ),
        (
            lambda d: d["cameras"]["*"].update(width="6" * 400),
            r"width is '6{80}\.\.\.'; it must be a whole number of at least 1$",
        ),
        (lambda d: d["cameras"]["*"].update(cx=None), "cx is None; it must be a number"),
        (lambda d: d["cameras"]["*"].update(fy=True), "fy is True; it must be a number"),
        (
            lambda d: d["cameras"]["*"].update(distortion=[0.1, 0, 0, 0]),
            "cannot be used: a pinhole camera has no distortion: is it brown_conrady or kannala_brandt?",
        ),
        (
            lambda d: d["cameras"]["*"].update(distortion=0.1),
            "distortion is 0.1; it must be a list of numbers",
        ),
        (
            lambda d: d["cameras"]["*"].update(distortion=[0, "x"]),
            r"distortion\[1\] is 'x'; it must be a number",
        ),
        (
            lambda d: d.update(georeference={"latitude_deg": 1, "height_m": 0}),
            "\"georeference\" has no 'longitude_deg'; it needs latitude_deg, longitude_deg, height_m",
        ),
        (
            lambda d: d.update(georeference={"latitude": 1}),
            "\"georeference\" has an unknown key 'latitude'; known are latitude_deg, longitude_deg, height_m",
        ),
        (
            lambda d: d.update(georeference=[46.5, 8.0, 0.0]),
            r'"georeference" is \[46.5, 8.0, 0.0\]; it must be',
        ),
        (
            lambda d: d["georeference"].update(height_m="48 m"),
            "\"georeference\": height_m is '48 m'; it must be",
        ),
        (
            lambda d: d["georeference"].update(latitude_deg=95),
            r'"georeference": latitude_deg is 95.0, must lie in \[-90, 90\]',
        ),
    ],
)
def test_descriptions_that_cannot_be_used(recorded, change, message):
    edit_description(recorded, change)
    with pytest.raises(ValueError, match=message):
        open_recording(recorded)


@pytest.mark.parametrize(
    ("key", "value"),
    [("*", {"width": 64}), ("fx", 30.0), ("georeference", None)],
)
def test_what_a_description_says_twice_is_refused(recorded, key, value):
    """Of two cameras of one name the last counted, in silence, whichever drone it was meant for."""
    path = recorded / "recording.json"
    description = path.read_text()
    assert description.count(f'"{key}":') == 1
    path.write_text(description.replace(f'"{key}":', f'"{key}": {json.dumps(value)}, "{key}":'))
    with pytest.raises(ValueError, match=re.escape(f"recording.json has two keys '{key}' side by side")):
        open_recording(recorded)


def test_a_camera_of_a_misspelt_drone_is_told(recorded):
    """The drone took the lens of all others, and its crowds lay elsewhere, in silence."""

    def named(*names):
        own = json.loads((recorded / "recording.json").read_text())["cameras"]["*"]
        edit_description(recorded, lambda d: d["cameras"].update(dict.fromkeys(names, own)))
        return open_recording(recorded).warnings

    assert named("uav_2") == ()
    (warning,) = named("uav03")
    assert "a camera of 'uav03' and no such drone, and 'uav1', 'uav3' is given that of \"*\"" in warning
    assert named("uav1", "uav3") == ()  # of one that did not fly


def test_what_else_a_description_says_is_told(recorded):
    edit_description(recorded, lambda d: d.update(georefrence=d.pop("georeference")))
    recording = open_recording(recorded)
    assert recording.georeference is None
    told = 'recording.json: georefrence not used; known are "cameras", "georeference", "terrain"'
    assert told in recording.warnings
    assert in_options(told) == told  # they are keys, no options of ours


def test_lens_models_of_the_description(recorded):
    distortion = [0.01, -0.002, 0.0003, 0.00004]
    edit_description(
        recorded, lambda d: d["cameras"]["*"].update(model="kannala_brandt", distortion=distortion)
    )
    camera = open_recording(recorded).frames[0].camera
    assert (camera.model, list(camera.distortion)) == ("kannala_brandt", distortion)
    edit_description(recorded, lambda d: d["cameras"]["*"].update(model="pinhole", distortion=[0, 0, 0, 0]))
    assert not any(open_recording(recorded).frames[0].camera.distortion)


def test_a_folder_without_description(recorded):
    (recorded / "recording.json").unlink()
    with pytest.raises(ValueError, match=r"recording.json is missing"):
        open_recording(recorded)


# --- what all recordings share ----------------------------------------------------------------------------


def test_instants_of_three_drones(recorded):
    instants = list(open_recording(recorded).instants())
    assert [[frame.drone for frame in instant.frames] for instant in instants] == [
        ["uav1", "uav_2", "uav3"]
    ] * 6
    assert instants[0].stamp_ns == EPOCH_NS + 71 * MS + 12_345
    assert len(list(open_recording(recorded).instants(tolerance_ms=40))) == 9
    assert len(list(open_recording(recorded).instants(tolerance_ms=0))) == 18


def test_a_drone_that_joins_late_and_one_that_leaves(tmp_path):
    flown = flight()
    flown = flown.with_frames("uav3", flown.frame_stamps_ns["uav3"][3:])
    flown = flown.with_frames("uav1", flown.frame_stamps_ns["uav1"][:4])
    recording = open_recording(write_folder(tmp_path / "rec", flown))
    assert recording.drones == ("uav1", "uav3", "uav_2")
    assert [len(instant.frames) for instant in recording.instants()] == [2, 2, 2, 3, 2, 2]


def test_a_part_of_the_fleet(recorded):
    recording = open_recording(recorded)
    assert {f.drone for i in recording.instants(drones=["uav1", "uav3"]) for f in i.frames} == {
        "uav1",
        "uav3",
    }
    with pytest.raises(ValueError, match="no drone 'uav9' in rec: it holds uav1, uav3, uav_2"):
        recording.instants(drones=["uav9"])
    with pytest.raises(ValueError, match="no drone 'uav9'"):
        recording.frames_of("uav9")


@pytest.mark.parametrize("tolerance_ms", [-1, 1e308, float("nan"), float("inf")])
def test_tolerances_that_make_no_sense(recorded, tolerance_ms):
    with pytest.raises(ValueError, match="tolerance_ms must be finite and not negative"):
        open_recording(recorded).instants(tolerance_ms)


def test_a_gap_in_one_drones_telemetry_leaves_the_others(tmp_path):
    flown = flight().without_telemetry("uav_2", EPOCH_NS + 150 * MS, EPOCH_NS + 450 * MS)
    recording = open_recording(write_folder(tmp_path / "rec", flown))
    assert [len(recording.frames_of(drone)) for drone in ("uav1", "uav_2", "uav3")] == [6, 3, 6]
    assert all(
        isinstance(refused, RefusedFrame) and refused.drone == "uav_2" for refused in recording.refused
    )
    assert "uav_2 at 1760000000237012345: no pose" in str(recording.refused[0])


def test_one_frame_hours_away(tmp_path):
    flown = flight()
    stamps = flown.frame_stamps_ns["uav1"]
    far = stamps[-1] + 7200 * 10**9
    recording = open_recording(write_folder(tmp_path / "rec", flown.with_frames("uav1", [*stamps, far])))
    assert len(recording.frames) == 18
    assert "jumps 2.00 h away from the 6 frames of this drone" in recording.refused[0].reason


@pytest.mark.parametrize(
    ("limit", "value"), [("max_pose_gap_s", 0), ("max_jump_s", -1), ("max_jump_s", float("nan"))]
)
def test_limits_that_make_no_sense(recorded, limit, value):
    with pytest.raises(ValueError, match=f"{limit} must be positive"):
        open_recording(recorded, **{limit: value})


def test_paths_that_hold_no_recording(tmp_path):
    with pytest.raises(FileNotFoundError):
        open_recording(tmp_path / "nothing")
    with pytest.raises(ValueError, match=r"holds no recording: neither airsim_rec.txt"):
        open_recording(tmp_path)
    for name in ("flight.mcap", "DJI_0001.MP4", "dem.tif"):
        (tmp_path / name).touch()
    with pytest.raises(ValueError, match=r"MultiviewX; name a recording in it: DJI_0001.MP4, flight.mcap$"):
        open_recording(tmp_path)
    (tmp_path / "poses.csv").write_text("drone,stamp_ns,x,y,z,qw,qx,qy,qz\n")
    (tmp_path / "recording.json").write_text('{"cameras": {}}')
    with pytest.raises(ValueError, match="holds no frames"):
        open_recording(tmp_path)


def test_airsim_options_belong_to_airsim(recorded, tmp_path):
    with pytest.raises(ValueError, match="is no AirSim recording: crowd_colors does not apply"):
        open_recording(recorded, crowd_colors=[(1, 2, 3)])
    with pytest.raises(TypeError, match="colour"):
        open_recording(write_airsim(tmp_path / "airsim", flight()), colour=1)


@pytest.mark.parametrize(
    ("header", "encoding", "said"),
    [
        ("drone;stamp_ns;x;y;z;qw;qx;qy;qz", "utf-8", "Save it with commas instead of semicolons"),
        ("drone\tstamp_ns\tx\ty\tz\tqw\tqx\tqy\tqz", "utf-8", "Save it with commas instead of tabs"),
        ("drone,stamp_ns,x,y,z,qw,qx,qy,qz", "utf-16", "Save it as UTF-8"),
        # Which of the two is east, nobody knows.
        ("drone,stamp_ns,x,y,z,qw,qx,qy,qz,x", "utf-8", "has 2 columns 'x'; name one of them so"),
    ],
)
def test_tables_of_another_form_say_what_to_do(recorded, header, encoding, said):
    (recorded / "poses.csv").write_bytes((header + "\n").encode(encoding))
    with pytest.raises(ValueError, match="poses.csv") as refused:
        open_recording(recorded)
    assert said in str(refused.value)


def test_labels_of_no_frame_are_counted(tmp_path):
    """A tool that rounded stamps to microseconds, and one more file for a frame that was deleted."""
    folder = write_hovering(tmp_path / "m", {"uav1": [EPOCH_NS + 1234, EPOCH_NS + 10**9]})
    labels, layer = folder / "truth" / "regions", folder / "truth" / "layers" / "water"
    (folder / "layers" / "water").mkdir(parents=True)
    for of in (labels, layer):
        of.mkdir(parents=True)
        for stamp_ns in (EPOCH_NS + 1000, EPOCH_NS + 10**9, EPOCH_NS + 3 * 10**9):
            Image.new("L", (32, 24)).save(of / f"uav1_{stamp_ns}.png")
    found = open_recording(folder)
    told = [warning for warning in found.warnings if "label file" in warning]
    assert [one.partition(";")[0] for one in told] == [
        f"2 of 3 label files in truth/{kind}/ belong to no frame, first: uav1_{EPOCH_NS + 1000}.png"
        for kind in ("regions", "layers/water")
    ]
    for of in (labels, layer):
        for stamp_ns in (EPOCH_NS + 1000, EPOCH_NS + 3 * 10**9):
            (of / f"uav1_{stamp_ns}.png").unlink()
    assert not any("label file" in warning for warning in open_recording(folder).warnings)
