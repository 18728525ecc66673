"""Which frame of a tree is that of the camera's pictures: z forward, x right (REP 103).

Pictures should name it, and those of simulators often name the link that carries it instead, whose x is
forward: taken for the camera's own, such a camera looks at the sky.
"""

from __future__ import annotations

from crowdfence.sources.ros_bag.transforms import TransformTree

_OPTICAL = "optical"
_LINK = "_link"
"""Ends the names of parts of robots, whose axes are forward-left-up."""


def optical_frame(named: str, tree: TransformTree) -> str:
    """The frame that pictures name, or the only one right below it that is a camera's by its name."""
    below = [] if _is_optical(named) else [name for name in tree.fixed_below(named) if _is_optical(name)]
    return below[0] if len(below) == 1 else named


def frame_doubt(named: str, frame: str) -> str | None:
    """What to tell of taking `frame` for that of pictures that name `named`, as the end of a sentence that
    begins with whose they are."""
    if named != frame:
        return f"{frame} is taken as the frame of its pictures: they name {named}, which carries it"
    if _is_optical(frame) or not frame.endswith(_LINK):
        return None
    return (
        f"its pictures name {frame}, which is taken as the camera's optical frame, z forward; if it is a "
        "link, x forward (REP 103), the camera looks elsewhere: tell its optical frame in /tf_static, below "
        "it, or the pose of the camera itself as camera_pose= in --topics"
    )


def _is_optical(frame: str) -> bool:
    return _OPTICAL in frame.lower()
