"""`--layer` from a simulated mission to sites and scores, as somebody who types it sees it."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import shapely
from affine import Affine
from typer.testing import CliRunner

import crowdfence as cf
from crowdfence.cli import source_options
from crowdfence.cli.app import app
from crowdfence.detector.shipped import shipped_model
from crowdfence.sources import Recording
from crowdfence.sources.recorded_truth import PeopleLog
from support.command_line import crowdfence
from support.onnx_models import contract as document
from support.onnx_models import write_map_model

ONE_FILE = ("--files", "sites.geojson")
SMALL = ("--no-rgb", "--frames", 3, "--size", "160x128", "--drones", 2, "--voxel", 2, "--workers", 1)


@pytest.fixture(scope="module")
def mission(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("layers") / "fair.mcap"
    done = crowdfence("simulate", "festival", "-o", path, "--layer", "landing-site", "--seed", 5, *SMALL)
    assert done.returncode == 0, done.stderr
    return path


@pytest.fixture(scope="module")
def sites(mission: Path) -> Path:
    folder = mission.parent / "sites"
    done = crowdfence("run", mission, "-o", folder, "--layer", "landing-site")
    assert done.returncode == 0, done.stderr
    assert "sites may lie inside one" in done.stdout.replace("\n", " ")
    return folder


def test_the_layer_lies_beside_the_crowds(mission: Path) -> None:
    recording = cf.open_recording(mission)
    frame = recording.of_layer("landing-site").frames[0]
    assert recording.layers == ("landing-site",)
    # The stand-in knows the truth, with mistakes: it says more where the labels do.
    fits = frame.regions().reshape(32, 4, 40, 4).mean(axis=(1, 3))
    says = frame.heatmap() / 255
    assert says[fits == 255].mean() > 0.7 and says[fits == 0].mean() < 0.3
    # Nobody stands on ground that is fit, and it is at least 5 m away.
    ground = recording.layer_grounds["landing-site"]
    people = recording.people_truth(recording.people.stamps_ns[0])
    assert people is not None and len(people.position) > 50
    assert not ground.values_at(ground.without(people.position), people.position[:, :2].astype(float)).any()
    assert 0.3 < ground.cells.mean() < 0.95


def test_sites_are_written_and_nothing_that_closes_ground(sites: Path) -> None:
    names = {path.name for path in sites.iterdir()}
    assert {"sites.geojson", "layer_map.tif", "layer_map.png", "layer_map.ot", "summary.json"} <= names
    assert not names & {"zones.geojson", "crowd_map.tif", "zone_history.jsonl"}
    told = json.loads((sites / "sites.geojson").read_text())
    summary = json.loads((sites / "summary.json").read_text())
    assert told["crowdfence"]["layer"] == summary["layer"] == "landing-site"
    assert len(told["features"]) == len(summary["sites"]) > 0
    assert all(feature["properties"]["radius_m"] >= 2.0 for feature in told["features"])
    with rasterio.open(sites / "layer_map.tif") as raster:
        assert raster.tags()["LAYER"] == "landing-site" and "landing-site" in raster.descriptions[0]
        assert "4 = landing-site" in raster.tags(2)["VALUES"]
        assert np.isnan(raster.read(1)).any()


def test_a_threshold_below_the_prior_is_told(mission: Path, tmp_path: Path) -> None:
    """Of landing sites a quarter: at .2 looks may speak against the ground of a site."""
    for threshold, is_told in ((0.2, True), (0.25, False)):
        folder = tmp_path / f"{threshold}"
        done = crowdfence(
            "run",
            mission,
            "-o",
            folder,
            "--layer",
            "landing-site",
            "--threshold",
            threshold,
            *ONE_FILE,
            "--json",
        )
        warnings = json.loads(done.stdout)["warnings"]
        told = [
            one for one in warnings if "the threshold 0.2 of landing sites is below the prior 0.25" in one
        ]
        assert len(told) == is_told


@pytest.mark.parametrize("command", [("export", "-f", "geojson", "-o", "a"), ("explain", "--zone", "Z1")])
def test_what_is_made_of_zones_says_that_a_layer_has_none(
    sites: Path, tmp_path: Path, command: tuple[str, ...]
) -> None:
    """It was told to be no folder of a run."""
    name, *rest = (str(tmp_path / word) if word == "a" else word for word in command)
    done = crowdfence(name, sites, *rest)
    assert done.returncode == 1 and "with --layer 'landing-site', of which no zones are made" in done.stderr
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "summary.json").write_text("[]")
    done = crowdfence(name, tmp_path / "other", *rest)
    assert done.returncode == 1 and "is it a folder that crowdfence run wrote?" in done.stderr


def test_a_method_that_keeps_what_it_once_found_is_refused_for_sites(mission: Path, tmp_path: Path) -> None:
    done = crowdfence("run", mission, "-o", tmp_path / "out", "--layer", "landing-site", "--method", "or")
    assert done.returncode != 0 and "never takes back" in done.stderr.replace("\n", " ")
    assert not (tmp_path / "out").exists()


def test_sites_smaller_than_the_least_area_are_left_out(mission: Path, sites: Path, tmp_path: Path) -> None:
    found = [site["area_m2"] for site in json.loads((sites / "summary.json").read_text())["sites"]]
    least_m2 = sorted(found)[len(found) // 2]
    done = crowdfence(
        "run", mission, "-o", tmp_path / "out", "--layer", "landing-site", "--min-area-m2", least_m2,
        *ONE_FILE, "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    left = [site["area_m2"] for site in json.loads(done.stdout)["sites"]]
    assert sorted(left) == sorted(area for area in found if area >= least_m2)


def test_zones_keep_sites_out(mission: Path, sites: Path, tmp_path: Path) -> None:
    first = json.loads((sites / "sites.geojson").read_text())["features"][0]
    zone = tmp_path / "closed.geojson"
    zone.write_text(json.dumps({"type": "Feature", "geometry": first["geometry"], "properties": {}}))
    done = crowdfence(
        "run", mission, "-o", tmp_path / "out", "--layer", "landing-site", "--static-zones", zone,
        "--files", "sites.geojson", "--files", "layer_map.tif", "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["closed_zones"] >= 1
    written = {path.name for path in (tmp_path / "out").iterdir()}
    assert written == {"sites.geojson", "layer_map.tif", "summary.json"}
    closed = shapely.geometry.shape(first["geometry"])
    for feature in json.loads((tmp_path / "out" / "sites.geojson").read_text())["features"]:
        assert shapely.disjoint(shapely.geometry.shape(feature["geometry"]), closed)
    # The band that says what zones close: ground that is fit, and closed.
    with rasterio.open(tmp_path / "out" / "layer_map.tif") as raster:
        told, state = raster.read(2), raster.read(3)
        assert "6 = CLOSED by a zone" in raster.tags(2)["VALUES"] and "6 =" not in raster.tags(3)["VALUES"]
    centre = first["properties"]["centre"]
    with rasterio.open(sites / "layer_map.tif") as raster:
        local = Affine(*json.loads(raster.tags()["LOCAL_FROM_CELLS"]))
    column, row = ~local @ (centre["x"], centre["y"])
    assert (told[int(row), int(column)], state[int(row), int(column)]) == (6, 4)
    assert (told[state == 4] == 6).sum() >= 0.9 * first["properties"]["area_m2"] / abs(local.a * local.e)


def test_a_layer_is_scored_like_crowds(mission: Path, tmp_path: Path) -> None:
    done = crowdfence(
        "evaluate", mission, "--layer", "landing-site", "--truth", "world", "-m", "evidence", "-m", "or",
        "--report", tmp_path / "report", "--json",
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["layer"] == "landing-site" and told["truth"] == "world"
    for score in told["scores"]:
        assert 0.2 < score["best_mean_iou"] <= 1.0 and score["safety"] is None
        measures = score["measures"]
        assert 0.5 < measures["average_precision"] <= 1.0 and measures["people"] > 0
    # `or` never forgets; of the people on ground in view hardly anybody stands where `evidence` would land.
    assert told["scores"][0]["measures"]["share_of_people_on_called"] < 0.02
    page = (tmp_path / "report" / "index.html").read_text()
    assert "people on it" in page and "Who stands in a zone" not in page
    assert (tmp_path / "report" / "reliability.png").exists()


def test_a_report_of_a_layer_needs_no_people(
    mission: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    opened = source_options.open_source

    def without_people(*told: Any) -> Recording:
        return replace(opened(*told), people=PeopleLog())

    monkeypatch.setattr(source_options, "open_source", without_people)
    asked = [
        "evaluate",
        str(mission),
        "--layer",
        "landing-site",
        "-m",
        "or",
        "--report",
        str(tmp_path / "out"),
    ]
    done = CliRunner().invoke(app, asked)
    assert done.exit_code == 0, done.exception
    assert "people on it" in (tmp_path / "out" / "index.html").read_text()


def test_what_a_layer_is_refused(mission: Path, tmp_path: Path) -> None:
    unknown = crowdfence("run", mission, "-o", tmp_path / "out", "--layer", "smoke")
    assert unknown.returncode == 2 or unknown.returncode == 1
    assert "it holds crowd, landing-site" in unknown.stderr.replace("\n", " ")
    assert not (tmp_path / "out").exists()
    shipped = crowdfence(
        "run", mission, "-o", tmp_path / "out", "--layer", "landing-site", "--detector", "crowdnet-s"
    )
    assert shipped.returncode != 0 and "finds crowds, not the layer" in shipped.stderr.replace("\n", " ")
    # The same model by its file, beside another one, and any that counts people.
    own = write_map_model(tmp_path / "own.onnx", document(name="own"))
    people = write_map_model(tmp_path / "people.onnx", document("density", name="counter"))
    for models, found in (
        ([shipped_model()], "the detector crowdnet-s finds crowds"),
        ([own, "crowdnet-s"], "the detector crowdnet-s finds crowds"),
        ([people], "the detector counter finds people"),
    ):
        words = [word for model in models for word in ("--detector", model)]
        done = crowdfence("run", mission, "-o", tmp_path / "out", "--layer", "landing-site", *words)
        assert done.returncode == 1 and f"{found}, not the layer 'landing-site'" in done.stderr
        assert not (tmp_path / "out").exists()
    wrong = crowdfence("simulate", "empty", "-o", tmp_path / "m.mcap", "--layer", "smoke")
    assert wrong.returncode != 0 and "no layer 'smoke' can be simulated" in wrong.stderr.replace("\n", " ")


def test_inspect_names_the_layers(mission: Path) -> None:
    done = crowdfence("inspect", mission, "--check-pixels", "--json")
    told = json.loads(done.stdout)
    assert told["layers"] == ["landing-site"] and told["damaged"] == []
