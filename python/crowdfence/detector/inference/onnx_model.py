"""An ONNX model under its contract: images in, maps or people out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.check import check_contract
from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.contract.metadata_values import fixed
from crowdfence.detector.inference.image_tensor import Image, InputTensor, patch_pixels
from crowdfence.detector.inference.map_output import Map, map_values
from crowdfence.detector.inference.patches import Patch, Span, patches
from crowdfence.detector.inference.people_output import People, people_in
from crowdfence.detector.onnx_session import OnnxSession, reason, time_limit
from crowdfence.errors import DetectorError


class OnnxModel:
    """Runs a session; the session is safe to share between threads, and so is this."""

    def __init__(self, session: OnnxSession, contract: Contract) -> None:
        check_contract(contract, session.face)
        self._session = session.session
        self._contract = contract
        self._tensor = InputTensor(contract.input)
        batch = session.face.inputs[0].shape[contract.input.layout.index("N")]
        self._takes_batches = fixed(batch) is None

    def maps_together(self, images: Sequence[Image]) -> list[Map] | None:
        """As `map`, several images in one run of the model; None where they cannot share one."""
        whole = self._shared_patch(images)
        if whole is None:
            return None
        cells = _cells(images[0], self._contract.output.stride)
        raw = self._run(np.stack([patch_pixels(image, whole) for image in images]))
        maps = map_values(raw, self._contract, _model_shape(whole))
        if len(maps) != len(images):
            raise DetectorError(
                f"output {self._contract.output.name}: {len(maps)} maps of {len(images)} images"
            )
        return [self._placed(values, whole, cells) for values in maps]

    def _shared_patch(self, images: Sequence[Image]) -> Patch | None:
        """The one patch that all the images are, when they can share a run."""
        output = self._contract.output
        if not self._takes_batches or len(images) < 2:
            return None
        if len({image.shape for image in images}) > 1:
            return None
        height, width = images[0].shape[:2]
        cut = patches(height, width, self._contract.input, output.stride)
        first, more = next(cut), next(cut, None)
        return first if more is None else None

    def map(self, image: Image) -> Map:
        """Values [ceil(H / stride), ceil(W / stride)]: probabilities, or people per image pixel for a density
        model. Cell (i, j) covers the pixels from (i, j) * stride on."""
        output = self._contract.output
        cells = _cells(image, output.stride)
        whole: Map | None = None
        for patch in patches(image.shape[0], image.shape[1], self._contract.input, output.stride):
            raw = self._run(patch_pixels(image, patch)[None])
            maps = map_values(raw, self._contract, _model_shape(patch))
            if len(maps) != 1:
                raise DetectorError(f"output {output.name}: {len(maps)} maps of one image")
            values = self._placed(maps[0], patch, cells)
            if values.shape == cells:
                return values
            if whole is None:
                whole = np.empty(cells, np.float32)
            whole[_own_cells(patch.rows, output.stride), _own_cells(patch.columns, output.stride)] = values
        assert whole is not None
        return whole

    def _placed(self, values: Map, patch: Patch, cells: tuple[int, int]) -> Map:
        """The cells that the patch answers for, on the grid of the image."""
        output = self._contract.output
        if output.kind == "density":
            # People per cell become people per image pixel, which resizing leaves alone.
            values = values * np.float32(patch.rows.scale * patch.columns.scale / output.stride**2)
        if not patch.is_native:
            return _resampled(values, patch, cells, output.stride)
        rows, columns = (_own_cells(span, output.stride) for span in (patch.rows, patch.columns))
        top, left = patch.rows.start // output.stride, patch.columns.start // output.stride
        own = values[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
        return np.ascontiguousarray(own)

    def people(self, image: Image) -> People:
        """Everybody in the image, in its pixels; where tiles overlap, the one that holds the feet decides."""
        height, width = image.shape[:2]
        parts = []
        for patch in patches(height, width, self._contract.input, self._contract.output.stride):
            raw = self._run(patch_pixels(image, patch)[None])
            found = people_in(raw, self._contract, _model_shape(patch))
            x, y = patch.columns.to_image(found.x), patch.rows.to_image(found.y)
            own = _owns(patch.columns, x, width) & _owns(patch.rows, y, height)
            scales = 1.0 / patch.columns.scale, 1.0 / patch.rows.scale
            parts.append(found.moved(x, y, *scales).chosen(own))
        return People.joined(parts)

    def _run(self, pixels: Image) -> NDArray[np.generic]:
        contract = self._contract
        tensor = self._tensor(pixels)
        try:
            with time_limit() as run_options:
                outputs = self._session.run(
                    [contract.output.name], {contract.input.name: tensor}, run_options
                )
            raw = outputs[0]
        except TimeoutError as error:
            raise DetectorError(f"{error} on an input of shape {list(tensor.shape)}") from None
        except Exception as error:  # the runtime's exceptions have no base class of their own
            raise DetectorError(
                f"the model failed on an input of shape {list(tensor.shape)}: {reason(error)}"
            ) from None
        if not isinstance(raw, np.ndarray):
            raise DetectorError(f"output {contract.output.name} is a {type(raw).__name__}, not a tensor")
        return raw


def _cells(image: Image, stride: int) -> tuple[int, int]:
    return -(-image.shape[0] // stride), -(-image.shape[1] // stride)


def _model_shape(patch: Patch) -> tuple[int, int]:
    return patch.rows.model, patch.columns.model


def _own_cells(span: Span, stride: int) -> slice:
    return slice(span.own_start // stride, -(-span.own_stop // stride))


def _owns(span: Span, at: NDArray[np.float64], pixels: int) -> NDArray[np.bool_]:
    """Feet below the image's edge belong to the patch at that edge."""
    inside = np.clip(at, 0, pixels - 1)
    return np.asarray((inside >= span.own_start) & (inside < span.own_stop))


def _resampled(values: Map, patch: Patch, cells: tuple[int, int], stride: int) -> Map:
    """The part of the output that shows the image, on the cells of the image."""
    spans = (patch.rows, patch.columns)
    # Bars around the image are no neighbours of its border.
    shows = [slice(0, int(np.ceil(_model_px(span, span.stop) / stride))) for span in spans]
    ends = [_model_px(span, count * stride) / stride for span, count in zip(spans, cells, strict=True)]
    starts = [span.low / stride for span in spans]
    return on_cells(values[shows[0], shows[1]], cells, starts, ends)


def _model_px(span: Span, image_px: int) -> float:
    return span.low + (image_px - span.start) * span.scale


def on_cells(values: Map, cells: tuple[int, int], starts: Sequence[float], ends: Sequence[float]) -> Map:
    """What lies between `starts` and `ends` (row, column) of an answer, in its cells, on `cells` of the
    image. The last of these may reach beyond the answer, whose border goes on there."""
    from PIL import Image as Pillow

    beyond = [(0, max(0, int(np.ceil(end)) - side)) for end, side in zip(ends, values.shape, strict=True)]
    picture = Pillow.fromarray(np.pad(values, beyond, mode="edge"))
    box = (starts[1], starts[0], ends[1], ends[0])
    resized = picture.resize(cells[::-1], Pillow.Resampling.BILINEAR, box=box)
    # Interpolation of float32 may step over the highest value by a rounding.
    return np.asarray(resized, np.float32).clip(values.min(), values.max())
