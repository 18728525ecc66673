"""The mission protocol for fences over links that lose packets, bring them twice, late and out of order."""

from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mavlink

from crowdfence.fence_sync import FenceError, GroundStation, Patience, fence_item, messages
from crowdfence.fence_sync.conversation import ask
from crowdfence.fence_sync.fence_error import Silence
from crowdfence.fence_sync.fence_item import FenceItem, shapes_of
from crowdfence.fence_sync.messages import Ack, Count, Item, MissionResult, RequestItem, RequestList
from crowdfence.fence_sync.transfer import download, upload
from support.fence_zones import station
from support.vehicle_emulator import Channel, EmulatedLink, EmulatedVehicle, RawItem

PATIENCE = Patience()


def circles(count: int, radius_m: float = 20.0) -> list[FenceItem]:
    return [
        FenceItem(fence_item.CIRCLE_EXCLUSION, radius_m, 473_977_000 + 5000 * i, 85_456_000)
        for i in range(count)
    ]


def raw(items: Sequence[FenceItem]) -> list[RawItem]:
    return [(item.command, item.param1, item.latitude_e7, item.longitude_e7) for item in items]


def sent(ground: GroundStation, items: Sequence[FenceItem]) -> int:
    return ground.hold(upload(items, ground.clock, ground.patience))


def read(ground: GroundStation) -> tuple[FenceItem, ...]:
    return ground.hold(download(ground.clock, ground.patience))


def test_numbers_are_those_of_mavlink() -> None:
    for name in ("POLYGON_INCLUSION", "POLYGON_EXCLUSION"):
        assert getattr(fence_item, name) == getattr(
            mavlink, f"MAV_CMD_NAV_FENCE_{name.replace('N_', 'N_VERTEX_', 1)}"
        )
    for name in ("CIRCLE_INCLUSION", "CIRCLE_EXCLUSION", "RETURN_POINT"):
        assert getattr(fence_item, name) == getattr(mavlink, f"MAV_CMD_NAV_FENCE_{name}")
    for result in MissionResult:
        assert result == getattr(mavlink, f"MAV_MISSION_{result.name}")
    for number, name in (("HOME_MESSAGE", "HOME_POSITION"), ("POSITION_MESSAGE", "GLOBAL_POSITION_INT")):
        assert getattr(messages, number) == getattr(mavlink, f"MAVLINK_MSG_ID_{name}")
    assert messages.VERSION_MESSAGE == mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION


def test_a_list_is_replaced_and_read_back() -> None:
    vehicle = EmulatedVehicle()
    ground = station(EmulatedLink(vehicle))
    for items in (circles(3), circles(60), [], circles(1)):
        assert sent(ground, items) == MissionResult.ACCEPTED
        assert vehicle.items == raw(items)
        assert raw(read(ground)) == raw(items)


def test_what_px4_was_measured_to_say() -> None:
    """63 items and no more; a polygon of two corners is an error, a command that is no fence is taken; the
    list stays on every refusal."""
    vehicle = EmulatedVehicle()
    ground = station(EmulatedLink(vehicle))
    assert sent(ground, circles(63)) == MissionResult.ACCEPTED
    assert sent(ground, circles(64)) == MissionResult.NO_SPACE
    line = [FenceItem(fence_item.POLYGON_EXCLUSION, 2.0, 473_977_000 + i, 85_456_000) for i in range(2)]
    assert sent(ground, line) == MissionResult.ERROR
    assert vehicle.items == raw(circles(63)) and vehicle.lists == [raw(circles(63))]
    foreign = [FenceItem(16, 0.0, 473_977_000, 85_456_000)]
    assert sent(ground, foreign) == MissionResult.ACCEPTED and vehicle.items == raw(foreign)


@settings(max_examples=25)
@given(
    seed=st.integers(0, 2**32 - 1),
    lose=st.sampled_from([0.0, 0.1, 0.3]),
    twice=st.sampled_from([0.0, 0.3]),
    late=st.sampled_from([0.0, 0.3]),
    before=st.integers(0, 12),
    after=st.integers(0, 12),
)
def test_a_bad_link_leaves_one_list_or_the_other(
    seed: int, lose: float, twice: float, late: float, before: int, after: int
) -> None:
    vehicle = EmulatedVehicle(items=raw(circles(before, 10.0)))
    ground = station(EmulatedLink(vehicle, channel=Channel(seed, lose, twice, late)))
    old, new = raw(circles(before, 10.0)), raw(circles(after))
    try:
        assert raw(read(ground)) == old
        result = sent(ground, circles(after))
    except FenceError:
        assert vehicle.items in (old, new)
    else:
        if result == MissionResult.ERROR:  # as PX4 says to what comes late: who sent it reads the list
            assert vehicle.items in (old, new)
        else:
            assert result == MissionResult.ACCEPTED and vehicle.items == new


def test_a_word_that_is_lost_between_reading_and_writing_is_no_refusal() -> None:
    """PX4 takes no list until it heard that its own was read: one push in ten over a radio that loses every
    tenth packet was "refused: ERROR"."""
    vehicle = EmulatedVehicle(items=raw(circles(2)))
    ground = station(EmulatedLink(vehicle))
    heard, vehicle._on_mission_ack = vehicle._on_mission_ack, lambda *_: None  # type: ignore[method-assign]
    assert raw(read(ground)) == vehicle.items
    vehicle._on_mission_ack = heard  # type: ignore[method-assign]
    assert sent(ground, circles(5)) == MissionResult.ACCEPTED and vehicle.items == raw(circles(5))


def test_an_error_after_which_the_vehicle_goes_on_is_no_refusal() -> None:
    """PX4 says so of a first word that comes twice; one that stops there refuses."""
    now_s = 0.0
    conversation = upload(circles(2), lambda: now_s, PATIENCE)
    next(conversation)
    conversation.send(RequestItem(0))
    assert conversation.send(Ack(MissionResult.ERROR)).say == ()
    assert conversation.send(RequestItem(1)).say == (Item(1, circles(2)[1]),)
    conversation.send(Ack(MissionResult.ERROR))
    with pytest.raises(StopIteration) as end:
        conversation.send(None)
    assert end.value.value == MissionResult.ERROR


def test_a_vehicle_that_is_busy_for_good_refuses() -> None:
    vehicle = EmulatedVehicle(rejects=mavlink.MAV_MISSION_ERROR)
    link = EmulatedLink(vehicle)
    ground = station(link)
    began_s = link.now_s
    assert sent(ground, circles(2)) == MissionResult.ERROR and not vehicle.lists
    assert link.now_s - began_s == pytest.approx(4 * 0.5 + 3 * 0.5, abs=0.1)


def test_a_vehicle_that_falls_silent_is_said_to_be() -> None:
    vehicle = EmulatedVehicle()
    link = EmulatedLink(vehicle)
    ground = station(link, Patience(retry_s=0.5, tries=4))
    vehicle.mute = True
    began_s = link.now_s
    for conversation in (
        upload(circles(2), link.clock, ground.patience),
        download(link.clock, ground.patience),
    ):
        with pytest.raises(Silence, match=r"check (that|the link)"):
            ground.hold(conversation)
    assert link.now_s - began_s == pytest.approx(2 * 4 * 0.5, abs=0.1)


def test_nobody_there() -> None:
    link = EmulatedLink(EmulatedVehicle(mute=True))
    ground = GroundStation(link, clock=link.clock)
    with pytest.raises(FenceError, match="no heartbeat of a vehicle was heard in 3 s; check --link"):
        ground.find_vehicle(3.0)
    assert link.now_s == pytest.approx(3.0)


def test_several_vehicles_are_told_apart_by_their_system_id() -> None:
    first, second = EmulatedVehicle(system=1), EmulatedVehicle(system=7)
    link = EmulatedLink(first, second)
    ground = GroundStation(link, clock=link.clock)
    with pytest.raises(FenceError, match="vehicles 1, 7 are on this link; choose one with --system"):
        ground.find_vehicle(5.0)
    with pytest.raises(FenceError, match="no heartbeat of vehicle 9 was heard in 5 s, only of 1, 7"):
        ground.find_vehicle(5.0, 9)
    ground.find_vehicle(5.0, 7)
    assert sent(ground, circles(2)) == MissionResult.ACCEPTED
    assert (first.items, second.items) == ([], raw(circles(2)))


def test_only_autopilots_are_vehicles_and_only_theirs_is_heard() -> None:
    """A camera on the same vehicle and another ground station speak too."""
    vehicle = EmulatedVehicle()
    camera = EmulatedVehicle(component=100, items=raw(circles(9)))
    other = EmulatedVehicle(system=255, component=190, autopilot=mavlink.MAV_AUTOPILOT_INVALID)
    ground = station(EmulatedLink(camera, other, vehicle))
    assert (ground.vehicle.system, ground.vehicle.component) == (1, 1)
    assert read(ground) == ()


def test_an_answer_from_before_accepts_nothing() -> None:
    """The vehicle's "accepted" of an earlier list comes again; then the new list is asked for and refused."""
    conversation = upload(circles(2), lambda: 0.0, PATIENCE)
    assert next(conversation).say == (Count(2),)
    assert conversation.send(Ack(MissionResult.ACCEPTED)).say == ()
    assert conversation.send(RequestItem(0)).say == (Item(0, circles(2)[0]),)
    assert conversation.send(RequestItem(0)).say == (Item(0, circles(2)[0]),)  # it was lost
    assert conversation.send(RequestItem(5)).say == ()  # of a longer list
    assert conversation.send(Ack(MissionResult.INVALID_SEQUENCE)).say == ()  # ArduPilot goes on
    with pytest.raises(StopIteration) as end:
        conversation.send(Ack(MissionResult.INVALID))
    assert end.value.value == MissionResult.INVALID


def test_a_list_that_changes_while_it_is_read_is_read_again() -> None:
    now_s = 0.0
    conversation = download(lambda: now_s, PATIENCE)
    items = circles(3)
    assert next(conversation).say == (RequestList(),)
    assert conversation.send(Count(1)).say == (RequestItem(0),)  # an old answer; the true one is next
    assert conversation.send(Count(3)).say == (RequestList(),)
    assert conversation.send(Count(3)).say == (RequestItem(0),)
    for seq in range(3):
        asked = conversation.send(Item(seq, items[seq]))
    assert asked.say == (RequestList(),)
    assert conversation.send(Count(3)).say == (Ack(MissionResult.ACCEPTED),)
    with pytest.raises(StopIteration) as end:
        conversation.send(None)
    assert end.value.value == tuple(items)


def test_a_list_that_would_be_read_for_hours_is_given_up() -> None:
    """A length that no vehicle holds: every item was waited for, however long."""
    now_s, patience = 0.0, Patience(longest_s=60.0)
    conversation = download(lambda: now_s, patience)
    next(conversation)
    asked = conversation.send(Count(65_535))
    with pytest.raises(FenceError, match="61 of its 65535 items came in 60 s; check the link"):
        for seq in range(65_535):
            assert asked.say == (RequestItem(seq),)
            now_s += 1.0
            asked = conversation.send(Item(seq, circles(1)[0]))


def test_a_vehicle_that_knows_no_fences_is_said_to() -> None:
    conversation = download(lambda: 0.0, PATIENCE)
    next(conversation)
    with pytest.raises(FenceError, match="UNSUPPORTED; does its firmware take fences"):
        conversation.send(Ack(MissionResult.UNSUPPORTED))


def test_a_vehicle_whose_fence_another_station_writes_is_busy() -> None:
    """It was asked whether its firmware takes fences at all."""
    conversation = download(lambda: 0.0, PATIENCE)
    next(conversation)
    with pytest.raises(
        FenceError, match="DENIED; ArduPilot says so while another ground station writes it: try"
    ):
        conversation.send(Ack(MissionResult.DENIED))


def test_we_are_no_ground_station_of_an_operator() -> None:
    """As system 255 our heartbeat stood in for theirs: ArduPilot did not notice that their link was lost."""
    link = EmulatedLink(EmulatedVehicle())
    packets: list[bytes] = []
    send, link.send = link.send, lambda data: (packets.append(data), send(data))[1]  # type: ignore[method-assign]
    read(station(link))
    said = [packet for data in packets for packet in mavlink.MAVLink(None).parse_buffer(data) or []]
    assert {(one.get_srcSystem(), one.get_srcComponent()) for one in said} == {(254, 190)}
    assert {one.type for one in said if one.get_type() == "HEARTBEAT"} == {mavlink.MAV_TYPE_GCS}, (
        "PX4 sends texts"
    )


def test_something_is_said_again_until_it_is_answered() -> None:
    conversation = ask(RequestList(), lambda heard: None, lambda: 0.0, Patience(retry_s=0.5, tries=3))
    said = [next(conversation).say]
    with pytest.raises(Silence, match=r"did not answer RequestList in 1.5 s"):
        while True:
            said.append(conversation.send(None).say)
    assert said == [(RequestList(),)] * 3


def test_shapes_of_items() -> None:
    def corner(of: int, place: int) -> FenceItem:
        return FenceItem(fence_item.POLYGON_EXCLUSION, float(of), place, 0)

    triangle = [corner(3, i) for i in range(3)]
    square = [corner(4, i) for i in range(4)]
    (circle,) = circles(1)
    home = FenceItem(fence_item.RETURN_POINT, 0.0, 1, 1)
    assert shapes_of([*triangle, circle, *square, home]) == [
        tuple(triangle),
        (circle,),
        tuple(square),
        (home,),
    ]
    assert shapes_of([*square[:2], *triangle]) == [tuple(square[:2]), tuple(triangle)]
    assert shapes_of([]) == []
