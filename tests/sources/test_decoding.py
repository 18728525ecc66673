"""Pictures that must not be taken for what they do not show: too deep, damaged, turned."""

from __future__ import annotations

import io
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import rasterio
from numpy.typing import NDArray
from PIL import EpsImagePlugin, ExifTags, Image

from crowdfence.sources.pictures.decoding import as_png, decode_rgb, read_heatmap, read_regions, read_rgb
from crowdfence.sources.ros_bag.picture import image_pixels

SIZE = (160, 120)


def scene() -> NDArray[np.uint8]:
    """Something with detail everywhere, so that lost bytes cost pixels: [120, 160, 3]."""
    rows, columns = np.mgrid[:120, :160]
    waves = np.stack([np.sin(columns / (3 + n)) * np.cos(rows / (5 + n)) for n in range(3)], axis=-1)
    noise = np.random.default_rng(5).normal(0, 20, waves.shape)
    return np.clip(128 + 90 * waves + noise, 0, 255).astype(np.uint8)


def encoded(kind: str, mode: str = "RGB", **options: Any) -> bytes:
    file = io.BytesIO()
    Image.fromarray(scene()).convert(mode).save(file, kind, **options)
    return file.getvalue()


@pytest.mark.parametrize("kind", ["PNG", "TIFF", "PPM"])
def test_grey_in_sixteen_bits_is_refused_and_not_clipped_to_two_tones(tmp_path: Path, kind: str) -> None:
    file = io.BytesIO()
    Image.fromarray(np.linspace(0, 65535, 64, dtype=np.uint16).reshape(8, 8)).save(file, kind)
    with pytest.raises(ValueError, match="picture has mode I.*: save it with 8 bits a channel"):
        decode_rgb(file.getvalue(), (8, 8))
    path = tmp_path / "deep.png"
    path.write_bytes(file.getvalue())
    with pytest.raises(ValueError, match="deep.png has mode I.*: save it with 8 bits a channel"):
        read_rgb(path)


@pytest.mark.filterwarnings("ignore::rasterio.errors.NotGeoreferencedWarning")
@pytest.mark.parametrize(
    ("driver", "made"), [("PNG", {}), ("GTiff", {"interleave": "pixel", "photometric": "RGB"})]
)
@pytest.mark.parametrize("bands", [3, 4])
def test_colours_in_sixteen_bits_are_refused_and_not_cut_to_their_upper_eight(
    tmp_path: Path, driver: str, made: dict[str, str], bands: int
) -> None:
    """White of a camera of 12 bits, 4095 of 65535, was shown to detectors as black, 15 of 255."""
    path = tmp_path / "deep.png"
    with rasterio.open(path, "w", driver, 8, 8, bands, dtype="uint16", **made) as file:
        file.write(np.full((bands, 8, 8), 4095, np.uint16))
    with pytest.raises(ValueError, match="picture has 16 bits a channel: save it with 8 bits a channel"):
        decode_rgb(path.read_bytes(), (8, 8))
    with pytest.raises(ValueError, match="deep.png has 16 bits a channel: save it with 8 bits a channel"):
        read_rgb(path)


def test_sixteen_bits_in_a_bag_are_not_sent_into_the_same_trap() -> None:
    """Compressed as they are, they would still be too deep."""
    message = SimpleNamespace(encoding="mono16", height=8, width=8, step=16, data=bytes(128))
    with pytest.raises(ValueError, match="'mono16' are not supported.*with 8 bits a channel"):
        image_pixels(message)


def test_a_picture_that_is_a_program_is_not_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Encapsulated PostScript, as a picture of a drone or called so in a folder: Pillow gives it to
    Ghostscript."""
    ran: list[object] = []
    monkeypatch.setattr(EpsImagePlugin, "Ghostscript", lambda *what, **more: ran.append(what))
    path = tmp_path / "picture.png"
    path.write_bytes(encoded("EPS"))
    for read in (lambda: decode_rgb(path.read_bytes(), SIZE), lambda: read_rgb(path)):
        with pytest.raises(ValueError, match="is damaged: it is no picture that can be read"):
            read()
    assert not ran


@pytest.mark.parametrize("kind", ["BMP", "GIF", "JPEG", "PNG", "PPM", "TIFF", "WEBP"])
def test_pictures_of_other_kinds_are_read(kind: str) -> None:
    assert decode_rgb(encoded(kind), SIZE).shape == (120, 160, 3)


INTACT = {
    "baseline": encoded("JPEG", quality=92),
    "no subsampling": encoded("JPEG", quality=95, subsampling=0),
    "progressive": encoded("JPEG", quality=92, progressive=True),
    "grey": encoded("JPEG", "L"),
    "cmyk": encoded("JPEG", "CMYK"),
    "subsampled cmyk": encoded("JPEG", "CMYK", subsampling=1),
    "restart markers": encoded("JPEG", restart_marker_blocks=4),
    "with a preview behind it": encoded(
        "MPO", save_all=True, append_images=[Image.fromarray(scene()).resize((40, 30))]
    ),
    "with a cut-off preview": encoded("JPEG") + encoded("JPEG")[:500],
    "with a rest of a buffer": encoded("JPEG") + bytes(3000),
    "filled up before its end": encoded("JPEG")[:-2] + b"\0\0\xff\xff\xd9",
}


@pytest.mark.parametrize("kind", INTACT)
def test_intact_jpegs_of_all_kinds_are_read(kind: str) -> None:
    picture = decode_rgb(INTACT[kind], SIZE)
    assert picture.shape == (120, 160, 3)
    if "grey" not in kind and "cmyk" not in kind:
        assert np.abs(picture.astype(float) - scene()).mean() < 20


def cut(data: bytes) -> bytes:
    """As an encoder leaves it whose buffer was full."""
    return data[: len(data) // 2] + b"\xff\xd9"


def zeroed(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes(1000) + data[middle + 1000 :]


def lost(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + data[middle + 1500 :]


@pytest.mark.parametrize("kind", ["baseline", "progressive", "grey", "cmyk", "restart markers"])
@pytest.mark.parametrize("harm", [cut, zeroed, lost])
def test_a_jpeg_that_the_decoder_would_patch_up_is_refused(tmp_path: Path, kind: str, harm: Any) -> None:
    data = harm(INTACT[kind])
    Image.open(io.BytesIO(data)).load()  # nothing is wrong, says the decoder
    with pytest.raises(ValueError, match="picture is damaged: its pixels do not decode to the end"):
        decode_rgb(data, SIZE)
    path = tmp_path / "a.jpg"
    path.write_bytes(data)
    with pytest.raises(ValueError, match="a.jpg is damaged: its pixels do not decode to the end"):
        read_rgb(path)


def test_without_ffmpeg_only_a_jpeg_that_stops_is_known_to_be_damaged(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As docs/recordings.md says; intact ones are read all the same."""
    for name in ("av", "av.error"):
        monkeypatch.setitem(sys.modules, name, None)
    assert decode_rgb(INTACT["baseline"], SIZE).shape == (120, 160, 3)
    assert decode_rgb(zeroed(INTACT["baseline"]), SIZE).shape == (120, 160, 3)
    with pytest.raises(ValueError, match="picture is damaged: "):
        decode_rgb(INTACT["baseline"][: len(INTACT["baseline"]) // 2], SIZE)


def turned(orientation: int, kind: str = "PNG") -> bytes:
    """A picture whose upper left corner is white, with the tag."""
    stored = np.zeros((4, 6, 3), np.uint8)
    stored[0, 0] = 255
    exif, file = Image.Exif(), io.BytesIO()
    exif[ExifTags.Base.Orientation] = orientation
    Image.fromarray(stored).save(file, kind, exif=exif)
    return file.getvalue()


# The first stored row is shown at, the first stored column is shown at (EXIF 2.3, Orientation).
@pytest.mark.parametrize(
    ("orientation", "row", "column"),
    [
        (1, "top", "left"),
        (2, "top", "right"),
        (3, "bottom", "right"),
        (4, "bottom", "left"),
        (5, "left", "top"),
        (6, "right", "top"),
        (7, "right", "bottom"),
        (8, "left", "bottom"),
    ],
)
@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
def test_a_picture_without_a_pose_comes_upright(
    tmp_path: Path, kind: str, orientation: int, row: str, column: str
) -> None:
    path = tmp_path / "a.png"
    path.write_bytes(turned(orientation, kind))
    picture = read_rgb(path)
    assert picture.shape == ((4, 6, 3) if orientation < 5 else (6, 4, 3))
    sides = {row, column}
    corner = (-1 if "bottom" in sides else 0, -1 if "right" in sides else 0)
    assert picture[corner].tolist() == [255, 255, 255] and picture.sum() == 3 * 255


@pytest.mark.parametrize("kind", ["PNG", "TIFF"])
def test_a_picture_with_a_pose_must_not_ask_to_be_turned(kind: str) -> None:
    """A TIFF is turned by whoever decodes it: of Orientation 3 its crowd would stand in the corner across."""
    assert decode_rgb(turned(1, kind), (6, 4))[0, 0, 0] == 255
    for orientation in range(2, 9):
        refused = f"EXIF Orientation {orientation}.*save it with Orientation 1"
        with pytest.raises(ValueError, match=refused):
            decode_rgb(turned(orientation, kind), (6, 4))
        with pytest.raises(ValueError, match=refused):
            as_png(turned(orientation, kind))  # whose bytes would not say it


def test_a_heatmap_must_not_ask_to_be_turned(tmp_path: Path) -> None:
    path = tmp_path / "a.tif"
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 3
    Image.fromarray(np.array([[255, 0, 0]], np.uint8)).save(path, exif=exif)
    with pytest.raises(ValueError, match=r"a.tif is stored turned \(EXIF Orientation 3\)"):
        read_heatmap(path, (6, 4))


def test_a_panorama_that_is_too_large_is_not_called_damaged(tmp_path: Path) -> None:
    path = tmp_path / "panorama.png"
    Image.new("1", (16_000, 12_000)).save(path)
    with pytest.raises(ValueError, match=r"^panorama.png has more than 178,956,970 pixels: cut it into sev"):
        read_rgb(path)


@pytest.mark.parametrize("told", [0, 9, 77])
def test_a_turn_that_does_not_exist_is_none(told: int) -> None:
    assert decode_rgb(turned(told), (6, 4))[0, 0, 0] == 255


@pytest.mark.parametrize("mode", ["RGBA", "LA", "P", "RGB"])
def test_a_posed_picture_that_is_transparent_anywhere_is_refused(mode: str) -> None:
    """What nobody saw became black, which is ground without people. An alpha that hides nothing is none."""
    opaque = Image.new("RGBA", (8, 6), (200, 10, 10, 255))
    holed = opaque.copy()
    holed.putpixel((7, 5), (0, 0, 0, 254))
    more: dict[str, object] = {}
    if mode == "P":  # with a colour of its palette that is transparent
        opaque, holed = (Image.new("P", (8, 6), colour) for colour in (1, 0))
        more = {"transparency": 0}
    elif mode == "RGB":
        opaque, holed = (Image.new("RGB", (8, 6), colour) for colour in ((9, 9, 9), (1, 2, 3)))
        more = {"transparency": (1, 2, 3)}
    else:
        opaque, holed = opaque.convert(mode), holed.convert(mode)

    def as_file(picture: Image.Image) -> bytes:
        file = io.BytesIO()
        picture.save(file, format="PNG", **more)
        return file.getvalue()

    assert decode_rgb(as_file(opaque), (8, 6)).shape == (6, 8, 3)
    with pytest.raises(ValueError, match="picture is transparent in places, where nobody sees anything"):
        decode_rgb(as_file(holed), (8, 6))


@pytest.mark.parametrize("white_first", [True, False])
def test_a_label_whose_palette_begins_with_white_is_not_taken_for_its_reverse(
    tmp_path: Path, white_first: bool
) -> None:
    """A white crowd of 20 x 30 pixels before black: its numbers are 0, and those of all else 1."""
    crowd = np.zeros((120, 160), np.bool_)
    crowd[10:30, 10:40] = True
    picture = Image.fromarray((crowd != white_first).astype(np.uint8), "P")
    picture.putpalette([255, 255, 255, 0, 0, 0] if white_first else [0, 0, 0, 255, 255, 255])
    picture.save(tmp_path / "label.png")
    if white_first:
        with pytest.raises(ValueError, match=r"label.png has a palette in which black is 1, a crowd, and 0"):
            read_regions(tmp_path / "label.png", SIZE)
    else:
        assert np.count_nonzero(read_regions(tmp_path / "label.png", SIZE)) == 600
