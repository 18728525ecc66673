//! Walls and roofs in voxel columns larger than the cells of a height map. The height of a column is that of the
//! surface at its middle; a wall falls between two middles, and the ground that it hides would be called seen and
//! empty. A column whose highest cell stands out of the ground is therefore as high as that cell: a little too much
//! is hidden, never too little.

use rayon::prelude::*;

use crate::error::{Error, Result, require};

/// Columns up to so many cells wide are as fine as the map.
pub const COARSER: f64 = 1.1;
/// A standing person is seen over what is lower.
const OUTSTANDING_M: f64 = 1.0;
/// The same in voxels: what is lower than half a voxel hides little more than the voxel behind it.
const OUTSTANDING_VOXELS: f64 = 0.5;

/// Heights of the middles of columns [X, Y], row-major, and of their highest points where these stand out.
pub fn raised(heights_m: &[f32], tops_m: &[f32], shape: [usize; 2], voxel_size_m: f64) -> Result<Vec<f32>> {
    require(voxel_size_m.is_finite() && voxel_size_m > 0.0, "voxel_size_m", voxel_size_m, "finite and > 0")?;
    for (name, given) in [("height_m", heights_m), ("top_m", tops_m)] {
        let expected = shape[0].saturating_mul(shape[1]);
        if given.len() != expected {
            return Err(Error::Length { name, actual: given.len(), expected });
        }
    }
    let middles = Middles { heights_m, shape, voxel_size_m };
    let column = |at: usize| middles.raised(at / shape[1], at % shape[1], tops_m[at].into()) as f32;
    Ok((0..heights_m.len()).into_par_iter().map(column).collect())
}

/// Heights of the middles of columns, row-major, metres; NaN is a hole.
pub(super) struct Middles<'h, T> {
    pub heights_m: &'h [T],
    pub shape: [usize; 2],
    pub voxel_size_m: f64,
}

impl<T: Copy + Into<f64>> Middles<'_, T> {
    /// Height of a column whose highest cell is `top_m`. On a slope the upper edge of a column lies above its middle;
    /// what its neighbours on both sides make of that does not count.
    pub fn raised(&self, i: usize, j: usize, top_m: f64) -> f64 {
        let height_m = self.at([i, j]);
        let least_m = OUTSTANDING_M.max(OUTSTANDING_VOXELS * self.voxel_size_m);
        let relief_m = self.relief_m([i, j], 0) + self.relief_m([i, j], 1);
        if top_m - height_m - relief_m > least_m { top_m } else { height_m }
    }

    /// How far the upper edge of a column on a slope lies above its middle: by the gentler side, because beside a
    /// house only the other one is the ground's. What falls, or rises, to both sides is no slope; the ground goes on
    /// at the edge of the map, and is level towards a hole.
    fn relief_m(&self, column: [usize; 2], axis: usize) -> f64 {
        if self.shape[axis] < 2 {
            return 0.0;
        }
        let step = |low: usize| {
            let [from, to] = [low, low + 1].map(|at| {
                let mut place = column;
                place[axis] = at;
                self.at(place)
            });
            if (to - from).is_nan() { 0.0 } else { to - from }
        };
        let before = step(column[axis].max(1) - 1);
        let after = step(column[axis].min(self.shape[axis] - 2));
        if before * after > 0.0 { before.abs().min(after.abs()) / 2.0 } else { 0.0 }
    }

    fn at(&self, [i, j]: [usize; 2]) -> f64 {
        self.heights_m[i * self.shape[1] + j].into()
    }
}
