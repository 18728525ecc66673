"""A model that sees every part of a picture at a size that it knows, and the heatmap that comes of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from crowdfence.detector.contract.contract import Contract
from crowdfence.detector.contract.crowd_rules import DensityRule, PeopleRule
from crowdfence.detector.contract.model_output import PEOPLE_KINDS
from crowdfence.detector.contract.picture_sizes import PictureSizes
from crowdfence.detector.ground_scale import GroundScale, Gsd
from crowdfence.detector.inference.density_map import crowd_from_density
from crowdfence.detector.inference.image_tensor import Image
from crowdfence.detector.inference.map_output import Map, sigmoid
from crowdfence.detector.inference.onnx_model import OnnxModel, on_cells
from crowdfence.detector.inference.overlap_removal import strongest_boxes
from crowdfence.detector.inference.people_map import crowd_from_people
from crowdfence.detector.inference.people_output import People
from crowdfence.detector.inference.people_scale import gsd_of_people
from crowdfence.detector.inference.picture_parts import (
    ENLARGED,
    Enlarge,
    PicturePart,
    far_cells,
    near_parts,
    parts_by_gsd,
    suspicious_parts,
)

_SAME_PERSON_IOU = 0.5
"""Of two boxes of different sizes of a picture, where the model itself removes no overlaps."""
_MOST_LOGIT = 16.0
"""A float32 probability cannot tell more from 1."""


class SizedModel:
    """An ONNX model, shown pictures as `Contract.sizes` says. As safe between threads as the model."""

    def __init__(
        self,
        model: OnnxModel,
        contract: Contract,
        enlarge: Enlarge = "always",
        *,
        whole_pictures: bool = False,
    ) -> None:
        """`whole_pictures`: at every size the whole picture is shown, and not those parts of it that need
        that size. On a GPU pixels cost little, and every new shape of them much (`SessionPerShape`). What is
        affordable is then all."""
        self._model, self._output = model, contract.output
        self._sizes = contract.sizes or PictureSizes()
        self._enlarge: Enlarge = "always" if whole_pictures and enlarge == "affordable" else enlarge
        self._whole = whole_pictures
        self.sees_pictures_as_they_are = contract.sizes is None

    def heatmap(self, image: Image, gsd_m: Gsd | None, *, as_it_is: bool = False) -> Map:
        """P [ceil(H / stride), ceil(W / stride)]; cell (i, j) covers the pixels from (i, j) * stride on."""
        output = self._output
        parts = self._parts(image, gsd_m, as_it_is)
        if output.kind in PEOPLE_KINDS:
            return self._from_people(self._people(image, parts), image, gsd_m)
        if output.kind == "density":
            scale = GroundScale.of(gsd_m, self._cells(image), output.kind)
            rule = output.rule
            assert isinstance(rule, DensityRule)
            return crowd_from_density(self._map(image, parts), scale, rule, output.stride)
        if gsd_m is not None and self._enlarge == "affordable" and not as_it_is:
            return self._looked_at_again(image, parts, gsd_m)
        if gsd_m is not None or as_it_is or self._sizes.weights is None:
            return self._map(image, parts)
        return combined([self._of_part(image, part) for part in parts], self._sizes)

    @property
    def _gives_probabilities(self) -> bool:
        """Whether the model's output is a probability for every cell."""
        return self._output.kind not in (*PEOPLE_KINDS, "density")

    @property
    def tells_near_from_far(self) -> bool:
        """Whether `near_heatmap` is there: of a map whose cells are probabilities of their own. People are
        counted over borders, and a crowd at the border of what was looked at would lack some."""
        return self._gives_probabilities and self._sizes.gsd_m is not None

    @property
    def enlarged(self) -> float:
        """Size at which all ground is shown that is too far away; 1 where some of it may be at its own."""
        return max(ENLARGED) if self._enlarge == "always" else 1.0

    def near_heatmap(self, image: Image, gsd_m: Gsd) -> Map:
        """`heatmap`, a masked array [h, w]: ground that is coarser than the model knows was not looked at,
        nor was the sky above it."""
        known_m = self._sizes.gsd_m
        assert known_m is not None and self.tells_near_from_far
        parts, far = near_parts(gsd_m, known_m, image, self._output.stride, whole=self._whole)
        values = self._map(image, parts) if parts else np.zeros(far.shape, np.float32)
        return np.ma.MaskedArray(np.where(far, np.float32(0.0), values), far)

    def heatmaps(
        self, images: Sequence[Image], gsd_m: Sequence[Gsd | None], *, as_it_is: bool = False
    ) -> list[Map]:
        """Several images; those that fit in one run of the model share it."""
        shared = self._gives_probabilities and (self.sees_pictures_as_they_are or as_it_is)
        together = self._model.maps_together(images) if shared else None
        if together is not None:
            return together
        return [self.heatmap(image, gsd, as_it_is=as_it_is) for image, gsd in zip(images, gsd_m, strict=True)]

    def _parts(self, image: Image, gsd_m: Gsd | None, as_it_is: bool) -> list[PicturePart]:
        """Parts that answer for their own cells; of a picture of unknown scale the whole at several sizes."""
        sizes, stride = self._sizes, self._output.stride
        rows, columns = slice(0, image.shape[0]), slice(0, image.shape[1])
        if as_it_is:
            return [PicturePart(1.0, rows, columns, None)]
        if gsd_m is None:
            return [PicturePart(size, rows, columns, None) for size in sizes.without_gsd]
        if sizes.gsd_m is None:
            return [PicturePart(1.0, rows, columns, None)]
        return parts_by_gsd(gsd_m, sizes.gsd_m, image, stride, self._enlarge, whole=self._whole)

    def _map(self, image: Image, parts: list[PicturePart]) -> Map:
        """Values [h, w]: probabilities, or people per image pixel for a density model."""
        if parts[0].own is None:
            return self._of_part(image, parts[0])
        whole = np.empty(self._cells(image), np.float32)
        for part in parts:
            assert part.own is not None
            whole[part.own] = self._of_part(image, part)[part.own]
        return whole

    def _looked_at_again(self, image: Image, parts: list[PicturePart], gsd_m: Gsd) -> Map:
        """The map, and where far ground could not be enlarged as a whole, what is suspicious of it is."""
        values = self._map(image, parts)
        known_m = self._sizes.gsd_m
        if known_m is None or any(part.size > 1.0 for part in parts):
            return values
        far = far_cells(gsd_m, known_m, values.shape)
        if far.any():
            values = values.copy()
            for part in suspicious_parts(values, parts, far, image, self._output.stride):
                values[part.own] = self._of_part(image, part)[part.own]
        return values

    def _of_part(self, image: Image, part: PicturePart) -> Map:
        """Values [h, w] on the cells of the whole image; 0 beyond the part."""
        values = self._model.map(part.shown(image))
        cells, stride = self._cells(image), self._output.stride
        if part.is_whole_picture:
            return values
        if self._output.kind == "density":
            values = values * np.float32(part.scales[0] * part.scales[1])
        rows, columns = (
            slice(span.start // stride, -(-span.stop // stride)) for span in (part.rows, part.columns)
        )
        whole = np.zeros(cells, np.float32)
        whole[rows, columns] = _on_cells(values, part, stride)
        return whole

    def _people(self, image: Image, parts: list[PicturePart]) -> People:
        """Everybody, in pixels of the image; the part that answers for the cell of the feet decides."""
        found = []
        for part in parts:
            seen = self._model.people(part.shown(image))
            down, across = part.scales
            x, y = seen.x / across + part.columns.start, seen.y / down + part.rows.start
            seen = seen.moved(x, y, 1.0 / across, 1.0 / down)
            if part.own is not None:
                row, column = (
                    np.clip(at // self._output.stride, 0, side - 1).astype(np.intp)
                    for at, side in zip((y, x), part.own.shape, strict=True)
                )
                seen = seen.chosen(part.own[row, column])
            found.append(seen)
        people = People.joined(found)
        if len(parts) == 1 or parts[0].own is not None:
            return people
        iou_max = self._output.iou_max or _SAME_PERSON_IOU
        return people.chosen(strongest_boxes(people.boxes, people.score, iou_max))

    def _from_people(self, people: People, image: Image, gsd_m: Gsd | None) -> Map:
        output, cells = self._output, self._cells(image)
        rule = output.rule
        assert isinstance(rule, PeopleRule)
        if gsd_m is None and rule.person_height_m is not None:
            if len(people.x) == 0:
                return np.zeros(cells, np.float32)
            gsd_m = gsd_of_people(people, image.shape[:2], rule.person_height_m)
        return crowd_from_people(people, GroundScale.of(gsd_m, cells, output.kind), rule, output.stride)

    def _cells(self, image: Image) -> tuple[int, int]:
        stride = self._output.stride
        return -(-image.shape[0] // stride), -(-image.shape[1] // stride)


def combined(maps: Sequence[Map], sizes: PictureSizes) -> Map:
    """P [h, w] of the maps of one picture at several sizes, none of which is known to be right: a line in
    their logits, sorted downwards."""
    assert sizes.weights is not None
    with np.errstate(divide="ignore"):
        logits = np.stack([np.log(values) - np.log1p(-values) for values in maps])
    ordered = -np.sort(-np.clip(logits, -_MOST_LOGIT, _MOST_LOGIT), axis=0)
    z = np.tensordot(np.array(sizes.weights, np.float32), ordered, axes=1) + np.float32(sizes.bias)
    return np.asarray(sigmoid(z), np.float32)


def _on_cells(values: Map, part: PicturePart, stride: int) -> NDArray[np.float32]:
    """The answer for a part on the cells of the whole image that it covers."""
    if part.size == 1.0:
        return values
    height, width = (span.stop - span.start for span in (part.rows, part.columns))
    cells = -(-height // stride), -(-width // stride)
    down, across = part.scales
    return on_cells(values, cells, (0.0, 0.0), (cells[0] * down, cells[1] * across))
