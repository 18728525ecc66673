"""`docs/foxglove.png` from a file of `crowdfence convert RECORDING --results RUN`: what Foxglove shows of it, drawn
from its messages alone by a reader that is not ours.

    python docs/foxglove_picture.py flight_with_results.mcap docs/foxglove.png
"""

from __future__ import annotations

import io
import sys
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.figure import Figure
from PIL import Image
from rosbags.highlevel import AnyReader
from scipy.spatial.transform import Rotation

LINE_LIST, TEXT, TRIANGLES = 5, 9, 11


def last_messages(path: Path) -> dict[str, Any]:
    """The last message of each topic; of /tf one per frame."""
    last: dict[str, Any] = {}
    with AnyReader([path]) as reader:
        for connection, _, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            if connection.topic == "/tf":
                for transform in message.transforms:
                    last.setdefault("/tf", {}).setdefault(transform.child_frame_id, []).append(transform)
            else:
                last[connection.topic] = message
    return last


def camera_from_map(last: dict[str, Any], camera_info: Any) -> tuple[Rotation, np.ndarray]:
    """From the transform whose stamp is nearest to the picture's."""
    stamp = seconds(camera_info.header.stamp)
    track = last["/tf"][camera_info.header.frame_id]
    transform = min(track, key=lambda one: abs(seconds(one.header.stamp) - stamp)).transform
    turn, place = transform.rotation, transform.translation
    return Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).inv(), np.array([place.x, place.y, place.z])


def seconds(stamp: Any) -> float:
    return stamp.sec + stamp.nanosec / 1e9


def places(marker: Any) -> np.ndarray:
    return np.array([[point.x, point.y, point.z] for point in marker.points])


def draw_map(axes: Any, last: dict[str, Any]) -> None:
    (terrain,) = last["/crowdfence/terrain"].markers
    colours = [(colour.r, colour.g, colour.b) for colour in terrain.colors[::3]]
    axes.add_collection(PolyCollection(places(terrain).reshape(-1, 3, 3)[:, :, :2], facecolors=colours, edgecolors="face"))
    cloud = last["/crowdfence/ground"]
    offsets = {field.name: field.offset for field in cloud.fields}
    rows = cloud.data.reshape(-1, cloud.point_step)
    xy = rows[:, :8].copy().view("<f4")
    rgb = rows[:, offsets["rgb"] : offsets["rgb"] + 3][:, ::-1] / 255
    seen = rows[:, offsets["state"]] > 1
    axes.scatter(*xy[seen].T, c=rgb[seen], s=5.0, marker="s", linewidths=0, alpha=0.55)
    for marker in last["/crowdfence/zones"].markers:
        if marker.ns.endswith("outline"):
            axes.add_collection(LineCollection(places(marker)[:, :2].reshape(-1, 2, 2), colors="black"))
        if marker.type == TEXT and float(marker.text.split("\n")[1].split()[0]) > 20:
            at = marker.pose.position
            axes.text(at.x, at.y + 8.0, marker.text.split("\n")[0], fontsize=8, weight="bold", clip_on=True)
    crowd = np.concatenate([places(one) for one in last["/crowdfence/zones"].markers if one.type == TRIANGLES])
    middle, reach = crowd[:, :2].mean(axis=0), 105.0
    axes.set(xlim=(middle[0] - reach, middle[0] + reach), ylim=(middle[1] - reach, middle[1] + reach))
    axes.set(aspect="equal", xlabel="east, m", ylabel="north, m")
    axes.set_title("/crowdfence/terrain, ground, zones", fontsize=9)


def draw_camera(axes: Any, last: dict[str, Any], drone: str) -> None:
    info = last[f"/{drone}/camera/camera_info"]
    picture = Image.open(io.BytesIO(last[f"/{drone}/camera/image/compressed"].data.tobytes()))
    axes.imshow(picture, extent=(-0.5, info.width - 0.5, info.height - 0.5, -0.5))
    rotation, position = camera_from_map(last, info)
    for marker in last["/crowdfence/zones"].markers:
        if not marker.ns.endswith("outline"):
            continue
        in_camera = rotation.apply(places(marker) - position).reshape(-1, 2, 3)
        in_camera = in_camera[(in_camera[:, :, 2] > 1.0).all(axis=1)]
        pixels = in_camera @ info.k.reshape(3, 3).T
        axes.add_collection(LineCollection(pixels[:, :, :2] / pixels[:, :, 2:], colors="red", linewidths=0.8))
    axes.set(xlim=(-0.5, info.width - 0.5), ylim=(info.height - 0.5, -0.5), xticks=[], yticks=[])
    axes.set_title(f"/{drone}/camera with /crowdfence/zones", fontsize=9)


def draw_heatmap(axes: Any, last: dict[str, Any], drone: str) -> None:
    heatmap = last[f"/{drone}/heatmap"]
    axes.imshow(heatmap.data.reshape(heatmap.height, heatmap.step), cmap="inferno", vmin=0, vmax=255)
    axes.set(xticks=[], yticks=[])
    axes.set_title(f"/{drone}/heatmap", fontsize=9)


def main() -> None:
    source, target = map(Path, sys.argv[1:])
    last = last_messages(source)
    figure = Figure(figsize=(13, 7.2), layout="constrained")
    FigureCanvasAgg(figure)
    grid = figure.add_gridspec(3, 3, width_ratios=(2.2, 1, 1))
    draw_map(figure.add_subplot(grid[:, 0]), last)
    drones = sorted({topic.split("/")[1] for topic in last if topic.endswith("/camera/image/compressed")})
    for row, drone in enumerate(drones[:3]):
        draw_camera(figure.add_subplot(grid[row, 1]), last, drone)
        draw_heatmap(figure.add_subplot(grid[row, 2]), last, drone)
    figure.savefig(target, dpi=100)


if __name__ == "__main__":
    main()
