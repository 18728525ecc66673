"""Pictures of nothing: textures of many families and of any scale and colour, in which nobody stands.

What a detector that was trained on renderings calls crowd in the real world is texture of the size, contrast
and colours of people: autumn trees, roofs, flower beds, facades, printed text, tyre marks. No renderer holds
all of them; simple processes hold their statistics. Dead leaves and noise with the spectrum of natural
pictures teach networks much of what photographs do (Baradad et al., 2021).
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFilter, ImageFont

Picture = NDArray[np.uint8]
"""[H, W, 3] RGB."""
Colours = NDArray[np.float64]
"""[K, 3] in [0, 1]."""


def texture(rng: np.random.Generator, width: int, height: int) -> Picture:
    """A picture of one family, or two of which one lies in patches upon the other."""
    one = _of_a_family(rng, width, height)
    if rng.random() < 0.6:
        return one
    other = _of_a_family(rng, width, height)
    field = _noise(rng, width, height, rng.uniform(1.6, 2.6))
    share = _step(field, rng.uniform(-0.8, 0.8), rng.uniform(8, 60))
    return _as_picture(one / 255.0 * (1.0 - share[..., None]) + other / 255.0 * share[..., None])


def _of_a_family(rng: np.random.Generator, width: int, height: int) -> Picture:
    family: Callable[[np.random.Generator, int, int], Picture] = FAMILIES[int(rng.integers(len(FAMILIES)))]
    picture = family(rng, width, height)
    if rng.random() < 0.5:
        light = np.exp(0.35 * _noise(rng, width, height, rng.uniform(1.5, 2.5)))
        picture = _as_picture(picture / 255.0 * light[..., None])
    return picture


def palette(rng: np.random.Generator, count: int) -> Colours:
    """Colours that go together: near a few hues, dull or bright, like the things of one place."""
    hues = rng.choice(rng.random(int(rng.integers(1, 5))), count) + rng.normal(0.0, 0.03, count)
    saturation = np.clip(rng.normal(rng.uniform(0.05, 0.7), 0.15, count), 0.0, 1.0)
    value = np.clip(rng.normal(rng.uniform(0.25, 0.8), rng.uniform(0.05, 0.3), count), 0.02, 1.0)
    sector = (hues[:, None] * 6.0 + np.array([0.0, 4.0, 2.0])) % 6.0
    pure = np.clip(np.abs(sector - 3.0) - 1.0, 0.0, 1.0)
    return value[:, None] * (1.0 - saturation[:, None] * (1.0 - pure))


def _noise(rng: np.random.Generator, width: int, height: int, slope: float) -> NDArray[np.float64]:
    """[H, W] of mean 0 and deviation 1, whose amplitudes fall like frequency to the power of -slope / 2."""
    rows, columns = np.fft.fftfreq(height)[:, None], np.fft.rfftfreq(width)[None, :]
    stretch = math.exp(rng.normal(0.0, 0.3))
    frequency = np.hypot(rows * stretch, columns / stretch)
    frequency[0, 0] = np.inf
    spectrum = np.fft.rfft2(rng.standard_normal((height, width))) * frequency ** (-slope / 2.0)
    field = np.fft.irfft2(spectrum, (height, width))
    return np.asarray(field / field.std())


def _step(field: NDArray[np.float64], at: float, steepness: float) -> NDArray[np.float64]:
    return np.asarray(1.0 / (1.0 + np.exp(np.clip(-steepness * (field - at), -50.0, 50.0))))


def _as_picture(values: NDArray[np.float64]) -> Picture:
    return np.asarray(np.rint(np.clip(values, 0.0, 1.0) * 255.0), np.uint8)


def _ink(colour: NDArray[np.float64], factor: float = 1.0) -> tuple[int, int, int]:
    red, green, blue = (int(value) for value in np.clip(colour * factor, 0.0, 1.0) * 255.0)
    return red, green, blue


def _direction(rng: np.random.Generator) -> NDArray[np.float64]:
    turn = rng.uniform(0.0, 2.0 * math.pi)
    return np.array([math.cos(turn), math.sin(turn)])


def _sizes(rng: np.random.Generator, count: int, smallest: float, largest: float) -> NDArray[np.float64]:
    """Radii with density r^-power, the law of dead leaves; power 3 looks the same at every scale."""
    power = rng.uniform(1.5, 4.0)
    low, high = smallest ** (1.0 - power), largest ** (1.0 - power)
    return np.asarray((low + rng.random(count) * (high - low)) ** (1.0 / (1.0 - power)))


def _canvas(rng: np.random.Generator, width: int, height: int) -> tuple[Image.Image, ImageDraw.ImageDraw]:
    """Ground in two shades, to draw on."""
    dark, light = palette(rng, 2)
    share = _step(_noise(rng, width, height, rng.uniform(0.5, 2.5)), 0.0, rng.uniform(0.5, 3.0))[..., None]
    ground = Image.fromarray(_as_picture(dark * (1.0 - share) + light * share))
    return ground, ImageDraw.Draw(ground)


def coloured_noise(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Three fields whose colours hang together: grass, soil, asphalt, water."""
    slope = rng.uniform(0.3, 2.4)
    fields = np.stack([_noise(rng, width, height, slope) for _ in range(3)], axis=-1)
    fields *= np.array([1.0, rng.uniform(0.1, 0.5), rng.uniform(0.05, 0.3)])
    opponent = np.array([[1.0, 1.0, 1.0], [1.0, 0.0, -2.0], [1.0, -1.0, 1.0]])
    axes = np.linalg.qr(opponent + rng.normal(0.0, 0.3, (3, 3)))[0]
    return _as_picture(palette(rng, 1) + rng.uniform(0.05, 0.25) * fields @ axes.T)


def dead_leaves(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Discs, boxes and shards that hide one another, of sizes from a pixel to a third of the picture."""
    ground, draw = _canvas(rng, width, height)
    largest = rng.uniform(6.0, height / 3.0)
    radii = _sizes(rng, int(rng.integers(400, 2500)), rng.uniform(1.0, 3.0), largest)
    if rng.random() < 0.5:
        radii = np.sort(radii)[::-1]
    colours, corners = palette(rng, len(radii)), int(rng.choice([0, 3, 4, 5, 7]))
    middles = rng.uniform((0.0, 0.0), (width, height), (len(radii), 2))
    for middle, radius, colour in zip(middles, radii, colours, strict=True):
        if corners == 0:
            _ellipse(draw, middle, radius, radius * rng.uniform(0.4, 1.0), _ink(colour))
        else:
            angle = np.sort(rng.uniform(0.0, 2 * math.pi, corners))
            shard = middle + radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
            draw.polygon([tuple(point) for point in shard], fill=_ink(colour))
    return np.asarray(ground)


def _ellipse(
    draw: ImageDraw.ImageDraw,
    middle: NDArray[np.float64],
    across: float,
    along: float,
    ink: tuple[int, int, int],
) -> None:
    x, y = (float(value) for value in middle)
    draw.ellipse((x - across, y - along, x + across, y + along), fill=ink)


def foliage(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Clumps of small leaves, bright above, dark below: trees of any season, hedges, bushes, flower beds."""
    ground, draw = _canvas(rng, width, height)
    leaf, colours = rng.uniform(1.0, 5.0), palette(rng, 12)
    radii = _sizes(rng, int(rng.integers(8, 60)), 8.0, rng.uniform(16.0, height / 2.5))
    middles = rng.uniform((0.0, 0.0), (width, height), (len(radii), 2))
    order = np.argsort(middles[:, 1], kind="stable")  # what stands lower hides what stands behind
    for middle, radius in zip(middles[order].tolist(), radii[order].tolist(), strict=True):
        own = colours[rng.integers(len(colours))]
        leaves = int(min(500.0, 5.0 * (radius / leaf) ** 2 + 10.0))
        angle, away = rng.uniform(0.0, 2 * math.pi, leaves), radius * np.sqrt(rng.random(leaves))
        x, y = middle[0] + away * np.cos(angle), middle[1] + away * np.sin(angle)
        shade = (1.0 - 0.45 * (y - middle[1]) / radius) * np.exp(rng.normal(0.0, 0.3, leaves))
        for place in zip(x, y, shade, strict=True):
            size = leaf * rng.uniform(0.5, 1.6)
            _ellipse(draw, np.array(place[:2]), size, size * rng.uniform(0.5, 1.0), _ink(own, place[2]))
    return np.asarray(ground)


def dots(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Many small things of a few colours on one ground, alone, in rows or in clouds: flowers, fruit, litter,
    gravel, buoys, with a shadow to one side."""
    ground, draw = _canvas(rng, width, height)
    radius, colours = rng.uniform(1.0, 7.0), palette(rng, int(rng.integers(1, 8)))
    count = int(np.clip(rng.uniform(0.05, 0.7) * width * height / (math.pi * radius**2), 30, 3000))
    if rng.random() < 0.4:
        apart = radius * rng.uniform(2.2, 6.0)
        x, y = (axis.ravel() for axis in np.meshgrid(np.arange(0, width, apart), np.arange(0, height, apart)))
        places = np.stack([x, y], axis=-1) + rng.normal(0.0, rng.uniform(0.0, 0.4) * apart, (x.size, 2))
    else:
        places = rng.uniform((0.0, 0.0), (width, height), (count, 2))
    if rng.random() < 0.5:
        cloud = _noise(rng, width, height, 2.2)
        inside = np.clip(places, 0.0, [width - 1.0, height - 1.0]).astype(np.intp)
        places = places[cloud[inside[:, 1], inside[:, 0]] > rng.uniform(-0.5, 1.0)]
    shadow = radius * rng.uniform(0.0, 1.5) * _direction(rng)
    for place in places[:4000]:
        size, colour = radius * rng.uniform(0.7, 1.3), colours[rng.integers(len(colours))]
        _ellipse(draw, place + shadow, size, size, _ink(colours[0], 0.25))
        _ellipse(draw, place, size, size * rng.uniform(0.6, 1.0), _ink(colour, rng.uniform(0.7, 1.2)))
    return np.asarray(ground)


def tiles(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Rows of tiles, bricks, cobbles, seats or parked cars: turned, each a little different, with joints."""
    side = 2 * max(width, height)
    ground, draw = _canvas(rng, side, side)
    across = math.exp(rng.uniform(math.log(4.0), math.log(40.0)))
    along, joint = across * rng.uniform(0.35, 1.6), rng.uniform(0.05, 0.5)
    colours, shift, spread = palette(rng, 6), rng.choice([0.0, 0.5]), rng.uniform(0.02, 0.35)
    missing = rng.choice([0.0, 0.0, 0.3, 0.6])
    for row in range(int(side / along) + 1):
        for column in range(int(side / across) + 1):
            if rng.random() < missing:
                continue
            x, y = (column + shift * (row % 2)) * across, row * along
            ink = _ink(colours[rng.integers(len(colours))], math.exp(rng.normal(0.0, spread)))
            draw.rectangle((x, y, x + across * (1.0 - joint), y + along * (1.0 - joint)), fill=ink)
    return _seen_aslant(ground, rng, width, height)


def facade(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Windows, doors and balconies on walls."""
    side = 2 * max(width, height)
    ground, draw = _canvas(rng, side, side)
    apart = math.exp(rng.uniform(math.log(8.0), math.log(60.0)))
    storey, frame = apart * rng.uniform(0.8, 1.8), palette(rng, 3)
    wide, tall = rng.uniform(0.25, 0.7), rng.uniform(0.3, 0.75)
    for row in range(int(side / storey) + 1):
        for column in range(int(side / apart) + 1):
            x, y = (column + 0.1) * apart, (row + 0.1) * storey
            box = (x, y, x + wide * apart, y + tall * storey)
            draw.rectangle(box, fill=_ink(frame[0], rng.uniform(0.6, 1.4)))
            inner = 0.06 * apart
            pane = _ink(frame[1], rng.uniform(0.2, 1.3))
            draw.rectangle((box[0] + inner, box[1] + inner, box[2] - inner, box[3] - inner), fill=pane)
            if rng.random() < 0.3:
                draw.rectangle((box[0], box[3], box[2], box[3] + 0.12 * storey), fill=_ink(frame[2]))
    return _seen_aslant(ground, rng, width, height)


def bars(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Parallel lines, crossed or not, even or broken: fields, pergolas, fences, wheel tracks, stairs."""
    side = 2 * max(width, height)
    ground, draw = _canvas(rng, side, side)
    for _ in range(int(rng.integers(1, 4))):
        apart, ink = math.exp(rng.uniform(math.log(3.0), math.log(50.0))), _ink(palette(rng, 1)[0])
        thick, broken, upright = apart * rng.uniform(0.1, 0.6), rng.random() < 0.4, rng.random() < 0.5
        for line in np.arange(0.0, side, apart):
            start = rng.uniform(0.0, side / 2) if broken else 0.0
            end = rng.uniform(start, side) if broken else side
            line += rng.normal(0.0, 0.1) * apart
            box = (start, line, end, line + thick)
            draw.rectangle((box[1], box[0], box[3], box[2]) if upright else box, fill=ink)
    return _seen_aslant(ground, rng, width, height)


def text(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Lines of letters and figures, printed and painted."""
    side = 2 * max(width, height)
    ground, draw = _canvas(rng, side, side)
    size = math.exp(rng.uniform(math.log(7.0), math.log(60.0)))
    font, colours = ImageFont.load_default(size), palette(rng, 3)
    signs = np.array(list("ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789     .,:-+/"))
    for line in np.arange(0.0, side, size * rng.uniform(1.0, 2.2)):
        written = "".join(rng.choice(signs, int(side / size * 2.0)))
        ink = _ink(colours[rng.integers(len(colours))], rng.choice([0.2, 1.0, 1.6]))
        draw.text((rng.uniform(-size, size), line), written, fill=ink, font=font)
    return _seen_aslant(ground, rng, width, height)


def market(rng: np.random.Generator, width: int, height: int) -> Picture:
    """Upright things of the size and the colours of people, with shadows: crates, bins, sacks, sunshades,
    chairs, parked bicycles. No heads, no limbs, and never round above and narrow below."""
    ground, draw = _canvas(rng, width, height)
    tall = math.exp(rng.uniform(math.log(5.0), math.log(50.0)))
    count = int(np.clip(rng.uniform(0.1, 0.6) * width * height / tall**2, 10, 1200))
    colours = np.concatenate([palette(rng, 10), rng.random((6, 3))])
    cast = tall * rng.uniform(0.2, 1.5) * _direction(rng)
    feet = rng.uniform((0.0, 0.0), (width, height), (count, 2))
    for x, y in feet[np.argsort(feet[:, 1])].tolist():
        high, wide = tall * rng.uniform(0.4, 1.4), tall * rng.uniform(0.3, 1.6)
        box = (x - wide / 2, y - high, x + wide / 2, y)
        ink = _ink(colours[rng.integers(len(colours))], rng.uniform(0.5, 1.2))
        lid = _ink(np.array(ink) / 255.0, rng.uniform(1.1, 1.6))
        fallen = [(box[0], y), (box[2], y), (box[2] + cast[0], y + cast[1]), (box[0] + cast[0], y + cast[1])]
        draw.polygon(fallen, fill=_ink(np.asarray(ground.getpixel((0, 0))) / 255.0, 0.35))
        kind = rng.integers(3)
        if kind == 0:
            draw.rectangle(box, fill=ink)
            draw.rectangle((box[0], box[1], box[2], box[1] + 0.3 * high), fill=lid)
        elif kind == 1:
            eaves = box[1] + 0.4 * high
            draw.polygon([(box[0], eaves), (x, box[1]), (box[2], eaves)], fill=lid)
            draw.line((x, box[1], x, y), fill=ink, width=max(1, int(0.06 * tall)))
        else:
            draw.line((box[0], y, box[2], box[1]), fill=ink, width=max(1, int(0.12 * tall)))
            draw.line((box[0], box[1], box[2], y), fill=lid, width=max(1, int(0.12 * tall)))
    return np.asarray(ground)


def _seen_aslant(flat: Image.Image, rng: np.random.Generator, width: int, height: int) -> Picture:
    """A flat pattern turned and seen from the side: a part of it [height, width]."""
    side = flat.size[0]
    if rng.random() < 0.3:
        flat = flat.filter(ImageFilter.GaussianBlur(rng.uniform(0.3, 1.2)))
    turn, tilt = rng.normal(0.0, 0.5) + rng.choice([0.0, 0.0, math.pi / 2]), rng.uniform(0.0, 0.7)
    cosine, sine = math.cos(turn), math.sin(turn)
    far = rng.uniform(0.0, 0.6) * rng.uniform(-1.0, 1.0) / height
    # Coordinates of the pattern, about its middle, from those of the picture, about the picture's.
    aslant = 1.0 + tilt
    plane = np.array([[cosine, -sine * aslant, 0.0], [sine, cosine * aslant, 0.0], [0.0, far, 1.0]])
    to_middle = np.array([[1.0, 0.0, -width / 2], [0.0, 1.0, -height / 2], [0.0, 0.0, 1.0]])
    from_middle = np.array([[1.0, 0.0, side / 2], [0.0, 1.0, side / 2], [0.0, 0.0, 1.0]])
    matrix = from_middle @ plane @ to_middle
    seen = flat.transform(
        (width, height),
        Image.Transform.PERSPECTIVE,
        tuple((matrix / matrix[2, 2]).ravel()[:8]),
        Image.Resampling.BICUBIC,
    )
    return np.asarray(seen)


FAMILIES = (coloured_noise, dead_leaves, foliage, foliage, dots, tiles, facade, bars, text, market)
