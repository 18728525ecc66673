"""One detector or several by name, the one that suits the pictures, and what a run says of them."""

import io
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import crowdfence
from crowdfence import DetectorError, Recording, open_recording
from crowdfence.detector.shipped import shipped_model
from crowdfence.pipeline import choose_detector, heatmap_source, named_detector, suitable_model
from support.onnx_models import contract as document
from support.onnx_models import write_map_model


@pytest.mark.parametrize("name", ["crowdnet-s", "crowdnet-s-wide"])
def test_the_shipped_models_have_names(name: str) -> None:
    assert named_detector([name]).contract.name == name
    assert crowdfence.Detector(name).contract.name == name


def test_several_are_one(tmp_path: Path) -> None:
    model = write_map_model(tmp_path / "m.onnx", document())
    both = named_detector(["crowdnet-s", str(model)])
    heatmaps = heatmap_source(both, None, 100.0)
    made = heatmaps.to_json()
    assert made["name"] == "crowdnet-s + test model"
    assert [one["file"] for one in made["members"]] == ["crowdnet-s-int8.onnx", "m.onnx"]
    assert all(len(one["sha256"]) == 64 for one in made["members"])
    assert made["calibrated_together"] is False
    assert heatmaps.warnings[0].startswith(
        "the detectors crowdnet-s + test model were not calibrated together"
    )


def test_one_has_nothing_to_be_calibrated_with() -> None:
    heatmaps = heatmap_source(named_detector(["crowdnet-s"]), None, 100.0)
    assert heatmaps.warnings == [] and "calibrated_together" not in heatmaps.to_json()


@pytest.mark.parametrize(
    ("names", "message"),
    [
        (["auto", "crowdnet-s"], "--detector auto cannot be combined"),
        (["crowdnet-s", "recorded"], "--detector recorded cannot be combined"),
        (["crowdnet-s", "crowdnet-s"], "is given twice: its opinion would count double"),
    ],
)
def test_words_that_mean_no_model_are_not_combined(names: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        named_detector(names)


def test_one_contract_is_not_that_of_several_models(tmp_path: Path) -> None:
    """That of the one fits the tensors of the other, which is shown pictures otherwise."""
    with pytest.raises(ValueError, match=r"--contract .*c.json: several detectors have one each"):
        named_detector(["crowdnet-s", "crowdnet-s-wide"], contract=tmp_path / "c.json")


def test_one_file_under_two_names_is_one_model(tmp_path: Path) -> None:
    model = write_map_model(tmp_path / "m.onnx", document())
    (tmp_path / "link.onnx").symlink_to(model)
    for other in (tmp_path / "." / "folder" / ".." / "m.onnx", tmp_path / "link.onnx"):
        (tmp_path / "folder").mkdir(exist_ok=True)
        with pytest.raises(ValueError, match="is given twice: its opinion would count double"):
            named_detector([str(model), str(other)])
    with pytest.raises(ValueError, match="is given twice"):
        named_detector(["crowdnet-s", str(shipped_model("crowdnet-s"))])


def test_a_model_without_a_contract_is_still_refused(tmp_path: Path) -> None:
    with pytest.raises(DetectorError, match="says neither what it expects"):
        named_detector(["crowdnet-s", str(write_map_model(tmp_path / "m.onnx"))])


def test_the_shipped_networks_call_the_same_crowds() -> None:
    """On the pictures of the bundled flight, which neither was made from."""
    recording = open_recording(Path(crowdfence.__file__).parent / "demo_data" / "race.mcap")
    images = [frame.image() for frame in recording.frames[::12]]
    names = ("crowdnet-s", "crowdnet-s-float32", "crowdnet-s-wide")
    called = [
        np.stack([one(image, as_it_is=True) >= 0.5 for image in images])
        for one in (named_detector([name]) for name in names)
    ]
    fast, exact, wide = called
    assert fast.sum() > 100
    assert (fast & exact).sum() / (fast | exact).sum() > 0.95
    # Trained further on other pictures: another opinion of most of the same crowds.
    assert 0.5 < (fast & wide).sum() / (fast | wide).sum() < 0.95


def demo() -> Recording:
    return open_recording(Path(crowdfence.__file__).parent / "demo_data" / "race.mcap")


def encoded(levels: np.ndarray) -> Callable[[], bytes]:
    def png() -> bytes:
        file = io.BytesIO()
        Image.fromarray(levels.astype(np.uint8)).save(file, format="PNG")
        return file.getvalue()

    return png


def with_pictures(*pictures: Callable[[], bytes] | None) -> Recording:
    """The first frames of the bundled flight, with these pictures, None: as they are."""
    flight = demo()
    frames = [
        frame if picture is None else replace(frame, pixels=replace(frame.pixels, image=picture))
        for frame, picture in zip(flight.frames, pictures, strict=False)
    ]
    return replace(flight, frames=tuple(frames))


NOISE = encoded(np.random.default_rng(0).integers(0, 256, (240, 320, 3)))
"""No renderer made it: every pixel has a colour of its own."""
BLACK = encoded(np.zeros((240, 320, 3)))


def test_the_bundled_flight_looks_as_tested() -> None:
    assert suitable_model(demo()) == "crowdnet-s"


@pytest.mark.parametrize(("noise", "name"), [(6, "crowdnet-s"), (7, "crowdnet-s-wide")])
def test_most_of_twelve_pictures_decide(noise: int, name: str) -> None:
    flight = with_pictures(*[NOISE] * noise, *[None] * (12 - noise))
    assert suitable_model(flight) == name
    chosen = choose_detector(flight, "auto")
    assert chosen is not None and chosen.contract.name == name


def test_pictures_that_show_nothing_decide_nothing() -> None:
    """Damaged or black, as before the lens is open: of the two others both are unlike the tested ones."""
    damaged = [lambda: b"no picture"] * 5
    assert suitable_model(with_pictures(*damaged, *[BLACK] * 5, NOISE, NOISE)) == "crowdnet-s-wide"
    assert suitable_model(with_pictures(*damaged, *[BLACK] * 7)) == "crowdnet-s"


def test_one_in_every_part_of_a_flight_is_looked_at() -> None:
    """A third of the frames are noise, the last third: of twelve pictures over the whole flight four."""
    flight = demo()
    count = len(flight.frames)
    late = [None] * (count - count // 3) + [NOISE] * (count // 3)
    assert suitable_model(with_pictures(*late)) == "crowdnet-s"
    early = [NOISE] * (count - count // 3) + [None] * (count // 3)
    assert suitable_model(with_pictures(*early)) == "crowdnet-s-wide"


def test_a_recording_without_pictures_has_the_first() -> None:
    flight = demo()
    frames = tuple(replace(one, pixels=replace(one.pixels, image=None)) for one in flight.frames)
    assert suitable_model(replace(flight, frames=frames)) == "crowdnet-s"
