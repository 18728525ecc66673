"""The drones and what they see."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Path, Response

from crowdfence.service.media import MediaKind
from crowdfence.service.routes.asking import ERRORS, AtNs, Reader, TheService
from crowdfence.service.service import Service
from crowdfence.service.stamps import LARGEST_NS

router = APIRouter(tags=["drones"], responses=ERRORS)
Drone = Annotated[str, Path(min_length=1, max_length=100)]
"""As a path, because names of ROS namespaces have slashes."""
_MAGIC = {b"\xff\xd8": "image/jpeg", b"\x89P": "image/png"}


@router.get("/drones")
def drones(service: TheService, user: Reader, at: AtNs) -> dict[str, Any]:
    """Where every drone is, what it has in view, how old that is, and whether it is left out now."""
    return {"drones": service.drones_json(at)}


@router.get("/drones/{drone:path}/picture", response_class=Response, responses={404: {}})
def picture(service: TheService, user: Reader, drone: Drone, at: AtNs) -> Response:
    """What its camera showed."""
    return _media(service, "picture", drone, at)


@router.get("/drones/{drone:path}/heatmap", response_class=Response, responses={404: {}})
def heatmap(service: TheService, user: Reader, drone: Drone, at: AtNs) -> Response:
    """What was crowd in it: PNG, grey 255 is 1."""
    return _media(service, "heatmap", drone, at)


def _media(service: Service, kind: MediaKind, drone: str, at: int | None) -> Response:
    found = service.media.at(kind, drone, LARGEST_NS if at is None else at)
    if found is None:
        raise HTTPException(404, f"no {kind} of this drone is kept")
    stamp_ns, body = found
    media_type = _MAGIC.get(body[:2])
    if media_type is None:
        from crowdfence.service.media import as_png

        body, media_type = as_png(body), "image/png"
    headers = {
        "x-crowdfence-stamp-ns": str(stamp_ns),
        "etag": f'"{stamp_ns}"',
        "cache-control": "private, no-cache",
    }
    return Response(body, media_type=media_type, headers=headers)
