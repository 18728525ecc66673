//! The ends of a column of voxels, by descending the tree from below and from above.

use super::{SIDE, SIDE_BITS, Tree, cell_number};

impl Tree {
    /// Lowest and highest z of the voxels at (x, y) inside the tree's cube; None where there is no voxel.
    pub fn column(&self, x: u32, y: u32) -> Option<(u32, u32)> {
        let upwards = std::array::from_fn(|k| k as u32);
        let downwards = std::array::from_fn(|k| (SIDE - 1 - k) as u32);
        let first = |order| self.first_in_column(self.depth() - 1, 0, [x, y, 0], order);
        Some((first(upwards)?, first(downwards)?))
    }

    /// z of the first voxel above (x, y, floor) in a node that begins at this floor, its cells taken in
    /// `order`. An occupied cell may hold voxels beside the column only: then the search goes on in the next.
    fn first_in_column(
        &self,
        level: u32,
        index: u32,
        [x, y, floor]: [u32; 3],
        order: [u32; SIDE],
    ) -> Option<u32> {
        let node = self.node(level, index);
        order.into_iter().find_map(|step| {
            let z = floor + (step << (SIDE_BITS * level));
            let number = cell_number([x, y, z], level);
            match (node.has(number), level) {
                (false, _) => None,
                (true, 0) => Some(z),
                (true, _) => self.first_in_column(level - 1, node.child(number), [x, y, z], order),
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::build;

    proptest! {
        #[test]
        fn the_ends_of_a_column_are_those_of_a_scan(
            voxels in prop::collection::vec((0u32..9, 0u32..9, 0u32..256).prop_map(<[u32; 3]>::from), 1..200),
        ) {
            let tree = build(&voxels, 4);
            for (x, y) in (0..9).flat_map(|x| (0..9).map(move |y| (x, y))) {
                let column = || voxels.iter().filter(|voxel| voxel[..2] == [x, y]).map(|voxel| voxel[2]);
                prop_assert_eq!(tree.column(x, y), column().min().zip(column().max()));
            }
        }
    }
}
