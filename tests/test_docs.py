"""Every command and every snippet of the pages in docs/ runs, in the order in which a reader meets them.

The pages name files that a reader would have: `flight.mcap`, `dem.tif`, `log.csv` with its pictures.
"""

import contextlib
import csv
import importlib.metadata
import importlib.util
import inspect
import io
import itertools
import json
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import rasterio
import yaml
from PIL import Image
from rasterio.rio.main import main_group as rio

import crowdfence
from crowdfence import open_recording
from crowdfence.cli.app import app
from crowdfence.cli.command_line import command_line
from crowdfence.cli.options import DEFAULT
from crowdfence.cli.reference import reference
from crowdfence.exports.report.page import STATES
from crowdfence.sources.convert import convert
from crowdfence.voxel_state import VoxelState
from crowdfence.zones.reasons import REASONS
from crowdfence.zones.safety_distance import RULES, safety_distance_m
from support.served import serving
from support.small_recordings import flight, write_folder

DOCS = Path(__file__).parents[1] / "docs"
PAGES = [
    "quick-start",
    "concepts",
    "maps",
    "own-recording",
    "states",
    "wrong-place",
    "frames",
    "methods",
    "zones",
    "foxglove",
]
NOT_RUN = ("source ", "export ")
ASCII_GRID = "ncols 2\nnrows 2\nxllcorner 0\nyllcorner 0\ncellsize 1\n5 5\n5 5\n"


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a reader's own files."""
    folder = tmp_path_factory.mktemp("desk")
    convert(open_recording(write_folder(folder / "plain", flight())), folder / "flight.mcap")
    write_dem(folder / "dem.tif")
    (folder / "tiles").mkdir()
    write_dem(folder / "tiles" / "1.tif")
    (folder / "other.asc").write_text(ASCII_GRID)
    write_log(folder)
    return folder


def write_dem(path: Path) -> None:
    """600 x 600 m of level ground, 25 m below the origin of the flight."""
    crs = "+proj=aeqd +lat_0=46.5 +lon_0=8 +datum=WGS84"
    transform = rasterio.transform.from_origin(-550.0, 420.0, 1.0, 1.0)
    profile = {"driver": "GTiff", "count": 1, "dtype": "float32", "crs": crs, "transform": transform}
    with rasterio.open(path, "w", width=600, height=600, **profile) as raster:
        raster.write(np.full((600, 600), 1175.0, np.float32), 1)


def write_log(folder: Path) -> None:
    """Six pictures of noise: 0.2 s apart, to the north-east, looking east and 60 degrees down."""
    names = ("time_s", "east_m", "north_m", "up_m", "heading_deg", "pitch_deg", "picture")
    noise = np.random.default_rng(5)
    with (folder / "log.csv").open("w", newline="") as file:
        rows = csv.writer(file)
        rows.writerow(names)
        for k in range(6):
            pixels = noise.integers(90, 140, (480, 640, 3), dtype=np.uint8)
            Image.fromarray(pixels).save(folder / f"{k}.jpg")
            rows.writerow([1760000000 + 0.2 * k, 3.0 * k, 4.0 * k, 15.0, 90.0, -60.0, f"{k}.jpg"])


def blocks(page: str) -> list[tuple[str, str]]:
    """(language, code) of every fenced block of a page."""
    return re.findall(r"^```(\w*)\n(.*?)^```", (DOCS / f"{page}.md").read_text(), re.DOTALL | re.MULTILINE)


@pytest.mark.parametrize("page", PAGES)
def test_what_a_page_shows_runs(desk: Path, page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    run_page(desk, page, monkeypatch)


def run_page(desk: Path, page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(desk)
    if page == "quick-start":
        # The demo with its recorded heatmaps: tests/cli/test_commands.py runs it as it is.
        monkeypatch.setattr("crowdfence.pipeline.choose_detector", lambda *_, **__: None)
    for language, code in blocks(page):
        run_block(page, language, code)


def run_block(page: str, language: str, code: str) -> None:
    if language == "python":
        exec(compile(code, f"{page}.md", "exec"), {"__name__": "__main__"})
        return
    if not language:  # a drawing
        return
    assert language == "sh", f"{page}.md: code of kind {language!r} is run by nobody"
    for line in code.splitlines():
        if not line.startswith(NOT_RUN):
            run(line)


def test_tiles_that_the_page_of_maps_joins_and_cuts_keep_unit_and_scale(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """They would be feet taken for metres otherwise, and centimetres."""
    monkeypatch.chdir(tmp_path)
    Path("tiles").mkdir()
    write_dem(Path("tiles/1.tif"))
    Path("other.asc").write_text(ASCII_GRID)
    with rasterio.open("tiles/1.tif", "r+") as tile:
        tile.units, tile.scales, tile.offsets = ("ft",), (0.01,), (1000.0,)
    for language, code in blocks("maps"):
        if "tiles/" in code:
            run_block("maps", language, code)
    with rasterio.open("flight.tif") as made:
        assert (made.units, made.scales, made.offsets) == (("ft",), (0.01,), (1000.0,))


def run(line: str) -> None:
    program, *words = shlex.split(line)
    if program == "rio":
        files = [sorted(map(str, Path().glob(word))) if "*" in word else [word] for word in words]
        rio(list(itertools.chain(*files)), standalone_mode=False)
        return
    assert program == "crowdfence", line
    with (
        contextlib.redirect_stdout(io.StringIO()) as out,
        contextlib.redirect_stderr(io.StringIO()) as err,
        pytest.raises(SystemExit) as left,
    ):
        try:
            command_line(app)(words)
        except (ValueError, OSError) as error:
            pytest.fail(f"{line}: {error}")
    assert left.value.code == 0, f"{line}\n{out.getvalue()}{err.getvalue()}"


def test_the_client_on_the_page_of_the_service_gives_a_view_and_hears_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (code,) = [code for language, code in blocks("service") if language == "python"]
    heard: list[str] = []
    endless = crowdfence.Client.stream

    def two(client: crowdfence.Client) -> Iterator[dict[str, Any]]:
        for message in itertools.islice(endless(client), 2):
            heard.append(message["type"])
            yield message

    monkeypatch.setattr(crowdfence.Client, "stream", two)
    with serving(tmp_path) as served:
        here = code.replace("http://127.0.0.1:8080", served.url)
        assert here != code
        exec(compile(here, "service.md", "exec"), {})
    assert heard == ["hello", "step"]
    told = re.findall(r"\w+", code.rpartition("# ")[2])
    assert set(heard) <= set(told) == {"hello", "step", "alert", "mode", "ping"}


def test_the_csv_becomes_a_recording_that_looks_where_it_says(
    desk: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Heading 90 and pitch -60: half of forward is east, the rest is down; right is south."""
    if not (desk / "myflight").exists():  # the test of the page was not run before this one
        run_page(desk, "own-recording", monkeypatch)
    recording = open_recording(desk / "myflight")
    assert len(recording.frames) == 6 and recording.refused == () and recording.warnings == ()
    pose = recording.frames[2].world_from_camera
    np.testing.assert_allclose(pose[:3, 3], [6.0, 8.0, 15.0], atol=1e-6)
    np.testing.assert_allclose(pose[:3, 2], [0.5, 0.0, -np.sqrt(0.75)], atol=1e-6)
    np.testing.assert_allclose(pose[:3, 0], [0.0, -1.0, 0.0], atol=1e-6)
    assert json.loads((desk / "out" / "myflight" / "summary.json").read_text())["frames"] == {"uav1": 6}


def test_every_page_is_in_the_contents_of_the_site() -> None:
    contents = yaml.safe_load((DOCS.parent / "mkdocs.yml").read_text())
    listed = list(_pages(contents["nav"]))
    assert [page for page in listed if not (DOCS.parent / page).is_file()] == []
    places = ("docs", "benchmarks", "crates", "paper", "reference", "training")  # what the Makefile lays out
    pages = {path for place in places for path in (DOCS.parent / place).rglob("*.md")}
    assert {"README.md", "ARCHITECTURE.md", *(str(path.relative_to(DOCS.parent)) for path in pages)} == {
        *listed
    }
    assert len(listed) == len(set(listed))


def _pages(nav: object) -> Iterator[str]:
    if isinstance(nav, str):
        yield nav
    for entry in nav if isinstance(nav, list) else nav.values() if isinstance(nav, dict) else ():
        yield from _pages(entry)


def test_the_site_asks_nothing_of_other_hosts() -> None:
    contents = yaml.safe_load((DOCS.parent / "mkdocs.yml").read_text())
    assert contents["theme"]["font"] is False
    assert not any("://" in sheet for sheet in contents["extra_css"]) and "extra_javascript" not in contents


def test_the_reference_of_names_is_current_and_whole() -> None:
    specification = importlib.util.spec_from_file_location("api_reference", DOCS / "api_reference.py")
    assert specification is not None and specification.loader is not None
    made = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(made)
    page = (DOCS / "api.md").read_text()
    assert page == made.reference(), "run `make api-reference`"
    for name in ("View", "CrowdMap", "Observation", "Paper", "FrameLoop", "Detector"):
        assert f"\n    {name}(" in page, f"how a {name} is made"
    named = [name for names in made.GROUPS.values() for name in names]
    assert sorted([*named, "__version__"]) == sorted(crowdfence.__all__)


def test_the_reference_of_commands_is_current() -> None:
    assert (DOCS / "cli.md").read_text() == reference(), "run `make cli-reference`"
    # What an option takes stands beside it; a switch takes nothing.
    for cell in (
        "| `--surface` `{planes,voxels}` |",
        "| `--from` `LAT,LON` |",
        "| `--output`, `-o` `<path>` |",
        "| `--max-vertices` `<int>` |",
        "| `--link` `udpin/udpout/tcp:HOST:PORT` |",
        "| `--topics` `ROLE=TOPIC,...` |",
        "| `--detector` `MODEL...` |",
        "| `--force` |",
    ):
        assert cell in reference(), cell


def test_the_page_of_zones_has_every_safety_distance_with_its_keys() -> None:
    rows = re.findall(
        r"^\| `([a-z0-9-]+):([^`]*)` \| ([^|]*) \|", (DOCS / "zones.md").read_text(), re.MULTILINE
    )
    assert {kind for kind, _, _ in rows} == set(RULES)
    for kind, example, keys in rows:
        parameters = inspect.signature(RULES[kind]).parameters.values()
        told = dict(pair.partition("=")[::2] for pair in re.findall(r"`([^`]+)`", keys))
        assert [*told] == [one.name for one in parameters]
        for one in parameters:
            default = "" if one.default is inspect.Parameter.empty else one.default
            shown = f"{default:.3g}" if isinstance(default, float) else str(default).lower()
            assert told[one.name] == shown, (kind, one.name)
        assert safety_distance_m([f"{kind}:{example}"]) > 0.0


def test_the_states_and_bounds_on_the_pages_are_those_of_the_code() -> None:
    table = (DOCS / "states.md").read_text()
    numbers = dict(re.findall(r"^\| ([a-z ]+?)(?: \(occluded\))? \| (\d) \|", table, re.MULTILINE))
    names = {state: name.removeprefix("looked at, ") for state, (name, _) in STATES.items()}
    assert {names[state]: str(int(state)) for state in VoxelState} == numbers
    reasons = re.findall(r"^\| ([^|]*) \|", table.partition("| it says |")[2], re.MULTILINE)
    assert reasons == [*REASONS.values()]
    assert DEFAULT.zones.stale_after_s > 0


def test_sections_that_are_linked_exist() -> None:
    for path in DOCS.glob("*.md"):
        for target, section in re.findall(r"\]\(([\w-]*\.?m?d?)#([\w-]+)\)", path.read_text()):
            page = (path.parent / target) if target else path
            headings = re.findall(r"^#+ (.*)$", page.read_text(), re.MULTILINE)
            anchors = {
                re.sub(r"[^\w -]", "", heading).strip().lower().replace(" ", "-") for heading in headings
            }
            assert section in anchors, f"{path.name}: {target}#{section}"


def test_the_page_of_installing_has_every_extra_and_a_unit_with_options_that_exist() -> None:
    page = (DOCS / "install.md").read_text()
    listed = re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)
    assert listed == sorted(importlib.metadata.metadata("crowdfence").get_all("Provides-Extra"))
    unit = dict(blocks("install"))["ini"].replace("\\\n", "")
    told = re.search(r"^ExecStart=\S*/crowdfence serve (.*)", unit, re.MULTILINE)
    assert told is not None
    options = re.findall(r"--[\w-]+", told[1])
    serve = reference().split("### crowdfence serve\n")[1].split("\n##")[0]
    assert len(options) == 8 and [option for option in options if f"`{option}" not in serve] == []
