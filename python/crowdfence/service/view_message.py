"""A view as JSON: camera, pose, stamp, and a heatmap or a picture."""

from __future__ import annotations

import base64
import binascii
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from crowdfence._core import Camera, View
from crowdfence.sources.camera_mask import CameraMask
from crowdfence.sources.recording import Frame, PixelSources

MOST_PIXELS = 64_000_000
FARTHEST_M = 1e8
"""Of a camera, east, north or up: more than any map projection has."""


class CameraMessage(BaseModel):
    """Intrinsics, in pixels; the centre of pixel (i, j) is at (i + 0.5, j + 0.5)."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    model: Literal["pinhole", "brown_conrady", "kannala_brandt"] = "pinhole"
    width: Annotated[int, Field(ge=1, le=100_000)]
    height: Annotated[int, Field(ge=1, le=100_000)]
    fx: Annotated[float, Field(gt=0)]
    fy: Annotated[float, Field(gt=0)]
    cx: float
    cy: float
    distortion: Annotated[list[float], Field(max_length=8)] = []

    def camera(self) -> Camera:
        """ValueError for a camera that cannot be."""
        size_and_focus = (self.width, self.height, self.fx, self.fy, self.cx, self.cy)
        if self.model == "kannala_brandt":
            return Camera.fisheye(*size_and_focus, self.distortion or (0.0, 0.0, 0.0, 0.0))
        if self.model == "pinhole" and self.distortion:
            raise ValueError("a pinhole camera has no distortion; name the model brown_conrady")
        return Camera.pinhole(*size_and_focus, self.distortion or None)

    @staticmethod
    def of(camera: Camera) -> CameraMessage:
        return CameraMessage(
            model=camera.model,
            width=camera.width,
            height=camera.height,
            fx=camera.fx,
            fy=camera.fy,
            cx=camera.cx,
            cy=camera.cy,
            distortion=[] if camera.model == "pinhole" else list(camera.distortion),
        )


class HeatmapMessage(BaseModel):
    """Values in [0, 1]: 8 bit grey PNG (value * 255), or numbers row by row, u8 (value * 255) or little
    endian f32."""

    model_config = ConfigDict(extra="forbid")

    encoding: Literal["png", "u8", "f32"]
    rows: Annotated[int, Field(ge=1, le=20_000)] | None = None
    columns: Annotated[int, Field(ge=1, le=20_000)] | None = None
    data: str
    """Base64."""
    looked_at: str | None = None
    """Base64 of a byte for every cell, row by row: 0 where nobody looked, whatever its value; left out where
    all was looked at."""

    def heatmap(self) -> NDArray[Any]:
        """[h, w], masked where nobody looked. ValueError for what is no heatmap."""
        values = self._values()
        if self.looked_at is None:
            return values
        looked_at = np.frombuffer(_decoded(self.looked_at), np.uint8)
        if looked_at.size != values.size:
            rows, columns = values.shape
            raise ValueError(f"looked_at of {rows} x {columns} cells has {looked_at.size} bytes")
        return np.ma.MaskedArray(values, looked_at.reshape(values.shape) == 0)

    def _values(self) -> NDArray[Any]:
        body = _decoded(self.data)
        if self.encoding == "png":
            return _grey(body)
        if self.rows is None or self.columns is None:
            raise ValueError("a heatmap as numbers needs rows and columns")
        kind = np.dtype(np.uint8 if self.encoding == "u8" else "<f4")
        if len(body) != self.rows * self.columns * kind.itemsize:
            raise ValueError(
                f"{self.rows} x {self.columns} values of {self.encoding} are "
                f"{self.rows * self.columns * kind.itemsize} bytes, not {len(body)}"
            )
        return np.frombuffer(body, kind).reshape(self.rows, self.columns).astype(kind.newbyteorder("="))

    @staticmethod
    def of(heatmap: NDArray[Any], looked_at: NDArray[np.bool_] | None = None) -> HeatmapMessage:
        """uint8 (value / 255) or float, every digit of float32 kept, with the cells that were looked at."""
        kind: Literal["u8", "f32"] = "u8" if heatmap.dtype == np.uint8 else "f32"
        body = np.ascontiguousarray(heatmap, np.uint8 if kind == "u8" else "<f4").tobytes()
        rows, columns = heatmap.shape
        return HeatmapMessage(
            encoding=kind,
            rows=rows,
            columns=columns,
            data=_encoded(body),
            looked_at=None if looked_at is None else _encoded(looked_at.astype(np.uint8).tobytes()),
        )


class ViewMessage(BaseModel):
    """What one camera saw at one instant."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)

    drone: Annotated[str, Field(min_length=1, max_length=100)]
    stamp_ns: Annotated[int, Field(ge=0, lt=1 << 63)]
    """When the picture was exposed, nanoseconds since 1970."""
    camera: CameraMessage
    world_from_camera: (
        Annotated[
            list[Annotated[list[float], Field(min_length=4, max_length=4)]], Field(min_length=4, max_length=4)
        ]
        | None
    ) = None
    """Rigid transform, camera axes (x right, y down, z forward) to local east-north-up metres; left out by a
    drone whose telemetry tells it."""
    heatmap: HeatmapMessage | None = None
    image: str | None = None
    """Base64 of a JPEG or PNG, which the service's detector looks at."""

    def posed(self, world_from_camera: NDArray[np.float64]) -> ViewMessage:
        """The same with this pose."""
        return self.model_copy(update={"world_from_camera": world_from_camera.tolist()})

    def check(self, mask: CameraMask | None = None) -> None:
        """ValueError for what can be no view, whatever its pose, nor with this mask."""
        if (self.heatmap is None) == (self.image is None):
            raise ValueError("a view has either a heatmap or an image")
        whole = self if self.world_from_camera is not None else self.posed(np.eye(4))
        _ = whole.view(mask) if self.image is None else whole.frame(mask)
        farthest_m = float(np.abs(whole._pose()[:3, 3]).max())
        if farthest_m > FARTHEST_M:
            raise ValueError(
                f"world_from_camera places the camera {farthest_m:g} m from the origin; no place on Earth is "
                f"more than {FARTHEST_M:g} m from it: are these metres?"
            )

    def _pose(self) -> NDArray[np.float64]:
        if self.world_from_camera is None:
            raise ValueError("there is no pose")
        return np.array(self.world_from_camera)

    def view(self, mask: CameraMask | None = None) -> View:
        """Of a message with a heatmap, without what a mask hides. ValueError for what the core refuses, and
        for a mask of other proportions."""
        if self.heatmap is None:
            raise ValueError("there is no heatmap")
        camera, heatmap = self.camera.camera(), self.heatmap.heatmap()
        if mask is not None:
            heatmap = mask.over(heatmap, camera.width, camera.height)
        return View(self.drone, self.stamp_ns, camera, self._pose(), heatmap)

    def frame(self, mask: CameraMask | None = None) -> Frame:
        """Of a message with an image. ValueError for a camera, a pose or text that cannot be, and as for
        `view`."""
        if self.image is None:
            raise ValueError("there is no image")
        body, camera = _decoded(self.image), self.camera.camera()
        pose = self._pose()
        View(self.drone, self.stamp_ns, camera, pose, np.zeros((1, 1), np.uint8))  # refuses a wrong pose now
        if mask is not None:
            mask.require_fit(camera.width, camera.height)
        return Frame(self.drone, self.stamp_ns, camera, pose, PixelSources(image=lambda: body), mask=mask)


def first_problem(error: ValidationError) -> str:
    """One line: where in a message, and what is wrong there."""
    problem = error.errors(include_url=False, include_input=False, include_context=False)[0]
    place = ".".join(str(part) for part in problem["loc"])
    return f"{place}: {problem['msg']}" if place else problem["msg"]


def _encoded(body: bytes) -> str:
    return base64.b64encode(body).decode("ascii")


def _decoded(text: str) -> bytes:
    try:
        return base64.b64decode(text, validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"that is no base64: {error}") from error


def _grey(body: bytes) -> NDArray[np.uint8]:
    import io

    from PIL import Image

    try:
        with Image.open(io.BytesIO(body), formats=["PNG"]) as picture:
            if picture.width * picture.height > MOST_PIXELS:
                raise ValueError(f"{picture.width} x {picture.height} pixels are more than {MOST_PIXELS}")
            if picture.mode != "L":
                raise ValueError(f"a heatmap is 8 bit grey, not {picture.mode}")
            return np.array(picture, dtype=np.uint8)
    except (OSError, SyntaxError, Image.DecompressionBombError) as error:
        raise ValueError(f"that is no PNG: {error}") from error
