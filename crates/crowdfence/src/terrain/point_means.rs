//! Where in their voxels points lie on average.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::Terrain;

/// By voxel id.
pub(super) struct PointMeans {
    means: Vec<Mean>,
}

#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    /// In voxels from the voxel's lowest corner.
    point: Vec3,
    count: f32,
}

impl PointMeans {
    /// Of points in voxels from the terrain's origin, which all lie in voxels of it; `indices` says in which.
    pub fn of(terrain: &Terrain, points: impl Iterator<Item = DVec3>, indices: &[[i32; 3]]) -> PointMeans {
        let mut means = vec![Mean::default(); terrain.voxel_count()];
        let id = |&index: &[i32; 3]| terrain.id(index).expect("every point has its voxel");
        let ids: Vec<u32> = indices.par_iter().map(id).collect();
        for (point, id) in points.zip(ids) {
            let mean = &mut means[id as usize];
            mean.count += 1.0;
            mean.point += ((point - point.floor()).as_vec3() - mean.point) / mean.count;
        }
        PointMeans { means }
    }

    /// In voxels from the centre of the voxel's column, and above its floor.
    pub fn of_voxel(&self, id: u32) -> [f64; 3] {
        (self.means[id as usize].point.as_dvec3() - DVec3::new(0.5, 0.5, 0.0)).to_array()
    }
}
