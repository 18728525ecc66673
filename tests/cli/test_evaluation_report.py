"""`crowdfence evaluate --report` on the bundled recording."""

import json
from pathlib import Path

import pytest
from PIL import Image

from crowdfence.cli.demo import RECORDING
from support.command_line import crowdfence
from support.small_recordings import flight, write_airsim

ARGUMENTS = (
    "evaluate",
    RECORDING,
    "--truth",
    "world",
    "--detector",
    "recorded",
    "-m",
    "evidence",
    "-m",
    "or",
)


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("evaluated") / "report"
    done = crowdfence(*ARGUMENTS, "--report", folder, "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads((folder / "scores.json").read_text()) == json.loads(done.stdout)
    return folder


def test_a_report_is_a_page_with_its_plots(report: Path) -> None:
    page = (report / "index.html").read_text()
    pictures = {path.name for path in report.glob("*.png")}
    assert pictures == {"iou.png", "reliability.png", "people.png", "cost.png"}
    for name in pictures:
        assert f'src="{name}"' in page
        with Image.open(report / name) as picture:
            assert len(picture.convert("RGB").getcolors(1 << 20)) > 20  # something is drawn
    for row in json.loads((report / "scores.json").read_text())["scores"]:
        assert f"{row['mean_iou']:.3f}" in page
        assert f"{row['measures']['average_precision']:.3f}" in page
        assert f"{100 * row['safety']['in_zone'][2]:.1f} %" in page


def test_only_a_report_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep me")
    refused = crowdfence(*ARGUMENTS, "--report", tmp_path)
    assert refused.returncode == 1 and "mine.txt" in refused.stderr
    assert (tmp_path / "mine.txt").read_text() == "keep me"


def test_a_report_needs_people(tmp_path: Path) -> None:
    recording = write_airsim(tmp_path / "recording", flight())
    refused = crowdfence("evaluate", recording, "--detector", "recorded", "--report", tmp_path / "report")
    assert refused.returncode == 1 and "does not record where people are" in refused.stderr
    assert not (tmp_path / "report").exists()


def test_every_knob_can_be_turned(tmp_path: Path) -> None:
    methods = ("-m", "moving-average", "-m", "or")
    arguments = (*ARGUMENTS[:6], *methods, "--sweep", "--report", tmp_path / "report", "--json")
    done = crowdfence(*arguments)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    knobs = {one["method"]: one["best_mean_iou"] for one in found["knobs"]}
    assert set(knobs) == {"moving-average", "or"} and knobs["or"] == {}
    assert set(knobs["moving-average"]) == {"prior", "memory_s"}
    # The value that the method has stands among the others, with the score of its own row.
    (own,) = [iou for value, iou in knobs["moving-average"]["memory_s"] if value == 5.0]
    (score,) = [one for one in found["scores"] if one["config"]["method"] == "moving-average"]
    assert own == score["best_mean_iou"]
    assert "<h2>Knobs</h2>" in (tmp_path / "report" / "index.html").read_text()
