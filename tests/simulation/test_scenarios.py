import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from crowdfence.simulation.scenarios import scenario_file
from crowdfence.simulation.scenarios.scenario import CrowdPlan, Scenario, ScenarioError, TroublePlan
from crowdfence.simulation.scenarios.scenario_file import BUILT_IN, load_scenario
from crowdfence.simulation.scene import build_scene
from support.damaged_files import damaged, outcome


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_scenarios_are_complete(name: str) -> None:
    scenario = load_scenario(name)
    assert scenario.name == name
    assert scenario.description
    assert scenario.trouble != TroublePlan()
    assert (scenario.camera.width, scenario.camera.height) == (640, 480)


def test_race_is_the_mission_of_the_paper() -> None:
    race = load_scenario("race")
    assert race.drones == race.cyclists.count == 3
    assert race.frames >= 1056
    assert race.landscape.kind == "mountain_road"
    assert race.flight.pattern == "follow"
    assert len(race.crowds) >= 3
    assert all(crowd.motion == "march" and crowd.speed_m_s for crowd in race.crowds)


def test_empty_has_nobody_but_many_look_alikes() -> None:
    empty = load_scenario("empty")
    assert not empty.crowds and empty.walkers.count == empty.cyclists.count == 0
    things = empty.landscape
    assert min(things.bushes, things.posts, things.sculptures, things.barriers, things.animals) > 0


def test_overrides_change_what_they_name_and_nothing_else() -> None:
    plain = load_scenario("race")
    scenario = load_scenario("race", frames=90, camera={"width": 320, "height": 240}, season=None)
    assert scenario.frames == 90
    assert (scenario.camera.width, scenario.camera.height) == (320, 240)
    assert scenario.camera.hfov_deg == plain.camera.hfov_deg
    assert (scenario.season, scenario.crowds) == (plain.season, plain.crowds)
    assert load_scenario("race", trouble=TroublePlan()).trouble.dropped == 0.0


def test_duration_and_intrinsics_by_hand() -> None:
    race = load_scenario("race", frames=11, fps=4.0)
    assert race.duration_s == 2.5
    camera = race.intrinsics()
    assert camera.fx == camera.fy == pytest.approx(320 / math.tan(math.radians(40)))
    assert (camera.cx, camera.cy, camera.model) == (320, 240, "pinhole")
    bent = load_scenario("race", trouble={"lens_distortion": [-0.1, 0.02, 0.0, 0.0]}).intrinsics()
    assert bent.distortion[:2] == [-0.1, 0.02]


IMPOSSIBLE = [
    (dict(drones=0), "drones must be between 1 and 64, got 0"),
    (dict(drones=2.5), "drones must be int, got 2.5"),
    (dict(drones=True), "drones must be int, got True"),
    (dict(fps=0), "fps must be above 0"),
    (dict(fps=-1.0), "fps must be above 0"),
    (dict(fps=math.nan), "fps must be above 0"),
    (dict(fps=10**400), "fps must be a finite number, got 10"),
    (dict(drones=10**400), "drones must be a finite number, got 10"),
    (dict(frames=0), "frames must be between 1 and"),
    (dict(season="spring"), "season must be one of summer, autumn, winter, dry; got 'spring'"),
    (dict(time_of_day_h=25), "time_of_day_h must be between 0 and 24, got 25"),
    (dict(voxel_size_m=0), "voxel_size_m"),
    (dict(camera={"width": 102}), "camera.width must be a multiple of 4 from 16 to 4096 pixels, got 102"),
    (dict(camera={"height": 8192}), "camera.height must be a multiple of 4 from 16 to 4096 pixels, got 8192"),
    (dict(camera={"height": 0}), "camera.height"),
    (dict(camera={"hfov_deg": 180}), "camera.hfov_deg"),
    (dict(altitude=3), "unknown key altitude; known are"),
    (dict(flight={"altitud_m": 3}), "unknown key flight.altitud_m; known are altitude_m"),
    (dict(flight={"altitude_m": [40, 15]}), "flight.altitude_m must rise"),
    (dict(flight={"altitude_m": [40]}), "flight.altitude_m must have 2 values, got 1"),
    (dict(flight={"altitude_m": 40}), "flight.altitude_m must be a list, got 40"),
    (dict(flight={"tilt_deg": [20, 95]}), "flight.tilt_deg must be between 5 and 90, got 95"),
    (dict(flight={"pattern": "swarm"}), "flight.pattern must be one of follow, survey; got 'swarm'"),
    (dict(flight={"shared_view_s": [[5, 3]]}), "flight.shared_view_s must be spans"),
    (dict(cyclists={"count": 0}), 'flight.pattern "follow" needs cyclists.count of at least 1'),
    (dict(landscape={"road": False}), "cyclists.count 3 needs landscape.road"),
    (dict(landscape={"kind": "moon"}), "landscape.kind must be one of"),
    (dict(landscape={"trees": -1}), "landscape.trees"),
    (dict(landscape=4), "landscape must be a table, got 4"),
    (dict(crowds=[{"people": 50, "length_m": 3, "depth_m": 3}]), "crowds.people 50 at spacing_m 0.6 need"),
    (dict(crowds=[{"people": 5, "density": "thin"}]), "crowds.density must be one of even, core; got 'thin'"),
    (dict(landscape={"plants_from_road_m": -1}), "landscape.plants_from_road_m"),
    (dict(crowds=[{"people": 0}]), "crowds.people must be between 1"),
    (dict(crowds=[{"place": "road"}]), "crowds[0].people is missing"),
    (dict(crowds=[{"people": 5, "gather_s": 50, "disperse_s": 40}]), "crowds.gather_s, disperse_s"),
    (dict(walkers={"count": 70_000}), "walkers.count"),
    (dict(crowds=[{"people": 20_000, "length_m": 1000, "depth_m": 1000}] * 4), "instance ids allow 65535"),
    (dict(trouble={"dropped": 2}), "trouble.dropped must be between 0 and 0.9, got 2"),
    (dict(trouble={"lens_distortion": [0.1]}), "trouble.lens_distortion must be"),
    (dict(trouble={"joins_s": [[-1, 3.0]]}), "trouble.joins_s names drone -1"),
    (dict(crowd_definition={"radius_m": 0}), "crowd_definition.radius_m"),
    (dict(fps=1e-300, frames=2), "frames 2 at fps 1e-300 take 1e+300 s; at most 1e+09 s"),
    (
        dict(crowds=[{"people": 5, "along_m": math.nan}]),
        "crowds.along_m must be between -10000 and 10000, got nan",
    ),
    (dict(crowds=[{"people": 5, "x_m": 1e300}]), "crowds.x_m must be between -10000 and 10000, got 1e+300"),
    (
        dict(crowds=[{"people": 5, "heading_deg": math.inf}]),
        "crowds.heading_deg must be between -360 and 360",
    ),
    (
        dict(crowds=[{"people": 5, "place": "way", "way_m": [[0, 0], [1e9, 0]]}]),
        "crowds.way_m must be between -10000 and 10000, got 1e+09",
    ),
    (dict(crowds=[{"people": 5, "disperse_s": 1e300}]), "crowds.gather_s, disperse_s must be spans"),
    (dict(flight={"y_m": -math.inf}), "flight.y_m must be between -10000 and 10000, got -inf"),
    (
        dict(trouble={"lens_distortion": [math.nan, 0, 0, 0]}),
        "trouble.lens_distortion must be between -10 and 10, got nan",
    ),
    (dict(georeference={"latitude_deg": 95, "longitude_deg": 0, "height_m": 0}), "latitude_deg"),
]


@pytest.mark.parametrize(
    ("overrides", "message"), IMPOSSIBLE, ids=[message[:40] for _, message in IMPOSSIBLE]
)
def test_impossible_parameters_are_refused_by_name(overrides: dict[str, object], message: str) -> None:
    with pytest.raises(ScenarioError) as refusal:
        load_scenario("race", **overrides)
    assert message in str(refusal.value)
    assert "race.toml" not in str(refusal.value)  # which holds nothing wrong


def test_unknown_scenario_lists_the_known_ones() -> None:
    with pytest.raises(ScenarioError, match="unknown scenario 'rally': choose one of race, festival"):
        load_scenario("rally")


def test_own_file_and_its_mistakes(tmp_path: Path) -> None:
    path = tmp_path / "parade.toml"
    path.write_text('drones = 2\n[landscape]\nkind = "field"\n[[crowds]]\npeople = 12\nplace = "ground"\n')
    parade = load_scenario(path)
    assert (parade.name, parade.drones, parade.landscape.kind) == ("parade", 2, "field")
    assert parade.crowds == (CrowdPlan(people=12, place="ground"),)
    for content in ("drones = 2", "drones = [", "\x00\xff"):
        path.write_bytes(content.encode("latin-1"))
        with pytest.raises(ScenarioError, match=r"parade\.toml: (landscape is missing|not a TOML file)"):
            load_scenario(path)
    path.write_text("#" * 1_000_001)
    with pytest.raises(ScenarioError, match="1000001 bytes, a scenario has at most 1000000"):
        load_scenario(path)
    with pytest.raises(OSError):
        load_scenario(tmp_path / "missing.toml")


def test_seed_out_of_range_is_refused() -> None:
    for seed in (-1, 2**32):
        with pytest.raises(ScenarioError, match="seed must be between 0 and 4294967295"):
            build_scene(load_scenario("empty"), seed)


@given(frames=st.integers(1, 10_000_000), fps=st.floats(0.01, 240.0), drones=st.integers(1, 64))
def test_every_possible_length_makes_a_scenario(frames: int, fps: float, drones: int) -> None:
    ground = load_scenario("empty").landscape
    # The longest begin early enough to end before the last stamp that a recording can have.
    scenario = Scenario("x", "", ground, drones=drones, frames=frames, fps=fps, epoch_ns=10**12)
    assert len(set(scenario.drone_names)) == drones
    assert scenario.duration_s == pytest.approx((frames - 1) / fps)


def test_a_damaged_scenario_is_read_or_refused_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    intact = (Path(scenario_file.__file__).parent / "festival.toml").read_bytes()
    refused = 0
    for data in damaged(intact, 400):
        path.write_bytes(data)
        said = outcome(lambda: load_scenario(path))
        assert not said or said.startswith(str(path))
        refused += bool(said)
    assert refused > 100


@pytest.mark.parametrize(("kind", "number"), [("joins_s", 3), ("leaves_s", 7)])
def test_trouble_of_a_drone_that_is_not_there_is_refused(tmp_path: Path, kind: str, number: int) -> None:
    """Who counts drones from 1, as their names do, had a mission without the trouble."""
    path = tmp_path / "late.toml"
    path.write_text(f'drones = 3\n[landscape]\nkind = "field"\n[trouble]\n{kind} = [[{number}, 5.0]]\n')
    with pytest.raises(ScenarioError, match=rf"late.toml: trouble.{kind} names drone {number} of 3"):
        load_scenario(path)
    # A smaller fleet than that of the file has only a part of its trouble, a larger one all of it.
    assert load_scenario("festival", drones=2).drones == 2
    assert load_scenario(path, drones=number + 1).drones == number + 1


@pytest.mark.parametrize(
    ("epoch_s", "frames"), [(0, 10), (2**31, 10), (2**31 - 3600, 100_000), (1_767_225_600, 10_000_000)]
)
def test_missions_lie_where_stamps_of_recordings_do(epoch_s: int, frames: int) -> None:
    """They were begun, and ended in "pose of 'uav1': stamp -240000000 is outside"."""
    with pytest.raises(ScenarioError, match="epoch_ns"):
        load_scenario("empty", epoch_ns=epoch_s * 10**9, frames=frames, fps=0.02)
