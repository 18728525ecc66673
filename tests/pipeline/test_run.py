"""What `run` and `open_terrain` say to whoever gives them something else."""

from pathlib import Path

import numpy as np
import pytest

import crowdfence as cf
from support.small_recordings import flight, write_folder


def test_what_is_given_in_another_place_is_told_with_what_belongs_there(tmp_path: Path) -> None:
    folder = write_folder(tmp_path / "flight", flight())
    recording = cf.open_recording(folder)
    terrain = cf.Terrain.from_height_map(np.zeros((40, 40)), cell_size_m=1.0)
    for call, said in (
        (lambda: cf.open_terrain("dem.tif"), "'dem.tif' is no recording; `open_recording` makes one"),
        (lambda: cf.run(str(folder), terrain), "is no recording; `open_recording` makes one"),
        (lambda: cf.run(recording, "dem.tif"), "'dem.tif' is no Terrain; `open_terrain` makes one"),
        (lambda: cf.run(recording, terrain, cf.EvidenceConfig()), "a method goes into one: RunConfig("),
        (lambda: cf.run(recording, terrain, detector="crowdnet-s"), "it is Detector('crowdnet-s')"),
        (
            lambda: cf.RunConfig("paper"),
            "method of a RunConfig is 'paper'; it must be such as EvidenceConfig()",
        ),
        (lambda: cf.RunConfig(zones=30.0), "zones of a RunConfig is 30.0; it must be such as ZoneConfig()"),
    ):
        with pytest.raises(TypeError) as refused:
            call()
        assert said in str(refused.value)
