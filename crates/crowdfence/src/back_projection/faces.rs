//! Full coverage: the voxels that no pixel centre hits, by a depth test of their faces.
//!
//! The test goes to the centre of each bare face that is turned to the camera, not to the voxel's centre: at
//! a grazing angle the voxels in front hide every centre of a plain, while their tops are in full view.

use glam::DVec3;
use rayon::prelude::*;

use super::viewing_cone::ViewingCone;
use super::{Sighting, Vantage};

/// What a voxel, or one face of it, shows.
enum FaceView {
    /// Heatmap value there.
    Visible(f64),
    Hidden,
}

/// Of the voxels that no ray has hit: those with a visible face, and the ids of those in range of which all
/// bare faces in the image lie behind something. All three are sorted by id.
pub(super) fn beside_rays(vantage: &Vantage, hit: &[Sighting]) -> (Vec<Sighting>, Vec<u32>) {
    let views: Vec<(u32, FaceView)> = ViewingCone::of(vantage)
        .voxels()
        .into_par_iter()
        .filter(|id| hit.binary_search_by_key(id, |sighting| sighting.voxel_id).is_err())
        .filter_map(|id| Some((id, vantage.view_of_voxel(id)?)))
        .collect();
    let (mut seen, mut occluded_ids) = (Vec::new(), Vec::new());
    for (voxel_id, view) in views {
        match view {
            FaceView::Visible(mean) => seen.push(Sighting { voxel_id, mean, pixel_count: 0 }),
            FaceView::Hidden => occluded_ids.push(voxel_id),
        }
    }
    (seen, occluded_ids)
}

impl Vantage<'_> {
    /// Mean over the visible faces of a voxel; None when nothing of it lies in the image and in range.
    fn view_of_voxel(&self, id: u32) -> Option<FaceView> {
        let faces = self.bare_faces_towards_camera(id);
        let views: Vec<FaceView> = faces.filter_map(|face| self.view_of_face(id, face)).collect();
        let visible = views.iter().filter_map(|view| match view {
            FaceView::Visible(value) => Some(*value),
            FaceView::Hidden => None,
        });
        let visible: Vec<f64> = visible.collect();
        if views.is_empty() {
            None
        } else if visible.is_empty() {
            Some(FaceView::Hidden)
        } else {
            Some(FaceView::Visible(visible.iter().sum::<f64>() / visible.len() as f64))
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

    /// None when the face's centre lies outside the image or the range.
    fn view_of_face(&self, id: u32, face: DVec3) -> Option<FaceView> {
        let to_face = face - self.origin;
        if to_face.length() > self.max_range_m {
            return None;
        }
        let camera = &self.view.camera;
        let pixel = camera.project(self.view.world_from_camera.rotation.transpose() * to_face)?;
        if !camera.contains(pixel) {
            return None;
        }
        if self.cast(to_face).is_some_and(|hit| hit.voxel_id == id) {
            let value = self.view.value_at(pixel.x as u32, pixel.y as u32);
            Some(FaceView::Visible(f64::from(value)))
        } else {
            Some(FaceView::Hidden)
        }
    }
}
