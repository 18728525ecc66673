"""A model on labelled pictures, from outside."""

from pathlib import Path

import numpy as np
from PIL import Image

from crowdfence import Detector
from crowdfence.evaluation.labelled_missions import MeasurementPlan
from crowdfence.evaluation.model_quality import model_quality
from crowdfence.labelled_pictures.annotated_picture import AnnotatedPicture, rectangle
from crowdfence.labelled_pictures.coco import ANNOTATIONS, write_coco
from support.onnx_models import contract, write_map_model


def test_pictures_count_by_their_cells_whatever_their_size_is_a_multiple_of(tmp_path: Path) -> None:
    """A red crowd that the model sees in 160 x 120 pixels, 40 x 30 cells of 4 pixels, and in one more pixel
    both ways, 41 x 31 cells. Had the second heatmap as many cells as pixels it would count sixteenfold."""
    folder = tmp_path / "pictures"
    folder.mkdir()
    pictures = []
    for width, height in ((160, 120), (161, 121)):
        pixels = np.full((height, width, 3), 20, np.uint8)
        pixels[40:80, 80:120] = (255, 0, 0)
        place = folder / f"{width}.png"
        Image.fromarray(pixels).save(place)
        crowd = rectangle(80.0, 40.0, 39.0, 39.0)
        pictures.append(AnnotatedPicture(place, width, height, np.empty((0, 4)), (crowd,)))
    write_coco(pictures, folder / ANNOTATIONS)
    detector = Detector(write_map_model(tmp_path / "m.onnx", contract()))
    overall = model_quality(detector, [folder], MeasurementPlan()).quality.overall
    assert overall.cells == 40 * 30 + 41 * 31
    assert overall.crowd_cells == 2 * 10 * 10
    assert (overall.iou.value, overall.false_positive_rate.value) == (1.0, 0.0)
