"""`crowdfence evaluate --report` on the bundled recording."""

import json
import re
from html import escape
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

import crowdfence as cf
from crowdfence.cli.demo import RECORDING
from crowdfence.evaluation.replay import score
from crowdfence.evaluation.report import plots
from crowdfence.evaluation.report.page import MOST_REFUSALS, _doubts
from crowdfence.sources.recording import Frame
from support.command_line import crowdfence
from support.near_ground import write_near_ground
from support.small_recordings import flight, write_airsim

METHODS = ("-m", "evidence", "-m", "or")


@pytest.fixture(scope="module")
def race(tmp_path_factory: pytest.TempPathFactory) -> tuple[object, ...]:
    """The words that evaluate it by the methods that follow."""
    near = write_near_ground(tmp_path_factory.mktemp("near"))
    return ("evaluate", RECORDING, "-t", near, "--truth", "world", "--detector", "recorded")


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory, race: tuple[object, ...]) -> Path:
    folder = tmp_path_factory.mktemp("evaluated") / "report"
    done = crowdfence(*race, *METHODS, "--report", folder, "--json")
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
    assert "Heatmaps: as recorded." in page
    for row in json.loads((report / "scores.json").read_text())["scores"]:
        assert f"{row['mean_iou']:.3f}" in page
        assert f"{row['measures']['average_precision']:.3f}" in page
        assert f"{100 * row['safety']['in_zone'][2]:.1f} %" in page


def test_table_and_page_say_the_same_and_of_how_many(report: Path, race: tuple[object, ...]) -> None:
    done = crowdfence(*race, *METHODS, "--or-b-threshold", "0.7")
    assert done.returncode == 0, done.stderr
    scores = json.loads((report / "scores.json").read_text())["scores"]
    people, moments = (scores[0]["safety"][name] for name in ("people", "moments"))
    assert f"{people:,} counts at {moments} moments" in " ".join(done.stdout.split())
    assert f"{people:,} counts, at {moments} moments, of people" in (report / "index.html").read_text()
    # Nothing says in which range recorded heatmaps are good; all were told to be in a tested one.
    for told in (done.stdout, (report / "index.html").read_text()):
        assert "In range: as 5 m, for no range is known that the heatmaps are good in" in told
        assert "tested" not in told and "of them in range" not in told
    # Thresholds of a rare class are small: two digits after the point made 0.00 of them.
    for row, method in zip(scores, ("evidence", "or"), strict=True):
        line = next(line for line in done.stdout.splitlines() if line.split()[:1] == [method])
        assert line.split()[-2] == f"{row['best_threshold']:.4g}"
    assert line.split()[1] == "0.700"  # of `or` its b_threshold, which the best one is set beside


def test_the_page_says_what_was_doubtful_and_what_was_refused(report: Path) -> None:
    """The page is what is sent around, without the warnings of the command and scores.json."""
    told, page = json.loads((report / "scores.json").read_text()), (report / "index.html").read_text()
    for sentence in (*told["warnings"], *told["refused"]):
        assert f"<li>{escape(sentence)}</li>" in page
    assert ("Nothing was doubtful." in page) == (not told["warnings"])
    assert ("Every picture was used." in page) == (not told["refused"])
    refused = [f"uav1 at {number}: it is <cut> off" for number in range(MOST_REFUSALS + 3)]
    page = "".join(_doubts({"warnings": ["nobody's position is recorded"], "refused": refused}))
    assert "<li>nobody&#x27;s position is recorded</li>" in page
    assert page.count("it is &lt;cut&gt; off") == MOST_REFUSALS and "and 3 more" in page


def test_a_small_threshold_is_shown_by_table_and_page(tmp_path: Path, race: tuple[object, ...]) -> None:
    words = ("-m", "evidence", "--threshold", "0.0003", "--report", tmp_path / "report")
    done = crowdfence(*race, *words)
    assert done.returncode == 0, done.stderr
    assert re.search(r"evidence +0\.0003 ", done.stdout)
    assert "<td>0.0003</td>" in (tmp_path / "report" / "index.html").read_text()


def test_every_method_is_drawn_however_many_are_asked_for() -> None:
    iou = SimpleNamespace(per_frame=np.ones(2), mean=1.0)
    axes = Figure().add_subplot()
    plots.draw_iou(axes, [f"paper, alpha {number}" for number in range(13)], [SimpleNamespace(iou=iou)] * 13)
    looks = {(line.get_color(), line.get_linestyle()) for line in axes.lines}
    assert len(axes.lines) == len(looks) == 13


@pytest.mark.parametrize(
    ("cost", "told"),
    [
        ([9.0, 4.0, 1.0], "or"),
        ([np.nan, 12.0, 1.0], "or"),  # on the very edge
        ([30.0, 12.1, 1.0], "or, above 12 x below 30 %"),
        ([np.nan, 30.0, 1.0], "or, above 12 x below 30 %"),
        ([60.0, 30.0, 13.0], "or, above 12 x throughout"),
        ([np.nan] * 3, "or, always misses more than 30 %"),
    ],
)
def test_the_plot_of_costs_says_what_it_does_not_show(
    cost: list[float], told: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(plots, "MISSED", np.array([0.0, 0.15, 0.3]))
    measures = SimpleNamespace(cost=SimpleNamespace(curve=lambda missed: np.array(cost)))
    axes = Figure().add_subplot()
    plots.draw_cost(axes, ["or"], [SimpleNamespace(measures=measures)])
    assert axes.get_legend_handles_labels()[1] == [told]
    assert axes.get_ylim() == (0.0, 12.0)


@pytest.fixture(scope="module")
def without_crowds(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two drones look once each at single walkers, whom the stand-in takes for crowd here and there."""
    folder = tmp_path_factory.mktemp("nobody")
    (folder / "nobody.toml").write_text(
        'drones = 2\nframes = 1\n[landscape]\nkind = "field"\nsize_m = 200\n[walkers]\ncount = 60\n'
        "[flight]\narea_m = 60\naltitude_m = [20, 40]\n[camera]\nwidth = 160\nheight = 112\n"
    )
    few = ["--no-rgb", "--voxel", "1", "--workers", "1"]
    done = crowdfence("simulate", folder / "nobody.toml", "-o", folder / "nobody.mcap", *few)
    assert done.returncode == 0, done.stderr
    return folder / "nobody.mcap"


def test_ground_that_is_closed_for_nobody_is_told(without_crowds: Path, tmp_path: Path) -> None:
    """Of a mission without crowds nothing was: neither in the tables nor in the JSON."""
    words = ("evaluate", without_crowds, "--truth", "world", "-m", "or", "-m", "paper")
    done = crowdfence(*words, "--report", tmp_path / "report", "--json")
    assert done.returncode == 0, done.stderr
    by_or, by_paper = (row["safety"] for row in json.loads(done.stdout)["scores"])
    closed = _closed_m2(without_crowds)
    assert closed > 0.0 and by_or["closed_m2"][0] == closed
    assert by_or["closed_m2"] == sorted(by_or["closed_m2"]) and by_or["closed_m2"][2] > closed
    assert by_or["blocked_per_own"] == [None] * 4 and by_paper["closed_m2"] == [0.0] * 4
    page = (tmp_path / "report" / "index.html").read_text()
    assert f"<td>{by_or['closed_m2'][2]:.0f} m2</td>" in page and "<td>0 m2</td>" in page
    table = crowdfence(*words).stdout
    assert "Nobody of a crowd stood on ground in view" in table
    assert re.search(rf"or +{closed:.0f} m2 +\d+ m2 +{by_or['closed_m2'][2]:.0f} m2", table)


def _closed_m2(path: Path) -> float:
    """Columns of 1 m in which a voxel has a mean heatmap value above 0.5 in one look at least."""
    flight = cf.open_recording(path)
    terrain = cf.open_terrain(flight)
    (instant,) = flight.instants()
    looks = [cf.project(view, terrain, max_range_m=300.0) for view in instant.views(Frame.heatmap).views]
    called = np.concatenate([look.voxel_ids[look.mean > 0.5] for look in looks])
    return float(len(np.unique(terrain.voxel_indices(called)[:, :2], axis=0)))


def test_no_label_of_a_plot_is_not_a_number(without_crowds: Path) -> None:
    """ "mean nan" and "closes nan x" stood there of missions without crowds."""
    flight = cf.open_recording(without_crowds)
    terrain = cf.open_terrain(flight)
    configs = [cf.RunConfig(cf.PaperConfig())]
    rows = score(flight, terrain, configs, truth="world", with_measures=True).rows
    for draw in plots.DRAWN.values():
        axes = Figure().add_subplot()
        draw(axes, ["paper"], rows)
        assert not any("nan" in str(line.get_label()) for line in axes.lines)


def test_only_a_report_is_replaced(tmp_path: Path, race: tuple[object, ...]) -> None:
    (tmp_path / "mine.txt").write_text("keep me")
    refused = crowdfence(*race, *METHODS, "--report", tmp_path)
    assert refused.returncode == 1 and "mine.txt" in refused.stderr
    assert (tmp_path / "mine.txt").read_text() == "keep me"


def test_a_report_needs_people(tmp_path: Path) -> None:
    recording = write_airsim(tmp_path / "recording", flight())
    refused = crowdfence("evaluate", recording, "--detector", "recorded", "--report", tmp_path / "report")
    assert refused.returncode == 1 and "does not record where people are" in refused.stderr
    assert not (tmp_path / "report").exists()


def test_every_knob_can_be_turned(tmp_path: Path, race: tuple[object, ...]) -> None:
    methods = ("-m", "moving-average", "-m", "or")
    arguments = (*race, *methods, "--sweep", "--report", tmp_path / "report", "--json")
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
