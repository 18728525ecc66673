"""Whether the places of photographs are what their receivers knew, by what photographs say of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from crowdfence.sources.photographs.tags import PhotographTags

_APART_M = 2.0
"""Of one place in EXIF and in XMP: seconds of an arc with one digit behind the point are 1.5 m off."""
_INEXACT_M = 5.0
"""As of a receiver without corrections on a bad day."""


def place_doubts(photographs: Sequence[PhotographTags]) -> Iterator[str]:
    """What to tell, each as the end of a sentence that begins with whose they are."""
    count = len(photographs)
    apart_m = [one.place_apart_m for one in photographs if one.place_apart_m > _APART_M]
    if apart_m:
        yield (
            f"EXIF and XMP of {len(apart_m)} of {count} photographs tell places up to {max(apart_m):.1f} m "
            "apart, as where a program put the one right and not the other (PPK): that of XMP counts, and "
            "the height of EXIF; remove those that are not meant, such as by exiftool "
            "-XMP-drone-dji:GPSLatitude= -XMP-drone-dji:GPSLongitude="
        )
    without = [one.without_fix for one in photographs if one.without_fix]
    if without:
        yield (
            f"{len(without)} of {count} photographs were taken without a fix of the receiver ({without[0]}): "
            "their places or heights are those of an earlier moment, and what they saw may be anywhere"
        )
    told_m = [one.place_error_m for one in photographs if one.place_error_m is not None]
    errors_m = [error_m for error_m in told_m if error_m > _INEXACT_M]
    if errors_m:
        yield (
            f"places of {len(errors_m)} of {count} photographs are uncertain by up to {max(errors_m):.0f} m, "
            "by their receiver, and so are those of their crowds"
        )
