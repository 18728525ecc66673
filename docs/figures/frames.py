"""Draws docs/frames.png: the world's axes, a camera's axes, and the pixels of its picture.

python docs/figures/frames.py
"""

from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import FancyArrowPatch, Polygon, Rectangle

RED, GREEN, BLUE = "#c8372d", "#2e8b57", "#2b65b5"
INK, QUIET, GROUND, SIGHT = "#1c2321", "#68726e", "#e9eee6", "#f2c14e"
ARROW = {"arrowstyle": "-|>", "mutation_scale": 16, "lw": 2.6, "shrinkA": 0, "shrinkB": 0}
NAME = {"fontsize": 11.5, "fontweight": "bold"}
TILT_DEG, HEADING_DEG = 40.0, 152.0
CAMERA = np.array([-1.0, 5.2, 5.0])
"""The camera looks so far below the horizon, and so far east of north."""


def camera_axes() -> np.ndarray:
    """Columns: the camera's x (right), y (down) and z (forward) in east, north, up: `world_from_camera`."""
    tilt, heading = np.radians([TILT_DEG, HEADING_DEG])
    forward = np.array([np.cos(tilt) * np.sin(heading), np.cos(tilt) * np.cos(heading), -np.sin(tilt)])
    right = np.array([np.cos(heading), -np.sin(heading), 0.0])
    return np.column_stack([right, np.cross(forward, right), forward])


def seen(points: object) -> np.ndarray:
    """World points [..., 3] on the drawing [..., 2], seen from the south and a little from above."""
    turn, rise = np.radians([-16.0, 27.0])
    east, north, up = np.moveaxis(np.asarray(points, float), -1, 0)
    across = np.cos(turn) * east + np.sin(turn) * north
    away = -np.sin(turn) * east + np.cos(turn) * north
    return np.stack([across, np.sin(rise) * away + np.cos(rise) * up], axis=-1)


def draw_axes(axes: plt.Axes, start: np.ndarray, ends: np.ndarray, names: tuple[str, ...]) -> None:
    """Three arrows [3, 3] from a point, red, green and blue, each with its name."""
    for end, name, colour in zip(ends, names, (RED, GREEN, BLUE), strict=True):
        tip = seen(start + end)
        axes.add_patch(FancyArrowPatch(seen(start), tip, color=colour, **ARROW))
        away = (tip - seen(start)) / np.linalg.norm(tip - seen(start))
        across = {-1: "right", 0: "center", 1: "left"}[int(np.round(away[0] * 0.75))]
        axes.text(*(tip + 0.22 * away), name, color=colour, ha=across, va="center", **NAME)


def draw_world(axes: plt.Axes) -> None:
    side = 6.0
    plane = [(-side, -side, 0), (side, -side, 0), (side, side, 0), (-side, side, 0)]
    axes.add_patch(Polygon(seen(plane), color=GROUND))
    for k in np.arange(-4, 5, 2):
        for line in ([(k, -side, 0), (k, side, 0)], [(-side, k, 0), (side, k, 0)]):
            axes.plot(*seen(line).T, color="white", lw=1.0)
    turn = camera_axes()
    corners = np.array([[-0.36, -0.27, 1], [0.36, -0.27, 1], [0.36, 0.27, 1], [-0.36, 0.27, 1]]) @ turn.T
    ground = CAMERA - corners * (CAMERA[2] / corners[:, 2])[:, None]
    axes.add_patch(Polygon(seen(ground), facecolor=SIGHT, alpha=0.6, edgecolor="#b98a1d"))
    for corner in ground:
        axes.plot(*seen([CAMERA, corner]).T, color="#b98a1d", lw=1.0, ls=(0, (4, 3)))
    axes.plot(*seen([CAMERA, CAMERA * [1, 1, 0]]).T, color=QUIET, lw=1.0, ls=":")
    middle = seen(ground).mean(axis=0)
    axes.text(*middle, "ground in view", color="#6b4e08", fontsize=10, ha="center", va="center")
    origin = np.array([-5.6, -5.6, 0.0])
    draw_axes(axes, origin, 2.6 * np.eye(3), ("x east", "y north", "z up"))
    axes.plot(*seen(origin), "o", color=INK, ms=5)
    axes.text(*(seen(origin) - [0.0, 0.5]), "(0, 0, 0) of the flight", color=QUIET, fontsize=10, ha="center")
    draw_axes(axes, CAMERA, 2.5 * turn.T, ("x right", "y down", "z forward"))
    axes.plot(*seen(CAMERA), "o", color=INK, ms=9)
    axes.text(*(seen(CAMERA) + np.array([0.3, 0.45])), "camera", color=INK, ha="center", fontsize=11)
    axes.set(aspect="equal", xlim=(-8.2, 8.2), ylim=(-5.4, 8.2))
    axes.set_axis_off()
    axes.set_title("The world, and a camera in it", fontsize=13, fontweight="bold", color=INK)


def draw_picture(axes: plt.Axes) -> None:
    columns, rows, stride = 16, 12, 4
    axes.add_patch(Rectangle((0, 0), columns, rows, facecolor="#f7f5ee", edgecolor=INK, lw=1.6))
    for x in range(1, columns):
        axes.plot(
            (x, x), (0, rows), color=INK if x % stride == 0 else "#d9d6c8", lw=1.2 if x % stride == 0 else 0.6
        )
    for y in range(1, rows):
        axes.plot(
            (0, columns),
            (y, y),
            color=INK if y % stride == 0 else "#d9d6c8",
            lw=1.2 if y % stride == 0 else 0.6,
        )
    axes.add_patch(Rectangle((8, 4), stride, stride, facecolor="#e4572e", alpha=0.45, edgecolor="none"))
    axes.text(
        10, 6, "one cell of\nthe heatmap\n(stride 4)", ha="center", va="center", fontsize=9.5, color="#7a1f08"
    )
    axes.add_patch(Rectangle((0, 0), 1, 1, facecolor="#2b65b5", alpha=0.35, edgecolor="none"))
    note = {"fontsize": 9.5, "color": INK, "arrowprops": {"arrowstyle": "-", "color": QUIET}}
    axes.plot(0.5, 0.5, "o", color=BLUE, ms=4.5)
    axes.annotate("first pixel: its centre is (0.5, 0.5)", (0.5, 0.5), (2.2, -1.7), **note)
    axes.plot(0, 0, "s", color=INK, ms=4.5)
    axes.annotate("(0, 0)", (0, 0), (-1.9, -1.1), **note)
    axes.plot(8, 6, "+", color=INK, ms=11, mew=1.8)
    axes.annotate("cx, cy: where\nthe lens looks", (8, 6), (3.4, 9.0), **note)
    axes.add_patch(FancyArrowPatch((0, 13.1), (5, 13.1), color=RED, **ARROW))
    axes.text(5.3, 13.1, "columns: x right", color=RED, va="center", fontsize=11, fontweight="bold")
    axes.add_patch(FancyArrowPatch((-1.0, 4.0), (-1.0, 9.0), color=GREEN, **ARROW))
    axes.text(
        -1.35,
        6.5,
        "rows: y down",
        color=GREEN,
        rotation=90,
        va="center",
        ha="right",
        fontsize=11,
        fontweight="bold",
    )
    axes.set(xlim=(-3.2, 16.6), ylim=(14.4, -2.8), aspect="equal")
    axes.set_axis_off()
    axes.set_title("Its picture, in pixels", fontsize=13, fontweight="bold", color=INK)


def main() -> None:
    figure = plt.figure(figsize=(12.4, 5.4), facecolor="white")
    draw_world(figure.add_axes((0.0, 0.02, 0.55, 0.88)))
    draw_picture(figure.add_axes((0.56, 0.03, 0.43, 0.88)))
    figure.savefig(Path(__file__).parents[1] / "frames.png", dpi=110)


if __name__ == "__main__":
    main()
