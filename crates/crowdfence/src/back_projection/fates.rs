//! What became of the crowd in a picture. Each pixel that shows crowd has one ray, and each ray one fate, the first
//! of these that fits:
//!
//! ```text
//! unusable      there is no ray: the lens model gives the pixel none, or the camera is under ground: so little above it
//!               that its target would be, or below the map or in one of its solids, where no ray tells anything
//! ground        it hits a voxel within the range
//! out_of_range  it hits one further on
//! sky           it does not descend, so it meets no ground behind what it has missed
//! hole          it descends through the map's bounding box, and where it leaves the box, ground lies above it, or no
//!               voxel lies there but the map goes on in all four directions of the compass: on its way it passed
//!               through ground of which the map knows nothing
//! off_map       it descends past the map: beside its bounding box, or through the box and out over the map's edge,
//!               to ground that the map does not reach
//! ```
//!
//! A ray that falls through a hole and meets the ground further on from below has met ground, here as in the
//! observation: the map has a surface there and no inside.
//!
//! The reference says already which pixels met ground; only those that show crowd and met none are cast again,
//! without a range. A view whose crowd is all on the map costs a look at its pixels, one without crowd less.

use glam::DVec3;
use rayon::prelude::*;

use super::Vantage;
use crate::observation::CrowdMass;
use crate::view::View;

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Fate {
    Ground,
    OutOfRange,
    Hole,
    OffMap,
    Sky,
    Unusable,
}

impl Vantage<'_> {
    /// Of a pixel whose ray meets no ground in range.
    pub(super) fn fate_of_lost(&self, column: u32, row: u32) -> Fate {
        let Some(ray_camera) = self.view.camera.pixel_ray(column, row) else {
            return Fate::Unusable;
        };
        let direction = self.view.world_from_camera.rotation * ray_camera;
        if self.cast_up_to(direction, f64::INFINITY).is_some() {
            Fate::OutOfRange
        } else if direction.z >= 0.0 {
            Fate::Sky
        } else if self.passes_through(direction) {
            Fate::Hole
        } else {
            Fate::OffMap
        }
    }

    /// Whether a descending ray that hits no voxel goes through the map rather than past it.
    fn passes_through(&self, direction: DVec3) -> bool {
        let extent = self.terrain.extent();
        let origin = self.terrain.tree_from_world(self.origin);
        let Some(exit) = exit(origin, direction, extent.map(f64::from).into()) else {
            return false;
        };
        // Rounding may have put it a hair beside the column of its last empty cell.
        let inside = |coordinate: f64, side: u32| (coordinate as u32).min(side - 1);
        let (x, y) = (inside(exit.x, extent[0]), inside(exit.y, extent[1]));
        match self.terrain.tree().column(x, y).next() {
            // The ray has hit none of the column: it is above its lowest voxel or below it, not in it.
            Some((lowest, _)) => exit.z < f64::from(lowest) + 0.5,
            None => self.terrain.outline().encloses(x, y),
        }
    }
}

/// Where a descending line leaves the box from 0 to `extent`; None where it passes the box.
fn exit(origin: DVec3, direction: DVec3, extent: DVec3) -> Option<DVec3> {
    let (mut enter, mut leave) = (0.0f64, f64::INFINITY);
    for axis in 0..3 {
        if direction[axis] == 0.0 {
            if !(0.0..extent[axis]).contains(&origin[axis]) {
                return None;
            }
            continue;
        }
        let distances = [0.0, extent[axis]].map(|plane| (plane - origin[axis]) / direction[axis]);
        enter = enter.max(distances[0].min(distances[1]));
        leave = leave.min(distances[0].max(distances[1]));
    }
    (enter <= leave).then(|| origin + direction * leave)
}

/// Sums the pixels of a view whose value is above `threshold` by their fate, which is asked of no others.
pub(super) fn crowd_mass(view: &View, threshold: f64, fate: impl Fn(u32, u32) -> Fate + Sync) -> CrowdMass {
    let values = view.pixel_values();
    let mass_of_row = |(row, values): (usize, &[f32])| {
        let mut mass = CrowdMass::default();
        for (column, value) in values.iter().map(|&value| f64::from(value)).enumerate() {
            if value > threshold {
                *part(&mut mass, fate(column as u32, row as u32)) += value;
            }
        }
        mass
    };
    // Rows are added in their order, so that the sum does not depend on the threads.
    let rows: Vec<CrowdMass> =
        values.par_chunks(view.camera.width() as usize).enumerate().map(mass_of_row).collect();
    rows.into_iter().sum()
}

/// Whether any pixel may show crowd.
pub(super) fn shows_crowd(view: &View, threshold: f64) -> bool {
    // Line by line of the cache without a branch, so that it becomes vectors.
    let is_above = |value: &f32| f64::from(*value) > threshold;
    view.heatmap
        .values()
        .chunks(16)
        .any(|values| values.iter().fold(false, |any, value| any | is_above(value)))
}

fn part(mass: &mut CrowdMass, fate: Fate) -> &mut f64 {
    match fate {
        Fate::Ground => &mut mass.ground,
        Fate::OutOfRange => &mut mass.out_of_range,
        Fate::Hole => &mut mass.hole,
        Fate::OffMap => &mut mass.off_map,
        Fate::Sky => &mut mass.sky,
        Fate::Unusable => &mut mass.unusable,
    }
}
