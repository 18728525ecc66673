"""Image -> heatmap: the shipped model, any other model under a contract, or any function."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Any, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.detector.combination import CombinedModel, combined_contract, rule_for
from crowdfence.detector.contract.contract import Contract, contract_of, read_contract
from crowdfence.detector.contract.crowd_rules import PeopleRule
from crowdfence.detector.contract.lookup import FoundContract, find_contract
from crowdfence.detector.execution_device import Device
from crowdfence.detector.ground_scale import Gsd
from crowdfence.detector.inference.even_cells import evenly
from crowdfence.detector.inference.function_model import (
    BoxesFunction,
    HeatmapFunction,
    boxes_contract,
    heatmap_contract,
)
from crowdfence.detector.inference.image_tensor import Image, check_image
from crowdfence.detector.inference.onnx_model import OnnxModel
from crowdfence.detector.inference.picture_parts import Enlarge
from crowdfence.detector.inference.sized_model import SizedModel
from crowdfence.detector.onnx_session import open_session
from crowdfence.detector.shipped import model_path
from crowdfence.errors import DetectorError, quoted

AnyContract = Contract | Mapping[str, Any] | str | PathLike[str]


class _Model(Protocol):
    def heatmap(self, image: Image, gsd_m: Gsd | None, *, as_it_is: bool) -> NDArray[np.float32]: ...

    def heatmaps(
        self, images: Sequence[Image], gsd_m: Sequence[Gsd | None], *, as_it_is: bool
    ) -> list[NDArray[np.float32]]: ...


class Detector:
    """Finds crowds in images.

        detector = Detector()                                # the shipped model
        heatmap = detector(image)                            # uint8 [H, W, 3] RGB -> float32 [h, w] in [0, 1]

    The h x w cells divide the image evenly. They are `stride` pixels wide and high, or where the sides of the
    image are no multiples of that, the largest divisor of it that they are multiples of: h = H / 4 and
    w = W / 4 for a stride of 4 and 640 x 480, h = H and w = W for 641 x 483.
    Images of any size work: they are padded, resized or cut into tiles as the contract says.
    One detector holds one session with its own threads: make one per camera stream.
    """

    def __init__(
        self,
        model: str | PathLike[str] | None = None,
        contract: AnyContract | None = None,
        *,
        threads: int = 1,
        device: Device = "cpu",
        output: Mapping[str, Any] | None = None,
        enlarge: Enlarge = "always",
        far_every_s: float = 0.0,
    ) -> None:
        """Load an ONNX model: its file, or a shipped one by its name, such as "crowdnet-s-wide" (None:
        "crowdnet-s").

        device: "cpu", or "cuda": a GPU of NVIDIA, which needs the package onnxruntime-gpu in the place of
        onnxruntime. `threads` are the processor's. The shipped "crowdnet-s" is then the one in floating
        point, `crowdnet-s-float32`.
        contract: a Contract, its JSON object or the path of a JSON file, instead of what is found with the
        model (see `contract_lookup`).
        output: the "output" object of a contract, for models that come with Hugging Face's description of the
        input only.
        enlarge: whether ground farther away than the model knows is enlarged: "never", "always", or as far as
        that costs no more than a 640 x 480 picture or the picture itself.
        far_every_s: along a flight, such ground is looked at once in so many seconds of a drone and left out
        of its looks in between, see `pipeline.far_looks`; 0: it is never left out.

        OSError when a file cannot be read; DetectorError when the model, the contract or the device cannot be
        used; ValueError for seconds that are negative or not finite, and for another word of `enlarge`.
        """
        if enlarge not in get_args(Enlarge):
            raise ValueError(f"enlarge is {quoted(enlarge)}; allowed: {', '.join(get_args(Enlarge))}")
        if not 0.0 <= far_every_s < float("inf"):
            raise ValueError(f"far_every_s is {far_every_s:g}; it must be finite and >= 0")
        path = model_path(model, device)
        session = open_session(path, threads, device)
        found = find_contract(session.face, output) if contract is None else _given(contract)
        model_shown = SizedModel(
            OnnxModel(session, found.contract), found.contract, enlarge, whole_pictures=device != "cpu"
        )
        self._set_up(model_shown, found, str(path), path, device)
        self._far_every_s = far_every_s if model_shown.tells_near_from_far else 0.0

    def __repr__(self) -> str:
        return f"Detector({self.contract.name!r}, stride {self.contract.output.stride})"

    @classmethod
    def from_callable(
        cls,
        function: Callable[[Image], ArrayLike],
        *,
        stride: int = 1,
        name: str | None = None,
        contract: AnyContract | None = None,
    ) -> Detector:
        """A detector of any function: uint8 [H, W, 3] RGB -> heatmap [h, w] at `stride`, float in [0, 1] or
        uint8 as value / 255. A mask of 0 and 1 is given as float: as uint8 its ones are next to nothing.

        contract: for its rates, validity and target height; its output.stride then counts, not `stride`.
        """
        found = FoundContract(heatmap_contract(_name(function, name), stride), "a function")
        found = found if contract is None else _given(contract)
        return cls._of(HeatmapFunction(function, found.contract), found, found.contract.name)

    @classmethod
    def from_supervision(
        cls,
        function: Callable[[Image], Any],
        *,
        class_ids: Sequence[int] | None,
        stride: int = 4,
        score_min: float | None = None,
        rule: PeopleRule | None = None,
        name: str | None = None,
    ) -> Detector:
        """A detector of a function that gives boxes, as `supervision.Detections` or alike.

        Read are .xyxy [N, 4] in image pixels, .confidence [N] or None (then 1) and .class_id [N].
        class_ids: the classes that are people; None: everything found is. Calls need `gsd_m`.
        """
        contract = boxes_contract(_name(function, name), class_ids, stride, score_min, rule)
        return cls._of(
            BoxesFunction(function, contract), FoundContract(contract, "a function"), contract.name
        )

    @classmethod
    def combined(cls, detectors: Sequence[Detector]) -> Detector:
        """Several detectors as one, by the rule of `combination`; the first is the one whose tested range and
        rates count. ValueError for fewer than two."""
        if len(detectors) < 2:
            raise ValueError(f"{len(detectors)} detectors; a combination has two and more")
        contracts = [detector.contract for detector in detectors]
        rule, calibrated = rule_for(contracts)
        contract = combined_contract(contracts, calibrated=calibrated)
        model = CombinedModel(detectors, rule)
        combination = cls._of(model, FoundContract(contract, "a combination"), contract.name)
        combination._members = tuple(detectors)
        return combination

    @property
    def members(self) -> tuple[Detector, ...]:
        """The detectors of a combination, else none."""
        return self._members

    @property
    def needs_gsd(self) -> bool:
        """There is no heatmap without metres per pixel; of a combination, none of one of its members."""
        return any(one.contract.needs_gsd for one in (self, *self._members))

    @property
    def uses_gsd(self) -> bool:
        """The heatmap depends on metres per pixel, where they are known."""
        return any(one.contract.uses_gsd for one in (self, *self._members))

    @property
    def coarsest_gsd_m(self) -> float | None:
        """Metres per pixel up to which it is shown all ground at a size that it knows; None where its
        contract does not say what it knows."""
        sizes = self.contract.sizes
        enlarged = self._model.enlarged if isinstance(self._model, SizedModel) else 1.0
        return None if sizes is None or sizes.gsd_m is None else sizes.gsd_m[1] * enlarged

    @property
    def far_every_s(self) -> float:
        """Along a flight, ground that is farther away than the model knows is looked at once in so many
        seconds of a drone; 0: in every picture, as always by what finds people, combines or is a function."""
        return self._far_every_s

    def near_ground(self, image: NDArray[np.uint8], gsd_m: Gsd) -> NDArray[np.float32]:
        """The heatmap of a look that leaves out what is farther away than the model knows, and the sky above
        that: a masked array whose masked cells were not looked at. Errors as for a call; ValueError for a
        detector that does not know how far it sees.
        """
        model = self._model
        if not (isinstance(model, SizedModel) and model.tells_near_from_far):
            raise ValueError(f"{self._name} does not tell near ground from far")
        try:
            return self._evenly(model.near_heatmap(check_image(image), gsd_m), image)
        except DetectorError as error:
            raise DetectorError(f"{self._name}: {error}") from None

    @property
    def contract(self) -> Contract:
        return self._found.contract

    @property
    def path(self) -> Path | None:
        """The model's file, None for a function."""
        return self._path

    @property
    def device(self) -> Device | None:
        """Where its model computes, None for a function and for a combination."""
        return self._device

    @property
    def contract_source(self) -> str:
        """Where the contract was read, for people."""
        return self._found.source

    def __call__(
        self, image: NDArray[np.uint8], gsd_m: Gsd | None = None, *, as_it_is: bool = False
    ) -> NDArray[np.float32]:
        """Heatmap float32 [h, w] in [0, 1] of an image uint8 [H, W, 3] RGB.

        gsd_m: metres on the ground per image pixel (see `ground_scale.Gsd`). With it every part of the image
        is shown at a size that the model knows (`PictureSizes`), without it the image at several sizes, if
        the contract says so; density and points need it.
        as_it_is: the model sees the image at its own size only.

        DetectorError for an image of another kind and for output that is no heatmap (NaN, out of range, wrong
        shape); ValueError when gsd_m is missing or wrong.
        """
        try:
            heatmap = self._model.heatmap(check_image(image), gsd_m, as_it_is=as_it_is)
            return self._evenly(heatmap, image)
        except DetectorError as error:
            raise DetectorError(f"{self._name}: {error}") from None

    def batch(
        self,
        images: Sequence[NDArray[np.uint8]],
        gsd_m: Sequence[Gsd | None] | float | None = None,
        *,
        as_it_is: bool = False,
    ) -> list[NDArray[np.float32]]:
        """Heatmaps of several images, one per stream; those of one size share a run where the model allows.

        gsd_m: one number for all, or one entry per image.
        """
        scales = list(gsd_m) if isinstance(gsd_m, Sequence) else [gsd_m] * len(images)
        if len(scales) != len(images):
            raise ValueError(f"gsd_m has {len(scales)} entries for {len(images)} images")
        try:
            checked = [check_image(image) for image in images]
            heatmaps = self._model.heatmaps(checked, scales, as_it_is=as_it_is)
            return [self._evenly(one, image) for one, image in zip(heatmaps, checked, strict=True)]
        except DetectorError as error:
            raise DetectorError(f"{self._name}: {error}") from None

    def _evenly(self, heatmap: NDArray[np.float32], image: NDArray[np.uint8]) -> NDArray[np.float32]:
        """Those of a combination's members are."""
        if self._members:
            return heatmap
        return evenly(heatmap, self.contract.output.stride, image.shape[:2])

    @classmethod
    def _of(cls, model: _Model, found: FoundContract, name: str) -> Detector:
        detector = cls.__new__(cls)
        detector._set_up(model, found, name)
        return detector

    def _set_up(
        self,
        model: _Model,
        found: FoundContract,
        name: str,
        path: Path | None = None,
        device: Device | None = None,
    ) -> None:
        self._model, self._found, self._name, self._path, self._device = model, found, name, path, device
        self._members: tuple[Detector, ...] = ()
        self._far_every_s = 0.0


def _given(contract: AnyContract) -> FoundContract:
    if isinstance(contract, Contract):
        contract = contract.to_json()  # one that was put together by hand is checked as any other
    if isinstance(contract, Mapping):
        return FoundContract(contract_of(contract, "the given contract"), "given")
    return FoundContract(read_contract(Path(contract)), str(contract))


def _name(function: Callable[..., Any], name: str | None) -> str:
    return name or getattr(function, "__name__", None) or type(function).__name__
