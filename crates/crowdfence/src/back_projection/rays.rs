//! The reference: the ray of every pixel centre is cast, and each voxel that rays hit first takes the mean of
//! their pixels.

use rayon::prelude::*;

use super::pixel_set::PixelSet;
use super::rim::{Pixels, Rim, mean_at_rim};
use super::{Sighting, Vantage};
use crate::view::View;

/// Which voxel the ray of each pixel centre hits first: the voxel's id in the upper half, the pixel in the lower.
pub(super) struct PixelHits {
    /// Sorted, which groups the pixels of a voxel in image order, whatever the threads did.
    hits: Vec<u64>,
}

impl PixelHits {
    pub fn cast(vantage: &Vantage) -> PixelHits {
        let view = vantage.view;
        let (camera, width) = (&view.camera, view.camera.width());
        let mut hits: Vec<u64> = (0..camera.height() * width)
            .into_par_iter()
            .filter(|pixel| view.is_looked_at(pixel % width, pixel / width))
            .filter_map(|pixel| {
                let ray_camera = camera.pixel_ray(pixel % width, pixel / width)?;
                let hit = vantage.cast(view.world_from_camera.rotation * ray_camera)?;
                Some(u64::from(hit.voxel_id) << 32 | u64::from(pixel))
            })
            .collect();
        hits.par_sort_unstable();
        PixelHits { hits }
    }

    /// The voxels hit, sorted by id.
    pub fn sightings(&self, vantage: &Vantage) -> Vec<Sighting> {
        let view = vantage.view;
        let width = view.camera.width();
        let value = |&hit: &u64| {
            let pixel = hit as u32;
            f64::from(view.value_at(pixel % width, pixel / width))
        };
        let ray = |&hit: &u64| {
            let pixel = hit as u32;
            let ray_camera = view.camera.pixel_ray(pixel % width, pixel / width);
            view.world_from_camera.rotation * ray_camera.expect("the ray of a hit")
        };
        self.hits
            .chunk_by(|a, b| a >> 32 == b >> 32)
            .map(|pixels| {
                let voxel_id = (pixels[0] >> 32) as u32;
                let (line, is_turned_away) = vantage.line_to(voxel_id);
                let mean = match Rim::of(vantage, voxel_id) {
                    None => pixels.iter().map(value).sum::<f64>() / pixels.len() as f64,
                    Some(rim) => {
                        let mut parts: [Pixels; 2] = [(0.0, 0); 2];
                        for hit in pixels {
                            let (sum, count) = &mut parts[usize::from(rim.is_met_beside(ray(hit)))];
                            (*sum, *count) = (*sum + value(hit), *count + 1);
                        }
                        mean_at_rim(parts[0], parts[1], vantage.value_at(line))
                    }
                };
                Sighting { voxel_id, mean, pixel_count: pixels.len() as u32, line, is_turned_away }
            })
            .collect()
    }

    /// The pixels that met ground.
    pub fn on_ground(&self, view: &View) -> PixelSet {
        let (width, height) = (view.camera.width() as usize, view.camera.height() as usize);
        let mut on_ground = PixelSet::empty(width, height);
        for pixel in self.hits.iter().map(|&hit| hit as u32 as usize) {
            on_ground.insert(pixel % width, pixel / width);
        }
        on_ground
    }
}
