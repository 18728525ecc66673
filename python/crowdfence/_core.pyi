"""Typed face of the compiled core (Rust crate `crowdfence`). Arrays in, arrays out; no files, no clock.

Conventions everywhere: world = local ENU metres (x east, y north, z up), float64; camera = OpenCV axes
(x right, y down, z forward); continuous pixel coordinates, the centre of pixel (column i, row j) is at
(i + 0.5, j + 0.5); `stamp_ns` = int64 nanoseconds since the Unix epoch; durations and rates in seconds.

Everything here raises ValueError, with the offending value and its bound, for input that cannot be used.
"""

from collections.abc import Sequence
from os import PathLike
from typing import Any, Literal, final

import numpy as np
from numpy.typing import ArrayLike, NDArray

from crowdfence.georeference import Georeference

__all__ = [
    "Camera",
    "CrowdMap",
    "Observation",
    "Or",
    "Paper",
    "Rates",
    "Terrain",
    "Update",
    "View",
    "__version__",
    "blend",
    "pool",
    "project",
    "write_octomap_binary",
    "write_octomap_color",
]

__version__: str

@final
class Camera:
    """Intrinsics of one camera: pinhole with optional Brown-Conrady or Kannala-Brandt distortion."""

    @staticmethod
    def pinhole(
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        distortion: Sequence[float] | None = None,
    ) -> Camera:
        """Pinhole camera; `distortion` = (k1, k2, p1, p2[, k3]) in OpenCV's order (Brown-Conrady)."""
    @staticmethod
    def fisheye(
        width: int,
        height: int,
        fx: float,
        fy: float,
        cx: float,
        cy: float,
        distortion: Sequence[float] = (0.0, 0.0, 0.0, 0.0),
    ) -> Camera:
        """Kannala-Brandt camera; `distortion` = (k1, k2, k3, k4) as in OpenCV's fisheye module."""
    @property
    def width(self) -> int: ...
    @property
    def height(self) -> int: ...
    @property
    def fx(self) -> float: ...
    @property
    def fy(self) -> float: ...
    @property
    def cx(self) -> float: ...
    @property
    def cy(self) -> float: ...
    @property
    def model(self) -> Literal["pinhole", "brown_conrady", "kannala_brandt"]: ...
    @property
    def distortion(self) -> list[float]:
        """[] for a plain pinhole, [k1, k2, p1, p2, k3] or [k1, k2, k3, k4]."""
    def project(self, points_camera: ArrayLike) -> NDArray[np.float64]:
        """Points [N, 3] in camera axes -> pixels [N, 2]; NaN where the camera cannot see the direction."""
    def unproject(self, pixels: ArrayLike) -> NDArray[np.float64]:
        """Pixels [N, 2] -> unit rays [N, 3] in camera axes.

        ValueError names the first pixel at which the distortion cannot be inverted.
        """
    def blind_pixel_count(self) -> int:
        """How many pixel centres have no ray because the distortion cannot be inverted there."""

@final
class View:
    """What one drone saw at one instant."""

    def __new__(
        cls,
        drone: str,
        stamp_ns: int,
        camera: Camera,
        world_from_camera: ArrayLike,
        heatmap: ArrayLike,
    ) -> View:
        """`world_from_camera` [4, 4] rigid transform, camera axes -> local ENU metres; `heatmap` [h, w]
        float32/float64 in [0, 1] or uint8 (value / 255), at any stride of the image."""
    @property
    def drone(self) -> str: ...
    @property
    def stamp_ns(self) -> int: ...
    @property
    def camera(self) -> Camera: ...
    @property
    def world_from_camera(self) -> NDArray[np.float64]: ...
    @property
    def heatmap(self) -> NDArray[np.float32]: ...

@final
class Terrain:
    """Sparse voxel surface. Voxel (i, j, k) is the half-open box
    [origin + (i, j, k) * voxel_size_m, origin + (i + 1, j + 1, k + 1) * voxel_size_m).
    Voxel ids are ranks 0 .. voxel_count - 1 in the terrain's tree and index every per-voxel array."""

    @staticmethod
    def from_occupancy(
        occupied: NDArray[np.bool_], voxel_size_m: float, origin: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Terrain:
        """Occupied cells of a [X, Y, Z] array become voxels."""
    @staticmethod
    def from_height_map(
        height_m: ArrayLike,
        cell_size_m: float,
        voxel_size_m: float | None = None,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> Terrain:
        """Height map [X, Y] (first axis east, second north), value = height in metres above origin z at the
        cell's centre; cell (i, j) covers origin + [i, i + 1) x [j, j + 1) * cell_size_m. NaN is a hole.
        The surface is closed: a column also fills the step down to its lowest neighbour."""
    @staticmethod
    def from_points(
        points: ArrayLike, voxel_size_m: float, origin: Sequence[float] = (0.0, 0.0, 0.0)
    ) -> Terrain:
        """Every voxel that holds at least one of the points [N, 3] (world metres)."""
    @staticmethod
    def from_triangles(
        vertices: ArrayLike,
        triangles: ArrayLike,
        voxel_size_m: float,
        origin: Sequence[float] = (0.0, 0.0, 0.0),
    ) -> Terrain:
        """Every voxel that a triangle touches. vertices [N, 3] world metres, triangles [M, 3] indices."""
    @staticmethod
    def from_octomap(data: bytes, *, origin: Sequence[float] = (0.0, 0.0, 0.0)) -> Terrain:
        """Occupied leaves of an OctoMap file (.bt or .ot bytes); pruned leaves are expanded.
        `origin` is added to the file's coordinates."""
    @staticmethod
    def open(
        path: str | PathLike[str],
        *,
        voxel_size_m: float | None = None,
        georeference: Georeference | None = None,
        **options: Any,
    ) -> Terrain:
        """Read .bt .ot .tif .laz .las .ply .obj; see `crowdfence.maps.open_terrain` for the options."""
    @property
    def voxel_count(self) -> int: ...
    @property
    def voxel_size_m(self) -> float: ...
    @property
    def origin(self) -> tuple[float, float, float]: ...
    @property
    def bounds(self) -> NDArray[np.float64]:
        """[2, 3]: lowest and highest corner of the occupied voxels, world metres."""
    @property
    def tree_bytes(self) -> int:
        """Memory of the tree."""
    @property
    def fingerprint(self) -> int:
        """Checksum of geometry and voxels; equal terrains have equal fingerprints."""
    georeference: Georeference | None
    """Where on Earth the local frame lies, when known."""
    def raycast(
        self, origins: ArrayLike, directions: ArrayLike, max_range_m: float
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """First occupied voxel along each ray: (voxel_ids [N], -1 = none; distances_m [N], inf = none).

        origins and directions [N, 3] world; directions need not be unit length. The distance is to the
        point where the ray enters the voxel (0 when it starts inside)."""
    def voxel_centers(self, ids: ArrayLike) -> NDArray[np.float64]:
        """World coordinates [N, 3] of the voxels' centres."""
    def voxel_indices(self, ids: ArrayLike) -> NDArray[np.int64]:
        """Grid indices (i, j, k) [N, 3]."""
    def voxel_ids(self, indices: ArrayLike) -> NDArray[np.int64]:
        """Ids [N] of grid indices [N, 3], -1 where there is no voxel."""
    def with_origin(self, origin: Sequence[float]) -> Terrain:
        """The same voxels in a frame shifted so that index (0, 0, 0) starts at `origin`."""

@final
class Observation:
    """What one view says about the terrain (arrays of equal length V, sorted by voxel id)."""

    @property
    def voxel_ids(self) -> NDArray[np.int64]: ...
    @property
    def mean(self) -> NDArray[np.float64]:
        """m_i: mean heatmap value over the pixels whose ray first hits the voxel."""
    @property
    def pixel_count(self) -> NDArray[np.int64]: ...
    @property
    def occluded_ids(self) -> NDArray[np.int64]:
        """coverage="full": voxels inside the image and in range that something hides. Empty for "rays"."""

def project(
    view: View,
    terrain: Terrain,
    *,
    max_range_m: float,
    target_height_m: float = 0.0,
    coverage: Literal["rays", "full"] = "rays",
) -> Observation:
    """Back-project a view onto the terrain: mean heatmap value per visible voxel."""

@final
class Rates:
    """Detector rates: true_positive = P(B=1 | A=1), false_positive = P(B=1 | A=0), both inside (0, 1)."""

    def __new__(cls, true_positive: float, false_positive: float) -> Rates: ...
    @property
    def true_positive(self) -> float: ...
    @property
    def false_positive(self) -> float: ...
    @property
    def false_negative(self) -> float: ...
    @property
    def true_negative(self) -> float: ...

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
    """Linear opinion pool, equations 1-2. m [N, V] and visible [N, V] -> (probability [V], seen [V])."""

def blend(
    previous: ArrayLike,
    elapsed_s: ArrayLike,
    pooled: ArrayLike,
    seen: ArrayLike,
    *,
    alpha: float,
    decay_per_s: float,
) -> NDArray[np.float64]:
    """Temporal blending with decay, equation 3. All arrays [V] -> [V]."""

@final
class Paper:
    """Method `paper`: equations 1-3 with a switch for everything that the paper leaves open."""

    def __new__(
        cls,
        rates: Rates,
        prior: float,
        *,
        alpha: float = 0.1,
        decay_per_s: float = 0.0005,
        fleet_size: int,
        b_threshold: float = 0.5,
        unseen: Literal["fleet", "visible"] = "fleet",
        normalise: bool = False,
        initial: Literal["zero", "prior", "first"] = "zero",
        decay_unit: Literal["second", "frame"] = "second",
    ) -> Paper: ...
    @property
    def rates(self) -> Rates: ...
    @property
    def prior(self) -> float: ...
    @property
    def alpha(self) -> float: ...
    @property
    def decay_per_s(self) -> float:
        """lambda, per second or per instant as `decay_unit` says."""
    @property
    def fleet_size(self) -> int: ...
    @property
    def post_positive(self) -> float:
        """P(A=1 | b=1)."""
    @property
    def post_negative(self) -> float:
        """P(A=1 | b=0)."""

@final
class Or:
    """Baseline `or`: a voxel once called crowd (m > b_threshold in any view) stays crowd."""

    def __new__(cls, *, fleet_size: int, b_threshold: float = 0.5) -> Or: ...
    @property
    def fleet_size(self) -> int: ...
    @property
    def b_threshold(self) -> float: ...

@final
class Update:
    """What one instant changed."""

    @property
    def stamp_ns(self) -> int: ...
    @property
    def voxel_ids(self) -> NDArray[np.int64]:
        """Voxels seen at this instant by any drone, sorted."""
    @property
    def probability(self) -> NDArray[np.float64]:
        """Their probability after this instant."""
    @property
    def observations(self) -> list[Observation]:
        """One per view, in the order given."""

@final
class CrowdMap:
    """Probability of crowd per terrain voxel over time."""

    def __new__(
        cls,
        terrain: Terrain,
        method: Paper | Or,
        *,
        max_range_m: float = 300.0,
        target_height_m: float = 0.0,
        coverage: Literal["rays", "full"] = "rays",
        max_gap_s: float = 3600.0,
    ) -> CrowdMap: ...
    @property
    def terrain(self) -> Terrain: ...
    @property
    def method(self) -> Paper | Or: ...
    @property
    def stamps_ns(self) -> NDArray[np.int64]:
        """Stamps of the instants integrated so far."""
    def integrate(self, views: Sequence[View], stamp_ns: int) -> Update:
        """Project, pool, blend. An error leaves the map as it was."""
    def integrate_observations(
        self, drones: Sequence[str], observations: Sequence[Observation], stamp_ns: int
    ) -> Update:
        """Pool, blend: the same for views that were projected onto this terrain before, one drone each."""
    def probability(self, stamp_ns: int, ids: ArrayLike | None = None) -> NDArray[np.float64]:
        """P~ per voxel [V], or of the voxels `ids`, at a stamp not before the last instant.

        A voxel that nobody has seen holds the method's initial value, which is no evidence of absence: see
        `state`."""
    def state(
        self, stamp_ns: int, *, threshold: float | None = None, stale_after_s: float = 30.0
    ) -> NDArray[np.uint8]:
        """`VoxelState` per voxel [V]: unseen is never the same as empty.

        Crowd is P~ >= `threshold` (default: `default_threshold()`); what is not crowd is stale once its last
        look is more than `stale_after_s` old."""
    def seen(self) -> NDArray[np.bool_]:
        """Union of the fields of view so far [V] (equation 4)."""
    def seen_ids(self) -> NDArray[np.int64]:
        """The same as sorted voxel ids. Costs what was seen, not the map."""
    def last_seen_ns(self) -> NDArray[np.int64]:
        """Stamp of the last look per voxel [V], -1 = never."""
    def default_threshold(self) -> float:
        """Probability above which a voxel is called crowd unless the caller says otherwise."""
    def to_bytes(self) -> bytes: ...
    @staticmethod
    def from_bytes(data: bytes, terrain: Terrain) -> CrowdMap: ...
    def save(self, path: str | PathLike[str]) -> None:
        """Write atomically (temporary file, then rename)."""
    @staticmethod
    def load(path: str | PathLike[str], terrain: Terrain) -> CrowdMap:
        """ValueError for a damaged file, a newer version, or a map of another terrain."""

def write_octomap_binary(terrain: Terrain, ids: ArrayLike) -> bytes:
    """OctoMap `.bt` file content: the voxels `ids` [N], occupied."""

def write_octomap_color(terrain: Terrain, ids: ArrayLike, colors: ArrayLike, probability: ArrayLike) -> bytes:
    """OctoMap `.ot` file content (ColorOcTree): voxels `ids` [N], colors [N, 3] uint8, probability [N]
    as occupancy."""
