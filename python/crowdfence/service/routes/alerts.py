"""What somebody should look at."""

from __future__ import annotations

import sqlite3
from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Path

from crowdfence.service.routes.asking import ERRORS, Decider, Reader, TheService

router = APIRouter(tags=["alerts"], responses=ERRORS)


@router.get("/alerts")
def alerts(service: TheService, user: Reader) -> dict[str, Any]:
    """The newest first."""
    return {"alerts": [alert.to_json() for alert in service.alerts.all()]}


@router.post("/alerts/{alert}/acknowledge", responses={404: {}, 507: {"description": "the disk is full"}})
def acknowledge(
    service: TheService, user: Decider, alert: Annotated[str, Path(pattern="^A[0-9]{1,12}$")]
) -> dict[str, Any]:
    """Somebody saw it, and is written down for it."""
    known = service.alerts.named(alert)
    if known is None:
        raise HTTPException(404, f"there is no alert {alert}")
    try:
        service.audit(user, "acknowledge", None, f"{known.id}: {known.text}")
    except sqlite3.Error as error:
        raise HTTPException(507, f"the acknowledgement cannot be kept: {error}") from error
    seen = service.alerts.acknowledge(alert, user.name, service.now_ns())
    return (seen or known).to_json()
