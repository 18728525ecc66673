//! Where the columns of a terrain begin and end, and how high their surface lies.

use rayon::prelude::*;

use super::Terrain;
use super::tree::{Brick, Square, Stacks};

/// One column of voxels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColumnEnds {
    /// Grid index along x.
    pub i: i32,
    /// Grid index along y.
    pub j: i32,
    /// Grid index k of the lowest voxel.
    pub bottom: i32,
    /// Grid index k of the highest.
    pub top: i32,
}

impl Terrain {
    /// Voxels without a voxel on top, on which somebody can stand: sorted by column (i, then j), then from below.
    pub fn standing_places(&self) -> Vec<u32> {
        self.by_column(|_, bricks, number, places| {
            places.extend(standing(bricks, number).map(|(brick, z)| brick.voxel_id(number, z)));
        })
    }

    /// Every column with a voxel, sorted by i, then j.
    pub fn columns(&self) -> Vec<ColumnEnds> {
        self.by_column(|[i, j], bricks, number, columns| {
            let mut occupied =
                bricks.iter().map(|brick| (brick.low, brick.column(number))).filter(|one| one.1 != 0);
            let Some((low, bits)) = occupied.next() else { return };
            let (high, top_bits) = occupied.next_back().unwrap_or((low, bits));
            let level = |z: u32| self.base[2].wrapping_add_unsigned(z);
            let (bottom, top) = (level(low + bits.trailing_zeros()), level(high + top_bits.ilog2()));
            columns.push(ColumnEnds { i, j, bottom, top });
        })
    }

    /// The terrain from above: how high the surface lies over the middle of every column of `extent_xy`, metres above
    /// the lowest face, column j of row i at `i * extent_xy[1] + j` from the lowest indices in use on. NaN without a voxel.
    pub fn surface_map(&self) -> Vec<f32> {
        let [rows, columns, _] = self.extent.map(|side| side as usize);
        let heights = self.by_column(|[i, j], bricks, number, heights: &mut Vec<(usize, f32)>| {
            // Not always that of the uppermost voxel: its plane may lie deeper than one that rises from below.
            let tops = standing(bricks, number)
                .map(|(brick, z)| f64::from(brick.low + z) + self.plane(brick.voxel_id(number, z)).height());
            let Some(top) = tops.reduce(f64::max) else { return };
            let [row, column] = [i.abs_diff(self.base[0]), j.abs_diff(self.base[1])].map(|at| at as usize);
            heights.push((row * columns + column, (top * self.voxel_size_m) as f32));
        });
        let mut map = vec![f32::NAN; rows * columns];
        for (at, height) in heights {
            map[at] = height;
        }
        map
    }

    /// Columns along x and along y from the lowest indices in use to the highest.
    pub fn extent_xy(&self) -> [usize; 2] {
        [self.extent[0] as usize, self.extent[1] as usize]
    }

    /// What `tell` adds for each column, which may hold nothing, by i, then j: it gets the column's grid indices, the
    /// bricks over the 4 x 4 columns that it is one of, from the lowest upwards, and its number among these.
    fn by_column<T: Send>(&self, tell: impl Fn([i32; 2], &[Brick], u32, &mut Vec<T>) + Sync) -> Vec<T> {
        let mut stacks = Stacks::new(&self.tree);
        let (root, mut squares) = (stacks.root(), Vec::new());
        leaves(&mut stacks, &root, &mut squares);
        squares.sort_unstable();
        let strips: Vec<&[[u32; 2]]> = squares.chunk_by(|a, b| a[0] == b[0]).collect();
        let rows: Vec<Vec<T>> = strips
            .into_par_iter()
            .flat_map_iter(|strip| {
                let mut rows: [Vec<T>; Brick::SIDE as usize] = std::array::from_fn(|_| vec![]);
                let (mut stacks, mut bricks) = (Stacks::new(&self.tree), vec![]);
                for &place in strip {
                    let square = stacks.square_at(place, Square::LEAF).expect("it is one of the tree's");
                    bricks.clear();
                    stacks.for_bricks(&square, |_, brick| bricks.push(brick));
                    for number in 0..Brick::SIDE * Brick::SIDE {
                        let (x, y) = (number % Brick::SIDE, number / Brick::SIDE);
                        let i = self.base[0].wrapping_add_unsigned(place[0] + x);
                        let j = self.base[1].wrapping_add_unsigned(place[1] + y);
                        tell([i, j], &bricks, number, &mut rows[x as usize]);
                    }
                    stacks.release(&square);
                }
                rows
            })
            .collect();
        rows.into_iter().flatten().collect()
    }
}

/// Voxels of a column without a voxel on top, from the lowest upwards: their bricks, and how high they lie in these.
fn standing(bricks: &[Brick], number: u32) -> impl Iterator<Item = (&Brick, u32)> {
    bricks.iter().enumerate().flat_map(move |(at, brick)| {
        let above = bricks.get(at + 1).filter(|above| above.low == brick.low + Brick::SIDE);
        let first_above = above.map_or(0, |above| above.column(number) & 1);
        let here = brick.column(number);
        let stands = here & !(here >> 1 | first_above << (Brick::SIDE - 1));
        (0..Brick::SIDE).filter(move |z| stands >> z & 1 != 0).map(move |z| (brick, z))
    })
}

/// Lowest corners of the squares of 4 x 4 columns with something over them.
fn leaves(stacks: &mut Stacks<'_>, square: &Square, places: &mut Vec<[u32; 2]>) {
    if square.levels() == Square::LEAF {
        places.push(square.low);
        return;
    }
    for (x, y) in (0..Stacks::SIDE).flat_map(|x| (0..Stacks::SIDE).map(move |y| (x, y))) {
        if let Some(child) = stacks.child(square, x, y) {
            leaves(stacks, &child, places);
            stacks.release(&child);
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::terrain::{HeightMap, Surface};

    proptest! {
        #[test]
        fn ends_are_those_of_a_scan(
            voxels in prop::collection::btree_set((-9i32..9, -9i32..9, -3i32..9).prop_map(<[i32; 3]>::from), 1..600),
        ) {
            let voxels: Vec<[i32; 3]> = voxels.into_iter().collect();
            let terrain = Terrain::from_indices(&voxels, 0.5, DVec3::ZERO).unwrap();
            let stands = voxels.iter().filter(|&&[i, j, k]| !voxels.contains(&[i, j, k + 1]));
            let expected: Vec<u32> = stands.map(|&index| terrain.id(index).unwrap()).collect();
            prop_assert_eq!(terrain.standing_places(), expected);
            let mut columns: BTreeMap<[i32; 2], Vec<i32>> = BTreeMap::new();
            voxels.iter().for_each(|&[i, j, k]| columns.entry([i, j]).or_default().push(k));
            let expected: Vec<ColumnEnds> = columns
                .into_iter()
                .map(|([i, j], heights)| ColumnEnds { i, j, bottom: heights[0], top: heights[heights.len() - 1] })
                .collect();
            prop_assert_eq!(terrain.columns(), expected);
        }
    }

    proptest! {
        #[test]
        fn the_surface_from_above_is_what_rays_meet(
            heights in prop::collection::vec(-3.0..9.0f32, 12 * 10),
            roofs in prop::collection::btree_set((-2i32..10, -2i32..8, 12i32..16).prop_map(<[i32; 3]>::from), 0..30),
            is_estimated in prop::bool::ANY,
        ) {
            let size = 0.5;
            let closed = HeightMap::new(&heights, [12, 10], size).unwrap();
            let ground = Terrain::from_height_map(&closed, size, DVec3::ZERO).unwrap();
            let roofs: Vec<[i32; 3]> = roofs.into_iter().collect();
            let terrain = if is_estimated {
                let all: Vec<u32> = (0..ground.voxel_count() as u32).collect();
                let bare = [ground.indices_of(&all), roofs].concat();
                Terrain::from_indices(&bare, size, DVec3::new(7.0, -3.0, 40.0)).unwrap()
            } else {
                ground
            };
            is_what_rays_meet(&terrain)?;
        }
    }

    /// Looking straight down from high above shows the same surface.
    fn is_what_rays_meet(terrain: &Terrain) -> Result<(), TestCaseError> {
        let (low, high) = terrain.bounds();
        let size = terrain.voxel_size_m();
        let [rows, columns] = terrain.extent_xy();
        let map = terrain.surface_map();
        prop_assert_eq!(map.len(), rows * columns);
        for (row, column) in (0..rows).flat_map(|row| (0..columns).map(move |column| (row, column))) {
            let middle = [row, column].map(|at| (at as f64 + 0.5) * size);
            let over = DVec3::new(low.x + middle[0], low.y + middle[1], high.z + 9.0);
            let met = terrain.raycast(Surface::Planes, over, DVec3::NEG_Z, f64::INFINITY);
            let height = map[row * columns + column];
            match met {
                None => prop_assert!(height.is_nan()),
                Some(hit) => {
                    prop_assert!((f64::from(height) - (over.z - hit.distance_m - low.z)).abs() < 1e-4)
                }
            }
        }
        Ok(())
    }

    #[test]
    fn a_surface_that_rises_past_the_voxel_above_it_is_what_rays_meet() {
        let mut heights = [0.0; 12 * 10];
        [heights[12], heights[13], heights[25]] = [5.638961, 5.722361, 8.565159];
        let ground =
            Terrain::from_height_map(&HeightMap::new(&heights, [12, 10], 0.5).unwrap(), 0.5, DVec3::ZERO)
                .unwrap();
        let all: Vec<u32> = (0..ground.voxel_count() as u32).collect();
        let roofs = vec![[0, 4, 12], [1, 3, 13], [1, 4, 14], [2, 1, 12]];
        let bare = [ground.indices_of(&all), roofs].concat();
        let terrain = Terrain::from_indices(&bare, 0.5, DVec3::new(7.0, -3.0, 40.0)).unwrap();
        is_what_rays_meet(&terrain).unwrap();
    }

    #[test]
    fn a_terrain_of_one_brick_has_columns() {
        let terrain = Terrain::from_indices(&[[0, 0, 0], [0, 0, 2], [3, 1, 1]], 0.5, DVec3::ZERO).unwrap();
        let ends = |i, j, bottom, top| ColumnEnds { i, j, bottom, top };
        assert_eq!(terrain.columns(), [ends(0, 0, 0, 2), ends(3, 1, 1, 1)]);
        let expected: Vec<u32> =
            [[0, 0, 0], [0, 0, 2], [3, 1, 1]].map(|index| terrain.id(index).unwrap()).to_vec();
        assert_eq!(terrain.standing_places(), expected);
    }
}
