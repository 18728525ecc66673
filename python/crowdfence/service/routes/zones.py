"""The zones: now, then, over time, and as files."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Path, Query, Response
from fastapi.responses import JSONResponse

from crowdfence.service.downloads import FORMATS, NotPossible, download
from crowdfence.service.routes.asking import ERRORS, AtNs, Reader, TheService
from crowdfence.zones import MAX_ID_LENGTH

router = APIRouter(tags=["zones"], responses=ERRORS)
_LOST: dict[int | str, dict[str, Any]] = {
    404: {"description": "nothing could be written then, so what was closed is not known"}
}
ZoneId = Annotated[str, Path(min_length=1, max_length=MAX_ID_LENGTH)]
"""As a path: those of others are what their files call them."""


@router.get("/zones", responses=_LOST)
def zones(
    service: TheService,
    user: Reader,
    at: AtNs,
    without_static: Annotated[
        str | None,
        Query(
            description="A `static_version`, whose zones of others are left out then; * for any.",
            max_length=20,
        ),
    ] = None,
) -> Response:
    """What is closed and why. Ground outside the zones is not known to be free."""
    # Of thousands of zones FastAPI's own way to JSON takes seconds.
    return JSONResponse(service.zones_json(service.moment(at), without_static))


@router.get(
    "/zones/{zone:path}/history", responses={404: {"description": "no zone of this id is or was there"}}
)
def zone_history(service: TheService, user: Reader, zone: ZoneId, at: AtNs) -> dict[str, Any]:
    """How a zone's probability and area went, and what became of it; nothing where it came after `at`."""
    timeline = service.mission.timeline
    told = timeline.zone_history(zone, at)
    if not (any(told.values()) or service.has_zone(zone) or any(timeline.zone_history(zone).values())):
        raise HTTPException(404, f"there is no zone {zone}, and in the history that is kept there was none")
    return told


@router.get("/timeline")
def timeline(service: TheService, user: Reader) -> dict[str, Any]:
    """Figures over time, at most 2000 points."""
    alerts = [
        {"stamp_ms": told["raised_ms"], "id": told["id"], "level": told["level"]}
        for told in (alert.to_json() for alert in service.alerts.all()[::-1])
    ]
    return {"points": service.mission.timeline.points(), "alerts": alerts}


@router.get(
    "/export", response_class=Response, responses={409: {"description": "not possible here"}, **_LOST}
)
def export(
    service: TheService,
    user: Reader,
    at: AtNs,
    format: Annotated[str, Query(description=f"One of {', '.join(FORMATS)}.", max_length=20)] = "geojson",
    country: Annotated[str | None, Query(description="ISO 3166, three letters.", max_length=3)] = None,
    authority: Annotated[str, Query(max_length=200)] = "fleet operator",
    contact: Annotated[str | None, Query(max_length=200)] = None,
    datum: Annotated[str, Query(pattern="^(AGL|AMSL|WGS84)$")] = "AGL",
    max_items: Annotated[int, Query(ge=1, le=100_000)] = 63,
) -> Response:
    """The zones as a file, as `crowdfence export` writes it."""
    moment = service.moment(at)
    try:
        file = download(
            service.mission,
            moment,
            format,
            service.now_ns(),
            country=country,
            authority=authority,
            contact=contact,
            datum=datum,
            max_items=max_items,
        )
    except NotPossible as error:
        raise HTTPException(409, str(error)) from error
    except ValueError as error:
        raise HTTPException(422, str(error)) from error
    headers = {"content-disposition": f'attachment; filename="{file.name}"'}
    return Response(file.body, media_type=file.media_type, headers=headers)
