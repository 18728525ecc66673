"""What somebody should look at."""

from __future__ import annotations

from typing import Annotated, Any

from fastapi import APIRouter, HTTPException, Path

from crowdfence.service.routes.asking import ERRORS, Decider, Reader, TheService

router = APIRouter(tags=["alerts"], responses=ERRORS)


@router.get("/alerts")
def alerts(service: TheService, user: Reader) -> dict[str, Any]:
    """The newest first."""
    return {"alerts": [alert.to_json() for alert in service.alerts.all()]}


@router.post("/alerts/{alert}/acknowledge", responses={404: {}})
def acknowledge(
    service: TheService, user: Decider, alert: Annotated[str, Path(pattern="^A[0-9]{1,12}$")]
) -> dict[str, Any]:
    """Somebody saw it."""
    known = service.alerts.acknowledge(alert, user.name, service.now_ns())
    if known is None:
        raise HTTPException(404, f"there is no alert {alert}")
    service.audit(user, "acknowledge", None, f"{known.id}: {known.text}")
    return known.to_json()
