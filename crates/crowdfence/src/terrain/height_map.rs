//! Height map -> the voxels of its surface, and where in them it lies.

use rayon::prelude::*;

use crate::error::{Error, Result, require};

use super::outstanding::{self, Middles};
use super::plane::Plane;
use super::tree::MAX_EXTENT;
use super::{MAX_HEIGHT, MAX_HEIGHT_M, MAX_VOXELS};

/// Heights [X, Y] above the terrain's origin, row-major (first axis east, second north). Cell (i, j) covers
/// [i, i + 1) x [j, j + 1) cells of `cell_size_m`; its height belongs to its centre; NaN is a hole.
#[derive(Debug, Clone)]
pub struct HeightMap<'a> {
    heights_m: &'a [f32],
    shape: [usize; 2],
    cell_size_m: f64,
}

impl<'a> HeightMap<'a> {
    /// Of `shape` [X, Y] cells.
    ///
    /// Errors: a length that is not X times Y, cells that are not larger than 0.
    pub fn new(heights_m: &'a [f32], shape: [usize; 2], cell_size_m: f64) -> Result<HeightMap<'a>> {
        require(cell_size_m.is_finite() && cell_size_m > 0.0, "cell_size_m", cell_size_m, "finite and > 0")?;
        let expected = shape[0].saturating_mul(shape[1]);
        if heights_m.len() != expected {
            return Err(Error::Length { name: "height_m", actual: heights_m.len(), expected });
        }
        let no_ground = |height: &f32| f64::from(height.abs()) > MAX_HEIGHT_M;
        if let Some(at) = heights_m.par_iter().position_first(no_ground) {
            let [column, row] = [at / shape[1], at % shape[1]];
            return Err(Error::Height { column, row, value: heights_m[at], bound: MAX_HEIGHT });
        }
        Ok(HeightMap { heights_m, shape, cell_size_m })
    }

    /// The surface over columns of voxels.
    pub fn columns(&self, voxel_size_m: f64) -> Result<SurfaceColumns> {
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
        let middle_m = |i: usize, j: usize| {
            self.sample((i as f64 + 0.5) / columns_per_cell, (j as f64 + 0.5) / columns_per_cell)
        };
        if columns_per_cell * outstanding::COARSER >= 1.0 {
            return self.surface(shape, voxel_size_m, middle_m);
        }
        let columns = (0..shape[0] * shape[1]).into_par_iter();
        let heights_m: Vec<f64> = columns.map(|at| middle_m(at / shape[1], at % shape[1])).collect();
        let middles = Middles { heights_m: &heights_m, shape, voxel_size_m };
        self.surface(shape, voxel_size_m, |i, j| middles.raised(i, j, self.highest_m(i, j, columns_per_cell)))
    }

    /// The surface over columns of the heights that `height_m` gives, NaN for a hole.
    fn surface(
        &self,
        shape: [usize; 2],
        voxel_size_m: f64,
        height_m: impl Fn(usize, usize) -> f64 + Sync,
    ) -> Result<SurfaceColumns> {
        let mut tops = vec![Top::HOLE; shape[0] * shape[1]];
        tops.par_chunks_mut(shape[1].max(1)).enumerate().try_for_each(|(i, row)| {
            row.iter_mut().enumerate().try_for_each(|(j, top)| {
                let height_m = height_m(i, j);
                if height_m.is_nan() {
                    return Ok(());
                }
                let height = height_m / voxel_size_m;
                if height.abs() >= f64::from(i32::MAX) - 1.0 {
                    let cell = |at: usize| (at as f64 * voxel_size_m / self.cell_size_m) as usize;
                    let (column, row, value) = (cell(i), cell(j), height_m as f32);
                    return Err(Error::Height { column, row, value, bound: "2^31 voxels" });
                }
                *top = Top::new(height);
                Ok(())
            })
        })?;
        Ok(SurfaceColumns { tops, shape })
    }

    /// Greatest height of the cells in a column, NaN where all of them are holes.
    fn highest_m(&self, i: usize, j: usize, columns_per_cell: f64) -> f64 {
        let [rows, columns] = [(i, self.shape[0]), (j, self.shape[1])].map(|(at, cells)| {
            // A hair less: a cell that only touches the column is not in it.
            let [low, high] = [at as f64, at as f64 + 1.0].map(|edge| edge / columns_per_cell);
            (low + 1e-9) as usize..((high - 1e-9).ceil() as usize).min(cells)
        });
        let row = |i: usize| &self.heights_m[i * self.shape[1]..][..self.shape[1]];
        rows.flat_map(|i| &row(i)[columns.clone()])
            .fold(f64::NAN, |highest, &height| highest.max(height.into()))
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

/// Height of a column's centre in voxels: the voxel and the place in it. A f64 would do as well at twice the memory.
#[derive(Debug, Clone, Copy)]
struct Top {
    level: i32,
    fraction: f32,
}

impl Top {
    /// No height reaches its level, see `columns`.
    const HOLE: Top = Top { level: i32::MIN, fraction: 0.0 };

    fn new(height: f64) -> Top {
        let level = height.floor();
        Top { level: level as i32, fraction: (height - level) as f32 }
    }

    fn is_hole(self) -> bool {
        self.level == Top::HOLE.level
    }

    fn above(self, other: Top) -> f64 {
        f64::from(self.level) - f64::from(other.level) + f64::from(self.fraction) - f64::from(other.fraction)
    }
}

/// A height map over the columns of a voxel grid.
pub struct SurfaceColumns {
    tops: Vec<Top>,
    shape: [usize; 2],
}

impl SurfaceColumns {
    /// Grid indices of the closed surface: every column of voxels holds the voxel of its own height and all
    /// voxels below it down to just above its lowest neighbour (of four), so that no ray slips through a
    /// step. A hole neither has voxels nor pulls its neighbours down.
    pub fn voxels(&self) -> Result<Vec<[i32; 3]>> {
        let count: u64 = (0..self.shape[0])
            .into_par_iter()
            .map(|i| {
                self.levels_along(i).map(|(_, lowest, own)| u64::from(own.abs_diff(lowest)) + 1).sum::<u64>()
            })
            .sum();
        if count > MAX_VOXELS {
            return Err(Error::TooManyVoxels { count, bound: MAX_VOXELS });
        }
        Ok((0..self.shape[0])
            .into_par_iter()
            .flat_map_iter(|i| self.levels_along(i).map(move |(j, lowest, own)| (i, j, lowest, own)))
            .flat_map_iter(|(i, j, lowest, own)| (lowest..=own).map(move |k| [i as i32, j as i32, k]))
            .collect())
    }

    /// Where in voxel (i, j, k) the surface lies. Slopes are the smaller of the differences to either side, and
    /// nothing where these disagree (minmod): planes stay planes, and the foot and the edge of a wall stay level.
    pub fn plane(&self, [i, j, k]: [i32; 3]) -> Plane {
        let (i, j) = (i as usize, j as usize);
        let own = self.tops[i * self.shape[1] + j];
        if own.level != k {
            return Plane::CEILING;
        }
        let [west, east, south, north] = self.neighbours(i, j);
        let slope = |before: Option<Top>, after: Option<Top>| {
            limited(before.map(|top| own.above(top)), after.map(|top| top.above(own)))
        };
        Plane::new(f64::from(own.fraction), [slope(west, east), slope(south, north)])
    }

    /// Column j of row i that has ground, with the lowest and the highest level of its voxels.
    fn levels_along(&self, i: usize) -> impl Iterator<Item = (usize, i32, i32)> {
        (0..self.shape[1]).filter_map(move |j| {
            let own = self.at(i, j)?.level;
            let lowest = self.neighbours(i, j).into_iter().flatten().map(|top| top.level).min();
            Some((j, lowest.map_or(own, |low| own.min(low.saturating_add(1))), own))
        })
    }

    fn at(&self, i: usize, j: usize) -> Option<Top> {
        Some(self.tops[i * self.shape[1] + j]).filter(|top| !top.is_hole())
    }

    /// West, east, south and north, where there is ground.
    fn neighbours(&self, i: usize, j: usize) -> [Option<Top>; 4] {
        let [columns, rows] = self.shape;
        [
            i.checked_sub(1).and_then(|i| self.at(i, j)),
            Some(i + 1).filter(|&i| i < columns).and_then(|i| self.at(i, j)),
            j.checked_sub(1).and_then(|j| self.at(i, j)),
            Some(j + 1).filter(|&j| j < rows).and_then(|j| self.at(i, j)),
        ]
    }
}

/// The smaller of two slopes of the same sign, else 0. Of a single one, beside a hole or at the border, nobody knows
/// whether it is a slope or a wall: 45 degrees are the bound.
fn limited(before: Option<f64>, after: Option<f64>) -> f64 {
    match (before, after) {
        (Some(a), Some(b)) if a * b > 0.0 => {
            if a.abs() < b.abs() {
                a
            } else {
                b
            }
        }
        (Some(single), None) | (None, Some(single)) if single.abs() <= 1.0 => single,
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn surface(heights: &[f32], shape: [usize; 2], cell: f64, voxel: f64) -> Vec<[i32; 3]> {
        let mut voxels =
            HeightMap::new(heights, shape, cell).unwrap().columns(voxel).unwrap().voxels().unwrap();
        voxels.sort_unstable();
        voxels
    }

    #[test]
    fn a_shape_whose_cells_nobody_can_count_is_refused() {
        // Their number wraps to 0.
        assert!(HeightMap::new(&[], [1 << (usize::BITS / 2); 2], 1.0).is_err());
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
    fn heights_that_no_ground_has_are_refused_with_their_cell() {
        for (height, words) in [
            (f32::INFINITY, "is inf; heights must be within 9000 m of the origin, or NaN for a hole"),
            (-32768.0, "is -32768;"),
            (-9999.0, "is -9999;"),
            (f32::MIN, "is -3.4028235e38;"),
            (9000.001, "is 9000.001;"),
        ] {
            let error = HeightMap::new(&[0.0, f32::NAN, height, 0.0], [2, 2], 1.0).unwrap_err();
            assert!(error.to_string().contains(&format!("cell (1, 0) {words}")), "{error}");
        }
        assert!(HeightMap::new(&[-9000.0, f32::NAN, 9000.0, 8849.0], [2, 2], 1.0).is_ok());
    }

    #[test]
    fn voxels_far_too_small_for_the_map_are_refused_before_any_memory_is_taken() {
        let message = |heights: &[f32], shape, cell, voxel| {
            let map = HeightMap::new(heights, shape, cell).unwrap();
            map.columns(voxel).err().unwrap().to_string()
        };
        assert!(message(&[0.0; 4], [2, 2], 0.5, 1e-6).contains("has 1000000000000 voxels; the bound is"));
        let high = message(&[0.0, 8000.0], [1, 2], 1e-6, 1e-6);
        assert!(high.contains("cell (0, 1) is 8000;") && high.contains("within 2^31 voxels"), "{high}");
    }
}
