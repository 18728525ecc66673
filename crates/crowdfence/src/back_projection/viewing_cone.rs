//! Which voxels a view may see at all: those that a cone around the optical axis touches, in range.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use super::Vantage;
use crate::camera::Camera;
use crate::terrain::Terrain;
use crate::terrain::tree::Node;

pub(super) struct ViewingCone {
    apex: DVec3,
    axis: DVec3,
    half_angle: f64,
    max_range_m: f64,
}

impl ViewingCone {
    pub fn of(vantage: &Vantage) -> ViewingCone {
        ViewingCone {
            apex: vantage.origin,
            axis: vantage.view.world_from_camera.rotation * DVec3::Z,
            half_angle: half_angle(&vantage.view.camera),
            max_range_m: vantage.max_range_m,
        }
    }

    /// Ids of the voxels of which a part may lie in the cone and in range, sorted.
    pub fn voxels(&self, terrain: &Terrain) -> Vec<u32> {
        let tree = terrain.tree();
        let root = tree.depth() - 1;
        let mut frontier = vec![TreeCell { node: tree.node(root, 0), low: [0; 3], level: root }];
        // Breadth first down to the bricks, each level in parallel: nodes that miss the cone drop out early.
        for _ in 0..root {
            frontier = frontier
                .par_iter()
                .flat_map_iter(|cell| {
                    cell.children().filter_map(|(child, low)| {
                        let level = cell.level - 1;
                        self.may_touch(terrain, low, 1 << (2 * (level + 1))).then(|| TreeCell {
                            node: tree.node(level, child),
                            low,
                            level,
                        })
                    })
                })
                .collect();
        }
        frontier
            .par_iter()
            .flat_map_iter(|brick| {
                brick.children().filter(|(_, low)| self.may_touch(terrain, *low, 1)).map(|(id, _)| id)
            })
            .collect()
    }

    /// False only when no point of the cube (tree coordinates, side in voxels) is in the cone and in range.
    fn may_touch(&self, terrain: &Terrain, low: [u32; 3], side: u32) -> bool {
        let side = f64::from(side);
        let center = DVec3::from(low.map(f64::from)) + 0.5 * side;
        let to_center = (center - terrain.tree_from_world(self.apex)) * terrain.voxel_size_m();
        let radius = 0.5 * 3f64.sqrt() * side * terrain.voxel_size_m();
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

struct TreeCell {
    node: Node,
    /// Lowest corner in tree coordinates.
    low: [u32; 3],
    level: u32,
}

impl TreeCell {
    /// Index one level below (a voxel id at level 0) and lowest corner of each child.
    fn children(&self) -> impl Iterator<Item = (u32, [u32; 3])> {
        let (node, low, shift) = (self.node, self.low, 2 * self.level);
        (0..64).filter(move |&cell| node.has(cell)).map(move |cell| {
            let offset = [cell & 3, cell >> 2 & 3, cell >> 4];
            (node.child(cell), std::array::from_fn(|k| low[k] + (offset[k] << shift)))
        })
    }
}
