"""The paper's evaluation by one command, `make paper`: Table 1 and Fig. 3; see README.md beside this file.

    python paper/reproduce.py --seeds 5001 5002 --frames 1056 --size 320x240 --work out/paper -o paper

Every mission is simulated, looked at and projected once; whatever is there already in the work folder is not
made again. `--quick` takes the bundled recording instead and needs a minute.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from figure import write_figure
from fused import fused
from looks import Mission, Weakened, simulated
from settings import EVIDENCE, WEAKENED_TABLE, all_settings
from tables import Regime, markdown, write_csv

BUNDLED = Path(__file__).parents[1] / "python" / "crowdfence" / "demo_data" / "race.mcap"


def missions(arguments: argparse.Namespace) -> list[Mission]:
    work: Path = arguments.work
    work.mkdir(parents=True, exist_ok=True)
    if arguments.quick:
        return [Mission("bundled race", BUNDLED, work / "bundled")]
    found = []
    for seed in arguments.seeds:
        recording = simulated(seed, arguments.frames, arguments.size, work)
        found.append(Mission(f"race {seed}", recording, recording.with_suffix("")))
    return found


def regimes(arguments: argparse.Namespace) -> list[Regime]:
    shipped, weakened = {}, {}
    for mission in missions(arguments):
        shipped[mission.name] = fused(mission, all_settings(), mission.kept / "shipped")
        weakened[mission.name] = fused(
            Weakened(mission), [*WEAKENED_TABLE, EVIDENCE], mission.kept / "weakened"
        )
        tell(f"{mission.name} is fused")
    return [Regime("the shipped detector", shipped), Regime("weakened to the paper's", weakened)]


def settled(found: list[Regime], arguments: argparse.Namespace) -> str:
    (shipped, _) = found
    told = []
    for mission, by_setting in shipped.missions.items():
        stamps_ns = next(iter(by_setting.values())).stamps_ns
        told.append(f"{mission} ({len(stamps_ns)} instants in {(stamps_ns[-1] - stamps_ns[0]) / 1e9:.0f} s)")
    size = "320x240" if arguments.quick else arguments.size
    seeds = " ".join(map(str, arguments.seeds))
    command = "make paper QUICK=1" if arguments.quick else f'make paper SEEDS="{seeds}"'
    return (
        f"Three drones with {size} pictures: {', '.join(told)}. Made by `{command}`; mean IoU against the "
        "projected labels (equation 4), over all instants."
    )


def tell(text: str) -> None:
    print(f"{time.strftime('%H:%M:%S')} {text}", file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--seeds", type=int, nargs="+", default=[5001, 5002])
    parser.add_argument("--frames", type=int, default=1056, help="Images per drone.")
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--work", type=Path, default=Path("out/paper"), help="What is kept.")
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent)
    parser.add_argument("--quick", action="store_true", help="The bundled recording, in a minute.")
    arguments = parser.parse_args()
    found = regimes(arguments)
    output: Path = arguments.output
    output.mkdir(parents=True, exist_ok=True)
    write_csv(output / "table1.csv", found)
    (output / "table1.md").write_text(markdown(found, settled(found, arguments)))
    write_figure(output / "figure3.png", found)
    tell(f"wrote table1.csv, table1.md and figure3.png into {output}")


if __name__ == "__main__":
    main()
