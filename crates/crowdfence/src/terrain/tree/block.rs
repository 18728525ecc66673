//! Cubes of the grid that are worked on one by one, and the bricks in any box.

use std::ops::Range;

use super::{Branch, Brick, Tree};

/// An occupied cube of [`Block::SIDE`] voxels a side; a smaller tree is one block.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Block {
    /// Lowest corner.
    pub low: [u32; 3],
    /// Of its voxels, which are those of no other block.
    pub ids: Range<u32>,
}

impl Block {
    pub const SIDE: u32 = 16;
}

impl Tree {
    /// All of them, by voxel id.
    pub fn blocks(&self) -> Vec<Block> {
        let mut branches = vec![self.root()];
        while branches[0].cell.side > Block::SIDE {
            branches = branches.into_iter().flat_map(|branch| self.children(branch)).collect();
        }
        let firsts = branches.iter().map(|&branch| self.first_voxel(branch));
        let ends = firsts.clone().skip(1).chain([self.voxel_count as u32]);
        let block = |(branch, ids): (&Branch, _)| Block { low: branch.cell.low, ids };
        branches.iter().zip(firsts.zip(ends).map(|(first, end)| first..end)).map(block).collect()
    }

    fn first_voxel(&self, branch: Branch) -> u32 {
        let mut first = branch.index;
        for level in (0..branch.levels).rev() {
            first = self.node(level, first).base;
        }
        first
    }

    /// The bricks that meet the box from `low` up to `high`, each with its lowest corner.
    pub fn for_bricks_in(&self, low: [i64; 3], high: [i64; 3], mut each: impl FnMut([u32; 3], Brick)) {
        self.for_bricks_of(self.root(), low, high, &mut each);
    }

    fn for_bricks_of(
        &self,
        branch: Branch,
        low: [i64; 3],
        high: [i64; 3],
        each: &mut impl FnMut([u32; 3], Brick),
    ) {
        let corner = branch.cell.low.map(i64::from);
        let meets = |k: usize| corner[k] < high[k] && corner[k] + i64::from(branch.cell.side) > low[k];
        if !(meets(0) && meets(1) && meets(2)) {
            return;
        }
        if branch.levels == 1 {
            let node = self.node(0, branch.index);
            return each(branch.cell.low, Brick { low: branch.cell.low[2], node });
        }
        for child in self.children(branch) {
            self.for_bricks_of(child, low, high, each);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::build;
    use super::*;

    proptest! {
        #[test]
        fn blocks_part_the_voxels(
            voxels in prop::collection::vec(prop::array::uniform3(0u32..250), 1..200), depth in 1u32..=4,
        ) {
            let voxels: Vec<[u32; 3]> = voxels.iter().map(|voxel| voxel.map(|at| at % 4u32.pow(depth))).collect();
            let tree = build(&voxels, depth);
            let blocks = tree.blocks();
            let all: Vec<u32> = blocks.iter().flat_map(|block| block.ids.clone()).collect();
            prop_assert_eq!(all, Vec::from_iter(0..tree.voxel_count() as u32));
            for block in blocks {
                prop_assert!(!block.ids.is_empty());
                for id in block.ids {
                    let corner = tree.coordinate(id).map(|at| at / Block::SIDE * Block::SIDE);
                    prop_assert_eq!(corner, block.low);
                }
            }
        }

        #[test]
        fn bricks_in_a_box_are_those_that_meet_it(
            voxels in prop::collection::vec(prop::array::uniform3(0u32..64), 1..200),
            low in prop::array::uniform3(-20i64..70), sides in prop::array::uniform3(1i64..40),
        ) {
            let tree = build(&voxels, 3);
            let high = std::array::from_fn(|k| low[k] + sides[k]);
            let mut found = Vec::new();
            tree.for_bricks_in(low, high, |corner, brick| {
                found.push((corner, brick.first_id()));
                assert!(brick.contains(corner[2]));
            });
            let mut expected: Vec<_> = voxels.iter().map(|voxel| voxel.map(|at| at / 4 * 4)).collect();
            expected.retain(|corner| (0..3).all(|k| {
                i64::from(corner[k]) < high[k] && i64::from(corner[k]) + 4 > low[k]
            }));
            expected.sort_unstable();
            expected.dedup();
            let first_of = |corner: &[u32; 3]| {
                let inside = voxels.iter().filter(|voxel| voxel.map(|at| at / 4 * 4) == *corner);
                (*corner, inside.map(|&voxel| tree.id(voxel).unwrap()).min().unwrap())
            };
            found.sort_unstable();
            prop_assert_eq!(found, expected.iter().map(first_of).collect::<Vec<_>>());
        }
    }
}
