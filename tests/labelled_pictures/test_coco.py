"""COCO files: outlines, boxes and points; files that are wrong."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from crowdfence.labelled_pictures.annotated_picture import AnnotationError
from crowdfence.labelled_pictures.coco import annotation_file, read_coco, write_coco
from crowdfence.labelled_pictures.crowd_labels import picture_labels
from crowdfence.labelled_pictures.picture_recording import open_labelled_pictures


def document(*annotations: dict[str, Any], **changes: Any) -> dict[str, Any]:
    given = {
        "images": [{"id": 7, "file_name": "a/b.jpg", "width": 64, "height": 48}],
        "annotations": [{"image_id": 7, "category_id": 1, **one} for one in annotations],
        "categories": [{"id": 1, "name": "Person"}, {"id": 2, "name": "crowd"}, {"id": 3, "name": "tent"}],
    }
    return given | changes


def written(folder: Path, content: object) -> Path:
    path = folder / "annotations.json"
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_boxes_points_and_outlines_of_people(tmp_path: Path) -> None:
    path = written(
        tmp_path,
        document(
            {"bbox": [10, 20, 4, 8]},
            {"keypoints": [0, 0, 0, 30, 31, 2], "num_keypoints": 1},
            {"segmentation": [[1, 2, 5, 2, 5, 12]]},
            {"bbox": [0, 0, 9, 9], "category_id": 3},
        ),
    )
    (picture,) = read_coco(path)
    assert (picture.path, picture.width, picture.height) == (tmp_path / "a/b.jpg", 64, 48)
    np.testing.assert_array_equal(picture.people, [[12, 28, 4, 8], [30, 31, 0, 0], [3, 12, 4, 10]])
    assert picture.crowds == () and picture.gsd_m is None


def test_crowds_are_outlined_or_groups(tmp_path: Path) -> None:
    outline = {"category_id": 2, "segmentation": [[0, 0, 8, 0, 8, 8], [20, 20, 30, 20, 30, 30]]}
    group = {"iscrowd": 1, "bbox": [40, 10, 5, 6]}
    (picture,) = read_coco(written(tmp_path, document(outline, group)))
    assert len(picture.crowds) == 3 and len(picture.people) == 0
    np.testing.assert_array_equal(picture.crowds[2], [[40, 10], [45, 10], [45, 16], [40, 16]])


def test_a_crowd_with_a_part_that_has_no_area_is_one(tmp_path: Path) -> None:
    """Of outlines that cross themselves, as of a bow tie, the areas cancel out."""
    bow_tie, sliver = [0, 0, 20, 20, 20, 0, 0, 20], [30, 30, 40, 40, 50, 50]
    crowd = {"category_id": 2, "segmentation": [bow_tie, sliver]}
    (picture,) = read_coco(written(tmp_path, document(crowd)))
    assert len(picture.crowds) == 2 and picture_labels(picture).crowd[10, 15]


def test_a_box_of_four_zeros_is_none(tmp_path: Path) -> None:
    """COCO Annotator writes one beside points and outlines: all people stood in the corner, as one, and a
    picture of a crowd was one of empty ground. CVAT writes boxes without a size beside single points."""
    nothing = {"bbox": [0, 0, 0, 0], "segmentation": []}
    points = [{**nothing, "keypoints": [x, 31, 2], "num_keypoints": 1} for x in (20, 22, 24)]
    outline = {**nothing, "segmentation": [[1, 2, 5, 2, 5, 12]]}
    of_a_point = {"bbox": [40, 30, 0, 0], "segmentation": [], "keypoints": [40, 30, 2]}
    (picture,) = read_coco(written(tmp_path, document(*points, outline, of_a_point)))
    standing = [[20, 31, 0, 0], [22, 31, 0, 0], [24, 31, 0, 0], [3, 12, 4, 10], [40, 30, 0, 0]]
    np.testing.assert_array_equal(picture.people, standing)
    (picture,) = read_coco(written(tmp_path, document({"bbox": [0, 0, 4, 8]}, {"bbox": [7, 0, 0, 0]})))
    np.testing.assert_array_equal(picture.people, [[2, 8, 4, 8], [7, 0, 0, 0]])


@pytest.mark.parametrize(("rotation", "upright"), [(90.0, False), (-90, False), (180.0, True), (0.0, True)])
def test_boxes_are_turned_as_cvat_states_it(tmp_path: Path, rotation: float, upright: bool) -> None:
    """Its box is that before turning: a crowd was marked beside where it stands. 20 x 4 about (30, 22)."""
    mark = {"bbox": [20, 20, 20, 4], "segmentation": [], "attributes": {"rotation": rotation}}
    (picture,) = read_coco(written(tmp_path, document({**mark, "category_id": 2}, mark)))
    expected = [20, 20, 40, 24] if upright else [28, 12, 32, 32]
    np.testing.assert_allclose(shapely.Polygon(picture.crowds[0]).bounds, expected)
    person = [30, 24, 20, 4] if upright else [30, 32, 4, 20]
    np.testing.assert_allclose(picture.people, [person])


def test_boxes_turn_clockwise_and_outlines_do_not(tmp_path: Path) -> None:
    """20 x 4 about (30, 22) by 30 degrees: its right end comes down by 10 sin 30 = 5, to 27."""
    turned = {"bbox": [20, 20, 20, 4], "category_id": 2, "attributes": {"rotation": 30, "occluded": False}}
    outline = [20.0, 20.0, 40.0, 20.0, 40.0, 24.0, 20.0, 24.0]
    drawn = {**turned, "segmentation": [outline]}
    named = {**turned, "attributes": {"rotation": "left"}}
    (picture,) = read_coco(written(tmp_path, document(turned, drawn, named)))
    box, other, upright = (shapely.Polygon(one) for one in picture.crowds)
    cos, sin = math.cos(math.pi / 6), 0.5
    assert box.area == pytest.approx(80.0)
    assert box.contains(shapely.Point(30 + 9 * cos, 22 + 9 * sin))
    assert not box.contains(shapely.Point(30 + 9 * cos, 22 - 9 * sin))
    assert other.bounds == upright.bounds == (20, 20, 40, 24)


def run_lengths(mask: NDArray[np.bool_]) -> list[int]:
    """Down the columns, beginning with those outside."""
    flat = [False, *mask.ravel(order="F").tolist()]
    turns = [0, *(number for number in range(1, len(flat)) if flat[number] != flat[number - 1])]
    begins = [max(turn - 1, 0) for turn in turns]
    return [b - a for a, b in zip(begins, [*begins[1:], mask.size], strict=True)]


def as_text(runs: list[int]) -> str:
    """As pycocotools packs them."""
    text = ""
    for number, run in enumerate(runs):
        value = run - (runs[number - 2] if number > 2 else 0)
        more = True
        while more:
            digit, value = value & 0x1F, value >> 5
            more = value != (-1 if digit & 0x10 else 0)
            text += chr(48 + digit + (0x20 if more else 0))
    return text


@pytest.mark.parametrize("packed", [False, True])
def test_masks_are_where_their_pixels_are(tmp_path: Path, packed: bool) -> None:
    """An L whose box is mostly empty, and a block below it: as programs for painting write crowds."""
    mask = np.zeros((48, 64), np.bool_)
    mask[4:40, 8:12], mask[36:40, 8:50], mask[44:48, 60:64] = True, True, True
    runs = run_lengths(mask)
    outline = {"counts": as_text(runs) if packed else runs, "size": [48, 64]}
    mark = {"iscrowd": 1, "bbox": [8, 4, 56, 44], "segmentation": outline}
    (picture,) = read_coco(written(tmp_path, document(mark)))
    areas = sorted(shapely.Polygon(one).area for one in picture.crowds)
    assert areas == [16, 36 * 4 + 38 * 4]
    drawn = picture_labels(picture).crowd
    assert (drawn & ~binary_dilation(mask, np.ones((3, 3)))).sum() == 0 and (mask & ~drawn).sum() == 0


def test_the_hole_of_an_ignored_mask_counts(tmp_path: Path) -> None:
    """Who masks all but a field had the field ignored too: its crowd was in no figure, without a word."""
    mask = np.ones((48, 64), np.bool_)
    mask[8:40, 4:20], mask[10:20, 30:50] = False, False
    ignored = {"category_id": 3, "segmentation": {"counts": run_lengths(mask), "size": [48, 64]}}
    categories = [{"id": 1, "name": "person"}, {"id": 3, "name": "ignored"}]
    path = written(tmp_path, document(ignored, categories=categories))
    write_coco(read_coco(path), path)
    drawn = picture_labels(read_coco(path)[0]).ignored
    # As above, edges of outlines are drawn too: a pixel at most.
    assert drawn[mask].all() and not drawn[~binary_dilation(mask, np.ones((3, 3)))].any()


def test_masks_that_are_groups_of_people_are_told_of(tmp_path: Path) -> None:
    """CVAT exports every mask with iscrowd: 1: people painted one by one were crowds, and nothing said so."""
    mask = {"segmentation": {"counts": [10, 5, 64 * 48 - 15], "size": [48, 64]}}
    one = {**mask, "iscrowd": 0}
    group, box = {**mask, "iscrowd": 1}, {"iscrowd": 1, "bbox": [40, 10, 5, 6]}
    marks = [one, group, group, box, {**group, "ignore": 1}, {**group, "category_id": 2}]
    (picture,) = read_coco(written(tmp_path, document(*marks)))
    assert len(picture.people) == 1 and len(picture.crowds) == 4 and picture.painted_groups == 2
    (told,) = (one for one in open_labelled_pictures(tmp_path).recording.warnings if "mask" in one)
    assert told.startswith("2 masks of people are groups (iscrowd: 1) and count as a crowd each; CVAT")
    written(tmp_path, document(one, box))
    assert open_labelled_pictures(tmp_path).recording.warnings == ()


def test_nothing_is_said_of_what_is_to_be_ignored(tmp_path: Path) -> None:
    """Converters of VisDrone and of others write `ignore` beside `iscrowd`."""
    path = written(
        tmp_path,
        document(
            {"bbox": [10, 20, 4, 8], "ignore": 0, "iscrowd": 0},
            {"bbox": [20, 20, 30, 9], "ignore": 1, "iscrowd": 0},
            {"segmentation": [[0, 0, 8, 0, 8, 8]], "category_id": 2, "ignore": 1},
            {"bbox": [1, 1, 2, 2], "category_id": 3, "ignore": 1},
        ),
    )
    (picture,) = read_coco(path)
    np.testing.assert_array_equal(picture.people, [[12, 28, 4, 8]])
    assert picture.crowds == () and len(picture.ignored) == 2 and picture.left_out == ("tent",)
    np.testing.assert_array_equal(picture.ignored[0], [[20, 20], [50, 20], [50, 29], [20, 29]])


def test_other_names_are_said(tmp_path: Path) -> None:
    mark = document({"bbox": [0, 0, 2, 2]}, categories=[{"id": 1, "name": "Zuschauer"}])
    path = written(tmp_path, mark)
    with pytest.raises(AnnotationError, match=r"no class is of people or crowds; it has 'zuschauer'"):
        read_coco(path)
    assert len(read_coco(path, {"zuschauer": "person"})[0].people) == 1
    with pytest.raises(AnnotationError, match="no class is named 'publikum'"):
        read_coco(path, {"publikum": "crowd"})


def test_pictures_say_which_of_their_marks_mean_nothing(tmp_path: Path) -> None:
    """Riders were empty ground for whoever opened the folder without `data import`, and nobody was told."""
    classes = [{"id": 1, "name": "person"}, {"id": 2, "name": "rider"}]
    box = {"bbox": [0, 0, 2, 2]}
    written(tmp_path, document(box, {**box, "category_id": 2}, categories=classes))
    (warning,) = open_labelled_pictures(tmp_path).recording.warnings
    assert warning.startswith("1 mark of classes that mean nothing here: rider, so where they are nobody is")
    assert "data import coco --class NAME=person" in warning
    written(tmp_path, document(box, categories=classes))
    assert open_labelled_pictures(tmp_path).recording.warnings == ()


def test_what_is_written_is_read(tmp_path: Path) -> None:
    before = read_coco(
        written(
            tmp_path,
            document(
                {"bbox": [10, 20, 4, 8]},
                {"keypoints": [30, 31, 2]},
                {"category_id": 2, "segmentation": [[0, 0, 8, 0, 8, 8]]},
                images=[{"id": "x", "file_name": "p.png", "width": 9, "height": 8, "gsd_m": 0.25}],
                annotations=[{"image_id": "x", "category_id": 1, "bbox": [10, 20, 4, 8]}],
            ),
        )
    )
    write_coco(before, tmp_path / "again.json")
    (after,) = read_coco(tmp_path / "again.json")
    np.testing.assert_allclose(after.people, before[0].people)
    assert (after.path, after.gsd_m) == (before[0].path, 0.25)


def test_the_annotations_of_a_folder(tmp_path: Path) -> None:
    assert annotation_file(tmp_path) is None and annotation_file(tmp_path / "missing") is None
    (tmp_path / "other.json").write_text("{}")
    assert annotation_file(tmp_path) is None
    (tmp_path / "labels.json").write_text(json.dumps(document()))
    assert annotation_file(tmp_path) == tmp_path / "labels.json"
    (tmp_path / "more.json").write_text(json.dumps(document()))
    assert annotation_file(tmp_path) is None  # which of the two is meant?
    written(tmp_path, document())
    assert annotation_file(tmp_path) == tmp_path / "annotations.json"


IMAGE = {"id": 7, "file_name": "a.jpg", "width": 64, "height": 48}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("{", "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("[]", "must hold an object"),
        ({"images": [], "annotations": [], "categories": []}, "no class is of people"),
        (document(images={}), r"images is {}; allowed: a list"),
        (document(images=[]), "holds no image"),
        (document(images=[7]), r"images\[0\] is 7; allowed: an object"),
        (document(images=[IMAGE, IMAGE]), r"images\[1\].id 7 occurs twice"),
        (document(images=[IMAGE, {**IMAGE, "id": 8}]), r"images\[1\].file_name 'a.jpg' occurs twice"),
        (
            document(images=[{**IMAGE, "file_name": "../a.jpg"}]),
            r"file_name is '../a.jpg'; allowed: a path below",
        ),
        (document(images=[{**IMAGE, "file_name": "/etc/passwd"}]), "allowed: a path below"),
        (document(images=[{**IMAGE, "width": 0}]), r"images\[0\].width is 0; allowed: pixels from 1"),
        (document(images=[{**IMAGE, "width": 10**9}]), "allowed: pixels from 1 to 65535"),
        (document(images=[{**IMAGE, "height": 4.5}]), "height is 4.5"),
        (document(images=[{**IMAGE, "gsd_m": -1}]), "gsd_m is -1; allowed: metres above 0"),
        (document({"bbox": [1, 2, 3]}), r"annotations\[0\].bbox has 3 numbers; allowed: 4"),
        (document({"bbox": [1, 2, -3, 4]}), "allowed: width and height of at least 0"),
        (document({"bbox": [1, 2, -3, 4], "category_id": 2}), "allowed: width and height of at least 0"),
        (
            document({"bbox": [1, 2, 3, 4], "category_id": 9}),
            r"annotations\[0\].category_id is 9, which is no category",
        ),
        (document({"bbox": [1, 2, math.nan, 4]}), "allowed: a list of finite numbers"),
        (document({"bbox": "1,2"}), "allowed: a list of finite numbers"),
        (
            document({"bbox": [0, 0, 0, 0], "segmentation": [], "keypoints": [0, 0, 0]}),
            r"annotations\[0\] has no outline \(segmentation\), no box \(bbox\) and no point",
        ),
        (document({"segmentation": [[1, 2, 3, 4]]}), "has 4 numbers; allowed: x, y of 3 corners"),
        (document({"segmentation": [[1, 2, 3, 4, 5, 6, 7]]}), "has 7 numbers"),
        (
            document({"segmentation": {"counts": "abc"}}),
            r"annotations\[0\].segmentation.size is None; allowed: \[48, 64\], height and width",
        ),
        (document({"segmentation": {"size": [64, 48], "counts": [3072]}}), r"size is \[64, 48\]; allowed"),
        *(
            (document({"segmentation": {"size": [48, 64], "counts": counts}}), "no sequence of runs of 3072")
            for counts in (None, [5], [-1, 3073], [1.5, 3070.5], "abc", "\x00", "o" * 9, [True, 3071])
        ),
        (document({"segmentation": {"size": [48, 64], "counts": [3072]}}), "is a mask without a pixel"),
        # Drawn, each covers less than half of any cell: the picture was one without crowd.
        *(
            (document({**mark, "category_id": 2}), r"annotations\[0\] is a crowd without area: its corners")
            for mark in (
                {"segmentation": [[8, 8, 20, 20, 32, 32]]},
                {"segmentation": [[8, 8, 8, 8, 8, 8], [1, 1, 1, 5, 1, 9]]},
                {"bbox": [10, 10, 30, 0]},
            )
        ),
        (document({"segmentation": [[1, 2, 3, 4, 5, 10**400]]}), "allowed: a list of finite numbers"),
        (
            document({"bbox": [1, 2, 3, 4], "image_id": 8}),
            r"annotations\[0\].image_id is 8, which is no image",
        ),
        (document({"bbox": [1, 2, 3, 4], "image_id": [8]}), "allowed: a whole number or text"),
        (document({"bbox": [1, 2, 3, 4], "iscrowd": "1"}), r"\[0\].iscrowd is '1'; allowed: 0 or 1"),
        (document({"bbox": [1, 2, 3, 4], "ignore": 2}), r"annotations\[0\].ignore is 2; allowed: 0 or 1"),
        (document(categories=[{"id": 1}]), r"categories\[0\].name is None"),
        (
            document(categories=[{"id": 1, "name": "car"}, {"id": 1, "name": "crowd"}]),
            r"categories\[1\].id 1 occurs twice",
        ),
    ],
)
def test_a_wrong_file_is_one_line(tmp_path: Path, content: object, message: str) -> None:
    path = written(tmp_path, content)
    with pytest.raises(AnnotationError, match=message) as caught:
        read_coco(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)
