"""How far a clock that shows local time is ahead of UTC, where something tells UTC beside it."""

from __future__ import annotations

_QUARTER_S = 900
_MOST_ZONE_S = 14 * 3600
_WHOLE_S = 3600
_HALVES_S = (-34_200, -16_200, -12_600, -9000, 12_600, 16_200, 19_800, 23_400, 30_600, 34_200, 37_800, 41_400)
"""Zones of half hours since 2010: Marquesas, Caracas, Newfoundland (winter, summer), Iran (winter, summer),
India, Myanmar, Pyongyang, Adelaide (winter, summer), Norfolk."""
_QUARTERS_S = (20_700, 31_500, 45_900, 49_500)
"""Zones that are no whole or half hour: Nepal, Eucla, the Chatham Islands in winter and in summer."""


def quarter_zone_s(ahead_s: float, off_s: float) -> int | None:
    """The zone of a clock so many seconds ahead of UTC, to a quarter of an hour. None where it is more than
    `off_s` beside any."""
    zone_s = round(ahead_s / _QUARTER_S) * _QUARTER_S
    return zone_s if abs(ahead_s - zone_s) <= off_s and abs(zone_s) <= _MOST_ZONE_S else None


def real_zone_s(ahead_s: float, off_s: float) -> int | None:
    """The same, of the zones that there are."""
    zone_s = quarter_zone_s(ahead_s, off_s)
    if zone_s is None or zone_s % _WHOLE_S == 0 or zone_s in (*_HALVES_S, *_QUARTERS_S):
        return zone_s
    return None


def zone_name(zone_s: int) -> str:
    """Such as UTC+05:45."""
    hours, minutes = divmod(abs(zone_s) // 60, 60)
    return f"UTC{'-' if zone_s < 0 else '+'}{hours:02}:{minutes:02}"
