//! Where a pinhole of the same intrinsics would see what each pixel of a lens that distorts sees. There the images of
//! straight lines are straight, so what is drawn as polygons is drawn there, and each pixel is asked where it lies.

use std::ops::Range;

use glam::{DVec2, UVec2};
use rayon::prelude::*;

use super::Camera;

/// Furthest from the optical axis that a pixel may look for a pinhole to be of use, as the cosine: 80 degrees.
const WIDEST: f64 = 0.1736;
/// Places along each side of the image at which a lens is asked how much it stretches, and by how much more it may do
/// so between them.
const SAMPLES: u32 = 64;
const SPARE: f64 = 1.1;
/// Cells along each side of the grid in which places are found again.
const CELLS: usize = 96;

/// Where a pinhole sees what each pixel of a lens that distorts sees, see [`Camera::ideal_pixels`].
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
    /// Of a grid between the corners, row after row: the pixels that have their place in each cell lie between these.
    /// Where the model of a lens ends, nothing else says where they are.
    cells: Vec<Rectangle>,
}

/// Pixels from one, along both axes, up to before another one.
#[derive(Debug, Clone, Copy)]
struct Rectangle {
    first: UVec2,
    end: UVec2,
}

impl Rectangle {
    const EMPTY: Rectangle = Rectangle { first: UVec2::MAX, end: UVec2::ZERO };

    fn around(self, other: Rectangle) -> Rectangle {
        Rectangle { first: self.first.min(other.first), end: self.end.max(other.end) }
    }
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
        let pixels = IdealPixels { width, offset, low, high, reach, cells: vec![] };
        Some(IdealPixels { cells: pixels.found_cells(), ..pixels })
    }

    fn found_cells(&self) -> Vec<Rectangle> {
        let mut cells = vec![Rectangle::EMPTY; CELLS * CELLS];
        for at in 0..self.offset.len() {
            let (column, row) = (at % self.width, at / self.width);
            let place = self.place(column, row);
            if !place.is_nan() {
                let first = UVec2::new(column as u32, row as u32);
                let [x, y] = self.cell_of(place);
                let cell = &mut cells[y * CELLS + x];
                *cell = cell.around(Rectangle { first, end: first + 1 });
            }
        }
        cells
    }

    /// Of a place; the nearest one of a place beside the grid. What lies further to one side is in no cell before.
    #[inline(always)]
    fn cell_of(&self, place: DVec2) -> [usize; 2] {
        let cells = (place - self.low) / (self.high - self.low) * CELLS as f64;
        [cells.x, cells.y].map(|cell| (cell as usize).min(CELLS - 1))
    }

    /// Rows and columns between which all pixels lie that have their place in a rectangle.
    #[inline(always)]
    pub fn around(&self, low: DVec2, high: DVec2) -> (Range<usize>, Range<usize>) {
        let ([left, top], [right, bottom]) = (self.cell_of(low), self.cell_of(high));
        let mut found = Rectangle::EMPTY;
        for y in top..=bottom {
            for cell in &self.cells[y * CELLS + left..=y * CELLS + right] {
                found = found.around(*cell);
            }
        }
        let Rectangle { first, end } = found;
        (first.y as usize..end.y as usize, first.x as usize..end.x as usize)
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::camera::Distortion;

    /// r - .4 r^3 turns back at r = .913, where it is .609: pixels more than 91 from the middle are blind.
    fn ending_lens() -> Camera {
        let distortion = Distortion::BrownConrady { k1: -0.4, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0 };
        Camera::new(320, 240, 150.0, 150.0, 160.0, 120.0, distortion).unwrap()
    }

    proptest! {
        #[test]
        fn pixels_are_found_by_their_places(
            x in -200.0f64..520.0, y in -200.0f64..440.0, width in 0.0f64..60.0, height in 0.0f64..60.0,
        ) {
            let camera = ending_lens();
            let pixels = camera.ideal_pixels().unwrap();
            let (low, high) = (DVec2::new(x, y), DVec2::new(x + width, y + height));
            let (rows, columns) = pixels.around(low, high);
            let mut count = 0;
            for (row, column) in (0..240).flat_map(|row| (0..320).map(move |column| (row, column))) {
                let place = pixels.place(column, row);
                if place.cmpge(low).all() && place.cmple(high).all() {
                    prop_assert!(rows.contains(&row) && columns.contains(&column), "{row}, {column}");
                    count += 1;
                }
            }
            // A cell is a few pixels wide: no more are asked than lie in the rectangle and some around it.
            let asked = rows.len() * columns.len();
            prop_assert!(asked <= 4 * count + 40 * (count as f64).sqrt() as usize + 400, "{asked} for {count}");
        }
    }
}
