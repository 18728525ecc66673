//! Which voxels a view may see at all: those that a cone around the optical axis touches, in range.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::Vantage;
use crate::camera::Camera;
use crate::terrain::tree::{Branch, Cell};
use crate::terrain::{Solid, Terrain};

pub(super) struct ViewingCone<'a> {
    terrain: &'a Terrain,
    /// Tree coordinates.
    apex: DVec3,
    axis: DVec3,
    half_angle: f64,
    max_range_m: f64,
}

impl<'a> ViewingCone<'a> {
    pub fn of(vantage: &Vantage<'a>) -> ViewingCone<'a> {
        ViewingCone {
            terrain: vantage.terrain,
            apex: vantage.terrain.tree_from_world(vantage.origin),
            axis: vantage.view.world_from_camera.rotation * DVec3::Z,
            half_angle: half_angle(&vantage.view.camera),
            max_range_m: vantage.max_range_m,
        }
    }

    /// Ids of the voxels of which a part may lie in the cone and in range, sorted.
    pub fn voxels(&self) -> Vec<u32> {
        let tree = self.terrain.tree();
        let mut branches = vec![tree.root()];
        // Breadth first, each level in parallel: branches that miss the cone drop out early.
        for _ in 0..tree.depth() {
            branches = branches
                .par_iter()
                .flat_map_iter(|&branch| tree.children(branch).filter(|child| self.may_hold(child.cell)))
                .collect();
        }
        branches.into_iter().filter_map(Branch::voxel_id).collect()
    }

    /// False only when no point of the cell is in the cone and in range.
    fn may_hold(&self, cell: Cell) -> bool {
        let side = f64::from(cell.side);
        let center = DVec3::from(cell.low.map(f64::from)) + 0.5 * side;
        let to_center = (center - self.apex) * self.terrain.voxel_size_m();
        // The surface may leave its voxel upwards and downwards.
        let half_height = 0.5 * side + f64::from(Solid::RISE.max(Solid::SINK));
        let radius = DVec3::new(0.5 * side, 0.5 * side, half_height).length() * self.terrain.voxel_size_m();
        let distance = to_center.length();
        if distance <= radius {
            return true;
        }
        distance - radius <= self.max_range_m
            && to_center.angle_between(self.axis) - (radius / distance).asin() <= self.half_angle
    }
}

/// Widest angle off the axis of any ray of the image: of its edge, every pixel corner of it. A blind corner
/// gives no bound: then every direction is inside.
fn half_angle(camera: &Camera) -> f64 {
    let (width, height) = (camera.width(), camera.height());
    let edge = (0..=width)
        .flat_map(|u| [(u, 0), (u, height)])
        .chain((0..=height).flat_map(|v| [(0, v), (width, v)]));
    let angle = |(u, v): (u32, u32)| {
        let ray = camera.unproject(DVec2::new(f64::from(u), f64::from(v)));
        ray.map_or(PI, |ray| ray.angle_between(DVec3::Z))
    };
    // Between two corners of the edge the angle may be a little larger, by far less than a pixel.
    edge.map(angle).fold(0.0, f64::max) + 1.0 / camera.fx().min(camera.fy())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    proptest! {
        /// Dropping whole branches misses nothing.
        #[test]
        fn no_voxel_with_its_centre_in_the_cone_is_left_out(
            voxels in prop::collection::vec(prop::array::uniform3(0i32..80), 1..200),
            apex in prop::array::uniform3(-20.0..100.0f64),
            axis in prop::array::uniform3(-1.0..1.0f64),
            half_angle in 0.0..3.0f64,
            max_range_m in 0.0..100.0f64,
        ) {
            let terrain = &Terrain::from_indices(&voxels, 0.5, DVec3::ZERO).unwrap();
            let axis = DVec3::from(axis).normalize_or(DVec3::Z);
            let apex_world = DVec3::from(apex) * 0.5;
            let apex = terrain.tree_from_world(apex_world);
            let found = ViewingCone { terrain, apex, axis, half_angle, max_range_m }.voxels();
            prop_assert!(found.is_sorted_by(|a, b| a < b));
            for id in 0..terrain.voxel_count() as u32 {
                let ray = terrain.center(id) - apex_world;
                let inside = ray.length() < max_range_m - 1e-9 && ray.angle_between(axis) < half_angle - 1e-9;
                prop_assert!(!inside || found.binary_search(&id).is_ok(), "voxel {id} at {ray}");
            }
        }
    }
}
