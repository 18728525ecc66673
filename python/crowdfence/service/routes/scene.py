"""The scene, its terrain and what is believed about it."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, HTTPException, Request, Response

from crowdfence.service.belief import aged
from crowdfence.service.routes.asking import ERRORS, AtNs, Kept, Reader, TheService

router = APIRouter(tags=["scene"], responses=ERRORS)
_BYTES: dict[str, Any] = {"responses": {200: {"content": {"application/octet-stream": {}}}}}


@router.get("/scene")
def scene(service: TheService, user: Reader) -> dict[str, Any]:
    """What stays the same while the mission goes on."""
    return service.scene_json(user)


@router.get("/terrain", response_class=Response, **_BYTES)
def terrain(service: TheService, user: Reader, kept: Kept) -> Response:
    """Heights of the highest ground: float32, little endian, north row first, NaN where the map has none."""
    heights = service.raster.heights_m.astype("<f4").tobytes()
    return Response(heights, media_type="application/octet-stream", headers=kept)


@router.get("/terrain/colour", response_class=Response, responses={404: {"description": "there is none"}})
def terrain_colour(user: Reader) -> Response:
    """A picture to drape over the terrain."""
    raise HTTPException(404, "no picture of the terrain is known")


@router.get("/belief", response_class=Response, responses={**_BYTES["responses"], 304: {}, 404: {}})
def belief(request: Request, service: TheService, user: Reader, at: AtNs) -> Response:
    """The crowd map from above; see `belief_bytes` for the layout."""
    mission, newest = service.mission, service.mission.newest
    if at is None or newest is None or at >= newest.stamp_ns:
        number, stamp_ns, body = mission.belief(service.now_ns())
        version = f"{number}-{stamp_ns}"
    else:
        found = mission.timeline.belief_at(at)
        if found is None:
            raise HTTPException(404, "no map of so early is kept")
        number, kept = found
        body = aged(kept, at, stale_after_s=mission.config.zones.stale_after_s)
        version = f"{number}-{at}"
    etag = f'"{mission.run}-{version}"'
    if request.headers.get("if-none-match") == etag:
        return Response(status_code=304, headers={"etag": etag})
    headers = {"etag": etag, "cache-control": "private, no-cache"}
    return Response(body, media_type="application/octet-stream", headers=headers)


@router.get("/me")
def me(user: Reader) -> dict[str, str]:
    """Whose token it is."""
    return {"user": user.name, "role": user.role}
