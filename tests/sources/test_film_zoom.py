"""How wide a DJI camera sees, by what its subtitles say of it frame by frame."""

from collections.abc import Callable
from pathlib import Path

import av
import numpy as np
import pytest

from crowdfence import Camera, open_recording
from crowdfence.sources.convert import convert
from crowdfence.sources.film.subtitles import read_subtitles
from crowdfence.sources.recording import Recording

WIDTH, HEIGHT = 640, 360


def subtitles(path: Path, lens: Callable[[int], str], *, count: int = 60, every_s: float = 0.1) -> Path:
    """A block every `every_s`; `lens` writes what the n-th says of the camera."""
    text = ""
    for number in range(count):
        begin, end = (f"00:00:{(number + more) * every_s:06.3f}".replace(".", ",") for more in (0, 1))
        text += (
            f"{number + 1}\n{begin} --> {end}\n2026-01-01 12:00:00.000\n{lens(number)} [latitude: 46.500000] "
            "[longitude: 8.000000] [rel_alt: 60.000 abs_alt: 560.000] "
            "[gb_yaw: 0.0 gb_pitch: -60.0 gb_roll: 0.0]\n\n"
        )
    path.write_text(text)
    return path


@pytest.mark.parametrize(
    ("written", "length_mm"),
    [
        ("[focal_len: 24.00]", 24.0),  # Mini 3, Mavic 3
        ("[focal_len: 166.00]", 166.0),  # the tele camera of a Mavic 3 Pro
        ("[focal_len: 162.00] [dzoom_ratio: 2.00]", 324.0),
        ("[focal_len : 240]", 24.0),  # Mavic Air 2
        ("[focal_len : 240] [dzoom_ratio: 20000, delta:0]", 48.0),
        ("[focal_len: 24]", 24.0),
    ],
)
def test_only_whole_numbers_are_tenths_of_a_millimetre(
    tmp_path: Path, written: str, length_mm: float
) -> None:
    log = read_subtitles(subtitles(tmp_path / "x.srt", lambda number: written, count=3))
    assert log.focal_35mm is not None
    assert log.focal_35mm.tolist() == pytest.approx([length_mm] * 3)


PX_PER_MM = 800 / np.hypot(36, 24)
"""35 mm film compares diagonals; the picture's 16:9 are cut from a sensor of 4:3, 640 x 480, 800 across."""


def film(folder: Path, lens: Callable[[int], str], **spacing: float) -> Path:
    """5 s at 10 frames a second, with subtitles."""
    with av.open(str(folder / "a.mp4"), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for number in range(50):
            grey = np.full((HEIGHT, WIDTH, 3), number, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="rgb24")))
        container.mux(stream.encode(None))
    subtitles(folder / "a.srt", lens, **spacing)  # type: ignore[arg-type]
    return folder / "a.mp4"


def lengths_mm(found: Recording) -> dict[float, float]:
    """Seconds since the film began -> the focal length of that frame, on 35 mm film."""
    begin_ns = min(one.stamp_ns for one in (*found.frames, *found.refused))
    return {(one.stamp_ns - begin_ns) / 1e9: one.camera.fx / PX_PER_MM for one in found.frames}


@pytest.mark.parametrize(
    "lens", ["[focal_len: {}] [dzoom_ratio: 1.00]", "[focal_len: 24.00] [dzoom_ratio: {}]"]
)
def test_every_frame_has_the_focal_length_of_its_moment(tmp_path: Path, lens: str) -> None:
    values = ("24.00", "72.00") if lens.startswith("[focal_len: {}") else ("1.00", "3.00")
    found = open_recording(film(tmp_path, lambda number: lens.format(values[number >= 36])))
    assert not found.refused
    # Two frames a second; the 37th block begins at 3.6 s.
    assert lengths_mm(found) == pytest.approx({n / 2: 24 if n < 8 else 72 for n in range(10)})
    assert any("zooms, from 24 to 72 mm on 35 mm film" in warning for warning in found.warnings)


def test_frames_of_one_focal_length_share_one_camera(tmp_path: Path) -> None:
    found = open_recording(film(tmp_path, lambda number: "[focal_len: 166.00]"))
    assert found.frames[0].camera.fx == pytest.approx(166 * PX_PER_MM)
    assert len({id(frame.camera) for frame in found.frames}) == 1
    assert any("estimate from 166 mm on 35 mm film" in warning for warning in found.warnings)


def test_slow_zooming_is_followed_between_the_rows(tmp_path: Path) -> None:
    # 1 % a row of a second: halfway between 24 * 1.01 ** 2 and 24 * 1.01 ** 3.
    slowly = film(tmp_path, lambda n: f"[focal_len: {24 * 1.01**n:.6f}]", count=6, every_s=1.0)
    found = lengths_mm(open_recording(slowly))
    assert found[2.0] == pytest.approx(24.4824, abs=1e-3)
    assert found[2.5] == pytest.approx((24.4824 + 24.7272) / 2, abs=1e-3)


def test_a_frame_between_two_focal_lengths_is_refused_and_counted(tmp_path: Path) -> None:
    quickly = film(tmp_path, lambda n: f"[focal_len: {24 if n < 3 else 70:.2f}]", count=6, every_s=1.0)
    found = open_recording(quickly)
    # Rows at 2 s and 3 s differ; nobody knows when in between.
    assert [refused.reason for refused in found.refused] == [
        "the camera zooms there: the log has 24 mm before it and 70 mm after"
    ]
    assert 2.5 not in lengths_mm(found) and len(found.frames) == 9
    assert any("1 of 10 frames are refused" in warning for warning in found.warnings)


@pytest.mark.parametrize(("calibrated_mm", "of_mm"), [(25.5, 24), (67, 70)])
def test_a_calibration_is_of_one_focal_length(tmp_path: Path, calibrated_mm: float, of_mm: float) -> None:
    focal_px = calibrated_mm * PX_PER_MM
    calibration = Camera.pinhole(WIDTH, HEIGHT, focal_px, focal_px, 320.0, 180.0)
    zoomed = film(tmp_path, lambda n: f"[focal_len: {24 if n < 36 else 70:.2f}]")
    found = open_recording(zoomed, calibration=calibration)
    # 8 of 10 frames at 24 mm, then two at 70 mm.
    assert len(found.frames) == (8 if of_mm == 24 else 2) and len(found.refused) == 10 - len(found.frames)
    assert all(frame.camera.fx == pytest.approx(focal_px) for frame in found.frames)
    assert found.refused[0].reason == f"the camera is at {94 - of_mm} mm there, its calibration at {of_mm} mm"
    said = f"taken as {of_mm} mm; {len(found.refused)} of 10 frames are refused"
    assert any(said in warning for warning in found.warnings)


def test_a_calibration_of_a_film_that_does_not_zoom_is_taken_as_it_is(tmp_path: Path) -> None:
    calibration = Camera.pinhole(WIDTH, HEIGHT, 700.0, 700.0, 320.0, 180.0)
    found = open_recording(film(tmp_path, lambda n: "[focal_len: 24.00]"), calibration=calibration)
    assert len(found.frames) == 10 and {frame.camera.fx for frame in found.frames} == {700.0}


@pytest.mark.parametrize(
    ("lens", "calibrated_mm", "told"),
    [
        (lambda n: "[focal_len: 24.00] [dzoom_ratio: 2.00]", 24.0, True),  # zoomed all the time
        (lambda n: "[focal_len: 24.00] [dzoom_ratio: 1.00]", 30.0, False),  # cut to be stabilised
        (lambda n: f"[focal_len: {70 if n < 36 else 90}.00]", 24.0, True),  # by the lens not calibrated
    ],
)
def test_a_calibration_of_another_lens_or_zoom_is_told(
    tmp_path: Path, lens: Callable[[int], str], calibrated_mm: float, told: bool
) -> None:
    focal_px = calibrated_mm * PX_PER_MM
    calibration = Camera.pinhole(WIDTH, HEIGHT, focal_px, focal_px, 320.0, 180.0)
    found = open_recording(film(tmp_path, lens), calibration=calibration)
    doubts = [one for one in found.warnings if "is it of another lens, or zoom?" in one]
    assert len(doubts) == told and all(f"calibration is of {calibrated_mm:.0f} mm" in one for one in doubts)


def test_blocks_that_do_not_tell_it_and_lengths_of_no_lens_say_nothing(tmp_path: Path) -> None:
    told = {0: "[focal_len: 24.00]", 1: "[focal_len: 0.00]"}
    found = open_recording(film(tmp_path, lambda number: told.get(number % 3, "[iso: 100]")))
    assert lengths_mm(found) == pytest.approx({n / 2: 24 for n in range(10)})
    with pytest.raises(ValueError, match="a focal length of 0 mm"):
        open_recording(film(tmp_path, lambda number: "[focal_len: 0.00]"))


def test_a_converted_film_keeps_the_camera_of_every_frame(tmp_path: Path) -> None:
    zoomed = film(tmp_path, lambda n: f"[focal_len: {24 if n < 36 else 72:.2f}]")
    found = open_recording(zoomed, heights="sea", geoid_m=48.0)
    convert(found, tmp_path / "a.mcap")
    kept = open_recording(tmp_path / "a.mcap")
    assert [frame.camera for frame in kept.frames] == [frame.camera for frame in found.frames]
    assert len({frame.camera for frame in kept.frames}) == 2
