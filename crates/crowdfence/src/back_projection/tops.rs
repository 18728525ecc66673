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
                seen.push(Sighting { voxel_id, mean, pixel_count: 0, line: vantage.line_to(voxel_id) })
            }
            TopView::Hidden => occluded_ids.push(voxel_id),
        }
    }
    (seen, occluded_ids)
}

impl Vantage<'_> {
    /// None when the voxel is no top, or its top lies outside the image or the range.
    fn view_of_top(&self, id: u32) -> Option<TopView> {
        let (middle, normal) = self.middle_of_top(id)?;
        let to_top = middle - self.origin;
        if to_top.length() > self.max_range_m {
            return None;
        }
        let camera = &self.view.camera;
        let pixel = camera.project(self.view.world_from_camera.rotation.transpose() * to_top)?;
        if !camera.contains(pixel) {
            return None;
        }
        let is_turned_to_camera = to_top.dot(normal) < 0.0;
        if is_turned_to_camera && self.cast(to_top).is_some_and(|hit| hit.voxel_id == id) {
            let value = self.view.value_at(pixel.x as u32, pixel.y as u32);
            Some(TopView::Visible(f64::from(value)))
        } else {
            Some(TopView::Hidden)
        }
    }

    /// From where rays start to what is seen of a voxel: the middle of its top, or in a wall its centre.
    pub(super) fn line_to(&self, id: u32) -> DVec3 {
        let point = self.middle_of_top(id).map_or_else(|| self.terrain.center(id), |(middle, _)| middle);
        point - self.origin
    }

    /// World metres, with the direction in which the top faces; None when another voxel lies on top.
    fn middle_of_top(&self, id: u32) -> Option<(DVec3, DVec3)> {
        let terrain = self.terrain;
        let index = terrain.index(id);
        let top = terrain.top_plane(id, index)?;
        let plane = match self.surface {
            Surface::Planes => top,
            Surface::Voxels => Plane::CEILING,
        };
        // A hair inside the solid, so that the ray to its top enters it.
        let height = plane.height() - 1e-6;
        let middle = terrain.center(id) + DVec3::Z * (height - 0.5) * terrain.voxel_size_m();
        Some((middle, plane.normal()))
    }
}
