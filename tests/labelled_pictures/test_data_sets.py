"""Small files in the formats of VisDrone, DroneCrowd, UP-COUNT and COCO, through the command line and into
measurements."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image
from scipy.io import savemat

from crowdfence.detector_training.frame_store import store_missions
from crowdfence.evaluation.labelled_missions import LabelledMissions, MeasurementPlan
from crowdfence.labelled_pictures.annotated_picture import AnnotationError
from crowdfence.labelled_pictures.coco import read_coco
from crowdfence.labelled_pictures.data_sets import ImportOptions, read_data_set
from crowdfence.labelled_pictures.picture_recording import open_labelled_pictures
from support.command_line import crowdfence
from support.onnx_models import contract as document
from support.onnx_models import write_map_model

OK, FAILED = 0, 1
NOTHING = ImportOptions()


def picture(path: Path, width: int = 64, height: int = 48, red: int = 0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    pixels = np.zeros((height, width, 3), np.uint8)
    pixels[..., 0] = red
    pixels[: height // 2, :, 1] = 60  # of one tone it would be refused
    Image.fromarray(pixels).save(path)
    return path


def visdrone(
    folder: Path, text: str = "10,20,4,8,1,1,0,0\n0,0,5,6,0,0,0,0\n30,20,4,8,1,2,0,0,\n9,9,9,9,1,4,0,0\n"
) -> Path:
    picture(folder / "images" / "0001.jpg")
    (folder / "annotations").mkdir()
    (folder / "annotations" / "0001.txt").write_text(text)
    return folder


def test_visdrone(tmp_path: Path) -> None:
    """A pedestrian, an ignored region, a person and a car."""
    (found,) = read_data_set("visdrone", visdrone(tmp_path), NOTHING)
    np.testing.assert_array_equal(found.people, [[12, 28, 4, 8], [32, 28, 4, 8]])
    assert (found.width, found.height) == (64, 48)
    np.testing.assert_array_equal(found.ignored[0], [[0, 0], [5, 0], [5, 6], [0, 6]])


@pytest.mark.parametrize("nested", [True, False])
def test_dronecrowd(tmp_path: Path, nested: bool) -> None:
    """image_info is the heads, or a structure of a structure that holds them."""
    heads = np.array([[10.0, 20.0], [30.0, 40.0]])
    picture(tmp_path / "images" / "img001001.jpg")
    (tmp_path / "ground_truth").mkdir()
    info: object = heads
    if nested:
        inner = np.zeros((1, 1), dtype=[("location", object), ("number", object)])
        inner[0, 0] = (heads, np.array([[2]]))
        info = np.empty((1, 1), object)
        info[0, 0] = inner
    savemat(tmp_path / "ground_truth" / "GT_img001001.mat", {"image_info": info})
    (found,) = read_data_set("dronecrowd", tmp_path, ImportOptions(gsd_m=0.05))
    np.testing.assert_array_equal(found.people, [[10, 20, 0, 0], [30, 40, 0, 0]])
    assert found.gsd_m == 0.05


@pytest.mark.parametrize("shape", [(2, 5), (1, 10)])
def test_heads_of_dronecrowd_that_lie_across_are_refused(tmp_path: Path, shape: tuple[int, int]) -> None:
    """Five heads one a column, or all in one row: two people were there, or one."""
    picture(tmp_path / "images" / "img001001.jpg")
    (tmp_path / "ground_truth").mkdir()
    heads = np.arange(10.0).reshape(shape)
    savemat(tmp_path / "ground_truth" / "GT_img001001.mat", {"image_info": heads})
    with pytest.raises(AnnotationError, match=r"image_info has shape \[\d, \d+\]; allowed: finite \[N, 2\]"):
        list(read_data_set("dronecrowd", tmp_path, NOTHING))


def test_upcount_states_its_altitude(tmp_path: Path) -> None:
    """90 degrees over 64 pixels from 32 m: 64 m across, 1 m per pixel."""
    picture(tmp_path / "images" / "flight" / "a__32.0.jpg")
    (tmp_path / "labels" / "flight").mkdir(parents=True)
    (tmp_path / "labels" / "flight" / "a__32.0.txt").write_text("5 6\n7.5 8\n\n")
    (found,) = read_data_set("upcount", tmp_path, ImportOptions(hfov_deg=90.0))
    np.testing.assert_array_equal(found.people[:, :2], [[5, 6], [7.5, 8]])
    assert found.gsd_m == pytest.approx(1.0)


@pytest.mark.parametrize("suffix", [".JPG", ".jpeg", ".PNG"])
def test_pictures_are_found_by_any_spelling_of_their_kind(tmp_path: Path, suffix: str) -> None:
    picture(tmp_path / "images" / "a__32.0.jpg")
    picture(tmp_path / "images" / f"b__32.0{suffix}")
    (tmp_path / "labels").mkdir()
    for name in "ab":
        (tmp_path / "labels" / f"{name}__32.0.txt").write_text("5 6\n")
    assert len(list(read_data_set("upcount", tmp_path, NOTHING))) == 2


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1,2,3\n", r"0001.txt, line 1: '1,2,3'; allowed: 8 finite numbers"),
        ("1,2,3,4,5,nan,7,8\n", "allowed: 8 finite numbers"),
        ("a,b,c,d,e,f,g,h\n", "allowed: 8 finite numbers"),
        ("1\n" * 100_001, "has 100,001 lines; allowed: 100,000"),
        ("1,1,10,20,4,8,1,1,0,0\n", r"line 1: '1,1,10,20,4,8,1,1,0,0'; allowed: 8 finite numbers"),
        ("10,,20,4,8,1,1,0,0\n", "allowed: 8 finite numbers"),
        ("9,9,4,8,1,4,0,0\n\n20,9,-4,8,1,1,0,0\n", r"txt: a box of -4 x 8 pixels; allowed: at least 0"),
    ],
)
def test_wrong_lines_are_named(tmp_path: Path, text: str, message: str) -> None:
    """Lines of ten numbers are of VisDrone's films: read as eight, nobody would be in them."""
    with pytest.raises(AnnotationError, match=message):
        list(read_data_set("visdrone", visdrone(tmp_path, text), NOTHING))


def test_labels_that_are_no_text_are_named(tmp_path: Path) -> None:
    folder = visdrone(tmp_path)
    (folder / "annotations" / "0001.txt").write_bytes(b"\xe9")
    with pytest.raises(AnnotationError, match="is no text of numbers"):
        list(read_data_set("visdrone", folder, NOTHING))


def test_labels_may_come_from_windows(tmp_path: Path) -> None:
    """With a mark of the byte order, and other ends of lines."""
    folder = visdrone(tmp_path)
    (folder / "annotations" / "0001.txt").write_bytes(b"\xef\xbb\xbf10,20,4,8,1,1,0,0,\r\n\r\n")
    (found,) = read_data_set("visdrone", folder, NOTHING)
    np.testing.assert_array_equal(found.people, [[12, 28, 4, 8]])


def test_people_whom_visdrone_does_not_judge_are_ignored(tmp_path: Path) -> None:
    """Their score is 0; they are neither people nor ground without anybody."""
    text = "10,20,4,8,0,1,0,0\n30,20,4,8,0,2,0,0\n40,20,4,8,1,2,0,0\n50,20,4,8,0,11,0,0\n"
    (found,) = read_data_set("visdrone", visdrone(tmp_path, text), NOTHING)
    np.testing.assert_array_equal(found.people, [[42, 28, 4, 8]])
    np.testing.assert_array_equal([one[0] for one in found.ignored], [[10, 20], [30, 20]])


def test_one_picture_in_two_files_is_refused(tmp_path: Path) -> None:
    """Both would be judged by the same labels, and count twice."""
    folder = visdrone(tmp_path)
    picture(folder / "images" / "0001.png")
    with pytest.raises(AnnotationError, match=r"0001.png and 0001.jpg have the same labels: keep one"):
        list(read_data_set("visdrone", folder, NOTHING))


def test_upcount_has_one_head_a_line(tmp_path: Path) -> None:
    """Lines with a class before them, or of boxes, are another form: x would be the class."""
    picture(tmp_path / "images" / "a__32.0.jpg")
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "a__32.0.txt").write_text("0 5 6 2 2\n")
    with pytest.raises(AnnotationError, match=r"line 1: '0 5 6 2 2'; allowed: 2 finite numbers"):
        list(read_data_set("upcount", tmp_path, NOTHING))


def test_what_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match="is no folder"):
        list(read_data_set("visdrone", tmp_path / "nowhere", NOTHING))
    with pytest.raises(FileNotFoundError, match="holds no picture"):
        list(read_data_set("upcount", tmp_path, NOTHING))
    with pytest.raises(FileNotFoundError, match=r"takes one annotations.json there, which names pictures"):
        list(read_data_set("coco", tmp_path, NOTHING))
    picture(tmp_path / "images" / "a__x.jpg")
    with pytest.raises(FileNotFoundError, match=r"a__x.txt: no labels of a__x.jpg"):
        list(read_data_set("upcount", tmp_path, NOTHING))
    (tmp_path / "labels").mkdir()
    (tmp_path / "labels" / "a__x.txt").write_text("")
    with pytest.raises(AnnotationError, match="does not end in the altitude"):
        list(read_data_set("upcount", tmp_path, ImportOptions(hfov_deg=80.0)))
    (tmp_path / "images" / "a__x.jpg").write_bytes(b"no picture")
    with pytest.raises(AnnotationError, match="cannot be read as a picture"):
        list(read_data_set("upcount", tmp_path, NOTHING))


@pytest.mark.parametrize("content", [b"", b"MATLAB 5.0 MAT-file" + bytes(200), b"\x00" * 300])
def test_a_damaged_matlab_file_is_one_line(tmp_path: Path, content: bytes) -> None:
    picture(tmp_path / "images" / "img001001.jpg")
    (tmp_path / "ground_truth").mkdir()
    (tmp_path / "ground_truth" / "GT_img001001.mat").write_bytes(content)
    with pytest.raises(AnnotationError, match="is no MATLAB file with image_info") as caught:
        list(read_data_set("dronecrowd", tmp_path, NOTHING))
    assert "\n" not in str(caught.value)


def three_people(folder: Path) -> Path:
    """A COCO folder: in a.png three people side by side, left half red; in b.png, another size, nobody."""
    image = np.zeros((48, 64, 3), np.uint8)
    image[:, :32, 0] = 255
    picture(folder / "b.png", 40, 40)
    Image.fromarray(image).save(folder / "a.png")
    boxes = [[x, 15, 4, 17] for x in (8, 14, 20)]
    (folder / "labels.json").write_text(
        json.dumps(
            {
                "images": [
                    {"id": 1, "file_name": "a.png", "width": 64, "height": 48},
                    {"id": 2, "file_name": "b.png", "width": 40, "height": 40},
                ],
                "annotations": [{"image_id": 1, "category_id": 9, "bbox": box} for box in boxes],
                "categories": [{"id": 9, "name": "pedestrian"}],
            }
        )
    )
    return folder


@pytest.fixture
def imported(tmp_path: Path) -> Path:
    (tmp_path / "source").mkdir()
    finished = crowdfence(
        "data", "import", "coco", three_people(tmp_path / "source"), "-o", tmp_path / "data"
    )
    assert (finished.returncode, finished.stderr) == (OK, "")
    assert "2, 1 of them with a crowd" in finished.stdout
    return tmp_path / "data"


def test_an_import_is_a_folder_of_its_own(imported: Path) -> None:
    first, second = read_coco(imported / "annotations.json")
    assert first.path == imported / "images" / "a.png" and first.path.is_file()
    assert len(first.people) == 3 and len(second.people) == 0
    again = crowdfence("data", "import", "coco", imported, "-o", imported)
    assert again.returncode == FAILED and "exists and is not empty" in again.stderr


def test_an_import_tells_how_many_pictures_have_no_mark(tmp_path: Path) -> None:
    """CVAT exports every picture of a task: those that nobody had labelled yet were ground without anybody,
    and what a model found there was an error of the model."""
    (tmp_path / "source").mkdir()
    source = three_people(tmp_path / "source")  # b.png has none
    finished = crowdfence("data", "import", "coco", source, "-o", tmp_path / "a")
    assert "1 without any mark, where nobody is taken to be" in " ".join(finished.stdout.split())
    finished = crowdfence("data", "import", "coco", source, "-o", tmp_path / "b", "--json")
    assert json.loads(finished.stdout)["pictures_without_marks"] == 1


def test_an_import_tells_what_it_takes_for_nothing(tmp_path: Path) -> None:
    """A crowd in a class of another language would be ground without anybody, and nobody would hear of it."""
    (tmp_path / "source").mkdir()
    labels = three_people(tmp_path / "source") / "labels.json"
    document = json.loads(labels.read_text())
    document["categories"] += [{"id": 4, "name": "Menschenmenge"}, {"id": 5, "name": "unused"}]
    outline = [[30, 5, 60, 5, 60, 40]]
    document["annotations"] += [{"image_id": 2, "category_id": 4, "segmentation": outline}] * 2
    labels.write_text(json.dumps(document))

    def told(output: str, *roles: str) -> object:
        finished = crowdfence(
            "data", "import", "coco", labels.parent, "-o", tmp_path / output, "--json", *roles
        )
        return json.loads(finished.stdout)["left_out"]

    assert told("a") == {"Menschenmenge": 2}
    assert told("b", "--class", "Menschenmenge=crowd") == {}
    finished = crowdfence("data", "import", "coco", labels.parent, "-o", tmp_path / "c")
    assert "2 marks of classes that mean nothing here: Menschenmenge" in " ".join(finished.stdout.split())


def test_a_class_that_is_said_to_be_two_things_is_refused(tmp_path: Path) -> None:
    """The last one won: people of that class were left out, or nobody knew which."""
    (tmp_path / "source").mkdir()
    source = three_people(tmp_path / "source")

    def told(*roles: str) -> tuple[int, str]:
        words = [word for role in roles for word in ("--class", role)]
        finished = crowdfence("data", "import", "coco", source, "-o", tmp_path / "data", *words)
        return finished.returncode, finished.stderr

    for again in ("X", "x"):
        code, said = told("X=person", f"{again}=ignore")
        assert code == FAILED and f"says that {again} is person and that it is ignore: give one" in said
        assert not (tmp_path / "data").exists()
    assert told("pedestrian=person", "pedestrian=person")[0] == 0


def test_an_import_tells_which_people_were_painted_as_groups(tmp_path: Path) -> None:
    (tmp_path / "source").mkdir()
    labels = three_people(tmp_path / "source") / "labels.json"
    document = json.loads(labels.read_text())
    image = document["images"][0]
    pixels = image["width"] * image["height"]
    mask = {"counts": [0, 9, pixels - 9], "size": [image["height"], image["width"]]}
    document["annotations"].append({**document["annotations"][0], "segmentation": mask, "iscrowd": 1})
    labels.write_text(json.dumps(document))
    finished = crowdfence("data", "import", "coco", labels.parent, "-o", tmp_path / "a", "--json")
    assert "1 mask of people is a group (iscrowd: 1) and counts as a crowd" in finished.stderr
    assert json.loads(finished.stdout)["painted_groups"] == 1


def test_an_import_tells_of_labels_whose_pictures_are_not_there(tmp_path: Path) -> None:
    """An archive that was unpacked in part gave figures of whatever pictures had come."""
    source = visdrone(tmp_path / "source")
    (source / "annotations" / "0002.txt").write_text("10,20,4,8,1,1,0,0\n")
    finished = crowdfence("data", "import", "visdrone", source, "-o", tmp_path / "a")
    assert finished.returncode == OK
    assert "1 file of labels without a picture, left out, the first: " in finished.stderr
    assert "annotations/0002.txt" in finished.stderr
    told = crowdfence("data", "import", "visdrone", source, "-o", tmp_path / "b", "--json").stdout
    assert json.loads(told)["labels_without_picture"] == 1


def test_an_import_tells_who_is_marked_twice(tmp_path: Path) -> None:
    source = visdrone(tmp_path / "source", "10,20,4,8,1,1,0,0\n16,20,4,8,1,1,0,0\n" * 2)
    finished = crowdfence("data", "import", "visdrone", source, "-o", tmp_path / "a")
    said = " ".join(finished.stdout.split())
    assert "1, 0 of them with a crowd" in said and "people 2, 2 marks again of the same" in said


def test_one_scale_for_pictures_of_several_sizes_is_doubted(tmp_path: Path) -> None:
    source = visdrone(tmp_path / "source")
    picture(source / "images" / "0002.jpg", 32, 24)
    (source / "annotations" / "0002.txt").write_text("")
    finished = crowdfence("data", "import", "visdrone", source, "-o", tmp_path / "a", "--gsd-m", "0.1")
    assert "pictures have 2 sizes, from 32 x 24 to 64 x 48 pixels, and 0.1 m a pixel is" in finished.stderr
    finished = crowdfence("data", "import", "visdrone", source, "-o", tmp_path / "b")
    assert finished.stderr == ""  # boxes tell the scale of each
    told = ("--gsd-m", "0.1", "--json")
    finished = crowdfence("data", "import", "visdrone", source, "-o", tmp_path / "c", *told)
    assert json.loads(finished.stdout)["pictures"] == 2
    assert "pictures have 2 sizes" in finished.stderr  # which the JSON says nowhere


def turned(path: Path, told: int) -> None:
    with Image.open(path) as picture:
        exif = picture.getexif()
        exif[ExifTags.Base.Orientation] = told
        picture.save(path, exif=exif)


def test_pictures_that_are_stored_turned_are_told_at_the_door(tmp_path: Path) -> None:
    """They were counted as pictures with a crowd, and left out of every measurement."""
    source = visdrone(tmp_path / "source")
    turned(source / "images" / "0001.jpg", 3)
    finished = crowdfence("data", "import", "visdrone", source, "-o", tmp_path / "a")
    assert finished.returncode == OK
    assert "1 picture stored turned (EXIF Orientation), on which nothing is measured" in finished.stderr
    told = crowdfence("data", "import", "visdrone", source, "-o", tmp_path / "b", "--json").stdout
    assert json.loads(told)["stored_turned"] == 1


def test_marks_of_a_picture_as_it_is_shown_are_refused_with_the_reason(tmp_path: Path) -> None:
    """Programs for labelling turn pictures upright; their width is the height of the stored one."""
    (tmp_path / "source").mkdir()
    source = three_people(tmp_path / "source")
    with Image.open(source / "a.png") as picture:
        picture.transpose(Image.Transpose.ROTATE_90).save(source / "a.png")
    turned(source / "a.png", 6)
    with pytest.raises(AnnotationError, match=r"a.png is stored turned \(EXIF Orientation 6\)"):
        list(read_data_set("coco", source, NOTHING))


def test_marks_of_another_size_of_the_picture_are_refused(tmp_path: Path) -> None:
    """Somebody made the pictures smaller and left the marks as they were."""
    (tmp_path / "source").mkdir()
    source = three_people(tmp_path / "source")
    with Image.open(source / "b.png") as picture:
        picture.resize((32, 24)).save(source / "b.png")
    finished = crowdfence("data", "import", "coco", source, "-o", tmp_path / "data")
    assert finished.returncode == FAILED and finished.stderr.count("\n") == 1
    assert "b.png has 32 x 24 pixels, its marks are of 40 x 40" in finished.stderr
    assert not (tmp_path / "data").exists()


@pytest.mark.parametrize(
    ("kind", "words", "said"),
    [
        ("visdrone", ("--hfov-deg", "80"), "--hfov-deg is for upcount"),
        ("upcount", ("--hfov-deg", "80", "--gsd-m", "0.1"), "give one of them"),
        ("visdrone", ("--class", "car=person"), "--class is for coco"),
    ],
)
def test_an_option_that_would_do_nothing_is_refused(
    tmp_path: Path, kind: str, words: tuple[str, ...], said: str
) -> None:
    source = visdrone(tmp_path / "source")
    finished = crowdfence("data", "import", kind, source, "-o", tmp_path / "data", *words)
    assert finished.returncode == FAILED and said in finished.stderr
    assert not (tmp_path / "data").exists()


def test_an_import_that_fails_writes_nothing(tmp_path: Path) -> None:
    source = visdrone(tmp_path / "source", "1,2,3\n")
    finished = crowdfence("data", "import", "visdrone", source, "-o", tmp_path / "data")
    assert finished.returncode == FAILED and finished.stderr.count("\n") == 1
    assert not (tmp_path / "data").exists()


def test_a_model_is_judged_on_an_import(imported: Path, tmp_path: Path) -> None:
    """The model marks the red half, in which all of the crowd stands; nothing in the picture without one."""
    model = write_map_model(tmp_path / "m.onnx", document())
    page = tmp_path / "page.png"
    finished = crowdfence("model", "evaluate", model, "--data", imported, "--examples", page, "--json")
    assert finished.returncode == OK, finished.stderr
    report = json.loads(finished.stdout)
    assert report["pictures"] == {
        "pictures_with_crowd": 1,
        "mean_recall": 1.0,
        "pictures_without_crowd": 1,
        "mean_share_marked": 0.0,
        "share_with_more_than_one_percent": 0.0,
    }
    assert report["frames"] == 2 and report["rates"] is None and report["quality"]["overall"]["units"] == 2
    with Image.open(page) as drawn:
        assert drawn.size == (4 * 480, 360)
    text = crowdfence("model", "evaluate", model, "--data", imported).stdout
    assert "1 pictures with crowd: 100.0% of it marked" in text and "1 without: 0.00%" in text


def test_pictures_are_frames_to_calibrate_and_train_on(imported: Path, tmp_path: Path) -> None:
    missions = LabelledMissions([imported], MeasurementPlan(target="ground"), lambda: None)
    (mission,) = missions.opened(with_maps=True)
    assert mission.is_pictures and mission.terrain is None and len(mission.recording.frames) == 2
    (stored,) = store_missions([imported], ("ground", "silhouettes"), tmp_path / "store")
    assert stored.images.shape == (2, 48, 64, 3) and stored.crowd.shape == (2, 2, 24, 32)
    assert stored.crowd[0].any() and not stored.crowd[1].any()
    assert stored.known[0].all() and not stored.known[1, :, 20:].any() and stored.known[1, :, :20, :20].all()


def test_a_picture_that_cannot_be_read_is_refused_by_name(imported: Path) -> None:
    (imported / "images" / "a.png").write_bytes(b"no picture")
    finished = crowdfence("model", "evaluate", "--data", imported, "--json")
    assert finished.returncode == OK
    report = json.loads(finished.stdout)
    assert report["refused"][0].startswith("data: images/a.png at 0: image cannot be read")
    assert report["contract"] == "crowdnet-s-wide"  # which looks at pictures where nobody is named


def test_pictures_have_placeholders_for_poses_and_say_so(imported: Path) -> None:
    recording = open_labelled_pictures(imported).recording
    assert recording.manifest["labelled pictures"] == str(imported / "annotations.json")
    assert [frame.drone for frame in recording.frames] == ["images/a.png", "images/b.png"]
    with pytest.raises(FileNotFoundError, match="holds no pictures with COCO annotations"):
        open_labelled_pictures(imported / "images")
