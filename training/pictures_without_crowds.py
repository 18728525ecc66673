"""Photographs without crowds, to train on: `python pictures_without_crowds.py PICTURES OUT`.

Links the pictures of a folder into OUT, with a COCO file that annotates nobody, so that `crowdfence train
--data OUT` takes them like any folder of labelled pictures. Leave out what the network shall be judged on:
whole flights, since two pictures of one flight show the same trees.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from PIL import Image

from crowdfence.labelled_pictures.annotated_picture import AnnotatedPicture
from crowdfence.labelled_pictures.coco import ANNOTATIONS, write_coco

NOBODY = np.zeros((0, 4))


def linked(path: Path, out: Path) -> AnnotatedPicture:
    """A picture under its own name in `out`, where nobody is annotated."""
    link = out / path.name
    if not link.exists():
        link.symlink_to(path.resolve())
    with Image.open(link) as image:
        width, height = image.size
    return AnnotatedPicture(link, width, height, NOBODY)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("pictures", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", default="", help="take those alone whose name contains this text")
    parser.add_argument(
        "--leave-out", action="append", default=[], metavar="TEXT", help="... and not this; repeat"
    )
    given = parser.parse_args()
    taken = [
        path
        for path in sorted(given.pictures.iterdir())
        if path.suffix.lower() in (".jpg", ".jpeg", ".png")
        and given.only in path.name
        and not any(text in path.name for text in given.leave_out)
    ]
    if not taken:
        sys.exit(f"error: {given.pictures} holds no such picture")
    given.out.mkdir(parents=True, exist_ok=True)
    write_coco([linked(path, given.out) for path in taken], given.out / ANNOTATIONS)
    print(f"{len(taken)} pictures in {given.out}")


if __name__ == "__main__":
    main()
