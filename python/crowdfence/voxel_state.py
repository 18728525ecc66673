"""What is known about a voxel: six states, so that missing data can never be read as "free"."""

from enum import IntEnum


class VoxelState(IntEnum):
    """State of one terrain voxel at one stamp; the values are those of `CrowdMap.state`."""

    NEVER_SEEN = 0
    """No view has ever seen it: nothing is known, and that is not evidence of absence."""

    OCCLUDED = 1
    """Never seen, but a camera pointed at it and something hid it."""

    EMPTY = 2
    """Seen recently, and what was seen speaks against crowd: how clearly it must is up to the method."""

    STALE = 3
    """The last look left it empty, but that look is older than `stale_after_s`: not evidence of absence any
    more."""

    CROWD = 4
    """Its probability is at or above the threshold."""

    NOT_CLEARED = 5
    """Looked at, however long ago, and not crowd now, but the last look did not leave it empty: from too far,
    too coarse, too flat; or crowd was seen, and is forgotten by now."""
