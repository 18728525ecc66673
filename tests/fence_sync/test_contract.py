"""What an autopilot must do with a fence, over a real link: the emulator, and any autopilot whose address is
in CROWDFENCE_AUTOPILOT, such as udpin:0.0.0.0:14550. Its fence is replaced and cleared: not in flight.

mavsdk is a client that we did not write: what it sends we read, what we send it reads.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import shapely
from mavsdk.component_type import ComponentType
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.geofence.geofence import Circle, FenceType, Geofence, GeofenceData, Point, Polygon

from crowdfence import Georeference, Zone
from crowdfence.fence_sync import FenceError, FenceKeeper, GroundStation, open_transport
from crowdfence.fence_sync.autopilot_capacity import usual_capacity
from crowdfence.fence_sync.fence_item import CIRCLE_EXCLUSION, POLYGON_EXCLUSION, items_of
from crowdfence.fence_sync.messages import Position
from crowdfence.fence_sync.questions import optional
from support.fence_zones import zone
from support.vehicle_emulator import EmulatedVehicle, UdpVehicle

LIVE = os.environ.get("CROWDFENCE_AUTOPILOT")


@pytest.fixture(params=["emulator", "live"])
def address(request: pytest.FixtureRequest) -> Iterator[str]:
    """Of an autopilot, as our links and, with two slashes, mavsdk's are written."""
    if request.param == "emulator":
        with UdpVehicle(EmulatedVehicle()) as served:
            yield f"udpout:127.0.0.1:{served.port}"
    elif LIVE is None:
        pytest.skip("CROWDFENCE_AUTOPILOT gives no address of a live autopilot")
    else:
        yield LIVE


class OurClient:
    """Our end, and zones some hundred metres away from the vehicle."""

    def __init__(self, address: str, folder: Path) -> None:
        self.station = GroundStation(open_transport(address))
        self.station.find_vehicle(20.0, None if address == LIVE else 1)
        self.keeper = FenceKeeper(self.station, folder)
        place = self.station.hold(optional(Position, self.station.clock, self.station.patience))
        assert isinstance(place, Position)
        self.here = Georeference(place.latitude_deg, place.longitude_deg, 0.0)

    def zones(self, count: int) -> list[Zone]:
        return [zone(shapely.box(300.0, 60.0 * i, 330.0, 60.0 * i + 30.0), f"Z{i}") for i in range(count)]

    def __enter__(self) -> "OurClient":
        return self

    def __exit__(self, *_: object) -> None:
        self.station.close()


@pytest.fixture
def ours(address: str, tmp_path: Path) -> Iterator[OurClient]:
    with OurClient(address, tmp_path) as client:
        yield client


def test_zones_are_taken_read_back_and_cleared(ours: OurClient) -> None:
    report = ours.keeper.put(ours.zones(3), ours.here)
    assert report.written and [len(shape) for shape in report.ours] == [4, 4, 4]
    assert ours.keeper.read() == (report.shapes, report.ours)
    ours.keeper.put([], ours.here)
    assert ours.keeper.read()[1] == ()


def test_more_zones_than_the_fence_holds_are_fitted_into_it(ours: OurClient) -> None:
    report = ours.keeper.put(ours.zones(40), ours.here)
    assert usual_capacity(ours.station.vehicle.autopilot).holds(report.shapes)
    assert report.placed.fence.over_coverage_m2 > 0.0
    ours.keeper.clear()


def test_the_fence_outlives_the_client(address: str, tmp_path: Path) -> None:
    with OurClient(address, tmp_path) as first:
        put = first.keeper.put(first.zones(2), first.here)
    with OurClient(address, tmp_path) as second:
        assert second.keeper.read() == (put.shapes, put.ours)
        second.keeper.clear()


@contextmanager
def mavsdk_client(address: str) -> Iterator[Geofence]:
    """mavsdk's end of a link. It ends the whole process where a part of it outlives the rest."""
    kind, place = address.split(":", 1)
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(f"{kind}://{place}")
    system = mavsdk.first_autopilot(20.0)
    geofence = None if system is None else Geofence(system)
    try:
        assert geofence is not None
        yield geofence
    finally:
        for part in filter(None, (geofence, system, mavsdk)):
            part.destroy()


def corners_of(polygon: Any) -> list[tuple[float, float]]:
    return [(point.latitude_deg, point.longitude_deg) for point in polygon.points]


def test_mavsdk_writes_reads_and_clears(address: str) -> None:
    triangle = [(47.3980, 8.5454), (47.3980, 8.5460), (47.3985, 8.5460)]
    data = GeofenceData(
        [Polygon([Point(*corner) for corner in triangle], FenceType.EXCLUSION)],
        [Circle(Point(47.40, 8.55), 25.0, FenceType.EXCLUSION)],
    )
    with mavsdk_client(address) as theirs:
        theirs.upload_geofence(data)
        there = theirs.download_geofence()
        assert corners_of(there.polygons[0]) == [pytest.approx(corner, abs=1.1e-7) for corner in triangle]
        assert there.circles[0].radius == 25.0 and there.circles[0].fence_type == FenceType.EXCLUSION
        theirs.clear_geofence()
        assert theirs.download_geofence().polygons == []


def test_we_keep_what_mavsdk_wrote_and_it_reads_what_we_write(tmp_path: Path) -> None:
    """On the emulator, where both can be on the link at once."""
    with UdpVehicle(EmulatedVehicle()) as served:
        address = f"udpout:127.0.0.1:{served.port}"
        with mavsdk_client(address) as theirs, OurClient(address, tmp_path) as ours:
            circle = GeofenceData([], [Circle(Point(47.40, 8.55), 25.0, FenceType.EXCLUSION)])
            theirs.upload_geofence(circle)
            (read,), known = ours.keeper.read()
            assert known == () and read[0].command == CIRCLE_EXCLUSION and read[0].param1 == 25.0
            assert (read[0].latitude_e7, read[0].longitude_e7) == (474_000_000, 85_500_000)
            report = ours.keeper.put(ours.zones(2), ours.here)
            there = theirs.download_geofence()
            assert len(there.circles) == 1 and len(there.polygons) == 2
            for polygon, shape in zip(there.polygons, report.ours, strict=True):
                assert polygon.fence_type == FenceType.EXCLUSION
                sent = [(item.latitude_e7 / 1e7, item.longitude_e7 / 1e7) for item in shape]
                assert corners_of(polygon) == [pytest.approx(corner, abs=1e-9) for corner in sent]
            # It replaces the whole list; we notice, keep its shape and put ours back.
            theirs.upload_geofence(circle)
            report = ours.keeper.put(ours.zones(2), ours.here)
            assert "changed_by_others" in [event.kind for event in report.alarms]
            commands = [item.command for item in items_of(report.shapes)]
            assert commands == [*[POLYGON_EXCLUSION] * 8, CIRCLE_EXCLUSION]


def test_a_port_where_nobody_answers() -> None:
    with UdpVehicle(EmulatedVehicle(mute=True)) as served:
        station = GroundStation(open_transport(f"udpout:127.0.0.1:{served.port}"))
        with pytest.raises(FenceError, match="no heartbeat"):
            station.find_vehicle(0.3)
        station.close()


def test_a_vehicle_that_calls_us(tmp_path: Path) -> None:
    """udpin: we wait at a port, as ground stations do."""
    import socket

    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    station = GroundStation(open_transport(f"udpin:127.0.0.1:{port}"))
    with UdpVehicle(EmulatedVehicle(), calls=port):
        station.find_vehicle(10.0, 1)
        assert FenceKeeper(station, tmp_path).read() == ((), ())
    with pytest.raises(OSError, match=f"the link udpin:127.0.0.1:{port} cannot be opened"):
        open_transport(f"udpin:127.0.0.1:{port}")
    station.close()


@pytest.mark.parametrize("address", ["", "udp:1.2.3.4:5", "udpin:14550", "udpout:host:0", "tcp:host:99999"])
def test_an_address_that_is_none(address: str) -> None:
    with pytest.raises(FenceError, match="is no link; give udpin:HOST:PORT"):
        open_transport(address)
