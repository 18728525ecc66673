"""`crowdfence demo`: the main job on the recording that comes with the package."""

from __future__ import annotations

import shlex
import sys
from os.path import relpath
from pathlib import Path
from typing import Annotated

import typer

from crowdfence.cli import console, options
from crowdfence.cli.run import OpenReport, fuse_and_report, result_folder
from crowdfence.config import RunConfig

RECORDING = Path(__file__).parent.parent / "demo_data" / "race.mcap"


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "out/demo"
    ),
    show: OpenReport = False,
    force: options.Force = False,
    as_json: options.Json = False,
) -> None:
    """Fuse the bundled recording: three drones above a mountain road with crowds at its side."""
    from crowdfence.pipeline import choose_detector, read_map
    from crowdfence.sources import open_recording

    with result_folder(output, force=force):
        recording = open_recording(RECORDING)
        ground = read_map(recording)
        detector = choose_detector(recording, "auto")
        fuse_and_report(
            recording, ground, RunConfig(), output, detector=detector, force=force, as_json=as_json, show=show
        )
    if not as_json:
        how = console.escaped(serve_command())
        console.stdout().print(f"see it on the map page: [bold]{how}[/]", soft_wrap=True)


def serve_command() -> str:
    """To be pasted as it stands, whether or not the virtual environment is active."""
    called = Path(sys.argv[0])
    return shlex.join(
        [str(called) if called.name == "crowdfence" else "crowdfence", "serve", relpath(RECORDING)]
    )
