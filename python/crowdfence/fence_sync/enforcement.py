"""Parameters that decide what an autopilot does at a fence: nothing, too much, or what is wanted."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from crowdfence.fence_sync.fence_error import FenceError
from crowdfence.fence_sync.fence_event import FenceEvent
from crowdfence.fence_sync.ground_station import Vehicle
from crowdfence.fence_sync.messages import Autopilot

TERMINATE = 4
"""GF_ACTION of PX4: the motors stop in the air."""
_PX4_MILD = {0: "none", 1: "warn"}
_POLYGONS_BIT = 4
"""Of FENCE_TYPE: polygons and circles."""
_ROUND_IN_GUIDED_BIT = 64
"""Of GUID_OPTIONS: a target is flown to by way points, as those of a mission."""

PARAMETERS: Mapping[int, tuple[str, ...]] = {
    Autopilot.PX4: ("GF_ACTION",),
    Autopilot.ARDUPILOT: ("FENCE_ENABLE", "FENCE_TYPE", "FENCE_ACTION"),
}
NOT_OF_EVERY_VERSION: Mapping[int, tuple[str, ...]] = {
    Autopilot.PX4: ("GF_PREDICT",),
    Autopilot.ARDUPILOT: ("OA_TYPE", "GUID_OPTIONS"),
}


def enforcement(vehicle: Vehicle, values: Mapping[str, float]) -> Iterator[FenceEvent]:
    """What will not happen at the fence, by parameters and by what the vehicle says of it. FenceError where
    the vehicle would be dropped on the crowd, or where it is not known that it would not."""
    if vehicle.autopilot == Autopilot.PX4:
        yield from _px4(values)
    elif vehicle.autopilot == Autopilot.ARDUPILOT:
        unkept = list(_ardupilot(values))
        if not unkept and _is_switched_off(vehicle):
            unkept.append(
                _not_enforced(
                    "the vehicle says that its fence is off, whatever FENCE_ENABLE is: a switch of the "
                    "transmitter, a command or a landing did that; switch it on again"
                )
            )
        yield from unkept or _ardupilot_acts_inside(values)
    else:
        yield FenceEvent(
            "autopilot_unknown",
            f"autopilot {vehicle.autopilot} is neither PX4 nor ArduPilot: what it does at a fence is not "
            "known",
            alarm=True,
        )


def _px4(values: Mapping[str, float]) -> Iterator[FenceEvent]:
    if "GF_ACTION" not in values:
        raise FenceError(
            "GF_ACTION could not be read, so it may stop the motors at a fence; nothing was sent. Check the "
            "link, or the parameter in a ground station"
        )
    action = round(values["GF_ACTION"])
    if action == TERMINATE:
        raise FenceError(
            "GF_ACTION is 4 (terminate): the motors would stop at the fence of a crowd; nothing was sent. "
            "Set it to 2 (hold), 3 (return) or 5 (land)"
        )
    if action in _PX4_MILD:
        yield _not_enforced(
            f"GF_ACTION is {action} ({_PX4_MILD[action]}): the vehicle flies through the fence; set 2 (hold)"
        )
    elif values.get("GF_PREDICT") == 0.0:
        yield FenceEvent(
            "acts_inside",
            "GF_PREDICT is 0: the vehicle acts once it is in the fence, and halts 7 m behind its edge at "
            "5 m/s, 23 m at 9 m/s; set 1, or close so much more (--buffer)",
            alarm=True,
        )


def _ardupilot(values: Mapping[str, float]) -> Iterator[FenceEvent]:
    unread = [name for name in PARAMETERS[Autopilot.ARDUPILOT] if name not in values]
    if unread:
        yield _not_enforced(f"{', '.join(unread)} could not be read: whether the fence is kept is not known")
    if values.get("FENCE_ENABLE", 1.0) == 0.0:
        yield _not_enforced("FENCE_ENABLE is 0: the vehicle ignores its fence; set 1")
    fence_type = round(values.get("FENCE_TYPE", _POLYGONS_BIT))
    if not fence_type & _POLYGONS_BIT:
        wanted = fence_type | _POLYGONS_BIT
        yield _not_enforced(f"FENCE_TYPE is {fence_type}: polygons and circles are ignored; set {wanted}")
    if values.get("FENCE_ACTION", 1.0) == 0.0:
        yield _not_enforced("FENCE_ACTION is 0 (report only): the vehicle flies through the fence; set 1")


def flies_round(values: Mapping[str, float]) -> bool:
    """Whether missions and returns are flown round the fence: only ArduCopter can."""
    return values.get("OA_TYPE", 0.0) != 0.0


def _ardupilot_acts_inside(values: Mapping[str, float]) -> Iterator[FenceEvent]:
    guided = round(values.get("GUID_OPTIONS", _ROUND_IN_GUIDED_BIT))
    if not flies_round(values):
        yield FenceEvent(
            "acts_inside",
            "ArduPilot acts once it is in the fence, and halts 9 m behind its edge at 5 m/s, 22 m at 10 m/s: "
            "close so much more (--buffer)"
            + (", or have it fly round them (OA_TYPE is 0; set 2)" if "OA_TYPE" in values else ""),
            alarm="OA_TYPE" in values,
        )
    elif not guided & _ROUND_IN_GUIDED_BIT:
        yield FenceEvent(
            "acts_inside",
            f"GUID_OPTIONS is {guided}: missions are flown round the fence, a target in GUIDED is not: it "
            "halts 9 m behind the edge at 5 m/s, 22 m at 10 m/s; set "
            f"{guided | _ROUND_IN_GUIDED_BIT}, or close so much more (--buffer)",
            alarm=True,
        )


def _is_switched_off(vehicle: Vehicle) -> bool:
    """Before it is armed it may be off until the take-off (FENCE_AUTOENABLE)."""
    geofence = vehicle.geofence
    return vehicle.armed and geofence is not None and geofence.present and not geofence.enabled


def _not_enforced(text: str) -> FenceEvent:
    return FenceEvent("not_enforced", text, alarm=True)
