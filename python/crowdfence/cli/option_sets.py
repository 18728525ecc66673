"""Options that several commands take, in sets that are stated once.

    @takes(MapOptions, SourceOptions, before="as_json")
    def command(context: typer.Context, as_json: options.Json = False) -> None:
        ... context.params["terrain"]

typer reads a command's options from its signature; `takes` writes the options of the sets into it. The
command finds their values in `context.params`, under the names that they have here.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, get_type_hints

from crowdfence.cli import options, source_options
from crowdfence.cli.options import DEFAULT, EVIDENCE, PAPER


class MapOptions:
    """Which map, and how it is read."""

    terrain: options.TerrainPath = None
    voxel_size_m: options.VoxelSizeM = None
    terrain_option: options.TerrainOption = None
    origin: options.Origin = None
    assume_local: options.AssumeLocal = False


class SourceOptions:
    """What a recording does not say about itself."""

    topics: source_options.Topics = None
    mount: source_options.Mount = None
    calibration: source_options.Calibration = None
    telemetry: source_options.Telemetry = None
    clock_offset_s: source_options.ClockOffset = None
    heights: source_options.Heights = None
    geoid_m: source_options.GeoidM = None
    take_off: source_options.TakeOff = None
    ground_start: source_options.GroundStart = False
    frames_per_s: source_options.FramesPerS = None
    boxes: source_options.Boxes = None
    pose_noise: source_options.PoseNoise = None
    max_jump_s: source_options.MaxJumpS = None


class FlightOptions:
    """What is known to have gone wrong on a flight."""

    alignment: source_options.AlignmentFile = None
    without: source_options.Without = None


class DetectorOptions:
    """What finds crowds in the pictures."""

    detector: options.DetectorChoice = options.AUTO
    contract: options.ContractPath = None
    enlarge: options.EnlargeOption = options.EnlargeChoice.always
    device: options.DeviceOption = options.DeviceChoice.cpu


class MaskOptions:
    """What of its pictures a drone hides by itself."""

    camera_masks: source_options.CameraMasks = None


class LookOptions:
    """How often a detector looks along a flight."""

    far_every_s: options.FarEveryS = 0.0


class LayerOptions:
    """Of which class the heatmaps are."""

    layer: options.LayerName = "crowd"


class MethodOptions:
    """How looks are put together."""

    method: options.Method = options.MethodName.evidence


class EvidenceOptions:
    """Parameters of the method `evidence`."""

    memory_s: options.MemoryS = EVIDENCE.memory_s
    sharp_gsd_m: options.SharpGsdM = EVIDENCE.sharp_gsd_m
    doubt: options.Doubt = EVIDENCE.doubt
    agreement: options.Agreement = EVIDENCE.agreement
    zone_log_odds: options.ZoneLogOdds = EVIDENCE.zone_log_odds
    clear_log_odds: options.ClearLogOdds = EVIDENCE.clear_log_odds
    prior: options.Prior = None


class PaperOptions:
    """Parameters of the methods `paper` and `or`."""

    alpha: options.Alpha = PAPER.alpha
    decay: options.Decay = PAPER.decay
    decay_unit: options.DecayUnitOption = options.DecayUnit.second
    unseen: options.UnseenOption = options.Unseen.fleet
    normalise: options.Normalise = False
    initial: options.InitialOption = options.Initial.zero
    true_positive_rate: options.TruePositiveRate = None
    false_positive_rate: options.FalsePositiveRate = None
    b_threshold: options.BThreshold = PAPER.b_threshold
    fleet_size: options.FleetSize = None


class ProjectionOptions:
    """How views become looks at the map, and which of them form one instant."""

    max_range_m: options.MaxRangeM = DEFAULT.projection.max_range_m
    target_height_m: options.TargetHeightM = None
    coverage: options.CoverageOption = options.Coverage.full
    surface: options.SurfaceOption = options.Surface.planes
    tolerance_ms: options.ToleranceMs = DEFAULT.grouping.tolerance_ms


class ZoneOptions:
    """What is closed."""

    threshold: options.Threshold = None
    off_threshold: options.OffThreshold = None
    opening_looks: options.OpeningLooks = DEFAULT.zones.opening_looks
    min_area_m2: options.MinAreaM2 = None
    max_hole_m2: options.MaxHoleM2 = DEFAULT.zones.max_hole_m2
    buffer: options.Buffer = None
    simplify_m: options.SimplifyM = DEFAULT.zones.simplify_m
    max_vertices: options.MaxVertices = None
    lower_m: options.LowerM = DEFAULT.zones.lower_m
    upper_m: options.UpperM = DEFAULT.zones.upper_m
    restriction: options.RestrictionOption = options.RestrictionName.prohibited
    close_unseen: options.CloseUnseen = False
    static_zones: options.StaticZones = None
    stale_after_s: options.StaleAfterS = DEFAULT.zones.stale_after_s


FUSION = (
    SourceOptions,
    FlightOptions,
    MaskOptions,
    DetectorOptions,
    LookOptions,
    MethodOptions,
    EvidenceOptions,
    PaperOptions,
    ProjectionOptions,
    ZoneOptions,
)
"""From a recording to zones; the map comes before."""

Command = Callable[..., None]
_KIND = inspect.Parameter.KEYWORD_ONLY
"""typer calls a command by names alone."""


def takes(*sets: type, before: str | None = None) -> Callable[[Command], Command]:
    """The command also takes the options of the sets; `before` names the parameter of its own that follows
    them, None: they come last."""

    def with_options(command: Command) -> Command:
        own = inspect.signature(command, eval_str=True).parameters
        place = list(own).index(before) if before else len(own)
        added = [parameter for one in sets for parameter in _parameters(one)]
        ours = [parameter.replace(kind=_KIND) for parameter in own.values()]
        parameters = [*ours[:place], *added, *ours[place:]]

        @functools.wraps(command)
        def run(**values: Any) -> None:
            command(**{name: value for name, value in values.items() if name in own})

        run.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        run.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
        return run

    return with_options


def _parameters(options_of: type) -> list[inspect.Parameter]:
    hints = get_type_hints(options_of, include_extras=True)
    return [
        inspect.Parameter(name, _KIND, default=getattr(options_of, name), annotation=hint)
        for name, hint in hints.items()
    ]


def map_options(chosen: dict[str, Any]) -> dict[str, Any]:
    """What `read_map` is told, from a command's parameters."""
    return options.terrain_options(
        chosen["voxel_size_m"],
        chosen["terrain_option"],
        origin=chosen["origin"],
        assume_local=chosen["assume_local"],
    )
