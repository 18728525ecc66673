"""Identifiers of zones: a letter and a number to base 36, at most 7 characters."""

MAX_ID_LENGTH = 7
"""Longest identifier that ED-318 and ED-269 accept."""

_DIGITS = "0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZ"
MOST_ID = len(_DIGITS) ** (MAX_ID_LENGTH - 1) - 1


def zone_id(number: int, letter: str = "Z") -> str:
    """Of the zone with this number, from 1. ValueError where there is no room for it.

    >>> zone_id(35), zone_id(36), zone_id(36**6 - 1)
    ('ZZ', 'Z10', 'ZZZZZZZ')
    """
    if not 0 < number <= MOST_ID:
        raise ValueError(f"zone {number} is beyond the {MOST_ID} ids; raise min_area_m2 or the threshold")
    digits = ""
    while number:
        number, digit = divmod(number, len(_DIGITS))
        digits = _DIGITS[digit] + digits
    return letter + digits
