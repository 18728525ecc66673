"""Make a recording small enough to bundle: half the image size, JPEG, the map and the truth kept.

    python scripts/bundle_recording.py RECORDING OUTPUT.mcap [--quality 80]

The map that came with the recording is copied beside the output. Heatmaps are kept as they are: at half the
image size their stride halves.
"""

import argparse
import io
import shutil
from heapq import merge
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from crowdfence import Camera, open_recording
from crowdfence.sources.mission_writer import MissionWriter
from crowdfence.sources.recording import Frame


def halved_camera(camera: Camera) -> Camera:
    """The camera of an image of which 2 x 2 pixels were averaged."""
    if camera.model != "pinhole" or camera.width % 2 or camera.height % 2:
        raise SystemExit(f"only pinhole images with even sides can be halved, got {camera}")
    sides = (camera.width // 2, camera.height // 2)
    return Camera.pinhole(*sides, camera.fx / 2, camera.fy / 2, camera.cx / 2, camera.cy / 2)


def halved_image(frame: Frame, quality: int) -> bytes:
    height, width, _ = (image := frame.image()).shape
    small = Image.fromarray(image).resize((width // 2, height // 2), Image.Resampling.BOX)
    data = io.BytesIO()
    small.save(data, "JPEG", quality=quality, optimize=True)
    return data.getvalue()


def halved_regions(frame: Frame) -> NDArray[np.uint8]:
    """A pixel belongs to a crowd when at least two of the four it replaces do."""
    regions = frame.regions()
    blocks = regions.reshape(regions.shape[0] // 2, 2, regions.shape[1] // 2, 2).swapaxes(1, 2)
    blocks = blocks.reshape(*blocks.shape[:2], 4)
    return np.where((blocks > 0).sum(axis=-1) >= 2, blocks.max(axis=-1), 0).astype(np.uint8)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("recording", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--quality", type=int, default=80)
    arguments = parser.parse_args()

    recording = open_recording(arguments.recording)
    if recording.terrain is None:
        raise SystemExit(f"{arguments.recording} comes without a map")
    terrain = arguments.output.with_suffix(recording.terrain.suffix)
    shutil.copyfile(recording.terrain, terrain)
    poses = [
        [(int(stamp), drone, (position, quaternion)) for stamp, position, quaternion in zip(
            track.stamps_ns, track.positions, track.quaternions, strict=True
        )]
        for drone, track in recording.tracks().items()
    ]  # fmt: skip
    frames = [(frame.stamp_ns, frame.drone, frame) for frame in recording.frames]
    with MissionWriter(
        arguments.output, georeference=recording.georeference, terrain=terrain, source="demo"
    ) as writer:
        for stamp_ns, drone, item in merge(*poses, frames, key=lambda entry: entry[0]):
            if not isinstance(item, Frame):
                writer.add_pose(drone, stamp_ns, *item)
                continue
            writer.add_camera(drone, halved_camera(item.camera))
            writer.add_frame(
                drone,
                stamp_ns,
                image=halved_image(item, arguments.quality),
                heatmap=item.heatmap(),
                regions=halved_regions(item),
            )
    print(f"{arguments.output}: {arguments.output.stat().st_size / 1e6:.1f} MB")


if __name__ == "__main__":
    main()
