//! Full coverage: the voxels that no pixel centre hits, by a ray to the middle of the top of each solid.
//!
//! What lies below the top of a solid is wall, on which nobody stands: it is seen where a pixel centre hits it.

use glam::DVec3;
use rayon::prelude::*;

use super::viewing_cone::ViewingCone;
use super::{Sighting, Vantage};
use crate::terrain::{Plane, Surface};

/// What the top of a solid shows.
enum TopView {
    /// Heatmap value there.
    Visible(f64),
    Hidden,
}

/// Of the voxels that no ray has hit: those with a visible top, and the ids of those whose top lies in the image
/// and in range behind something. Both are sorted by id.
pub(super) fn beside_rays(vantage: &Vantage, hit: &[Sighting]) -> (Vec<Sighting>, Vec<u32>) {
    let views: Vec<(u32, TopView)> = ViewingCone::of(vantage)
        .voxels()
        .into_par_iter()
        .filter(|id| hit.binary_search_by_key(id, |sighting| sighting.voxel_id).is_err())
        .filter_map(|id| Some((id, vantage.view_of_top(id)?)))
        .collect();
    let (mut seen, mut occluded_ids) = (Vec::new(), Vec::new());
    for (voxel_id, view) in views {
        match view {
            TopView::Visible(mean) => {
                let (line, is_turned_away) = vantage.line_to(voxel_id);
                seen.push(Sighting { voxel_id, mean, pixel_count: 0, line, is_turned_away })
            }
            TopView::Hidden => occluded_ids.push(voxel_id),
        }
    }
    (seen, occluded_ids)
}

/// Of a top, by the line to its middle and the direction in which it faces.
pub(super) fn is_turned_away(to_top: DVec3, normal: DVec3) -> bool {
    to_top.dot(normal) >= 0.0
}

impl Vantage<'_> {
    /// None when the voxel is no top, or its top lies outside the image, what was looked at of it, or the range.
    fn view_of_top(&self, id: u32) -> Option<TopView> {
        let (middle, normal) = self.middle_of_top(id)?;
        let to_top = middle - self.origin;
        if to_top.length() > self.max_range_m {
            return None;
        }
        let value = self.value_at(to_top)?;
        if !is_turned_away(to_top, normal) && self.cast(to_top).is_some_and(|hit| hit.voxel_id == id) {
            Some(TopView::Visible(value))
        } else {
            Some(TopView::Hidden)
        }
    }

    /// Heatmap value at the end of a line from where rays start, whatever hides it; None outside the image and what was
    /// looked at of it.
    pub(super) fn value_at(&self, line: DVec3) -> Option<f64> {
        let camera = &self.view.camera;
        let pixel = camera.project(self.view.world_from_camera.rotation.transpose() * line)?;
        let (column, row) = (pixel.x as u32, pixel.y as u32);
        let is_seen = camera.contains(pixel) && self.view.is_looked_at(column, row);
        is_seen.then(|| f64::from(self.view.value_at(column, row)))
    }

    /// From where rays start to what is seen of a voxel: the middle of its top, or in a wall its centre; and whether
    /// that is a top which is turned away.
    pub(super) fn line_to(&self, id: u32) -> (DVec3, bool) {
        match self.middle_of_top(id) {
            Some((middle, normal)) => (middle - self.origin, is_turned_away(middle - self.origin, normal)),
            None => (self.terrain.center(id) - self.origin, false),
        }
    }

    /// World metres, with the direction in which the top faces; None when another voxel lies on top.
    fn middle_of_top(&self, id: u32) -> Option<(DVec3, DVec3)> {
        let terrain = self.terrain;
        terrain.top_plane(id, terrain.index(id))?;
        let plane = self.plane_of_top(id);
        // A hair inside the solid, so that the ray to its top enters it.
        let height = plane.height() - 1e-6;
        let middle = terrain.center(id) + DVec3::Z * (height - 0.5) * terrain.voxel_size_m();
        Some((middle, plane.normal()))
    }

    /// Of a voxel on which no other lies.
    pub(super) fn plane_of_top(&self, id: u32) -> Plane {
        match self.surface {
            Surface::Planes => self.terrain.plane(id),
            Surface::Voxels => Plane::CEILING,
        }
    }
}
