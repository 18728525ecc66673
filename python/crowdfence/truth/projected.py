"""Ground truth on the terrain, projected from the labelled images of the drones themselves."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

if TYPE_CHECKING:
    from crowdfence._core import Camera, Terrain


class ProjectedTruth(NamedTuple):
    """What one labelled image says about the terrain (arrays of equal length)."""

    voxel_ids: NDArray[np.int64]
    """Voxels that the image shows, sorted."""
    crowd: NDArray[np.bool_]
    """Whether the voxel is crowd in this image."""

    @property
    def crowd_ids(self) -> NDArray[np.int64]:
        """Voxels that are crowd in this image, sorted."""
        return self.voxel_ids[self.crowd]


def project_truth(
    mask: ArrayLike,
    camera: Camera,
    world_from_camera: ArrayLike,
    terrain: Terrain,
    *,
    max_range_m: float,
    target_height_m: float = 0.0,
    coverage: Literal["rays", "full"] = "full",
    surface: Literal["planes", "voxels"] = "planes",
) -> ProjectedTruth:
    """Project the crowd regions of one image onto the terrain, the way `project` does with a heatmap.

    `mask` is bool [camera.height, camera.width], as from `crowd_regions`. A voxel is crowd when at least half
    of the pixels that show it are. The other arguments are those of `View` and `project`; give the truth the
    same `target_height_m` as the map that is compared with it.

    Raises ValueError for a mask of another kind or shape.
    """
    from crowdfence._core import View, project

    regions = np.asarray(mask)
    if regions.dtype != np.bool_ or regions.shape != (camera.height, camera.width):
        raise ValueError(
            f"mask must be bool [{camera.height}, {camera.width}], got {regions.dtype} {list(regions.shape)}"
        )
    view = View("truth", 0, camera, world_from_camera, regions.astype(np.uint8) * np.uint8(255))
    seen = project(
        view,
        terrain,
        max_range_m=max_range_m,
        target_height_m=target_height_m,
        coverage=coverage,
        surface=surface,
    )
    return ProjectedTruth(seen.voxel_ids, seen.mean >= 0.5)


class TruthMap:
    """Projected ground truth over time: every voxel keeps the label it was last seen with.

    This is the truth that the paper's IoU is taken against. It knows no more than the drones saw: a crowd
    that walks away unseen stays in it. `world_truth` is the truth that does not depend on any view.
    """

    def __init__(self, voxel_count: int) -> None:
        if voxel_count < 1:
            raise ValueError(f"voxel_count must be at least 1, got {voxel_count}")
        self._crowd = np.zeros(voxel_count, np.bool_)
        self._seen = np.zeros(voxel_count, np.bool_)

    @property
    def crowd(self) -> NDArray[np.bool_]:
        """Label per voxel [V]; False for voxels that nobody has seen (see `seen`). A copy."""
        return self._crowd.copy()

    @property
    def seen(self) -> NDArray[np.bool_]:
        """Voxels that some image has shown [V]. A copy."""
        return self._seen.copy()

    def update(self, views: Iterable[ProjectedTruth]) -> None:
        """Take in the labelled views of one instant: a voxel that they show is crowd if any of them says so.

        ValueError for ids outside the map; the map is then as it was.
        """
        instant = list(views)
        for view in instant:
            ids = view.voxel_ids
            if ids.size and not (ids.min() >= 0 and ids.max() < self._seen.size):
                raise ValueError(
                    f"voxel ids {ids.min()} to {ids.max()} do not fit a map of {self._seen.size} voxels"
                )
        for view in instant:  # all labels of the instant first, so that their order does not matter
            self._seen[view.voxel_ids] = True
            self._crowd[view.voxel_ids] = False
        for view in instant:
            self._crowd[view.crowd_ids] = True
