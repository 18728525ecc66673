"""The compiled core (Rust crate `crowdfence`). Arrays in, arrays out; no files, no clock.

Conventions everywhere: world = local ENU metres (x east, y north, z up), float64; camera = OpenCV axes
(x right, y down, z forward); continuous pixel coordinates, the centre of pixel (column i, row j) is at
(i + 0.5, j + 0.5); `stamp_ns` = int64 nanoseconds since the Unix epoch; durations and rates in seconds.
Arrays that come out are copies.

Input that cannot be used raises CrowdfenceError or one of its children (all are ValueErrors); the message
names the offending value and its bound. Arguments of a wrong type raise TypeError.
"""

from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.georeference import Georeference

__all__ = [
    "COARSER",
    "Camera",
    "CrowdColumns",
    "CrowdMap",
    "CrowdMass",
    "CrowdfenceError",
    "Evidence",
    "LikelihoodRatio",
    "LinearPool",
    "LogOdds",
    "LogPool",
    "MapFileError",
    "MovingAverage",
    "Observation",
    "Or",
    "Paper",
    "Rates",
    "StampError",
    "Terrain",
    "Update",
    "View",
    "ViewError",
    "VoxelKnowledge",
    "__version__",
    "blend",
    "pool",
    "project",
    "raised",
    "vibrant",
    "write_octomap_binary",
    "write_octomap_color",
]

COARSER: float
"""Voxel columns up to so many cells of a height model wide are as fine as it; for `raised`."""
__version__: str

class CrowdfenceError(ValueError):
    """Something that crowdfence cannot use; the message names the value and its bound.

    Its children say what kind of thing it was. This class itself is raised for parameters, for arrays of a
    wrong shape, element type or content, and for terrains.
    """

class ViewError(CrowdfenceError):
    """A camera, heatmap or pose that cannot be, or a drone without a name or beside the fleet."""

class StampError(CrowdfenceError):
    """A stamp that is no int64, or an instant out of order, in the past or too far from the others."""

class MapFileError(CrowdfenceError):
    """An OctoMap, crowd map or other map file that cannot be used, or a crowd map of another terrain."""

@final
class Camera:
    """Intrinsics of one camera. `Camera.pinhole` and `Camera.fisheye` make one.

    Camera axes are those of OpenCV: x right, y down, z forward. Pixel coordinates are continuous: the image
    covers [0, width) x [0, height) and the centre of pixel (column i, row j) is at (i + 0.5, j + 0.5).

    A lens model is trusted only where it is one-to-one: directions from outside of that field of view have no
    pixel and pixels from outside have no ray. A camera cannot change; it can be compared, hashed and pickled.
    """

    @staticmethod
    def pinhole(
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        distortion: ArrayLike | None = None,
    ) -> Camera:
        """Pinhole camera, plain or with Brown-Conrady distortion.

        width, height  size of the image, in pixels
        fx, fy         focal length along a row and along a column, in pixels
        cx, cy         principal point (column, row) in continuous pixels. Calibrations that put the centre of
                       the first pixel at (0, 0), as those of OpenCV and ROS do, need 0.5 added to both
        distortion     (k1, k2, p1, p2) or (k1, k2, p1, p2, k3), OpenCV's order; None = plain pinhole. Also
                       in a row or a column, as OpenCV's calibrations give them

        ViewError names the parameter that is not finite or out of bounds, or the number of coefficients.
        """
    @staticmethod
    def fisheye(
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        distortion: ArrayLike = (0.0, 0.0, 0.0, 0.0),
    ) -> Camera:
        """Fisheye camera by Kannala and Brandt: a polynomial in the angle off the axis.

        width, height  size of the image, in pixels
        fx, fy         focal length along a row and along a column, in pixels
        cx, cy         principal point (column, row) in continuous pixels. Calibrations that put the centre of
                       the first pixel at (0, 0), as those of OpenCV and ROS do, need 0.5 added to both
        distortion     (k1, k2, k3, k4) as in OpenCV's fisheye module; zeros = image radius f * angle

        ViewError names the parameter that is not finite or out of bounds, or the number of coefficients.
        """
    @property
    def width(self) -> int:
        """Width of the image in pixels."""
    @property
    def height(self) -> int:
        """Height of the image in pixels."""
    @property
    def fx(self) -> float:
        """Focal length along a row, in pixels."""
    @property
    def fy(self) -> float:
        """Focal length along a column, in pixels."""
    @property
    def cx(self) -> float:
        """Column of the principal point, in continuous pixels."""
    @property
    def cy(self) -> float:
        """Row of the principal point, in continuous pixels."""
    @property
    def model(self) -> Literal["pinhole", "brown_conrady", "kannala_brandt"]:
        """Lens model: "pinhole", "brown_conrady" or "kannala_brandt"."""
    @property
    def distortion(self) -> list[float]:
        """Distortion coefficients: [] for a plain pinhole, [k1, k2, p1, p2, k3] or [k1, k2, k3, k4]."""
    def project(self, points_camera: ArrayLike) -> NDArray[np.float64]:
        """Points [N, 3] in camera axes -> pixels [N, 2] float64, which may lie outside the image.

        NaN where the camera cannot see the direction (behind a pinhole, outside the field of view of the lens
        model) and for points that are not finite. CrowdfenceError for another shape.
        """
    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Pixels [N, 2] -> unit rays [N, 3] float64 in camera axes; the inverse of `project`.

        ViewError names the first pixel that is not finite or at which the distortion cannot be inverted;
        CrowdfenceError for another shape.
        """
    def blind_pixel_count(self) -> int:
        """How many pixel centres have no ray because the distortion cannot be inverted there."""

@final
class View:
    """What one drone saw at one instant.

    drone              its name, the same in all of its views
    stamp_ns           when the image was exposed: int, nanoseconds since the Unix epoch
    camera             intrinsics of the image
    world_from_camera  [4, 4] rigid transform, camera axes -> local ENU metres
    heatmap            [h, w] float in [0, 1] or uint8 (value / 255), at any stride of the image; a mask of
                       0 and 1 is given as bool: as uint8 its ones are next to nothing. Of a masked array
                       (`numpy.ma`) the masked cells were not looked at: they say neither crowd nor empty

    ViewError for a drone without a name, a pose that is not rigid to 1e-4, a heatmap that is empty, holds a
    value outside [0, 1] or is no reduction of the image; StampError for a stamp that is no int64;
    CrowdfenceError for an array of another shape or element type. A view cannot change; it can be pickled.
    """

    def __new__(
        cls,
        drone: str,
        stamp_ns: int,
        camera: Camera,
        world_from_camera: ArrayLike,
        heatmap: ArrayLike,
    ) -> View: ...
    @property
    def drone(self) -> str:
        """Name of the drone."""
    @property
    def stamp_ns(self) -> int:
        """When the image was exposed, nanoseconds since the Unix epoch."""
    @property
    def camera(self) -> Camera:
        """Intrinsics of the image."""
    @property
    def world_from_camera(self) -> NDArray[np.float64]:
        """Rigid transform [4, 4] float64, camera axes -> local ENU metres."""
    @property
    def heatmap(self) -> NDArray[np.float32]:
        """Heatmap [h, w] float32 in [0, 1]; 0 in cells that were not looked at."""
    @property
    def looked_at(self) -> NDArray[np.bool_] | None:
        """Cells [h, w] of the heatmap that were looked at; None: all of them."""

@final
class Terrain:
    """The known terrain: a sparse voxel surface.

    Voxel (i, j, k) is the half-open box from origin + (i, j, k) * voxel_size_m to
    origin + (i + 1, j + 1, k + 1) * voxel_size_m, in world metres. Voxel ids are ranks 0 .. voxel_count - 1
    in the terrain's tree and index every per-voxel array.

    `Terrain.open` reads map files, the `from_` constructors take arrays; all of them raise CrowdfenceError
    for a terrain without a voxel, with more than 2^31 of them or more than 2^20 along an axis, for a
    voxel_size_m that is not positive, for values that are not finite, for heights beyond +-9000 m, which no
    ground has, and for arrays of another shape or element type. The voxels cannot change. A terrain can be
    pickled (16 bytes per voxel).
    """

    @staticmethod
    def from_occupancy(
        occupied: NDArray[np.bool_], voxel_size_m: float, origin: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Terrain:
        """Occupied cells of a bool array [X, Y, Z] become voxels; cell (0, 0, 0) starts at `origin`.

        CrowdfenceError as for the class.
        """
    @staticmethod
    def from_height_map(
        height_m: ArrayLike,
        cell_size_m: float,
        voxel_size_m: float | None = None,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> Terrain:
        """Closed surface of a height map [X, Y] (first axis east, second north), float32.

        height_m      height of each cell's centre, metres above origin z; NaN is a hole
        cell_size_m   cell (i, j) covers origin + [i, i + 1) x [j, j + 1) * cell_size_m
        voxel_size_m  None = cell_size_m
        origin        world coordinates (x, y, z) of the corner of cell (0, 0), metres

        A column also fills the step down to its lowest neighbour, so that no ray slips through. In voxels
        larger than the cells it has the height at its middle, but that of its highest cell where this stands
        out of it by a metre and half a voxel: what a wall hides would be called seen.
        CrowdfenceError as for the class.
        """
    @staticmethod
    def from_points(
        points: ArrayLike, voxel_size_m: float, origin: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Terrain:
        """Every voxel that holds at least one of the points [N, 3] (world metres).

        The surface goes through the mean points of neighbouring voxels; one point a voxel is enough.
        CrowdfenceError as for the class, naming the first point that has no place on the grid.
        """
    @staticmethod
    def from_triangles(
        vertices: ArrayLike,
        triangles: ArrayLike,
        voxel_size_m: float,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> Terrain:
        """Every voxel that a triangle touches: vertices [N, 3] world metres, triangles [M, 3] indices.

        The surface is the highest triangle in a column of voxels.
        CrowdfenceError as for the class, naming the vertex or triangle that cannot be used.
        """
    @staticmethod
    def from_indices(
        indices: ArrayLike, voxel_size_m: float, origin: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Terrain:
        """Voxels by their grid indices (i, j, k) [N, 3], in any order; the inverse of `voxel_indices`.

        Where in them the surface lies is estimated from the voxels around.
        CrowdfenceError as for the class, naming the first index beyond 32 bits.
        """
    @staticmethod
    def from_voxels(
        indices: ArrayLike,
        planes: ArrayLike,
        voxel_size_m: float,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
        unmeasured: ArrayLike | None = None,
    ) -> Terrain:
        """Voxels by their grid indices (i, j, k) [N, 3], with the surface in them as `planes` [N] gives it.

        From `voxel_indices` of all ids, `planes` and `unmeasured` comes the very terrain that they were taken
        from. CrowdfenceError as for the class.
        """
    @staticmethod
    def from_octomap(data: bytes, *, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> Terrain:
        """Occupied leaves of an OctoMap (the bytes of its .bt or .ot file); pruned leaves are expanded.

        `origin` is added to the file's coordinates. MapFileError says what is wrong and at which byte.
        """
    @staticmethod
    def open(
        path: str | PathLike[str],
        *,
        voxel_size_m: float | None = None,
        georeference: Georeference | None = None,
        **options: Any,
    ) -> Terrain:
        """Terrain of a map file: OctoMap .bt .ot, heights .tif .tiff, lidar points .las .laz, mesh .ply .obj.

        voxel_size_m   None lets the file decide
        georeference   anchor of the local frame, as a rule that of the recording. A map with a coordinate
                       reference system is brought into its frame; without an anchor it gets one in its middle
        options        of the kind of file, see `crowdfence.maps.open_terrain`

        `terrain.georeference` says where the frame lies. MapFileError names the file, what is wrong with it
        and what to do; TypeError for an option that the kind of file does not have.
        """
    @property
    def voxel_count(self) -> int:
        """Number of voxels V; their ids are 0 .. V - 1."""
    @property
    def voxel_size_m(self) -> float:
        """Side of a voxel in metres."""
    @property
    def origin(self) -> tuple[float, float, float]:
        """World coordinates (x, y, z) at which grid index (0, 0, 0) starts."""
    @property
    def bounds(self) -> NDArray[np.float64]:
        """[2, 3] float64: lowest and highest corner of the occupied voxels, world metres."""
    @property
    def tree_bytes(self) -> int:
        """Memory of the tree in bytes."""
    @property
    def bytes(self) -> int:
        """Memory of voxels and surface in bytes."""
    @property
    def planes(self) -> NDArray[np.uint32]:
        """Where in each voxel the surface lies [V] uint32: numbers for `from_voxels`."""
    @property
    def unmeasured(self) -> NDArray[np.int64]:
        """Columns (i, j) [U, 2] int64, sorted, whose surface nobody measured: it was bridged from what lies
        around when the map was read, and no landing site holds it.
        """
    @property
    def fingerprint(self) -> int:
        """Checksum of geometry and voxels; equal terrains have equal fingerprints."""
    @property
    def georeference(self) -> Georeference | None:
        """Where on Earth the local frame lies; None when unknown. Can be set."""
    @georeference.setter
    def georeference(self, georeference: Georeference | None) -> None: ...
    def raycast(
        self,
        origins: ArrayLike,
        directions: ArrayLike,
        max_range_m: float,
        *,
        surface: Literal["planes", "voxels"] = "planes",
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Where each ray first meets the terrain: (voxel ids [N], -1 = nowhere; metres [N], inf = nowhere).

        origins and directions are [N, 3] in the world; directions need not have unit length
        surface   "planes": where in the voxels the map says that it lies; "voxels": the voxels as cubes

        A ray that starts inside has distance 0; farther than `max_range_m` is no hit. CrowdfenceError names
        the first ray that is not finite or has no direction, or the shape that does not fit.
        """
    def voxel_centers(self, ids: ArrayLike) -> NDArray[np.float64]:
        """World coordinates [N, 3] of the centres of the voxels `ids` [N].

        CrowdfenceError for an id that does not exist.
        """
    def surface_heights(self, ids: ArrayLike) -> NDArray[np.float64]:
        """Heights [N] of the surface over the middle of the voxels `ids` [N], world metres.

        Of a voxel under another one it is its upper face. CrowdfenceError for an id that does not exist.
        """
    def voxel_indices(self, ids: ArrayLike) -> NDArray[np.int64]:
        """Grid indices (i, j, k) [N, 3] of the voxels `ids` [N].

        CrowdfenceError for an id that does not exist.
        """
    def standing_places(self) -> NDArray[np.int64]:
        """Ids [N] int64 of the voxels without a voxel on top, on which somebody can stand: sorted by column
        (i, then j), then from below. Costs the map, 0.02 s a million voxels.
        """
    def columns(self) -> NDArray[np.int64]:
        """Every column of voxels, sorted [C, 4] int64: grid indices i and j, k of its lowest and of its
        highest voxel. Costs the map, 0.03 s a million voxels.
        """
    def surface_map(self) -> NDArray[np.float32]:
        """The terrain from above [X, Y] float32: height of the highest surface over the middle of every
        column, metres above the lowest face, from the smallest grid indices in use on. NaN in a column
        without a voxel. Costs the map, 0.03 s a million voxels.
        """
    def voxel_ids(self, indices: ArrayLike) -> NDArray[np.int64]:
        """Ids [N] of grid indices [N, 3], -1 where there is no voxel. CrowdfenceError for another shape."""
    def with_origin(self, origin: Sequence[float]) -> Terrain:
        """The same voxels in a frame shifted so that grid index (0, 0, 0) starts at `origin` (x, y, z).

        CrowdfenceError for an origin that is not finite.
        """
    def with_unmeasured(self, columns: ArrayLike) -> Terrain:
        """The same terrain, of which nobody measured the surface in the columns (i, j) [N, 2] either.

        CrowdfenceError for another shape.
        """
    def joined(self, other: Terrain) -> Terrain:
        """The voxels of this terrain and of another one of the same grid, with their surfaces.

        In a voxel of both, this terrain's surface counts. The georeference is this one's.
        CrowdfenceError for another voxel_size_m, origin or georeference.
        """

@final
class CrowdMass:
    """Where the crowd in a picture went: heatmap value summed over the pixels that show crowd (those above
    the crowd threshold), by what their rays met. Every such pixel counts in exactly one of the six; only
    what met ground is on the map.

    ground        a voxel in range
    out_of_range  a voxel, but beyond `max_range_m`
    hole          no voxel, on a way down through the map: below ground that lies above it, or where the map
                  has no voxel but goes on to the east, west, north and south
    off_map       no voxel, on a way down past the map: beside it, or over it and its edge
    sky           no voxel, on a way that is level or leads up
    unusable      no ray: the lens model has none for the pixel, or the camera is under ground

    Masses of several views add up with +. CrowdfenceError names one that is negative or not finite. It
    cannot change; it can be compared and pickled.
    """
    def __new__(
        cls,
        *,
        ground: float = 0.0,
        out_of_range: float = 0.0,
        hole: float = 0.0,
        off_map: float = 0.0,
        sky: float = 0.0,
        unusable: float = 0.0,
    ) -> CrowdMass: ...
    @property
    def ground(self) -> float:
        """What met a voxel in range: it is on the map."""
    @property
    def out_of_range(self) -> float:
        """What met a voxel beyond the range."""
    @property
    def hole(self) -> float:
        """What went down through the map and met no voxel."""
    @property
    def off_map(self) -> float:
        """What went down past the map."""
    @property
    def sky(self) -> float:
        """What did not go down and met no voxel."""
    @property
    def unusable(self) -> float:
        """What pixels without a ray show."""
    @property
    def total(self) -> float:
        """All six together."""
    @property
    def lost(self) -> float:
        """All that met no ground in range."""
    def by_fate(self) -> dict[str, float]:
        """The six by name, ground first."""
    def __add__(self, value: CrowdMass, /) -> CrowdMass: ...
    def __radd__(self, value: CrowdMass, /) -> CrowdMass: ...
    def __getnewargs_ex__(self) -> tuple[tuple[()], dict[str, float]]: ...

@final
class Observation:
    """What one view says about the terrain: arrays of equal length V, one row per voxel that it sees.

    terrain       the terrain that the ids are meant for
    drone         name of the drone
    stamp_ns      when the image was exposed: int, nanoseconds since the Unix epoch
    voxel_ids     [V] sorted and unique
    mean          [V] m_i of equation 1, in [0, 1]
    pixel_count   [V] pixels that show the voxel; 0 = in view, but between the pixel centres
    range_m       [V] from the camera to the voxel's centre, metres
    tilt_deg      [V] of that line, degrees below the horizon: 90 is straight down; negative
                  where it comes from below, also from below the plane of the voxel's top
    occluded_ids  [O] sorted, unique and not seen: in the image and in range, but hidden by something
    crowd_mass    where the crowd in the picture went; None: it shows none, or nobody knows
    focal_px      focal length of the camera in pixels, >= 0: a voxel is seen with range / focal metres per
                  pixel; 0: nobody said

    `project` makes one from a view. It is checked when it is made, and cannot change: CrowdfenceError
    names what is not sorted, not unique, not finite, out of bounds or of another length; ViewError a
    drone without a name; StampError a stamp that is none. It can be compared, pickled, and sent as
    bytes.
    """
    def __new__(
        cls,
        terrain: Terrain,
        drone: str,
        stamp_ns: int,
        *,
        voxel_ids: ArrayLike,
        mean: ArrayLike,
        pixel_count: ArrayLike,
        range_m: ArrayLike,
        tilt_deg: ArrayLike,
        occluded_ids: ArrayLike,
        crowd_mass: CrowdMass | None = None,
        focal_px: float = 0.0,
    ) -> Observation: ...
    @property
    def focal_px(self) -> float:
        """Focal length of the camera in pixels; 0 = nobody said."""
    @property
    def drone(self) -> str:
        """Name of the drone."""
    @property
    def stamp_ns(self) -> int:
        """When the image was exposed, nanoseconds since the Unix epoch."""
    @property
    def terrain_fingerprint(self) -> int:
        """`Terrain.fingerprint` of the terrain that the ids are meant for."""
    @property
    def voxel_ids(self) -> NDArray[np.int64]:
        """Voxels seen [V] int64, sorted."""
    @property
    def mean(self) -> NDArray[np.float64]:
        """m_i [V] float64: mean heatmap value over the pixels whose ray first hits the voxel."""
    @property
    def pixel_count(self) -> NDArray[np.int64]:
        """Those pixels [V] int64; 0 for a voxel that is in view but between the pixel centres."""
    @property
    def range_m(self) -> NDArray[np.float32]:
        """From the camera to the voxel's centre [V] float32, metres."""
    @property
    def tilt_deg(self) -> NDArray[np.float32]:
        """Of that line, below the horizon [V] float32, degrees: 90 is straight down, negative is upwards."""
    @property
    def occluded_ids(self) -> NDArray[np.int64]:
        """Voxels inside the image and in range that something hides [O] int64, sorted. Empty for coverage
        "rays".
        """
    @property
    def crowd_mass(self) -> CrowdMass:
        """Where the crowd in the picture went: heatmap value of the pixels above the crowd threshold, by what
        their rays met.
        """
    def to_bytes(self) -> bytes:
        """The observation as bytes, with a checksum, for other machines and other versions of this
        library.
        """
    @staticmethod
    def from_bytes(data: bytes) -> Observation:
        """The observation that `to_bytes` wrote. MapFileError for bytes that are damaged, of another kind
        or of a newer version, CrowdfenceError where their content breaks a promise of an observation.
        """
    def __len__(self) -> int: ...

def project(
    view: View,
    terrain: Terrain,
    *,
    max_range_m: float,
    target_height_m: float = 0.0,
    coverage: Literal["rays", "full"] = "full",
    surface: Literal["planes", "voxels"] = "planes",
    crowd_threshold: float = 0.5,
) -> Observation:
    """Back-project a view onto the terrain: mean heatmap value per visible voxel.

    max_range_m      > 0, rays end here
    target_height_m  in [0, 100], height above the ground at which people are marked
    coverage         "full": every voxel of which the top is in view, also between the pixels, and which are
                     occluded; "rays": the voxels first hit by the ray of some pixel centre, as in the paper
    surface          "planes": where in the voxels the map says that the surface lies; "voxels": the voxels as
                     cubes, as in the paper, up to a voxel too high. At a hole or the edge of the map, pixels
                     of the open side of a plane's voxel raise its mean, and never lower it
    crowd_threshold  in [0, 1], as a rule the method's b_threshold: pixels with a larger heatmap value show
                     crowd, and `Observation.crowd_mass` says where it went; it decides nothing else

    A camera inside the terrain, or one that `target_height_m` would push through it, sees nothing.
    CrowdfenceError for a parameter out of bounds.
    """

@final
class Rates:
    """What a detector is worth: two rates strictly between 0 and 1, the true positive rate the larger one.

    true_positive   P(B = 1 | A = 1), how often it calls crowd what is crowd
    false_positive  P(B = 1 | A = 0), how often it calls crowd what is none

    CrowdfenceError names a rate out of bounds or two rates that are swapped. Rates cannot change; they
    can be compared, hashed and pickled.
    """

    def __new__(cls, true_positive: float, false_positive: float) -> Rates: ...
    @property
    def true_positive(self) -> float:
        """P(B = 1 | A = 1)."""
    @property
    def false_positive(self) -> float:
        """P(B = 1 | A = 0)."""
    @property
    def false_negative(self) -> float:
        """P(B = 0 | A = 1) = 1 - true_positive."""
    @property
    def true_negative(self) -> float:
        """P(B = 0 | A = 0) = 1 - false_positive."""

def pool(
    m: ArrayLike,
    visible: ArrayLike,
    rates: Rates,
    prior: float,
    *,
    b_threshold: float = 0.5,
    unseen: Literal["fleet", "visible"] = "fleet",
    normalise: bool = False,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Equations 1-2, the linear opinion pool over the drones of a fleet: (probability [V], seen [V]).

    P(A = 1) = sum over drones i of w_i P(A = 1 | B_i = b_i) with w_i = |m_i - 0.5| / (0.5 N) and b_i =
    1 where m_i > b_threshold; P(A | B) follows from rates and prior by Bayes' rule. The weights need
    not sum to 1.

    m            [N drones, V voxels] mean heatmap values in [0, 1], read only where `visible`
    visible      [N, V] bool, which drone sees which voxel
    rates        of the detector
    prior        P(A = 1), strictly between 0 and 1
    b_threshold  in [0, 1)
    unseen       "fleet": a drone that does not see the voxel enters with m = 0, as printed; "visible": it is
                 left out, N counts those that see it, and what nobody sees has the prior
    normalise    divide the weights by their sum; where they are all 0 the result is the prior

    probability is float64 and seen bool: whether any drone sees the voxel. CrowdfenceError names the
    value out of bounds, or the array whose shape does not fit.
    """

def blend(
    previous: ArrayLike,
    elapsed_s: ArrayLike,
    pooled: ArrayLike,
    seen: ArrayLike,
    *,
    alpha: float,
    decay_per_s: float,
) -> NDArray[np.float64]:
    """Equation 3, temporal blending with decay: P~ per voxel [V] float64.

    With beta = exp(-decay_per_s * elapsed_s): alpha * pooled + (1 - alpha) * beta * previous where a
    voxel is seen, beta * previous where it is not.

    previous     [V] P~ after the last look, in [0, 1]
    elapsed_s    [V] time since that look, >= 0
    pooled       [V] probability by equation 1, in [0, 1], read only where `seen`
    seen         [V] bool
    alpha        weight of the newest instant, in (0, 1]
    decay_per_s  lambda, >= 0

    CrowdfenceError names the value out of bounds, or the array whose length does not fit.
    """

@final
class Paper:
    """Method `paper`: equations 1-3 with a switch for everything that the paper leaves open.

    rates        of the detector, which decides P(A | B)
    prior        P(A = 1), strictly between 0 and 1
    alpha        weight of the newest instant in equation 3, in (0, 1]; 1 is the paper's Policy 1
    decay        lambda of equation 3, >= 0, per `decay_unit`
    fleet_size   N of equation 1, in [1, 10000]; no more drones than this may ever give a view
    b_threshold  a view calls a voxel crowd when its mean heatmap value is above this, in [0, 1)
    unseen       what a drone that does not see a voxel says: "fleet", m = 0 with full weight as printed, or
                 "visible", nothing
    normalise    divide the weights of equation 2 by their sum
    initial      P~ before the first look: "zero", "prior", or "first", which takes the first look whole
    decay_unit   what lambda counts: "second", or "frame", the instants integrated

    CrowdfenceError names the parameter that is out of bounds. It cannot change; it can be compared and
    pickled.
    """
    def __new__(
        cls,
        rates: Rates,
        prior: float,
        *,
        alpha: float = 0.1,
        decay: float = 0.0005,
        fleet_size: int,
        b_threshold: float = 0.5,
        unseen: Literal["fleet", "visible"] = "fleet",
        normalise: bool = False,
        initial: Literal["zero", "prior", "first"] = "zero",
        decay_unit: Literal["second", "frame"] = "second",
    ) -> Paper: ...
    @property
    def name(self) -> Literal["paper"]:
        """Name of the method: "paper"."""
    @property
    def rates(self) -> Rates:
        """Rates of the detector."""
    @property
    def prior(self) -> float:
        """P(A = 1)."""
    @property
    def alpha(self) -> float:
        """Weight of the newest instant in equation 3."""
    @property
    def decay(self) -> float:
        """lambda of equation 3, per `decay_unit`."""
    @property
    def decay_unit(self) -> Literal["second", "frame"]:
        """What lambda counts: "second" or "frame"."""
    @property
    def fleet_size(self) -> int:
        """N of equation 1."""
    @property
    def b_threshold(self) -> float:
        """A view calls a voxel crowd when its mean heatmap value is above this."""
    @property
    def unseen(self) -> Literal["fleet", "visible"]:
        """What a drone that does not see a voxel says: "fleet" or "visible"."""
    @property
    def normalise(self) -> bool:
        """Whether the weights of equation 2 are divided by their sum."""
    @property
    def initial(self) -> Literal["zero", "prior", "first"]:
        """P~ before the first look: "zero", "prior" or "first"."""
    @property
    def post_positive(self) -> float:
        """P(A = 1 | b = 1), by Bayes' rule from rates and prior."""
    @property
    def post_negative(self) -> float:
        """P(A = 1 | b = 0), by Bayes' rule from rates and prior."""
    @property
    def default_threshold(self) -> float:
        """Probability from which a voxel is called crowd unless the caller says otherwise: a quarter of
        the way from a place that all drones see empty to one where a single drone of the fleet is sure
        of crowd.
        """
    @property
    def parameters(self) -> dict[str, str | int | float | bool]:
        """What the method was told, by name, for reports."""
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...

@final
class Or:
    """Baseline `or`: a voxel once called crowd by any view stays crowd. Instants may come in any order.

    b_threshold  a view calls a voxel crowd when its mean heatmap value is above this, in [0, 1)

    CrowdfenceError for a threshold out of bounds. It cannot change; it can be compared and pickled.
    """
    def __new__(cls, *, b_threshold: float = 0.5) -> Or: ...
    @property
    def name(self) -> Literal["or"]:
        """Name of the method: "or"."""
    @property
    def b_threshold(self) -> float:
        """A view calls a voxel crowd when its mean heatmap value is above this."""
    @property
    def default_threshold(self) -> float:
        """Probability from which a voxel is called crowd: 0.5, as `or` knows only 0 and 1."""
    @property
    def parameters(self) -> dict[str, str | int | float | bool]:
        """What the method was told, by name, for reports."""
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...

@final
class LikelihoodRatio:
    """How strongly a look speaks for crowd: ln P(m | crowd) / P(m | no crowd) by ground sample distance, tilt
    and mean heatmap value m, as measured on missions whose truth is known.

    gsd_m      [D - 1] metres per pixel at which one bin ends and the next begins, increasing, > 0
    tilt_deg   [T - 1] the same for degrees below the horizon
    mean       [M - 1] the same for m
    log_ratio  [D, T, M] natural logarithm, inside [-20, 20]
    finer      (times, LikelihoodRatio) or None: what was measured of cameras that are so many times as
               fine, in (1, 1000], by their own metres per pixel. A camera between the two lies between what
               both say; a look of a finer one speaks no more against crowd than with theirs

    A value on a border belongs to the bin above, of `mean` to the bin below; what lies beyond the borders
    belongs to the first or the last bin. CrowdfenceError for borders that do not increase and for a table of
    another shape. It cannot change; it can be compared and pickled.
    """
    def __new__(
        cls,
        gsd_m: ArrayLike,
        tilt_deg: ArrayLike,
        mean: ArrayLike,
        log_ratio: ArrayLike,
        finer: tuple[float, LikelihoodRatio] | None = None,
    ) -> LikelihoodRatio: ...
    @property
    def finer(self) -> tuple[float, LikelihoodRatio] | None:
        """How many times as fine the cameras of another table are, and that table; None without one."""
    @property
    def gsd_m(self) -> NDArray[np.float32]:
        """Borders of the ground sample distance [D - 1] float32, metres per pixel."""
    @property
    def tilt_deg(self) -> NDArray[np.float32]:
        """Borders of the tilt [T - 1] float32, degrees below the horizon."""
    @property
    def mean(self) -> NDArray[np.float32]:
        """Borders of the mean heatmap value [M - 1] float32."""
    @property
    def log_ratio(self) -> NDArray[np.float32]:
        """The table [D, T, M] float32."""
    def of(self, gsd_m: float, tilt_deg: float, mean: float) -> float:
        """ln P(m | crowd) / P(m | no crowd) of one look of a camera of this table. CrowdfenceError for a
        gsd_m that is not finite and > 0, a tilt_deg outside [-90, 90] and a mean outside [0, 1].
        """
    def __getnewargs__(self) -> tuple[Any, ...]: ...

@final
class Evidence:
    """Method `evidence`: the log odds of crowd from calibrated looks. Instants may come in any order.

    likelihood   how strongly a look speaks for or against crowd
    prior        P(A = 1) where nobody has looked, strictly between 0 and 1
    memory_s     > 0, after so many seconds a look weighs 1 / e of what it did
    sharp_gsd_m  > 0, metres per pixel up to which a look weighs 1; a coarser one weighs as much less as it
                 has fewer pixels on the same ground
    doubt        > 0, the sharp looks that the prior stands against
    agreement    in [0, 1]: 0 = further drones only average, 1 = they add up as if independent
    threshold    a voxel at or above this probability is crowd, strictly between 0 and 1
    cleared      > 0 and below prior and threshold: up to this probability a voxel is empty; between the two
                 it was looked at, and that showed neither
    focal_px     > 0, of the cameras of the calibration: taken for a view that does not say its own; a look
                 of a finer camera weighs as one of theirs, or where it shows crowd as 1.5 times as fine, and
                 says what those say unless `likelihood` knows finer ones
    from_below   which looks from below the top of a place count: "for", those that show crowd, as that none
                 shows there clears nothing, or "against", those that show none, for what opens ground

    Looks are averaged, because looks at one place agree; only further drones add to them. CrowdfenceError
    names the parameter that is out of bounds. It cannot change; it can be compared and pickled.
    """
    def __new__(
        cls,
        likelihood: LikelihoodRatio,
        *,
        prior: float,
        memory_s: float,
        sharp_gsd_m: float,
        doubt: float,
        agreement: float,
        threshold: float,
        cleared: float,
        focal_px: float,
        from_below: Literal["for", "against"] = "for",
    ) -> Evidence: ...
    @property
    def name(self) -> Literal["evidence"]:
        """Name of the method: "evidence"."""
    @property
    def likelihood(self) -> LikelihoodRatio:
        """How strongly a look speaks for or against crowd."""
    @property
    def b_threshold(self) -> float:
        """Pixels above this show crowd, where crowd that meets no ground is counted; it decides no more."""
    @property
    def cleared(self) -> float:
        """Probability up to which a voxel is called empty."""
    @property
    def default_threshold(self) -> float:
        """Probability from which a voxel is called crowd unless the caller says otherwise."""
    @property
    def parameters(self) -> dict[str, str | int | float | bool]:
        """What the method was told beside the likelihood, by name, for reports."""
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...

@final
class LinearPool:
    """Method `linear-pool`, for comparison: equations 1-3 with the drones that see a place alone, weights
    that sum to 1, and forgetting towards the prior.

    rates        of the detector, which decides P(A | B)
    prior        P(A = 1), strictly between 0 and 1
    alpha        weight of the newest instant, in (0, 1]
    decay        lambda per second, >= 0
    b_threshold  a view calls a voxel crowd when its mean heatmap value is above this, in [0, 1)

    CrowdfenceError names the parameter that is out of bounds. It cannot change; it can be compared and
    pickled.
    """
    def __new__(
        cls,
        rates: Rates,
        prior: float,
        *,
        alpha: float = 0.1,
        decay: float = 0.0005,
        b_threshold: float = 0.5,
    ) -> LinearPool: ...
    @property
    def name(self) -> Literal["linear-pool"]:
        """Name of the method: "linear-pool"."""
    @property
    def b_threshold(self) -> float:
        """A view calls a voxel crowd when its mean heatmap value is above this."""
    @property
    def default_threshold(self) -> float:
        """Probability from which a voxel is called crowd unless the caller says otherwise: a quarter of the
        way from what all drones see empty to what all are sure of.
        """
    @property
    def parameters(self) -> dict[str, str | int | float | bool]:
        """What the method was told, by name, for reports."""
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...

@final
class LogPool:
    """Method `log-pool`, for comparison: the mean of the log likelihood ratios of the drones that see a
    place, blended over time as in equation 3 and forgotten towards the prior.

    likelihood  how strongly a look speaks for or against crowd
    prior       P(A = 1) where nobody has looked, strictly between 0 and 1
    alpha       weight of the newest instant, in (0, 1]
    decay       lambda per second, >= 0
    threshold   a voxel at or above this probability is crowd, strictly between 0 and 1
    focal_px    > 0, of the cameras of the calibration: as of `Evidence`

    CrowdfenceError names the parameter that is out of bounds. It cannot change; it can be compared and
    pickled.
    """
    def __new__(
        cls,
        likelihood: LikelihoodRatio,
        *,
        prior: float,
        alpha: float,
        decay: float,
        threshold: float,
        focal_px: float,
    ) -> LogPool: ...
    @property
    def name(self) -> Literal["log-pool"]:
        """Name of the method: "log-pool"."""
    @property
    def likelihood(self) -> LikelihoodRatio:
        """How strongly a look speaks for or against crowd."""
    @property
    def b_threshold(self) -> float:
        """Pixels above this show crowd, where crowd that meets no ground is counted; it decides no more."""
    @property
    def default_threshold(self) -> float:
        """Probability from which a voxel is called crowd unless the caller says otherwise."""
    @property
    def parameters(self) -> dict[str, str | int | float | bool]:
        """What the method was told beside the likelihood, by name, for reports."""
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...

@final
class LogOdds:
    """Method `log-odds`, for comparison: every look adds to the log odds, between two clamps, as in OctoMap.
    Nothing is forgotten.

    rates        of the detector: what a look with crowd and one without add
    prior        P(A = 1), strictly between 0 and 1
    b_threshold  a view calls a voxel crowd when its mean heatmap value is above this, in [0, 1)
    clamp_low    lowest log odds, below 0
    clamp_high   highest log odds, above 0

    The defaults of prior and clamps are OctoMap's. CrowdfenceError names the parameter that is out of
    bounds. It cannot change; it can be compared and pickled.
    """
    def __new__(
        cls,
        rates: Rates,
        prior: float = 0.5,
        *,
        b_threshold: float = 0.5,
        clamp_low: float = -2.0,
        clamp_high: float = 3.5,
    ) -> LogOdds: ...
    @property
    def name(self) -> Literal["log-odds"]:
        """Name of the method: "log-odds"."""
    @property
    def b_threshold(self) -> float:
        """A view calls a voxel crowd when its mean heatmap value is above this."""
    @property
    def default_threshold(self) -> float:
        """Probability from which a voxel is called crowd: 0.5, as in OctoMap."""
    @property
    def parameters(self) -> dict[str, str | int | float | bool]:
        """What the method was told, by name, for reports."""
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...

@final
class MovingAverage:
    """Method `moving-average`, for comparison: the mean of the calibrated scores of all looks, which fade
    with their age. Instants may come in any order.

    likelihood  how strongly a look speaks for or against crowd
    prior       P(A = 1) where nobody has looked, strictly between 0 and 1
    memory_s    > 0, after so many seconds a look weighs 1 / e of what it did
    threshold   a voxel at or above this probability is crowd, strictly between 0 and 1
    focal_px    > 0, of the cameras of the calibration: as of `Evidence`

    CrowdfenceError names the parameter that is out of bounds. It cannot change; it can be compared and
    pickled.
    """
    def __new__(
        cls, likelihood: LikelihoodRatio, *, prior: float, memory_s: float, threshold: float, focal_px: float
    ) -> MovingAverage: ...
    @property
    def name(self) -> Literal["moving-average"]:
        """Name of the method: "moving-average"."""
    @property
    def likelihood(self) -> LikelihoodRatio:
        """How strongly a look speaks for or against crowd."""
    @property
    def b_threshold(self) -> float:
        """Pixels above this show crowd, where crowd that meets no ground is counted; it decides no more."""
    @property
    def default_threshold(self) -> float:
        """Probability from which a voxel is called crowd unless the caller says otherwise."""
    @property
    def parameters(self) -> dict[str, str | int | float | bool]:
        """What the method was told beside the likelihood, by name, for reports."""
    def __getnewargs_ex__(self) -> tuple[tuple[Any, ...], dict[str, Any]]: ...

@final
class VoxelKnowledge:
    """What is known about voxels, one value each; `CrowdMap.knowledge` makes it."""
    @property
    def state(self) -> NDArray[np.uint8]:
        """`VoxelState` [N] uint8."""
    @property
    def probability(self) -> NDArray[np.float64]:
        """Probability of crowd [N] float64; where nobody has seen a voxel it says nothing about the place."""
    @property
    def age_s(self) -> NDArray[np.float64]:
        """Seconds since the last look [N] float64, NaN = nobody has seen it."""
    @property
    def looks(self) -> NDArray[np.float64]:
        """Looks that the method still remembers [N] float64, in those that weigh 1; NaN = there were none, or
        it does not count them.
        """
    @property
    def drones(self) -> NDArray[np.int64]:
        """How many drones have ever seen it [N] int64."""
    def __len__(self) -> int: ...

@final
class Update:
    """What one instant changed; `CrowdMap.integrate` makes it. It can be compared and pickled."""
    @property
    def stamp_ns(self) -> int:
        """The instant, nanoseconds since the Unix epoch."""
    @property
    def voxel_ids(self) -> NDArray[np.int64]:
        """Voxels seen at this instant by any drone [V] int64, sorted."""
    @property
    def probability(self) -> NDArray[np.float64]:
        """Their probability of crowd after the instant [V] float64."""
    @property
    def observations(self) -> list[Observation]:
        """What each view says about the terrain, in the order of the views."""

@final
class CrowdColumns:
    """The columns of the terrain that hold some voxels, sorted by i, then j: `CrowdMap.crowd_columns` makes
    it of those that hold crowd, `CrowdMap.columns_of` of any.
    """
    @property
    def indices(self) -> NDArray[np.int64]:
        """Grid indices (i, j) [C, 2] int64."""
    @property
    def bottom_index(self) -> NDArray[np.int64]:
        """Grid index k of the lowest voxel of the terrain in each column [C] int64."""
    @property
    def top_index(self) -> NDArray[np.int64]:
        """Grid index k of the highest voxel of the terrain in each column [C] int64."""
    @property
    def probability(self) -> NDArray[np.float64]:
        """Largest probability of these voxels in each column [C] float64."""
    @property
    def last_seen_ns(self) -> NDArray[np.int64]:
        """Stamp of the newest look at any of these voxels in each column [C] int64."""
    @property
    def crowd_count(self) -> NDArray[np.int64]:
        """How many of these voxels are in each column [C] int64, at least 1."""
    @property
    def voxel_ids(self) -> NDArray[np.int64]:
        """The voxels [sum of `crowd_count`] int64, column by column."""
    def __len__(self) -> int: ...

@final
class CrowdMap:
    """Probability of crowd per terrain voxel over time.

    terrain          what the views are projected onto
    method           `Evidence`, `Paper`, `Or`, or one of those for comparison (`LinearPool`, `LogPool`,
                     `LogOdds`, `MovingAverage`)
    max_range_m      > 0, rays end here
    target_height_m  in [0, 100], height above the ground at which people are marked
    coverage         "full" or "rays", see `project`
    surface          "planes" or "voxels", see `project`
    max_gap_s        > 0, longest time between two instants, and between a view and its instant; a longer one
                     is taken for a wrong clock

    A voxel keeps its belief as of its last look, so that an update costs what was seen and not the
    map. One thread may integrate while others read: a reader sees whole instants. CrowdfenceError for
    a parameter out of bounds.
    """
    def __new__(
        cls,
        terrain: Terrain,
        method: Evidence | Paper | Or | LinearPool | LogPool | LogOdds | MovingAverage,
        *,
        max_range_m: float = 300.0,
        target_height_m: float = 0.0,
        coverage: Literal["rays", "full"] = "full",
        surface: Literal["planes", "voxels"] = "planes",
        max_gap_s: float = 3600.0,
    ) -> CrowdMap: ...
    @property
    def terrain(self) -> Terrain:
        """What the views are projected onto."""
    @property
    def method(self) -> Evidence | Paper | Or | LinearPool | LogPool | LogOdds | MovingAverage:
        """The method with its parameters."""
    @property
    def max_range_m(self) -> float:
        """Rays end here, metres."""
    @property
    def target_height_m(self) -> float:
        """Height above the ground at which people are marked, metres."""
    @property
    def coverage(self) -> Literal["rays", "full"]:
        """ "full" or "rays", see `project`."""
    @property
    def surface(self) -> Literal["planes", "voxels"]:
        """ "planes" or "voxels", see `project`."""
    @property
    def max_gap_s(self) -> float:
        """Longest time between two instants, and between a view and its instant, seconds."""
    @property
    def instant_count(self) -> int:
        """Instants integrated so far."""
    @property
    def span_ns(self) -> tuple[int, int] | None:
        """Stamps of the first and of the newest instant, nanoseconds since the Unix epoch; None before
        the first.
        """
    @property
    def drones(self) -> list[str]:
        """Every drone that ever gave a view, by name."""
    def integrate(self, views: Sequence[View], stamp_ns: int) -> Update:
        """Take in the views of one instant, each drone at most once: project, fuse, store.

        stamp_ns  the instant; for `Paper` after the one before, for the others in any order

        A view within 1 s of its instant counts as taken then, an older one at its own stamp. An error
        leaves the map as it was: StampError for an instant or a view whose stamp cannot be right,
        ViewError for a drone that appears twice or makes the fleet larger than `Paper.fleet_size`.
        """
    def integrate_observations(self, observations: Sequence[Observation], stamp_ns: int) -> Update:
        """The same for views that were projected before, onto this very terrain, here or on another
        machine.

        Errors as for `integrate`, and MapFileError for an observation of another terrain.
        """
    def probability(self, stamp_ns: int, ids: ArrayLike | None = None) -> NDArray[np.float64]:
        """Probability of crowd per voxel [V] float64, or of the voxels `ids` [N], at a stamp not before
        the newest instant.

        A voxel that nobody has seen holds the method's initial value, which is no evidence of absence:
        see `state`. StampError for an earlier stamp, CrowdfenceError for an id that does not exist.
        """
    def interval(
        self, stamp_ns: int, ids: ArrayLike | None = None, *, level: float = 0.9
    ) -> NDArray[np.float64] | None:
        """Bounds between which the probability of crowd lies, per voxel [V, 2] float64 or of the voxels
        `ids` [N, 2], at a stamp not before the newest instant. None for all but `Evidence`, whose
        probability is no measured rate.

        level  in (0, 1): how many of such intervals hold the share of crowd among places like theirs

        0 and 1 where nobody has looked. StampError for an earlier stamp, CrowdfenceError for an id that
        does not exist and for a level out of bounds.
        """
    def state(
        self, stamp_ns: int, *, threshold: float | None = None, stale_after_s: float = 30.0
    ) -> NDArray[np.uint8]:
        """`VoxelState` per voxel [V] uint8: unseen is never the same as empty.

        threshold      in (0, 1]: a voxel at or above it is crowd; None = the method's `default_threshold`
        stale_after_s  >= 0: what its last look left empty is stale once that look is older than this

        What is not crowd is empty where the method clears it: `Evidence` asks for evidence, the others do
        not. What its last look did not leave empty stays not cleared, however long ago that was.

        StampError for a stamp before the newest instant, CrowdfenceError for a parameter out of bounds.
        """
    def empty_ids(
        self, stamp_ns: int, *, threshold: float | None = None, stale_after_s: float = 30.0
    ) -> NDArray[np.int64]:
        """The voxels in state `EMPTY`, sorted ids [N] int64. Costs what was seen, not the map.

        Arguments and errors as for `state`.
        """
    def knowledge(
        self,
        ids: ArrayLike,
        stamp_ns: int,
        *,
        threshold: float | None = None,
        stale_after_s: float = 30.0,
    ) -> VoxelKnowledge:
        """All that is known about the voxels `ids` [N] at a stamp not before the newest instant.

        Threshold and stale_after_s as for `state`; CrowdfenceError for an id that does not exist.
        """
    def crowd_columns(self, stamp_ns: int, *, threshold: float | None = None) -> CrowdColumns:
        """The columns of the terrain that hold crowd at a stamp not before the newest instant: what zones
        are drawn on. Costs what holds crowd and what was seen since the last call, not the map.

        threshold  in (0, 1]: a voxel at or above it is crowd; None = the method's `default_threshold`

        StampError for an earlier stamp, CrowdfenceError for a threshold out of bounds.
        """
    def crowd_ids_at_last_looks(self, *, threshold: float | None = None) -> NDArray[np.int64]:
        """The voxels that held crowd when somebody last looked at them, sorted ids [N] int64. What was
        forgotten since takes none away, and crowd that a late view showed is among them.

        threshold  in (0, 1]: what was at or above it held crowd; None = the method's `default_threshold`

        CrowdfenceError for a threshold out of bounds.
        """
    def crowd_ids(self, stamp_ns: int, *, threshold: float | None = None) -> NDArray[np.int64]:
        """The voxels that hold crowd at a stamp not before the newest instant, sorted ids [N] int64. Costs
        what holds crowd and what was seen since the last call, not the map.

        threshold  in (0, 1]: a voxel at or above it is crowd; None = the method's `default_threshold`

        StampError for an earlier stamp, CrowdfenceError for a threshold out of bounds.
        """
    def columns_of(self, ids: ArrayLike, stamp_ns: int) -> CrowdColumns:
        """The columns of the voxels `ids` [N], each given once, at a stamp not before the newest instant.
        Voxels that nobody has seen are left out.

        StampError for an earlier stamp, CrowdfenceError for an id that does not exist.
        """
    def shown_ids(self, stamp_ns: int, *, threshold: float | None = None) -> NDArray[np.int64]:
        """The voxels that a look of the last 2 s by itself showed as crowd, whatever other drones saw there
        at the time; at a stamp not before the newest instant, sorted ids [N] int64. Only `evidence` tells
        looks apart.

        threshold  in (0, 1]: the look alone leaves crowd 2 in log odds above it, and above the prior; None =
                   the method's `default_threshold`

        StampError for an earlier stamp, CrowdfenceError for a threshold out of bounds.
        """
    def shown_ids_at_last_looks(self, *, threshold: float | None = None) -> NDArray[np.int64]:
        """The voxels that such a look showed as crowd when somebody last looked at them, by that look or
        in the 2 s before it, sorted ids [N] int64. How long ago that was takes none away.

        threshold  as for `shown_ids`

        CrowdfenceError for a threshold out of bounds.
        """
    def spoke_for_crowd(self, ids: ArrayLike) -> NDArray[np.bool_]:
        """Whether the last look at each of the voxels `ids` [N] spoke for crowd, [N] bool: it left more of it
        than there was, and more than the method holds of ground that nobody has seen. Of looks that
        an older build wrote to a file it says no. CrowdfenceError for an id that does not exist.
        """
    def seen(self) -> NDArray[np.bool_]:
        """Union of the fields of view so far (equation 4): [V] bool per voxel."""
    def seen_ids(self) -> NDArray[np.int64]:
        """The same as sorted voxel ids [N] int64. Costs what was seen, not the map."""
    @property
    def seen_count(self) -> int:
        """How many voxels somebody has seen."""
    def seen_probability(self, stamp_ns: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """The voxels that somebody has seen, sorted ids [N] int64, and their probability of crowd [N]
        float64 at a stamp not before the newest instant. Costs what was seen, not the map. StampError
        for an earlier stamp.
        """
    def last_seen_ns(self, ids: ArrayLike | None = None) -> NDArray[np.int64]:
        """Stamp of the last look per voxel [V] int64, or at the voxels `ids` [N]; -1 = never.

        CrowdfenceError for an id that does not exist.
        """
    def seen_by(self, ids: ArrayLike) -> list[str]:
        """Drones that have ever seen one of the voxels `ids` [N], by name. A map that was saved by a
        build that did not keep this knows nobody. CrowdfenceError for an id that does not exist.
        """
    def default_threshold(self) -> float:
        """Probability from which a voxel is called crowd unless the caller says otherwise: the method's."""
    def to_bytes(self) -> bytes:
        """The map as bytes, with a checksum; the terrain is not among them."""
    @staticmethod
    def from_bytes(data: bytes, terrain: Terrain) -> CrowdMap:
        """The map that `to_bytes` wrote, on its terrain. MapFileError for bytes that are damaged, of
        another kind, of a newer version or of another terrain.
        """
    def save(self, path: str | PathLike[str]) -> None:
        """Write the map to a file, in one step: what stood there stays until the new file is whole.
        OSError when it cannot be written.
        """
    @staticmethod
    def load(path: str | PathLike[str], terrain: Terrain) -> CrowdMap:
        """The map that `save` wrote, on its terrain. MapFileError as for `from_bytes`, OSError when the
        file cannot be read.
        """

def write_octomap_binary(terrain: Terrain, ids: ArrayLike, moved: tuple[int, int, int] = (0, 0, 0)) -> bytes:
    """OctoMap `.bt` file content: the voxels `ids` [N] of a terrain, occupied.

    CrowdfenceError for an id that does not exist, MapFileError for a grid index beyond the format's -32768 to
    32767. The terrain's origin is not part of it; `moved` [3] is how many voxels are added to each index.
    """

def write_octomap_color(
    terrain: Terrain,
    ids: ArrayLike,
    colors: ArrayLike,
    probability: ArrayLike,
    moved: tuple[int, int, int] = (0, 0, 0),
) -> bytes:
    """OctoMap `.ot` file content (ColorOcTree) of the voxels `ids` [N] of a terrain.

    colors       [N, 3] uint8, red green blue
    probability  [N] in [0, 1], written as the occupancy

    CrowdfenceError for an id that does not exist or an array of another shape, MapFileError for a probability
    out of bounds, an id given twice and a grid index beyond the format's -32768 to 32767. The terrain's
    origin is not part of it; `moved` [3] is how many voxels are added to each index.
    """

def raised(height_m: ArrayLike, top_m: ArrayLike, voxel_size_m: float) -> NDArray[np.float32]:
    """Heights [X, Y] of the middles of voxel columns, and of their highest points where these stand out.

    The height of a column is that of the surface at its middle. A wall of half a metre falls between the
    middles of columns of two metres, and the ground that it hides would be called seen and empty. A column
    whose highest point stands out of the ground by a metre, and by half a voxel, is therefore as high as
    that: a little too much is hidden, never too little. People stand beside a wall, and in its column they
    are counted all the same. On a slope the upper edge of a column lies above its middle; what its neighbours
    on both sides make of that does not count.

    height_m, top_m  float32 [X, Y], metres, of middles and of highest points; NaN is a hole, and stays one
    voxel_size_m     side of a column, > 0

    CrowdfenceError for arrays of different shapes and for another size.
    """

def vibrant(pixels: ArrayLike, gain: float) -> NDArray[np.uint8]:
    """Pixels with their weak colours made stronger: uint8 [H, W, 3] RGB, a copy.

    With y the brightness of a pixel (BT.601), d the differences of its channels from y and c the largest of
    them, each channel becomes y + d * gain / (1 + (gain - 1) * c / 128). Grey stays grey.

    gain  1 to 8; 1 changes nothing

    CrowdfenceError for another shape or gain.
    """
