"""The operator's own map of the surroundings."""

from __future__ import annotations

from typing import Annotated

from fastapi import APIRouter, HTTPException, Query, Response
from starlette.responses import FileResponse

from crowdfence.service.routes.asking import ERRORS, Kept, Reader, TheService

router = APIRouter(
    tags=["scene"], responses={**ERRORS, 404: {"description": "the service was given none of this kind"}}
)
Metres = Annotated[float, Query(ge=-1e6, le=1e6, allow_inf_nan=False)]
Side = Annotated[int, Query(ge=1, le=2048)]


@router.get("/base-map", response_class=Response)
def base_map(service: TheService, user: Reader, kept: Kept) -> Response:
    """The PMTiles archive of `--base-map`; ask for ranges of it."""
    known = service.base_map
    if known is None or known.kind != "tiles":
        raise HTTPException(404, "no archive of tiles was given")
    return FileResponse(known.path, media_type="application/vnd.pmtiles", headers=kept)


@router.get("/base-map/picture", response_class=Response)
def base_map_picture(
    service: TheService,
    user: Reader,
    west: Metres,
    south: Metres,
    east: Metres,
    north: Metres,
    rows: Side,
    columns: Side,
    kept: Kept,
) -> Response:
    """The GeoTIFF of `--base-map` over a rectangle in local metres, as PNG."""
    known, anchor = service.base_map, service.mission.georeference
    if known is None or known.kind != "picture" or anchor is None:
        raise HTTPException(404, "no picture of the ground was given")
    if not (west < east and south < north):
        raise HTTPException(422, "west must be less than east, and south less than north")
    try:
        picture = known.over(anchor, (west, south, east, north), (rows, columns))
    except ValueError as error:
        raise HTTPException(422, str(error)) from error
    return Response(picture, media_type="image/png", headers=kept)
