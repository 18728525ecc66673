//! A column of voxels, from below.

use super::{Descent, Place, Tree};

impl Tree {
    /// z and id of every voxel at (x, y) inside the tree's cube, from the lowest upwards. What is empty between
    /// them is passed in steps as large as the tree's cells.
    pub fn column(&self, x: u32, y: u32) -> impl Iterator<Item = (u32, u32)> {
        let ceiling = self.root().cell.side;
        let mut descent = Descent::new(self);
        let mut above = 0;
        std::iter::from_fn(move || {
            while above < ceiling {
                let z = above;
                match descent.locate([x, y, z]) {
                    Place::Voxel(id) => {
                        above = z + 1;
                        return Some((z, id));
                    }
                    Place::Empty(cell) => above = cell.low[2] + cell.side,
                }
            }
            None
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::build;

    proptest! {
        #[test]
        fn a_column_is_that_of_a_scan(
            mut voxels in prop::collection::vec((0u32..9, 0u32..9, 0u32..256).prop_map(<[u32; 3]>::from), 1..200),
        ) {
            let tree = build(&voxels, 4);
            voxels.sort_unstable();
            voxels.dedup();
            for (x, y) in (0..9).flat_map(|x| (0..9).map(move |y| (x, y))) {
                let scan = voxels.iter().filter(|voxel| voxel[..2] == [x, y]);
                let scan = scan.map(|&voxel| (voxel[2], tree.id(voxel).unwrap()));
                prop_assert_eq!(tree.column(x, y).collect::<Vec<_>>(), scan.collect::<Vec<_>>());
            }
        }
    }
}
