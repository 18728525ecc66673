"""Which frames of labelled missions a measurement looks at."""

import shutil
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from crowdfence import Terrain, _core, open_recording
from crowdfence.evaluation.labelled_missions import (
    LabelledMission,
    LabelledMissions,
    MeasurementPlan,
    frames_looked_at,
    open_labelled,
)
from crowdfence.labelled_pictures.annotated_picture import AnnotatedPicture, rectangle
from crowdfence.labelled_pictures.coco import ANNOTATIONS, write_coco
from crowdfence.sources.convert import convert
from support.foreign_recordings import write_photographs
from support.small_recordings import flight, ground, write_airsim, write_hovering

S = 10**9


def test_every_third_frame_is_one_of_every_drone(tmp_path: Path) -> None:
    """Three drones expose together, four times: every third of all frames would be the first drone's."""
    stamps_ns = [(1000 + number) * S for number in range(4)]
    folder = write_hovering(tmp_path / "m", dict.fromkeys(("uav1", "uav2", "uav3"), stamps_ns))
    missions = LabelledMissions([folder], MeasurementPlan(every=3), lambda: None)
    recording = open_recording(folder)
    mission = LabelledMission("m", recording, None, lambda _: None, None)
    seen: list[tuple[str, int]] = []
    used = missions.over_frames(mission, lambda frame: seen.append((frame.drone, frame.stamp_ns // S)))
    # The first frame and the fourth of each.
    assert Counter(seen) == Counter({(drone, at): 1 for drone in recording.drones for at in (1000, 1003)})
    assert used == frames_looked_at([folder], 3) == 6


def test_pictures_without_annotations_are_told_what_they_lack(tmp_path: Path) -> None:
    Image.new("RGB", (64, 48)).save(tmp_path / "a.jpg")
    (tmp_path / "annotation.json").write_text("{}")
    message = "a.jpg does not say when it was taken; nor does the folder hold annotations.json in COCO form"
    missions = LabelledMissions([tmp_path], MeasurementPlan(), lambda: None)
    for opened in (lambda: open_labelled(tmp_path), lambda: next(missions.opened(with_maps=False))):
        with pytest.raises(ValueError, match=message):
            opened()


@pytest.mark.parametrize("kind", ["png", "geotagged", "hovering"])
def test_what_is_not_labelled_is_told_what_it_lacks(tmp_path: Path, kind: str) -> None:
    """PNG pictures are no recording, geotagged photographs one without labels."""
    folder, told = tmp_path / "data", "data is not labelled: it does not record where people stand"
    forgotten = "nor does the folder hold annotations.json in COCO form"
    if kind == "png":
        folder.mkdir()
        Image.new("RGB", (64, 48)).save(folder / "a.png")
        told = "data holds no recording"
    elif kind == "geotagged":
        write_photographs(folder)
    else:
        write_hovering(folder, {"uav1": [1000 * S]})
    missions = LabelledMissions([folder], MeasurementPlan(target="ground"), lambda: None)
    with pytest.raises(ValueError, match=told) as refused:
        next(missions.opened(with_maps=False))
    assert str(refused.value).endswith(forgotten) == (kind != "hovering")


def test_people_beside_the_map_of_a_mission_are_told(tmp_path: Path) -> None:
    """Its rates would count all ground as empty."""
    folder = write_airsim(tmp_path / "mission", flight())
    (folder / "terrain" / "dem.tif").unlink()
    terrain = Terrain.from_points(ground(), 2.0)
    bt = _core.write_octomap_binary(terrain, np.arange(terrain.voxel_count))
    (folder / "terrain" / "terrain.bt").write_bytes(bt)
    stamp_ns = open_recording(folder).frames[0].stamp_ns
    rows = [f"{stamp_ns},{person},{100 * person},900000,0,0" for person in range(1, 5)]  # centimetres
    (folder / "truth" / "world.csv").write_text("\n".join(["stamp_ns,person,x,y,z,crowd", *rows]) + "\n")
    missions = LabelledMissions([folder], MeasurementPlan(), lambda: None)
    list(missions.opened(with_maps=True))
    assert [one for one in missions.doubts if "mission: everybody recorded in mission stands beside" in one]


def test_a_picture_that_is_in_two_folders_is_refused(tmp_path: Path) -> None:
    """The second of three is the third of four, under another name; first, middle and last ones differ."""
    for name, levels in (("all", (10, 20, 30)), ("some", (40, 50, 20, 60)), ("more", (70,))):
        (tmp_path / name).mkdir()
        marked = []
        for number, level in enumerate(levels):
            path = tmp_path / name / f"{name}-{number}.png"
            Image.new("RGB", (64, 48), (level, 0, 0)).save(path)
            marked.append(AnnotatedPicture(path, 64, 48, np.empty((0, 4)), (rectangle(0, 0, 9, 9),)))
        write_coco(marked, tmp_path / name / ANNOTATIONS)
    missions = LabelledMissions([tmp_path / "all", tmp_path / "some"], MeasurementPlan(), lambda: None)
    with pytest.raises(ValueError, match=r"some holds a picture of all, some-2\.png: it would count double"):
        list(missions.opened(with_maps=False))
    apart = LabelledMissions([tmp_path / "all", tmp_path / "more"], MeasurementPlan(), lambda: None)
    for _ in range(2):  # every pass opens them anew
        assert [one.name for one in apart.opened(with_maps=False)] == ["all", "more"]


@pytest.mark.parametrize("how", ["copied", "converted"])
def test_a_mission_that_is_there_twice_is_refused(tmp_path: Path, how: str) -> None:
    """A correction was judged on the very pictures that it was fitted on, and its interval had no width."""
    folder = write_airsim(tmp_path / "mission", flight(frames=4))
    (folder / "terrain" / "dem.tif").unlink()
    if how == "copied":
        other = Path(shutil.copytree(folder, tmp_path / "backup"))
    else:
        other = tmp_path / "backup.mcap"
        convert(open_recording(folder), other)
    missions = LabelledMissions([folder, other], MeasurementPlan(), lambda: None)
    with pytest.raises(ValueError, match="backup holds the pictures of mission: they would count double"):
        list(missions.opened(with_maps=False))
    alone = LabelledMissions([folder], MeasurementPlan(), lambda: None)
    for _ in range(2):  # every pass opens it anew
        assert [one.name for one in alone.opened(with_maps=False)] == ["mission"]
