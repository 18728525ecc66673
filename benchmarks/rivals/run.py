"""Back-projection against its rivals: same scenes, stages and run. Writes results.json, a table and a plot.

Every program builds its map of a scene, then takes orders. A pass times all of them on the same twelve
views, one after the other; the next pass goes through them in the opposite order. The fastest of a view's
passes counts, and the mean and the worst of the twelve views are told. Times are CPU time of the process,
for two threads wall time. Embree's mode is chosen on views of their own. A run stops when the rivals do not
see the same scene. Each map that was measured stays under --out, and a run that was stopped goes on after it,
as long as no program has changed since.
"""

import argparse
import hashlib
import json
import os
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from report import write_report
from rival import LOOK
from scene import KINDS, make_scene, write_heatmaps, write_scene

HERE = Path(__file__).parent
SIZES = {"640x480": (640, 480), "1920x1080": (1920, 1080)}
VIEWS = 12
EMBREE_MODES = ("Intersect1", "Intersect16", "Intersect1M")
MAPS = {"1000x0.5": (1000.0, 0.5), "1000x0.25": (1000.0, 0.25), "4000x0.5": (4000.0, 0.5)}
LARGE_MAP_GB = 18  # 128 million triangles while Embree builds its tree
SAME_HIT_RATE = 0.02  # between a smooth surface and its voxels
SAME_PIXELS = {"OpenVDB": 0.99, "Embree": 0.9}  # between programs that trace the same surface
# A voxel keeps one plane, and crowns have several faces in one: at their rims a pixel meets the cell beside.
SAME_PIXELS_OF_CROWNS = 0.8

Json = dict[str, object]


@dataclass
class Program:
    name: str
    command: list[str | Path]
    surface: (
        str  # whose surface it traces, unless it is told to trace voxels: "Embree" (triangles) or "OpenVDB"
    )
    modes: list[str] = field(default_factory=lambda: ["-"])
    row_step: dict[str, int] = field(
        default_factory=dict
    )  # of a slow rival only every so many rows are traced
    largest_cells: float = np.inf  # columns of the map beyond which memory or patience ends
    process: subprocess.Popen[str] | None = None

    def start(self, folder: Path) -> Json:
        command = [str(part) for part in [*self.command, folder]]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        return self._answer()

    def order(self, *words: object) -> list[Json]:
        self.process.stdin.write(" ".join(map(str, words)) + "\n")
        self.process.stdin.flush()
        return self._answer()

    def stop(self) -> None:
        self.process.stdin.close()
        self.process.wait()

    def _answer(self):
        line = self.process.stdout.readline()
        if not line:
            raise SystemExit(f"{self.name} ended with {self.process.wait()}")
        return json.loads(line)


@dataclass
class Bench:
    programs: list[Program]
    folder: Path
    passes: int
    sizes: list[str]

    def scene_once(self, kind: str, map_name: str, drones: list[int]) -> Json:
        """What is measured on a map, or was by the same programs. Fleets fly on the first map alone."""
        path = self.folder / f"{kind}-{map_name}.json"
        of = {"by": self._programs_sha256(), "sizes": self.sizes, "passes": self.passes}
        if path.exists() and (kept := json.loads(path.read_text())).get("of") == of:
            print(f"{kind}, {map_name}: measured before, {path}", flush=True)
            return kept
        start = time.monotonic()
        measured = self.scene(kind, *MAPS[map_name], drones if map_name == next(iter(MAPS)) else [])
        path.write_text(json.dumps(measured | {"of": of}))
        print(f"{kind}, {map_name}: {time.monotonic() - start:.0f} s, load {os.getloadavg()}", flush=True)
        return measured

    def _programs_sha256(self) -> str:
        """Of all programs and of what steers them."""
        files = {Path(part) for program in self.programs for part in program.command}
        files |= {HERE / name for name in ("run.py", "rival.py", "scene.py")}
        return hashlib.sha256(b"".join(file.read_bytes() for file in sorted(files))).hexdigest()

    def scene(self, kind: str, side_m: float, voxel_m: float, drones: list[int]) -> Json:
        folder = self.folder / "scene"
        write_scene(make_scene(kind, side_m, voxel_m), folder)
        cells = (side_m / voxel_m) ** 2
        running = [program for program in self.programs if cells <= program.largest_cells]
        result: Json = {
            "scene": kind,
            "side_m": side_m,
            "voxel_m": voxel_m,
            "date": time.strftime("%Y-%m-%d"),
            "load_before": os.getloadavg()[0],
        }
        try:
            result["built"] = {program.name: program.start(folder) for program in running}
            result["agreement"] = self._agreement(running, kind)
            result["times"] = [row for size in self.sizes for row in self._times(running, size)]
            result["drones"] = [row for size in self.sizes for row in self._drones(running, size, drones)]
        finally:
            for program in running:
                if program.process is not None:
                    program.stop()
            shutil.rmtree(folder)
        return result | {"load_after": os.getloadavg()[0]}

    def _times(self, running: list[Program], size: str) -> list[Json]:
        self._choose_embree_mode(running, size)
        entries = [(program, mode) for program in running for mode in program.modes]
        passes: dict[tuple[str, str], list[list[Json]]] = {}
        for at in range(self.passes):
            for program, mode in entries if at % 2 == 0 else reversed(entries):
                step = program.row_step.get(size, 1)
                times = program.order("time", mode, "reporting", *SIZES[size], 1, 1, step, VIEWS)
                passes.setdefault((program.name, mode), []).append(times)
        embree = next(program for program in running if program.name == "Embree")
        passes["memory floor", "-"] = [
            embree.order("floor", embree.modes[0], "reporting", *SIZES[size], 1, 1, 1, VIEWS)
            for _ in range(self.passes)
        ]
        steps = {program.name: program.row_step.get(size, 1) for program in running}
        return [
            {
                "program": name,
                "mode": mode,
                "size": size,
                "step": steps.get(name, 1),
                "views": _fastest(of_passes),
            }
            for (name, mode), of_passes in passes.items()
        ]

    def _choose_embree_mode(self, running: list[Program], size: str) -> None:
        embree = next(program for program in running if program.name == "Embree")
        spent = dict.fromkeys(EMBREE_MODES, np.inf)
        for mode in EMBREE_MODES * 2:
            times = embree.order("time", mode, "tuning", *SIZES[size], 1, 1, 1, VIEWS // 2)
            spent[mode] = min(spent[mode], sum(view["cpu"] for view in times))
        embree.modes = [min(spent, key=spent.get)]

    def _drones(self, running: list[Program], size: str, counts: list[int]) -> list[Json]:
        """Time of one instant, all drones' views, of the two programs that matter."""
        entries = [
            (program, count, threads)
            for count in counts
            for threads in (1, 2)
            for program in running
            if program.name in ("crowdfence", "Embree")
        ]
        passes: dict[tuple[str, str, int, int], list[list[Json]]] = {}
        for at in range(self.passes):
            for program, count, threads in entries if at % 2 == 0 else reversed(entries):
                mode, instants = program.modes[0], max(1, min(VIEWS, 24 // count))
                times = program.order("time", mode, "reporting", *SIZES[size], count, threads, 1, instants)
                passes.setdefault((program.name, mode, count, threads), []).append(times)
        rows = []
        for (name, mode, count, threads), of_passes in passes.items():
            fastest = _fastest(of_passes, "wall")
            mean = {
                clock: float(np.mean([instant[clock] for instant in fastest])) for clock in ("wall", "cpu")
            }
            rows.append(
                {"program": name, "mode": mode, "size": size, "drones": count, "threads": threads} | mean
            )
        return rows

    def _agreement(self, running: list[Program], kind: str) -> list[Json]:
        """Share of pixels that hit, and of those that two programs put on the same cell, over three views."""
        looks = {
            (program.name, mode): [self._looks(program, mode, view) for view in range(3)]
            for program in running
            if program.name != "numpy"  # inexact by nature
            for mode in program.modes
        }
        pixels = 3 * 640 * 480
        rows = []
        for (name, mode), seen in looks.items():
            row: Json = {
                "program": name,
                "mode": mode,
                "hit": sum(int(s["pixels"].sum()) for s in seen) / pixels,
            }
            row["cells"] = sum(map(len, seen)) / 3
            for reference, key in (("Embree", "Intersect16"), ("OpenVDB", "-")):
                pairs = zip(seen, looks[reference, key], strict=True)
                row[reference] = sum(_same_pixels(a, b) for a, b in pairs) / pixels / row["hit"]
            rows.append(row)
        least = SAME_PIXELS | ({"Embree": SAME_PIXELS_OF_CROWNS} if kind == "forest" else {})
        _check_agreement(rows, {program.name: program.surface for program in running}, least)
        return rows

    def _looks(self, program: Program, mode: str, view: int) -> np.ndarray:
        path = self.folder / "looks"
        program.order("dump", mode, "reporting", *SIZES["640x480"], view, path)
        return np.sort(np.fromfile(path, LOOK), order="cell")


def _same_pixels(a: np.ndarray, b: np.ndarray) -> int:
    """Pixels on the same cell, at most: the programs tell how many pixels a cell has, not which."""
    _, of_a, of_b = np.intersect1d(a["cell"], b["cell"], assume_unique=True, return_indices=True)
    return int(np.minimum(a["pixels"][of_a], b["pixels"][of_b]).sum())


def _check_agreement(rows: list[Json], surfaces: dict[str, str], least: dict[str, float]) -> None:
    hit = [row["hit"] for row in rows]
    if max(hit) - min(hit) > SAME_HIT_RATE:
        raise SystemExit(f"the rivals do not see the same scene: {rows}")
    for row in rows:
        surface = "OpenVDB" if row["mode"] == "voxels" else surfaces[row["program"]]
        if row[surface] < least[surface]:
            raise SystemExit(f"{row['program']} does not trace the surface that it should: {row}")


def _fastest(passes: list[list[Json]], clock: str = "cpu") -> list[Json]:
    return [min(of_view, key=lambda times: times[clock]) for of_view in zip(*passes, strict=True)]


def programs(out: Path) -> list[Program]:
    target = HERE.parents[1] / "target" / "release"
    found = [
        # The first, because it writes what the others number the cells by.
        Program("crowdfence", [target / "rivals-crowdfence"], "Embree", ["rays", "full", "voxels"]),
        Program("Embree", [out / "embree"], "Embree", ["Intersect16"]),
        Program("OpenVDB", [out / "openvdb"], "OpenVDB", row_step={"1920x1080": 4}),
        Program(
            "OctoMap",
            [out / "octomap"],
            "OpenVDB",
            row_step={"640x480": 32, "1920x1080": 72},
            largest_cells=2e7,
        ),
        Program(
            "numpy",
            [sys.executable, HERE / "numpy_march.py"],
            "OpenVDB",
            row_step={"640x480": 32, "1920x1080": 72},
            largest_cells=5e6,
        ),
    ]
    open3d_python = out / "open3d" / "bin" / "python"
    if open3d_python.exists():
        open3d = Program("Open3D", [open3d_python, HERE / "open3d_rays.py"], "Embree", largest_cells=5e6)
        found.insert(2, open3d)
    else:
        print("Open3D is left out: `make setup-rivals` could not install it", file=sys.stderr)
    return found


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--quick", action="store_true", help="one scene and size, two passes, report under --out"
    )
    parser.add_argument("--scene", choices=KINDS, help="this scene only")
    parser.add_argument(
        "--maps", choices=MAPS, nargs="+", default=list(MAPS), help="these maps only: metres along x voxel"
    )
    parser.add_argument("--out", type=Path, default=Path("out/rivals"), help="programs, scenes and results")
    options = parser.parse_args()
    out = options.out.resolve()
    sizes = ["640x480"] if options.quick else list(SIZES)
    for size in sizes:
        write_heatmaps(out, *SIZES[size])
    maps = list(MAPS)[:1] if options.quick else list(options.maps)
    if "4000x0.5" in maps and (free_gb := _free_gb()) < LARGE_MAP_GB:
        print(
            f"16 km2 are left out: Embree needs {LARGE_MAP_GB} GB of memory, {free_gb:.0f} are free",
            file=sys.stderr,
        )
        maps.remove("4000x0.5")
    kinds = [options.scene] if options.scene else KINDS[:1] if options.quick else KINDS
    bench = Bench(programs(out), out, 2 if options.quick else 3, sizes)
    counts = [1, 12] if options.quick else [1, 3, 12, 48]
    scenes = [bench.scene_once(kind, name, counts) for kind in kinds for name in maps]
    results = {
        "machine": _machine(),
        "date": " and ".join(sorted({scene["date"] for scene in scenes})),
        "passes": bench.passes,
        "left_out": [
            f"{side / 1e3:g} x {side / 1e3:g} km at {voxel:g} m"
            for name, (side, voxel) in MAPS.items()
            if name not in maps
        ],
        "scenes": scenes,
    }
    (out / "results.json").write_text(json.dumps(results))
    report = out if options.quick or options.scene else HERE
    write_report(results, report)
    print(f"{report / 'RESULTS.md'}, {report / 'times.svg'}")


def _free_gb() -> float:
    lines = Path("/proc/meminfo").read_text().splitlines()
    return next(int(line.split()[1]) * 1024 / 1e9 for line in lines if line.startswith("MemAvailable"))


def _machine() -> str:
    models = [line for line in Path("/proc/cpuinfo").read_text().splitlines() if "model name" in line]
    return f"{len(os.sched_getaffinity(0))} cores, {models[0].partition(':')[2].strip()}"


if __name__ == "__main__":
    main()
