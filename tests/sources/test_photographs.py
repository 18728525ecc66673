"""Geotagged photographs with the tags of several makers: poses, intrinsics, zones."""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import ExifTags, Image
from PIL.TiffImagePlugin import IFDRational
from scipy.spatial.transform import Rotation

from crowdfence import open_recording
from crowdfence.sources.ground_contact import on_ground
from crowdfence.sources.photographs.tags import read_tags
from support.foreign_recordings import (
    Row,
    beyond,
    closed,
    focal_35mm,
    frames,
    ground,
    heights,
    mission,
    reference,
    rows,
)

Angles = tuple[float, float, float]
"""Yaw, pitch, roll of a camera whose pitch of 0 is the horizon."""


def dji(angles: Angles, extra: str = "") -> str:
    yaw, pitch, roll = angles
    return (
        f'drone-dji:GimbalYawDegree="{yaw:+.2f}" drone-dji:GimbalPitchDegree="{pitch:+.2f}" '
        f'drone-dji:GimbalRollDegree="{roll:+.2f}" {extra}'
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


def degrees(value: float) -> tuple[IFDRational, ...]:
    """Degrees, minutes and seconds to 1e-4, as cameras write them: 3 mm."""
    whole = int(abs(value))
    minutes = int((abs(value) - whole) * 60)
    seconds = ((abs(value) - whole) * 60 - minutes) * 60
    return IFDRational(whole), IFDRational(minutes), IFDRational(round(seconds * 10_000), 10_000)


def write_photograph(
    path: Path,
    image: np.ndarray,
    stamp_ns: int,
    place: tuple[float, float, float],
    xmp: str,
    *,
    make: str = "DJI",
    focal_mm35: float | None = None,
) -> Path:
    picture, exif = Image.fromarray(image), Image.Exif()
    taken = datetime.fromtimestamp(stamp_ns // 10**9, timezone.utc)
    exif[ExifTags.Base.Make], exif[ExifTags.Base.Model] = make, "X1"
    more = exif.get_ifd(ExifTags.IFD.Exif)
    more[ExifTags.Base.DateTimeOriginal] = f"{taken:%Y:%m:%d %H:%M:%S}"
    more[ExifTags.Base.SubsecTimeOriginal] = f"{stamp_ns % 10**9 // 1000:06d}"
    if focal_mm35 is not None:
        more[ExifTags.Base.FocalLengthIn35mmFilm] = round(focal_mm35)
    gps = exif.get_ifd(ExifTags.IFD.GPSInfo)
    latitude, longitude, height = place
    gps |= {1: "N" if latitude >= 0 else "S", 2: degrees(latitude), 3: "E" if longitude >= 0 else "W"}
    gps |= {4: degrees(longitude), 5: b"\0", 6: IFDRational(round(height * 1000), 1000)}
    exif.get_ifd(ExifTags.IFD.GPSInfo).update(gps)
    packet = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF><rdf:Description rdf:about="" '
        f"{xmp}></rdf:Description></rdf:RDF></x:xmpmeta>"
    )
    if "skydio" in xmp:
        packet = f"<x:xmpmeta><rdf:RDF><rdf:Description {xmp}></rdf:Description></rdf:RDF></x:xmpmeta>"
    picture.save(path, "JPEG", quality=95, exif=exif, xmp=packet.encode())
    return path


def row_at(stamp_ns: int) -> Row:
    """The camera at a picture; its pose is the mission's own."""
    frame = next(one for one in frames() if one.stamp_ns == stamp_ns)
    pose = frame.world_from_camera
    return Row(stamp_ns, pose[:3, 3], Rotation.from_matrix(pose[:3, :3]))


Maker = Callable[..., str]


def write_flight(folder: Path, maker: Maker, **options: Any) -> Path:
    folder.mkdir()
    camera = frames()[0].camera
    dewarp = f'drone-dji:DewarpData="2026-01-01;{camera.fx},{camera.fy},0,0,0,0,0,0,0"'
    below = heights(rows()[0].position[None, :2])[0]
    for number, frame in enumerate(frames()):
        row = row_at(frame.stamp_ns)
        latitude, longitude, height = row.geodetic
        extra = (
            f'{dewarp} drone-dji:RelativeAltitude="{row.position[2] - below:+.2f}"' if maker is dji else ""
        )
        place = latitude, longitude, height - 48.0
        xmp = maker(tuple(row.yaw_pitch_roll_deg), extra)
        write_photograph(folder / f"{number:03}.JPG", frame.image(), frame.stamp_ns, place, xmp, **options)
    return folder


@pytest.mark.parametrize("maker", [dji, parrot, skydio, pix4d, sensefly])
def test_photographs_of_each_maker_lie_where_they_were_taken(tmp_path: Path, maker: Maker) -> None:
    make = {sensefly: "senseFly"}.get(maker, "x")
    folder = write_flight(tmp_path / "flight", maker, make=make)
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


def test_a_flight_gives_the_zones_of_the_mission(tmp_path: Path) -> None:
    found = open_recording(write_flight(tmp_path / "flight", dji), take_off=rows()[0].geodetic[:2])
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


def test_what_a_photograph_lacks_refuses_it_alone(tmp_path: Path) -> None:
    folder = write_flight(tmp_path / "flight", dji)
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


def test_photographs_of_one_second_keep_their_order(tmp_path: Path) -> None:
    row = row_at(frames()[0].stamp_ns)
    for name in "ab":
        path = tmp_path / f"{name}.jpg"
        write_photograph(
            path, frames()[0].image(), 10**18, row.geodetic, dji(tuple(row.yaw_pitch_roll_deg)), focal_mm35=20
        )
        picture = Image.open(path)
        exif = picture.getexif()
        del exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.SubsecTimeOriginal]
        picture.save(path, exif=exif, xmp=picture.info["xmp"])
    found = open_recording(tmp_path, heights="sea", geoid_m=0.0)
    assert [frame.stamp_ns for frame in found.frames] == [10**18, 10**18 + 500_000_000]
    assert any("of the same second are spread" in warning for warning in found.warnings)


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
