//! View -> observation: which voxels the camera saw, the mean heatmap value of each, and where its crowd went.

mod fates;
mod pixel_set;
mod projection;
mod raster;
mod rays;
mod rim;
mod sighting;
mod tops;
mod viewing_cone;

use glam::DVec3;

use crate::camera::Distortion;
use crate::observation::{CrowdMass, Observation, SeenVoxels};
use crate::raycast::Hit;
use crate::terrain::{Surface, Terrain};
use crate::view::View;

pub use projection::{Coverage, DEFAULT_CROWD_THRESHOLD, Projection};

use fates::{Fate, crowd_mass, shows_crowd};
use pixel_set::PixelSet;
use rays::PixelHits;
use sighting::{Sighting, seen_voxels};

/// Back-projects a view. A camera inside the terrain or below it, or one that `target_height_m` would push through it,
/// sees nothing: its rays would pass below the surface and mark places it never saw.
///
/// The terrain is painted on the image. Through a lens so wide that no pinhole could see as much, every
/// pixel has its ray ([`project_by_rays`]). Both mean the same.
pub fn project(view: &View, terrain: &Terrain, projection: &Projection) -> Observation {
    let lens = match view.camera.distortion() {
        Distortion::None => None,
        _ => match view.camera.ideal_pixels() {
            None => return project_by_rays(view, terrain, projection),
            lens => lens,
        },
    };
    let between_pixels = projection.coverage() == Coverage::Full;
    with_vantage(view, terrain, projection, |vantage| raster::paint(vantage, lens, between_pixels))
}

/// The same by casting the ray of every pixel: the reference for [`project`], and many times slower.
pub fn project_by_rays(view: &View, terrain: &Terrain, projection: &Projection) -> Observation {
    with_vantage(view, terrain, projection, |vantage| {
        let hits = PixelHits::cast(vantage);
        let (sightings, on_ground) = (hits.sightings(vantage), hits.on_ground(view));
        let (sightings, occluded_ids) = match projection.coverage() {
            Coverage::Rays => (sightings, Vec::new()),
            Coverage::Full => {
                let (beside, occluded_ids) = tops::beside_rays(vantage, &sightings);
                (merged(sightings, beside), occluded_ids)
            }
        };
        let count = sightings.len();
        Looked { seen: seen_voxels(sightings.into_iter(), count), occluded_ids, on_ground }
    })
}

/// What a look at the terrain shows.
struct Looked {
    seen: SeenVoxels,
    /// Tops in the image and in range behind something, sorted.
    occluded_ids: Vec<u32>,
    /// The pixels that show ground in range.
    on_ground: PixelSet,
}

fn with_vantage(
    view: &View,
    terrain: &Terrain,
    projection: &Projection,
    look: impl FnOnce(&Vantage) -> Looked,
) -> Observation {
    let threshold = projection.crowd_threshold();
    let Some(vantage) = Vantage::new(view, terrain, projection) else {
        let unusable = crowd_mass(view, threshold, |_, _| Fate::Unusable);
        return observation(view, terrain, SeenVoxels::default(), Vec::new(), unusable);
    };
    let looked = look(&vantage);
    let crowd_mass = crowd_mass_of(&vantage, &looked.on_ground, threshold);
    observation(view, terrain, looked.seen, looked.occluded_ids, crowd_mass)
}

/// Where the crowd of a view went, whatever the coverage: it is a matter of pixels.
fn crowd_mass_of(vantage: &Vantage, on_ground: &PixelSet, threshold: f64) -> CrowdMass {
    let view = vantage.view;
    if !shows_crowd(view, threshold) {
        return CrowdMass::default();
    }
    crowd_mass(view, threshold, |column, row| {
        let is_on_ground = on_ground.contains(column as usize, row as usize);
        if is_on_ground { Fate::Ground } else { vantage.fate_of_lost(column, row) }
    })
}

/// One camera position looking at one terrain.
struct Vantage<'a> {
    view: &'a View,
    terrain: &'a Terrain,
    surface: Surface,
    /// Where rays start: the camera, lowered by the target's height.
    origin: DVec3,
    max_range_m: f64,
}

impl<'a> Vantage<'a> {
    /// None under ground.
    fn new(view: &'a View, terrain: &'a Terrain, projection: &Projection) -> Option<Vantage<'a>> {
        let camera_world = view.world_from_camera.translation;
        let height = projection.target_height_m();
        let surface = projection.surface();
        let has_room = terrain.raycast(surface, camera_world, DVec3::NEG_Z, height).is_none();
        let origin = camera_world - DVec3::Z * height;
        let vantage = Vantage { view, terrain, surface, origin, max_range_m: projection.max_range_m() };
        (has_room && !vantage.is_under_ground()).then_some(vantage)
    }

    /// Whether the map lies above the camera and nowhere below it: a map has tops and walls, and no inside.
    fn is_under_ground(&self) -> bool {
        let meets = |direction| self.cast_up_to(direction, f64::INFINITY).is_some();
        !meets(DVec3::NEG_Z) && meets(DVec3::Z)
    }

    fn cast(&self, direction_world: DVec3) -> Option<Hit> {
        self.cast_up_to(direction_world, self.max_range_m)
    }

    fn cast_up_to(&self, direction_world: DVec3, range_m: f64) -> Option<Hit> {
        self.terrain.raycast(self.surface, self.origin, direction_world, range_m)
    }
}

fn merged(mut some: Vec<Sighting>, others: Vec<Sighting>) -> Vec<Sighting> {
    some.extend(others);
    some.sort_unstable_by_key(|sighting| sighting.voxel_id);
    some
}

/// The one place that makes an observation.
fn observation(
    view: &View,
    terrain: &Terrain,
    seen: SeenVoxels,
    occluded_ids: Vec<u32>,
    crowd_mass: CrowdMass,
) -> Observation {
    let focal_px = (view.camera.fx() * view.camera.fy()).sqrt().min(f64::from(f32::MAX)) as f32;
    Observation::new(terrain.key(), view.drone.clone(), view.stamp_ns, seen, occluded_ids, crowd_mass)
        .and_then(|observation| observation.with_focal_px(focal_px))
        .expect("rows are sorted, and values of a heatmap lie in [0, 1]")
}

#[cfg(test)]
mod tests;
