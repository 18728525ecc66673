"""The detect step: frames -> heatmaps, as recorded, by a detector on the pictures, or by a function."""

from __future__ import annotations

import hashlib
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence._core import Terrain
from crowdfence.errors import FrameError, quoted
from crowdfence.pipeline.far_looks import FarLooks
from crowdfence.pipeline.picture_watch import PictureWatch
from crowdfence.pipeline.still_video import StillVideo
from crowdfence.sources.layers import CROWD, LANDING_SITE
from crowdfence.sources.recording import Frame, Instant, InstantViews, Pixels, Recording

if TYPE_CHECKING:
    from crowdfence.detector.contract.contract import Contract
    from crowdfence.detector.detector import Detector
    from crowdfence.detector.execution_device import Device
    from crowdfence.detector.ground_sampling import GroundSampling

HeatmapFunction = Callable[[Frame], Pixels]

PEOPLE_GRID = 48, 64
"""Rows and columns of the rays that tell how far apart people stand."""
SIZES_GRID = 12, 16
"""Of those that tell at which size a part of a picture is shown."""


@dataclass(frozen=True, slots=True, eq=False)
class HeatmapSource:
    """Frame -> heatmap, and who makes it. `heatmap_source` makes one."""

    kind: Literal["recorded", "model", "function"]
    heatmap_of: HeatmapFunction = field(repr=False)
    """FrameError for a frame without a usable heatmap."""
    contract: Contract | None = None
    """What the model that makes them, or made recorded ones (`detect`), states about itself."""
    model: Path | None = None
    """The file of a model."""
    device: Device | None = None
    """Where a model computes."""
    members: tuple[Detector, ...] = ()
    """The models of a combination."""
    near_of: HeatmapFunction | None = field(default=None, repr=False)
    """Frame -> heatmap of near ground alone, the rest masked; None: looks leave nothing out."""
    far_every_s: float = 0.0
    """From one look of a drone that leaves nothing out to its next."""
    watch: PictureWatch = field(default_factory=PictureWatch)
    """What the pictures were like that a model was shown."""

    def detected(
        self,
        instants: Iterable[Instant],
        drones: int,
        video: StillVideo | None = None,
        far: FarLooks | None = None,
    ) -> Iterator[tuple[Instant, InstantViews]]:
        """The step: each instant with its views and refused frames, in order. `video` refuses the views of
        videos that stand still; whoever asks how they stand gives it, and who goes on with a flight gives the
        `far` looks of before.

        An ONNX model looks at the drones of an instant side by side, one thread each, which share its
        session, and at the next instant while the caller works on this one. Of other functions nobody knows
        whether they may be called so, nor of a combination that has one.
        """
        video = StillVideo() if video is None else video
        if self.model is None and not (self.members and all(member.path for member in self.members)):
            for instant in instants:
                yield instant, video.moving(instant.views(self.heatmap_of), instant)
            return
        begun: deque[Callable[[], tuple[Instant, InstantViews]]] = deque()
        far = self.far_looks() if far is None else far
        with ThreadPoolExecutor(drones, thread_name_prefix="detector") as executor:

            def begin(instant: Instant) -> Callable[[], tuple[Instant, InstantViews]]:
                near = {frame.drone for frame in instant.frames if self.leaves_far_out(frame, far)}
                shown = _read_once(instant)
                views = shown.views_begun(partial(self._look, near), executor)
                return lambda: (instant, video.moving(views(), shown, of_pictures=True))

            for instant in instants:
                begun.append(begin(instant))
                if len(begun) > 1:
                    yield begun.popleft()()
            for finished in begun:
                yield finished()

    def shrunk(self, sizes: Collection[tuple[int, int]], gsd_m: float | None = None) -> list[str]:
        """What is said where models see pictures of these widths and heights far smaller than they are."""
        from crowdfence.detector.validity import shrunk_warnings

        alone = [] if self.contract is None else [self.contract]
        contracts = [member.contract for member in self.members] or alone
        return shrunk_warnings(contracts, sizes, gsd_m)

    def far_looks(self) -> FarLooks:
        """For one flight."""
        return FarLooks(self.far_every_s)

    def leaves_far_out(self, frame: Frame, far: FarLooks) -> bool:
        """Whether the look at a frame along a flight is at near ground alone; to be asked once for each, in
        their order."""
        return self.near_of is not None and not far.takes(frame.drone, frame.stamp_ns)

    def look(self, frame: Frame, *, near: bool) -> Pixels:
        """The heatmap of a frame, or of its near ground. FrameError for a frame without a usable one."""
        return self.heatmap_of(frame) if self.near_of is None or not near else self.near_of(frame)

    def _look(self, near: Collection[str], frame: Frame) -> Pixels:
        return self.look(frame, near=frame.drone in near)

    @property
    def of_detectors(self) -> list[str]:
        """What is doubtful about detectors that look together, known before they look at anything."""
        if not self.members or self.contract is None:
            return []
        from crowdfence.detector.combination import combination_warnings

        return combination_warnings(self.contract)

    @property
    def warnings(self) -> list[str]:
        """That, and what is doubtful about the pictures looked at so far, one sentence each."""
        return [*self.of_detectors, *self.watch.warnings]

    def to_json(self) -> dict[str, Any]:
        """For a summary: what made the heatmaps, with the checksum of a model's file."""
        made = (
            {}
            if self.contract is None
            else describe_model(self.contract, self.model, self.members, self.device)
        )
        if self.watch.looked_at:
            made["pictures"] = self.watch.to_json()
        if self.near_of is not None:
            made["far_every_s"] = self.far_every_s
        return {"heatmaps": self.kind, **made}


def _read_once(instant: Instant) -> Instant:
    """Whose pictures are looked at by a detector, and then asked whether they are the ones before."""
    frames = (
        frame
        if frame.pixels.image is None
        else replace(frame, pixels=replace(frame.pixels, image=cache(frame.pixels.image)))
        for frame in instant.frames
    )
    return replace(instant, frames=tuple(frames))


_SHOWN = 0.5
"""From here on a heatmap shows somebody."""


def _unless_blind(heatmap_of: HeatmapFunction, layer: str = CROWD) -> HeatmapFunction:
    """The function; FrameError where its heatmap shows nobody and the picture of the frame shows nothing:
    whoever made it saw nothing. One that shows crowd is of another sensor than the picture, or errs safely.
    Of landing sites no heatmap does: one tone looks like level, open ground.
    """

    def seeing(frame: Frame) -> Pixels:
        heatmap = heatmap_of(frame)
        told = "" if layer == LANDING_SITE else "its heatmap shows nobody, and "
        if frame.pixels.image is None or (told and not _shows_nobody(heatmap)):
            return heatmap
        if reason := _blind(frame):
            raise FrameError(frame.drone, frame.stamp_ns, f"{told}{reason}")
        return heatmap

    return seeing


def _shows_nobody(heatmap: Pixels) -> bool:
    """False for what is no heatmap: the core says what is wrong with it."""
    values = np.asarray(np.ma.filled(heatmap, 0))
    if values.size == 0 or values.dtype.kind not in "uf":
        return False
    return bool(values.max() < (_SHOWN * 255 if values.dtype == np.uint8 else _SHOWN))


def _blind(frame: Frame) -> str | None:
    """Why its picture shows nothing; None too where it cannot be read, which says nothing of the heatmap."""
    from crowdfence.detector.blank_picture import blank_reason

    try:
        return blank_reason(frame.image())
    except FrameError:
        return None


RECORDED = HeatmapSource("recorded", _unless_blind(Frame.heatmap))


def recorded_heatmaps(recording: Recording) -> HeatmapSource:
    """The heatmaps of crowds as recorded. Those that `crowdfence detect` wrote count for what the detector's
    calibration says of them, as where it looks at the pictures itself. ValueError where what the recording
    says of that detector cannot be read."""
    told = recording.manifest.get("detector")
    if told is None:
        return RECORDED
    from crowdfence.detector.contract.contract import Contract

    if not isinstance(told, dict):
        raise ValueError(f"{recording.name}: what it says of its detector is no contract: {quoted(told)}")
    try:
        contract = Contract.from_json(told)
    except ValueError as error:
        raise ValueError(
            f"{recording.name}: what it says of the detector that made its heatmaps cannot be read: {error}; "
            "make them again (crowdfence detect)"
        ) from error
    return replace(RECORDED, contract=contract)


def heatmap_source(
    detector: Detector | HeatmapFunction | None,
    terrain: Terrain | None,
    max_range_m: float,
    *,
    whole: bool = True,
    gsd_of: Callable[[Frame], float | None] | None = None,
    layer: str = CROWD,
    recording: Recording | None = None,
) -> HeatmapSource:
    """Who makes the heatmaps. None: they are taken as recorded, and are those of the detector that
    `recording` names, where it does (`recorded_heatmaps`). A `Detector` sees the pictures; where its
    model needs metres per pixel they come from the frame's pose and the terrain; a picture that shows nothing
    is refused (`blank_picture`). Any other function is called with the frame. A heatmap of either that shows
    nobody is refused beside such a picture, and of the `layer` of landing sites any.

    `whole`: every look takes in all of its picture, whatever `Detector.far_every_s` says. `gsd_of`: metres
    per pixel of a whole picture for which there is no terrain, None where nobody knows them.

    ValueError when a terrain is needed and missing, TypeError for what is neither detector nor function.
    """
    if detector is None:
        if layer != CROWD:
            return HeatmapSource("recorded", _unless_blind(Frame.heatmap, layer))
        return RECORDED if recording is None else recorded_heatmaps(recording)
    from crowdfence.detector.detector import Detector

    if not isinstance(detector, Detector):
        if not callable(detector):
            raise TypeError(f"detector is {quoted(detector)}; of a model it is Detector({quoted(detector)})")
        return HeatmapSource("function", _unless_blind(_refusing(detector), layer))
    watch, near_of = PictureWatch(detector.contract), None
    heatmap_of: HeatmapFunction
    if terrain is not None and not detector.uses_gsd and watch.ground.is_known:
        heatmap_of = partial(_detect_on_ground, detector, watch, terrain, max_range_m)
    elif not detector.uses_gsd or (terrain is None and gsd_of is None and not detector.needs_gsd):
        heatmap_of = partial(_detect, detector, watch)
    elif terrain is None and gsd_of is not None:
        heatmap_of = partial(_detect_at_one_scale, detector, watch, gsd_of)
    elif terrain is not None:
        heatmap_of = partial(_detect_to_scale, detector, watch, terrain, max_range_m)
        if detector.far_every_s > 0.0 and not whole:
            near_of = _refusing(partial(heatmap_of, near=True))
    else:
        contract = next(one.contract for one in (*detector.members, detector) if one.needs_gsd)
        raise ValueError(
            f"{contract.name} gives {contract.output.kind}, which become a heatmap only with metres per "
            "pixel: give a map with --terrain"
        )
    return HeatmapSource(
        "model",
        _refusing(heatmap_of),
        detector.contract,
        detector.path,
        detector.device,
        detector.members,
        near_of,
        detector.far_every_s,
        watch,
    )


def describe_model(
    contract: Contract,
    path: Path | None,
    members: Sequence[Detector] = (),
    device: Device | None = None,
) -> dict[str, Any]:
    """Which model exactly, for JSON; `path` is None for a function. `members`: those of a combination.
    `device`: told where it is no processor."""
    described: dict[str, Any] = {
        "name": contract.name,
        "version": contract.version,
        "file": None if path is None else path.name,
        "sha256": None if path is None else _sha256(path),
    }
    if device not in (None, "cpu"):
        described["device"] = device
    if members:
        from crowdfence.detector.combination import combination_warnings

        described["calibrated_together"] = not combination_warnings(contract)
        described["members"] = [
            describe_model(one.contract, one.path, one.members, one.device) for one in members
        ]
    return described


def _detect(detector: Detector, watch: PictureWatch, frame: Frame) -> Pixels:
    return _watched(watch, detector(_image(frame, watch)))


def _detect_on_ground(
    detector: Detector, watch: PictureWatch, terrain: Terrain, max_range_m: float, frame: Frame
) -> Pixels:
    """Of a detector that says where it was tested, and looks at all ground alike."""
    _sampled(watch, terrain, max_range_m, frame, SIZES_GRID)
    return _detect(detector, watch, frame)


def _detect_at_one_scale(
    detector: Detector, watch: PictureWatch, gsd_of: Callable[[Frame], float | None], frame: Frame
) -> Pixels:
    gsd_m = gsd_of(frame)
    if gsd_m is None and detector.needs_gsd:
        raise FrameError(frame.drone, frame.stamp_ns, "the metres per pixel of its picture are unknown")
    return _watched(watch, detector(_image(frame, watch), gsd_m=gsd_m))


def _detect_to_scale(
    detector: Detector,
    watch: PictureWatch,
    terrain: Terrain,
    max_range_m: float,
    frame: Frame,
    *,
    near: bool = False,
) -> Pixels:
    """`near`: of near ground alone. Where no ground is seen, what the picture shows is at its own size for
    all, and the look is a whole one."""
    needed = detector.needs_gsd
    counts_people = detector.contract.output.rule is not None or detector.members
    sampling = _sampled(watch, terrain, max_range_m, frame, PEOPLE_GRID if counts_people else SIZES_GRID)
    if sampling.sees_ground and near:
        return detector.near_ground(_image(frame, watch), sampling.along_ground())
    if sampling.sees_ground:
        return _watched(watch, detector(_image(frame, watch), gsd_m=sampling.along_ground()))
    if needed:
        raise ValueError("sees no ground of the map, so metres per pixel are unknown")
    return _watched(watch, detector(_image(frame, watch), as_it_is=True))


def _sampled(
    watch: PictureWatch, terrain: Terrain, max_range_m: float, frame: Frame, grid: tuple[int, int]
) -> GroundSampling:
    from crowdfence.detector.ground_sampling import ground_sampling

    rows, columns = grid
    sampling = ground_sampling(
        frame.camera, frame.world_from_camera, terrain, max_range_m=max_range_m, rows=rows, columns=columns
    )
    watch.ground.look(frame.drone, sampling)
    return sampling


def _watched(watch: PictureWatch, heatmap: NDArray[np.float32]) -> NDArray[np.float32]:
    watch.answered(heatmap)
    return heatmap


def _image(frame: Frame, watch: PictureWatch) -> NDArray[np.uint8]:
    """FrameError for a picture that shows nothing: where nothing can be seen no crowd is not seen either."""
    from crowdfence.detector.blank_picture import blank_reason

    image = frame.image()
    if reason := blank_reason(image):
        raise FrameError(frame.drone, frame.stamp_ns, reason)
    watch.look(f"{frame.drone} at {frame.stamp_ns}", image, frame.drone)
    return image


def _refusing(function: HeatmapFunction) -> HeatmapFunction:
    """The function, its ValueErrors, OSErrors and RuntimeErrors made refusals of the frame at hand. Anything
    else is a mistake in the function itself and ends the run."""

    def heatmap_of(frame: Frame) -> Pixels:
        try:
            return function(frame)
        except FrameError:
            raise
        except (ValueError, OSError, RuntimeError) as error:
            raise FrameError(frame.drone, frame.stamp_ns, f"the detector failed: {error}") from error

    return heatmap_of


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        digest = hashlib.sha256()
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
