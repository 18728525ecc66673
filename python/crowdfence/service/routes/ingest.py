"""Views in: answered once they are on disk."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any

from fastapi import APIRouter, Depends, HTTPException, Request
from fastapi.responses import JSONResponse

from crowdfence.service.gate import Refused
from crowdfence.service.intake import Accepted
from crowdfence.service.live import Live
from crowdfence.service.routes.asking import ERRORS, Giver, TheService
from crowdfence.service.service import Service
from crowdfence.service.view_message import ViewMessage

router = APIRouter(tags=["drones"])
_ANSWERS: dict[int | str, dict[str, Any]] = {
    **ERRORS,
    202: {"description": "on disk; `accepted` is its place in the journal"},
    200: {"description": "it was there already"},
    409: {"description": "this service replays a recording, or the drone gave another view of this stamp"},
    413: {"description": "too large"},
    415: {"description": "compressed (Content-Encoding): send it as it is"},
    503: {"description": "its drone's telemetry has not come yet"},
    507: {"description": "it cannot be kept: the disk is full"},
}


async def _body(request: Request) -> bytes:
    return await request.body()


Body = Annotated[bytes, Depends(_body)]
_VIEW: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {"application/json": {"schema": {"$ref": "#/components/schemas/ViewMessage"}}},
    }
}
_OBSERVATION: dict[str, Any] = {
    "requestBody": {
        "required": True,
        "content": {"application/octet-stream": {"schema": {"type": "string", "format": "binary"}}},
    }
}


@router.post("/views", status_code=202, responses=_ANSWERS, openapi_extra=_VIEW)
def views(service: TheService, user: Giver, body: Body) -> JSONResponse:
    """A view: camera, pose, stamp, and a heatmap or an image. Sending it again is harmless."""
    live = _live(service)
    return _answered(lambda: live.intake.give_view(body, user.drones))


@router.post("/observations", status_code=202, responses=_ANSWERS, openapi_extra=_OBSERVATION)
def observations(service: TheService, user: Giver, body: Body) -> JSONResponse:
    """What a companion computer projected itself: the bytes of `Observation.to_bytes`."""
    live = _live(service)
    return _answered(lambda: live.intake.give_observation(body, user.drones))


def _live(service: Service) -> Live:
    if service.live is None:
        raise HTTPException(409, "this service replays a recording; it takes no views")
    return service.live


def _answered(give: Callable[[], Accepted]) -> JSONResponse:
    try:
        accepted = give()
    except Refused as error:
        headers = {"Retry-After": str(max(1, round(error.again_s)))} if error.again_s else None
        raise HTTPException(error.status, error.reason, headers) from error
    told = {"accepted": accepted.seq, "duplicate": accepted.duplicate}
    return JSONResponse(told, status_code=200 if accepted.duplicate else 202)


SCHEMAS = (ViewMessage,)
"""Messages that are read here and not by FastAPI; the description of the interface holds them too."""
