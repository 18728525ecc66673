"""For those who watch the service itself."""

from __future__ import annotations

from typing import Any

from fastapi import APIRouter, Response
from fastapi.responses import JSONResponse

from crowdfence.service.routes.asking import ERRORS, Reader, TheService

router = APIRouter(tags=["health"])


@router.get("/healthz", responses={503: {"description": "views cannot be kept"}})
def healthz(service: TheService) -> JSONResponse:
    """Whether it works; says nothing about the mission, so that no token is needed."""
    alive = service.store_trouble is None and service.works
    told: dict[str, Any] = {"status": "ok" if alive else "failing", "mode": service.mode}
    return JSONResponse(told, status_code=200 if alive else 503)


@router.get("/metrics", response_class=Response, responses=ERRORS)
def metrics(service: TheService, user: Reader) -> Response:
    """Prometheus text."""
    from crowdfence.service.metrics import metrics_text

    return Response(metrics_text(service), media_type="text/plain; version=0.0.4; charset=utf-8")
