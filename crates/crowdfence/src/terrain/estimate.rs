//! Where the surface lies in voxels of which nothing else is known, as in an OctoMap.

use super::{Plane, Terrain};

/// Planes by voxel id.
pub(super) fn planes(terrain: &Terrain) -> Vec<Plane> {
    vec![Plane::new(0.5, [0.0, 0.0]); terrain.voxel_count()]
}
