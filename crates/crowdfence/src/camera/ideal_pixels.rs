//! Where a pinhole of the same intrinsics would see what each pixel of a lens that distorts sees. There the images of
//! straight lines are straight, so what is drawn as polygons is drawn there, and each pixel is asked where it lies.

use glam::DVec2;
use rayon::prelude::*;

use super::Camera;

/// Furthest from the optical axis that a pixel may look for a pinhole to be of use, as the cosine: 80 degrees.
const WIDEST: f64 = 0.1736;
/// Places along each side of the image at which a lens is asked how much it stretches, and by how much more it may do
/// so between them.
const SAMPLES: u32 = 64;
const SPARE: f64 = 1.1;

#[derive(Debug, Clone)]
pub struct IdealPixels {
    width: usize,
    /// From the centre of each pixel, row after row, to its place in the pinhole's image; NaN for a blind pixel.
    offset: Vec<[f32; 2]>,
    /// Between these lie all of them.
    low: DVec2,
    high: DVec2,
    /// Largest change of u and v (rows) for a step of one ideal pixel along x and y (columns).
    reach: [[f64; 2]; 2],
}

impl IdealPixels {
    /// None when a pixel looks further aside than a pinhole can.
    pub(super) fn of(camera: &Camera) -> Option<IdealPixels> {
        let width = camera.width as usize;
        let rays = camera.pixel_rays();
        if rays.iter().flatten().any(|ray| ray.z < WIDEST) {
            return None;
        }
        let places: Vec<DVec2> = rays
            .into_par_iter()
            .map(|ray| {
                let image = ray.map(|ray| ray.truncate() / ray.z * camera.focal_px + camera.principal_px);
                image.unwrap_or(DVec2::NAN)
            })
            .collect();
        let seen = || places.iter().filter(|place| !place.is_nan());
        // A hair wider, as offsets are rounded.
        let low = seen().copied().reduce(DVec2::min)? - 0.01;
        let high = seen().copied().reduce(DVec2::max)? + 0.01;
        let reach = reach(camera, low, high);
        let center = |at: usize| DVec2::new((at % width) as f64, (at / width) as f64) + 0.5;
        let offset =
            places.iter().enumerate().map(|(at, &place)| (place - center(at)).as_vec2().to_array()).collect();
        Some(IdealPixels { width, offset, low, high, reach })
    }

    /// Place of a pixel, NaN for a blind one.
    #[inline(always)]
    pub fn place(&self, column: usize, row: usize) -> DVec2 {
        let [x, y] = self.offset[row * self.width + column];
        DVec2::new(column as f64 + 0.5 + f64::from(x), row as f64 + 0.5 + f64::from(y))
    }

    /// Corners of the rectangle that all places lie in.
    pub fn bounds(&self) -> (DVec2, DVec2) {
        (self.low, self.high)
    }

    /// Half sides of a rectangle of pixels around the image of the middle of a rectangle of places, in which all
    /// pixels lie that have their place there; from half the sides of that.
    #[inline(always)]
    pub fn reach(&self, half: DVec2) -> DVec2 {
        let side = |[x, y]: [f64; 2]| x * half.x + y * half.y + 1.0;
        DVec2::new(side(self.reach[0]), side(self.reach[1]))
    }
}

/// Largest change of u and v (rows) for a step along x and y (columns) between two corners.
fn reach(camera: &Camera, low: DVec2, high: DVec2) -> [[f64; 2]; 2] {
    let mut reach = [[0.0f64; 2]; 2];
    let step = (high - low) / f64::from(SAMPLES);
    for (i, j) in (0..=SAMPLES).flat_map(|i| (0..=SAMPLES).map(move |j| (i, j))) {
        let place = low + DVec2::new(f64::from(i), f64::from(j)) * step;
        for (column, axis) in DVec2::AXES.into_iter().enumerate() {
            let beside = place + axis * 1e-3 * step;
            if let (Some(from), Some(to)) = (camera.pixel_of_ideal(place), camera.pixel_of_ideal(beside)) {
                let change = SPARE * ((to - from) / (beside - place)[column]).abs();
                reach[0][column] = reach[0][column].max(change.x);
                reach[1][column] = reach[1][column].max(change.y);
            }
        }
    }
    reach
}
