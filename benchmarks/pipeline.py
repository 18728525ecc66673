"""From picture to zone: what every stage costs a frame, how many frames a second come through, how old a zone
is when it is made.

A simulated race of three drones at 640 x 480, recorded on the first call. Stages are measured one after the
other, so that the CPU time of a stage shows whether the core used more than one thread for it. A run and a
replay are then measured whole, as users start them.
"""

from __future__ import annotations

import argparse
import cProfile
import os
import pstats
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from scene import machine

from crowdfence import CrowdMap, Recording, Terrain, open_recording, project
from crowdfence.config import OrConfig, PaperConfig, RunConfig
from crowdfence.detector.detector import Detector
from crowdfence.detector.inference.picture_parts import Enlarge
from crowdfence.evaluation.replay import score
from crowdfence.pipeline import FrameLoop, HeatmapSource, heatmap_source, open_terrain, run
from crowdfence.pipeline.detect import RECORDED
from crowdfence.pipeline.far_looks import FarLooks
from crowdfence.pipeline.run import frame_row
from crowdfence.results import write_results
from crowdfence.sources.recording import Instant
from crowdfence.zones import find_zones

RECORDING = Path("out/race-640x480.mcap")
SIMULATE = ("simulate", "race", "--seed", "11", "--frames", "80", "--size", "640x480")
CONFIG = RunConfig()
LOOKS: dict[str, tuple[float, Enlarge]] = {
    "shipped model": (0.0, "always"),
    "shipped model, --enlarge affordable": (0.0, "affordable"),
    "shipped model, --enlarge never": (0.0, "never"),
    "shipped model, --far-every 0.25": (0.25, "always"),
}
"""Seconds from one look at far ground to the next, and whether that is enlarged."""
AROUND_M = 5.0  # of the step that keeps a safety distance
HOTTEST = 15


def main() -> None:
    arguments = _arguments()
    if not arguments.recording.exists():
        command = [sys.executable, "-m", "crowdfence", *SIMULATE, "-o", str(arguments.recording)]
        subprocess.run(command, check=True)
    recording = open_recording(arguments.recording)
    recording = replace(recording, frames=recording.frames[: arguments.frames])
    terrain = open_terrain(recording)
    print(
        f"{recording.name}: {len(recording.drones)} drones, {len(recording.frames)} frames, "
        f"{terrain.voxel_count / 1e6:.1f} M voxels of {terrain.voxel_size_m:g} m; {machine()}, "
        f"load {os.getloadavg()[0]:.1f}\n"
    )
    models = {"as recorded": RECORDED}
    if not arguments.recorded:
        models |= {
            name: heatmap_source(_detector(name), terrain, CONFIG.projection.max_range_m, whole=False)
            for name in LOOKS
        }
    _print_stages(recording, terrain, models)
    for name, heatmaps in models.items():
        _print_whole(recording, terrain, name, heatmaps)
    _print_replay(recording, terrain)
    _print_results(recording, terrain)
    _print_python(recording, terrain)


def _detector(name: str) -> Detector:
    far_every_s, enlarge = LOOKS[name]
    return Detector(far_every_s=far_every_s, enlarge=enlarge)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("recording", type=Path, nargs="?", default=RECORDING)
    parser.add_argument("--frames", type=int, help="take no more than these; default: all")
    parser.add_argument("--recorded", action="store_true", help="leave the detector out")
    return parser.parse_args()


@dataclass(slots=True)
class Stage:
    """CPU time of all threads and wall time, summed."""

    cpu_s: float = 0.0
    wall_s: float = 0.0

    @contextmanager
    def running(self) -> Iterator[None]:
        cpu_s, wall_s = time.process_time(), time.perf_counter()
        yield
        self.cpu_s += time.process_time() - cpu_s
        self.wall_s += time.perf_counter() - wall_s


@dataclass(slots=True)
class Stages:
    """The pipeline taken apart. `step` is one frame loop's, everything behind the projection."""

    recording: Recording
    terrain: Terrain
    by_name: dict[str, Stage] = field(default_factory=dict)

    def measure(self, models: dict[str, HeatmapSource]) -> int:
        """Every frame through every stage; the voxels seen so far at the end."""
        loop = _loop(self.recording, self.terrain, RECORDED)
        zones = replace(CONFIG.zones, buffer_m=AROUND_M)
        around = _loop(self.recording, self.terrain, RECORDED, replace(CONFIG, zones=zones))
        beside = CONFIG.with_detector(None).crowd_map(self.terrain, len(self.recording.drones))
        far = {name: heatmaps.far_looks() for name, heatmaps in models.items()}
        for instant in self.recording.instants():
            self._read(instant, models, far)
            self._fuse(instant, loop, around, beside)
        return loop.crowd_map.seen_count

    def _stage(self, name: str) -> Stage:
        return self.by_name.setdefault(name, Stage())

    def _read(self, instant: Instant, models: dict[str, HeatmapSource], far: dict[str, FarLooks]) -> None:
        if "shipped model" in models:
            with self._stage("decode picture").running():
                pictures = [frame.image() for frame in instant.frames]
            del pictures
            for name in LOOKS:
                with self._stage(f"decode picture and detect, {name}").running():
                    for frame in instant.frames:
                        near = models[name].leaves_far_out(frame, far[name])
                        models[name].look(frame, near=near)
        with self._stage("decode heatmap").running():
            for frame in instant.frames:
                frame.heatmap()

    def _fuse(self, instant: Instant, loop: FrameLoop, around: FrameLoop, beside: CrowdMap) -> None:
        views = instant.views().views
        how = {"max_range_m": beside.max_range_m, "target_height_m": beside.target_height_m}
        with self._stage("project").running():
            seen = [project(view, self.terrain, coverage=beside.coverage, **how) for view in views]
        with self._stage("step without projection").running():
            loop.step_observed(seen, instant.stamp_ns)
        with self._stage(f"the same, {AROUND_M:g} m around every crowd closed").running():
            around.step_observed(seen, instant.stamp_ns)
        with self._stage("- fuse").running():
            beside.integrate_observations(seen, instant.stamp_ns)
        with self._stage("- zones").running():
            find_zones(beside, instant.stamp_ns)


def _print_stages(recording: Recording, terrain: Terrain, models: dict[str, HeatmapSource]) -> None:
    stages = Stages(recording, terrain)
    seen = stages.measure(models)
    print(f"| stage ({seen / 1e6:.2f} M voxels seen at the end) | CPU | wall |\n|---|---|---|")
    for name, stage in stages.by_name.items():
        print(f"| {name} | {_a_frame(stage.cpu_s, recording)} | {_a_frame(stage.wall_s, recording)} |")
    print()


def _a_frame(seconds: float, recording: Recording) -> str:
    return f"{seconds / len(recording.frames) * 1e3:.2f} ms"


def _print_whole(recording: Recording, terrain: Terrain, name: str, heatmaps: HeatmapSource) -> None:
    """`pipeline.run`, then each instant by itself for its latency."""
    whole, detector = Stage(), None if heatmaps is RECORDED else _detector(name)
    with whole.running():
        run(recording, terrain, CONFIG, detector=detector)
    before = Stage()
    with before.running():
        loop = _loop(recording, terrain, heatmaps)
    p50, p99 = np.percentile(_latency_ms(recording, loop, heatmaps), [50, 99])
    print(
        f"run, heatmaps {name}: {len(recording.frames) / (whole.wall_s - before.wall_s):.1f} frames/s after "
        f"{before.wall_s:.1f} s for the prior, CPU {_a_frame(whole.cpu_s - before.cpu_s, recording)} each; "
        f"from the arrival of an instant to its zones p50 {p50:.0f} ms, p99 {p99:.0f} ms"
    )


def _loop(
    recording: Recording, terrain: Terrain, heatmaps: HeatmapSource, config: RunConfig = CONFIG
) -> FrameLoop:
    config = config.with_detector(heatmaps.contract)
    return FrameLoop(config.crowd_map(terrain, len(recording.drones)), config.zones)


def _latency_ms(recording: Recording, loop: FrameLoop, heatmaps: HeatmapSource) -> list[float]:
    latency_ms, far = [], heatmaps.far_looks()
    for instant in recording.instants():
        arrived = time.perf_counter()
        ((_, found),) = heatmaps.detected([instant], len(recording.drones), far=far)
        loop.step(found.views, instant.stamp_ns)
        latency_ms.append((time.perf_counter() - arrived) * 1e3)
    return latency_ms


def _print_replay(recording: Recording, terrain: Terrain) -> None:
    for truth in ("projected", "world"):
        whole = Stage()
        with whole.running():
            score(
                recording,
                terrain,
                [RunConfig(method=OrConfig()), RunConfig(method=PaperConfig())],
                truth=truth,
            )
        print(
            f"evaluate, two methods against {truth} truth: {len(recording.frames) / whole.wall_s:.1f} "
            f"frames/s, CPU {_a_frame(whole.cpu_s, recording)} a frame"
        )


def _print_results(recording: Recording, terrain: Terrain) -> None:
    finished, whole = run(recording, terrain, CONFIG), Stage()
    with TemporaryDirectory() as folder, whole.running():
        write_results(finished, folder)
    print(f"writing the results: {whole.wall_s:.1f} s, CPU {whole.cpu_s:.1f} s\n")


def _print_python(recording: Recording, terrain: Terrain) -> None:
    """Time in functions written in Python, everything between the calls into compiled code, of a loop whose
    views were projected before. The profiler slows them down by what the same loop takes longer under it."""
    first = _loop(recording, terrain, RECORDED)
    seen = [first.step(instant.views().views, instant.stamp_ns) for instant in recording.instants()]

    def again(loop: FrameLoop) -> None:
        for instant, step in zip(recording.instants(), seen, strict=True):
            instant.views()
            frame_row(loop.step_observed(step.update.observations, step.stamp_ns), terrain)

    plain, profiled, profile = Stage(), Stage(), cProfile.Profile()
    loops = [_loop(recording, terrain, RECORDED) for _ in range(2)]
    with plain.running():
        again(loops[0])
    with profiled.running():
        profile.runcall(again, loops[1])
    stats = pstats.Stats(profile)
    own = {
        (file, line, name): entry[2]
        for (file, line, name), entry in stats.stats.items()  # type: ignore[attr-defined]
    }
    python_s = sum(seconds for (file, _, _), seconds in own.items() if file != "~")
    slower_s = profiled.cpu_s - plain.cpu_s
    print(
        f"Python between calls into compiled code: {_a_frame(python_s - slower_s, recording)} a frame "
        f"({_a_frame(python_s, recording)} under the profiler, which adds {_a_frame(slower_s, recording)})\n"
    )
    print("| own time a frame | function |\n|---|---|")
    for (file, _, name), seconds in sorted(own.items(), key=lambda entry: -entry[1])[:HOTTEST]:
        where = "compiled" if file == "~" else Path(file).name
        print(f"| {_a_frame(seconds, recording)} | {where}: `{name}` |")


if __name__ == "__main__":
    main()
