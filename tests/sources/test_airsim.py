"""AirSim recordings: geometry against direction vectors, and every trap of the format."""

import json
import shutil

import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import Rotation

from crowdfence.sources import FrameError, open_recording
from crowdfence.sources.airsim.table import parse_image_name
from crowdfence.truth.recorded_people import require_people
from support.small_recordings import (
    EPOCH_NS,
    HEIGHT,
    MOUNT,
    STARTS,
    WIDTH,
    body_ned,
    camera_enu,
    flight,
    heatmap,
    regions,
    write_airsim,
)

MS = 1_000_000


@pytest.fixture
def recorded(tmp_path):
    return write_airsim(tmp_path / "2025-10-09-08-53-20", flight())


def edit_settings(folder, change):
    path = folder / "settings.json"
    settings = json.loads(path.read_text())
    change(settings)
    path.write_text(json.dumps(settings))


def edit_table(folder, change):
    path = folder / "airsim_rec.txt"
    lines = path.read_text().splitlines()
    path.write_text("\n".join(change(lines)) + "\n")


def pose_error(frame, expected):
    """(metres, degrees) between a frame's pose and the expected [4, 4]."""
    apart = np.linalg.norm(frame.world_from_camera[:3, 3] - expected[:3, 3])
    turn = Rotation.from_matrix(expected[:3, :3].T @ frame.world_from_camera[:3, :3])
    return apart, np.degrees(turn.magnitude())


def test_what_is_in_it(recorded):
    recording = open_recording(recorded)
    assert recording.drones == ("uav1", "uav3", "uav_2")
    assert [len(recording.frames_of(drone)) for drone in recording.drones] == [6, 6, 6]
    assert recording.span_ns == (EPOCH_NS + 12_345, EPOCH_NS + 571 * MS + 12_345)
    assert recording.terrain == recorded / "terrain" / "dem.tif"
    where = recording.georeference
    assert (where.latitude_deg, where.longitude_deg, where.height_m) == (46.5, 8.0, 1200.0)
    assert recording.refused == () and recording.warnings == ()


def test_cameras_stand_where_direction_vectors_put_them(recorded):
    """Between two 50 Hz rows the curves of the flight bend by less than 1 mm and 0.01 degrees."""
    for frame in open_recording(recorded).frames:
        metres, degrees = pose_error(frame, camera_enu(frame.drone, frame.stamp_ns))
        assert metres < 1e-3 and degrees < 0.01


def test_a_hand_worked_pose(tmp_path):
    """Level body facing east, gimbal 90 degrees down: image right is south, image down is west."""
    flown = flight(frames=1)
    folder = write_airsim(tmp_path / "rec", flown)
    half = np.sqrt(0.5)
    stamp = flown.frame_stamps_ns["uav1"][0]
    header = "stamp_ns,position_x,position_y,position_z,q_w,q_x,q_y,q_z,gimbal_w,gimbal_x,gimbal_y,gimbal_z\n"
    row = f"1,2,-10,{half},0,0,{half},{half},0,{-half},0\n"
    (folder / "telemetry" / "uav1.csv").write_text(header + f"{stamp},{row}")
    edit_settings(
        folder, lambda s: s["Vehicles"].update(uav1={**s["Vehicles"]["uav1"], "X": 100, "Y": 50, "Z": -5})
    )
    frame = open_recording(folder).frames_of("uav1")[0]
    # North 100 + 1, east 50 + 2 + 0.35 (mount forward = east), up 5 + 10 - 0.12.
    expected = [[0, -1, 0, 52.35], [-1, 0, 0, 101.0], [0, 0, -1, 14.88], [0, 0, 0, 1]]
    np.testing.assert_allclose(frame.world_from_camera, expected, atol=1e-12)


def test_focal_length_from_the_field_of_view(recorded):
    camera = open_recording(recorded).frames[0].camera
    assert camera.fx == camera.fy == pytest.approx(16 / 0.8390996311772800, rel=1e-12)  # tan 40 deg
    assert (camera.width, camera.height, camera.cx, camera.cy) == (32, 24, 16, 12)


def test_pixels_belong_to_their_frames(recorded):
    recording = open_recording(recorded, crowd_colors=[(89, 121, 72)])
    for frame in recording.frames:
        np.testing.assert_array_equal(frame.heatmap(), heatmap(frame.drone, frame.stamp_ns))
        np.testing.assert_array_equal(frame.regions(), regions(frame.drone, frame.stamp_ns))
        np.testing.assert_array_equal(frame.silhouettes(), regions(frame.drone, frame.stamp_ns) == 2)
        assert frame.image().shape == (HEIGHT, WIDTH, 3)
        assert frame.image()[0, 0, 0] == regions(frame.drone, frame.stamp_ns)[0, 0] * 60


def test_two_heatmaps_of_one_picture_are_not_chosen_from(recorded):
    """One file says that nobody is there, the other that a crowd is: who wins must not hang on its suffix."""
    png = sorted((recorded / "heatmaps").glob("heatmap_uav1_*.png"))[2]
    np.save(png.with_suffix(".npy"), np.ones((12, 16), np.float32))
    frame = open_recording(recorded).frames_of("uav1")[2]
    with pytest.raises(FrameError, match=rf"2 heatmaps for one frame: {png.name}, {png.stem}.npy; remove"):
        frame.heatmap()
    assert frame.image().any()


def test_segmentation_needs_to_know_its_colours(recorded):
    with pytest.raises(FrameError, match="has no silhouettes"):
        open_recording(recorded).frames[0].silhouettes()


def test_pfm_has_its_first_row_on_top(recorded):
    depth = open_recording(recorded).frames[0].depth_m()
    assert depth[0, :3].tolist() == [0.0, 1.0, 2.0] and depth[HEIGHT - 1, 0] == (HEIGHT - 1) * WIDTH


def test_depth_along_the_ray_becomes_planar(recorded):
    def rename(lines):
        return [line.replace("_front_center_1_", "_front_center_2_") for line in lines]

    edit_table(recorded, rename)
    for path in (recorded / "images").glob("*_front_center_1_*"):
        path.rename(path.with_name(path.name.replace("_front_center_1_", "_front_center_2_")))
    edit_settings(recorded, lambda s: [add_type_2(vehicle) for vehicle in s["Vehicles"].values()])
    frame = open_recording(recorded).frames[0]
    corner = np.array([0.5 - 16, 0.5 - 12]) / frame.camera.fx
    along_ray = (
        HEIGHT - 1
    ) * WIDTH  # of the lower left pixel, which is as far off the axis as the upper left
    assert frame.depth_m()[HEIGHT - 1, 0] == pytest.approx(along_ray / np.sqrt(1 + corner @ corner), rel=1e-6)


def add_type_2(vehicle):
    settings = vehicle["Cameras"]["front_center"]["CaptureSettings"]
    settings.append({**settings[0], "ImageType": 2})


def test_depth_as_centimetres_and_never_from_eight_bits(recorded):
    edit_table(recorded, lambda lines: [line.replace(".pfm", ".png") for line in lines])
    frames = open_recording(recorded).frames
    names = [recorded / "images" / f"img_{f.drone}_front_center_1_{f.stamp_ns}.png" for f in frames[:2]]
    centimetres = np.full((HEIGHT, WIDTH), 1234, dtype=np.uint16)
    centimetres[0, 0] = 0
    Image.fromarray(centimetres).save(names[0])
    Image.fromarray(np.full((HEIGHT, WIDTH), 200, dtype=np.uint8)).save(names[1])
    assert frames[0].depth_m()[1, 1] == np.float32(12.34) and np.isnan(frames[0].depth_m()[0, 0])
    with pytest.raises(FrameError, match="8-bit depth is clipped"):
        frames[1].depth_m()


def test_depth_vis_is_no_truth(recorded):
    edit_table(
        recorded, lambda lines: [line.replace("_front_center_1_", "_front_center_3_") for line in lines]
    )
    recording = open_recording(recorded)
    assert any("DepthVis" in warning for warning in recording.warnings)
    with pytest.raises(FrameError, match="has no depth"):
        recording.frames[0].depth_m()


def test_truth_of_another_size_is_not_laid_over_the_picture(recorded):
    def shrink(settings):
        settings["Vehicles"]["uav1"]["Cameras"]["front_center"]["CaptureSettings"][1]["Width"] = 16

    edit_settings(recorded, shrink)
    recording = open_recording(recorded)
    assert (
        "uav1: planar depth: not read, its size or field of view is not the colour picture's"
        in recording.warnings
    )
    assert recording.frames_of("uav1")[0].pixels.depth_m is None
    assert recording.frames_of("uav3")[0].pixels.depth_m is not None


@pytest.mark.parametrize(
    ("file", "vehicle", "camera", "image_type", "stamp"),
    [
        ("img_uav_2_front_center_0_123.png", "uav_2", "front_center", 0, 123),
        ("img_Drone1_0_5_123.png", "Drone1", "0", 5, 123),
        ("img_0_0_123.png", "Drone1", "0", 0, 123),
        ("img_front_center_1_123.pfm", "Drone1", "front_center", 1, 123),
        ("img__0_0_123.ppm", "", "0", 0, 123),
        ("img_0_0_123.png", "", "0", 0, 123),
        ("img_uav1_cam_3_5_123.png", "uav1", "cam_3", 5, 123),
        ("img_uav1_front_center_10_people_v2_123.png", "uav1", "front_center", 10, 123),
    ],
)
def test_image_names_of_all_versions(file, vehicle, camera, image_type, stamp):
    name = parse_image_name(file, vehicle)
    assert (name.camera, name.image_type, name.stamp_ns) == (camera, image_type, stamp)


def test_a_vehicle_named_like_half_a_camera():
    assert parse_image_name("img_front_center_0_1.png", "front").camera == "center"
    assert parse_image_name("img_front_center_0_1.png", "front", ["front_center"]).camera == "front_center"


@pytest.mark.parametrize(
    "file", ["img_uav1_front_0.png", "../img_uav1_c_0_1.png", "img_uav1_../c_0_1.png", "x"]
)
def test_other_names_are_refused(file):
    assert parse_image_name(file, "uav1") is None


def old_airsim(lines):
    """AirSim 1.2: no VehicleName column, no vehicle in the file names."""
    kept = [line.split("\t", 1)[1] for line in lines if line.startswith(("VehicleName", "uav1\t"))]
    return [line.replace("img_uav1_", "img_") for line in kept]


def test_old_airsim_without_vehicle_names(tmp_path):
    folder = write_airsim(tmp_path / "rec", flight())
    edit_table(folder, old_airsim)
    edit_settings(folder, lambda s: [s["Vehicles"].pop(name) for name in ("uav_2", "uav3")])
    recording = open_recording(folder)
    assert recording.drones == ("uav1",) and len(recording.frames) == 6
    metres, degrees = pose_error(recording.frames[3], camera_enu("uav1", recording.frames[3].stamp_ns))
    assert metres < 1e-3 and degrees < 0.01


def test_without_telemetry_the_body_carries_the_camera(tmp_path):
    recording = open_recording(write_airsim(tmp_path / "rec", flight(), telemetry=False))
    assert sum("no telemetry" in warning and "gimbal" in warning for warning in recording.warnings) == 3
    frame = recording.frames_of("uav3")[2]
    position, body, _ = body_ned("uav3", frame.stamp_ns)
    north, east, down = np.array(STARTS["uav3"]) + position + body.apply(MOUNT)
    np.testing.assert_allclose(frame.world_from_camera[:3, 3], [east, north, -down], atol=1e-9)
    forward = body.apply([1.0, 0.0, 0.0])
    np.testing.assert_allclose(
        frame.world_from_camera[:3, 2], [forward[1], forward[0], -forward[2]], atol=1e-9
    )


def test_mount_angles_count_without_telemetry(tmp_path):
    folder = write_airsim(tmp_path / "rec", flight(), telemetry=False)
    edit_settings(folder, lambda s: s["Vehicles"]["uav1"]["Cameras"]["front_center"].update(Pitch=-90, Yaw=0))
    frame = open_recording(folder).frames_of("uav1")[0]
    down = body_ned("uav1", frame.stamp_ns)[1].apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(frame.world_from_camera[:3, 2], [down[1], down[0], -down[2]], atol=1e-9)


def test_what_is_not_a_number_is_not_set(tmp_path):
    """AirSim's documentation lists all settings with NaN for those without a default."""
    folder = write_airsim(tmp_path / "rec", flight(), telemetry=False)
    before = open_recording(folder).frames_of("uav1")[0].world_from_camera
    nothing = dict.fromkeys(("X", "Y", "Z", "Pitch", "Roll", "Yaw"), float("nan"))
    edit_settings(folder, lambda settings: settings.setdefault("CameraDefaults", {}).update(nothing))
    np.testing.assert_array_equal(open_recording(folder).frames_of("uav1")[0].world_from_camera, before)


def test_camera_defaults_hold_for_cameras_that_do_not_say_otherwise(tmp_path):
    """CameraDefaults "can be overridden for individual camera" (AirSim's documentation); its angles went
    unread, and the camera looked ahead."""
    folder = write_airsim(tmp_path / "rec", flight(), telemetry=False)

    def down_by_default(settings):
        settings.setdefault("CameraDefaults", {}).update(Pitch=-90, Roll=0, Yaw=0)
        for name in ("Pitch", "Roll", "Yaw"):
            settings["Vehicles"]["uav1"]["Cameras"]["front_center"].pop(name, None)

    edit_settings(folder, down_by_default)
    frame = open_recording(folder).frames_of("uav1")[0]
    down = body_ned("uav1", frame.stamp_ns)[1].apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(frame.world_from_camera[:3, 2], [down[1], down[0], -down[2]], atol=1e-9)


def test_a_log_of_the_camera_itself(tmp_path):
    """`camera_position` and `camera_orientation` of AirSim's ImageResponse: NED from the vehicle's start."""
    flown = flight()
    folder = write_airsim(tmp_path / "rec", flown)
    lines = [
        "stamp_ns,camera_position_x,camera_position_y,camera_position_z,camera_q_w,camera_q_x,camera_q_y,camera_q_z"
    ]
    for stamp in flown.telemetry_stamps_ns["uav1"]:
        position, body, gimbal = body_ned("uav1", stamp)
        x, y, z, w = (body * gimbal).as_quat()
        lines.append(",".join(map(str, [stamp, *(position + body.apply(MOUNT)), w, x, y, z])))
    (folder / "telemetry" / "uav1.csv").write_text("\n".join(lines))
    for frame in open_recording(folder).frames_of("uav1"):
        metres, degrees = pose_error(frame, camera_enu("uav1", frame.stamp_ns))
        assert metres < 1e-3 and degrees < 0.01


def test_file_names_on_another_clock(tmp_path):
    """Real AirSim: the table counts simulated milliseconds, the file names the machine's nanoseconds."""
    folder = write_airsim(tmp_path / "rec", flight(), telemetry=False)
    hours_later = EPOCH_NS + 5 * 3600 * 10**9
    for path in [*(folder / "images").iterdir(), *(folder / "heatmaps").iterdir()]:
        stamp = path.stem.rsplit("_", 1)[1]
        path.rename(path.with_name(path.name.replace(stamp, str(int(stamp) - EPOCH_NS + hours_later))))
    edit_table(folder, lambda lines: [line.replace("_1760000", "_1760018") for line in lines])
    recording = open_recording(folder)
    assert sum("whole milliseconds" in warning for warning in recording.warnings) == 3
    frames = recording.frames_of("uav_2")
    assert [frame.stamp_ns for frame in frames] == [
        EPOCH_NS + (37 + 100 * number) * MS for number in range(6)
    ]
    np.testing.assert_array_equal(frames[1].heatmap(), heatmap("uav_2", EPOCH_NS + 137 * MS + 12_345))


def test_vehicles_on_two_clocks_are_not_mixed(tmp_path):
    """Telemetry on the file names' clock for one vehicle only; the others fall back to the table's."""
    folder = write_airsim(tmp_path / "rec", flight())
    for name in ("uav_2", "uav3"):
        (folder / "telemetry" / f"{name}.csv").unlink()
    edit_table(folder, lambda lines: [line.replace("\t1760000", "\t1760018", 1) for line in lines])
    with pytest.raises(ValueError, match=r"'uav1' come from the file names, those of 'uav.*' from the table"):
        open_recording(folder)


def test_truth_pairs_by_order_when_every_file_has_its_own_nanoseconds(recorded):
    def later_depth(lines):
        return [line.replace("345.pfm", "999.pfm") for line in lines]

    edit_table(recorded, later_depth)
    for path in (recorded / "images").glob("*345.pfm"):
        path.rename(path.with_name(path.name.replace("345.pfm", "999.pfm")))
    assert open_recording(recorded).frames[0].depth_m()[0, 2] == 2.0


def test_several_pictures_in_one_line(recorded):
    """AirSim issue 2110. On one clock each picture is a frame of its own."""

    def merge_first_two(lines):
        first, second = lines[1], lines[2]
        return [lines[0], first + ";" + second.split("\t")[-1], *lines[3:]]

    edit_table(recorded, merge_first_two)
    frames = open_recording(recorded).frames_of("uav1")
    assert len(frames) == 6
    np.testing.assert_array_equal(frames[1].heatmap(), heatmap("uav1", frames[1].stamp_ns))
    assert pose_error(frames[1], camera_enu("uav1", frames[1].stamp_ns))[0] < 1e-3


def test_the_folder_above_opens_its_only_recording(recorded):
    assert len(open_recording(recorded.parent).frames) == 18
    shutil.copytree(recorded, recorded.parent / "second")
    with pytest.raises(ValueError, match=r"holds 2 AirSim recordings .*second"):
        open_recording(recorded.parent)


def test_settings_may_lie_above(recorded):
    (recorded / "settings.json").rename(recorded.parent / "settings.json")
    assert open_recording(recorded).georeference is not None


def test_several_vehicles_need_their_start_positions(tmp_path):
    folder = write_airsim(tmp_path / "rec", flight(), settings=False)
    with pytest.raises(ValueError, match=r"no start position for vehicle 'uav1'.*Add Vehicles.uav1.X, Y, Z"):
        open_recording(folder)


def test_a_single_vehicle_is_one_of_its_settings(tmp_path):
    """Those of another recording, or of several vehicles whose table does not name them: it would have
    started at the origin, and its camera looked ahead."""
    folder = write_airsim(tmp_path / "rec", flight())
    edit_table(folder, old_airsim)
    with pytest.raises(ValueError, match=r"does not hold the vehicle 'drone' of the recording, but 'uav1', "):
        open_recording(folder)
    edit_settings(folder, lambda s: s["Vehicles"].clear())
    assert open_recording(folder).drones == ("drone",)


def test_a_downward_camera_needs_its_mount(tmp_path):
    folder = write_airsim(tmp_path / "rec", flight(), telemetry=False)
    for path in (folder / "images").iterdir():
        path.rename(path.with_name(path.name.replace("front_center", "bottom_center")))
    edit_table(folder, lambda lines: [line.replace("front_center", "bottom_center") for line in lines])
    with pytest.raises(ValueError, match="does not say where camera 'bottom_center' of 'uav1' looks"):
        open_recording(folder)


def test_one_camera_of_several(recorded):
    """The one with the most pictures, or the one asked for; the rest is named."""
    other = "img_uav1_bottom_center_0_1.png"
    edit_table(recorded, lambda lines: [lines[0], lines[1] + f";{other}", *lines[2:]])
    recording = open_recording(recorded)
    assert "uav1: only camera 'front_center' is read, not bottom_center" in recording.warnings
    assert len(recording.frames_of("uav1")) == 6
    with pytest.raises(
        ValueError, match="no picture of camera 'left' of 'uav1'; its cameras are bottom_center, front"
    ):
        open_recording(recorded, camera="left")


def test_a_vehicle_without_pictures_stays_in_the_fleet(recorded):
    def blind(lines):
        return [line if "uav3" not in line else line.rsplit("\t", 1)[0] + "\t" for line in lines]

    edit_table(recorded, blind)
    recording = open_recording(recorded)
    assert recording.drones == ("uav1", "uav3", "uav_2") and recording.frames_of("uav3") == []
    assert "uav3: airsim_rec.txt lists no picture of it: it has no frames" in recording.warnings


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"crowd_colors": [(0, 0, 256)]}, r"crowd_colors holds \(0, 0, 256\)"),
        ({"pose_delay_ms": float("nan")}, "pose_delay_ms is nan"),
    ],
)
def test_options_that_make_no_sense(recorded, options, message):
    with pytest.raises(ValueError, match=message):
        open_recording(recorded, **options)


def test_pose_delay_shifts_the_poses(recorded):
    """A pose logged 20 ms late belongs to the picture taken 20 ms before its stamp."""
    for frame in open_recording(recorded, pose_delay_ms=20.0).frames[:6]:
        metres, _ = pose_error(frame, camera_enu(frame.drone, frame.stamp_ns + 20 * MS))
        assert metres < 1e-3


def test_bad_lines_of_the_table_are_refused_one_by_one(recorded):
    def damage(lines):
        lines[2] = lines[2].replace("uav1\t1760", "uav1\tx760", 1)
        lines[3] = "\t".join(lines[3].split("\t")[:5])
        lines[4] = lines[4].replace("img_uav1_", "../img_uav1_", 1)
        return lines

    edit_table(recorded, damage)
    recording = open_recording(recorded)
    assert len(recording.frames_of("uav1")) == 3
    reasons = [str(refused) for refused in recording.refused]
    assert len(reasons) == 3
    assert any("line 3: TimeStamp is 'x760" in reason for reason in reasons)
    assert any("line 4 has 5 columns, the header has 10" in reason for reason in reasons)
    assert any("line 5: image name '../img" in reason for reason in reasons)


def test_a_column_is_missing(recorded):
    edit_table(recorded, lambda lines: [lines[0].replace("POS_Z", "ALTITUDE"), *lines[1:]])
    with pytest.raises(ValueError, match=r"airsim_rec.txt has no column 'POS_Z'"):
        open_recording(recorded)


@pytest.mark.parametrize("content", ["", "\n\n", "VehicleName\tTimeStamp"])
def test_an_empty_table(recorded, content):
    (recorded / "airsim_rec.txt").write_text(content)
    with pytest.raises(ValueError, match=r"airsim_rec.txt (is empty|has no column)"):
        open_recording(recorded)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda s: s["OriginGeopoint"].update(Latitude="north"), "Latitude is 'north', expected a number"),
        (lambda s: s["OriginGeopoint"].update(Latitude=10**400), "Latitude is '1000"),
        (lambda s: s.update(Vehicles=[1]), "Vehicles is not an object but list"),
        (
            lambda s: s["Vehicles"]["uav1"]["Cameras"]["front_center"]["CaptureSettings"][0].update(
                FOV_Degrees=180
            ),
            "180 degrees .*between 0 and 180",
        ),
    ],
)
def test_unusable_settings_name_the_value(recorded, change, message):
    edit_settings(recorded, change)
    with pytest.raises(ValueError, match=message):
        open_recording(recorded)


@pytest.mark.parametrize("content", ["{", "[" * 100_000, "\x00"])
def test_settings_that_are_no_json(recorded, content):
    (recorded / "settings.json").write_text(content)
    with pytest.raises(ValueError, match=r"settings.json is not JSON"):
        open_recording(recorded)


def test_bad_telemetry_rows_are_reported_and_leave_a_gap(recorded):
    path = recorded / "telemetry" / "uav1.csv"
    lines = path.read_text().splitlines()
    for row in range(21, 36):  # stamps 0.2 s to 0.48 s
        lines[row] = lines[row].rsplit(",", 3)[0] + ",nan,nan,nan"
    lines[-1] = lines[-1][:30]  # the log was cut off
    path.write_text("\n".join(lines))
    recording = open_recording(recorded)
    assert any(
        "uav1.csv: 1 rows cannot be read, first: line 56 has" in warning for warning in recording.warnings
    )
    assert any("15 of 54 pose rows are no poses" in warning for warning in recording.warnings)
    assert [refused.stamp_ns for refused in recording.refused] == [
        EPOCH_NS + n * 100 * MS + 12_345 for n in (2, 3, 4)
    ]
    assert all(
        "gap of 0.320 s there (limit max_pose_gap_s = 0.25 s)" in refused.reason
        for refused in recording.refused
    )


def write_people(folder, stamps_ns, position, crowd):
    (folder / "truth").mkdir(exist_ok=True)
    arrays = {"stamp_ns": stamps_ns, "position_enu": position, "crowd_id": crowd}
    np.savez(folder / "truth" / "people.npz", **{name: np.asarray(value) for name, value in arrays.items()})


def test_people_in_arrays(recorded):
    frames = open_recording(recorded).frames
    stamps_ns = [frame.stamp_ns for frame in frames]
    place = np.arange(len(frames) * 6, dtype=np.float32).reshape(len(frames), 2, 3)
    write_people(recorded, stamps_ns, place, [0, 3])
    recording = open_recording(recorded)
    assert list(recording.people.stamps_ns) == sorted(stamps_ns)
    for number, frame in enumerate(recording.frames):
        assert frame.exposure_ns() == frame.stamp_ns  # one clock, and nothing says otherwise
        people = recording.people_truth(frame.exposure_ns())
        np.testing.assert_array_equal(people.position, place[number])
        assert people.person.tolist() == [1, 2] and people.crowd.tolist() == [0, 3]


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("people.npz", b"not an archive", "where people stood cannot be read"),
        ("world.csv", b"stamp_ns,person\n", "world.csv has no column 'x'"),
        ("world.csv", b"stamp_ns,person,x,y,z,crowd\n5,1,here,2,3,0\n", "x is 'here', expected a number"),
        ("world.csv", b"stamp_ns,person,x,y,z,crowd\n5,1,nan,2,3,0\n", "no place: 5 ns, nan, 2.0, 3.0 m"),
        ("world.csv", b"stamp_ns,person,x,y,z,crowd\n99999999999999999999,1,1,2,3,0\n", "no moment"),
        ("../simulation.json", b'{"simulation": {"scenario": ', "nor what a crowd is there: Expecting value"),
        ("../simulation.json", b'{"simulation": 5}', "nor what a crowd is there: it holds no simulation"),
        ("cameras.csv", b"drone,stamp_ns\n", "has no column 'exposure_ns'"),
    ],
)
def test_a_truth_that_cannot_be_read_is_said_and_costs_no_frame(recorded, name, content, said):
    (recorded / "truth" / name).write_bytes(content)
    recording = open_recording(recorded)
    assert len(recording.frames) == 18 and len(recording.people.stamps_ns) == 0
    assert any(said in warning for warning in recording.warnings)


def test_people_without_a_place_leave_out_that_moment(recorded):
    """NaN where somebody is not there yet ended an evaluation, without a word of whom or where."""
    place = np.zeros((2, 3, 3), np.float32)
    place[1, 2] = np.nan
    write_people(recorded, [EPOCH_NS, EPOCH_NS + 10**9], place, [0, 0, 0])
    recording = open_recording(recorded)
    assert len(recording.people_truth(EPOCH_NS).person) == 3
    with pytest.raises(ValueError, match=r"person 3 stands at \(nan, nan, nan\) m, which is no place"):
        recording.people_truth(EPOCH_NS + 10**9)


def write_world(folder, rows):
    (folder / "truth").mkdir(exist_ok=True)
    lines = ["stamp_ns,person,x,y,z,crowd", *(",".join(map(str, row)) for row in rows)]
    (folder / "truth" / "world.csv").write_text("\n".join(lines) + "\n")


def standing(people=4, stamps=30, apart_ns=0):
    """Rows of people who are listed every 200 ms, each `apart_ns` after the one before."""
    return [
        (EPOCH_NS + stamp * 200 * MS + person * apart_ns, person, person, 0.0, 0.0, 0)
        for stamp in range(stamps)
        for person in range(1, people + 1)
    ]


def test_people_who_are_listed_twice_are_there_once(recorded):
    write_world(recorded, [row for row in standing(people=2) for _ in range(2)])  # a couple is no crowd
    recording = open_recording(recorded)
    assert len(recording.people_truth(EPOCH_NS).person) == 2
    assert "world.csv: 60 rows say again who stands where, and count once" in recording.warnings


def test_two_people_of_one_number_at_two_places_are_two(recorded):
    write_world(recorded, [(EPOCH_NS, 0, x, 0.0, 0.0, 0) for x in (1.0, 2.0, 3.0)])
    recording = open_recording(recorded)
    assert recording.people_truth(EPOCH_NS).position[:, 0].tolist() == [1.0, 2.0, 3.0]
    assert not any("world.csv" in warning for warning in recording.warnings)


def test_people_with_stamps_of_their_own_are_no_moments_of_the_world(recorded):
    """At every stamp one of four: there was a crowd, and no stamp knew of it."""
    write_world(recorded, standing(apart_ns=10 * MS))
    recording = open_recording(recorded)
    assert len(recording.people.stamps_ns) == 0
    (told,) = [warning for warning in recording.warnings if "people stood" in warning]
    # Between two stamps of each of the four lie 3 of the others, 29 times: 348 are missing beside 120.
    assert told.endswith("stamps in between; every stamp must list everybody") and "74.4%" in told
    with pytest.raises(ValueError, match="people are; where people stood .* must list everybody; say so"):
        require_people(recording, "say so")


def test_a_few_missing_people_are_told(recorded):
    rows = standing()
    write_world(recorded, [row for row in rows if row != rows[5 * 4]])
    recording = open_recording(recorded)
    assert len(recording.people.stamps_ns) == 30
    assert any("world.csv: 0.8% of the people" in warning for warning in recording.warnings)


def test_people_who_come_and_go_are_not_missing(recorded):
    rows = standing(stamps=40)
    gone = range(10, 30)  # for 4 s
    write_world(
        recorded, [row for row in rows if row[1] != 2 or (row[0] - EPOCH_NS) // (200 * MS) not in gone]
    )
    recording = open_recording(recorded)
    assert len(recording.people.stamps_ns) == 40
    assert not any("world.csv" in warning for warning in recording.warnings)


@pytest.mark.parametrize(("name", "missing"), [("uav1", 12), ("UAV_1", 18)])
def test_pictures_whose_true_camera_is_not_recorded_are_told(recorded, name, missing):
    """Rows of other names, or stamps: the camera as it was and its time are where telemetry has them."""
    frames = open_recording(recorded).frames_of("uav1")
    rows = [f"{name},{one.stamp_ns},{one.stamp_ns},1,2,3,1,0,0,0" for one in frames]
    header = "drone,stamp_ns,exposure_ns,x,y,z,qw,qx,qy,qz"
    (recorded / "truth" / "cameras.csv").write_text("\n".join([header, *rows]) + "\n")
    recording = open_recording(recorded)
    assert sum(frame.truth.pose is None for frame in recording.frames) == missing
    (told,) = [warning for warning in recording.warnings if "cameras.csv" in warning]
    assert told.startswith(f"{missing} of 18 pictures have no row in cameras.csv, the first: uav")


def test_people_of_another_shape_are_refused(recorded):
    write_people(recorded, [EPOCH_NS], np.zeros((1, 2, 3)), [1, 1, 1])
    (warning,) = [one for one in open_recording(recorded).warnings if "people" in one]
    assert "position_enu [1, 2, 3] for 1 stamps and 3 people" in warning


def test_labels_of_no_frame_are_counted(tmp_path):
    folder = write_airsim(tmp_path / "a", flight())
    assert not any("label file" in warning for warning in open_recording(folder).warnings)
    first = min((folder / "truth" / "regions").iterdir())
    count = len(list(first.parent.iterdir()))
    first.rename(first.with_name("region_uav1_17.png"))  # a stamp that nobody has
    (told,) = [warning for warning in open_recording(folder).warnings if "label file" in warning]
    assert told.startswith(
        f"1 of {count} label files in truth/regions/ belong to no frame, first: region_uav1_17.png"
    )
