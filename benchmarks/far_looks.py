"""What it is worth to look at far ground less often than at near: people in zones, ground closed, CPU time.

Simulated missions of ten pictures a second and drone, 640 x 480, of a seed that nothing was tuned to, which
the first call records into `out/`. Each is fused by `evidence` once for every interval.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path

from scene import machine

from crowdfence import Detector, open_recording
from crowdfence.config import RunConfig
from crowdfence.evaluation.replay import Score, score
from crowdfence.pipeline import heatmap_source, open_terrain

SCENARIOS = {"race": 80, "festival": 60, "street": 60, "beach": 60}
"""With their pictures a drone."""
SEED = 911
INTERVALS_S = (0.0, 0.25, 0.5)
BUFFERS = {0: "0 m", 2: "5 m"}
"""Columns of the table, by the places of `safety.BUFFERS_M`."""


def main() -> None:
    arguments = _arguments()
    print(f"{machine()}\n")
    print(
        "| mission | far ground | CPU a frame | mean IoU | "
        + _titles("people in zones")
        + _titles("closed / own")
    )
    print("|" + "---|" * (4 + 2 * len(BUFFERS)))
    for name in arguments.scenarios:
        path = Path(f"out/far-{name}.mcap")
        if not path.exists():
            size = ("--seed", str(SEED), "--frames", str(SCENARIOS[name]), "--size", "640x480")
            subprocess.run(
                [sys.executable, "-m", "crowdfence", "simulate", name, *size, "-o", str(path)], check=True
            )
        for far_every_s in INTERVALS_S:
            row, cpu_s = _scored(path, far_every_s)
            how = f"every {far_every_s:g} s" if far_every_s else "in every picture"
            print(
                f"| {name} | {how} | {cpu_s * 1e3:.0f} ms | {row.iou.mean:.3f} | {_of_people(row)}",
                flush=True,
            )


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenarios", nargs="*", default=list(SCENARIOS), help=f"of {', '.join(SCENARIOS)}")
    return parser.parse_args()


def _scored(path: Path, far_every_s: float) -> tuple[Score, float]:
    recording, config = open_recording(path), RunConfig()
    terrain = open_terrain(recording)
    detector = Detector(far_every_s=far_every_s)
    heatmaps = heatmap_source(detector, terrain, config.projection.max_range_m, whole=config.whole_looks)
    begun_s = time.process_time()
    scores = score(recording, terrain, [config], heatmaps, truth="world")
    return scores.rows[0], (time.process_time() - begun_s) / len(recording.frames)


def _titles(what: str) -> str:
    return "".join(f"{what}, {metres} around | " for metres in BUFFERS.values())


def _of_people(row: Score) -> str:
    assert row.safety is not None
    people, ground = row.safety.share_in_zone, row.safety.blocked_per_own
    numbers = [*(f"{people[at]:.3f}" for at in BUFFERS), *(f"{ground[at]:.2f}" for at in BUFFERS)]
    return " | ".join(numbers) + " |"


if __name__ == "__main__":
    main()
