"""What operators do to zones and drones: every action has a name and a reason, and is written down."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Annotated, Any, Literal

from fastapi import APIRouter, HTTPException
from pydantic import BaseModel, ConfigDict, Field

from crowdfence.service.access import User
from crowdfence.service.gate import Refused
from crowdfence.service.left_out import DroneVerb
from crowdfence.service.operator_zones import (
    LEAST_DRAWN_M2,
    MOST_CORNERS,
    Action,
    RefusedAction,
    drawn_polygon,
    seen_ground,
)
from crowdfence.service.routes.asking import ERRORS, Decider, TheService
from crowdfence.service.routes.drones import Drone
from crowdfence.service.routes.zones import ZoneId
from crowdfence.service.service import Service
from crowdfence.service.stamps import stamp_of
from crowdfence.service.zone_json import zone_json

router = APIRouter(tags=["operator"], responses=ERRORS)
_OTHERS: dict[int | str, dict[str, Any]] = {
    404: {"description": "there is no such zone or drone"},
    409: {"description": "not possible with it"},
    503: {"description": "it is kept, and done once the detector has answered"},
    507: {"description": "the disk is full"},
}
ReasonText = Annotated[str, Field(min_length=3, max_length=500, pattern=r"\S")]


class Because(BaseModel):
    """Why."""

    model_config = ConfigDict(extra="forbid")

    reason: ReasonText


class Dismissal(Because):
    """Why, and of what."""

    seen_ns: Annotated[str, Field(max_length=20)] | None = None
    """Stamp of the zones that were looked at, as they tell it: where the crowd has grown since, it is not
    dismissed unseen. Without it the dismissal is of what is there when it arrives."""


class DrawnZone(Because):
    """A zone that an operator draws."""

    polygon: Annotated[
        list[Annotated[list[float], Field(min_length=2, max_length=2)]],
        Field(min_length=3, max_length=MOST_CORNERS),
    ]
    """Corners, local metres east and north; closed by itself."""
    restriction: Literal["prohibited", "no_sustained_flight"] = "prohibited"


@router.post("/zones", status_code=201, responses=_OTHERS)
def add(service: TheService, user: Decider, drawn: DrawnZone) -> dict[str, Any]:
    """Close ground."""
    ring = drawn.polygon if drawn.polygon[0] == drawn.polygon[-1] else [*drawn.polygon, drawn.polygon[0]]
    _refuse_degrees(ring)
    return _decide(service, user, "add", "", drawn.reason, rings=[[ring]], restriction=drawn.restriction)


def _refuse_degrees(ring: list[list[float]]) -> None:
    """Here and not where the journal is read again: what was taken once stays."""
    try:
        area_m2 = drawn_polygon([[ring]]).area
    except RefusedAction as error:
        raise HTTPException(422, str(error)) from error
    if area_m2 < LEAST_DRAWN_M2:
        raise HTTPException(
            422,
            f"the polygon closes {area_m2:.2g} m2, which is below {LEAST_DRAWN_M2:g} m2: its corners "
            "are local metres east and north, not degrees",
        )


@router.post("/zones/{zone:path}/lock", responses=_OTHERS)
def lock(service: TheService, user: Decider, zone: ZoneId, because: Because) -> dict[str, Any]:
    """Keep a zone of crowd closed until it is unlocked, whatever the drones see."""
    return _decide(service, user, "lock", zone, because.reason)


@router.post("/zones/{zone:path}/unlock", responses=_OTHERS)
def unlock(service: TheService, user: Decider, zone: ZoneId, because: Because) -> dict[str, Any]:
    """The zone follows what the drones see again."""
    return _decide(service, user, "unlock", zone, because.reason)


@router.post("/zones/{zone:path}/dismiss", responses=_OTHERS)
def dismiss(service: TheService, user: Decider, zone: ZoneId, because: Dismissal) -> dict[str, Any]:
    """Take back a zone that an operator drew. A zone of crowd can be passed through for a while: it stays on
    the list with the name of who did that, and closes again by itself."""
    seen = {} if because.seen_ns is None else {"rings": _seen(service, zone, because.seen_ns)}
    return _decide(service, user, "dismiss", zone, because.reason, **seen)


def _seen(service: Service, zone: str, seen_ns: str) -> list[Any] | None:
    """The ground of a zone of crowd at the moment that somebody looked at; None for other zones, which do not
    change. 409 where there was none of this id."""
    try:
        then = service.moment(stamp_of(seen_ns)).zones
    except ValueError as error:
        raise HTTPException(422, f"seen_ns: {error}") from error
    found = next((one for one in then.closed if one.id == zone), None)
    if found is None:
        raise HTTPException(409, f"there was no zone {zone} at {seen_ns}: look again, then dismiss it")
    return seen_ground(found) if found.kind == "crowd" else None


@router.post("/drones/{drone:path}/leave-out", status_code=204, responses=_OTHERS)
def leave_out(service: TheService, user: Decider, drone: Drone, because: Because) -> None:
    """From now on the looks of this drone do not count, because it sees nothing: a covered lens, a detector
    that fails. What is closed stays closed; what it alone has in view is seen by nobody."""
    _decide_drone(service, user, "leave_out", drone, because.reason)


@router.post("/drones/{drone:path}/take-in", status_code=204, responses=_OTHERS)
def take_in(service: TheService, user: Decider, drone: Drone, because: Because) -> None:
    """Its looks count again, from the next one on."""
    _decide_drone(service, user, "take_in", drone, because.reason)


@router.get("/audit")
def audit(service: TheService, user: Decider) -> dict[str, Any]:
    """Who did what, the newest first."""
    return {"entries": service.audit_json()}


def _decide(
    service: Service, user: User, action: Action, zone: str, reason: str, **drawn: Any
) -> dict[str, Any]:
    known = service.mission.newest
    if action != "add" and (known is None or zone not in {one.id for one in known.zones.closed}):
        raise HTTPException(404, f"there is no zone {zone}")
    with _answering(422 if action == "add" else 409):
        name = service.decide(user, action, zone, reason, **drawn)
    now = service.moment(None)
    told = next((one for one in now.zones.closed if one.id == name), None)
    return {"id": name} if told is None else zone_json(told, now.marks.get(name, {}))


def _decide_drone(service: Service, user: User, action: DroneVerb, drone: str, reason: str) -> None:
    if drone not in service.drones:
        raise HTTPException(404, f"there is no drone {drone}; there are: {', '.join(service.drones)}")
    with _answering(409):
        service.decide_drone(user, action, drone, reason)


@contextmanager
def _answering(refused: int) -> Iterator[None]:
    """`refused`: the status of what cannot be done."""
    try:
        yield
    except RefusedAction as error:
        raise HTTPException(refused, str(error)) from error
    except Refused as error:
        raise HTTPException(error.status, error.reason) from error
