"""Any recording -> a mission file with the same frames, poses and pixels."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, field, replace
from heapq import merge
from operator import itemgetter
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from crowdfence.errors import FrameError
from crowdfence.sources.layers import LayerPixels
from crowdfence.sources.mission.attached_map import is_copy
from crowdfence.sources.mission.layout import CROWD_CLASS
from crowdfence.sources.mission.messages import LayerContent
from crowdfence.sources.mission.topic_writer import TopicMessage
from crowdfence.sources.mission.writer import MissionWriter
from crowdfence.sources.no_frame import no_frame_line
from crowdfence.sources.pictures.decoding import as_png, picture_format
from crowdfence.sources.place_camera import Limits
from crowdfence.sources.placed_again import widest_gap_s
from crowdfence.sources.pose_noise import smoothed_by
from crowdfence.sources.recording import Frame, Pixels, Recording, RefusedFrame, require_heights

Progress = Callable[[int, int], None]
"""Called with (frames done, frames in all)."""

ValueT = TypeVar("ValueT")


@dataclass(frozen=True, slots=True)
class Conversion:
    """What a conversion wrote and what it could not."""

    path: Path
    frames: dict[str, int]
    """Frames written per drone."""
    poses: int
    refused: list[RefusedFrame]
    """Frames that are not in the file: those of the recording and those whose heatmap cannot be used."""
    omitted: list[str]
    """Pictures and truth that could not be read; their frames are in the file without them."""
    size_bytes: int = field(default=0)
    map_inside: str | None = None
    """Name of the map that went into the file."""


def convert(
    recording: Recording,
    path: str | PathLike[str],
    *,
    heatmap_of: Callable[[Frame], Pixels] | None = None,
    detector: Mapping[str, Any] | None = None,
    source: str | None = None,
    beside: Iterable[TopicMessage] = (),
    depth_images: bool = False,
    terrain: Path | None = None,
    terrain_options: Mapping[str, Any] | None = None,
    map_inside: bool = True,
    progress: Progress | None = None,
) -> Conversion:
    """Write the recording as a mission file.

    `heatmap_of` makes the heatmaps instead of the recorded ones; it raises FrameError for a frame without.
    `detector` is what a model that makes them states about itself; what the recording says of the recorded
    ones goes with those.
    `source` says where the file comes from, instead of the recording's kind and name. `beside` are messages
    of others for the same file, in the order of their stamps. `depth_images`: depth as viewers draw it. The
    map goes into the file, the recording's own or `terrain` instead; without `map_inside` the file names the
    place of the map. `terrain_options` say how it is to be read, and go with it.

    The camera poses are stored as the recording holds them, so the file gives the same views bit for bit.
    Pictures keep their bytes (other kinds than JPEG and PNG become PNG). OSError when the file cannot be
    written, ValueError for a map too large to go into it and where no frame can be used; nothing is left
    behind then.
    """
    require_heights(recording.ground_contacts)
    refused = list(recording.refused)
    conversion = Conversion(
        Path(path), dict.fromkeys(recording.drones, 0), _pose_count(recording), refused, []
    )
    done = 0
    options = {**({} if terrain else recording.terrain_options), **(terrain_options or {})}
    terrain = terrain or recording.terrain
    if terrain is not None and not map_inside and is_copy(terrain):
        conversion.omitted.append("the map inside the recording, which has no place of its own")
        terrain = None
    with MissionWriter(
        path,
        georeference=recording.georeference,
        terrain=terrain,
        map_inside=map_inside,
        terrain_options=options,
        source=_source(recording) if source is None else source,
        depth_images=depth_images,
    ) as writer:
        if "simulation" in recording.manifest:
            writer.add_simulation(recording.manifest["simulation"])
        if "alignment" in recording.manifest:
            writer.add_alignment(recording.manifest["alignment"])
        made_by = recording.manifest.get("detector") if heatmap_of is None else detector
        if made_by is not None:
            writer.add_detector(made_by)
        if smoothed := smoothed_by(recording.manifest):
            writer.add_pose_noise({drone: asdict(noise) for drone, noise in smoothed.items()})
        for drone in recording.drones:
            writer.add_drone(drone, pose_gap_s=_bridged_s(recording, drone))
        for layer, ground in recording.layer_grounds.items():
            writer.add_layer_ground(layer, ground, (recording.span_ns or (0, 0))[0])
        others = ((message.stamp_ns, message) for message in beside)
        everything = merge(
            _poses(recording), _people(recording), _frames(recording), others, key=itemgetter(0)
        )
        for stamp_ns, item in everything:
            if item is None:
                _write_people(writer, recording, stamp_ns, conversion)
            elif isinstance(item, Frame):
                _write_frame(writer, item, heatmap_of or _recorded_heatmap, conversion)
                done += 1
                if progress is not None:
                    progress(done, len(recording.frames))
            elif isinstance(item, TopicMessage):
                writer.add_message(item)
            else:
                writer.add_pose(*item)
        if not any(conversion.frames.values()):
            raise ValueError(no_frame_line(recording, refused))
        writer.add_refused(refused)
        writer.add_warnings(recording.warnings)
        if "statistics" in recording.manifest:
            writer.add_statistics(recording.manifest["statistics"])
    return Conversion(
        conversion.path,
        conversion.frames,
        conversion.poses,
        refused,
        conversion.omitted,
        conversion.path.stat().st_size,
        terrain.name if terrain is not None and map_inside else None,
    )


def _bridged_s(recording: Recording, drone: str) -> float | None:
    """Over which gap of the poses its frames were placed, where readers would refuse them: the subtitles of a
    film may come once a second."""
    gap_s = widest_gap_s(recording, drone)
    return gap_s if gap_s > Limits().max_pose_gap_s else None


def _recorded_heatmap(frame: Frame) -> Pixels | None:
    return frame.heatmap() if frame.pixels.heatmap else None


def _write_frame(
    writer: MissionWriter,
    frame: Frame,
    heatmap_of: Callable[[Frame], Pixels | None],
    conversion: Conversion,
) -> None:
    try:
        heatmap = heatmap_of(frame)
        if heatmap is not None:
            frame.view(heatmap)
    except FrameError as error:
        conversion.refused.append(RefusedFrame(frame.drone, frame.stamp_ns, error.reason))
        return
    pixels, truth = frame.pixels, frame.truth
    segmentation = _read(pixels.segmentation, frame.segmentation, frame, conversion)
    writer.add_camera(frame.drone, frame.camera)
    writer.add_frame(
        frame.drone,
        frame.stamp_ns,
        image=_read(pixels.image, lambda: _jpeg_or_png(frame.encoded_image()), frame, conversion),
        heatmap=heatmap,
        regions=_read(pixels.regions, frame.regions, frame, conversion),
        silhouettes=_silhouettes(frame, segmentation, conversion),
        depth_m=_read(pixels.depth_m, frame.depth_m, frame, conversion),
        segmentation=segmentation,
        instances=_read(pixels.instances, frame.instances, frame, conversion),
        true_pose=_read(truth.pose, frame.true_pose, frame, conversion),
        exposure_ns=_read(truth.exposure_ns, frame.exposure_ns, frame, conversion),
        people=_read(truth.people, frame.people, frame, conversion),
        layers={name: _layer(frame, name, layer, conversion) for name, layer in pixels.layers.items()},
    )
    conversion.frames[frame.drone] += 1


def _layer(frame: Frame, name: str, layer: LayerPixels, conversion: Conversion) -> LayerContent:
    of_layer = replace(frame, pixels=frame.pixels.of_layer(name))
    labels = _read(layer.labels, of_layer.regions, frame, conversion)
    heatmap = _read(layer.heatmap, of_layer.heatmap, frame, conversion)
    return LayerContent(heatmap, None if labels is None else labels > 0)


def _silhouettes(
    frame: Frame, segmentation: NDArray[Any] | None, conversion: Conversion
) -> NDArray[np.bool_] | None:
    """None where the segmentation says the same."""
    silhouettes = _read(frame.pixels.silhouettes, frame.silhouettes, frame, conversion)
    if silhouettes is None or segmentation is None:
        return silhouettes
    return None if np.array_equal(silhouettes, segmentation == CROWD_CLASS) else silhouettes


def _read(source: object, read: Callable[[], ValueT], frame: Frame, conversion: Conversion) -> ValueT | None:
    if source is None:
        return None
    try:
        return read()
    except ValueError as error:
        reason = error.reason if isinstance(error, FrameError) else str(error)
        conversion.omitted.append(f"{frame.drone} at {frame.stamp_ns}: {reason}")
        return None


def _write_people(writer: MissionWriter, recording: Recording, stamp_ns: int, conversion: Conversion) -> None:
    try:
        people = recording.people_truth(stamp_ns)
    except ValueError as error:
        conversion.omitted.append(f"people of the world at {stamp_ns}: {error}")
        return
    if people is not None:
        writer.add_people(people)


def _jpeg_or_png(data: bytes) -> bytes:
    return data if picture_format(data) else as_png(data)


def _frames(recording: Recording) -> Iterator[tuple[int, Any]]:
    return ((frame.stamp_ns, frame) for frame in recording.frames)


def _people(recording: Recording) -> Iterator[tuple[int, Any]]:
    return ((stamp_ns, None) for stamp_ns in recording.people.stamps_ns)


def _poses(recording: Recording) -> Iterator[tuple[int, Any]]:
    per_drone = [
        [
            (int(stamp_ns), (drone, int(stamp_ns), position, quaternion))
            for stamp_ns, position, quaternion in zip(
                track.stamps_ns, track.positions, track.quaternions, strict=True
            )
        ]
        for drone, track in recording.tracks().items()
    ]
    return merge(*per_drone, key=lambda entry: entry[0])


def _pose_count(recording: Recording) -> int:
    return sum(len(track) for track in recording.tracks().values())


def _source(recording: Recording) -> str:
    return f"{recording.manifest.get('kind', 'recording')} {recording.name}"
