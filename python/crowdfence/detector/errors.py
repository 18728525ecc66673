"""The one exception of the detector."""

from crowdfence.errors import DetectorError

__all__ = ["DetectorError"]
