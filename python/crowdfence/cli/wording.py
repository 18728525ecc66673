"""Messages of the library in the words of the command line.

The library tells its callers which argument to pass; on the command line the same thing is an option. What is
said here is said once, for every command.
"""

from __future__ import annotations

import re

_OPTIONS = {
    "assume_local": "--assume-local",
    "close_unseen": "--close-unseen",
    "georeference": "--origin LAT,LON,HEIGHT",
    "voxel_size_m": "--voxel-size-m",
    "max_range_m": "--max-range-m",
    "far_every_s": "--far-every",
    "max_jump_s": "--max-jump-s",
    "geoid_m": "--geoid-m",
}
_READER_OPTIONS = "band|nodata|crs|height_unit|height_offset_m|max_hole_m2|max_hole_m|surface|up|unit_m"

_RULES = [
    # Said twice, for both readers: the option stays.
    (re.compile(r"(--[a-z-]+(?: [A-Z,]+)?), georeference="), r"\1"),
    (re.compile(r"(--assume-local) \(assume_local=True\)"), r"\1"),
    (re.compile(r"(--origin) \(georeference\)"), r"\1"),
    # In quotes they are keys of a file.
    *((re.compile(rf'(?<!")\b{name}(?:=True| =)?(?![\w=])'), option) for name, option in _OPTIONS.items()),
    (re.compile(rf"\b({_READER_OPTIONS})=(?:'([^']*)'|([\w.:+-]+))"), r"--terrain-option \1=\2\3"),
    (re.compile(r"\b(height_offset_m|max_hole_m2|max_hole_m) = "), r"--terrain-option \1="),
    (re.compile(r"\bfleet_size is (\d+)$"), r"--fleet-size is \1: give the number of all, or leave it out"),
    (re.compile(r"\bcountry=(?=[A-Z]{3}$)"), "--country "),
    (re.compile(r"\bpass (crs|height_offset_m)\b"), r"pass --terrain-option \1=..."),
    (re.compile(r"\((for maps: )(height_offset_m)\)"), r"(\1--terrain-option \2=...)"),
]


_NAMED_OTHERWISE = {
    "clock_offset_s": "--clock-offset",
    "frames_per_s": "--fps",
    "true_positive": "--tpr",
    "false_positive": "--fpr",
}
_REFUSED = re.compile(
    "^(threshold|off_threshold|opening_looks|max_vertices|min_area_m2|max_hole_m2|simplify_m|stale_after_s|"
    "tolerance_ms|target_height_m|zone_log_odds|clear_log_odds|memory_s|sharp_gsd_m|doubt|agreement|prior|alpha|"
    f"decay|fleet_size|b_threshold|clearance_m|{'|'.join(_NAMED_OTHERWISE)})(?= is | must )"
)
"""With these a refusal begins; elsewhere in a message they are words."""
_OF_ANOTHER_KIND = re.compile(r"\b([a-z_]+)(?= does not apply$| says something about a recording;)")


def _option(found: re.Match[str]) -> str:
    name = found[1]
    return _NAMED_OTHERWISE.get(name, "--" + name.replace("_", "-"))


def in_options(message: str) -> str:
    """A message with the options of the command line where the library names its arguments."""
    message = _OF_ANOTHER_KIND.sub(_option, message)
    message = _REFUSED.sub(_option, message)
    for pattern, replacement in _RULES:
        message = pattern.sub(replacement, message)
    return message


def counted(number: int, noun: str) -> str:
    """ "1 zone", "2 zones"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"
