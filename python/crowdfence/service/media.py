"""Pictures and heatmaps of the drones, as they were seen."""

from __future__ import annotations

import io
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from crowdfence.service.store import Store

MediaKind = Literal["picture", "heatmap"]
_AT_MOST_EVERY_NS = 180_000_000


class Media:
    """On disk; of a drone at most one picture, and its heatmap, in 0.18 s."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._kept_ns: dict[str, int] = {}

    def wants(self, drone: str, stamp_ns: int) -> bool:
        """Whether what was kept of a drone last is old enough."""
        last_ns = self._kept_ns.get(drone)
        return last_ns is None or stamp_ns >= last_ns + _AT_MOST_EVERY_NS

    def keep(self, kind: MediaKind, drone: str, stamp_ns: int, body: bytes) -> None:
        self._kept_ns[drone] = stamp_ns
        row = (kind, drone, stamp_ns, body)
        self._store.note(
            lambda connection: connection.execute("INSERT OR REPLACE INTO media VALUES (?, ?, ?, ?)", row),
            size=len(body),
        )

    def at(self, kind: MediaKind, drone: str, stamp_ns: int) -> tuple[int, bytes] | None:
        """The last one up to a stamp, with its own."""
        rows = self._store.rows(
            "SELECT stamp_ns, body FROM media WHERE kind = ? AND drone = ? AND stamp_ns <= ? "
            "ORDER BY stamp_ns DESC LIMIT 1",
            (kind, drone, stamp_ns),
        )
        return (rows[0][0], rows[0][1]) if rows else None


def heatmap_png(heatmap: NDArray[np.float32]) -> bytes:
    """[h, w] in [0, 1] -> 8 bit grey PNG."""
    from PIL import Image

    file = io.BytesIO()
    grey = np.rint(np.nan_to_num(heatmap) * 255.0).astype(np.uint8)
    Image.fromarray(grey).save(file, format="PNG", compress_level=1)
    return file.getvalue()


def as_png(picture: bytes) -> bytes:
    """A picture of a kind that browsers do not show, such as PPM."""
    from PIL import Image

    file = io.BytesIO()
    Image.open(io.BytesIO(picture)).convert("RGB").save(file, format="PNG", compress_level=1)
    return file.getvalue()
