"""Packets of 188 bytes: sync byte, flags and stream, 4 bits of what the packet holds and 4 that count."""

from pathlib import Path

import pytest

from crowdfence.sources.pictures.transport_stream import losses

STREAM, OTHER = 256, 17
CARRIES, ADAPTS, BOTH = 1, 2, 3


def packet(
    count: int, *, stream: int = STREAM, holds: int = CARRIES, flags: int = 0, damaged: bool = False
) -> bytes:
    """One that is filled with its count; `flags` are those of the adaptation field."""
    adaptation = bytes([1, flags]) if holds & ADAPTS else b""
    head = bytes([0x47, damaged << 7 | stream >> 8, stream & 0xFF, holds << 4 | count & 0x0F]) + adaptation
    return head + bytes([count & 0x0F]) * (188 - len(head))


def lost(tmp_path: Path, packets: list[bytes]) -> list[int]:
    path = tmp_path / "film.ts"
    path.write_bytes(b"".join(packets))
    return [int(place) for place in losses(path, STREAM)]


def test_a_stream_that_counts_on_lost_nothing(tmp_path: Path) -> None:
    other = [packet(5, stream=OTHER)] * 2
    whole = [packet(count) for count in range(40)]
    assert lost(tmp_path, [*whole[:7], *other, *whole[7:]]) == []
    assert lost(tmp_path, []) == []
    assert lost(tmp_path, [b"x" * 100]) == []


def test_the_packet_before_a_gap_is_told(tmp_path: Path) -> None:
    whole = [packet(count) for count in range(40)]
    assert lost(tmp_path, [*whole[:7], *whole[8:]]) == [6 * 188]
    assert lost(tmp_path, [*whole[:4], *whole[5:20], *whole[30:]]) == [3 * 188, 18 * 188]


def test_what_counts_otherwise_on_purpose_is_no_gap(tmp_path: Path) -> None:
    # A packet without pictures does not count, one may be sent twice, and a stream may say it starts anew.
    silent, anew = packet(3, holds=ADAPTS), packet(9, holds=BOTH, flags=0x80)
    sent = [packet(2), packet(3), silent, packet(4), packet(4), anew, packet(10)]
    assert lost(tmp_path, sent) == []
    # Of 17 packets 16 are missing where the count is the same and the content another.
    other = packet(4)[:-1] + b"x"
    assert lost(tmp_path, [packet(3), packet(4), other, packet(5)]) == [188]


def test_of_a_stream_that_does_not_count_nothing_is_known(tmp_path: Path) -> None:
    assert lost(tmp_path, [packet(0)[:-1] + bytes([number]) for number in range(40)]) == []


def test_a_packet_that_says_it_was_damaged_is_told(tmp_path: Path) -> None:
    assert lost(tmp_path, [packet(0), packet(1, damaged=True), packet(2)]) == [188]


@pytest.mark.parametrize(("before", "behind"), [(4, 0), (0, 16)])
def test_packets_with_a_time_before_or_a_checksum_behind(tmp_path: Path, before: int, behind: int) -> None:
    around = [bytes(before) + packet(count) + bytes(behind) for count in range(9)]
    stride = 188 + before + behind
    assert lost(tmp_path, around) == []
    assert lost(tmp_path, [*around[:5], *around[6:]]) == [4 * stride + before]


def test_bytes_that_are_missing_within_a_packet_shift_the_others(tmp_path: Path) -> None:
    whole = [packet(count) for count in range(12)]
    # Packet 5 takes up the beginning of packet 6, which is missing then; packet 7 is found again.
    assert lost(tmp_path, [*whole[:5], whole[5][:100], *whole[6:]]) == [5 * 188]
