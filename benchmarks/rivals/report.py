"""results.json of run.py -> RESULTS.md and times.svg beside it.

python benchmarks/rivals/report.py out/rivals/results.json
"""

import json
import sys
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
matplotlib.rcParams["svg.hashsalt"] = "crowdfence"

from matplotlib import pyplot as plt  # noqa: E402 (the backend comes first)

Json = dict
STAGES = ("rays", "average", "fuse")
STAGE_COLUMNS = ("rays and cells", "average", "fuse", "mean", "worst view", "cells touched", "ns a cell")
RATIOS = ("Embree / crowdfence", "OctoMap / crowdfence", "crowdfence / floor")


def write_report(results: Json, folder: Path) -> None:
    for scene in results["scenes"]:
        _extrapolate(scene)
    parts = [_head(results), _totals(results), _stages(results), _drones(results), _agreement(results)]
    (folder / "RESULTS.md").write_text("\n".join(parts))
    _plot(results, folder / "times.svg")


def _extrapolate(scene: Json) -> None:
    """Rows left out cost what the others cost; averaging and fusion are those of all pixels, by Embree."""
    for row in scene["times"]:
        if row["step"] == 1:
            continue
        whole = _row(scene, "Embree", row["size"])
        height = int(row["size"].split("x")[1])
        for view, complete in zip(row["views"], whole["views"], strict=True):
            view["rays"] *= height / (height // row["step"])
            view |= {stage: complete[stage] for stage in ("average", "fuse", "touched")}
            view["cpu"] = sum(view[stage] for stage in STAGES)


def _row(scene: Json, program: str, size: str) -> Json | None:
    rows = [row for row in scene["times"] if row["program"] == program and row["size"] == size]
    return rows[0] if rows else None


def _mean(row: Json, key: str = "cpu") -> float:
    return float(np.mean([view[key] for view in row["views"]]))


def _name(row: Json) -> str:
    return row["program"] if row["mode"] == "-" else f"{row['program']} {row['mode']}"


def _map(scene: Json) -> str:
    return f"{scene['scene']}, {(scene['side_m'] / 1e3) ** 2:g} km2, {scene['voxel_m']:g} m"


def _figure(value: float) -> str:
    return f"{value:.3g}" if value < 1000 else f"{value:.0f}"


def _head(results: Json) -> str:
    loads = [scene[when] for scene in results["scenes"] for when in ("load_before", "load_after")]
    load = f"load average {min(loads):.1f} to {max(loads):.1f}"
    left_out = results.get("left_out", [])
    left_out = f" Not run: maps of {' and '.join(left_out)}." if left_out else ""
    return f"""# Back-projection and its rivals

`make bench-rivals` on {results["date"]}: {results["machine"]}; {load} while it ran.{left_out}

Milliseconds of CPU time on one thread for one view, from heatmap to belief: rays, cells, means, fusion;
range 300 m. Mean of 12 views from 20 to 80 m above ground, 10 to 60 degrees down, 90 degrees wide; per view
the fastest of {results["passes"]} passes. A star marks figures extrapolated from every 4th (OpenVDB at
1920x1080), 32nd or 72nd row of pixels (OctoMap and numpy, at 640x480 and 1920x1080); their averaging and
fusion are Embree's. Embree's mode is the best of three on other views. crowdfence traces the planes in the
voxels, by pixel centres (`rays`) or with what lies between them (`full`, its default), or the voxels as
cubes (`voxels`). OpenVDB, OctoMap and numpy trace the voxels, Embree and Open3D the triangles between the
centres of the height map. The memory floor reads the heatmap once and reads and writes each touched cell
once.

![Time of one view](times.svg)
"""


def _totals(results: Json) -> str:
    names = list(dict.fromkeys(_name(row) for scene in results["scenes"] for row in scene["times"]))
    names = list(dict.fromkeys("Embree" if name.startswith("Embree") else name for name in names))
    lines = [
        "## Mean of the views\n",
        f"| map | image | {' | '.join(names)} | {' | '.join(RATIOS)} |",
        "|---" * (2 + len(names) + len(RATIOS)) + "|",
    ]
    for scene in results["scenes"]:
        for size in dict.fromkeys(row["size"] for row in scene["times"]):
            rows = {
                row["program"] if row["program"] == "Embree" else _name(row): row for row in _of(scene, size)
            }
            cells = [_total(rows[name]) if name in rows else "-" for name in names]
            ours = _mean(_row(scene, "crowdfence", size))
            ratios = [_mean(_row(scene, "Embree", size)) / ours]
            octomap = _row(scene, "OctoMap", size)
            ratios.append(_mean(octomap) / ours if octomap else np.nan)
            ratios.append(ours / _mean(_row(scene, "memory floor", size)))
            told = ["-" if np.isnan(ratio) else f"{_figure(ratio)} x" for ratio in ratios]
            lines.append(f"| {_map(scene)} | {size} | {' | '.join(cells)} | {' | '.join(told)} |")
    return "\n".join(lines) + "\n"


def _of(scene: Json, size: str) -> list[Json]:
    return [row for row in scene["times"] if row["size"] == size]


def _total(row: Json) -> str:
    return _figure(_mean(row)) + ("*" if row["step"] > 1 else "")


def _stages(results: Json) -> str:
    lines = [
        "## Stages\n",
        "crowdfence averages while it looks for the cells.\n",
        f"| map | image | program | {' | '.join(STAGE_COLUMNS)} |",
        "|---" * (3 + len(STAGE_COLUMNS)) + "|",
    ]
    for scene in results["scenes"]:
        for row in scene["times"]:
            star = "*" if row["step"] > 1 else ""
            is_floor = row["program"] == "memory floor"
            stages = ["-" if is_floor else _figure(_mean(row, stage)) for stage in STAGES]
            worst = max(view["cpu"] for view in row["views"])
            touched = _mean(row, "touched")
            figures = [*stages, _figure(_mean(row)) + star, _figure(worst) + star]
            figures += [f"{touched:.0f}", f"{1e6 * _mean(row) / touched:.0f}{star}"]
            lines.append(f"| {_map(scene)} | {row['size']} | {_name(row)} | {' | '.join(figures)} |")
    return "\n".join(lines) + "\n"


def _drones(results: Json) -> str:
    lines = [
        "## Drones and threads\n",
        "Wall time of one instant in milliseconds: mean over up to 12 instants, fastest of the passes.\n",
        "| map | image | program | drones | 1 thread | 2 threads | 1 / 2 | frames/s with 2 |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for scene in results["scenes"]:
        for row in scene["drones"]:
            if row["threads"] == 2:
                continue
            same = [other for other in scene["drones"] if _key(other) == _key(row) and other["threads"] == 2]
            one, two = row["wall"], same[0]["wall"]
            figures = f"{_figure(one)} | {_figure(two)} | {one / two:.2f} x | {1e3 * row['drones'] / two:.0f}"
            lines.append(f"| {_map(scene)} | {row['size']} | {_name(row)} | {row['drones']} | {figures} |")
    return "\n".join(lines) + "\n"


def _key(row: Json) -> tuple:
    return row["program"], row["mode"], row["size"], row["drones"]


def _agreement(results: Json) -> str:
    lines = [
        "## The same scene\n",
        "Three views at 640x480: share of pixels that hit something, and of these the share (at most: pixels",
        "are counted by cell) on the same cell as Embree's triangles and as OpenVDB's voxels. Voxels stand",
        "up to one voxel above the surface they hold, so the two kinds differ by nature, most where the view",
        "is flat. A plane a column and triangles between the centres differ where the ground bends.\n",
        "| map | program | hit | cells touched | same cell as Embree | same cell as OpenVDB |",
        "|---|---|---|---|---|---|",
    ]
    for scene in results["scenes"]:
        for row in scene["agreement"]:
            shares = f"{row['Embree']:.4f} | {row['OpenVDB']:.4f}"
            lines.append(
                f"| {_map(scene)} | {_name(row)} | {row['hit']:.4f} | {row['cells']:.0f} | {shares} |"
            )
    return "\n".join(lines) + "\n"


def _plot(results: Json, path: Path) -> None:
    sizes = list(dict.fromkeys(row["size"] for scene in results["scenes"] for row in scene["times"]))
    programs = list(dict.fromkeys(row["program"] for scene in results["scenes"] for row in scene["times"]))
    figure, panels = plt.subplots(
        len(sizes), 1, figsize=(10, 3.2 * len(sizes)), squeeze=False, layout="constrained"
    )
    width = 0.8 / len(programs)
    for panel, size in zip(panels[:, 0], sizes, strict=True):
        for at, program in enumerate(programs):
            rows = [_row(scene, program, size) for scene in results["scenes"]]
            heights = [_mean(row) if row else np.nan for row in rows]
            panel.bar(
                np.arange(len(rows)) + (at - len(programs) / 2 + 0.5) * width, heights, width, label=program
            )
        panel.set_yscale("log")
        panel.set_ylabel(f"ms a view, {size}")
        panel.set_xticks(
            range(len(results["scenes"])), [_map(scene).replace(", ", "\n") for scene in results["scenes"]]
        )
        panel.grid(axis="y", alpha=0.3)
    panels[0, 0].legend(ncols=len(programs), fontsize="small", loc="upper center", bbox_to_anchor=(0.5, 1.18))
    figure.savefig(path, metadata={"Date": None})
    plt.close(figure)


if __name__ == "__main__":
    source = Path(sys.argv[1])
    write_report(json.loads(source.read_text()), source.parent)
