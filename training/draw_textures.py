"""Draws the pictures of nothing that the detector is trained on: `python draw_textures.py OUT [--count N]`.

Textures of `detector_training.textures` with a COCO file that annotates nobody, so that
`crowdfence train --data OUT` takes them like any folder of labelled pictures. What is there is left alone.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from crowdfence.detector_training.textures import texture
from crowdfence.labelled_pictures.annotated_picture import AnnotatedPicture
from crowdfence.labelled_pictures.coco import ANNOTATIONS, write_coco

COUNT = 700
WIDTH, HEIGHT = 480, 352
SEED = 7


def draw(out: Path, number: int) -> Path:
    """The texture of a number: a function of it and of the seed."""
    path = out / f"texture-{number:04d}.png"
    if not path.exists():
        part = path.with_suffix(".part")
        drawn = texture(np.random.default_rng([SEED, number]), WIDTH, HEIGHT)
        Image.fromarray(drawn).save(part, format="PNG", compress_level=1)
        part.replace(path)
    return path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=COUNT)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    paths = [draw(given.out, number) for number in range(given.count)]
    nobody = np.zeros((0, 4))
    pictures = [AnnotatedPicture(path, WIDTH, HEIGHT, nobody) for path in paths]
    write_coco(pictures, given.out / ANNOTATIONS)


if __name__ == "__main__":
    sys.exit(main())
