//! The planes of a row of sixteen columns at once, where every column around has one solid or none, as most of any map
//! has: the same as one by one, to the bit, since sums of whole numbers are exact in any order.
//!
//! Loops over the columns have neither branches nor calls, so that they become vectors as wide as the machine's.

use super::super::plane_fit::PlaneFit;
use super::super::surroundings::{BLOCK, COLUMNS, RIM, SIDE, Surroundings};
use super::{FAR_SLACK, NEAR_SLACK, Plane, REACH, fitted, slack};

const WIDTH: usize = BLOCK as usize;
/// A number for each column of a row.
type Row = [f64; WIDTH];

pub(super) struct Rows {
    /// By column: z of the only top, no number where there is none, and the thickness of its solid.
    z: [f64; COLUMNS],
    thickness: [f64; COLUMNS],
    /// Of each row, a bit for the columns with several solids.
    stacked: [u32; SIDE as usize],
    /// Of each row of the block, and a bit for each of its columns that is known.
    planes: [[Plane; WIDTH]; WIDTH],
    known: [u32; WIDTH],
}

/// What the columns around say of a row's.
struct Sums {
    count: Row,
    x: Row,
    y: Row,
    xx: Row,
    xy: Row,
    yy: Row,
    z: Row,
    xz: Row,
    yz: Row,
    thickness: Row,
}

impl Rows {
    pub fn new() -> Rows {
        Rows {
            z: [f64::NAN; COLUMNS],
            thickness: [0.0; COLUMNS],
            stacked: [0; SIDE as usize],
            planes: [[Plane::CEILING; WIDTH]; WIDTH],
            known: [0; WIDTH],
        }
    }

    /// The plane of the only solid of a column of the block, if it was found here.
    #[inline(always)]
    pub fn plane(&self, column: i32) -> Option<Plane> {
        let (x, y) = ((column / SIDE - RIM) as usize, (column % SIDE - RIM) as usize);
        (self.known[x] >> y & 1 != 0).then(|| self.planes[x][y])
    }

    /// Finds the planes of a block.
    pub fn fit(&mut self, around: &Surroundings) {
        self.stacked = [0; SIDE as usize];
        for column in 0..COLUMNS as i32 {
            match around.only_top(column) {
                Some((z, thickness)) => {
                    (self.z[column as usize], self.thickness[column as usize]) = (z, thickness);
                }
                None => self.stacked[(column / SIDE) as usize] |= 1 << (column % SIDE),
            }
        }
        pulp::Arch::new().dispatch(Fit(self));
    }

    #[inline(always)]
    fn fit_row(&mut self, row: i32) {
        let first = (row + RIM) * SIDE + RIM;
        let mut stacked = 0;
        for x in row + RIM - REACH..=row + RIM + REACH {
            stacked |= self.stacked[x as usize];
        }
        for _ in 0..REACH {
            stacked |= stacked << 1 | stacked >> 1;
        }
        self.known[row as usize] = !(stacked >> RIM);
        let [step_x, step_y] = Surroundings::STEP;
        let rough = [self.rough_slopes(first, step_x), self.rough_slopes(first, step_y)];
        let sums = self.sums(first, &rough);
        for j in 0..WIDTH {
            let fit = PlaneFit {
                weight: sums.count[j],
                x: sums.x[j],
                y: sums.y[j],
                xx: sums.xx[j],
                xy: sums.xy[j],
                yy: sums.yy[j],
                z: sums.z[j],
                xz: sums.xz[j],
                yz: sums.yz[j],
            };
            self.planes[row as usize][j] = fitted(&fit, sums.thickness[j]);
        }
    }

    /// As [`super::rough_slope`], of the columns from one on.
    #[inline(always)]
    fn rough_slopes(&self, first: i32, step: i32) -> Row {
        let own = row(&self.z, first);
        let (before, after) = (row(&self.z, first - step), row(&self.z, first + step));
        let (far_before, far_after) = (row(&self.z, first - 2 * step), row(&self.z, first + 2 * step));
        let mut slopes = [0.0; WIDTH];
        for j in 0..WIDTH {
            let (before, after) = (before[j] - own[j], after[j] - own[j]);
            let (far_before, far_after) = (far_before[j] - own[j], far_after[j] - own[j]);
            let has_before = before.abs() <= NEAR_SLACK;
            let has_after = after.abs() <= NEAR_SLACK;
            let has_far_before = has_before & ((far_before - 2.0 * before).abs() <= FAR_SLACK);
            let has_far_after = has_after & ((far_after - 2.0 * after).abs() <= FAR_SLACK);
            let wide = (2.0 * (far_after - far_before) + after - before) / 10.0;
            let narrow = (after - before) / 2.0;
            let through = if has_far_before & has_far_after { wide } else { narrow };
            let (from_before, from_after) = (-far_before / 2.0, far_after / 2.0);
            let (steep_before, steep_after) = (from_before.abs(), from_after.abs());
            let gentler = if steep_before < steep_after { from_before } else { from_after };
            let both = if from_before * from_after <= 0.0 { 0.0 } else { gentler };
            let after_alone = if has_far_after { from_after } else { 0.0 };
            let before_alone = if has_far_before { from_before } else { after_alone };
            let of_sides = if has_far_before & has_far_after { both } else { before_alone };
            let is_through = has_before & has_after & ((before + after).abs() <= 1.0);
            slopes[j] = if is_through { through } else { of_sides };
        }
        slopes
    }

    #[inline(always)]
    fn sums(&self, first: i32, rough: &[Row; 2]) -> Sums {
        const NONE: Row = [0.0; WIDTH];
        let mut sums = Sums {
            count: NONE,
            x: NONE,
            y: NONE,
            xx: NONE,
            xy: NONE,
            yy: NONE,
            z: NONE,
            xz: NONE,
            yz: NONE,
            thickness: NONE,
        };
        let own = row(&self.z, first);
        for x in -REACH..=REACH {
            // Of the columns side by side along y.
            let (mut count, mut y_sum, mut yy_sum) = (NONE, NONE, NONE);
            let (mut z_sum, mut yz_sum) = (NONE, NONE);
            for y in -REACH..=REACH {
                let others = row(&self.z, first + x * SIDE + y);
                let thicknesses = row(&self.thickness, first + x * SIDE + y);
                let slack = slack(x, y);
                let (along_x, along_y) = (f64::from(x), f64::from(y));
                for j in 0..WIDTH {
                    let expected = rough[0][j] * along_x + rough[1][j] * along_y;
                    let rise = others[j] - own[j];
                    let is_of_sheet = (rise - expected).abs() <= slack;
                    let weight = if is_of_sheet { 1.0 } else { 0.0 };
                    let rise = if is_of_sheet { rise } else { 0.0 };
                    count[j] += weight;
                    y_sum[j] += weight * along_y;
                    yy_sum[j] += weight * (along_y * along_y);
                    z_sum[j] += rise;
                    yz_sum[j] += rise * along_y;
                    sums.thickness[j] += weight * thicknesses[j];
                }
            }
            let along_x = f64::from(x);
            for j in 0..WIDTH {
                sums.count[j] += count[j];
                sums.x[j] += along_x * count[j];
                sums.y[j] += y_sum[j];
                sums.xx[j] += along_x * along_x * count[j];
                sums.xy[j] += along_x * y_sum[j];
                sums.yy[j] += yy_sum[j];
                sums.z[j] += z_sum[j];
                sums.xz[j] += along_x * z_sum[j];
                sums.yz[j] += yz_sum[j];
            }
        }
        sums
    }
}

#[inline(always)]
fn row(values: &[f64; COLUMNS], first: i32) -> &Row {
    values[first as usize..first as usize + WIDTH].try_into().expect("a row of the block")
}

/// Compiled for every width of vectors and run with the widest of this machine.
struct Fit<'r>(&'r mut Rows);

impl pulp::WithSimd for Fit<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: pulp::Simd>(self, _: S) {
        for row in 0..BLOCK {
            self.0.fit_row(row);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::super::{Terrain, plane};
    use super::*;

    proptest! {
        #[test]
        fn planes_of_rows_are_those_of_single_columns(
            slope in prop::array::uniform2(-2.5f64..2.5), bumps in 0.0f64..3.0, seed in any::<u32>(),
            holes in prop::collection::vec((0i32..40, 0i32..40), 0..60),
            above in prop::collection::vec((0i32..40, 0i32..40, 1i32..9), 0..6),
        ) {
            let ground = |i: i32, j: i32| {
                let noise = (i as u32).wrapping_mul(0x9e37_79b1) ^ (j as u32).wrapping_mul(0x85eb_ca77) ^ seed;
                let noise = f64::from(noise.wrapping_mul(0xc2b2_ae3d) >> 16) / 65536.0;
                (100.0 + slope[0] * f64::from(i) + slope[1] * f64::from(j) + bumps * noise) as i32
            };
            let mut voxels = Vec::new();
            for (i, j) in (0..40).flat_map(|i| (0..40).map(move |j| (i, j))) {
                if !holes.contains(&(i, j)) {
                    let deep = 1 + (i * 7 + j * 3) % 3;
                    voxels.extend((0..deep).map(|k| [i, j, ground(i, j) - k]));
                }
            }
            voxels.extend(above.iter().map(|&(i, j, k)| [i, j, ground(i, j) + 1 + k]));
            let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
            let (mut around, mut rows, mut count) = (Surroundings::new(), Rows::new(), 0);
            for block in terrain.tree().blocks() {
                around.gather(terrain.tree(), &block);
                rows.fit(&around);
                for top in Surroundings::columns().flat_map(|column| around.tops(column)) {
                    if let Some(found) = rows.plane(top.column) {
                        prop_assert_eq!(found, plane(&around, top));
                        count += 1;
                    }
                }
            }
            prop_assert!(count > 500, "{} columns by rows", count);
        }
    }
}
