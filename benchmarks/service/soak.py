"""The live service for an hour of flight, as fast as it goes: memory and disk stay bounded.

    python benchmarks/service/soak.py [--seconds 3600]

Three drones give five views a second over a plain; the clock is that of the views. History is kept for ten
minutes, in shorter runs for a sixth of them. In the second half neither the resident memory nor the files may
grow by more than a fifth; the slopes of both are told.
"""

import argparse
import os
import sys
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

sys.path.insert(0, str(Path(__file__).parents[2] / "tests"))

import numpy as np

from crowdfence.service.watch import Watch
from support.small_service import SETTINGS, message, running, settle, view

DRONES = ("uav1", "uav2", "uav3")
KEPT_S = 600.0
GROWTH = 1.2


def resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def disk_mb(folder: Path) -> float:
    return sum(path.stat().st_size for path in folder.iterdir()) / 1e6


def main(seconds: float) -> int:
    kept_s = min(KEPT_S, seconds / 6)
    settings = replace(SETTINGS, keep_s=kept_s, keep_media_mb=5.0, snapshot_every=200)
    instants = int(seconds * 5)
    figures = []
    with TemporaryDirectory() as name, running(Path(name), settings=settings) as service:
        watch = Watch(service)
        for number in range(instants):
            for drone in DRONES:
                # The flight begins again every ten seconds; stamps go on.
                service.live.intake.give_view(message(_at(drone, number)))
            if number % 100 == 99:
                settle(service)
            if number % 300 == 299:
                watch.look()
                watch.tidy()
                service.store.flush()
                figures.append((number / 300, resident_mb(), disk_mb(Path(name))))
                print(
                    "{:5.0f} min {:7.1f} MB memory {:7.1f} MB disk".format(*figures[-1]),
                    flush=True,
                )
    settled = [one for one in figures if one[0] * 60 >= seconds / 2] or figures[-1:]
    for column, what in ((1, "memory"), (2, "disk")):
        middle = np.median([one[column] for one in settled])
        print(f"second half: {what} {middle:.1f} MB, {_slope(settled, column):+.2f} MB an hour")
    first, last = settled[0], figures[-1]
    bounded = last[1] <= GROWTH * first[1] and last[2] <= GROWTH * first[2]
    print("bounded" if bounded else "GROWS")
    return 0 if bounded else 3


def _slope(figures: list[tuple[float, float, float]], column: int) -> float:
    """Of the straight line through them, an hour of flight."""
    minutes = np.array([one[0] for one in figures])
    if len(minutes) < 2:
        return 0.0
    return 60.0 * float(np.polyfit(minutes, [one[column] for one in figures], 1)[0])


def _at(drone: str, number: int):
    from crowdfence import View

    flown, now = view(drone, number % 50), view(drone, number)
    return View(drone, now.stamp_ns, flown.camera, flown.world_from_camera, flown.heatmap)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=float, default=3600.0)
    sys.exit(main(parser.parse_args().seconds))
