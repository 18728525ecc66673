"""Renders a scene with OpenGL: colour, class, instance and depth from the same fragments."""

from __future__ import annotations

from types import TracebackType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence._core import Camera
from crowdfence.simulation.rendering.building_painter import BuildingPainter
from crowdfence.simulation.rendering.clip_space import (
    checked_pose,
    clip_from_camera,
    ray_from_clip,
    rigid_inverse,
    side_planes,
)
from crowdfence.simulation.rendering.film import Development, Film
from crowdfence.simulation.rendering.frame import RenderedFrame
from crowdfence.simulation.rendering.ground_painter import GroundPainter
from crowdfence.simulation.rendering.mesh_catalogue import (
    MeshFamily,
    cyclist_family,
    people_family,
    prop_families,
)
from crowdfence.simulation.rendering.noise_texture import noise_texture
from crowdfence.simulation.rendering.opengl_context import open_context
from crowdfence.simulation.rendering.picture_settings import PictureSettings
from crowdfence.simulation.rendering.random_palette import RandomPalette
from crowdfence.simulation.rendering.sample_lattice import lattice_for
from crowdfence.simulation.rendering.season_palette import SeasonPalette
from crowdfence.simulation.rendering.shader_program import build_program, set_uniforms
from crowdfence.simulation.rendering.shadow_maps import ShadowMaps, caster_planes, shadow_focus
from crowdfence.simulation.rendering.sky_painter import SkyPainter
from crowdfence.simulation.rendering.stage_cast import (
    cyclist_batches,
    people_batches,
    people_rows,
    prop_batches,
)
from crowdfence.simulation.rendering.thing_painter import Batch, ThingPainter

if TYPE_CHECKING:
    from crowdfence.simulation.scene import Scene

_NOISE_UNIT = 3
_ROLLING_MARGIN_M = 4.0


class Renderer:
    """Takes pictures of one scene with one camera. Use as a context manager; one per process or thread.

    `supersample` 1, 2 or 3: samples per pixel along each axis for the colours; labels and depth are always
    sampled exactly at pixel centres. NoOpenGL when this machine cannot render; ValueError for a lens that
    sees more than 160 degrees.
    """

    def __init__(
        self,
        scene: Scene,
        camera: Camera,
        *,
        supersample: int = 2,
        picture: PictureSettings | None = None,
    ) -> None:
        self._scene, self._picture = scene, picture or PictureSettings()
        self._lattice = lattice_for(camera, supersample)
        self._context = open_context()
        self._context.front_face = "cw"  # rows are top first, which mirrors the picture
        self._film = Film(self._context, self._lattice)
        self._build(scene)
        self.description = f"{self._context.info['GL_RENDERER']}, OpenGL {self._context.info['GL_VERSION']}"
        """The driver that makes the pictures."""

    def _build(self, scene: Scene) -> None:
        context, light, landscape = self._context, scene.light, scene.landscape
        families: dict[str, MeshFamily] = {str(kind): family for kind, family in prop_families().items()}
        families |= {"person": people_family(), "cyclist": cyclist_family()}
        palette = _palette(scene)
        self._props = prop_batches(landscape, families, palette)
        largest = max(
            [len(batch.rows) for batch in self._props] + [scene.people.count, scene.cyclists.count, 64]
        )
        self._thing_program = build_program(context, "thing.vert", "thing.frag")
        self._shadow_program = build_program(context, "thing_shadow.vert", "shadow.frag")
        self._things = ThingPainter(context, self._thing_program, self._shadow_program, families, largest)
        self._ground = GroundPainter(context, landscape, palette, light.sun_direction, scene.seed)
        self._buildings = BuildingPainter(context, landscape.buildings)
        self._sky = SkyPainter(context)
        self._noise = noise_texture(context, 7)
        self._kinds = len(families["person"].variants)
        self._shadows = ShadowMaps(context, light.sun_direction)
        set_uniforms(self._thing_program, {"u_snow": palette.snow_on_things})
        self._draw_standing_shadows()

    def _draw_standing_shadows(self) -> None:
        west, south, east, north = self._scene.landscape.extent_m
        centre = np.array([(west + east) / 2, (south + north) / 2, 0.0])
        self._context.enable_only(self._context.DEPTH_TEST)
        radius_m = float(np.hypot(east - west, north - south)) / 2

        def cast(clip: NDArray[np.float64]) -> None:
            self._cast(clip, self._props, level=1)

        self._shadows.draw_far(centre, radius_m, cast)

    def _cast(self, clip: NDArray[np.float64], batches: list[Batch], level: int) -> None:
        set_uniforms(self._shadow_program, {"u_shadow_clip_from_world": clip})
        self._things.cast(batches, caster_planes(clip), level)
        self._buildings.cast(clip)

    def __enter__(self) -> Renderer:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def close(self) -> None:
        """Release the context and everything in it."""
        self._context.release()

    def render(
        self,
        t_s: float,
        world_from_camera: ArrayLike,
        *,
        world_from_camera_end: ArrayLike | None = None,
        world_from_camera_blurred: ArrayLike | None = None,
        noise_seed: int = 0,
    ) -> RenderedFrame:
        """The scene at `t_s` from a camera at `world_from_camera` [4, 4] (OpenCV axes in local ENU metres).

        `world_from_camera_end` turns on the rolling exposure: the first row is taken at `world_from_camera`,
        the last at this pose, those between at poses in between. `world_from_camera_blurred` is where the
        camera is one exposure time later: colours are blurred along that motion, half of it to either side.
        `noise_seed` varies the sensor's noise."""
        start = checked_pose(world_from_camera)
        end = start if world_from_camera_end is None else checked_pose(world_from_camera_end)
        moving = self._moving(t_s)
        eye = (start[:3, 3] + end[:3, 3]) / 2
        self._context.enable_only(self._context.DEPTH_TEST)
        self._draw_moving_shadows(start, moving, t_s)
        self._paint(start, end, eye, moving, t_s)
        blur = None
        if self._picture.motion_blur and world_from_camera_blurred is not None:
            blur = rigid_inverse(checked_pose(world_from_camera_blurred)) @ start
        return self._film.develop(Development(self._picture.noise_sigma, noise_seed, blur))

    def _moving(self, t_s: float) -> list[Batch]:
        scene = self._scene
        people, cyclists = scene.people.at(t_s), scene.cyclists.at(t_s)
        rows = people_rows(
            people.position,
            people.heading_rad,
            people.speed_m_s,
            people.phase,
            people.arms,
            people.in_crowd,
            scene.people.colours,
            scene.people.height_m,
            scene.people.bodies,
        )
        return people_batches(rows, scene.people.kind, self._kinds) + cyclist_batches(
            cyclists.position,
            cyclists.heading_rad,
            cyclists.pitch_rad,
            cyclists.pedal_phase,
            scene.people.count + 1,
        )

    def _draw_moving_shadows(self, pose: NDArray[np.float64], moving: list[Batch], t_s: float) -> None:
        focus, radius_m = shadow_focus(pose, self._scene.landscape)
        set_uniforms(self._shadow_program, {"u_time_s": t_s})

        def cast(clip: NDArray[np.float64]) -> None:
            self._cast(clip, [*self._props, *moving], level=1)

        self._shadows.draw_near(focus, radius_m, cast)

    def _paint(
        self,
        start: NDArray[np.float64],
        end: NDArray[np.float64],
        eye: NDArray[np.float64],
        moving: list[Batch],
        t_s: float,
    ) -> None:
        projection = clip_from_camera(self._lattice)
        clip_from_world = np.stack([projection @ rigid_inverse(pose) for pose in (start, end)])
        rolling = not np.array_equal(start, end)
        planes = side_planes(clip_from_world[0])
        if rolling:
            planes = planes + np.array([0.0, 0.0, 0.0, _ROLLING_MARGIN_M])
        uniforms = {
            **self._air(eye, t_s),
            "u_clip_from_world": clip_from_world,
            "u_world_from_clip": np.stack([ray_from_clip(projection, pose) for pose in (start, end)]),
            "u_rolling": rolling,
        }
        for program in (
            self._thing_program,
            self._ground.program,
            self._buildings.program,
            self._sky.program,
        ):
            set_uniforms(program, uniforms)
        self._film.lattice_target.use()
        self._film.lattice_target.clear(depth=1.0)
        # Nearest first: what is hidden then costs nothing.
        self._things.paint([*moving, *self._props], planes, eye)
        self._buildings.paint()
        self._ground.paint(planes, eye)
        self._sky.paint()

    def _air(self, eye: NDArray[np.float64], t_s: float) -> dict[str, Any]:
        light = self._scene.light
        self._noise.use(_NOISE_UNIT)
        return {
            "u_sun_direction": light.sun_direction,
            "u_sun_colour": light.sun_colour,
            "u_sky_colour": light.sky_colour,
            "u_haze_colour": light.haze_colour,
            "u_haze_per_m": light.haze_per_m,
            "u_cloud_cover": light.cloud_cover,
            "u_exposure": light.exposure,
            "u_time_s": t_s,
            "u_eye": tuple(eye),
            "u_noise": _NOISE_UNIT,
            **self._shadows.uniforms(),
        }


def _palette(scene: Scene) -> SeasonPalette:
    if scene.scenario.looks == "random":
        return RandomPalette(scene.light.season, scene.seed)
    return SeasonPalette(scene.light.season)
