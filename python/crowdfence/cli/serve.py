"""`crowdfence serve`: the live service, or the replay of a recording, with its map page."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from crowdfence.cli import console, options, source_options
from crowdfence.cli.detector_choice import chosen_detector
from crowdfence.cli.option_sets import FUSION, MapOptions, map_options, takes
from crowdfence.cli.refusals import refusal_lines
from crowdfence.cli.unused_options import refuse_options_of_other_methods, refuse_unused
from crowdfence.cli.wording import in_options
from crowdfence.config import RunConfig

if TYPE_CHECKING:
    from crowdfence._core import Terrain
    from crowdfence.service.access import Access
    from crowdfence.service.inputs import Inputs
    from crowdfence.service.ros.link import RosLink
    from crowdfence.service.service import Service
    from crowdfence.service.settings import ServiceSettings
    from crowdfence.sources.pose_noise import GivenNoise

_SERVER, _LIVE = "Server", "Live views"
_OF_ZENOH = ("zenoh_config", "zenoh_keys", "ros_domain", "bridge_namespace")
_OF_LIVE_VIEWS = ("data", "name", "drone", "clock", "mavlink", "mavlink_key", "zenoh", *_OF_ZENOH)
_OF_MODELS = ("contract", "enlarge", "device", "far_every_s")
TokenFile = Annotated[
    Path | None,
    typer.Option("--tokens", rich_help_panel=_SERVER, help="File that `crowdfence token add` made."),
]


class KeyChoice(str, Enum):
    """How a fleet of ROS names its topics on Zenoh."""

    rmw = "rmw"
    bridge = "bridge"


class ClockName(str, Enum):
    """What live views are compared with."""

    system = "system"
    views = "views"


@takes(MapOptions, before="host")
@takes(*FUSION, before="as_json")
def serve(
    context: typer.Context,
    recording: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Recording to replay; several are one fleet. Left out: live views, on the map of --terrain."
        ),
    ] = None,
    host: Annotated[
        str, typer.Option("--host", rich_help_panel=_SERVER, help="Address to listen on.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option("--port", rich_help_panel=_SERVER, min=0, max=65535, help="0: any that is free.")
    ] = 8080,
    tokens: TokenFile = None,
    tls_certificate: Annotated[
        Path | None, typer.Option("--tls-certificate", rich_help_panel=_SERVER, help="PEM file, for HTTPS.")
    ] = None,
    tls_key: Annotated[
        Path | None, typer.Option("--tls-key", rich_help_panel=_SERVER, help="PEM file of its key.")
    ] = None,
    json_logs: Annotated[
        bool, typer.Option("--json-logs", rich_help_panel=_SERVER, help="Log lines on stderr are JSON.")
    ] = False,
    base_map: Annotated[
        Path | None,
        typer.Option(
            "--base-map", rich_help_panel=_SERVER, help="Map of the surroundings: a PMTiles or GeoTIFF file."
        ),
    ] = None,
    replay_speed: Annotated[
        float, typer.Option("--replay-speed", help="Recorded seconds per second; inf: as fast as it goes.")
    ] = 1.0,
    data: Annotated[
        Path,
        typer.Option("--data", rich_help_panel=_LIVE, help="Folder of the journal; goes on where it ended."),
    ] = Path("out/live"),
    name: Annotated[str, typer.Option("--name", rich_help_panel=_LIVE, help="Name of the mission.")] = "live",
    drone: Annotated[
        list[str] | None,
        typer.Option("--drone", rich_help_panel=_LIVE, help="A drone that is expected; may be repeated."),
    ] = None,
    clock: Annotated[
        ClockName,
        typer.Option(
            "--clock", rich_help_panel=_LIVE, help="What stamps are compared with; views: for simulations."
        ),
    ] = ClockName.system,
    max_delay_ms: Annotated[
        float, typer.Option("--max-delay-ms", rich_help_panel=_LIVE, help="A view that comes later is late.")
    ] = 500.0,
    silent_after_s: Annotated[
        float, typer.Option("--silent-after-s", rich_help_panel=_LIVE, help="Silence that is an alarm.")
    ] = 5.0,
    mavlink: Annotated[
        list[str] | None,
        typer.Option(
            "--mavlink",
            metavar="DRONE=udp:ADDRESS:PORT[:SYSTEM]",
            rich_help_panel=_LIVE,
            help="Telemetry that tells the poses of a drone whose views come without; may be repeated. "
            "--mount, --heights, --geoid-m and --take-off say what it leaves open.",
        ),
    ] = None,
    mavlink_key: Annotated[
        Path | None,
        typer.Option(
            "--mavlink-key",
            rich_help_panel=_LIVE,
            help="File with the pass phrase of signed telemetry; needed on addresses of other machines.",
        ),
    ] = None,
    zenoh: Annotated[
        str | None,
        typer.Option(
            "--zenoh",
            metavar="ENDPOINT",
            rich_help_panel=_LIVE,
            help="Zenoh router of a ROS 2 fleet, such as tcp/127.0.0.1:7447: zones and maps go there, and "
            "what --topics names comes from there.",
        ),
    ] = None,
    zenoh_config: Annotated[
        Path | None,
        typer.Option(
            "--zenoh-config", rich_help_panel=_LIVE, help="Zenoh's own configuration, for TLS and the like."
        ),
    ] = None,
    zenoh_keys: Annotated[
        KeyChoice,
        typer.Option(
            "--zenoh-keys",
            rich_help_panel=_LIVE,
            help="rmw: the fleet runs rmw_zenoh; bridge: zenoh-bridge-ros2dds carries its topics.",
        ),
    ] = KeyChoice.rmw,
    ros_domain: Annotated[
        int, typer.Option("--ros-domain", rich_help_panel=_LIVE, help="ROS_DOMAIN_ID of the fleet, for rmw.")
    ] = 0,
    bridge_namespace: Annotated[
        str, typer.Option("--bridge-namespace", rich_help_panel=_LIVE, help="That of the bridge.")
    ] = "",
    keep_h: Annotated[
        float,
        typer.Option(
            "--keep-h",
            min=0.01,
            max=87_600.0,
            rich_help_panel=_LIVE,
            help="Hours that history and pictures are kept.",
        ),
    ] = 24.0,
    as_json: options.Json = False,
) -> None:
    """Serve the map page, the zones and the crowd map, of live views or of a recording that is replayed."""
    chosen = context.params
    config = options.run_config(
        options.zone_parameters(chosen), options.method_config(chosen, chosen["method"])
    )
    refuse_options_of_other_methods(context, [config.method])
    if recording:
        refuse_unused(context, _OF_LIVE_VIEWS, "for a recording that is replayed")
    else:
        refuse_unused(context, ["replay_speed"], "for live views")
        if not _models(context.params):
            refuse_unused(context, _OF_MODELS, "for live views without --detector")
    if not mavlink:
        refuse_unused(context, ["mavlink_key"], "without --mavlink")
    if zenoh is None:
        refuse_unused(context, _OF_ZENOH, "without --zenoh")
    from crowdfence.service.access import Access
    from crowdfence.service.base_map import BaseMap
    from crowdfence.service.logs import logs_on_stderr
    from crowdfence.service.server import Address
    from crowdfence.service.server import serve as serve_on
    from crowdfence.service.settings import ServiceSettings

    address = Address(host, port, tls_certificate, tls_key)
    address.check(has_tokens=tokens is not None)
    access = Access.of(tokens)
    settings = ServiceSettings(
        clock=clock.value,
        max_delay_ms=max_delay_ms,
        silent_after_s=silent_after_s,
        keep_s=keep_h * 3600.0,
    )
    surroundings = BaseMap.open(base_map) if base_map is not None else None
    opened = _replayed if recording else _live
    with (
        logs_on_stderr(as_json=json_logs),
        console.warnings_logged(on=json_logs),
        opened(chosen, config, access, settings) as service,
    ):
        service.base_map = surroundings
        if surroundings is not None and service.mission.georeference is None:
            console.warn("the mission does not say where on Earth it lies: its page shows no base map")
        for warning in service.mission.heatmaps.of_detectors:
            console.warn(warning)
        serve_on(service, address, lambda url: _ready(url, service, as_json))


def _ready(url: str, service: Service, as_json: bool) -> None:
    if as_json:
        console.print_json({"url": url, "mode": service.mode, "mission": service.mission.name})
    else:
        console.stdout().print(f"{console.escaped(service.mission.name)}: [bold]{url}[/]", soft_wrap=True)


@contextmanager
def _replayed(
    chosen: dict[str, Any], config: RunConfig, access: Access, settings: ServiceSettings
) -> Iterator[Service]:
    from crowdfence.pipeline import read_map, review_detector
    from crowdfence.pipeline.under_ground import under_ground_line
    from crowdfence.service.opening import replayed
    from crowdfence.sources.ground_contact import on_ground

    recording = source_options.open_source(chosen["recording"], chosen)
    ground = read_map(recording, chosen["terrain"], **map_options(chosen))
    recording = on_ground(recording, ground.terrain)
    if recording.frames:  # else they are the error
        _warn_of(*recording.warnings, *refusal_lines(recording.refused))
    _warn_of(*ground.doubts, *_doubts_of(ground.terrain, config))
    _warn_of(*filter(None, [under_ground_line(ground.terrain, recording.frames)]))
    with replayed(
        recording,
        ground.terrain,
        config,
        detector=chosen_detector(recording, chosen),
        speed=chosen["replay_speed"],
        settings=settings,
        access=access,
        static_zones=_static(chosen, recording.georeference or ground.terrain.georeference),
    ) as service:
        review = review_detector(service.mission.heatmaps, recording, ground.terrain, config)
        _warn_of(*([] if review is None else review.warnings))
        yield service


@contextmanager
def _live(
    chosen: dict[str, Any], config: RunConfig, access: Access, settings: ServiceSettings
) -> Iterator[Service]:
    from crowdfence.pipeline import named_detector, review_statement
    from crowdfence.pipeline.terrain import level_doubt, read_map_for_live_views
    from crowdfence.service.opening import live
    from crowdfence.sources.alignment_file import doubt_of_live
    from crowdfence.sources.layers import CROWD

    if chosen["terrain"] is None:
        raise ValueError("live views need a map: give one with --terrain (or name a recording to replay)")
    how = map_options(chosen)
    ground = read_map_for_live_views(chosen["terrain"], **how)
    _warn_of(*ground.doubts, *_doubts_of(ground.terrain, config))
    inputs = _inputs(chosen)
    if (anchor := ground.terrain.georeference) is not None:
        of_poses = _heights_are_absolute(inputs, of_origin=chosen["origin"] is not None)
        _warn_of(*filter(None, [level_doubt(chosen["terrain"], anchor, how, of_poses=of_poses)]))
    if chosen["alignment"] is not None:
        _warn_of(*filter(None, [doubt_of_live(chosen["alignment"])]))
    words = _models(chosen)
    if not words:
        _refuse_unseen_pictures(inputs)
    with live(
        chosen["data"],
        ground.terrain,
        config,
        name=chosen["name"],
        drones=chosen["drone"] or (),
        detector=named_detector(
            words,
            contract=chosen["contract"],
            enlarge=chosen["enlarge"].value,
            device=chosen["device"].value,
            far_every_s=chosen["far_every_s"],
        )
        if words
        else None,
        settings=settings,
        access=access,
        static_zones=_static(chosen, ground.terrain.georeference),
        inputs=inputs,
    ) as service:
        contract = service.mission.heatmaps.contract
        if contract is not None:
            _warn_of(*review_statement(contract, CROWD, ground.terrain, config))
        yield service


def _models(chosen: dict[str, Any]) -> list[str]:
    """The detectors that were named; live views bring heatmaps unless one is."""
    return [word for word in chosen["detector"] if word not in ("auto", "recorded")]


def _doubts_of(terrain: Terrain, config: RunConfig) -> list[str]:
    """What the cells of a map do to zones, and what the method takes from it, as `run` tells both."""
    from crowdfence.maps.voxel_size import coarse_voxels_warning

    _, of_prior = config.with_terrain(terrain)
    return [*of_prior, *filter(None, [coarse_voxels_warning(terrain.voxel_size_m)])]


def _warn_of(*doubts: str) -> None:
    for doubt in doubts:
        console.warn(in_options(doubt))


def _inputs(chosen: dict[str, Any]) -> Inputs:
    """What is listened to besides HTTP. ValueError for what only recordings can use, and for telemetry that
    cannot be laid on the clock."""
    from crowdfence.service.inputs import Inputs
    from crowdfence.service.mavlink_link import TelemetryAddress
    from crowdfence.service.telemetry import TelemetryOptions
    from crowdfence.sources.alignment_file import read_alignment
    from crowdfence.sources.camera_mount import CameraMount
    from crowdfence.sources.geographic_track import HeightOptions
    from crowdfence.sources.masked_drones import camera_masks

    told = source_options.given(chosen)
    addresses = [TelemetryAddress.parse(text) for text in chosen["mavlink"] or ()]
    if addresses and chosen["clock"] is ClockName.views:
        raise ValueError("--mavlink is laid on the machine's clock: it does not go with --clock views")
    ros = _ros(chosen, told.get("pose_noise"))
    usable = {
        "alignment",
        "camera_masks",
        *(("mount", "heights", "geoid_m", "take_off") if addresses else ()),
    }
    if ros is not None:
        usable |= {"topics", "mount"}
    if addresses or ros is not None:
        usable |= {"pose_noise"}
    for name in told.keys() - usable:
        raise ValueError(f"{name} says something about a recording; live views have none")
    mount = told.get("mount")
    heights = HeightOptions(told.get("heights"), told.get("geoid_m"), told.get("take_off"))
    key, alignment = chosen["mavlink_key"], told.get("alignment")
    return Inputs(
        mavlink=addresses,
        mavlink_key=None if key is None else key.read_text().strip(),
        telemetry=TelemetryOptions(
            None if mount is None else CameraMount.parse(mount), heights, noise=told.get("pose_noise")
        ),
        ros=ros,
        offsets={} if alignment is None else read_alignment(alignment),
        camera_masks=camera_masks(told.get("camera_masks", {})),
    )


def _heights_are_absolute(inputs: Inputs, *, of_origin: bool) -> bool:
    """Whether heights of live poses count from the ellipsoid or the sea, not from the ground of the map.
    `of_origin`: the local frame of poses counts from a place that was stated; else it is that of the map."""
    if inputs.mavlink and inputs.telemetry.heights.heights in ("ellipsoid", "sea"):
        return True
    if inputs.ros is not None and any(one.origin for one in inputs.ros.topics):
        return True
    # Telemetry tells heights above the take-off, and poses come by it alone.
    return of_origin and not (inputs.mavlink and inputs.ros is None)


def _refuse_unseen_pictures(inputs: Inputs) -> None:
    """ValueError for pictures of ROS topics at which no detector would look: each would be refused."""
    for one in () if inputs.ros is None else inputs.ros.topics:
        if one.camera is not None:
            raise ValueError(
                f"--topics: nobody would look at the pictures of {one.drone} ({one.camera}): name a "
                "detector, such as --detector crowdnet-s, or heatmap= in place of camera="
            )


def _ros(chosen: dict[str, Any], noise: GivenNoise | None) -> RosLink | None:
    from crowdfence.service.ros.keys import RosKeys
    from crowdfence.service.ros.link import RosLink
    from crowdfence.service.ros.topics import live_topics
    from crowdfence.sources.camera_mount import CameraMount

    if chosen["zenoh"] is None and chosen["zenoh_config"] is None:
        return None
    mount = chosen["mount"]
    return RosLink(
        endpoint=chosen["zenoh"] or "",
        config=chosen["zenoh_config"],
        keys=RosKeys(chosen["zenoh_keys"].value, chosen["ros_domain"], chosen["bridge_namespace"]),
        topics=live_topics(chosen["topics"] or ()),
        mount=None if mount is None else CameraMount.parse(mount),
        noise=noise,
    )


def _static(chosen: dict[str, Any], georeference: Any) -> Any:
    from crowdfence.static_zones import read_static_zones

    others, left_out = read_static_zones(list(chosen["static_zones"] or ()), georeference)
    for reason in left_out:
        console.warn(reason)
    return others
