//! Point queries for a ray: from the root to the smallest cell that says what is at a coordinate.

use super::{Cell, MAX_DEPTH, SIDE_BITS, Tree, cell_number};

/// What is at a coordinate.
pub(crate) enum Place {
    Voxel(u32),
    /// The largest cell around it without a voxel.
    Empty(Cell),
}

/// Path from the root to the current coordinate, kept so that a step only descends below the common ancestor.
pub(crate) struct Descent<'a> {
    tree: &'a Tree,
    /// Node index per level, valid from `deepest` upwards.
    path: [u32; MAX_DEPTH as usize],
    deepest: u32,
    coordinate: [u32; 3],
}

impl<'a> Descent<'a> {
    pub fn new(tree: &'a Tree) -> Descent<'a> {
        Descent { tree, path: [0; MAX_DEPTH as usize], deepest: tree.depth() - 1, coordinate: [0; 3] }
    }

    /// What is at a coordinate inside the tree's cube.
    #[inline]
    pub fn locate(&mut self, coordinate: [u32; 3]) -> Place {
        let difference = (0..3).fold(0, |bits, k| bits | (coordinate[k] ^ self.coordinate[k]));
        let common_level = (u32::BITS - difference.leading_zeros()).saturating_sub(1) / SIDE_BITS;
        let mut level = self.deepest.max(common_level).min(self.tree.depth() - 1);
        self.coordinate = coordinate;
        loop {
            self.deepest = level;
            let node = self.tree.node(level, self.path[level as usize]);
            let number = cell_number(coordinate, level);
            if !node.has(number) {
                return Place::Empty(Cell::around(coordinate, level));
            }
            if level == 0 {
                return Place::Voxel(node.child(number));
            }
            level -= 1;
            self.path[level as usize] = node.child(number);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::SIDE;
    use super::super::tests::build;
    use super::*;

    fn holds(cell: Cell, coordinate: [u32; 3]) -> bool {
        (0..3).all(|k| (cell.low[k]..cell.low[k] + cell.side).contains(&coordinate[k]))
    }

    proptest! {
        /// One descent asked again and again answers as the tree does; what it calls empty is empty, and the
        /// largest such cell.
        #[test]
        fn a_kept_path_answers_like_a_new_one(
            voxels in prop::collection::vec(prop::array::uniform3(0u32..64), 1..40),
            probes in prop::collection::vec(prop::array::uniform3(0u32..64), 1..40),
        ) {
            let tree = build(&voxels, 3);
            let mut descent = Descent::new(&tree);
            for probe in probes.into_iter().chain(voxels.clone()) {
                match descent.locate(probe) {
                    Place::Voxel(id) => prop_assert_eq!(Some(id), tree.id(probe)),
                    Place::Empty(cell) => {
                        prop_assert!(holds(cell, probe));
                        prop_assert!(!voxels.iter().any(|&voxel| holds(cell, voxel)));
                        let side = cell.side * SIDE;
                        let larger = Cell { low: cell.low.map(|c| c - c % side), side };
                        prop_assert!(voxels.iter().any(|&voxel| holds(larger, voxel)));
                    }
                }
            }
        }
    }
}
