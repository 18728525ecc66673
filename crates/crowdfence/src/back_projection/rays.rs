//! The reference: the ray of every pixel centre is cast, and each voxel that rays hit first takes the mean of
//! their pixels.

use rayon::prelude::*;

use super::{Sighting, Vantage};

/// The voxels first hit by the ray of some pixel centre, sorted by id.
pub(super) fn sightings(vantage: &Vantage) -> Vec<Sighting> {
    let view = vantage.view;
    let (camera, width) = (&view.camera, view.camera.width());
    // Sorting (voxel, pixel) pairs groups the pixels of a voxel in image order, whatever the threads did.
    let mut hits: Vec<u64> = (0..camera.height() * width)
        .into_par_iter()
        .filter_map(|pixel| {
            let ray_camera = camera.pixel_ray(pixel % width, pixel / width)?;
            let hit = vantage.cast(view.world_from_camera.rotation * ray_camera)?;
            Some(u64::from(hit.voxel_id) << 32 | u64::from(pixel))
        })
        .collect();
    hits.par_sort_unstable();
    let value = |&hit: &u64| {
        let pixel = hit as u32;
        f64::from(view.value_at(pixel % width, pixel / width))
    };
    hits.chunk_by(|a, b| a >> 32 == b >> 32)
        .map(|pixels| Sighting {
            voxel_id: (pixels[0] >> 32) as u32,
            mean: pixels.iter().map(value).sum::<f64>() / pixels.len() as f64,
            pixel_count: pixels.len() as u32,
        })
        .collect()
}
