"""`crowdfence detect` on videos, pictures and recordings; the model's heatmap is the red of 4 x 4 cells."""

import csv
import json
import os
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from crowdfence import atomic_folder, open_recording
from crowdfence.cli.demo import RECORDING as DEMO
from crowdfence.detector.detector import Detector
from crowdfence.detector.overlay import overlay
from crowdfence.exports.video import VideoWriter
from crowdfence.heatmap_files import detect_pictures
from crowdfence.sources.pictures.files import picture_files, read_pictures
from crowdfence.sources.pictures.stream import SkippedPicture, StreamPicture
from crowdfence.sources.pictures.video import Video
from support.command_line import crowdfence
from support.onnx_models import contract, write_map_model, write_pixel_people_model
from support.small_recordings import flight, write_airsim
from support.small_videos import (
    HEIGHT,
    WIDTH,
    damage,
    delayed,
    packet_ends,
    picture,
    side_by_side,
    turn,
    write_cover,
    write_video,
)

FAILED = 1


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_map_model(tmp_path_factory.mktemp("model") / "red.onnx", contract())


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_airsim(tmp_path_factory.mktemp("flight") / "recording", flight())


def detect(*arguments: object) -> subprocess.CompletedProcess[str]:
    return crowdfence("detect", *arguments)


def error_line(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == FAILED, done.stderr
    assert done.stdout == ""
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    return lines[0]


def index(folder: Path) -> list[dict[str, str]]:
    with (folder / "index.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_video_whose_pixels_are_not_square_is_told(model: Path, tmp_path: Path) -> None:
    """Players stretch it; the model is shown people half as wide as they are."""
    film = write_video(tmp_path / "film.mp4", 2, pixel_aspect="2:1")
    done = detect(film, "--model", model, "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    (told,) = [one for one in json.loads(done.stdout)["warnings"] if "squeezed" in one]
    assert "2.000 times as wide as high" in told
    done = detect(write_video(tmp_path / "square.mp4", 2), "--model", model, "-o", tmp_path / "2", "--json")
    assert "squeezed" not in done.stdout


def test_a_video_with_broken_frames_says_which_are_missing(model: Path, tmp_path: Path) -> None:
    film = damage(write_video(tmp_path / "film.mp4", 12), [6])
    done = detect(film, "--model", model, "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    # Frame 6 is gone, 7 to 9 build on it, 10 is a key frame.
    assert [line.partition(":")[0] for line in report["skipped"]] == [
        f"frame {number} at 0.{number}00 s" for number in (6, 7, 8, 9)
    ]
    assert "cannot be decoded" in report["skipped"][0]
    assert report["frames"] == 8

    rows = index(tmp_path / "out")
    whole = [0, 1, 2, 3, 4, 5, 10, 11]
    assert [int(row["frame"]) for row in rows] == whole
    assert [float(row["time_s"]) for row in rows] == [number / 10 for number in whole]
    # 4 * n of 64 columns are white, that is n of 16 columns of cells.
    assert [float(row["crowd_share"]) for row in rows] == [min(number, 8) / 16 for number in whole]
    for row, number in zip(rows, whole, strict=True):
        with Image.open(tmp_path / "out" / row["file"]) as png:
            assert (png.mode, png.size) == ("L", (WIDTH // 4, HEIGHT // 4))
            cells = np.asarray(png)
        assert (cells[:, : min(number, 8)] > 230).all() and (cells[:, min(number, 8) :] < 25).all()

    with Video(tmp_path / "out" / "overlay.mp4") as video:
        shown = list(video.pictures())
    assert [round(item.time_s or 0.0, 3) for item in shown] == [number / 10 for number in whole]
    assert all(isinstance(item, StreamPicture) for item in shown)
    assert shown[-1].rgb.shape == (HEIGHT, WIDTH, 3)


def test_a_film_beside_another_in_one_file_is_told(model: Path, tmp_path: Path) -> None:
    """As of a second lens: who stands in it alone was seen by nobody. The cover of a film is none."""
    one, other = write_video(tmp_path / "one.mp4", 3), write_video(tmp_path / "other.mp4", 2)
    both, covered = tmp_path / "both.mp4", write_cover(tmp_path / "covered.mp4", one)
    for film, told in ((side_by_side([one, other], both), [f"{both} holds 2 films"]), (covered, [])):
        report = json.loads(detect(film, "--model", model, "-o", tmp_path / film.stem, "--json").stdout)
        found = [warning for warning in report["warnings"] if "films" in warning]
        assert report["frames"] == 3
        assert [warning.partition(", as of several lenses, ")[0] for warning in found] == told


@pytest.mark.parametrize(
    ("codec", "options"),
    [
        ("libx264", {"slices": "4", "bf": "0", "sc_threshold": "0"}),
        ("libx265", {"x265-params": "bframes=0:scenecut=0:open-gop=0:min-keyint=6:log-level=none"}),
    ],
)
def test_a_stream_that_lost_bytes_on_its_way_shows_nothing_that_was_patched_up(
    tmp_path: Path, codec: str, options: dict[str, str]
) -> None:
    """H.264 in slices and HEVC, as drones send them: FFmpeg puts other pixels in the place of those that are
    lost, and whoever stood there is gone, in all frames up to the next key frame."""
    import av

    film = tmp_path / "downlink.ts"
    scene = np.random.default_rng(0).integers(0, 256, (128, 128, 3), np.uint8)
    with av.open(str(film), "w") as container:
        stream = container.add_stream(codec, rate=10, options=options)
        stream.width, stream.height, stream.pix_fmt, stream.gop_size = 128, 128, "yuv420p", 6
        for _ in range(12):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(scene, format="rgb24")))
        container.mux(stream.encode(None))
    sent = film.read_bytes()
    with av.open(str(film)) as container:
        first = next(packet for packet in container.demux(video=0) if packet.size)
    lost = first.pos + first.size // 2 // 188 * 188  # one packet of the stream, in the middle of the frame
    film.write_bytes(sent[:lost] + sent[lost + 188 :])
    with Video(film) as video:
        items = list(video.pictures())
    whole = [item for item in items if isinstance(item, StreamPicture)]
    assert [round(item.time_s or 0.0, 3) for item in whole] == [0.6, 0.7, 0.8, 0.9, 1.0, 1.1]
    reasons = [item.reason for item in items if isinstance(item, SkippedPicture)]
    assert reasons[0] == "bytes of it were lost on their way" and len(reasons) == 6


def test_films_that_were_put_one_behind_the_other(tmp_path: Path) -> None:
    """Byte for byte, as transport streams may be: the second begins at the time of the first."""
    one, joined = write_video(tmp_path / "one.ts", 15), tmp_path / "joined.ts"
    joined.write_bytes(one.read_bytes() * 2)
    with Video(joined) as video:
        items = list(video.pictures())
    whole = [item for item in items if isinstance(item, StreamPicture)]
    # Whether the first lost its end nobody can know; the second begins with a key frame.
    assert [round((item.time_s or 0.0) * 10) for item in whole] == [*range(14), *range(15)]
    assert [item.number for item in items if isinstance(item, SkippedPicture)] == [14]
    with Video(joined) as video, pytest.raises(ValueError, match=r"joined.ts: its times go back by 1.4 s"):
        video.shown_times()


def test_a_video_without_a_single_frame_is_an_error_and_leaves_nothing(model: Path, tmp_path: Path) -> None:
    film = damage(write_video(tmp_path / "film.mp4", 4), [0, 1, 2, 3])
    line = error_line(detect(film, "--model", model, "-o", tmp_path / "out"))
    assert "film.mp4" in line and "no picture could be used: frame 0 at 0.000 s" in line
    assert not (tmp_path / "out").exists()


def test_every_second_frame_of_a_video(model: Path, tmp_path: Path) -> None:
    film = write_video(tmp_path / "film.mp4", 7)
    with Video(film) as video:
        done = detect_pictures(video.pictures(every=2), Detector(model), tmp_path / "out", video=False)
    assert done.frames == 4 and not done.skipped
    assert [int(row["frame"]) for row in index(tmp_path / "out")] == [0, 2, 4, 6]
    assert not (tmp_path / "out" / "overlay.mp4").exists()


def test_frames_out_of_order_keep_their_numbers(tmp_path: Path) -> None:
    """With B-frames the decoder meets frame 6 before 4 and 5."""
    import av

    path = tmp_path / "film.mp4"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("mpeg4", rate=10)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.gop_size, stream.max_b_frames, stream.bit_rate = 9, 2, 4_000_000
        for number in range(12):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture(number), format="rgb24")))
        container.mux(stream.encode(None))
    with av.open(str(path)) as container:
        order = [
            round(packet.pts * packet.time_base * 10) for packet in container.demux(video=0) if packet.size
        ]
    assert order != sorted(order)
    broken = order.index(4)
    damage(path, [broken])
    with Video(path) as video:
        items = list(video.pictures())
    assert [item.number for item in items] == list(range(12))
    reasons = {item.number: item.reason for item in items if isinstance(item, SkippedPicture)}
    assert "cannot be decoded" in reasons[4]
    for item in items:
        if isinstance(item, StreamPicture):
            assert np.abs(item.rgb.astype(int) - picture(item.number)).mean() < 8


@pytest.mark.parametrize(("clockwise_deg", "side"), [(90, "top"), (180, "right"), (270, "bottom")])
def test_a_film_that_is_stored_turned_is_looked_at_upright(
    model: Path, tmp_path: Path, clockwise_deg: int, side: str
) -> None:
    film = turn(write_video(tmp_path / "film.mp4", 4), clockwise_deg)
    size = (HEIGHT, WIDTH) if clockwise_deg != 180 else (WIDTH, HEIGHT)
    with Video(film) as video:
        assert video.size == size
        done = detect_pictures(video.pictures(), Detector(model), tmp_path / "out")
    assert done.frames == 4 and not done.skipped
    # Of the stored frame 3, the 12 columns on the left are white: 3 cells deep.
    cells = np.asarray(Image.open(tmp_path / "out" / "heatmaps" / "frame_000003.png"))
    assert cells.shape == (size[1] // 4, size[0] // 4)
    white = {"top": cells[:3], "right": cells[:, -3:], "bottom": cells[-3:]}[side]
    assert (white > 230).all() and (cells > 128).sum() == white.size
    with Video(tmp_path / "out" / "overlay.mp4") as video:
        assert video.size == size


@pytest.mark.parametrize("content", [b"", b"hello", b"#EXTM3U\n#EXTINF:1,\nfilm.mp4\n", b"\0" * 5000])
def test_files_that_are_no_video_are_refused(tmp_path: Path, content: bytes) -> None:
    write_video(tmp_path / "film.mp4", 2)
    path = tmp_path / "list.m3u8"
    path.write_bytes(content)
    with pytest.raises(ValueError, match="list.m3u8 is no video that can be read"):
        Video(path)


def test_a_video_that_was_cut_off(tmp_path: Path) -> None:
    """Every frame whose coded bytes lie before the cut is shown, and the next one is missing."""
    film = write_video(tmp_path / "film.mkv", 12)
    cut = film.stat().st_size * 2 // 3
    complete = sum(end <= cut for end in packet_ends(film))
    film.write_bytes(film.read_bytes()[:cut])
    with Video(film) as video:
        *whole, last = video.pictures()
    assert 1 < complete < 12
    assert [item.number for item in whole] == list(range(complete))
    for item in whole:
        assert isinstance(item, StreamPicture)
        assert np.abs(item.rgb.astype(int) - picture(item.number)).mean() < 8
    assert isinstance(last, SkippedPicture) and last.number == complete and "declares 1.2" in last.reason


@pytest.mark.parametrize("suffix", ["mkv", "mp4"])
def test_a_video_whose_times_begin_late_is_whole(tmp_path: Path, suffix: str) -> None:
    film = delayed(write_video(tmp_path / "film.mp4", 6), tmp_path / f"late.{suffix}", 3)
    with Video(film) as video:
        shown = list(video.pictures())
    assert all(isinstance(item, StreamPicture) for item in shown)
    assert [item.time_s for item in shown] == pytest.approx([0.1 * number for number in range(6)], abs=1e-3)


def test_a_folder_of_pictures(model: Path, tmp_path: Path) -> None:
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    Image.fromarray(picture(4)).save(pictures / "a.png")
    Image.fromarray(picture(2)).save(pictures / "b.jpg", quality=95)
    (pictures / "b2.jpg").write_bytes((pictures / "b.jpg").read_bytes()[:200])
    Image.fromarray(np.array([[[255, 0, 0], [255, 9, 0]]], np.uint8)).save(pictures / "c.png")
    Image.fromarray(np.zeros((8, 8), np.uint16)).save(pictures / "d.png")
    (pictures / "notes.txt").write_text("not a picture")
    done = detect(pictures, "--model", model, "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    damaged, deep = report["skipped"]
    assert damaged.startswith("frame 2 (b2.jpg): ") and "damaged" in damaged
    assert deep.startswith("frame 4 (d.png): ") and "8 bits" in deep
    rows = index(tmp_path / "out")
    assert [(row["source"], float(row["crowd_share"])) for row in rows] == [
        ("a.png", 4 / 16),
        ("b.jpg", 2 / 16),
        ("c.png", 1.0),
    ]
    assert all(row["time_s"] == "" for row in rows)
    with Video(tmp_path / "out" / "overlay.mp4") as video:
        assert len(list(video.pictures())) == 3

    line = error_line(detect(pictures, "--model", model, "-o", tmp_path / "out"))
    assert "exists" in line and "--force" in line
    assert detect(pictures / "a.png", "--model", model, "-o", tmp_path / "out", "--force").returncode == 0
    assert [path.name for path in (tmp_path / "out" / "heatmaps").iterdir()] == ["frame_000000.png"]


def test_what_is_left_out_of_a_folder_of_pictures_is_told(model: Path, tmp_path: Path) -> None:
    pictures = tmp_path / "pictures"
    (pictures / "heatmaps").mkdir(parents=True)
    page = Image.fromarray(picture(4))
    page.save(pictures / "a.png")
    page.save(pictures / "heatmaps" / "frame_000000.png")
    (pictures / "overlay.mp4").write_bytes(b"of the last time")
    report = json.loads(detect(pictures, "--model", model, "-o", tmp_path / "1", "--json").stdout)
    assert not report["skipped"] and not [one for one in report["warnings"] if "left out" in one]

    page.save(pictures / "b.tif", save_all=True, append_images=[page, page])
    page.save(pictures / "c.GIF")
    (pictures / "d.dng").write_bytes(b"raw")
    (pictures / "downlink.ts").write_bytes(b"a film")
    (pictures / "e.jpg").symlink_to(tmp_path / "nowhere.jpg")
    (pictures / "sub").mkdir()
    page.save(pictures / "sub" / "f.png")
    done = detect(pictures, "--model", model, "-o", tmp_path / "2", "--json")
    report = json.loads(done.stdout)
    assert report["frames"] == 2
    pages, lost = report["skipped"]
    assert pages.startswith("frame 1 (b.tif): only its first page is used, not the 2 behind it")
    assert lost.startswith("frame 2 (e.jpg): ") and "No such file" in lost
    files, folders = (one for one in report["warnings"] if "left out" in one)
    assert files.startswith("3 files of pictures/ left out, first: c.GIF; ")
    assert folders.startswith("1 subfolder of pictures/ with pictures left out, first: sub; ")


def test_a_picture_whose_name_is_no_utf8_is_looked_at(model: Path, tmp_path: Path) -> None:
    """As of cameras and archives of other times: one such name made a folder unusable."""
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    latin_1, damaged = (pictures / os.fsdecode(name) for name in (b"stra\xdfe.png", b"stra\xdfe.jpg"))
    try:
        Image.fromarray(picture(4)).save(latin_1)
        damaged.write_bytes(b"damaged")
    except OSError:
        pytest.skip("this file system takes no such name")
    done = detect(pictures, "--model", model, "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["skipped"] == [
        "frame 0 (stra<U+DCDF>e.jpg): stra<U+DCDF>e.jpg is damaged: it is no picture that can be read"
    ]
    assert [row["source"] for row in index(tmp_path / "out")] == ["stra<U+DCDF>e.png"]


def test_pictures_of_a_thermal_camera_are_told(model: Path, tmp_path: Path) -> None:
    """They show people as warmth: a detector of colours says of all of them that nobody is there."""
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    for name in ("DJI_20260101120000_0001_W.JPG", "DJI_20260101120000_0001_T.JPG", "DJI_0002_T.JPG"):
        Image.fromarray(picture(4)).save(pictures / name)
    film = write_video(tmp_path / "DJI_0003_T.MP4", 2)

    def told(source: Path, out: str) -> list[str]:
        report = json.loads(detect(source, "--model", model, "-o", tmp_path / out, "--json").stdout)
        return [one for one in report["warnings"] if "thermal" in one]

    (of_pictures,), (of_film,) = told(pictures, "1"), told(film, "2")
    assert of_pictures.startswith("2 pictures, first: DJI_0002_T.JPG, each is a thermal camera's, and")
    assert of_film.startswith("DJI_0003_T.MP4 is a thermal camera's, and") and "--detector" in of_film
    assert not told(pictures / "DJI_20260101120000_0001_W.JPG", "3")


def test_smaller_copies_in_a_picture_are_no_pages(tmp_path: Path) -> None:
    """Pyramids of a TIFF, and the preview that cameras put behind a photograph."""
    page = Image.fromarray(picture(4))
    small = page.resize((WIDTH // 2, HEIGHT // 2))
    small.encoderinfo = {"tiffinfo": {254: 1}}
    page.save(tmp_path / "a.tif", save_all=True, append_images=[small])
    page.save(tmp_path / "b.jpg", format="MPO", save_all=True, append_images=[small])
    with Image.open(tmp_path / "a.tif") as written:
        assert written.n_frames == 2
    items = list(read_pictures(picture_files(tmp_path)))
    assert [type(item) for item in items] == [StreamPicture, StreamPicture]


def test_nothing_is_replaced_without_being_asked_to(model: Path, tmp_path: Path) -> None:
    """Neither somebody's table, nor a film that happens to have our name."""
    film = write_video(tmp_path / "film.mp4", 2)
    for name in ("index.csv", "overlay.mp4"):
        folder = tmp_path / name.partition(".")[0]
        folder.mkdir()
        (folder / name).write_bytes(b"mine")
        line = error_line(detect(film, "--model", model, "-o", folder))
        assert f"{folder / name} exists" in line and "--force" in line
        assert [(path.name, path.read_bytes()) for path in folder.iterdir()] == [(name, b"mine")]


def test_what_is_looked_at_is_never_replaced(model: Path, tmp_path: Path) -> None:
    film = write_video(tmp_path / "overlay.mp4", 2)
    before = film.read_bytes()
    line = error_line(detect(film, "--model", model, "-o", tmp_path, "--force"))
    assert "overlay.mp4 is looked at and would be replaced" in line
    assert film.read_bytes() == before and [path.name for path in tmp_path.iterdir()] == ["overlay.mp4"]
    (tmp_path / "heatmaps").mkdir()
    Image.fromarray(picture(4)).save(tmp_path / "heatmaps" / "a.png")
    for source in (tmp_path / "heatmaps", tmp_path / "heatmaps" / "a.png"):
        assert "is looked at" in error_line(detect(source, "--model", model, "-o", tmp_path, "--force"))
    assert (tmp_path / "heatmaps" / "a.png").is_file()


def test_heatmaps_of_others_are_never_replaced(model: Path, tmp_path: Path) -> None:
    """A plain folder of pictures and heatmaps has them in a folder of the same name."""
    film = write_video(tmp_path / "film.mp4", 2)
    recorded = tmp_path / "flight" / "heatmaps" / "uav1_1760000000000000000.png"
    recorded.parent.mkdir(parents=True)
    recorded.write_bytes(b"mine")
    line = error_line(detect(film, "--model", model, "-o", tmp_path / "flight", "--force"))
    assert f"holds {recorded.name}, which is no result and would be lost" in line
    assert recorded.read_bytes() == b"mine" and [*(tmp_path / "flight").rglob("*.*")] == [recorded]


def test_a_killed_command_leaves_no_table_beside_heatmaps_that_it_is_not_of(
    model: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long, short = write_video(tmp_path / "long.mp4", 4), write_video(tmp_path / "short.mp4", 2)
    detector, out = Detector(model), tmp_path / "out"
    with Video(long) as video:
        detect_pictures(video.pictures(), detector, out, video=False)
    take_place = atomic_folder._take_place

    def die_after(beside: Path, target: Path) -> None:
        take_place(beside, target)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch, Video(short) as video, pytest.raises(KeyboardInterrupt):
        patch.setattr(atomic_folder, "_take_place", die_after)
        detect_pictures(video.pictures(), detector, out, video=False, replace_existing=True)
    assert len([*(out / "heatmaps").iterdir()]) == 2 and not (out / "index.csv").exists()

    # What one left that was killed before that is removed by the next.
    (out / ".heatmaps.crowdfence-killed").mkdir()
    with Video(long) as video:
        detect_pictures(video.pictures(), detector, out, video=False, replace_existing=True)
    assert sorted(path.name for path in out.iterdir()) == ["heatmaps", "index.csv"]
    assert len(index(out)) == 4


def test_an_overlay_of_other_heatmaps_does_not_stay(model: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    film = write_video(tmp_path / "film.mp4", 2)
    assert detect(film, "--model", model, "-o", out).returncode == 0
    assert (out / "overlay.mp4").is_file()
    assert detect(film, "--model", model, "-o", out, "--force", "--no-video").returncode == 0
    assert sorted(path.name for path in out.iterdir()) == ["heatmaps", "index.csv"]


def test_a_picture_that_shows_nothing_is_skipped_with_its_reason(model: Path, tmp_path: Path) -> None:
    pictures = tmp_path / "pictures"
    pictures.mkdir()
    Image.fromarray(picture(4)).save(pictures / "a.png")
    Image.fromarray(np.zeros((48, 64, 3), np.uint8)).save(pictures / "b.png")
    done = detect(pictures, "--model", model, "-o", tmp_path / "out", "--json")
    report = json.loads(done.stdout)
    assert report["frames"] == 1 and [row["source"] for row in index(tmp_path / "out")] == ["a.png"]
    (skipped,) = report["skipped"]
    assert skipped.startswith(
        "frame 1 (b.png): the picture shows nothing but one tone (red 0, green 0, blue 0)"
    )
    line = error_line(detect(pictures / "b.png", "--model", model, "-o", tmp_path / "nothing"))
    assert "no picture could be used" in line and "lost video" in line


def test_detectors_that_were_not_calibrated_together_are_told(model: Path, tmp_path: Path) -> None:
    other = write_map_model(tmp_path / "other.onnx", contract(name="other"))
    Image.fromarray(picture(4)).save(tmp_path / "a.png")
    both = ("--model", model, "--model", other, "-o", tmp_path / "out", "--no-video")
    report = json.loads(detect(tmp_path / "a.png", *both, "--json").stdout)
    assert report["detector"]["calibrated_together"] is False
    assert [one["name"] for one in report["detector"]["members"]] == ["test model", "other"]
    assert any("were not calibrated together" in warning for warning in report["warnings"])


def test_who_looks_where_nobody_is_named(tmp_path: Path) -> None:
    """Pictures without poses are a camera's. Those of a recording tell: no renderer's are so flat."""
    Image.fromarray(picture(4)).save(tmp_path / "a.png")
    flat = write_airsim(tmp_path / "flat", flight())
    (flat / "terrain" / "dem.tif").unlink()
    for source, output, every, expected in (
        (tmp_path / "a.png", tmp_path / "out", 1, "crowdnet-s-wide"),
        (DEMO, tmp_path / "seen.mcap", 60, "crowdnet-s"),
        (flat, tmp_path / "flat.mcap", 1, "crowdnet-s-wide"),
    ):
        done = detect(source, "-o", output, "--every", every, "--no-video", "--json")
        assert done.returncode == 0, done.stderr
        assert json.loads(done.stdout)["detector"]["name"] == expected
        chosen = "--detector crowdnet-s takes the other" in done.stderr
        assert chosen == (source == flat)


def test_a_folder_without_pictures_or_recording(model: Path, tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("nothing to see")
    with pytest.raises(ValueError, match="holds no pictures .* and no recording"):
        picture_files(tmp_path)


def test_people_need_metres_per_pixel(tmp_path: Path) -> None:
    people = write_pixel_people_model(tmp_path / "people.onnx", contract("points"))
    Image.fromarray(picture(4)).save(tmp_path / "a.png")
    files = picture_files(tmp_path / "a.png")
    with pytest.raises(ValueError, match="gsd_m is missing"):
        detect_pictures(read_pictures(files), Detector(people), tmp_path / "out")
    done = detect_pictures(read_pictures(files), Detector(people), tmp_path / "out", gsd_m=0.1)
    assert done.frames == 1


def test_a_recording_becomes_a_mission_with_these_heatmaps(
    model: Path, recording: Path, tmp_path: Path
) -> None:
    output = tmp_path / "seen.mcap"
    done = detect(recording, "--model", model, "-o", output, "--every", 2, "--video", "--json")
    assert done.returncode == 0, done.stderr
    report = json.loads(done.stdout)
    assert report["frames"] == {"uav1": 3, "uav_2": 3, "uav3": 3} and report["skipped"] == []
    assert report["detector"]["name"] == "test model"
    original, copy = open_recording(recording), open_recording(output)
    for drone in original.drones:
        kept = original.frames_of(drone)[::2]
        for before, after in zip(kept, copy.frames_of(drone), strict=True):
            assert before.stamp_ns == after.stamp_ns
            red = before.image()[..., 0].reshape(6, 4, 8, 4).mean(axis=(1, 3))
            assert after.heatmap() == pytest.approx(red / 255.0, abs=1e-6)
            assert (after.image() == before.image()).all()
            assert (after.regions() == before.regions()).all()
        assert (tmp_path / f"seen_{drone}.mp4").stat().st_size > 500
    assert "exists" in error_line(detect(recording, "--model", model, "-o", output))
    output.unlink()
    line = error_line(detect(recording, "--model", model, "-o", output, "--video"))
    assert "seen_uav1.mp4 exists" in line and "--force" in line and not output.exists()


def test_ground_of_a_flight_for_which_a_detector_was_not_tested_is_told(tmp_path: Path) -> None:
    """Here or never: whoever fuses the mission has heatmaps, and not the detector that made them. The
    cameras of the demo fly 25 to 90 m up."""
    narrow = {"schema": 1, **contract(), "validity": {"distance_m": [1.0, 5.0]}}
    model = write_map_model(tmp_path / "narrow.onnx", narrow)
    done = detect(DEMO, "--model", model, "-o", tmp_path / "seen.mcap", "--every", 30, "--json")
    assert done.returncode == 0, done.stderr
    told = [one for one in json.loads(done.stdout)["warnings"] if one.startswith("distance: ")]
    assert (
        len(told) == 1 and "100% of the ground seen lies above 5 m, where the detector test model" in told[0]
    )


def test_pictures_that_a_detector_is_shown_at_a_fraction_are_told(tmp_path: Path) -> None:
    """Of 64 x 48 pixels, the largest of them 192 x 144: there are no people a third as large in it."""
    small = contract(input__resize="letterbox", input__multiple_of=1) | {}
    small["input"]["size"] = [64, 48]
    model = write_map_model(tmp_path / "small.onnx", small)
    (tmp_path / "pictures").mkdir()
    for name, side in (("a", 1), ("b", 3)):
        seen = np.random.default_rng(side).integers(0, 256, (48 * side, 64 * side, 3), np.uint8)
        Image.fromarray(seen).save(tmp_path / "pictures" / f"{name}.png")
    done = detect(tmp_path / "pictures", "--model", model, "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    told = [one for one in json.loads(done.stdout)["warnings"] if "shrunk" in one]
    assert len(told) == 1 and "is shown pictures of 192 x 144 pixels shrunk to 64 x 48:" in told[0]


def test_the_command_that_fuses_what_was_detected_is_told(model: Path, tmp_path: Path) -> None:
    output = tmp_path / "seen once.mcap"
    done = detect(DEMO, "--model", model, "-o", output, "--every", 30)
    assert done.returncode == 0, done.stderr
    program, *arguments, more = shlex.split(done.stdout.split(" next ")[1])
    assert program == "crowdfence" and str(output) in arguments and more == "..."
    done = crowdfence(*arguments, "-o", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["detector"]["heatmaps"] == "recorded"


def test_the_overlay_marks_the_crowd_and_leaves_the_rest_alone() -> None:
    grey = np.full((48, 64, 3), 120, np.uint8)
    heatmap = np.zeros((12, 16), np.float32)
    assert (overlay(grey, heatmap) == grey).all()
    heatmap[4:8, 6:10] = 1.0
    marked = overlay(grey, heatmap)
    changed = (marked != grey).any(axis=-1)
    assert changed[16:32, 24:40].all()
    # A cell's value reaches half a cell beyond it, and the black rim one pixel more.
    assert not changed[:13].any() and not changed[35:].any() and not changed[:, :21].any()
    rim = (marked == 255).all(axis=-1)
    assert rim.any() and (marked[rim.any(axis=1).argmax() - 1, 32] == 0).all()
    assert (overlay(grey, (heatmap * 255).astype(np.uint8)) == marked).all()
    # Exactly the threshold is not above it, so there is no outline.
    assert not (overlay(grey, np.full((12, 16), 0.5)) == 255).all(axis=-1).any()


@pytest.mark.parametrize(
    ("image", "heatmap", "message"),
    [
        (np.zeros((4, 4), np.uint8), np.zeros((1, 1)), "image must be uint8 [H, W, 3]"),
        (np.zeros((4, 4, 3), np.uint8), np.full((2, 2), np.nan), "heatmap value nan at row 0"),
        (np.zeros((4, 4, 3), np.uint8), np.full((2, 2), 1.5), "heatmap value 1.5"),
        (np.zeros((4, 4, 3), np.uint8), np.zeros((0, 2)), "at least one cell"),
    ],
)
def test_an_overlay_of_something_else_is_refused(image: object, heatmap: object, message: str) -> None:
    with pytest.raises(ValueError) as caught:
        overlay(image, heatmap)
    assert message in str(caught.value)


def test_a_video_that_fails_half_way_is_not_left_behind(tmp_path: Path) -> None:
    def fail() -> None:
        with VideoWriter(tmp_path / "film.mp4") as film:
            film.write(picture(3), 0.0)
            raise RuntimeError("stop")

    with pytest.raises(RuntimeError, match="stop"):
        fail()
    assert list(tmp_path.iterdir()) == []
