"""What every source yields: frames with known cameras and poses, their pixels still on disk."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Camera, View
from crowdfence.errors import FrameError
from crowdfence.georeference import Georeference
from crowdfence.sources.camera_mask import CameraMask
from crowdfence.sources.layers import CROWD, LayerGround, LayerPixels
from crowdfence.sources.pose_track import PoseTrack
from crowdfence.sources.recorded_truth import CameraPose, FrameTruth, PeopleLog, RecordedPeople
from crowdfence.sources.synchronize import group_instants

Pixels = NDArray[Any]
PixelsT = TypeVar("PixelsT")
MOST_TOLERANCE_MS = 86_400_000.0


@dataclass(frozen=True, slots=True)
class RefusedFrame:
    """A frame that was recorded but does not take part, and why."""

    drone: str
    stamp_ns: int | None
    """None when not even the stamp could be read."""
    reason: str

    def __str__(self) -> str:
        return f"{self.drone or '(unknown drone)'} at {self.stamp_ns}: {self.reason}"


@dataclass(frozen=True, slots=True)
class PixelSources:
    """Where the pixels of one frame come from: functions called when pixels are wanted, None = not recorded.

    image         encoded picture, the bytes as recorded (JPEG, PNG or PPM)
    heatmap       [h, w] uint8 (value / 255) or float in [0, 1], at any stride of the image
    regions       [H, W] crowd number per image pixel, 0 = none: truth, silhouettes merged and gaps filled
    silhouettes   [H, W] bool, pixels that show a person of a crowd: truth, as segmented
    depth_m       [H, W] float32, distance along the camera's z axis in metres, NaN = unknown: truth
    segmentation  [H, W] uint8, class of what a pixel shows (`mission.layout.CLASSES`): truth
    instances     [H, W] number of the person that a pixel shows, 0 = none: truth
    layers        heatmaps of other classes, by the name of the layer
    """

    image: Callable[[], bytes] | None = None
    heatmap: Callable[[], Pixels] | None = None
    regions: Callable[[], Pixels] | None = None
    silhouettes: Callable[[], NDArray[np.bool_]] | None = None
    depth_m: Callable[[], NDArray[np.float32]] | None = None
    segmentation: Callable[[], Pixels] | None = None
    instances: Callable[[], Pixels] | None = None
    layers: Mapping[str, LayerPixels] = field(default_factory=dict)

    def of_layer(self, name: str) -> PixelSources:
        """The same with the heatmap of a layer, and with its labels for those of crowds."""
        layer = self.layers.get(name, LayerPixels())
        return replace(self, heatmap=layer.heatmap, regions=layer.labels, silhouettes=None)


@dataclass(frozen=True, slots=True, eq=False)
class Frame:
    """One image of one drone. Pixels are read when asked for, each time anew; nothing is kept in memory."""

    drone: str
    stamp_ns: int
    camera: Camera
    world_from_camera: NDArray[np.float64]
    """Rigid transform [4, 4], camera axes (OpenCV) -> local ENU metres."""
    pixels: PixelSources = field(default_factory=PixelSources, repr=False)
    truth: FrameTruth = field(default_factory=FrameTruth, repr=False)
    mask: CameraMask | None = field(default=None, repr=False)
    """Where the picture shows no ground."""

    def __repr__(self) -> str:
        east, north, up = self.world_from_camera[:3, 3]
        size = f"{self.camera.width}x{self.camera.height}"
        return f"Frame({self.drone} at {self.stamp_ns}, {size}, from ({east:.1f}, {north:.1f}, {up:.1f}) m)"

    def heatmap(self) -> Pixels:
        """Heatmap [h, w] as recorded. FrameError when there is none or it is damaged."""
        return self._read("heatmap", self.pixels.heatmap)

    def encoded_image(self) -> bytes:
        """The picture's bytes as recorded. FrameError when there is none."""
        return self._read("image", self.pixels.image)

    def image(self) -> NDArray[np.uint8]:
        """The picture [H, W, 3], RGB. FrameError when there is none or it is damaged."""
        from crowdfence.sources.pictures.decoding import decode_rgb

        size = (self.camera.width, self.camera.height)
        return self._read("image", lambda: decode_rgb(self.encoded_image(), size))

    def regions(self) -> Pixels:
        """True crowd number per image pixel [H, W], 0 = none. FrameError when not recorded or damaged."""
        return self._read_at_image_size("crowd regions", self.pixels.regions)

    def silhouettes(self) -> NDArray[np.bool_]:
        """True where an image pixel shows a person of a crowd [H, W]. FrameError as for `regions`."""
        return self._read_at_image_size("silhouettes", self.pixels.silhouettes)

    def depth_m(self) -> NDArray[np.float32]:
        """True depth along the camera's z axis [H, W], NaN = unknown. FrameError as for `regions`."""
        return self._read_at_image_size("depth", self.pixels.depth_m)

    def segmentation(self) -> Pixels:
        """True class per image pixel [H, W], see `mission.layout.CLASSES`. FrameError as for `regions`."""
        return self._read_at_image_size("segmentation", self.pixels.segmentation)

    def instances(self) -> Pixels:
        """True number of the person per image pixel [H, W], 0 = none. FrameError as for `regions`."""
        return self._read_at_image_size("instances", self.pixels.instances)

    def true_pose(self) -> CameraPose:
        """The camera as it was at the exposure. FrameError when not recorded or damaged."""
        return self._read("true pose", self.truth.pose)

    def exposure_ns(self) -> int:
        """When the picture was taken on the clock of the world. FrameError as for `true_pose`."""
        return self._read("true time", self.truth.exposure_ns)

    def people(self) -> RecordedPeople:
        """Everybody inside the picture, with the number of pixels that show each (0 = hidden). FrameError as
        for `true_pose`."""
        return self._read("people", self.truth.people)

    def view(self, heatmap: Pixels | None = None) -> View:
        """The frame for the core, with the recorded heatmap or the one given (a detector's), without what
        the mask hides.

        FrameError when the heatmap cannot be read or the core refuses it (shape, range, NaN).
        """
        if heatmap is None:
            heatmap = self.heatmap()
        heatmap = self.masked(heatmap)
        try:
            return View(self.drone, self.stamp_ns, self.camera, self.world_from_camera, heatmap)
        except ValueError as error:
            raise self._error(str(error)) from error

    def masked(self, heatmap: Pixels) -> Pixels:
        """A heatmap of this frame with the cells masked that its mask hides. FrameError for a mask of other
        proportions than the picture."""
        if self.mask is None:
            return heatmap
        try:
            return self.mask.over(heatmap, self.camera.width, self.camera.height)
        except ValueError as error:
            raise self._error(str(error)) from error

    def is_whole(self, view: View) -> bool:
        """Whether a view of this frame leaves out nothing but what the mask hides."""
        if view.looked_at is None or self.mask is None:
            return view.looked_at is None
        return np.array_equal(~view.looked_at, self.mask.cells(*view.looked_at.shape))

    def _read(self, what: str, read: Callable[[], PixelsT] | None) -> PixelsT:
        if read is None:
            raise self._error(f"has no {what}")
        try:
            return read()
        except FrameError:
            raise
        except (OSError, ValueError) as error:
            raise self._error(f"{what} cannot be read: {error}") from error

    def _read_at_image_size(self, what: str, read: Callable[[], NDArray[Any]] | None) -> NDArray[Any]:
        pixels = self._read(what, read)
        expected = (self.camera.height, self.camera.width)
        if pixels.shape != expected:
            raise self._error(f"{what} have shape {pixels.shape}, the image has {expected}")
        return pixels

    def _error(self, reason: str) -> FrameError:
        return FrameError(self.drone, self.stamp_ns, reason)


class InstantViews(NamedTuple):
    """The frames of an instant for the core: `views, refused = instant.views()`."""

    views: list[View]
    """In the order of the frames."""
    refused: list[RefusedFrame]
    """Frames that turned out to be unusable; the others are not affected."""


@dataclass(frozen=True, slots=True, eq=False)
class Instant:
    """Frames of different drones that count as simultaneous."""

    stamp_ns: int
    """The newest stamp of the group."""
    frames: tuple[Frame, ...]
    ground_contacts: Mapping[str, GroundContact] = field(default_factory=dict)
    """Drones of the recording whose heights wait for the map: a view of theirs would stand anywhere."""

    def __repr__(self) -> str:
        return f"Instant({self.stamp_ns}, {', '.join(frame.drone for frame in self.frames)})"

    def views(self, heatmap_of: Callable[[Frame], Pixels] = Frame.heatmap) -> InstantViews:
        """The frames as views for the core, with the recorded heatmaps or those of a detector.

        `heatmap_of` raises FrameError for a frame without a usable heatmap. ValueError while heights wait for
        a map.
        """
        require_heights(self.ground_contacts)
        return _sorted_out(map(partial(_view_or_refusal, heatmap_of), self.frames))

    def views_begun(
        self, heatmap_of: Callable[[Frame], Pixels], executor: Executor
    ) -> Callable[[], InstantViews]:
        """The same by threads, which begin at once; what is returned waits for them. The views still come in
        the order of the frames."""
        require_heights(self.ground_contacts)
        return partial(_sorted_out, executor.map(partial(_view_or_refusal, heatmap_of), self.frames))


def _sorted_out(results: Iterable[View | RefusedFrame]) -> InstantViews:
    views, refused = list[View](), list[RefusedFrame]()
    for result in results:
        if isinstance(result, RefusedFrame):
            refused.append(result)
        else:
            views.append(result)
    return InstantViews(views, refused)


def _view_or_refusal(heatmap_of: Callable[[Frame], Pixels], frame: Frame) -> View | RefusedFrame:
    try:
        heatmap = heatmap_of(frame)
        if heatmap is None:
            # `Frame.view` would take the recorded one.
            told = "it must be an array [h, w], or FrameError raised for a frame without"
            raise TypeError(f"the heatmap made for {frame.drone} at {frame.stamp_ns} is None; {told}")
        return frame.view(heatmap)
    except FrameError as error:
        return RefusedFrame(frame.drone, frame.stamp_ns, error.reason)
    except StopIteration as error:
        # It would end the loop over the frames, and this and all later ones would be missed by nobody.
        told = f"no heatmap was made for {frame.drone} at {frame.stamp_ns}: the function raised StopIteration"
        raise RuntimeError(f"{told}, as `next` does where nothing is left") from error


@dataclass(frozen=True, slots=True)
class GroundContact:
    """Heights of a drone that wait for the map, see `ground_contact.on_ground`."""

    place: tuple[float, float, float] | None
    """Local point that was on the ground, such as the take-off; None: heights count from the ground below."""
    said: str
    """Where that is known from."""
    absolute: bool = False
    """The heights were measured from elsewhere: what they move by is their bias."""


def require_heights(waiting: Mapping[str, GroundContact]) -> None:
    """ValueError while those of a drone wait for a map."""
    if waiting:
        drone, contact = next(iter(waiting.items()))
        raise ValueError(
            f"heights of {drone} count from the ground ({contact.said}), so the map is needed: give it with "
            "--terrain (sources.ground_contact.on_ground in Python)"
        )


@dataclass(frozen=True, slots=True, eq=False)
class Recording:
    """A flight of one or more drones, whatever it was stored as. `open_recording` makes one."""

    name: str
    drones: tuple[str, ...]
    """Every drone of the fleet, also one whose frames were all refused."""
    frames: tuple[Frame, ...]
    """All usable frames of all drones by stamp."""
    georeference: Georeference | None
    terrain: Path | None
    """A map file that came with the recording."""
    refused: tuple[RefusedFrame, ...]
    """Frames that do not take part. Pixels are read later: `Instant.views` says which of those cannot be."""
    warnings: tuple[str, ...]
    """What the reader had to assume or could not read, one sentence each."""
    manifest: dict[str, Any]
    """What the source says about itself, ready for JSON."""
    pose_tracks: Mapping[str, PoseTrack]
    people: PeopleLog = field(default_factory=PeopleLog, repr=False)
    """Everybody in the world over time, where a simulator or a survey recorded it."""
    ground_contacts: Mapping[str, GroundContact] = field(default_factory=dict)
    """Drones whose heights wait for the map."""
    layer: str = CROWD
    """Of which class its heatmaps and labels are."""
    longest_gap_s: float = 3600.0
    """Longest time between two instants that its clocks are believed to tell."""
    layer_grounds: Mapping[str, LayerGround] = field(default_factory=dict, repr=False)
    """Where in the world other classes are, by the name of the layer, where a simulator recorded it."""
    terrain_options: Mapping[str, Any] = field(default_factory=dict)
    """How the map that came with it was read when heights were settled on it, as `open_terrain` takes it."""

    def __repr__(self) -> str:
        first, last = self.span_ns or (0, 0)
        refused = f", {len(self.refused)} refused" if self.refused else ""
        frames = f"{len(self.frames)} frames in {(last - first) / 1e9:.1f} s{refused}"
        return f"Recording({self.name!r}, drones {', '.join(self.drones) or 'none'}, {frames})"

    def frames_of(self, drone: str) -> list[Frame]:
        """The frames of one drone by stamp. ValueError for a drone that is not in the recording."""
        self._check_drones([drone])
        return [frame for frame in self.frames if frame.drone == drone]

    def tracks(self) -> dict[str, PoseTrack]:
        """Camera poses over time per drone, at telemetry rate."""
        return dict(self.pose_tracks)

    @property
    def layers(self) -> tuple[str, ...]:
        """Names of the layers that some frame has a heatmap or a label of, beside those of crowds."""
        return tuple(sorted({name for frame in self.frames for name in frame.pixels.layers}))

    def of_layer(self, name: str) -> Recording:
        """The same recording with the heatmaps and labels of one layer in the place of those of crowds.

        ValueError for a layer that it neither holds nor has pictures for, from which a detector could make
        the heatmaps.
        """
        if name == self.layer:
            return self
        held = name in self.layers
        if not held and not any(frame.pixels.image for frame in self.frames):
            there = ", ".join((CROWD, *self.layers))
            raise ValueError(f"{self.name} holds no heatmaps of the layer {name!r}; it holds {there}")
        frames = tuple(replace(frame, pixels=frame.pixels.of_layer(name)) for frame in self.frames)
        return replace(self, frames=frames, layer=name)

    def people_truth(self, stamp_ns: int, *, max_gap_s: float = 0.1) -> RecordedPeople | None:
        """Everybody in the world at the recorded instant nearest to `stamp_ns`; None when none lies within
        `max_gap_s`. Stamps of the world's clock are those of `Frame.exposure_ns`.

        ValueError when the record is damaged.
        """
        return self.people.nearest(stamp_ns, max_gap_s)

    @property
    def span_ns(self) -> tuple[int, int] | None:
        """First and last stamp of the frames, None when there is no frame."""
        return (self.frames[0].stamp_ns, self.frames[-1].stamp_ns) if self.frames else None

    def instants(
        self, tolerance_ms: float = 100.0, *, drones: Sequence[str] | None = None
    ) -> Iterator[Instant]:
        """Frames grouped by time: at most one per drone, first to last within `tolerance_ms`.

        Every usable frame is in exactly one instant, and the stamps of the instants increase. `drones` limits
        the fleet. ValueError for a negative tolerance or an unknown drone.
        """
        if not 0.0 <= tolerance_ms <= MOST_TOLERANCE_MS:
            raise ValueError(
                f"tolerance_ms must be finite and not negative, at most {MOST_TOLERANCE_MS:.0f} (a day), got "
                f"{tolerance_ms:g}"
            )
        fleet = set(self.drones if drones is None else drones)
        self._check_drones(fleet)
        frames = (frame for frame in self.frames if frame.drone in fleet)
        return (
            Instant(group[-1].stamp_ns, tuple(group), self.ground_contacts)
            for group in group_instants(frames, int(tolerance_ms * 1e6))
        )

    def _check_drones(self, drones: Sequence[str] | set[str]) -> None:
        unknown = sorted(set(drones) - set(self.drones))
        if unknown:
            raise ValueError(
                f"no drone {unknown[0]!r} in {self.name}: it holds {', '.join(self.drones) or 'none'}"
            )
