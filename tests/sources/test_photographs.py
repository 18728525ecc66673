"""Geotagged photographs with the tags of several makers: poses, intrinsics, zones."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import ExifTags, Image
from scipy.spatial.transform import Rotation

from crowdfence import Camera, Recording, Terrain, open_recording
from crowdfence.sources.ground_contact import on_ground
from crowdfence.sources.photographs.tags import _place, read_tags
from support.foreign_recordings import (
    Angles,
    Maker,
    beyond,
    closed,
    dji,
    focal_35mm,
    frames,
    ground,
    mission,
    reference,
    row_at,
    rows,
    write_dem,
    write_photograph,
    write_photographs,
)


def parrot(angles: Angles, extra: str = "") -> str:
    yaw, pitch, roll = angles
    return (
        f'drone-parrot:CameraYawDegree="{yaw:.3f}" drone-parrot:CameraPitchDegree="{pitch:.3f}" '
        f'drone-parrot:CameraRollDegree="{roll:.3f}" {extra}'
    )


def skydio(angles: Angles, extra: str = "") -> str:
    yaw, pitch, roll = angles
    return (
        f"{extra}><drone-skydio:CameraOrientationNED rdf:parseType='Resource'>"
        f"<drone-skydio:Pitch>{pitch:.4f}</drone-skydio:Pitch><drone-skydio:Yaw>{yaw:.4f}</drone-skydio:Yaw>"
        f"<drone-skydio:Roll>{roll:.4f}</drone-skydio:Roll></drone-skydio:CameraOrientationNED"
    )


def pix4d(angles: Angles, extra: str = "", mirrored: int = 1) -> str:
    """Of a body whose camera looks straight down, the top of the picture forward."""
    yaw, pitch, roll = angles
    down = Rotation.from_euler("ZYX", [0, -90, 0], degrees=True)
    body = (Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True) * down.inv()).as_euler(
        "ZYX", degrees=True
    )
    yaw, pitch, roll = body[0], body[1], mirrored * body[2]
    return f'Camera:Yaw="{yaw:.5f}" Camera:Pitch="{pitch:.5f}" Camera:Roll="{roll:.5f}" {extra}'


def sensefly(angles: Angles, extra: str = "") -> str:
    return pix4d(angles, extra, mirrored=-1)


@pytest.mark.parametrize("maker", [dji, parrot, skydio, pix4d, sensefly])
def test_photographs_of_each_maker_lie_where_they_were_taken(tmp_path: Path, maker: Maker) -> None:
    make = {sensefly: "senseFly"}.get(maker, "x")
    folder = write_photographs(tmp_path / "flight", maker, make=make)
    found = open_recording(folder, calibration=frames()[0].camera, heights="sea", geoid_m=48.0)
    anchor, local = mission().georeference, found.georeference
    assert anchor is not None and local is not None and not found.refused
    assert len(found.frames) == len(frames()) and len(found.drones) == 1
    for ours, theirs in zip(found.frames, frames(), strict=True):
        assert abs(ours.stamp_ns - theirs.stamp_ns) < 1000  # EXIF holds microseconds here
        at = anchor.local_from_geodetic(*local.geodetic_from_local(ours.world_from_camera[None, :3, 3]))[0]
        assert np.linalg.norm(at - theirs.world_from_camera[:3, 3]) < 0.01
        turned = ours.world_from_camera[:3, :3].T @ theirs.world_from_camera[:3, :3]
        assert np.degrees(np.arccos(min((np.trace(turned) - 1) / 2, 1))) < 0.02


@pytest.mark.parametrize("written", ["elements", "attributes"])
def test_the_attitude_of_a_skydio_is_not_taken_for_that_of_its_camera(tmp_path: Path, written: str) -> None:
    """VehicleOrientationNED stands beside CameraOrientationNED, with angles of the same names."""
    name = "drone-skydio:{}OrientationNED"
    blocks = []
    for whose, (roll, pitch, yaw) in {"Camera": (0.2, -45.0, 90.0), "Vehicle": (1.0, -3.0, 10.0)}.items():
        angles = {"Roll": roll, "Pitch": pitch, "Yaw": yaw}
        if written == "elements":
            inside = "".join(f"<drone-skydio:{a}>{v}</drone-skydio:{a}>" for a, v in angles.items())
            begin = f"<{name.format(whose)} rdf:parseType='Resource'>"
            blocks.append(f"{begin}{inside}</{name.format(whose)}>")
        else:
            inside = " ".join(f'drone-skydio:{a}="{v}"' for a, v in angles.items())
            blocks.append(f"<{name.format(whose)} {inside}/>")
    path = tmp_path / "a.jpg"
    xmp = ">" + "".join(blocks)[:-1]  # the writer closes what it is given
    write_photograph(path, frames()[0].image(), 10**18, (46.5, 8.0, 500.0), xmp, focal_mm35=24)
    found = open_recording(path, geoid_m=50.0)
    looks = found.frames[0].world_from_camera[:3, 2]  # east, 45 degrees down
    assert looks == pytest.approx([np.sqrt(0.5), 0.0, -np.sqrt(0.5)], abs=1e-3)


RTK = dji((0.0, -90.0, 0.0), 'drone-dji:RelativeAltitude="+40.0" drone-dji:AltitudeType="RtkAlt" ')
ELLIPSOIDAL = 'Camera:HorizCS="EPSG:4326" Camera:VertCS="ellipsoidal"'


@pytest.mark.parametrize(
    ("model", "xmp"),
    [
        ("S.O.D.A.", pix4d((10.0, -90.0, 0.0), ELLIPSOIDAL)),
        ("M3E", RTK + 'drone-dji:RtkFlag="50"'),  # fixed
        ("M3E", RTK + 'drone-dji:RtkFlag="16"'),  # a single receiver's
        ("ANAFI Ai", parrot((0.0, -90.0, 0.0))),  # by Parrot's "Embedded Photo Metadata"
        ("S.O.D.A. 3D", pix4d((10.0, -90.0, 0.0))),  # as PIX4Dmatic takes it, and the next
        ("FC6310R", RTK + 'drone-dji:RtkFlag="0"'),
    ],
)
def test_heights_above_the_ellipsoid_are_not_moved_by_the_geoid(tmp_path: Path, model: str, xmp: str) -> None:
    """EXIF calls all of them "above sea level"; the geoid lies 48 m above the ellipsoid in the Alps."""
    path = tmp_path / "a.jpg"
    write_photograph(path, frames()[0].image(), 10**18, (46.5, 8.0, 500.0), xmp, model=model, focal_mm35=24)
    found = open_recording(path, heights="ellipsoid")
    assert found.georeference is not None
    assert found.georeference.height_m + found.frames[0].world_from_camera[2, 3] == pytest.approx(500.0)
    with pytest.raises(ValueError, match="no heights above sea are recorded"):
        open_recording(path, heights="sea", geoid_m=48.0)


@pytest.mark.parametrize(
    ("xmp", "above"),
    [
        (RTK + 'drone-dji:RtkFlag="0"', "sea"),  # no position by RTK
        (RTK.replace("RtkAlt", "GpsFusionAlt"), "sea"),
        (RTK + 'drone-dji:RtkFlag="50"', "take-off"),  # which comes first, where nothing is said
        (pix4d((10.0, -90.0, 0.0), 'Camera:VertCS="EPSG:5773"'), "sea"),  # EGM96
    ],
)
def test_other_heights_stay_what_they_were(tmp_path: Path, xmp: str, above: str) -> None:
    path = tmp_path / "a.jpg"
    write_photograph(path, frames()[0].image(), 10**18, (46.5, 8.0, 500.0), xmp, focal_mm35=24)
    options = {"heights": "sea", "geoid_m": 48.0} if above == "sea" else {}
    (said,) = [one for one in open_recording(path, **options).warnings if "heights are those" in one]
    assert f"above the {above}" in said


@pytest.mark.parametrize(
    ("version", "mark", "above", "height_m"),
    [
        (b"0300", b"\0", "ellipsoid", 30.0),
        (b"0300", b"\1", "ellipsoid", -30.0),
        (b"0300", b"\2", "sea", 30.0),
        (b"0300", b"\3", "sea", -30.0),
        (b"0310", b"\0", "ellipsoid", 30.0),
        (b"0232", b"\0", "sea", 30.0),  # whose 0 and 1 are of the sea
        (b"0232", b"\1", "sea", -30.0),
    ],
)
def test_what_exif_means_by_its_marks_of_heights(
    tmp_path: Path, version: bytes, mark: bytes, above: Any, height_m: float
) -> None:
    """Version 3.0 gave the old marks another meaning: cameras were put 48 m too high."""
    path = tmp_path / "a.jpg"
    place, xmp = (46.5, 8.0, height_m), dji((0.0, -90.0, 0.0))
    write_photograph(
        path, frames()[0].image(), 10**18, place, xmp, focal_mm35=24, exif_version=version, altitude_ref=mark
    )
    found = open_recording(path, heights=above, geoid_m=48.0 if above == "sea" else None)
    assert found.georeference is not None
    height = found.georeference.height_m + found.frames[0].world_from_camera[2, 3]
    assert height == pytest.approx(height_m + (48.0 if above == "sea" else 0.0), abs=1e-3)


@pytest.mark.parametrize(
    ("make", "xmp"),
    [
        ("Autel Robotics", 'Camera:Yaw="90.0" Camera:Pitch="66.04" Camera:Roll="0.0"'),  # as pix4d means it
        ("Autel Robotics", dji((90.0, -23.96, 0.0)).replace("drone-dji:", "drone:")),
        # An EVO Lite 640T, which is a "Camera": pitch from the horizon (OpenAthenaIOS issue 62).
        ("Camera", 'Camera:Yaw="90.0" Camera:Pitch="-23.96" Camera:Roll="0.0" tiff:Make="Autel Robotics"'),
        ("Autel Robotics", 'Camera:Yaw="90.0" Camera:Pitch="-23.96" Camera:Roll="0.0"'),
    ],
)
def test_each_generation_of_autel_looks_ahead_and_not_back(tmp_path: Path, make: str, xmp: str) -> None:
    path = tmp_path / "a.jpg"
    write_photograph(path, frames()[0].image(), 10**18, (46.5, 8.0, 500.0), xmp, make=make, focal_mm35=24)
    looks = open_recording(path, geoid_m=48.0).frames[0].world_from_camera[:3, 2]
    below = np.radians(23.96)
    assert looks == pytest.approx([np.cos(below), 0.0, -np.sin(below)], abs=1e-3)  # east


def test_a_camera_that_hangs_fast_may_look_back(tmp_path: Path) -> None:
    """A camera fixed to a wing whose nose is 12 degrees down, and a gimbal of Autel that shakes."""
    for make, pitch in (("senseFly", -12.0), ("Autel Robotics", -1.0)):
        path = tmp_path / "a.jpg"
        xmp = f'Camera:Yaw="0.0" Camera:Pitch="{pitch}" Camera:Roll="0.0"'
        write_photograph(path, frames()[0].image(), 10**18, (46.5, 8.0, 500.0), xmp, make=make, focal_mm35=24)
        looks = open_recording(path, geoid_m=48.0).frames[0].world_from_camera[:3, 2]
        assert looks == pytest.approx([0.0, np.sin(np.radians(pitch)), -np.cos(np.radians(pitch))], abs=1e-3)


@pytest.mark.parametrize(("pitch", "told"), [(-60.0, "30 degrees from that"), (-89.0, ""), (None, "")])
def test_a_mount_that_overrules_what_is_recorded_is_told(
    tmp_path: Path, pitch: float | None, told: str
) -> None:
    """Of a gimbal that the pilot had tilted."""
    path = tmp_path / "a.jpg"
    xmp = "x:Other='1'" if pitch is None else dji((0.0, pitch, 0.0))
    write_photograph(path, frames()[0].image(), 10**18, (46.5, 8.0, 500.0), xmp, focal_mm35=24)
    found = open_recording(path, geoid_m=48.0, mount="north:-90")
    said = [one for one in found.warnings if "--mount is used instead" in one]
    assert len(said) == bool(told) and all(told in one for one in said)


def test_a_pitch_from_the_horizon_is_not_taken_for_one_from_straight_down(tmp_path: Path) -> None:
    """Of a maker that is not known: straight down was read as level, upside down and backwards."""
    path = tmp_path / "a.jpg"
    image, place = frames()[0].image(), (46.5, 8.0, 500.0)
    for pitch in (-90.0, -60.0, -30.5):
        xmp = f'Camera:Yaw="90.0" Camera:Pitch="{pitch}" Camera:Roll="0.0"'
        write_photograph(path, image, 10**18, place, xmp, make="Yuneec", focal_mm35=24)
        with pytest.raises(
            ValueError, match=rf"a.jpg says Camera:Pitch {pitch:g}, which.*say it with --mount"
        ):
            open_recording(path, geoid_m=48.0)
    looks = open_recording(path, geoid_m=48.0, mount="north:-90").frames[0].world_from_camera[:3, 2]
    assert looks == pytest.approx([0.0, 0.0, -1.0], abs=1e-9)


def test_a_flight_gives_the_zones_of_the_mission(tmp_path: Path) -> None:
    found = open_recording(write_photographs(tmp_path / "flight", dji), take_off=rows()[0].geodetic[:2])
    anchor, local = mission().georeference, found.georeference
    assert anchor is not None and local is not None
    assert any("calibration in the photographs" in warning for warning in found.warnings)
    offset = local.local_from_geodetic(anchor.latitude_deg, anchor.longitude_deg, anchor.height_m)[0]
    terrain = ground(offset)
    settled = on_ground(found, terrain)
    for ours, theirs in zip(settled.frames, frames(), strict=True):
        at = ours.world_from_camera[:3, 3] - offset
        # Heights in centimetres above a start whose ground is a cell of the map.
        assert np.linalg.norm(at - theirs.world_from_camera[:3, 3]) < 0.5
    assert beyond(closed(settled, terrain), closed(reference()), 1.0) < 0.05


@pytest.mark.parametrize(("model", "told"), [("VT300-L_93", True), ("S2", False)])
def test_heights_of_a_skydio_x10_are_doubted(tmp_path: Path, model: str, told: bool) -> None:
    """By its "X10 RTK/PPK metadata overview" GPSAltitude is ellipsoidal, and marked as of the sea."""
    path = tmp_path / "a.jpg"
    xmp = skydio((10.0, -60.0, 0.0))
    write_photograph(path, frames()[0].image(), 10**18, (46.5, 8.0, 500.0), xmp, model=model, focal_mm35=20)
    found = open_recording(path, geoid_m=48.0)
    assert any("if it had that, give --geoid-m 0" in warning for warning in found.warnings) == told
    as_told = open_recording(path, geoid_m=0.0)
    assert as_told.georeference is not None
    assert as_told.georeference.height_m + as_told.frames[0].world_from_camera[2, 3] == pytest.approx(500.0)


def test_heights_above_the_ground_below_are_settled_on_the_map(tmp_path: Path) -> None:
    """Of each photograph by itself: 25.5 m above a terrace, and above the next one, 30 m higher. At 46.5
    degrees 4e-4 degrees of longitude are 30.7 m."""
    for number in range(2):
        xmp = pix4d((10.0, -80.0, 0.0), 'Camera:AboveGroundAltitude="51/2"')
        path, image = tmp_path / f"{number}.jpg", frames()[number].image()
        place = 46.5, 8.0 + 4e-4 * number, 500.0
        write_photograph(path, image, (10**9 + number) * 10**9, place, xmp, focal_mm35=24)
    terraces = np.full((100, 100), 100.0, np.float32)  # [x, y]
    terraces[65:] = 130.0
    terrain = Terrain.from_height_map(terraces, 1.0, origin=(-50.0, -50.0, 0.0))
    found = on_ground(open_recording(tmp_path, heights="ground"), terrain)
    assert [frame.world_from_camera[2, 3] for frame in found.frames] == pytest.approx(
        [125.5, 155.5], abs=0.01
    )
    assert any("heights are those above the ground below" in warning for warning in found.warnings)


def test_what_a_photograph_lacks_refuses_it_alone(tmp_path: Path) -> None:
    folder = write_photographs(tmp_path / "flight", dji)
    image, row = frames()[0].image(), row_at(frames()[0].stamp_ns)
    write_photograph(folder / "a.jpg", image, 10**18, row.geodetic, "x:Other='1'")
    (folder / "b.jpg").write_bytes(b"no picture")
    Image.fromarray(image).save(folder / "c.jpg")
    found = open_recording(folder)
    reasons = " | ".join(refusal.reason for refusal in found.refused)
    assert len(found.frames) == len(frames())
    assert "a.jpg does not say where its camera looked" in reasons and "--mount" in reasons
    assert "b.jpg is no picture" in reasons and "c.jpg does not say when it was taken" in reasons
    with pytest.raises(ValueError, match=r"no photograph can be placed.*does not say when"):
        open_recording(folder / "c.jpg")


@pytest.mark.parametrize("maker", [dji, parrot, skydio])
def test_a_gimbal_that_says_0_throughout_says_nothing(tmp_path: Path, maker: Maker) -> None:
    """As a P1 on an M400 wrote it (dji-sdk/Mobile-SDK-Android-V5 issue 772), whatever it looked at."""
    path = tmp_path / "a.jpg"
    image, place = frames()[0].image(), (46.5, 8.0, 500.0)
    write_photograph(path, image, 10**18, place, maker((0.0, 0.0, 0.0)), focal_mm35=24)
    with pytest.raises(ValueError, match="does not say where its camera looked"):
        open_recording(path, geoid_m=48.0)
    assert len(open_recording(path, geoid_m=48.0, mount="north:-90").frames) == 1
    write_photograph(path, image, 10**18, place, maker((0.0, -90.0, 0.0)), focal_mm35=24)
    assert len(open_recording(path, geoid_m=48.0).frames) == 1


def test_pix4d_angles_that_are_all_0_say_nothing(tmp_path: Path) -> None:
    """There they would be straight down with north on top, whatever the camera looked at."""
    path = tmp_path / "a.jpg"
    image, place = frames()[0].image(), (46.5, 8.0, 500.0)
    zero = 'Camera:Yaw="0.000000" Camera:Pitch="0.0" Camera:Roll="0"'
    write_photograph(path, image, 10**18, place, zero, make="Sony", focal_mm35=24)
    with pytest.raises(ValueError, match="does not say where its camera looked"):
        open_recording(path, geoid_m=48.0)
    write_photograph(path, image, 10**18, place, zero.replace('"0"', '"0.1"'), make="Sony", focal_mm35=24)
    assert len(open_recording(path, geoid_m=48.0).frames) == 1


def _with_sides(path: Path, sides: tuple[str, str] | None) -> Path:
    """33.9 degrees of latitude and 151.2 of longitude; `sides`: how EXIF says which, None: not at all."""
    angles = dji((10.0, -45.0, 0.0))
    write_photograph(path, frames()[0].image(), 10**18, (33.9, 151.2, 50.0), angles, focal_mm35=24)
    with Image.open(path) as picture:
        exif, xmp = picture.getexif(), picture.info["xmp"]
        gps = exif.get_ifd(ExifTags.IFD.GPSInfo)
        for tag in (1, 3):
            del gps[tag]
        if sides is not None:
            gps |= {1: sides[0], 3: sides[1]}
        picture.save(path, "JPEG", exif=exif, xmp=xmp)
    return path


@pytest.mark.parametrize("sides", [("S", "W"), ("S\0\0", "W\0 "), ("s", "w"), ("South", "West")])
def test_the_southern_and_the_western_hemisphere_are_where_they_are(
    tmp_path: Path, sides: tuple[str, str]
) -> None:
    assert read_tags(_with_sides(tmp_path / "a.jpg", sides)).place == pytest.approx((-33.9, -151.2))


@pytest.mark.parametrize("sides", [None, ("", "W"), ("?", "W")])
def test_a_place_without_its_hemisphere_is_none(tmp_path: Path, sides: tuple[str, str] | None) -> None:
    path = _with_sides(tmp_path / "a.jpg", sides)
    with pytest.raises(ValueError, match=r"does not say where it was taken \(GPS, with its hemispheres\)"):
        open_recording(path)


def test_a_signed_latitude_is_none() -> None:
    """-33 degrees, 54 minutes, south: as programs write it that take EXIF for signed. It could be either."""
    gps = {1: "S", 2: (33.0, 54.0, 0.0), 3: "E", 4: (151.0, 12.0, 0.0)}
    assert _place(gps, {}) == pytest.approx((-33.9, 151.2))
    assert _place({**gps, 2: (-33.0, 54.0, 0.0)}, {}) is None


@pytest.mark.parametrize("angles", [("+100.0", "-900.0", "0.0"), ("+10,5", "-45,9", "0,0")])
def test_angles_that_are_no_degrees_or_have_a_comma_say_nothing(
    tmp_path: Path, angles: tuple[str, str, str]
) -> None:
    named = zip(("Yaw", "Pitch", "Roll"), angles, strict=True)
    xmp = " ".join(f'drone-dji:Gimbal{name}Degree="{angle}"' for name, angle in named)
    path = write_photograph(
        tmp_path / "a.jpg", frames()[0].image(), 10**18, (46.5, 8.0, 50.0), xmp, focal_mm35=24
    )
    with pytest.raises(ValueError, match="does not say where its camera looked"):
        open_recording(path)


@pytest.mark.parametrize("written", ["9.5e-05", "-9.5E-05", "+0.000095", "95/1000000"])
def test_a_small_angle_with_an_exponent_is_small(tmp_path: Path, written: str) -> None:
    """As programs write it that print numbers as they are: its digits alone are a roll of 9.5 degrees."""
    xmp = (
        'drone-dji:GimbalYawDegree="90" drone-dji:GimbalPitchDegree="0.0" '
        f'drone-dji:GimbalRollDegree="{written}"'
    )
    path = write_photograph(tmp_path / "a.jpg", frames()[0].image(), 10**18, (46.5, 8.0, 50.0), xmp)
    half = np.radians(45.0)
    assert read_tags(path).attitude_ned == pytest.approx([np.cos(half), 0, 0, np.sin(half)], abs=1e-6)


def test_a_place_with_a_decimal_comma_is_that_of_exif(tmp_path: Path) -> None:
    """Cut at the comma it would be up to 100 km off."""
    xmp = dji((1.0, -45.0, 0.0), 'drone-dji:GpsLatitude="46,5123" drone-dji:GpsLongitude="8,0123"')
    path = tmp_path / "a.jpg"
    write_photograph(path, frames()[0].image(), 10**18, (46.5123, 8.0123, 50.0), xmp)
    assert read_tags(path).place == pytest.approx((46.5123, 8.0123))


@pytest.mark.parametrize(
    ("datum", "taken"), [("WGS-84", True), ("WGS 84 ", True), ("ITRF2014", True), ("TOKYO", False)]
)
def test_a_place_in_another_datum_is_not_taken_for_one_in_wgs84(
    tmp_path: Path, datum: str, taken: bool
) -> None:
    """Cameras of Japan could tell it in their old national datum, 450 m from WGS84 in Tokyo."""
    path = write_photographs(tmp_path / "flight", datum=datum)
    if taken:
        assert len(open_recording(path).frames) == len(frames())
    else:
        with pytest.raises(ValueError, match=r"000\.JPG says where it was taken in the datum 'TOKYO'"):
            open_recording(path)
    exact = 'drone-dji:GpsLatitude="46.5" drone-dji:GpsLongitude="8.0"'
    first, place = frames()[0], (46.5, 8.0, 1.0)
    xmp = dji((0.0, -60.0, 0.0), exact)
    write_photograph(tmp_path / "a.JPG", first.image(), first.stamp_ns, place, xmp, datum=datum)
    assert read_tags(tmp_path / "a.JPG").other_datum == ""  # XMP is in WGS84


def with_gps(path: Path, tags: dict[int, Any]) -> Path:
    with Image.open(path) as picture:
        exif, packet = picture.getexif(), picture.info["xmp"]
        exif.get_ifd(ExifTags.IFD.GPSInfo).update(tags)
        picture.save(path, "JPEG", exif=exif, xmp=packet)
    return path


def test_places_of_exif_and_xmp_that_are_apart_are_told(tmp_path: Path) -> None:
    """A degree of latitude is 111.2 km on a sphere of 6371 km: 4e-5 of it are 4.4 m."""
    for number, north in enumerate((0.0, 4e-5, 1e-5)):
        place = f'drone-dji:GpsLatitude="{46.5 + north:.7f}" drone-dji:GpsLongitude="8.0"'
        taken(tmp_path / f"{number}.jpg", focal_mm35=24, xmp=place)
    (said,) = [one for one in open_recording(tmp_path).warnings if "EXIF and XMP" in one]
    assert "EXIF and XMP of 1 of 3 photographs tell places up to 4.4 m apart" in said


@pytest.mark.parametrize(
    ("tags", "xmp", "told"),
    [
        ({ExifTags.GPS.GPSStatus: "A", ExifTags.GPS.GPSMeasureMode: "3"}, "", None),
        (
            {ExifTags.GPS.GPSStatus: "V"},
            "",
            r"1 of 2 photographs were taken without a fix .* \(GPSStatus V\)",
        ),
        ({ExifTags.GPS.GPSMeasureMode: "2"}, "", r"1 of 2 .* without a fix .* \(GPSMeasureMode 2\)"),
        (
            {ExifTags.GPS.GPSHPositioningError: 12.0},
            "",
            "places of 1 of 2 photographs are uncertain by up to 12 m",
        ),
        (
            {},
            'drone-dji:RtkStdLat="3.1" drone-dji:RtkStdLon="15.2"',
            "1 of 2 photographs are uncertain by up to 15 m",
        ),
        ({}, 'drone-dji:RtkStdLat="0.02" drone-dji:RtkStdLon="0.01"', None),
    ],
)
def test_what_a_receiver_says_of_its_own_place_is_told(
    tmp_path: Path, tags: dict[int, Any], xmp: str, told: str | None
) -> None:
    with_gps(taken(tmp_path / "a.jpg", focal_mm35=24, xmp=xmp), tags)
    taken(tmp_path / "b.jpg", focal_mm35=24)
    said = [one for one in open_recording(tmp_path).warnings if "1 of 2" in one]
    assert len(said) == (told is not None)
    assert told is None or re.search(told, said[0])


def test_a_panorama_is_refused(tmp_path: Path) -> None:
    """Drones put them together in flight and save them beside the others, with place, angles and lens."""
    folder = write_photographs(tmp_path / "flight")
    panorama = dji((10.0, -30.0, 0.0), 'GPano:ProjectionType="equirectangular"')
    image = frames()[0].image()
    write_photograph(folder / "pano.jpg", image, 10**18, (46.5, 8.0, 500.0), panorama, focal_mm35=24)
    found = open_recording(folder)
    assert len(found.frames) == len(frames())
    (refused,) = found.refused
    assert "pano.jpg is a panorama (equirectangular)" in refused.reason


def test_a_position_that_the_drone_calls_invalid_is_none(tmp_path: Path) -> None:
    """GpsStatus is Normal, RTK or Invalid (DJI's Mavic 3M Image Processing Guide)."""
    for status in ("Normal", "RTK"):
        path = taken(tmp_path / f"{status}.jpg", xmp=f'drone-dji:GpsStatus="{status}"', focal_mm35=24)
        assert len(open_recording(path).frames) == 1
    path = taken(tmp_path / "invalid.jpg", xmp='drone-dji:GpsStatus="Invalid"', focal_mm35=24)
    with pytest.raises(ValueError, match="does not say where it was taken"):
        open_recording(path)


def test_heights_of_dji_above_the_sea_are_doubted(tmp_path: Path) -> None:
    """They are those of a barometer on a standard day: no weather is."""
    path = taken(tmp_path / "a.jpg", focal_mm35=24)
    for heights, told in (("sea", True), ("take-off", False)):
        found = open_recording(path, heights=heights, geoid_m=48.0)
        assert any("air pressure" in warning for warning in found.warnings) == told


def test_one_photograph_without_its_height_above_the_take_off_is_told(tmp_path: Path) -> None:
    """The heights of all are those above the sea then, as of a barometer on a standard day."""
    for number in range(3):
        height = "" if number == 1 else 'drone-dji:RelativeAltitude="+20.0"'
        angles = dji((10.0, -60.0, 0.0), height)
        place = 46.5, 8.0, 520.0
        path = tmp_path / f"{number}.jpg"
        write_photograph(path, frames()[number].image(), (number + 1) * 10**18, place, angles, focal_mm35=24)
    found = open_recording(tmp_path, geoid_m=48.0)
    assert any("heights are those above the sea" in warning for warning in found.warnings)
    assert any("air pressure" in warning for warning in found.warnings)
    told = "1 of 3 photographs do not tell how high above the take-off"
    assert any(told in warning for warning in found.warnings)
    (tmp_path / "1.jpg").unlink()
    assert not any("do not tell" in one for one in open_recording(tmp_path).warnings)


@pytest.mark.parametrize(
    ("higher_m", "pause_s", "told"), [(25.0, 300, True), (3.0, 300, False), (25.0, 20, False)]
)
def test_two_flights_from_different_heights_in_one_folder(
    tmp_path: Path, higher_m: float, pause_s: int, told: bool
) -> None:
    """The second battery's was 25 m up the hill: all that it saw was put as if 25 m lower."""
    for number in range(6):
        second = number >= 3
        stamp_ns = (10**9 + 2 * number + (pause_s if second else 0)) * 10**9
        angles = dji((10.0, -60.0, 0.0), 'drone-dji:RelativeAltitude="+20.0"')
        place = 46.5, 8.0 + 1e-5 * number, 520.0 + (higher_m if second else 0.0)
        write_photograph(
            tmp_path / f"{number}.jpg", frames()[number].image(), stamp_ns, place, angles, focal_mm35=24
        )
    said = [one for one in open_recording(tmp_path).warnings if "flights whose take-offs lie" in one]
    assert bool(said) == told
    assert not told or "lie 25 m apart in height" in said[0]
    found = open_recording(tmp_path, heights="sea", geoid_m=48.0)
    assert not any("take-offs lie" in warning for warning in found.warnings)


@pytest.mark.parametrize(("higher_m", "told"), [(40.0, True), (3.0, False)])
def test_two_drones_of_one_name_that_took_off_at_different_heights(
    tmp_path: Path, higher_m: float, told: bool
) -> None:
    """Without serial numbers they are one, and all that the one saw was put as if 40 m lower."""
    for number in range(8):
        other = number % 2
        angles = dji((10.0, -60.0, 0.0), 'drone-dji:RelativeAltitude="+20.0"')
        place = 46.5 + 5e-4 * other, 8.0 + 1e-5 * number, 520.0 + higher_m * other
        stamp_ns, image = (10**9 + 2 * number) * 10**9, frames()[number % 4].image()
        write_photograph(tmp_path / f"{number}.jpg", image, stamp_ns, place, angles, focal_mm35=24)
    said = [one for one in open_recording(tmp_path).warnings if "of drones whose take-offs lie" in one]
    assert bool(said) == told
    assert not told or "lie 40 m apart in height" in said[0]


def test_a_photograph_that_asks_to_be_turned_is_refused(tmp_path: Path) -> None:
    """Whether the attitude means the stored picture or the shown one, nobody can know."""
    folder = write_photographs(tmp_path / "flight", dji)
    first = sorted(folder.iterdir())[0]
    with Image.open(first) as picture:
        exif = picture.getexif()
        exif[ExifTags.Base.Orientation] = 3
        shown = picture.transpose(Image.Transpose.ROTATE_180)
        shown.save(first, "JPEG", exif=exif, xmp=picture.info["xmp"])
    found = open_recording(folder)
    assert len(found.frames) == len(frames()) - 1
    (refusal,) = found.refused
    assert f"{first.name} is stored turned (EXIF Orientation 3)" in refusal.reason
    assert "save it with Orientation 1" in refusal.reason


def test_what_is_left_out_of_a_folder_is_told(tmp_path: Path) -> None:
    folder = write_photographs(tmp_path / "flight", dji)
    shots = sorted(folder.iterdir())
    first = shots[0]
    (folder / f"{first.stem}.dng").write_bytes(b"raw of a photograph that is there")
    (folder / "notes.txt").write_text("not a picture")
    (folder / ".hidden.png").write_bytes(b"")
    write_dem(folder / "dem.tif")
    (folder / "out" / "more").mkdir(parents=True)
    (folder / "out" / "crowd_map.png").write_bytes(b"of a run")
    assert not [warning for warning in open_recording(folder).warnings if "left out" in warning]

    (folder / "101MEDIA" / "deeper").mkdir(parents=True)
    shots[-1].rename(folder / "101MEDIA" / "deeper" / shots[-1].name)
    (folder / "DJI_0100.DNG").write_bytes(b"raw of one that is not there")
    (folder / "DJI_0101.MP4").write_bytes(b"film")
    (folder / "lost.JPG").symlink_to(folder / "nowhere.JPG")
    found = open_recording(folder)
    assert [warning for warning in found.warnings if "left out" in warning] == [
        "2 files of flight/ left out, first: DJI_0100.DNG; of a folder only .jpg .jpeg are read",
        "1 subfolder of flight/ with pictures left out, first: 101MEDIA; move its pictures up, or name it "
        "by itself",
    ]
    assert len(found.frames) == len(frames()) - 1
    (refusal,) = found.refused
    assert "lost.JPG" in refusal.reason and "No such file" in refusal.reason


def test_intrinsics_by_focal_length_are_an_estimate_that_says_so(tmp_path: Path) -> None:
    frame = frames()[0]
    row = row_at(frame.stamp_ns)
    path = tmp_path / "a.jpg"
    options = {"focal_mm35": focal_35mm(frame)}
    write_photograph(
        path, frame.image(), frame.stamp_ns, row.geodetic, dji(tuple(row.yaw_pitch_roll_deg)), **options
    )
    found = open_recording(path, heights="sea", geoid_m=0.0)
    assert found.frames[0].camera.fx == pytest.approx(frame.camera.fx, rel=0.05)  # whole millimetres
    assert any("within about 5 %" in warning and "--calibration" in warning for warning in found.warnings)


def calibrated(tmp_path: Path, flag: str, focal_mm35: float | None, *, shrunk: int = 1) -> Recording:
    """One photograph of 320 x 240 pixels with DJI's calibration of a lens that distorts, of a picture that
    was `shrunk` times as wide."""
    focal = 300.0 * shrunk
    dewarp = f'drone-dji:DewarpData="2026-01-01;{focal},{focal},5,-3,-0.2,0.1,0.001,-0.002,0.0" '
    xmp = dji((10.0, -50.0, 0.0), dewarp + flag + 'drone-dji:RelativeAltitude="+40.0"')
    folder = tmp_path / f"{flag[-3:-2]}-{focal_mm35}-{shrunk}"
    folder.mkdir()
    picture = np.random.default_rng(1).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    write_photograph(folder / "a.JPG", picture, 10**18, (46.5, 8.0, 1200.0), xmp, focal_mm35=focal_mm35)
    return open_recording(folder)


def test_the_photograph_of_a_fisheye_needs_a_calibration(tmp_path: Path) -> None:
    """By a focal length alone its rays would be those of a lens that keeps lines straight: 45 degrees off the
    middle a fisheye of 200 px shows what lies at 157 px, which were taken for 38 degrees."""
    path = taken(tmp_path / "a.jpg", focal_mm35=24, xmp='Camera:ModelType="fisheye"')
    (refusal,) = open_recording(path).refused
    assert "its lens is a fisheye's (Camera:ModelType)" in refusal.reason
    calibration = Camera.fisheye(320, 240, 200.0, 200.0, 160.0, 120.0, [0.0] * 4)
    assert open_recording(path, calibration=calibration).frames[0].camera.model == "kannala_brandt"
    straight = taken(tmp_path / "b.jpg", focal_mm35=24, xmp='Camera:ModelType="perspective"')
    assert len(open_recording(straight).frames) == 1


def test_a_photograph_that_the_drone_has_undistorted_is_not_undistorted_again(tmp_path: Path) -> None:
    """DewarpFlag (DJI's manuals): 0 not dewarped, 1 dewarped."""
    for flag in ("", 'drone-dji:DewarpFlag="0" '):
        camera = calibrated(tmp_path, flag, None).frames[0].camera
        assert camera.model == "brown_conrady" and camera.distortion[0] == -0.2
    camera = calibrated(tmp_path, 'drone-dji:DewarpFlag="1" ', None).frames[0].camera
    assert (camera.model, camera.fx, camera.cx, camera.cy) == ("pinhole", 300.0, 165.0, 117.0)


def test_a_calibration_of_a_picture_of_another_size_is_not_used(tmp_path: Path) -> None:
    """Programs that shrink photographs keep DewarpData, whose pixels are those of before."""
    whole = calibrated(tmp_path, "", 32.0)  # 300 px before a diagonal of 400 are 32.4 mm
    assert whole.frames[0].camera.fx == 300.0
    shrunk = calibrated(tmp_path, "", 32.0, shrunk=3)
    assert shrunk.frames[0].camera.fx == pytest.approx(32.0 / np.hypot(36.0, 24.0) * 400.0)
    assert any("DewarpData is of another picture" in warning for warning in shrunk.warnings)


def taken(path: Path, *, xmp: str = "", **options: Any) -> Path:
    """A photograph of 320 x 240 pixels straight down, the n-th of its folder n seconds later."""
    path.parent.mkdir(exist_ok=True)
    stamp_ns = 10**18 + len(list(path.parent.iterdir())) * 10**9
    picture = np.random.default_rng(1).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    down = dji((0.0, -90.0, 0.0), xmp + ' drone-dji:RelativeAltitude="+40.0"')
    return write_photograph(path, picture, stamp_ns, (46.5, 8.0, 1200.0), down, **options)


def test_a_photograph_that_was_cut_after_it_was_taken_is_refused(tmp_path: Path) -> None:
    """Its focal length is still that of the whole: the middle 320 x 240 of 640 x 360 were read as all that
    the lens saw, 1.3 times too wide and of its own middle."""
    folder = taken(tmp_path / "p" / "whole.jpg", focal_mm35=24, size_taken=(320, 240)).parent
    taken(folder / "upright.jpg", focal_mm35=24, size_taken=(240, 320))
    taken(folder / "shrunk.jpg", focal_mm35=24, size_taken=(1283, 960))
    taken(folder / "cut.jpg", focal_mm35=24, size_taken=(640, 360))
    found = open_recording(folder)
    assert len(found.frames) == 3
    (cut,) = found.refused
    assert "had 640x360 pixels when it was taken (EXIF) and has 320x240: cut" in cut.reason


def test_the_calibration_of_a_photograph_is_of_the_size_that_it_was_taken_in(tmp_path: Path) -> None:
    """Shrunk to 85 %: 18 % beside its calibration, which an estimate alone may be too."""
    dewarp = 'drone-dji:DewarpData="2026-01-01;285.0,285.0,0,0,0,0,0,0,0"'
    for size, expected in (((320, 240), 285.0), ((376, 282), 26 / np.hypot(36, 24) * 400)):
        path = taken(tmp_path / f"{size[0]}.jpg", xmp=dewarp, focal_mm35=26, size_taken=size)
        assert open_recording(path).frames[0].camera.fx == pytest.approx(expected)


def test_a_digital_zoom_narrows_what_the_lens_shows(tmp_path: Path) -> None:
    """The lens of a Mavic Pro, 4.73 mm before 6.17 mm of sensor, of whose width a zoom of 2 shows half."""
    whole = open_recording(taken(tmp_path / "1.jpg", model="FC220", focal_mm=4.73)).frames[0].camera
    assert whole.fx == pytest.approx(4.73 / 6.17 * 320)
    for film_mm in (None, 26, 52):  # not told, without the zoom, with it
        zoom = {"focal_mm": 4.73, "focal_mm35": film_mm, "digital_zoom": 2.0}
        found = open_recording(taken(tmp_path / f"{film_mm}.jpg", model="FC220", **zoom))
        assert found.frames[0].camera.fx == pytest.approx(2 * 4.73 / 6.17 * 320)
    # DewarpData is of the whole picture, near enough for what it is held against.
    dewarp = 'drone-dji:DewarpData="2026-01-01;245.3,245.3,0,0,0,0,0,0,0"'
    zoom = {"focal_mm": 4.73, "digital_zoom": 1.2}
    found = open_recording(taken(tmp_path / "dewarp.jpg", model="FC220", xmp=dewarp, **zoom))
    assert found.frames[0].camera.fx == pytest.approx(1.2 * 4.73 / 6.17 * 320)
    unknown = open_recording(taken(tmp_path / "other.jpg", focal_mm35=24, digital_zoom=2.0))
    (refusal,) = unknown.refused
    assert "digital zoom of 2, and makers differ" in refusal.reason and not unknown.frames
    for none in (0.0, 1.0):
        found = open_recording(taken(tmp_path / f"none {none}.jpg", focal_mm35=24, digital_zoom=none))
        assert found.frames[0].camera.fx == pytest.approx(24.0 / np.hypot(36.0, 24.0) * 400.0)


def test_a_second_camera_of_the_same_name_has_its_own_lens(tmp_path: Path) -> None:
    """The tele camera of a Mavic 3 Enterprise: M3E too, 29.9 mm before a smaller sensor, 162 mm on film."""
    wide = open_recording(taken(tmp_path / "w.jpg", model="M3E", focal_mm=12.29, focal_mm35=24))
    assert wide.frames[0].camera.fx == pytest.approx(12.29 / 17.3 * 320)
    tele = open_recording(taken(tmp_path / "z.jpg", model="M3E", focal_mm=29.9, focal_mm35=162))
    assert tele.frames[0].camera.fx == pytest.approx(162.0 / np.hypot(36.0, 24.0) * 400.0)
    # Zoomed, it is not before the sensor of the wide one either, 2.7 times too wide, whatever is counted.
    for film_mm in (162, 324):
        zoom = {"focal_mm": 29.9, "focal_mm35": film_mm, "digital_zoom": 2.0}
        found = open_recording(taken(tmp_path / f"{film_mm}.jpg", model="M3E", **zoom))
        (refusal,) = found.refused
        assert "digital zoom of 2, and makers differ" in refusal.reason and not found.frames


@pytest.mark.parametrize(
    "other",
    [
        {"model": "M3E", "focal_mm": 29.9, "focal_mm35": 162},  # the other camera
        {"model": "M3E", "focal_mm": 12.29, "focal_mm35": 24, "digital_zoom": 2.0},
        {"model": "M3E", "focal_mm": 12.29, "focal_mm35": 48, "digital_zoom": 2.0},
    ],
)
def test_a_calibration_is_of_one_lens_and_zoom(tmp_path: Path, other: dict[str, Any]) -> None:
    calibration = Camera.pinhole(640, 480, 470.0, 470.0, 320.0, 240.0)  # 25 mm on 35 mm film
    for number in range(3):
        taken(tmp_path / "flight" / f"{number}.jpg", model="M3E", focal_mm=12.29, focal_mm35=24)
    taken(tmp_path / "flight" / "other.jpg", **other)
    found = open_recording(tmp_path / "flight", calibration=calibration)
    assert [frame.camera.fx for frame in found.frames] == [235.0] * 3
    (refusal,) = found.refused
    assert "its calibration is of 25 mm" in refusal.reason
    assert not any("of another lens, or zoom?" in warning for warning in found.warnings)
    # Alone, it may be what was calibrated, which is doubted.
    alone = open_recording(tmp_path / "flight" / "other.jpg", calibration=calibration)
    assert [frame.camera.fx for frame in alone.frames] == [235.0]
    assert any("of another lens, or zoom?" in warning for warning in alone.warnings)


def test_photographs_of_one_second_keep_their_order(tmp_path: Path) -> None:
    row = row_at(frames()[0].stamp_ns)
    for name, image in zip("ab", [frames()[0].image(), frames()[1].image()], strict=True):
        path = tmp_path / f"{name}.jpg"
        write_photograph(path, image, 10**18, row.geodetic, dji(tuple(row.yaw_pitch_roll_deg)), focal_mm35=20)
        picture = Image.open(path)
        exif = picture.getexif()
        del exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.SubsecTimeOriginal]
        picture.save(path, exif=exif, xmp=picture.info["xmp"])
    found = open_recording(tmp_path, heights="sea", geoid_m=0.0)
    assert [frame.stamp_ns for frame in found.frames] == [10**18, 10**18 + 500_000_000]
    assert any("of the same second are spread" in warning for warning in found.warnings)


INFRARED = 'drone-dji:ImageSource="InfraredCamera"'


def shot(folder: Path, name: str, extra: str = "", stamp_ns: int = 10**18) -> Path:
    row, image = row_at(frames()[0].stamp_ns), frames()[0].image()
    xmp = dji(tuple(row.yaw_pitch_roll_deg), f'drone-dji:RelativeAltitude="+40.0" {extra}')
    return write_photograph(folder / name, image, stamp_ns, row.geodetic, xmp, model="M3T", focal_mm35=24)


def with_flir(path: Path) -> Path:
    whole = path.read_bytes()
    path.write_bytes(whole[:2] + b"\xff\xe1\x00\x0eFLIR\x00\x01\x00\x01" + bytes(4) + whole[2:])
    return path


@pytest.mark.parametrize(
    ("name", "extra"),
    [
        ("b.jpg", INFRARED),
        ("DJI_20260101120000_0001_T.JPG", ""),
        ("DJI_0001_T_gate.JPG", ""),
        ("b.jpg", 'Camera:BandName="LWIR"'),
        ("flir.jpg", ""),
    ],
)
def test_a_thermal_photograph_of_a_shot_is_not_looked_at_for_colours(
    tmp_path: Path, name: str, extra: str
) -> None:
    """It was the second look of its drone, half a second later, and saw nobody."""
    shot(tmp_path, "DJI_20260101120000_0001_W.JPG", 'drone-dji:ImageSource="WideCamera"')
    shot(tmp_path, "zoom.jpg", 'drone-dji:ImageSource="ZoomCamera"', 10**18 + 10**6)
    thermal = shot(tmp_path, name, extra)
    if name == "flir.jpg":
        with_flir(thermal)
    found = open_recording(tmp_path)
    assert len(found.frames) == 2 and found.drones == ("M3T",)
    (refusal,) = found.refused
    assert refusal.reason.startswith(f"{name} is a thermal camera's, and detectors that were trained on")
    assert not [warning for warning in found.warnings if "thermal" in warning]


def test_thermal_photographs_alone_are_taken_with_a_word(tmp_path: Path) -> None:
    shot(tmp_path, "a.jpg", INFRARED)
    found = open_recording(tmp_path)
    assert len(found.frames) == 1 and not found.refused
    (told,) = [warning for warning in found.warnings if "thermal" in warning]
    assert "every photograph is a thermal camera's" in told and "--detector" in told
    # What a photograph says of itself counts before its name.
    (tmp_path / "colours").mkdir()
    shot(tmp_path / "colours", "DJI_0001_T.JPG", 'drone-dji:ImageSource="WideCamera"')
    assert not [one for one in open_recording(tmp_path / "colours").warnings if "thermal" in one]


def test_a_copy_of_a_photograph_is_no_second_look(tmp_path: Path) -> None:
    path = taken(tmp_path / "a.jpg", focal_mm35=24)
    with Image.open(path) as picture:
        exif = picture.getexif()
        del exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.SubsecTimeOriginal]
        picture.save(path, exif=exif, xmp=picture.info["xmp"])
    (tmp_path / "a (1).jpg").write_bytes(path.read_bytes())
    found = open_recording(tmp_path)
    assert len(found.frames) == 1
    (refusal,) = found.refused
    assert refusal.reason == "a.jpg is a copy of a (1).jpg"


def test_damaged_photographs_are_one_line(tmp_path: Path) -> None:
    frame = frames()[0]
    row = row_at(frame.stamp_ns)
    path = tmp_path / "a.jpg"
    write_photograph(path, frame.image(), frame.stamp_ns, row.geodetic, dji(tuple(row.yaw_pitch_roll_deg)))
    whole = path.read_bytes()
    random = np.random.default_rng(17)
    for number in range(60):
        damaged = bytearray(whole[: int(random.integers(len(whole)))] if number % 2 else whole)
        for at in random.integers(min(len(damaged), 2000) or 1, size=12):
            damaged[at : at + 1] = bytes([int(random.integers(256))])
        path.write_bytes(bytes(damaged))
        try:
            tags = read_tags(path)
        except ValueError as error:
            assert str(error)
        else:
            assert tags.width > 0


@pytest.mark.parametrize("filling", ["a" * 400_000, "a:b>" + " " * 400_000, "a:" * 200_000, 'a:b="' * 80_000])
def test_tags_made_to_take_forever_do_not(tmp_path: Path, filling: str) -> None:
    frame = frames()[0]
    path = tmp_path / "a.jpg"
    write_photograph(path, frame.image(), frame.stamp_ns, row_at(frame.stamp_ns).geodetic, "x:Y='1'")
    head, mark, tail = path.read_bytes().partition(b"</rdf:Description>")
    path.write_bytes(head + filling.encode() + mark + tail)
    begun = time.process_time()
    read_tags(path)
    assert time.process_time() - begun < 5
