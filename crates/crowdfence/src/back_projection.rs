//! View -> observation: which voxels the camera saw, and the mean heatmap value of each.

use glam::{DVec2, DVec3};
use rayon::prelude::*;

use crate::error::{Result, require};
use crate::observation::{Observation, SeenVoxels};
use crate::raycast::Hit;
use crate::terrain::Terrain;
use crate::terrain::tree::Node;
use crate::view::View;

/// Which voxels count as seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coverage {
    /// The voxels first hit by the ray of some pixel centre, as in the paper.
    Rays,
    /// Also voxels that no pixel centre hits (far away, at grazing angles) but of which a face centre lies in
    /// the image with nothing in front of it. They read the heatmap there and have pixel count 0.
    Full,
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    max_range_m: f64,
    target_height_m: f64,
    coverage: Coverage,
}

impl Projection {
    /// `max_range_m` > 0 limits the distance along the ray. `target_height_m` >= 0 raises the terrain by the
    /// height at which people are marked, which is the same as lowering the camera by it.
    pub fn new(max_range_m: f64, target_height_m: f64, coverage: Coverage) -> Result<Projection> {
        require(max_range_m.is_finite() && max_range_m > 0.0, "max_range_m", max_range_m, "finite and > 0")?;
        require(
            target_height_m.is_finite() && target_height_m >= 0.0,
            "target_height_m",
            target_height_m,
            "finite and >= 0",
        )?;
        Ok(Projection { max_range_m, target_height_m, coverage })
    }

    pub fn max_range_m(&self) -> f64 {
        self.max_range_m
    }

    pub fn target_height_m(&self) -> f64 {
        self.target_height_m
    }

    pub fn coverage(&self) -> Coverage {
        self.coverage
    }
}

/// What a view meets on the terrain. The first three are parallel and sorted by voxel id.
#[derive(Debug, Clone, Default, PartialEq)]
struct Footprint {
    voxel_ids: Vec<u32>,
    /// m_i: mean heatmap value over the pixels whose ray first hits the voxel.
    mean: Vec<f64>,
    pixel_count: Vec<u32>,
    /// With [`Coverage::Full`]: voxels in range of which all bare faces in the image lie behind something.
    occluded_ids: Vec<u32>,
}

impl Footprint {
    fn observed(self, view: &View, terrain: &Terrain) -> Observation {
        let camera = view.world_from_camera.translation;
        let lines: Vec<DVec3> = terrain.centers(&self.voxel_ids).map(|center| center - camera).collect();
        let seen = SeenVoxels {
            ids: self.voxel_ids,
            mean: self.mean,
            pixel_count: self.pixel_count,
            range_m: lines.iter().map(|line| line.length() as f32).collect(),
            tilt_deg: lines.iter().map(|&line| tilt_deg(line)).collect(),
        };
        Observation::new(terrain.key(), view.drone.clone(), view.stamp_ns, seen, self.occluded_ids)
            .expect("a footprint is sorted, and means of a heatmap lie in [0, 1]")
    }
}

/// Of a line of sight, below the horizon.
fn tilt_deg(line: DVec3) -> f32 {
    (-line.z).atan2(line.truncate().length()).to_degrees() as f32
}

/// Back-projects a view. A camera inside an occupied voxel, or one that `target_height_m` would push through
/// the terrain, sees nothing: its rays would pass below the surface and mark places it never saw.
pub fn project(view: &View, terrain: &Terrain, projection: &Projection) -> Observation {
    let pose = &view.world_from_camera;
    let height = projection.target_height_m;
    if terrain.raycast(pose.translation, DVec3::NEG_Z, height).is_some() {
        return Footprint::default().observed(view, terrain);
    }
    let caster = Caster {
        view,
        terrain,
        origin: pose.translation - DVec3::Z * height,
        max_range_m: projection.max_range_m,
    };
    let hit = caster.pixels();
    let footprint = match projection.coverage {
        Coverage::Rays => hit,
        Coverage::Full => caster.with_faces(hit),
    };
    footprint.observed(view, terrain)
}

/// One camera position looking at one terrain.
struct Caster<'a> {
    view: &'a View,
    terrain: &'a Terrain,
    origin: DVec3,
    max_range_m: f64,
}

impl Caster<'_> {
    /// Casts the ray of every pixel centre and averages the heatmap per voxel.
    fn pixels(&self) -> Footprint {
        let camera = &self.view.camera;
        let width = camera.width();
        // Sorting (voxel, pixel) pairs groups the pixels of a voxel in image order, whatever the threads did.
        let mut hits: Vec<u64> = (0..camera.height() * width)
            .into_par_iter()
            .filter_map(|pixel| {
                let hit = self.cast(camera.pixel_ray(pixel % width, pixel / width)?)?;
                Some(u64::from(hit.voxel_id) << 32 | u64::from(pixel))
            })
            .collect();
        hits.par_sort_unstable();
        let mut observation = Footprint::default();
        for group in hits.chunk_by(|a, b| a >> 32 == b >> 32) {
            let sum: f64 = group
                .iter()
                .map(|&hit| {
                    let pixel = hit as u32;
                    f64::from(self.view.value_at(pixel % width, pixel / width))
                })
                .sum();
            observation.voxel_ids.push((group[0] >> 32) as u32);
            observation.mean.push(sum / group.len() as f64);
            observation.pixel_count.push(group.len() as u32);
        }
        observation
    }

    fn cast(&self, ray_camera: DVec3) -> Option<Hit> {
        let direction = self.view.world_from_camera.rotation * ray_camera;
        self.terrain.raycast(self.origin, direction, self.max_range_m)
    }

    /// Adds the voxels of which a face is visible although no pixel centre hits them, and lists the hidden ones.
    fn with_faces(&self, hit: Footprint) -> Footprint {
        let cone = self.viewing_cone();
        let looks: Vec<(u32, Look)> = self
            .voxels_inside(&cone)
            .into_par_iter()
            .filter(|id| hit.voxel_ids.binary_search(id).is_err())
            .filter_map(|id| Some((id, self.look_at(id)?)))
            .collect();
        let mut rows: Vec<(u32, f64, u32)> = (0..hit.voxel_ids.len())
            .map(|at| (hit.voxel_ids[at], hit.mean[at], hit.pixel_count[at]))
            .collect();
        let mut occluded_ids = Vec::new();
        for (id, look) in looks {
            match look {
                Look::Seen(value) => rows.push((id, value, 0)),
                Look::Occluded => occluded_ids.push(id),
            }
        }
        rows.sort_unstable_by_key(|row| row.0);
        occluded_ids.sort_unstable();
        Footprint {
            voxel_ids: rows.iter().map(|row| row.0).collect(),
            mean: rows.iter().map(|row| row.1).collect(),
            pixel_count: rows.iter().map(|row| row.2).collect(),
            occluded_ids,
        }
    }

    /// Depth test of a voxel's faces; None when nothing of it lies in the image and in range.
    ///
    /// The test goes to the centre of each bare face that is turned to the camera, not to the voxel's centre:
    /// at a grazing angle the voxels in front hide every centre of a plain, while their tops are in full view.
    fn look_at(&self, id: u32) -> Option<Look> {
        let faces = self.bare_faces_towards_camera(id);
        let looks: Vec<Option<f32>> = faces.filter_map(|face| self.look_at_face(id, face)).collect();
        let seen: Vec<f32> = looks.iter().flatten().copied().collect();
        if looks.is_empty() {
            None
        } else if seen.is_empty() {
            Some(Look::Occluded)
        } else {
            let sum: f64 = seen.iter().copied().map(f64::from).sum();
            Some(Look::Seen(sum / seen.len() as f64))
        }
    }

    /// Centres of the voxel's faces that are turned to the camera and have no voxel before them.
    fn bare_faces_towards_camera(&self, id: u32) -> impl Iterator<Item = DVec3> {
        let (index, center) = (self.terrain.index(id), self.terrain.center(id));
        // A hair inside the voxel, so that the ray to a face enters the voxel behind it.
        let to_face = 0.5 * self.terrain.voxel_size_m() * (1.0 - 1e-6);
        DVec3::AXES.into_iter().enumerate().filter_map(move |(axis, normal)| {
            let offset = (self.origin - center)[axis];
            let mut neighbour = index;
            neighbour[axis] = neighbour[axis].checked_add(offset.signum() as i32)?;
            let bare = offset.abs() > to_face && self.terrain.id(neighbour).is_none();
            bare.then_some(center + normal * offset.signum() * to_face)
        })
    }

    /// None when the point lies outside the image or the range, Some(None) when something hides it, else the
    /// heatmap value there.
    fn look_at_face(&self, id: u32, face: DVec3) -> Option<Option<f32>> {
        let to_face = face - self.origin;
        if to_face.length() > self.max_range_m {
            return None;
        }
        let camera = &self.view.camera;
        let pixel = camera.project(self.view.world_from_camera.rotation.transpose() * to_face)?;
        if !camera.contains(pixel) {
            return None;
        }
        let hit = self.terrain.raycast(self.origin, to_face, self.max_range_m);
        let visible = hit.is_some_and(|hit| hit.voxel_id == id);
        Some(visible.then(|| self.view.value_at(pixel.x as u32, pixel.y as u32)))
    }

    /// Cone around the optical axis that holds the rays of the image's edge, every pixel corner of it. A
    /// blind corner gives no bound: then every direction is a candidate.
    fn viewing_cone(&self) -> Cone {
        let camera = &self.view.camera;
        let (width, height) = (camera.width(), camera.height());
        let edge = (0..=width)
            .flat_map(|u| [(u, 0), (u, height)])
            .chain((0..=height).flat_map(|v| [(0, v), (width, v)]));
        let angle = |(u, v): (u32, u32)| {
            let ray = camera.unproject(DVec2::new(f64::from(u), f64::from(v)));
            ray.map_or(std::f64::consts::PI, |ray| ray.angle_between(DVec3::Z))
        };
        // Between two corners of the edge the angle may be a little larger, by far less than a pixel.
        let widest = edge.map(angle).fold(0.0, f64::max);
        let axis = self.view.world_from_camera.rotation * DVec3::Z;
        Cone { axis, half_angle: widest + 1.0 / camera.fx().min(camera.fy()) }
    }

    /// Voxels of which a part may lie in the cone and in range.
    fn voxels_inside(&self, cone: &Cone) -> Vec<u32> {
        let tree = self.terrain.tree();
        let root = tree.depth() - 1;
        let mut frontier = vec![TreeCell { node: tree.node(root, 0), low: [0; 3], level: root }];
        // Breadth first down to the bricks, each level in parallel: nodes that miss the cone drop out early.
        for _ in 0..root {
            frontier = frontier
                .par_iter()
                .flat_map_iter(|cell| {
                    cell.children().filter_map(|(child, low)| {
                        let level = cell.level - 1;
                        self.may_see(cone, low, 1 << (2 * (level + 1))).then(|| TreeCell {
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
                brick.children().filter(|(_, low)| self.may_see(cone, *low, 1)).map(|(id, _)| id)
            })
            .collect()
    }

    /// False only when no point of the cube (tree coordinates, side in voxels) is in the cone and in range.
    fn may_see(&self, cone: &Cone, low: [u32; 3], side: u32) -> bool {
        let side = f64::from(side);
        let center = DVec3::from(low.map(f64::from)) + 0.5 * side;
        let to_center = (center - self.terrain.tree_from_world(self.origin)) * self.terrain.voxel_size_m();
        let radius = 0.5 * 3f64.sqrt() * side * self.terrain.voxel_size_m();
        let distance = to_center.length();
        if distance <= radius {
            return true;
        }
        distance - radius <= self.max_range_m
            && to_center.angle_between(cone.axis) - (radius / distance).asin() <= cone.half_angle
    }
}

enum Look {
    Seen(f64),
    Occluded,
}

struct Cone {
    axis: DVec3,
    half_angle: f64,
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

#[cfg(test)]
mod tests;
