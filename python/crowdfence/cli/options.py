"""Options that several commands share, and how they become a configuration."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import fields
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from crowdfence.config import (
    EvidenceConfig,
    GroupingConfig,
    LinearPoolConfig,
    LogOddsConfig,
    LogPoolConfig,
    MethodConfig,
    MovingAverageConfig,
    OrConfig,
    PaperConfig,
    ProjectionConfig,
    RunConfig,
    ZoneConfig,
)

if TYPE_CHECKING:
    from crowdfence.georeference import Georeference

DEFAULT = RunConfig()
EVIDENCE = EvidenceConfig()
PAPER = PaperConfig()
OR = OrConfig()
PartT = TypeVar(
    "PartT",
    EvidenceConfig,
    PaperConfig,
    OrConfig,
    LinearPoolConfig,
    LogPoolConfig,
    LogOddsConfig,
    MovingAverageConfig,
    ProjectionConfig,
    GroupingConfig,
    ZoneConfig,
)
_METHOD, _EVIDENCE, _PAPER = "Method", "Method evidence", "Methods paper, or and those for comparison"
_MAP, _ZONES = "Projection and map", "Zones"
PANELS = (_ZONES, _MAP, _METHOD, _EVIDENCE, _PAPER)
"""Of these options, in the order of their use."""


class MethodName(str, Enum):
    """Fusion methods."""

    evidence = "evidence"
    or_ = "or"
    paper = "paper"
    linear_pool = "linear-pool"
    log_pool = "log-pool"
    log_odds = "log-odds"
    moving_average = "moving-average"


class Unseen(str, Enum):
    fleet = "fleet"
    visible = "visible"


class Initial(str, Enum):
    zero = "zero"
    prior = "prior"
    first = "first"


class DecayUnit(str, Enum):
    second = "second"
    frame = "frame"


class Coverage(str, Enum):
    rays = "rays"
    full = "full"


class Surface(str, Enum):
    planes = "planes"
    voxels = "voxels"


class RestrictionName(str, Enum):
    """What a zone forbids."""

    prohibited = "prohibited"
    no_sustained_flight = "no_sustained_flight"


class TruthChoice(str, Enum):
    projected = "projected"
    world = "world"


class LabelTarget(str, Enum):
    """What a detector's heatmap marks."""

    ground = "ground"
    silhouettes = "silhouettes"


class EnlargeChoice(str, Enum):
    """Whether far ground is enlarged for the detector."""

    never = "never"
    affordable = "affordable"
    always = "always"


class DeviceChoice(str, Enum):
    """Where a model computes."""

    cpu = "cpu"
    cuda = "cuda"


AUTO = ["auto"]

RecordingPaths = Annotated[
    list[Path],
    typer.Argument(
        help="Mission file (.mcap), ROS bag, film with its log, AirSim recording, folder with poses.csv: see "
        "docs/recordings.md. Several are one fleet."
    ),
]
TerrainPath = Annotated[
    Path | None,
    typer.Option(
        "--terrain", "-t", help="Map: .bt .ot .tif .las .laz .ply .obj. Default: the recording's own."
    ),
]
VoxelSizeM = Annotated[
    float | None,
    typer.Option(
        "--voxel-size-m",
        help="Size of the map's cells, in metres. Default: as fine as people, where the file allows it.",
    ),
]
TerrainOption = Annotated[
    list[str] | None,
    typer.Option(
        "--terrain-option",
        metavar="NAME=VALUE",
        help="How to read the map: crs=EPSG:32632, height_offset_m=5, surface=ground, max_hole_m2=0, up=y; "
        "may be repeated.",
    ),
]
Origin = Annotated[
    str | None,
    typer.Option(
        "--origin",
        metavar="LAT,LON,HEIGHT",
        help="Where on Earth the recording's (0, 0, 0) lies, if it does not say so: degrees (WGS84), metres "
        "above the ellipsoid.",
    ),
]
AssumeLocal = Annotated[
    bool,
    typer.Option(
        "--assume-local",
        help="The recording's coordinates are the map's own: (0, 0, 0) is the middle of a georeferenced map "
        "at its lowest height in whole metres; a map without reference system holds local metres.",
    ),
]
DetectorChoice = Annotated[
    list[str],
    typer.Option(
        "--detector",
        metavar="MODEL",
        help="What finds crowds in the pictures: auto (of crowdnet-s and crowdnet-s-wide the one that suits "
        "them, for live views crowdnet-s; without pictures as recorded), recorded, or a MODEL.onnx. Repeat "
        "it to combine several, such as crowdnet-s and yolox_nano.onnx.",
    ),
]
LayerName = Annotated[
    str,
    typer.Option(
        "--layer",
        metavar="NAME",
        help="Which heatmaps of the recording: crowd, or another class that it holds, such as landing-site, "
        "on a map of its own. Nothing is closed by it.",
    ),
]
EnlargeOption = Annotated[
    EnlargeChoice,
    typer.Option(
        "--enlarge",
        help="Whether the model sees ground that is too far for it enlarged: finds more, costs up to 4 x; "
        "affordable: no more than a 640 x 480 picture costs, or the picture itself.",
    ),
]
DeviceOption = Annotated[
    DeviceChoice,
    typer.Option(
        "--device",
        help="Where the model computes; cuda: on a GPU of NVIDIA, with the package onnxruntime-gpu in the "
        "place of onnxruntime.",
    ),
]
FarEveryS = Annotated[
    float,
    typer.Option(
        "--far-every",
        metavar="SECONDS",
        help="Ground that is too far for the model is looked at once in so many seconds of a drone, and left "
        "out of its looks in between, as if out of view; 0: in every picture. For machines that do not keep "
        "up: 0.25 saves a quarter of the work and more, and finds fewer of the people there.",
    ),
]
ContractPath = Annotated[
    Path | None,
    typer.Option("--contract", help="What the model expects and means (JSON). Default: beside or inside it."),
]
EveryFrame = Annotated[
    int, typer.Option("--every", help="Look at every n-th frame of each drone only.", min=1)
]
Force = Annotated[bool, typer.Option("--force", help="Replace what is there.")]
Files = Annotated[
    list[str] | None,
    typer.Option(
        "--files",
        metavar="NAME,...",
        help="Files to write, such as report.html,frames.csv; may be repeated. Zones, their history and the "
        "summary are always written. Default: all.",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print JSON instead of text.")]

Method = Annotated[
    MethodName,
    typer.Option(
        "--method",
        "-m",
        rich_help_panel=_METHOD,
        help="How looks are put together; all but evidence are for research.",
    ),
]
MemoryS = Annotated[
    float,
    typer.Option(
        "--memory-s",
        rich_help_panel=_EVIDENCE,
        help="How long a look counts, in seconds: after so long it weighs 1 / e. Also of moving-average.",
    ),
]
SharpGsdM = Annotated[
    float,
    typer.Option(
        "--sharp-gsd-m",
        rich_help_panel=_EVIDENCE,
        help="Metres per pixel up to which a look weighs fully, > 0.",
    ),
]
Doubt = Annotated[
    float,
    typer.Option(
        "--doubt", rich_help_panel=_EVIDENCE, help="Sharp looks that the prior stands against, > 0."
    ),
]
Agreement = Annotated[
    float,
    typer.Option(
        "--agreement",
        rich_help_panel=_EVIDENCE,
        help="What further drones add: 0 they only average, 1 they add up.",
    ),
]
ZoneLogOdds = Annotated[
    float,
    typer.Option(
        "--zone-log-odds",
        rich_help_panel=_EVIDENCE,
        help="Crowd from this far above the prior, at most 12, unless --threshold.",
    ),
]
ClearLogOdds = Annotated[
    float,
    typer.Option(
        "--clear-log-odds", rich_help_panel=_EVIDENCE, help="Empty from this far below the prior, in (0, 12]."
    ),
]
Alpha = Annotated[
    float, typer.Option("--alpha", rich_help_panel=_PAPER, help="Weight of the newest instant, in (0, 1].")
]
Decay = Annotated[
    float,
    typer.Option("--decay", rich_help_panel=_PAPER, help="lambda of equation 3 per --decay-unit, >= 0."),
]
DecayUnitOption = Annotated[
    DecayUnit, typer.Option("--decay-unit", rich_help_panel=_PAPER, help="Unit of lambda.")
]
UnseenOption = Annotated[
    Unseen,
    typer.Option(
        "--unseen",
        rich_help_panel=_PAPER,
        help="Who votes: the whole fleet, or the drones that see a voxel.",
    ),
]
Normalise = Annotated[
    bool, typer.Option("--normalise", rich_help_panel=_PAPER, help="Divide the weights by their sum.")
]
InitialOption = Annotated[
    Initial, typer.Option("--initial", rich_help_panel=_PAPER, help="Belief before the first look.")
]
TruePositiveRate = Annotated[
    float | None,
    typer.Option(
        "--tpr", rich_help_panel=_PAPER, help="P(B = 1 | A = 1). Default: the detector's own, else 0.9."
    ),
]
FalsePositiveRate = Annotated[
    float | None,
    typer.Option(
        "--fpr", rich_help_panel=_PAPER, help="P(B = 1 | A = 0). Default: the detector's own, else 0.02."
    ),
]
Prior = Annotated[
    float | None,
    typer.Option(
        "--prior",
        rich_help_panel=_METHOD,
        help="How likely crowd is before anybody looked, P(A = 1). Default: by evidence, the detector's own; "
        "by paper, the share of the map fit for landing, or 0.5; by log-odds, 0.5.",
    ),
]
BThreshold = Annotated[
    float,
    typer.Option(
        "--b-threshold",
        rich_help_panel=_PAPER,
        help="Mean heatmap value above which a view calls a voxel crowd.",
    ),
]
FleetSize = Annotated[
    int | None,
    typer.Option("--fleet-size", rich_help_panel=_PAPER, help="N. Default: the recording's drones."),
]
MaxRangeM = Annotated[
    float, typer.Option("--max-range-m", rich_help_panel=_MAP, help="Rays end at this distance.")
]
TargetHeightM = Annotated[
    float | None,
    typer.Option(
        "--target-height-m",
        rich_help_panel=_MAP,
        help="Height above ground at which people are marked. Default: the detector's own, else 0.",
    ),
]
CoverageOption = Annotated[
    Coverage,
    typer.Option(
        "--coverage",
        rich_help_panel=_MAP,
        help="full: all ground in view; rays: what the rays of pixels hit (the paper).",
    ),
]
SurfaceOption = Annotated[
    Surface,
    typer.Option(
        "--surface",
        rich_help_panel=_MAP,
        help="What rays meet: planes, the surface in the voxels; voxels, these as cubes (the paper).",
    ),
]
ToleranceMs = Annotated[
    float, typer.Option("--tolerance-ms", rich_help_panel=_MAP, help="Frames this close form one instant.")
]
Threshold = Annotated[
    float | None,
    typer.Option(
        "--threshold",
        rich_help_panel=_ZONES,
        help="Lowest probability that is crowd. Default: the method's.",
    ),
]
MinAreaM2 = Annotated[
    float | None,
    typer.Option(
        "--min-area-m2",
        rich_help_panel=_ZONES,
        help="Drop smaller zones (they are counted); one that is there ends below half of it. Default: 3, "
        "and 0 with --coverage rays.",
    ),
]
OffThreshold = Annotated[
    float | None,
    typer.Option(
        "--off-threshold",
        rich_help_panel=_ZONES,
        help="Ground leaves its zone below this probability. Default: the threshold.",
    ),
]
OpeningLooks = Annotated[
    int,
    typer.Option(
        "--opening-looks",
        rich_help_panel=_ZONES,
        help="Looks in a row that must find ground below the threshold before it opens.",
    ),
]
MaxHoleM2 = Annotated[
    float,
    typer.Option(
        "--max-hole-m2",
        rich_help_panel=_ZONES,
        help="Close ground that crowd encloses, up to this; inf: all.",
    ),
]
Buffer = Annotated[
    list[str] | None,
    typer.Option(
        "--buffer",
        metavar="RULE:NAME=VALUE,...",
        rich_help_panel=_ZONES,
        help="Distance around crowd: fixed:distance_m=30, one-to-one:height_m=60, "
        "glide:height_m=60,ratio=12, ballistic, parachute, eu-a2, sts-01, contingency, map, pose, motion. "
        "May be repeated: the distances are added.",
    ),
]
SimplifyM = Annotated[
    float,
    typer.Option(
        "--simplify-m",
        rich_help_panel=_ZONES,
        help="Fewer corners, at most so far outside the exact outline.",
    ),
]
MaxVertices = Annotated[
    int | None,
    typer.Option(
        "--max-vertices",
        rich_help_panel=_ZONES,
        help="Most corners of a zone; it grows as far as that takes.",
    ),
]
LowerM = Annotated[
    float, typer.Option("--lower-m", rich_help_panel=_ZONES, help="Zones begin here, metres above ground.")
]
UpperM = Annotated[
    float, typer.Option("--upper-m", rich_help_panel=_ZONES, help="Zones end here, metres above ground.")
]
RestrictionOption = Annotated[
    RestrictionName,
    typer.Option("--restriction", rich_help_panel=_ZONES, help="No flight, or none that stays above."),
]
CloseUnseen = Annotated[
    bool,
    typer.Option(
        "--close-unseen",
        rich_help_panel=_ZONES,
        help="Close ground that is not known to be empty: never seen, hidden, stale, or looked at and not "
        "cleared.",
    ),
]
StaticZones = Annotated[
    list[Path] | None,
    typer.Option(
        "--static-zones",
        rich_help_panel=_ZONES,
        help="Zones of others that stay closed: ED-318, ED-269, GeoJSON or KML; may be repeated.",
    ),
]
StaleAfterS = Annotated[
    float, typer.Option("--stale-after-s", rich_help_panel=_MAP, help="Older empty ground counts as stale.")
]


def recordings_in(places: list[Path]) -> list[Path]:
    """The recordings named, and the missions in folders that are no recording themselves; annotated pictures
    beside missions are one more."""
    from crowdfence.labelled_pictures.picture_recording import is_labelled_pictures

    paths: list[Path] = []
    for place in places:
        missions = sorted(place.glob("*.mcap")) if place.is_dir() else []
        paths += missions
        if not missions or is_labelled_pictures(place):
            paths.append(place)
    return paths


def run_config(parameters: Mapping[str, Any], method: MethodConfig) -> RunConfig:
    """The configuration from a command's parameters (`context.params`), which are named after the fields of
    its parts, around a method."""
    return RunConfig(
        method,
        part(ProjectionConfig, parameters),
        part(GroupingConfig, parameters),
        part(ZoneConfig, parameters),
    )


def zone_parameters(parameters: Mapping[str, Any]) -> dict[str, Any]:
    """A command's parameters with the safety distance of its --buffer rules. ValueError for a rule that
    cannot be computed."""
    from crowdfence.zones import safety_distance_m

    return {**parameters, "buffer_m": safety_distance_m(parameters["buffer"] or [])}


def method_config(parameters: Mapping[str, Any], name: MethodName) -> MethodConfig:
    """A method from a command's parameters."""
    match name:
        case MethodName.evidence:
            return part(EvidenceConfig, parameters)
        case MethodName.paper:
            return part(PaperConfig, parameters)
        case MethodName.or_:
            return part(OrConfig, parameters)
        case MethodName.linear_pool:
            return part(LinearPoolConfig, parameters)
        case MethodName.log_pool:
            return part(LogPoolConfig, parameters)
        case MethodName.log_odds:
            return part(LogOddsConfig, parameters)
        case MethodName.moving_average:
            return part(MovingAverageConfig, parameters)


def part(kind: type[PartT], parameters: Mapping[str, Any], **chosen: Any) -> PartT:
    """One part of the configuration; `chosen` are fields that the command decides itself."""
    names = (field.name for field in fields(kind))
    given = {name: parameters[name] for name in names if name in parameters}
    values = {name: value.value if isinstance(value, Enum) else value for name, value in given.items()}
    return kind(**{**values, **chosen})


def terrain_options(
    voxel_size_m: float | None = None,
    pairs: list[str] | None = None,
    *,
    origin: str | None = None,
    assume_local: bool = False,
) -> dict[str, Any]:
    """What `pipeline.open_terrain` and the map readers are told, as far as it was given. Values of pairs that
    read as JSON are numbers, booleans or lists, others are text.

    ValueError for a pair without "=", what is said twice, and an origin that is no place on Earth.
    """
    options: dict[str, Any] = {} if voxel_size_m is None else {"voxel_size_m": voxel_size_m}
    if origin is not None:
        options["georeference"] = _georeference(origin)
    if assume_local:
        options["assume_local"] = True
    for pair in pairs or []:
        name, equals, value = pair.partition("=")
        if not (name and equals):
            raise ValueError(f"--terrain-option {pair!r} must be NAME=VALUE")
        if name in options:
            raise ValueError(f"the map is told {name} twice; say it once")
        try:
            options[name] = json.loads(value)
        except json.JSONDecodeError:
            options[name] = value
    return options


def _georeference(origin: str) -> Georeference:
    from crowdfence.georeference import Georeference

    try:
        latitude_deg, longitude_deg, height_m = map(float, origin.split(","))
    except ValueError:
        raise ValueError(f"--origin {origin!r} must be LAT,LON,HEIGHT, such as 46.5,8.0,1200") from None
    return Georeference(latitude_deg, longitude_deg, height_m)
