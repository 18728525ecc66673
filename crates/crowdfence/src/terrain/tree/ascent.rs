//! Coordinates of many voxels: from the voxel up to the first node that is already known.

use super::{MAX_DEPTH, SIDE_BITS, Tree, corner, nth_set_bit, owner};

/// Path from the last voxel asked for to the root. The next one climbs only to the first node that holds
/// both, which pays where ids are sorted; any order gives the same answers.
pub(crate) struct Ascent<'a> {
    tree: &'a Tree,
    /// Node index per level.
    path: [usize; MAX_DEPTH as usize],
    /// Lowest corner of those nodes.
    low: [[u32; 3]; MAX_DEPTH as usize],
}

impl<'a> Ascent<'a> {
    /// Starts above voxel 0, which lies in the first node of every level.
    pub fn new(tree: &'a Tree) -> Ascent<'a> {
        let mut ascent = Ascent { tree, path: [0; MAX_DEPTH as usize], low: [[0; 3]; MAX_DEPTH as usize] };
        for level in (1..tree.levels.len()).rev() {
            ascent.low[level - 1] = ascent.coordinate_of_child(level, 0);
        }
        ascent
    }

    /// Coordinate of voxel `id`, which must exist.
    pub fn coordinate(&mut self, id: u32) -> [u32; 3] {
        let mut children = [id; MAX_DEPTH as usize];
        let mut level = 0;
        // The root is the same for all.
        while let Some(index) = self.other_owner(level, children[level]) {
            self.path[level] = index;
            level += 1;
            children[level] = index as u32;
        }
        for level in (1..=level).rev() {
            self.low[level - 1] = self.coordinate_of_child(level, children[level]);
        }
        self.coordinate_of_child(0, id)
    }

    /// Index of the node of `level` that owns the child, unless it is the one in the path.
    fn other_owner(&self, level: usize, child: u32) -> Option<usize> {
        let (nodes, last) = (&self.tree.levels[level], self.path[level]);
        let owns = |index: usize| {
            nodes[index].base <= child && nodes.get(index + 1).is_none_or(|next| child < next.base)
        };
        if owns(last) {
            None
        } else if last + 1 < nodes.len() && owns(last + 1) {
            Some(last + 1)
        } else {
            Some(owner(nodes, child))
        }
    }

    /// Lowest corner of a child of the path's node of `level`.
    fn coordinate_of_child(&self, level: usize, child: u32) -> [u32; 3] {
        let node = self.tree.levels[level][self.path[level]];
        let offset = corner(nth_set_bit(node.mask, child - node.base));
        std::array::from_fn(|axis| self.low[level][axis] + (offset[axis] << (SIDE_BITS * level as u32)))
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::build;
    use super::*;

    proptest! {
        #[test]
        fn ids_in_any_order_give_the_coordinates_of_single_look_ups(
            voxels in prop::collection::vec(prop::array::uniform3(0u32..200), 1..200),
            picks in prop::collection::vec(any::<prop::sample::Index>(), 1..100),
            sorted in any::<bool>(),
        ) {
            let tree = build(&voxels, 4);
            let mut ids: Vec<u32> = picks.iter().map(|pick| pick.index(tree.voxel_count()) as u32).collect();
            if sorted {
                ids.sort_unstable();
            }
            let mut ascent = Ascent::new(&tree);
            for id in ids {
                prop_assert_eq!(ascent.coordinate(id), tree.coordinate(id));
            }
        }
    }
}
