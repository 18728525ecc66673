"""A folder of geotagged photographs -> a recording: each camera (make, model, serial number) is a drone.

The pose of a photograph is its own, so nothing is interpolated. Photographs without a place or without the
attitude of their camera are refused one by one, and so are thermal ones beside those of colours.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from crowdfence._core import Camera
from crowdfence.errors import quoted
from crowdfence.georeference import Georeference
from crowdfence.sources.camera_mount import CameraMount, overruled
from crowdfence.sources.geographic_track import (
    DJI_SEA_LEVEL,
    GeographicPoses,
    HeightOptions,
    HeightsAbove,
    LocalTrack,
    local_track,
)
from crowdfence.sources.lens.focal_length import (
    EstimatedCamera,
    alike,
    calibration_doubt,
    camera_from_35mm,
    camera_from_sensor,
    focal_35mm_of,
    is_of_a_lens,
    scaled_camera,
)
from crowdfence.sources.photographs.place_doubts import place_doubts
from crowdfence.sources.photographs.tags import PhotographTags, read_tags
from crowdfence.sources.photographs.take_offs import take_off_doubt
from crowdfence.sources.photographs.when_taken import WhenTaken, clock_doubt
from crowdfence.sources.pictures.decoding import UPRIGHT, turned_fault
from crowdfence.sources.pictures.files import is_file_or_lost
from crowdfence.sources.pictures.left_out import left_out
from crowdfence.sources.pictures.thermal import THERMAL
from crowdfence.sources.place_camera import Limits, UnplacedFrame, place_cameras
from crowdfence.sources.recording import PixelSources, Recording, RefusedFrame

SUFFIXES = (".jpg", ".jpeg")
_ABSOLUTE: tuple[HeightsAbove, ...] = ("ellipsoid", "sea")
_HEIGHTS: tuple[HeightsAbove, ...] = ("take-off", *_ABSOLUTE, "ground")
"""In the order in which they are preferred: without RTK a barometer is steadier than satellites."""
_SKYDIO_X10 = ("VT300", "V100")
"""How names of its cameras begin."""
_SKYDIO_HEIGHTS = (
    "a Skydio X10 with its attachment for RTK and PPK tells heights above the ellipsoid, though EXIF calls "
    "them above the sea: if it had that, give --geoid-m 0"
)
_MOST_APART = 0.25
"""Of the focal lengths that a photograph is calibrated with and that EXIF tells."""
_SAME_SHAPE = 1.02
"""Whole pixels leave such a share between the sides of a picture that was shrunk."""


@dataclass(frozen=True, slots=True)
class PhotographOptions:
    """What photographs do not say about themselves."""

    mount: CameraMount | None = None
    """Of kind north, or of the drone's attitude where that is told (DJI)."""
    calibration: Camera | None = None
    heights: HeightsAbove | None = None
    geoid_m: float | None = None
    take_off: tuple[float, float] | None = None


@dataclass(frozen=True, slots=True)
class _Photograph:
    path: Path
    tags: PhotographTags
    taken: WhenTaken

    @property
    def stamp_ns(self) -> int:
        return self.taken.stamp_ns


def photographs(path: Path) -> list[Path]:
    """The photographs of a folder by name, or of the one named."""
    if path.is_dir():
        return sorted(
            file for file in path.iterdir() if file.suffix.lower() in SUFFIXES and is_file_or_lost(file)
        )
    return [path] if path.suffix.lower() in SUFFIXES else []


def read_photographs(
    path: Path, limits: Limits, options: PhotographOptions, anchor: Georeference | None = None
) -> Recording:
    """Open a folder of photographs. ValueError when none of them can be placed, with the reason of the
    first."""
    refused: list[RefusedFrame] = []
    by_drone: dict[str, list[_Photograph]] = {}
    remarks = left_out(path, SUFFIXES) if path.is_dir() else []
    groups = _by_camera(photographs(path), refused)
    only_thermal = all(one.tags.thermal for group in groups.values() for one in group)
    for drone, group in groups.items():
        usable = _placeable(drone, group, options, refused, only_thermal)
        if usable:
            in_utc = _in_utc(drone, usable, remarks)
            if doubt := clock_doubt([*_ahead_of_receiver_s(in_utc)]):
                remarks.append(f"{drone}: {doubt}")
            remarks += [f"{drone}: {doubt}" for doubt in place_doubts([one.tags for one in usable])]
            by_drone[drone] = _in_time(drone, in_utc, remarks)
    if not by_drone:
        why = f": {refused[0].reason}" if refused else ""
        raise ValueError(f"{path}: no photograph can be placed on a map, the first{why}")
    unplaced, tracks, contacts = {}, {}, {}
    for drone, group in by_drone.items():
        placed = _local_track(group, options, anchor)
        anchor = placed.anchor
        tracks[drone] = placed.track
        if placed.contact is not None:
            contacts[drone] = placed.contact
        remarks += [f"{drone}: {remark}" for remark in placed.remarks]
        if options.mount is not None and (told := _overruled(group, options.mount)):
            remarks.append(f"{drone}: {told}")
        if placed.heights == "take-off" and (doubt := _take_off_doubt(group)):
            remarks.append(f"{drone}: {doubt}")
        if only_thermal:
            remarks.append(
                f"{drone}: every photograph is {THERMAL}: they call the ground empty; give --detector one "
                "that was trained on thermal pictures"
            )
        lacking = sum(_HEIGHTS[0] not in one.tags.heights_m for one in group)
        if options.heights is None and 0 < lacking < len(group):
            remarks.append(
                f"{drone}: {lacking} of {len(group)} photographs do not tell how high above the take-off "
                "they were taken, so that is used of none: without these, those of the others would be"
            )
        if placed.heights == "sea" and all(one.tags.by_dji for one in group):
            remarks.append(f"{drone}: {DJI_SEA_LEVEL}")
        if placed.heights == "sea" and all(one.tags.model.startswith(_SKYDIO_X10) for one in group):
            remarks.append(f"{drone}: {_SKYDIO_HEIGHTS}")
        unplaced[drone] = _unplaced(drone, group, options, remarks)
    frames, misplaced = place_cameras(unplaced, tracks, limits)
    return Recording(
        name=path.resolve().stem,
        drones=tuple(sorted(by_drone)),
        frames=frames,
        georeference=anchor,
        terrain=None,
        refused=(*refused, *misplaced),
        warnings=tuple(remarks),
        manifest={"kind": "photographs", "path": str(path)},
        pose_tracks=tracks,
        ground_contacts=contacts,
    )


def _by_camera(paths: list[Path], refused: list[RefusedFrame]) -> dict[str, list[_Photograph]]:
    groups: dict[str, list[_Photograph]] = {}
    at_once: dict[tuple[str, int], list[Path]] = {}
    for path in paths:
        try:
            tags = read_tags(path)
        except (OSError, ValueError) as error:
            refused.append(RefusedFrame("", None, f"{path.name}: {error}"))
            continue
        drone = "_".join(word for word in (tags.model.replace(" ", "") or "camera", tags.serial[-4:]) if word)
        if tags.taken is None:
            refused.append(RefusedFrame(drone, None, f"{path.name} does not say when it was taken"))
            continue
        others = at_once.setdefault((drone, tags.taken.stamp_ns), [])
        original = next((other for other in others if _same_bytes(path, other)), None)
        if original is not None:  # what one look shows is no second one
            reason = f"{path.name} is a copy of {original.name}"
            refused.append(RefusedFrame(drone, tags.taken.stamp_ns, reason))
            continue
        others.append(path)
        groups.setdefault(drone, []).append(_Photograph(path, tags, tags.taken))
    return groups


def _same_bytes(path: Path, other: Path) -> bool:
    return path.stat().st_size == other.stat().st_size and path.read_bytes() == other.read_bytes()


def _placeable(
    drone: str,
    group: list[_Photograph],
    options: PhotographOptions,
    refused: list[RefusedFrame],
    only_thermal: bool,
) -> list[_Photograph]:
    """Whoever gives thermal photographs alone may have a detector for them."""
    usable = []
    for one in group:
        fault = _fault(one.tags, options)
        if fault is None and one.tags.thermal and not only_thermal:
            fault = f"is {THERMAL}: it is not looked at beside pictures of colours; give it in a folder alone"
        if fault is None:
            usable.append(one)
        else:
            refused.append(RefusedFrame(drone, one.stamp_ns, f"{one.path.name} {fault}"))
    return usable


def _fault(tags: PhotographTags, options: PhotographOptions) -> str | None:
    if tags.panorama:
        return f"is a panorama ({tags.panorama}), put together of several pictures: no lens shows it so"
    if tags.place is None:
        return "does not say where it was taken (GPS, with its hemispheres)"
    if tags.other_datum:
        return (
            f"says where it was taken in the datum {quoted(tags.other_datum)} (GPSMapDatum), which may lie "
            "hundreds of metres from WGS84: write it in that (exiftool -GPSMapDatum=WGS-84 where it is so)"
        )
    if not tags.heights_m:
        return "does not say how high it was taken"
    if options.mount is None and tags.attitude_ned is None:
        told = tags.unusable_attitude or (
            "does not say where its camera looked, and a guess would put crowds anywhere"
        )
        return f"{told}: say it with --mount, such as north:-90,0 for straight down with north on top"
    if options.mount is not None and options.mount.needs_body and tags.body_ned is None:
        return f"does not tell the drone's attitude, which a mount of kind {options.mount.kind!r} needs"
    return None if tags.orientation == UPRIGHT else turned_fault(tags.orientation)


def _in_utc(drone: str, group: list[_Photograph], remarks: list[str]) -> list[_Photograph]:
    """Those that do not say their time zone are in that of most others of the camera."""
    zones = Counter(one.taken.zone_s for one in group if one.taken.zone_s is not None)
    if not zones:
        remarks.append(
            f"{drone}: its photographs do not say their time zone: their times, and with them those of the "
            "zones, are taken as UTC"
        )
        return group
    ((zone_s, _),) = zones.most_common(1)
    return [replace(one, taken=one.taken.in_zone(zone_s)) for one in group]


def _ahead_of_receiver_s(group: list[_Photograph]) -> Iterator[float]:
    for one in group:
        if one.tags.received is not None:
            yield one.stamp_ns / 1e9 - one.tags.received.timestamp()


def _in_time(drone: str, group: list[_Photograph], remarks: list[str]) -> list[_Photograph]:
    """By time and name; those of one whole second are spread over it in the order of their names."""
    group = sorted(group, key=lambda one: (one.stamp_ns, one.path.name))
    same: dict[int, list[_Photograph]] = {}
    for one in group:
        same.setdefault(one.stamp_ns, []).append(one)
    if any(len(ones) > 1 and ones[0].taken.whole_second for ones in same.values()):
        remarks.append(f"{drone}: photographs of the same second are spread over it by their names")
    return [
        replace(one, taken=replace(one.taken, stamp_ns=one.stamp_ns + number * 1_000_000_000 // len(ones)))
        if one.taken.whole_second
        else one
        for ones in same.values()
        for number, one in enumerate(ones)
    ]


def _local_track(
    group: list[_Photograph], options: PhotographOptions, anchor: Georeference | None
) -> LocalTrack:
    kinds: list[HeightsAbove] = [
        kind for kind in _HEIGHTS if all(kind in one.tags.heights_m for one in group)
    ]
    places = np.array([one.tags.place for one in group], np.float64)
    poses = GeographicPoses(
        stamps_ns=[one.stamp_ns for one in group],
        latitude_deg=places[:, 0],
        longitude_deg=places[:, 1],
        heights_m={kind: np.array([one.tags.heights_m[kind] for one in group]) for kind in kinds},
        attitudes_ned=np.array([_attitude(one.tags, options.mount) for one in group]),
        preferred_heights=_HEIGHTS,
    )
    return local_track(poses, HeightOptions(options.heights, options.geoid_m, options.take_off), anchor)


def _take_off_doubt(group: list[_Photograph]) -> str | None:
    heights = [one.tags.heights_m for one in group]
    absolute = next((kind for kind in _ABSOLUTE if all(kind in one for one in heights)), None)
    if absolute is None:
        return None
    above_m, absolute_m = ([one[kind] for one in heights] for kind in (_HEIGHTS[0], absolute))
    return take_off_doubt([one.stamp_ns for one in group], above_m, absolute_m)


def _attitude(tags: PhotographTags, mount: CameraMount | None) -> object:
    if mount is None:
        return tags.attitude_ned
    body = np.array([1.0, 0.0, 0.0, 0.0]) if tags.body_ned is None else tags.body_ned
    return mount.camera_quaternions_ned(body[None])[0]


def _overruled(group: list[_Photograph], mount: CameraMount) -> str:
    told = [np.full(4, np.nan) if one.tags.attitude_ned is None else one.tags.attitude_ned for one in group]
    return overruled(mount, np.array(told), np.array([_attitude(one.tags, mount) for one in group]))


def _unplaced(
    drone: str, group: list[_Photograph], options: PhotographOptions, remarks: list[str]
) -> list[UnplacedFrame]:
    frames = []
    said: dict[str, None] = {}
    calibrated_mm = None
    if options.calibration is not None:
        calibrated_mm = _calibrated_mm(options.calibration, [one.tags for one in group])
        if calibrated_mm is not None:
            said[calibration_doubt(options.calibration, calibrated_mm)] = None
    for one in group:
        camera, fault = None, None
        try:
            if options.calibration is None:
                camera, how = _camera(one.tags)
                said[how] = None
            else:
                camera = _calibrated(options.calibration, calibrated_mm, one.tags)
        except ValueError as error:
            fault = str(error)
        frames.append(UnplacedFrame(one.stamp_ns, camera, PixelSources(image=one.path.read_bytes), fault))
    remarks += [f"{drone}: {how}" for how in list(said)[:3] if how]
    return frames


def _calibrated_mm(calibration: Camera, photographs: list[PhotographTags]) -> float | None:
    """Which of the focal lengths of a drone's photographs its calibration is of, on 35 mm film: the nearest;
    None where they tell none."""
    told = [length for one in photographs if (length := _focal_35mm(one)) is not None]
    of = focal_35mm_of(calibration)
    return min(told, key=lambda length: abs(np.log(length / of)), default=None)


def _calibrated(calibration: Camera, calibrated_mm: float | None, tags: PhotographTags) -> Camera:
    """ValueError for a photograph of another proportion, or through another lens or zoom."""
    length = _focal_35mm(tags)
    if length is not None and calibrated_mm is not None and not alike(length, calibrated_mm):
        raise ValueError(
            f"it was taken at {length:.0f} mm (35 mm film), its calibration is of {calibrated_mm:.0f} mm"
        )
    return scaled_camera(calibration, tags.width, tags.height)


def _focal_35mm(tags: PhotographTags) -> float | None:
    """To tell one lens or zoom of a drone from another; None where nothing is told."""
    told = tags.focal_35mm
    try:
        estimate = _estimate(tags)
    except ValueError:
        return told * tags.digital_zoom if told is not None and is_of_a_lens(told) else None
    return None if estimate is None else focal_35mm_of(estimate.camera)


def _camera(tags: PhotographTags) -> tuple[Camera, str]:
    if tags.fisheye:
        raise ValueError(
            "its lens is a fisheye's (Camera:ModelType), which bends lines and has no one focal length: give "
            "--calibration, of kind equidistant"
        )
    whole = _shown_of_it(tags) == 1.0
    camera = _by_dewarp_data(tags) if tags.dewarp and not _zoomed(tags) else None
    try:
        estimate = _estimate(tags)
    except ValueError:
        if camera is None:
            raise
        estimate = None
    if camera is not None and whole and (estimate is None or _agree(camera, estimate.camera)):
        return camera, "intrinsics are the calibration in the photographs (DewarpData)"
    if estimate is None:
        raise ValueError("nothing says how wide its camera sees: no focal length in EXIF; give --calibration")
    if camera is None:
        return estimate.camera, estimate.said
    return estimate.camera, f"{estimate.said}; DewarpData is of another picture: {camera.fx:.0f} px"


def _shown_of_it(tags: PhotographTags) -> float:
    """How large the picture is, by its sides, as a share of what the camera wrote; 1 where that is not told.
    ValueError for one that was cut, of which nobody knows what is left."""
    if tags.size_taken is None:
        return 1.0
    shares = [is_ / was for is_, was in zip(*map(sorted, (_size(tags), tags.size_taken)), strict=True)]
    if max(shares) > _SAME_SHAPE * min(shares):
        was, now = ("x".join(map(str, size)) for size in (tags.size_taken, _size(tags)))
        raise ValueError(
            f"it had {was} pixels when it was taken (EXIF) and has {now}: cut, and nothing says which part "
            "is left; take the picture as the camera saved it, or give --calibration of what is left"
        )
    return max(shares)


def _size(tags: PhotographTags) -> tuple[int, int]:
    return tags.width, tags.height


def _zoomed(tags: PhotographTags) -> bool:
    return not alike(tags.digital_zoom, 1.0)


def _estimate(tags: PhotographTags) -> EstimatedCamera | None:
    """By the focal length in EXIF; ValueError for one that no lens has, and where nobody can tell what a
    digital zoom has done to it."""
    by_sensor = _by_sensor(tags)
    told = tags.focal_35mm
    if by_sensor is None:
        if _zoomed(tags):
            raise _unknown_zoom(tags)
        return camera_from_35mm(tags.width, tags.height, told, film=False) if told else None
    if told is None or not is_of_a_lens(told):
        return by_sensor
    by_film = camera_from_35mm(tags.width, tags.height, told, film=False)
    # A drone with several cameras may call all of them by the name of one.
    if any(_agree(by_sensor.camera, by_film.camera, zoom) for zoom in (1.0, tags.digital_zoom)):
        return by_sensor
    if _zoomed(tags):
        raise _unknown_zoom(tags)
    return by_film


def _unknown_zoom(tags: PhotographTags) -> ValueError:
    return ValueError(
        f"it was taken with a digital zoom of {tags.digital_zoom:g}, and makers differ in whether the focal "
        "length on 35 mm film counts that: give --calibration, of this zoom"
    )


def _by_sensor(tags: PhotographTags) -> EstimatedCamera | None:
    """The lens alone is before the whole sensor; zoomed digitally, the picture shows less of that."""
    if tags.focal_mm is None or not tags.model:
        return None
    return camera_from_sensor(tags.width, tags.height, tags.focal_mm * tags.digital_zoom, tags.model)


def _agree(calibrated: Camera, estimated: Camera, zoom: float = 1.0) -> bool:
    """Estimates are some percent off; a picture that was shrunk or cut afterwards is off by more. `zoom`:
    what the estimate does not count."""
    return abs(calibrated.fx / (estimated.fx * zoom) - 1.0) <= _MOST_APART


def _by_dewarp_data(tags: PhotographTags) -> Camera | None:
    """DewarpData: date;fx,fy,cx,cy,k1,k2,p1,p2,k3, with cx and cy counted from the middle. None where it does
    not hold together."""
    try:
        values = [float(value) for value in (tags.dewarp or "").rpartition(";")[2].split(",")]
        fx, fy, cx, cy, *distortion = values
        middle = (cx + tags.width / 2, cy + tags.height / 2)
        left = None if tags.dewarped else distortion or None
        return Camera.pinhole(tags.width, tags.height, fx, fy, *middle, left)
    except ValueError:
        return None
