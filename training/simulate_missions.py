"""Records the missions of missions.toml: `python simulate_missions.py OUT [--only NAME]...`.

Missions that are there are left alone, so an interrupted recording goes on where it stopped. Two missions are
made side by side, each by one process: building a scene uses one core.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

from crowdfence.simulation.recording.frame_maker import FrameOptions
from crowdfence.simulation.recording.mission_recorder import record_mission
from crowdfence.simulation.scenarios.scenario import Scenario
from crowdfence.simulation.scenarios.scenario_file import load_scenario, merged, read_toml
from crowdfence.simulation.scene import build_scene

MISSIONS = Path(__file__).parent / "missions.toml"


def missions(only: Sequence[str] = ()) -> Iterator[tuple[str, dict[str, Any]]]:
    """(split/name, what differs from the scenario) of every mission, or of those of some splits."""
    tables = read_toml(MISSIONS)
    every = tables.pop("every")
    for split, table in tables.items():
        for mission in table["missions"]:
            if not only or split in only:
                name = f"{split}/{mission['scenario']}-{mission['seed']}.mcap"
                yield name, merged(merged(every, table.get("every", {})), mission)


def scenario_of(mission: dict[str, Any]) -> Scenario:
    """What a mission changes of the scenario that it names: a file of this folder, or one of crowdfence."""
    own = MISSIONS.with_name(f"{mission['scenario']}.toml")
    differs = {key: value for key, value in mission.items() if key not in ("scenario", "seed")}
    return load_scenario(own if own.exists() else mission["scenario"], **differs)


def record(path: Path, mission: dict[str, Any]) -> str:
    """One mission, with its map beside it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    scene = build_scene(scenario_of(mission), mission["seed"])
    recorded = record_mission(scene, path, options=FrameOptions(heatmaps=False), workers=1, overwrite=True)
    if not recorded.complete:
        path.unlink()  # what is there counts as whole
        return f"{path.name}: interrupted"
    return f"{path.name}: {recorded.frames} frames, {recorded.size_bytes / 1e6:.0f} MB"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", action="append", default=[], help="one group of missions.toml; repeat")
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    missing = [(given.out / name, mission) for name, mission in missions(given.only)]
    missing = [(path, mission) for path, mission in missing if not path.exists()]
    with ProcessPoolExecutor(given.processes, max_tasks_per_child=1) as pool:
        for line in pool.map(record, *zip(*missing, strict=True)) if missing else ():
            print(line, flush=True)


if __name__ == "__main__":
    sys.exit(main())
