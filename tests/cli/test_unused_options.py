"""Options that somebody gives and nobody would read are refused, whichever value they have."""

from pathlib import Path

import pytest
from typer.testing import CliRunner

from crowdfence.cli.app import app
from crowdfence.labelled_pictures.coco import ANNOTATIONS, write_coco


def refused(*words: str) -> str:
    done = CliRunner().invoke(app, list(words))
    assert isinstance(done.exception, ValueError), done.exception
    return str(done.exception)


@pytest.mark.parametrize(
    ("kind", "given", "users"),
    [
        ("geojson", ["--datum", "WGS84"], "ed318, ed269, ed269-list, csv"),
        ("qgc", ["--datum", "AGL"], "ed318, ed269, ed269-list, csv"),
        ("csv", ["--plan", "x.plan"], "qgc"),
        ("kml", ["--max-items", "63"], "qgc"),
        ("kml", ["--country", "GRC"], "ed318, ed269, ed269-list"),
        ("state", ["--authority", "me"], "ed318, ed269, ed269-list, f3548"),
        ("f3548", ["--contact", "a@b"], "ed318, ed269, ed269-list"),
    ],
)
def test_options_of_other_formats(tmp_path: Path, kind: str, given: list[str], users: str) -> None:
    message = refused("export", str(tmp_path), "-f", kind, "-o", str(tmp_path / "out"), *given)
    assert message == f"{given[0]} does nothing with --format {kind}; it is for {users}; leave it out"


def test_an_instant_of_a_file_that_holds_all(tmp_path: Path) -> None:
    words = ("export", str(tmp_path), "-f", "mcap", "-o", str(tmp_path / "out.mcap"))
    message = refused(*words, "--at", "first")
    assert message == "--at does nothing with --format mcap, which holds every instant; leave it out"


@pytest.mark.parametrize(
    ("method", "given"),
    [
        ("evidence", ["--alpha", ".5"]),
        ("evidence", ["--normalise"]),
        ("evidence", ["--decay", "0.0005"]),  # its default, and given all the same
        ("paper", ["--doubt", "1"]),
        ("paper", ["--opening-looks", "2"]),
        ("or", ["--prior", ".2"]),
        ("log-odds", ["--memory-s", "9"]),
    ],
)
@pytest.mark.parametrize("command", ["run", "serve"])
def test_options_of_other_methods(tmp_path: Path, command: str, method: str, given: list[str]) -> None:
    place = ["-o", str(tmp_path / "out")] if command == "run" else []
    message = refused(command, "nowhere.mcap", *place, "--method", method, *given)
    assert message.startswith(f"{given[0]} does nothing with --method {method}")


def test_options_of_a_method_are_taken(tmp_path: Path) -> None:
    """The recording is missed, so what was given before was no reason to stop."""
    out = ["-o", str(tmp_path / "out")]
    for words in (
        ["--method", "paper", "--alpha", ".5", "--prior", ".2"],
        ["--doubt", ".1", "--opening-looks", "2"],
    ):
        done = CliRunner().invoke(app, ["run", "nowhere.mcap", *out, *words])
        assert isinstance(done.exception, FileNotFoundError), done.exception


def test_what_shapes_zones_where_none_are_made(tmp_path: Path) -> None:
    common = ("run", "nowhere.mcap", "-o", str(tmp_path / "out"), "--layer", "vehicles")
    assert refused(*common, "--min-area-m2", "3").startswith(
        "--min-area-m2 does nothing with --layer vehicles"
    )
    assert refused(*common, "--close-unseen").startswith("--close-unseen does nothing with --layer vehicles")
    for given in ("--min-area-m2", "--off-threshold", "--opening-looks", "--stale-after-s"):
        message = refused("evaluate", "nowhere.mcap", "--layer", "vehicles", given, "1")
        assert message.startswith(
            f"{given} does nothing with --layer vehicles, of which no zones are counted"
        )


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (["nowhere.mcap", "--data", "x"], "--data does nothing for a recording that is replayed"),
        (["nowhere.mcap", "--clock", "views"], "--clock does nothing for a recording that is replayed"),
        (["--contract", "c.json"], "--contract does nothing for live views without --detector"),
        (["--far-every", "1"], "--far-every does nothing for live views without --detector"),
        (["--replay-speed", "2"], "--replay-speed does nothing for live views"),
        (["--ros-domain", "0"], "--ros-domain does nothing without --zenoh"),
        (["--mavlink-key", "x"], "--mavlink-key does nothing without --mavlink"),
    ],
)
def test_what_only_live_views_or_only_replays_take(given: list[str], why: str) -> None:
    assert refused("serve", *given).startswith(why)


@pytest.mark.parametrize(
    "given", [["--terrain", "dem.tif"], ["--voxel-size-m", "1"], ["--mount", "body:-90"]]
)
def test_what_pictures_without_poses_do_not_take(tmp_path: Path, given: list[str]) -> None:
    """A map tells their metres per pixel of pictures with poses only."""
    message = refused("detect", str(tmp_path), "-o", str(tmp_path / "out"), *given)
    assert message == f"{given[0]} does nothing for pictures without poses; leave it out"


@pytest.mark.parametrize(
    "given", [["--max-range-m", "50"], ["--target", "ground"], ["--target-height-m", "0"]]
)
def test_what_annotated_pictures_do_not_take(tmp_path: Path, given: list[str]) -> None:
    """Their labels are outlines in the pictures; nothing is projected."""
    write_coco([], tmp_path / ANNOTATIONS)
    message = refused("model", "evaluate", "--data", str(tmp_path), *given)
    assert message.startswith(f"{given[0]} does nothing for annotated pictures, which have neither poses")


def test_an_instant_of_a_file_that_has_one_only(tmp_path: Path) -> None:
    file = tmp_path / "zones.geojson"
    message = refused("fence", "push", str(file), "--link", "udpin:127.0.0.1:0", "--at", "first")
    assert message.startswith("--at does nothing with zones of one instant, as those of GeoJSON or a service")


@pytest.mark.parametrize(
    "given", [["--check-pixels"], ["--samples", "3"], ["--max-range-m", "50"], ["--tolerance-ms", "10"]]
)
def test_what_a_map_alone_does_not_take(tmp_path: Path, given: list[str]) -> None:
    path = tmp_path / "plain.obj"
    path.write_text("v 0 0 0\nv 9 0 0\nv 9 9 0\nf 1 2 3\n")
    message = refused("inspect", str(path), "--quick", *given)
    why = "with --quick" if "--samples" in given else f"with {path}, which is no recording"
    assert message.startswith(f"{given[0]} does nothing {why}")


@pytest.mark.parametrize(
    ("given", "why"),
    [
        (["-m", "evidence", "--alpha", ".5"], "--alpha does nothing with --method evidence"),
        (["-m", "or", "-m", "evidence", "--decay", "1"], "--decay does nothing with --method evidence, or"),
        (
            ["-m", "or", "--b-threshold", ".5"],
            "--b-threshold does nothing with --method or; --or-b-threshold",
        ),
        (
            ["-m", "or", "--threshold", ".3"],
            "--threshold does nothing with --method or; --or-b-threshold does",
        ),
        (["-m", "or", "--off-threshold", ".2"], "--off-threshold does nothing with --method or"),
        (["-m", "or", "--opening-looks", "2"], "--opening-looks does nothing with --method or"),
        (["-m", "evidence", "--fleet-size", "2"], "--fleet-size does nothing with --method evidence"),
        (["-m", "paper", "--far-every", "1"], "--far-every does nothing with --method paper"),
        (["-m", "paper", "--or-b-threshold", ".5"], "--or-b-threshold does nothing without --method or"),
        (["-m", "evidence", "--measured-rates"], "--measured-rates does nothing with --method evidence"),
        (["-m", "log-pool", "--measured-rates"], "--measured-rates does nothing with --method log-pool"),
        (["-m", "paper", "--measured-rates", "--tpr", ".8"], "--tpr does nothing with --measured-rates"),
        (["--measured-rates", "--fpr", ".1"], "--fpr does nothing with --measured-rates"),
    ],
)
def test_options_of_methods_that_are_not_scored(given: list[str], why: str) -> None:
    assert refused("evaluate", "nowhere.mcap", *given).startswith(why)
