//! View -> observation: which voxels the camera saw, and the mean heatmap value of each.

mod faces;
mod projection;
mod rays;
mod viewing_cone;

use glam::DVec3;

use crate::raycast::Hit;
use crate::terrain::Terrain;
use crate::view::View;

pub use projection::{Coverage, Projection};

/// What one view says about the terrain. The first three are parallel and sorted by voxel id.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Observation {
    pub voxel_ids: Vec<u32>,
    /// m_i: mean heatmap value over the pixels whose ray first hits the voxel.
    pub mean: Vec<f64>,
    pub pixel_count: Vec<u32>,
    /// With [`Coverage::Full`]: voxels in range of which all bare faces in the image lie behind something.
    pub occluded_ids: Vec<u32>,
}

/// Back-projects a view. A camera inside an occupied voxel, or one that `target_height_m` would push through
/// the terrain, sees nothing: its rays would pass below the surface and mark places it never saw.
pub fn project(view: &View, terrain: &Terrain, projection: &Projection) -> Observation {
    let Some(vantage) = Vantage::new(view, terrain, projection) else {
        return observation(&[], Vec::new());
    };
    let hit = rays::sightings(&vantage);
    match projection.coverage() {
        Coverage::Rays => observation(&hit, Vec::new()),
        Coverage::Full => {
            let (beside, occluded_ids) = faces::beside_rays(&vantage, &hit);
            observation(&merged(hit, beside), occluded_ids)
        }
    }
}

/// One camera position looking at one terrain.
struct Vantage<'a> {
    view: &'a View,
    terrain: &'a Terrain,
    /// Where rays start: the camera, lowered by the target's height.
    origin: DVec3,
    max_range_m: f64,
}

impl<'a> Vantage<'a> {
    /// None under ground.
    fn new(view: &'a View, terrain: &'a Terrain, projection: &Projection) -> Option<Vantage<'a>> {
        let camera_world = view.world_from_camera.translation;
        let height = projection.target_height_m();
        let above_ground = terrain.raycast(camera_world, DVec3::NEG_Z, height).is_none();
        let origin = camera_world - DVec3::Z * height;
        above_ground.then_some(Vantage { view, terrain, origin, max_range_m: projection.max_range_m() })
    }

    fn cast(&self, direction_world: DVec3) -> Option<Hit> {
        self.terrain.raycast(self.origin, direction_world, self.max_range_m)
    }
}

/// What is seen of one voxel: a row of the observation.
struct Sighting {
    voxel_id: u32,
    mean: f64,
    pixel_count: u32,
}

fn merged(mut some: Vec<Sighting>, others: Vec<Sighting>) -> Vec<Sighting> {
    some.extend(others);
    some.sort_unstable_by_key(|sighting| sighting.voxel_id);
    some
}

/// From rows and ids that are sorted: the one place that makes an observation.
fn observation(seen: &[Sighting], occluded_ids: Vec<u32>) -> Observation {
    Observation {
        voxel_ids: seen.iter().map(|sighting| sighting.voxel_id).collect(),
        mean: seen.iter().map(|sighting| sighting.mean).collect(),
        pixel_count: seen.iter().map(|sighting| sighting.pixel_count).collect(),
        occluded_ids,
    }
}

#[cfg(test)]
mod tests;
