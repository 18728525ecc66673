//! Height map -> the voxels that its surface passes through.

use rayon::prelude::*;

use crate::error::{Error, Result, require};

use super::MAX_VOXELS;
use super::tree::MAX_EXTENT;

/// Heights [X, Y] above the terrain's origin, row-major (first axis east, second north). Cell (i, j) covers
/// [i, i + 1) x [j, j + 1) cells of `cell_size_m`; its height belongs to its centre; NaN is a hole.
#[derive(Debug, Clone)]
pub struct HeightMap<'a> {
    heights_m: &'a [f32],
    shape: [usize; 2],
    cell_size_m: f64,
}

impl<'a> HeightMap<'a> {
    pub fn new(heights_m: &'a [f32], shape: [usize; 2], cell_size_m: f64) -> Result<HeightMap<'a>> {
        require(cell_size_m.is_finite() && cell_size_m > 0.0, "cell_size_m", cell_size_m, "finite and > 0")?;
        if heights_m.len() != shape[0] * shape[1] {
            return Err(Error::Length {
                name: "height_m",
                actual: heights_m.len(),
                expected: shape[0] * shape[1],
            });
        }
        if let Some(at) = heights_m.iter().position(|height| height.is_infinite()) {
            return Err(Error::Height { column: at / shape[1], row: at % shape[1], value: heights_m[at] });
        }
        Ok(HeightMap { heights_m, shape, cell_size_m })
    }

    /// Grid indices of the closed surface: every column of voxels holds the voxel of its own height and all
    /// voxels below it down to just above its lowest neighbour (of four), so that no ray slips through a
    /// step. A hole neither has voxels nor pulls its neighbours down.
    pub fn surface_voxels(&self, voxel_size_m: f64) -> Result<Vec<[i32; 3]>> {
        let tops = self.column_tops(voxel_size_m)?;
        let lowest = |i: usize, j: usize, own: i32| {
            tops.neighbours(i, j).flatten().min().map_or(own, |low| own.min(low.saturating_add(1)))
        };
        let count: u64 = (0..tops.shape[0])
            .into_par_iter()
            .map(|i| {
                (0..tops.shape[1])
                    .filter_map(|j| tops.at(i, j).map(|own| (own.abs_diff(lowest(i, j, own)) as u64) + 1))
                    .sum::<u64>()
            })
            .sum();
        if count > MAX_VOXELS {
            return Err(Error::TooManyVoxels { count, bound: MAX_VOXELS });
        }
        Ok((0..tops.shape[0])
            .into_par_iter()
            .flat_map_iter(|i| {
                let tops = &tops;
                (0..tops.shape[1]).filter_map(move |j| tops.at(i, j).map(|own| (i, j, own)))
            })
            .flat_map_iter(|(i, j, own)| (lowest(i, j, own)..=own).map(move |k| [i as i32, j as i32, k]))
            .collect())
    }

    fn column_tops(&self, voxel_size_m: f64) -> Result<ColumnTops> {
        let columns_per_cell = self.cell_size_m / voxel_size_m;
        let shape = self.shape.map(|cells| (cells as f64 * columns_per_cell - 1e-9).ceil().max(0.0) as usize);
        for (axis, &columns) in ['x', 'y'].iter().zip(&shape) {
            if columns as u64 > MAX_EXTENT {
                return Err(Error::TerrainExtent { axis: *axis, cells: columns as u64, bound: MAX_EXTENT });
            }
        }
        let count = shape[0] as u64 * shape[1] as u64; // a column has at least one voxel
        if count > MAX_VOXELS {
            return Err(Error::TooManyVoxels { count, bound: MAX_VOXELS });
        }
        let mut tops = vec![HOLE; shape[0] * shape[1]];
        tops.par_chunks_mut(shape[1].max(1)).enumerate().try_for_each(|(i, row)| {
            row.iter_mut().enumerate().try_for_each(|(j, top)| {
                let height_m =
                    self.sample((i as f64 + 0.5) / columns_per_cell, (j as f64 + 0.5) / columns_per_cell);
                if height_m.is_nan() {
                    return Ok(());
                }
                let level = (height_m / voxel_size_m).floor();
                if level.abs() >= f64::from(i32::MAX) {
                    let cell = |at: usize| (at as f64 / columns_per_cell) as usize;
                    return Err(Error::Height { column: cell(i), row: cell(j), value: height_m as f32 });
                }
                *top = level as i32;
                Ok(())
            })
        })?;
        Ok(ColumnTops { tops, shape })
    }

    /// Height at a position given in cells, bilinear between cell centres and level beyond the outermost
    /// ones; NaN where a cell that contributes is a hole.
    fn sample(&self, x: f64, y: f64) -> f64 {
        let [(i0, i1, wx), (j0, j1, wy)] = [(x, self.shape[0]), (y, self.shape[1])].map(|(at, cells)| {
            let at = (at - 0.5).clamp(0.0, (cells - 1) as f64);
            let low = at.floor() as usize;
            (low, (low + 1).min(cells - 1), at - low as f64)
        });
        let height = |i: usize, j: usize| f64::from(self.heights_m[i * self.shape[1] + j]);
        // A zero weight must not let a hole through: 0 * NaN is NaN.
        let mix = |a: f64, b: f64, weight: f64| if weight == 0.0 { a } else { a + (b - a) * weight };
        mix(mix(height(i0, j0), height(i0, j1), wy), mix(height(i1, j0), height(i1, j1), wy), wx)
    }
}

/// Mark of a column without ground; no height reaches it, see `column_tops`.
const HOLE: i32 = i32::MIN;

struct ColumnTops {
    tops: Vec<i32>,
    shape: [usize; 2],
}

impl ColumnTops {
    fn at(&self, i: usize, j: usize) -> Option<i32> {
        let top = self.tops[i * self.shape[1] + j];
        (top != HOLE).then_some(top)
    }

    fn neighbours(&self, i: usize, j: usize) -> impl Iterator<Item = Option<i32>> {
        let inside = move |i: Option<usize>, j: Option<usize>| Some((i?, j?));
        [
            inside(i.checked_sub(1), Some(j)),
            inside(Some(i + 1).filter(|&i| i < self.shape[0]), Some(j)),
            inside(Some(i), j.checked_sub(1)),
            inside(Some(i), Some(j + 1).filter(|&j| j < self.shape[1])),
        ]
        .into_iter()
        .flatten()
        .map(|(i, j)| self.at(i, j))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(heights: &[f32], shape: [usize; 2], cell: f64, voxel: f64) -> Vec<[i32; 3]> {
        let mut voxels = HeightMap::new(heights, shape, cell).unwrap().surface_voxels(voxel).unwrap();
        voxels.sort_unstable();
        voxels
    }

    #[test]
    fn a_step_is_closed_by_a_wall_on_its_high_side() {
        // Heights 0.5 and 3.5: the high column fills levels 1 to 3, the low one only level 0.
        assert_eq!(surface(&[0.5, 3.5], [2, 1], 1.0, 1.0), [[0, 0, 0], [1, 0, 1], [1, 0, 2], [1, 0, 3]]);
    }

    #[test]
    fn a_hole_has_no_voxels_and_no_walls_towards_it() {
        assert_eq!(surface(&[5.0, f32::NAN, 7.0], [1, 3], 1.0, 1.0), [[0, 0, 5], [0, 2, 7]]);
    }

    #[test]
    fn finer_voxels_interpolate_between_cell_centres() {
        // Cells of 2 m with heights 0 and 4 at x = 1 and x = 3: columns of 1 m at x = 0.5, 1.5, 2.5, 3.5
        // have heights 0, 1, 3, 4; walls fill down to one above the lower neighbour.
        assert_eq!(
            surface(&[0.0, 4.0], [2, 1], 2.0, 1.0)
                .iter()
                .filter(|v| v[1] == 0)
                .map(|v| (v[0], v[2]))
                .collect::<Vec<_>>(),
            [(0, 0), (1, 1), (2, 2), (2, 3), (3, 4)]
        );
    }

    #[test]
    fn negative_heights_round_down() {
        assert_eq!(surface(&[-0.1], [1, 1], 1.0, 1.0), [[0, 0, -1]]);
    }

    #[test]
    fn infinite_heights_are_refused_with_their_cell() {
        let error = HeightMap::new(&[0.0, 0.0, f32::INFINITY, 0.0], [2, 2], 1.0).unwrap_err();
        assert!(error.to_string().contains("cell (1, 0) is inf"), "{error}");
    }

    #[test]
    fn voxels_far_too_small_for_the_map_are_refused_before_any_memory_is_taken() {
        let message = |heights: &[f32], shape, cell, voxel| {
            let map = HeightMap::new(heights, shape, cell).unwrap();
            map.surface_voxels(voxel).unwrap_err().to_string()
        };
        assert!(message(&[0.0; 4], [2, 2], 0.5, 1e-6).contains("has 1000000000000 voxels; the bound is"));
        let high = message(&[0.0, 1e10], [1, 2], 1.0, 1.0);
        assert!(high.contains("cell (0, 1) is 10000000000") && high.contains("within 2^31 voxels"), "{high}");
    }
}
