"""`crowdfence demo`: the main job on the recording that comes with the package."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from crowdfence.atomic_file import writable_folder
from crowdfence.cli import options
from crowdfence.cli.run import fuse_and_report
from crowdfence.config import RunConfig, ZoneConfig

RECORDING = Path(__file__).parent.parent / "demo_data" / "race.mcap"
CONFIG = RunConfig(zones=ZoneConfig(min_area_m2=4.0))


def demo(
    output: Annotated[Path, typer.Option("--output", "-o", help="Folder for the results.")] = Path(
        "out/demo"
    ),
    as_json: options.Json = False,
) -> None:
    """Fuse the bundled recording: three drones above a mountain road with crowds at its side."""
    from crowdfence.pipeline import choose_detector, open_terrain
    from crowdfence.sources import open_recording

    with writable_folder(output, parents=True):
        recording = open_recording(RECORDING)
        terrain = open_terrain(recording)
        detector = choose_detector(recording, "auto")
        fuse_and_report(recording, terrain, CONFIG, output, detector=detector, as_json=as_json)
