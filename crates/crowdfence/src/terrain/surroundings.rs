//! The columns of a block of voxels and those around it, as bits: from which sheets are told.

use super::tree::{Block, Brick, Tree};

/// Columns of a brick along one side, and its voxels upwards.
const BRICK: i32 = Brick::SIDE as i32;
/// Columns of a block along one side.
pub(super) const BLOCK: i32 = Block::SIDE as i32;
/// Columns beside the block on each side: a brick's.
pub(super) const RIM: i32 = BRICK;
/// Voxels above and below the block: as far as a sheet may rise from one of its columns to those two columns away
/// along both axes, and some slack.
const CLIMB: i32 = 12;
/// Columns along one side, from one to the next along x.
pub(super) const SIDE: i32 = BLOCK + 2 * RIM;
pub(super) const COLUMNS: usize = (SIDE * SIDE) as usize;
/// Voxels of a column; they fit the bits of a number.
const HEIGHT: i32 = BLOCK + 2 * CLIMB;
const BRICKS: usize = (SIDE / BRICK * (SIDE / BRICK) * (HEIGHT / BRICK)) as usize;

/// The uppermost voxel of a solid, a run of voxels in one column without a gap. Of a solid that leaves what was gathered
/// only the part inside is known, which is too far away to be of the sheet of any voxel in the block.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Top {
    /// Row-major: the next one along y is one more.
    pub column: i32,
    /// Above the lowest that was gathered.
    pub z: i32,
}

pub(super) struct Surroundings {
    /// Tree coordinates of column 0 and of bit 0.
    low: [i64; 3],
    /// A bit for each voxel of a column, and for those with nothing on top.
    voxels: [u64; COLUMNS],
    tops: [u64; COLUMNS],
    /// By their place; those without a voxel are not looked at.
    bricks: [Brick; BRICKS],
}

impl Surroundings {
    /// Columns from one to the next along x and y.
    pub const STEP: [i32; 2] = [SIDE, 1];

    pub fn new() -> Surroundings {
        Surroundings { low: [0; 3], voxels: [0; COLUMNS], tops: [0; COLUMNS], bricks: [Brick::EMPTY; BRICKS] }
    }

    pub fn gather(&mut self, tree: &Tree, block: &Block) {
        const BEYOND: [i32; 3] = [RIM, RIM, CLIMB];
        const SIDES: [i32; 3] = [SIDE, SIDE, HEIGHT];
        let low: [i64; 3] = std::array::from_fn(|k| i64::from(block.low[k]) - i64::from(BEYOND[k]));
        let high = std::array::from_fn(|k| low[k] + i64::from(SIDES[k]));
        (self.low, self.voxels) = (low, [0; COLUMNS]);
        tree.for_bricks_in(low, high, |corner, brick| {
            let [x, y, z] = std::array::from_fn(|k| (i64::from(corner[k]) - low[k]) as i32);
            for number in 0..BRICK * BRICK {
                let column = (x + number % BRICK) * SIDE + y + number / BRICK;
                self.voxels[column as usize] |= u64::from(brick.column(number as u32)) << z;
            }
            self.bricks[brick_at(x, y, z)] = brick;
        });
        for (tops, voxels) in self.tops.iter_mut().zip(self.voxels) {
            *tops = voxels & !(voxels >> 1);
        }
    }

    /// The columns of the block.
    pub fn columns() -> impl Iterator<Item = i32> {
        let inside = RIM..RIM + BLOCK;
        inside.clone().flat_map(move |x| inside.clone().map(move |y| x * SIDE + y))
    }

    /// Those of a column that lie in the block.
    pub fn tops(&self, column: i32) -> impl Iterator<Item = Top> + use<> {
        const OWN: u64 = ((1 << BLOCK) - 1) << CLIMB;
        let mut left = self.tops[column as usize] & OWN;
        std::iter::from_fn(move || {
            let z = (left != 0).then(|| left.trailing_zeros() as i32)?;
            left &= left - 1;
            Some(Top { column, z })
        })
    }

    /// z of the only top of a column, no number where there is none, and the thickness of its solid; None where there
    /// are several.
    #[inline(always)]
    pub fn only_top(&self, column: i32) -> Option<(f64, f64)> {
        let tops = self.tops[column as usize];
        if tops == 0 {
            return Some((f64::NAN, 0.0));
        }
        let top = Top { column, z: tops.trailing_zeros() as i32 };
        (tops & (tops - 1) == 0).then(|| (f64::from(top.z), f64::from(self.thickness(top))))
    }

    /// The top of a column that is nearest to `rise` above another one, if it is within `slack` of that, and its own
    /// rise; the lower one of two as near.
    #[inline(always)]
    pub fn nearest(&self, column: i32, from: Top, rise: f64, slack: f64) -> Option<(Top, f64)> {
        let tops = self.tops[column as usize];
        let level = from.z + whole_below(rise);
        let up_to_level = if level < 0 { 0 } else { u64::MAX >> (63 - level.min(63)) };
        let (under, over) = (tops & up_to_level, tops & !up_to_level);
        let (below, above) = (63 - under.leading_zeros() as i32, over.trailing_zeros() as i32);
        let off = |z: i32| (f64::from(z - from.z) - rise).abs();
        let is_below = under != 0 && (over == 0 || off(below) <= off(above));
        let z = if is_below { below } else { above };
        (tops != 0 && off(z) <= slack).then_some((Top { column, z }, f64::from(z - from.z)))
    }

    /// Whether a voxel that may be there has nothing on top.
    pub fn is_top(&self, Top { column, z }: Top) -> bool {
        self.tops[column as usize] >> z & 1 != 0
    }

    /// Voxels of a solid.
    #[inline(always)]
    pub fn thickness(&self, Top { column, z }: Top) -> i32 {
        (self.voxels[column as usize] << (63 - z)).leading_ones() as i32
    }

    /// Of a voxel that is there.
    #[inline(always)]
    pub fn id(&self, Top { column, z }: Top) -> u32 {
        let (x, y) = (column / SIDE, column % SIDE);
        self.bricks[brick_at(x, y, z)].voxel_id((x % BRICK + y % BRICK * BRICK) as u32, z as u32)
    }

    /// Tree coordinates of a voxel that is there.
    pub fn coordinate(&self, Top { column, z }: Top) -> [u32; 3] {
        let at = [column / SIDE, column % SIDE, z];
        std::array::from_fn(|k| (self.low[k] + i64::from(at[k])) as u32)
    }
}

/// The whole number at or below one of little size; `floor` is a call on a machine that may be an old one.
#[inline(always)]
fn whole_below(number: f64) -> i32 {
    let towards_zero = number as i32;
    towards_zero - i32::from(number < f64::from(towards_zero))
}

#[inline(always)]
fn brick_at(x: i32, y: i32, z: i32) -> usize {
    ((x / BRICK * (SIDE / BRICK) + y / BRICK) * (HEIGHT / BRICK) + z / BRICK) as usize
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn tree(voxels: &[[u32; 3]]) -> Tree {
        let mut keys: Vec<u64> = voxels.iter().map(|&voxel| Tree::key(voxel, 3)).collect();
        keys.sort_unstable();
        Tree::from_sorted_keys(&keys, 3)
    }

    proptest! {
        #[test]
        fn every_top_is_met_once_and_told_as_it_is(
            voxels in prop::collection::vec(prop::array::uniform3(0u32..64), 1..300),
            column in (0u32..64, 0u32..60), length in 1u32..20,
        ) {
            let run = (0..length).map(|z| [column.0, column.1, (column.1 + z) % 64]);
            let voxels: Vec<[u32; 3]> = voxels.into_iter().chain(run).collect();
            let is_there = |[x, y, z]: [u32; 3]| voxels.contains(&[x, y, z]);
            let tree = tree(&voxels);
            let mut found = Vec::new();
            let mut around = Surroundings::new();
            for block in tree.blocks() {
                around.gather(&tree, &block);
                for top in Surroundings::columns().flat_map(|column| around.tops(column)) {
                    let [x, y, z] = around.coordinate(top);
                    prop_assert_eq!(tree.id([x, y, z]), Some(around.id(top)));
                    prop_assert!(block.ids.contains(&around.id(top)) && around.is_top(top));
                    let deep = (0..=z).rev().take_while(|&z| is_there([x, y, z])).count() as i32;
                    prop_assert_eq!(around.thickness(top), deep.min(top.z + 1));
                    found.push([x, y, z]);
                }
            }
            found.sort_unstable();
            let mut expected = voxels.clone();
            expected.retain(|&[x, y, z]| !is_there([x, y, z + 1]));
            expected.sort_unstable();
            expected.dedup();
            prop_assert_eq!(found, expected);
        }

        #[test]
        fn the_nearest_top_is_that_of_a_scan(
            heights in prop::collection::vec(0u32..40, 0..6), from in 12i32..28,
            quarters in -60i32..60, slack in 0i32..20,
        ) {
            // One column of a block; what is gathered begins at height 4.
            let voxels: Vec<[u32; 3]> = heights.iter().map(|&z| [20, 20, 4 + z]).chain([[0, 0, 16]]).collect();
            let tree = tree(&voxels);
            let mut around = Surroundings::new();
            around.gather(&tree, &Block { low: [16, 16, 16], ids: 0..1 });
            let (column, from) = ((4 + RIM) * SIDE + 4 + RIM, Top { column: 0, z: from });
            let found = around.nearest(column, from, f64::from(quarters) / 4.0, f64::from(slack) / 4.0);
            let tops = heights.iter().filter(|&&z| !heights.contains(&(z + 1))).map(|&z| z as i32);
            let off = |z: i32| (4 * (z - from.z) - quarters).abs();
            let nearest = tops.min_by_key(|&z| (off(z), z)).filter(|&z| off(z) <= slack);
            prop_assert_eq!(found, nearest.map(|z| (Top { column, z }, f64::from(z - from.z))));
        }
    }
}
