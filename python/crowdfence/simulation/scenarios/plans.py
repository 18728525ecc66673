"""The parts of a scenario: what is where, who moves how, and what goes wrong. Data only."""

from __future__ import annotations

from dataclasses import dataclass

from crowdfence.simulation.scenarios.plan_checks import (
    ScenarioError,
    require_one_of,
    require_positive,
    require_range,
    require_windows,
    require_within,
)

LANDSCAPE_KINDS = ("mountain_road", "field", "street", "beach")
SIDES = ("left", "right", "middle")
MOTIONS = ("march", "stand", "gather")
DENSITIES = ("even", "core")
FLIGHT_PATTERNS = ("follow", "survey")
MAX_IMAGE_PX = 4096
IMAGE_MULTIPLE_PX = 4
"""A cell of the heatmaps that are recorded with the pictures."""
MIN_IMAGE_PX = 16
MAX_PEOPLE = 20_000
MAX_PROPS = 50_000
FURTHEST_M = 10_000.0
"""From the middle of a landscape, which is far smaller."""


@dataclass(frozen=True, slots=True)
class LandscapePlan:
    """Ground, road, buildings and the number of things that stand around.

    `relief_m` is the height difference between valley and ridges. Counts are for the whole landscape.
    Beside a mountain road bushes and rocks begin `plants_from_road_m` from its edge.
    """

    kind: str
    size_m: float = 1500.0
    relief_m: float = 0.0
    cell_m: float = 2.0
    road: bool = False
    buildings: int = 0
    trees: int = 0
    bushes: int = 0
    rocks: int = 0
    tents: int = 0
    cars: int = 0
    barriers: int = 0
    flags: int = 0
    posts: int = 0
    sculptures: int = 0
    animals: int = 0
    plants_from_road_m: float = 8.5

    def __post_init__(self) -> None:
        require_one_of("landscape.kind", self.kind, LANDSCAPE_KINDS)
        require_within("landscape.size_m", self.size_m, 100.0, 4000.0)
        require_within("landscape.relief_m", self.relief_m, 0.0, 1000.0)
        require_within("landscape.cell_m", self.cell_m, 0.5, 10.0)
        require_within("landscape.plants_from_road_m", self.plants_from_road_m, 0.0, 1000.0)
        for thing in (
            "buildings",
            "trees",
            "bushes",
            "rocks",
            "tents",
            "cars",
            "barriers",
            "flags",
            "posts",
            "sculptures",
            "animals",
        ):
            require_within(f"landscape.{thing}", getattr(self, thing), 0, MAX_PROPS)


@dataclass(frozen=True, slots=True)
class CrowdPlan:
    """One crowd: a band of people beside or on a line of the landscape.

    `place` names the line: "road", a place of the landscape such as "shore" or "street_1", "way" for the
    line through the points `way_m` (east, north; corners are rounded), or "ground" for the straight line
    through (`x_m`, `y_m`) in direction `heading_deg` (clockwise from north). The crowd is centred `along_m`
    metres along the line (from its start; on "ground" from the point), on one `side` of it, `offset_m` from
    the edge of the road or from the line, and fills `length_m` x `depth_m`.
    `spacing_m` is the least distance between two of its people when it is densest. `density`: "even" fills
    the whole band; "core" is densest in the middle and thins out like a normal distribution, of which
    `length_m` and `depth_m` are five standard deviations.

    `motion`: "march" moves along the line at `speed_m_s` and turns back smoothly after `reach_m`; "stand"
    only sways; "gather" starts `scatter` times as wide, is together from `gather_s` to `disperse_s` while
    it flows along the line, and then spreads out again.
    """

    people: int
    place: str = "road"
    along_m: float = 0.0
    side: str = "middle"
    offset_m: float = 0.8
    length_m: float = 20.0
    depth_m: float = 4.0
    spacing_m: float = 0.6
    density: str = "even"
    motion: str = "march"
    speed_m_s: float = 0.3
    reach_m: float = 45.0
    x_m: float = 0.0
    y_m: float = 0.0
    heading_deg: float = 0.0
    way_m: tuple[tuple[float, float], ...] = ()
    gather_s: float = 30.0
    disperse_s: float = 80.0
    scatter: float = 4.0

    def __post_init__(self) -> None:
        require_within("crowds.people", self.people, 1, MAX_PEOPLE)
        require_one_of("crowds.side", self.side, SIDES)
        require_one_of("crowds.motion", self.motion, MOTIONS)
        require_one_of("crowds.density", self.density, DENSITIES)
        require_within("crowds.offset_m", self.offset_m, 0.0, 200.0)
        require_positive("crowds.length_m", self.length_m, 1000.0)
        require_positive("crowds.depth_m", self.depth_m, 1000.0)
        require_within("crowds.spacing_m", self.spacing_m, 0.5, 20.0)
        require_within("crowds.speed_m_s", self.speed_m_s, -1.5, 1.5)
        require_positive("crowds.reach_m", self.reach_m, 1000.0)
        require_within("crowds.scatter", self.scatter, 1.0, 20.0)
        require_windows("crowds.gather_s, disperse_s", [(self.gather_s, self.disperse_s)])
        for name, place_m in (("along_m", self.along_m), ("x_m", self.x_m), ("y_m", self.y_m)):
            require_within(f"crowds.{name}", place_m, -FURTHEST_M, FURTHEST_M)
        for point_m in self.way_m:
            for place_m in point_m:
                require_within("crowds.way_m", place_m, -FURTHEST_M, FURTHEST_M)
        require_within("crowds.heading_deg", self.heading_deg, -360.0, 360.0)
        if (self.place == "way") != (len(self.way_m) >= 2):
            raise ScenarioError(
                f'crowds.way_m needs at least two points for place "way" and none for others, got '
                f"{len(self.way_m)} for {self.place!r}"
            )
        needed_m2 = self.people * self.spacing_m**2
        if needed_m2 > self.length_m * self.depth_m:
            raise ScenarioError(
                f"crowds.people {self.people} at spacing_m {self.spacing_m:g} need {needed_m2:.0f} m2, but "
                f"length_m x depth_m is {self.length_m:g} x {self.depth_m:g} m"
            )


@dataclass(frozen=True, slots=True)
class WalkerPlan:
    """Single people who walk round on their own, away from crowds and from each other."""

    count: int = 0
    speed_m_s: tuple[float, float] = (0.6, 1.5)

    def __post_init__(self) -> None:
        require_within("walkers.count", self.count, 0, MAX_PEOPLE)
        require_range("walkers.speed_m_s", self.speed_m_s, 0.1, 2.5)


@dataclass(frozen=True, slots=True)
class CyclistPlan:
    """Cyclists who ride along the road to its end, turn and ride back.

    The middle one starts at `start_m` and rides at `speed_m_s`. The others ride up to `gap_m` apart, except
    in the spans `together_s`, when they ride `close_gap_m` apart; each change takes `change_s`.
    """

    count: int = 0
    start_m: float = 160.0
    speed_m_s: float = 7.5
    gap_m: float = 100.0
    close_gap_m: float = 12.0
    together_s: tuple[tuple[float, float], ...] = ()
    change_s: float = 28.0

    def __post_init__(self) -> None:
        require_within("cyclists.count", self.count, 0, 100)
        require_within("cyclists.start_m", self.start_m, 0.0, 10_000.0)
        require_within("cyclists.speed_m_s", self.speed_m_s, 1.0, 20.0)
        require_within("cyclists.gap_m", self.gap_m, 2.0, 500.0)
        require_within("cyclists.close_gap_m", self.close_gap_m, 2.0, self.gap_m)
        require_windows("cyclists.together_s", self.together_s)
        require_positive("cyclists.change_s", self.change_s, 1000.0)


@dataclass(frozen=True, slots=True)
class FlightPlan:
    """How the drones fly and where their gimbals look.

    `pattern` "follow": drone i follows cyclist i from `distance_m` behind or beside; in the spans
    `shared_view_s` all gimbals turn to the place in the middle of the riders. "survey": each drone flies
    lines `line_spacing_m` apart over its strip of a square of side `area_m` around (`x_m`, `y_m`) in a band
    of heights of its own, and looks at a point inside the square. `altitude_m` counts from the highest
    ground or roof nearby, and drones stay 3 m above trees; `tilt_deg` of the optical axis below the horizon.
    """

    pattern: str = "survey"
    altitude_m: tuple[float, float] = (15.0, 60.0)
    tilt_deg: tuple[float, float] = (20.0, 60.0)
    speed_m_s: float = 6.0
    distance_m: tuple[float, float] = (14.0, 28.0)
    shared_view_s: tuple[tuple[float, float], ...] = ()
    area_m: float = 200.0
    line_spacing_m: float = 40.0
    x_m: float = 0.0
    y_m: float = 0.0

    def __post_init__(self) -> None:
        require_one_of("flight.pattern", self.pattern, FLIGHT_PATTERNS)
        require_range("flight.altitude_m", self.altitude_m, 5.0, 500.0)
        require_range("flight.tilt_deg", self.tilt_deg, 5.0, 90.0)
        require_within("flight.speed_m_s", self.speed_m_s, 0.5, 25.0)
        require_range("flight.distance_m", self.distance_m, 0.0, 500.0)
        require_windows("flight.shared_view_s", self.shared_view_s)
        require_within("flight.area_m", self.area_m, 20.0, 4000.0)
        require_within("flight.line_spacing_m", self.line_spacing_m, 10.0, 500.0)
        require_within("flight.x_m", self.x_m, -FURTHEST_M, FURTHEST_M)
        require_within("flight.y_m", self.y_m, -FURTHEST_M, FURTHEST_M)


@dataclass(frozen=True, slots=True)
class CameraPlan:
    """Image size in pixels (multiples of 4 from 16 to 4096) and horizontal field of view."""

    width: int = 640
    height: int = 480
    hfov_deg: float = 80.0

    def __post_init__(self) -> None:
        for name, pixels in (("width", self.width), ("height", self.height)):
            if not MIN_IMAGE_PX <= pixels <= MAX_IMAGE_PX or pixels % IMAGE_MULTIPLE_PX:
                raise ScenarioError(
                    f"camera.{name} must be a multiple of {IMAGE_MULTIPLE_PX} from {MIN_IMAGE_PX} to "
                    f"{MAX_IMAGE_PX} pixels, got {pixels}"
                )
        require_within("camera.hfov_deg", self.hfov_deg, 10.0, 150.0)


@dataclass(frozen=True, slots=True)
class CrowdDefinition:
    """A crowd is at least `min_people` people within `radius_m` of one of them: see `crowds_of`."""

    min_people: int = 3
    radius_m: float = 2.0

    def __post_init__(self) -> None:
        require_within("crowd_definition.min_people", self.min_people, 1, MAX_PEOPLE)
        require_positive("crowd_definition.radius_m", self.radius_m, 50.0)


@dataclass(frozen=True, slots=True)
class TroublePlan:
    """What goes wrong. 0 (or nothing) switches a trouble off; `TroublePlan()` is a perfect mission.

    Offsets and biases are drawn once per drone and noise and jitter anew per row, all normal with the given
    standard deviation; fractions are of the frames or of the telemetry rows. `trigger_spread_ms`: the
    drones' cameras expose up to so long after each other. `clock_offset_ms`: a drone's stamps, of images and
    telemetry alike, are off the true time. `clock_jitter_ms`: the stamp of an image is off its exposure.
    `late_ms` is how much longer a late frame takes to arrive. `joins_s` and `leaves_s` are pairs (drone
    number, time). `lens_distortion` is k1, k2, p1, p2[, k3] as in OpenCV, `rolling_exposure_ms` the time
    between the exposures of the first and the last image row.
    """

    trigger_spread_ms: float = 0.0
    clock_offset_ms: float = 0.0
    clock_jitter_ms: float = 0.0
    telemetry_hz: float = 50.0
    telemetry_loss: float = 0.0
    position_noise_m: float = 0.0
    position_bias_m: float = 0.0
    attitude_noise_deg: float = 0.0
    attitude_bias_deg: float = 0.0
    gimbal_noise_deg: float = 0.0
    gimbal_bias_deg: float = 0.0
    dropped: float = 0.0
    duplicated: float = 0.0
    late: float = 0.0
    late_ms: float = 200.0
    joins_s: tuple[tuple[int, float], ...] = ()
    leaves_s: tuple[tuple[int, float], ...] = ()
    lens_distortion: tuple[float, ...] = ()
    rolling_exposure_ms: float = 0.0

    def __post_init__(self) -> None:
        require_within("trouble.trigger_spread_ms", self.trigger_spread_ms, 0.0, 1000.0)
        require_within("trouble.clock_offset_ms", self.clock_offset_ms, 0.0, 10_000.0)
        require_within("trouble.clock_jitter_ms", self.clock_jitter_ms, 0.0, 1000.0)
        require_within("trouble.telemetry_hz", self.telemetry_hz, 1.0, 1000.0)
        for name in ("position_noise_m", "position_bias_m"):
            require_within(f"trouble.{name}", getattr(self, name), 0.0, 100.0)
        for name in ("attitude_noise_deg", "attitude_bias_deg", "gimbal_noise_deg", "gimbal_bias_deg"):
            require_within(f"trouble.{name}", getattr(self, name), 0.0, 45.0)
        for name in ("telemetry_loss", "dropped", "duplicated", "late"):
            require_within(f"trouble.{name}", getattr(self, name), 0.0, 0.9)
        require_positive("trouble.late_ms", self.late_ms, 60_000.0)
        require_within("trouble.rolling_exposure_ms", self.rolling_exposure_ms, 0.0, 1000.0)
        if len(self.lens_distortion) not in (0, 4, 5):
            raise ScenarioError(
                "trouble.lens_distortion must be [] or k1, k2, p1, p2[, k3], got "
                f"{len(self.lens_distortion)} numbers"
            )
        for coefficient in self.lens_distortion:
            require_within("trouble.lens_distortion", coefficient, -10.0, 10.0)
