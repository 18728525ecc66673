"""What a vehicle is asked besides its fence, and a command whose answer is not the whole truth."""

import pytest

from crowdfence.fence_sync import Patience
from crowdfence.fence_sync.fence_error import Silence
from crowdfence.fence_sync.messages import Home, Position, Version
from crowdfence.fence_sync.questions import optional, parameters
from crowdfence.fence_sync.reposition import reposition
from support.fence_zones import station
from support.vehicle_emulator import ARDUPILOT, Channel, EmulatedLink, EmulatedVehicle, polygon

HOME = (47.3977, 8.5456)
AROUND = polygon((47.40, 8.54), (47.40, 8.55), (47.41, 8.55), (47.41, 8.54))


def test_who_and_where_it_is() -> None:
    vehicle = EmulatedVehicle(uid=0xABC, position=(-17.5, 179.999), home=HOME)
    ground = station(EmulatedLink(vehicle))
    found = [ground.hold(optional(kind, ground.clock, ground.patience)) for kind in (Position, Home, Version)]
    assert found == [Position(-17.5, 179.999), Home(*HOME), Version("abc")]
    vehicle.home = None
    assert ground.hold(optional(Home, ground.clock, ground.patience)) is None


@pytest.mark.parametrize("autopilot", [EmulatedVehicle().autopilot, ARDUPILOT])
@pytest.mark.parametrize("value", [0, 1, 4, -3, 2_000_000_000])
def test_whole_numbers_travel_as_bytes_or_as_numbers(autopilot: int, value: int) -> None:
    vehicle = EmulatedVehicle(autopilot=autopilot, parameters={"GF_ACTION": value})
    ground = station(EmulatedLink(vehicle, channel=Channel(3, lose=0.2)))
    read = ground.hold(parameters(["GF_ACTION", "GF_NONE"], autopilot, ground.clock, Patience(tries=6)))
    assert read == {"GF_ACTION": pytest.approx(value, rel=1e-7)}


def test_an_answer_that_accepts_and_a_text_that_refuses() -> None:
    vehicle = EmulatedVehicle(items=list(AROUND))
    ground = station(EmulatedLink(vehicle))

    def go(latitude: float, longitude: float) -> str | None:
        return ground.hold(reposition(latitude, longitude, 500.0, ground.clock, ground.patience))

    assert go(47.405, 8.545) == "Reposition is outside geofence" and vehicle.moved_to is None
    assert go(47.395, 8.545) is None and vehicle.moved_to == pytest.approx((47.395, 8.545))
    vehicle.mute = True
    with pytest.raises(Silence, match="did not answer Command"):
        go(47.395, 8.545)
