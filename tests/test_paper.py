"""The paper's table by one command, on the bundled recording."""

import csv
import importlib.util
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

from crowdfence import (
    Detector,
    OrConfig,
    PaperConfig,
    ProjectionConfig,
    RunConfig,
    open_recording,
    open_terrain,
)
from crowdfence.evaluation.replay import score
from crowdfence.pipeline.detect import heatmap_source

ROOT = Path(__file__).parents[1]
DEMO = ROOT / "python" / "crowdfence" / "demo_data" / "race.mcap"


def reproduced(work: Path, results: Path) -> subprocess.CompletedProcess[str]:
    command = [ROOT / "paper" / "reproduce.py", "--quick", "--work", work, "-o", results]
    return subprocess.run(
        [sys.executable, *map(str, command)], check=False, timeout=600, capture_output=True, text=True
    )


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("paper")
    finished = reproduced(folder / "work", folder / "results")
    assert finished.returncode == 0, finished.stderr
    return folder / "results"


def rows(results: Path) -> list[dict[str, str]]:
    with (results / "table1.csv").open() as file:
        return list(csv.DictReader(file))


def test_the_table_has_the_settings_of_the_paper(results: Path) -> None:
    fifteen = {(a, d) for a in ("0.1", "0.2", "0.5", "0.8", "1.0") for d in ("0.0", "0.0005", "0.05")}
    five = {(alpha, decay) for alpha, decay in fifteen if decay == "0.0005"}
    neither = {("", "")}  # no fusion and evidence
    for detector, expected in (("the shipped detector", fifteen), ("weakened to the paper's", five)):
        settings = {(row["alpha"], row["decay"]) for row in rows(results) if row["detector"] == detector}
        assert settings == expected | neither
    assert (results / "figure3.png").stat().st_size > 10_000
    assert "What the paper leaves open" in (results / "table1.md").read_text()


def test_its_figures_are_those_of_evaluate(results: Path) -> None:
    recording = open_recording(DEMO)
    terrain = open_terrain(recording)
    literal = ProjectionConfig(coverage="rays", surface="voxels")
    # The rates of this projection, as paper/looks.py has them; the model states those of the default one.
    paper_config = PaperConfig(
        true_positive_rate=0.763017, false_positive_rate=0.00373697, alpha=0.2, decay=0.05
    )
    configs = [RunConfig(one, literal) for one in (OrConfig(), paper_config)]
    heatmaps = heatmap_source(Detector(), terrain, literal.max_range_m)
    baseline, paper = score(recording, terrain, configs, heatmaps).rows
    shipped = {row["setting"]: row for row in rows(results) if row["detector"] == "the shipped detector"}
    for name, expected in (("no fusion", baseline), ("alpha 0.2, decay 0.05", paper)):
        assert float(shipped[name]["mean_iou"]) == pytest.approx(expected.iou.mean, abs=1e-4)
        assert float(shipped[name]["std_iou"]) == pytest.approx(expected.iou.std, abs=1e-4)
        assert int(shipped[name]["frames"]) == len(expected.iou.per_frame)


def test_the_weakened_detector_is_weaker(results: Path) -> None:
    shipped, weakened = (float(row["mean_iou"]) for row in rows(results) if row["setting"] == "no fusion")
    assert weakened < 0.5 * shipped


def looks_of_the_paper() -> ModuleType:
    spec = importlib.util.spec_from_file_location("looks", ROOT / "paper" / "looks.py")
    assert spec is not None and spec.loader is not None
    looks = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(looks)
    return looks


def test_looks_of_another_weakening_or_other_rates_are_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever changed how much a detector misses, or its rates, had the table of before again."""
    looks = looks_of_the_paper()
    before = looks.Mission("bundled", DEMO, tmp_path)
    weakened = looks.Weakened(before)
    monkeypatch.setattr(looks.Mission, "rates", looks.Rates(0.8, 0.01))
    monkeypatch.setattr(looks.Weakened, "MISSED", 0.5)
    after = looks.Mission("bundled", DEMO, tmp_path)
    assert after.made_from == before.made_from and after.taken_as != before.taken_as
    assert looks.Weakened(before).taken_as != weakened.taken_as


def test_a_mission_of_other_pictures_is_another_mission(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What was kept of a short try stood in the table of the whole one."""
    looks = looks_of_the_paper()
    asked: list[list[str]] = []
    monkeypatch.setattr(looks.subprocess, "run", lambda command, check: asked.append(command))
    tried = [(7, 6, "64x48"), (7, 6, "320x240"), (7, 1056, "320x240"), (8, 1056, "320x240")]
    paths = [looks.simulated(*one, tmp_path) for one in [*tried, *tried]]
    assert len(set(paths)) == len(asked) == len(tried) and paths[:4] == paths[4:]


def test_what_was_kept_of_other_methods_and_looks_is_not_taken_for_these(
    results: Path, tmp_path: Path
) -> None:
    """Whoever changed a method, or took another detector, had the table of before again."""
    work = results.parent / "work"
    shipped = work / "bundled" / "shipped"
    shutil.copy(shipped / "alpha_1_decay_0.05.npz", shipped / "no_fusion.npz")
    assert reproduced(work, tmp_path / "again").returncode == 0
    assert (tmp_path / "again" / "table1.csv").read_text() == (results / "table1.csv").read_text()
    (shipped / "no_fusion.npz").unlink()
    (work / "bundled" / "made_from.txt").write_text("another")
    finished = reproduced(work, tmp_path / "other")
    assert finished.returncode == 1 and not (tmp_path / "other").exists()
    assert "bundled holds looks that another crowdfence, detector or mission has left" in finished.stderr
