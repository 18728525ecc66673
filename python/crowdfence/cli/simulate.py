"""`crowdfence simulate`: a mission with ground truth, out of nothing."""

from __future__ import annotations

import re
import time
from contextlib import AbstractContextManager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.atomic_file import replaceable_file, writable_folder
from crowdfence.cli import console, options
from crowdfence.cli.exit_codes import INTERRUPTED

if TYPE_CHECKING:
    from crowdfence.simulation.recording.recorded import Recorded

_SCENARIO, _HOW = "Scenario", "Recording"


class RecordingFormat(str, Enum):
    mcap = "mcap"
    airsim = "airsim"


_FLAGS = {
    "drones": "--drones",
    "frames": "--frames",
    "fps": "--fps",
    "season": "--season",
    "looks": "--looks",
    "time_of_day_h": "--time-of-day",
    "voxel_size_m": "--voxel",
    "camera.width": "--size",
    "camera.height": "--size",
}
"""What a scenario calls the values that options replace."""
_OF_SCENARIOS = re.compile(rf"^({'|'.join(map(re.escape, _FLAGS))})(?= )")

_KEYS = re.compile(r"\b(georeference|voxel_size_m)\b")
"""What a scenario file calls as the library its arguments: in quotes it is no option of other commands."""


def _scenario_option(flag: str, text: str) -> Any:
    return typer.Option(flag, rich_help_panel=_SCENARIO, help=text)


def _how(flag: str, text: str) -> Any:
    return typer.Option(flag, rich_help_panel=_HOW, help=text)


def simulate(
    scenario: Annotated[
        str, typer.Argument(help="race, festival, street, beach, empty, or a scenario file (.toml).")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Mission file to write (.mcap), or folder for AirSim.")
    ],
    seed: Annotated[int, _scenario_option("--seed", "Another seed is another world.")] = 0,
    drones: Annotated[int | None, _scenario_option("--drones", "Number of drones.")] = None,
    frames: Annotated[int | None, _scenario_option("--frames", "Images per drone.")] = None,
    fps: Annotated[float | None, _scenario_option("--fps", "Images per second and drone.")] = None,
    size: Annotated[str | None, _scenario_option("--size", "Image size in pixels, such as 640x480.")] = None,
    season: Annotated[str | None, _scenario_option("--season", "summer, autumn, winter or dry.")] = None,
    looks: Annotated[
        str | None, _scenario_option("--looks", "natural, or random to train detectors on.")
    ] = None,
    time_of_day_h: Annotated[
        float | None, _scenario_option("--time-of-day", "Hour of the day, 0 to 24.")
    ] = None,
    voxel_size_m: Annotated[
        float | None, _scenario_option("--voxel", "Voxel size of the map in metres.")
    ] = None,
    no_trouble: Annotated[
        bool, _scenario_option("--no-trouble", "Perfect clocks, poses and links, whatever the scenario says.")
    ] = False,
    kind: Annotated[
        RecordingFormat, _how("--format", "Mission file or AirSim recording.")
    ] = RecordingFormat.mcap,
    no_rgb: Annotated[
        bool,
        _how("--no-rgb", "Labels, depth and truth alone, by raycasting: needs no OpenGL, leaves out trees."),
    ] = False,
    no_heatmaps: Annotated[
        bool,
        _how(
            "--no-heatmaps", "Leave out the heatmaps (of the shipped detector; with --no-rgb of a stand-in)."
        ),
    ] = False,
    layer: Annotated[
        list[str] | None,
        _how("--layer", "Record this layer too, with its truth: landing-site. May be repeated."),
    ] = None,
    workers: Annotated[int | None, _how("--workers", "Rendering processes. Default: one per core.")] = None,
    resume: Annotated[bool, _how("--resume", "Go on with an interrupted run of the same mission.")] = False,
    force: Annotated[bool, _how("--force", "Replace what is there.")] = False,
    as_json: options.Json = False,
) -> None:
    """Simulate a mission: pictures, labels, depth, poses, and where everybody really was.

    A scenario as it stands is a thousand pictures a drone, an hour on a laptop; --frames 20 --size 320x240
    --voxel 1 takes a minute. Ctrl-C leaves a readable recording that --resume goes on with.
    """
    from crowdfence.simulation.recording.frame_maker import FrameOptions
    from crowdfence.simulation.recording.helping_process import HelperKilled
    from crowdfence.simulation.recording.timeline_run import capture_counts
    from crowdfence.simulation.rendering.opengl_context import NoOpenGL
    from crowdfence.simulation.scenarios.plan_checks import ScenarioError
    from crowdfence.simulation.scenarios.scenario import TroublePlan
    from crowdfence.simulation.scenarios.scenario_file import load_scenario
    from crowdfence.simulation.scene import PARTS, build_scene
    from crowdfence.simulation.schedule import build_schedule

    if kind is RecordingFormat.mcap and output.suffix.lower() != ".mcap":
        raise ValueError(
            f"{output}: the name of a mission file ends in .mcap; --format airsim writes a folder"
        )
    if resume and force:
        raise ValueError("--resume goes on with what is there and --force replaces it: give one of them")
    if no_rgb:
        for flag, value in (("--season", season), ("--time-of-day", time_of_day_h)):
            if value is not None:
                raise ValueError(f"{flag} does nothing with --no-rgb, which makes no pictures; leave it out")
    options_of_frames = FrameOptions(
        rgb=not no_rgb, heatmaps=not no_heatmaps, layers=tuple(dict.fromkeys(layer or ()))
    )
    width, height = _size(size)
    try:
        loaded = load_scenario(
            scenario,
            drones=drones,
            frames=frames,
            fps=fps,
            camera={"width": width, "height": height} if width else None,
            season=season,
            looks=looks,
            time_of_day_h=time_of_day_h,
            voxel_size_m=voxel_size_m,
            trouble=TroublePlan() if no_trouble else None,
        )
    except ScenarioError as mistake:
        said = _OF_SCENARIOS.sub(lambda found: _FLAGS[found[0]], str(mistake))
        raise ValueError(_KEYS.sub(r'"\g<0>"', said)) from mistake
    record = _recorder(kind)
    started = time.perf_counter()
    with _writable(output, kind):
        with console.progress("building the scene", len(PARTS) + 1, "parts") as advance:
            scene = build_scene(loaded, seed, lambda part: advance())
            fates = capture_counts(build_schedule(scene)).values()
            advance()
        planned = sum(fate["delivered"] for fate in fates)
        if not planned:
            raise ValueError(
                f"{scenario}: no drone takes a picture that arrives in the {loaded.duration_s:g} s that the "
                "mission lasts: see joins_s, leaves_s and dropped of its trouble; --frames makes it longer, "
                "--no-trouble leaves them out"
            )
        with console.progress("writing the map, then simulating", planned, "frames") as advance:
            try:
                recorded = record(
                    scene,
                    output,
                    options=options_of_frames,
                    workers=workers,
                    resume=resume,
                    overwrite=force,
                    progress=lambda done, of: advance(),
                )
            except NoOpenGL as error:
                raise OSError(f"{error}: try --no-rgb") from error
            except HelperKilled as error:
                raise OSError(str(error)) from error
    _report(recorded, time.perf_counter() - started, as_json=as_json)
    if not recorded.complete:
        console.fail(
            f"interrupted after {recorded.frames} of {recorded.planned_frames} frames; "
            "the same command with --resume goes on"
        )
        raise typer.Exit(INTERRUPTED)


def _size(size: str | None) -> tuple[int, int]:
    """(width, height) of "640x480"; zeros for None."""
    if size is None:
        return 0, 0
    width, by, height = size.lower().partition("x")
    if not (by and width.isdecimal() and height.isdecimal() and int(width)):
        raise ValueError(f"--size is {size!r}, expected two numbers such as 640x480")
    return int(width), int(height)


def _writable(output: Path, kind: RecordingFormat) -> AbstractContextManager[None]:
    """The recorder says what may be replaced or gone on with. An AirSim folder that is not there yet is left
    to it too: it takes one for an earlier run."""
    if kind is RecordingFormat.mcap:
        return replaceable_file(output, force=True)
    return writable_folder(output if output.exists() else output.parent)


def _recorder(kind: RecordingFormat) -> Any:
    if kind is RecordingFormat.airsim:
        from crowdfence.simulation.recording.airsim_recorder import record_airsim

        return record_airsim
    from crowdfence.simulation.recording.mission_recorder import record_mission

    return record_mission


def _report(recorded: Recorded, seconds: float, *, as_json: bool) -> None:
    if as_json:
        console.print_json(
            {
                "recording": str(recorded.path),
                "bytes": recorded.size_bytes,
                "complete": recorded.complete,
                "frames": recorded.frames,
                "planned_frames": recorded.planned_frames,
                "resumed_frames": recorded.resumed_frames,
                "seconds": round(seconds, 3),
                "renderer": recorded.renderer,
                "terrain": [str(path) for path in recorded.terrain],
                "statistics": recorded.statistics,
            }
        )
        return
    console.stdout().print(console.facts(f"{recorded.path}", _facts(recorded, seconds)))


def _facts(recorded: Recorded, seconds: float) -> dict[str, str]:
    statistics = recorded.statistics
    made = recorded.frames - recorded.resumed_frames
    rows = {
        "frames": f"{recorded.frames} of {recorded.planned_frames}"
        + (f", {recorded.resumed_frames} of them taken over" if recorded.resumed_frames else ""),
        "time": f"{seconds:.1f} s" + (f", {1e3 * seconds / made:.0f} ms a frame" if made else ""),
        "size": f"{recorded.size_bytes / 1e6:.1f} MB"
        + (f", {recorded.size_bytes / recorded.frames / 1e6:.3f} MB a frame" if recorded.frames else ""),
        "made by": recorded.renderer,
        "map": ", ".join(path.name for path in recorded.terrain),
    }
    if statistics["class_share"] is not None:
        shares = ", ".join(f"{name} {share:.2%}" for name, share in statistics["class_share"].items())
        rows["pixels"] = shares
    overlap = statistics["overlap"]["overlapping_share_of_instants"]
    if overlap is not None:
        rows["overlap"] = f"two drones share ground in {overlap:.0%} of the instants"
    return rows
