"""Pictures that show nothing, and pictures that show little."""

import io
from pathlib import Path

import numpy as np
import pytest
from PIL import Image, ImageDraw

import crowdfence
from crowdfence.detector.blank_picture import blank_reason

BLACK, WHITE, GREY, NO_SIGNAL = (0, 0, 0), (255, 255, 255), (128, 128, 128), (0, 0, 255)
DEMO = Path(crowdfence.__file__).parent / "demo_data" / "race.mcap"


def plain(tone: tuple[int, int, int], width: int = 640, height: int = 480) -> np.ndarray:
    return np.full((height, width, 3), tone, np.uint8)


def noisy(picture: np.ndarray, deviation: float) -> np.ndarray:
    noise = np.random.default_rng(1).normal(0.0, deviation, picture.shape)
    return np.clip(np.rint(picture + noise), 0, 255).astype(np.uint8)


def compressed(picture: np.ndarray, quality: int) -> np.ndarray:
    file = io.BytesIO()
    Image.fromarray(picture).save(file, "JPEG", quality=quality)
    return np.asarray(Image.open(file).convert("RGB"))


def dimmed(picture: np.ndarray, share: float) -> np.ndarray:
    return np.rint(picture * share).astype(np.uint8)


def paled(picture: np.ndarray, share: float) -> np.ndarray:
    """As through fog: that share of the contrast, the rest is light."""
    return np.rint(255 - (255 - picture.astype(np.float64)) * share).astype(np.uint8)


@pytest.mark.parametrize("size", [(640, 480), (320, 240), (3840, 2160), (48, 64), (16, 12), (3, 2), (1, 1)])
@pytest.mark.parametrize("tone", [BLACK, WHITE, GREY, NO_SIGNAL])
def test_one_tone_is_nothing(tone: tuple[int, int, int], size: tuple[int, int]) -> None:
    reason = blank_reason(plain(tone, *size))
    red, green, blue = tone
    assert reason is not None and f"(red {red}, green {green}, blue {blue})" in reason


@pytest.mark.parametrize("tone", [BLACK, WHITE, (16, 16, 16), GREY, NO_SIGNAL])
def test_noise_is_nothing_too(tone: tuple[int, int, int]) -> None:
    for size in ((640, 480), (320, 240)):
        assert blank_reason(noisy(plain(tone, *size), 4.0))
        assert blank_reason(compressed(noisy(plain(tone, *size), 4.0), 80))
        assert blank_reason(compressed(noisy(plain(tone, *size), 4.0), 30))


def test_date_and_words_over_lost_video_are_nothing() -> None:
    image = Image.fromarray(plain(BLACK))
    pen = ImageDraw.Draw(image)
    pen.text((10, 10), "2026-01-01 00:00:00  CAM 1", fill="white", font_size=20)
    pen.text((220, 220), "NO SIGNAL", fill="white", font_size=40)
    assert blank_reason(np.asarray(image))
    assert blank_reason(compressed(np.asarray(image), 50))


def test_the_pictures_of_a_flight_show_something_by_night_and_in_fog() -> None:
    for frame in crowdfence.open_recording(DEMO).frames[::8]:
        image = frame.image()
        assert blank_reason(image) is None
        assert blank_reason(dimmed(image, 0.1)) is None
        assert blank_reason(paled(image, 0.1)) is None


def test_a_small_crowd_on_overexposed_snow_is_seen() -> None:
    """A twentieth of the picture is not white."""
    snow = plain(WHITE)
    snow[200:280, 260:460] = np.random.default_rng(2).integers(0, 200, (20, 50, 3)).repeat(4, 0).repeat(4, 1)
    assert blank_reason(snow) is None


def test_ground_of_one_colour_has_texture() -> None:
    """Grass, snow, water: patches of some 8 pixels that differ by a standard deviation of 5 levels."""
    patches = np.random.default_rng(3).normal(0.0, 5.0, (60, 80)).repeat(8, 0).repeat(8, 1)
    for tone in ((60, 90, 40), (225, 228, 230), (30, 60, 80)):
        lawn = np.clip(np.array(tone) + patches[..., None], 0, 255).astype(np.uint8)
        assert blank_reason(lawn) is None


def test_a_colour_alone_tells_pictures_apart() -> None:
    """Two fields that are equally bright in green and blue."""
    fields = plain((100, 100, 100))
    fields[:, 320:, 0] = 120
    assert blank_reason(fields) is None
