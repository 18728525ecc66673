"""What is said of a recording of which no frame can be used."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from crowdfence.sources.no_frame import no_frame_line
from crowdfence.sources.recording import RefusedFrame

EARLY = RefusedFrame("uav1", 9, "stamp 9 runs ahead")
NAN = [RefusedFrame("uav2", stamp, f"the detector failed: nan at [{stamp}, 0.5]") for stamp in (1, 2)]


@pytest.mark.parametrize(
    ("refused", "told"),
    [
        ([], "no frame of flight can be used"),
        ([EARLY], "; the first of 1 refusals: uav1 at 9: stamp 9 runs ahead"),
        ([EARLY, *NAN], "; 2 of 3 refusals: uav2 at 1: the detector failed: nan at [1, 0.5]"),
        ([*NAN, EARLY], "; the first of 3 refusals: uav2 at 1: the detector failed: nan at [1, 0.5]"),
    ],
)
def test_the_reason_of_most_refusals_is_told(refused: list[RefusedFrame], told: str) -> None:
    recording: Any = SimpleNamespace(name="flight", warnings=())
    assert no_frame_line(recording, refused).endswith(told)
