//! Sparse 64-tree over a cubic grid. Every node splits its cube into 4 x 4 x 4 cells and keeps one bit a
//! cell; the children of a node lie next to each other, so a child's index is the node's base plus the
//! number of set bits below it. At the lowest level that index is the voxel's rank, its id.
//!
//! This layout is known here and in `tree/` alone; the rest of the crate sees coordinates, ids and [`Cell`]s.

mod ascent;
mod block;
mod column;
mod descent;
mod stack;

pub(crate) use ascent::Ascent;
pub(crate) use block::Block;
pub(crate) use descent::{Descent, Place};
pub(crate) use stack::{Brick, Layer, Square, Stacks};

/// Bits of a coordinate that one level takes: a node has 4 cells along each side.
const SIDE_BITS: u32 = 2;
const SIDE: u32 = 1 << SIDE_BITS;
const SIDE_MASK: u32 = SIDE - 1;
/// Bits of a voxel key that one level takes: x, y and z, two each.
const KEY_BITS: u32 = 3 * SIDE_BITS;
const KEY_MASK: u64 = (1 << KEY_BITS) - 1;
/// Levels that fit a 64-bit key.
const MAX_DEPTH: u32 = 10;
/// Longest side of the grid, in voxels.
pub const MAX_EXTENT: u64 = 1 << (SIDE_BITS * MAX_DEPTH);

/// A cube of the grid: a voxel, a cell of a node, or the whole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Cell {
    /// Lowest corner, tree coordinates.
    pub low: [u32; 3],
    /// Voxels along one side.
    pub side: u32,
}

impl Cell {
    /// Cell of a node of `level` in which a coordinate lies.
    fn around(coordinate: [u32; 3], level: u32) -> Cell {
        let side = 1 << (SIDE_BITS * level);
        Cell { low: coordinate.map(|c| c & !(side - 1)), side }
    }
}

/// The part of the tree in one occupied cell, down to a single voxel.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Branch {
    pub cell: Cell,
    /// Levels below the cell; a voxel has none.
    levels: u32,
    /// Of the cell's node, or the voxel's id.
    index: u32,
}

impl Branch {
    pub fn voxel_id(self) -> Option<u32> {
        (self.levels == 0).then_some(self.index)
    }
}

#[derive(Debug, Clone, Copy)]
struct Node {
    /// Bit x + 4 y + 16 z says whether cell (x, y, z) is there.
    mask: u64,
    /// Index of the first child, one level below (a voxel id at the lowest level).
    base: u32,
}

impl Node {
    fn has(self, number: u32) -> bool {
        self.mask >> number & 1 != 0
    }

    fn child(self, number: u32) -> u32 {
        self.base + (self.mask & ((1 << number) - 1)).count_ones()
    }
}

#[derive(Debug, Clone)]
pub(crate) struct Tree {
    /// `levels[0]` holds the bricks of 4 x 4 x 4 voxels; the last level holds the root alone.
    levels: Vec<Vec<Node>>,
    voxel_count: usize,
}

impl Tree {
    /// Number of levels needed for a grid of `extent` voxels along its longest side, if the tree can hold it.
    pub fn depth_for(extent: u64) -> Option<u32> {
        (1..=MAX_DEPTH).find(|depth| extent <= 1 << (SIDE_BITS * depth))
    }

    /// Sort key of a grid coordinate: the cell numbers from the root downwards, six bits a level.
    pub fn key(coordinate: [u32; 3], depth: u32) -> u64 {
        (0..depth).rev().fold(0, |key, level| key << KEY_BITS | u64::from(cell_number(coordinate, level)))
    }

    /// Builds the tree from sorted keys; repeated keys count once. The caller bounds their number.
    pub fn from_sorted_keys(keys: &[u64], depth: u32) -> Tree {
        let mut levels = vec![Vec::<Node>::new(); depth as usize];
        let mut voxel_count = 0;
        let mut previous = None;
        for &key in keys {
            if previous == Some(key) {
                continue;
            }
            for level in (0..depth).rev() {
                let node_key = |key: u64| key >> (KEY_BITS * (level + 1)); // root: all bits are gone
                if previous.is_none_or(|p| node_key(p) != node_key(key)) {
                    let base = match level {
                        0 => voxel_count,
                        _ => levels[level as usize - 1].len(),
                    };
                    levels[level as usize].push(Node { mask: 0, base: base as u32 });
                }
                let node = levels[level as usize].last_mut().expect("a node was pushed for this key");
                node.mask |= 1 << (key >> (KEY_BITS * level) & KEY_MASK);
            }
            voxel_count += 1;
            previous = Some(key);
        }
        levels.iter_mut().for_each(Vec::shrink_to_fit);
        Tree { levels, voxel_count }
    }

    pub fn depth(&self) -> u32 {
        self.levels.len() as u32
    }

    pub fn voxel_count(&self) -> usize {
        self.voxel_count
    }

    pub fn bytes(&self) -> usize {
        self.levels.iter().map(|nodes| std::mem::size_of_val(nodes.as_slice())).sum()
    }

    /// Checksum of all occupied cells.
    pub fn checksum(&self) -> u32 {
        let mut hasher = crc32fast::Hasher::new();
        for node in self.levels.iter().flatten() {
            hasher.update(&node.mask.to_le_bytes());
        }
        hasher.finalize()
    }

    pub fn root(&self) -> Branch {
        let side = 1 << (SIDE_BITS * self.depth());
        Branch { cell: Cell { low: [0; 3], side }, levels: self.depth(), index: 0 }
    }

    /// The occupied cells of a branch one level below, in the order of their voxels' ids; of a voxel none.
    pub fn children(&self, branch: Branch) -> impl Iterator<Item = Branch> {
        let node = (branch.levels > 0).then(|| self.node(branch.levels - 1, branch.index));
        let side = branch.cell.side >> SIDE_BITS;
        node.into_iter().flat_map(|node| set_bits(node.mask).zip(node.base..)).map(move |(number, index)| {
            let offset = corner(number);
            let low = std::array::from_fn(|k| branch.cell.low[k] + side * offset[k]);
            Branch { cell: Cell { low, side }, levels: branch.levels - 1, index }
        })
    }

    /// Node `index` of a level; the root is node 0 of level `depth - 1`.
    fn node(&self, level: u32, index: u32) -> Node {
        self.levels[level as usize][index as usize]
    }

    /// Id of the voxel at a coordinate inside the tree's cube.
    pub fn id(&self, coordinate: [u32; 3]) -> Option<u32> {
        let mut index = 0;
        for level in (0..self.depth()).rev() {
            let node = self.node(level, index);
            let number = cell_number(coordinate, level);
            if !node.has(number) {
                return None;
            }
            index = node.child(number);
        }
        Some(index)
    }

    /// Coordinate of voxel `id`, which must exist.
    pub fn coordinate(&self, id: u32) -> [u32; 3] {
        let mut coordinate = [0; 3];
        let mut child = id;
        for (level, nodes) in self.levels.iter().enumerate() {
            let index = owner(nodes, child);
            let offset = corner(nth_set_bit(nodes[index].mask, child - nodes[index].base));
            for (axis, value) in coordinate.iter_mut().enumerate() {
                *value |= offset[axis] << (SIDE_BITS * level as u32);
            }
            child = index as u32;
        }
        coordinate
    }
}

/// Index of the node that owns a child, by bisection: bases grow with the index.
fn owner(nodes: &[Node], child: u32) -> usize {
    nodes.partition_point(|node| node.base <= child) - 1
}

/// Number, within its node of `level`, of the cell in which a coordinate lies.
fn cell_number(coordinate: [u32; 3], level: u32) -> u32 {
    let [x, y, z] = coordinate.map(|c| c >> (SIDE_BITS * level) & SIDE_MASK);
    x | y << SIDE_BITS | z << (2 * SIDE_BITS)
}

/// Place of a cell in its node, in cells along x, y and z.
fn corner(number: u32) -> [u32; 3] {
    [0, 1, 2].map(|axis| number >> (SIDE_BITS * axis) & SIDE_MASK)
}

fn set_bits(mut mask: u64) -> impl Iterator<Item = u32> {
    std::iter::from_fn(move || {
        let lowest = (mask != 0).then(|| mask.trailing_zeros())?;
        mask &= mask - 1;
        Some(lowest)
    })
}

/// Position of the n-th set bit, counted from 0.
fn nth_set_bit(mut mask: u64, n: u32) -> u32 {
    for _ in 0..n {
        mask &= mask - 1;
    }
    mask.trailing_zeros()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    pub(super) fn build(coordinates: &[[u32; 3]], depth: u32) -> Tree {
        let mut keys: Vec<u64> = coordinates.iter().map(|&c| Tree::key(c, depth)).collect();
        keys.sort_unstable();
        Tree::from_sorted_keys(&keys, depth)
    }

    #[test]
    fn depth_is_the_smallest_that_holds_the_extent() {
        assert_eq!(Tree::depth_for(1), Some(1));
        assert_eq!(Tree::depth_for(4), Some(1));
        assert_eq!(Tree::depth_for(5), Some(2));
        assert_eq!(Tree::depth_for(MAX_EXTENT), Some(10));
        assert_eq!(Tree::depth_for(MAX_EXTENT + 1), None);
    }

    #[test]
    fn a_key_reads_from_the_root_downwards() {
        // (5, 2, 0): cell (1, 0, 0) of the root, then cell (1, 2, 0) of the brick: 1 and 1 + 4 * 2 = 9.
        assert_eq!(Tree::key([5, 2, 0], 2), 1 << 6 | 9);
    }

    #[test]
    fn a_full_brick_costs_one_node_a_level() {
        let brick: Vec<[u32; 3]> = (0..64).map(|i| [i & 3, i >> 2 & 3, i >> 4]).collect();
        let tree = build(&brick, 3);
        assert_eq!(tree.voxel_count(), 64);
        assert_eq!(tree.bytes(), 3 * 16);
    }

    proptest! {
        #[test]
        fn ids_are_ranks_and_lead_back_to_their_coordinates(
            mut coordinates in prop::collection::vec(prop::array::uniform3(0u32..200), 1..200)
        ) {
            let tree = build(&coordinates, 4);
            coordinates.sort_by_key(|&c| Tree::key(c, 4));
            coordinates.dedup();
            prop_assert_eq!(tree.voxel_count(), coordinates.len());
            for (rank, &coordinate) in coordinates.iter().enumerate() {
                prop_assert_eq!(tree.id(coordinate), Some(rank as u32));
                prop_assert_eq!(tree.coordinate(rank as u32), coordinate);
            }
        }

        #[test]
        fn children_lead_from_the_root_to_every_voxel_in_order(
            coordinates in prop::collection::vec(prop::array::uniform3(0u32..200), 1..200)
        ) {
            let tree = build(&coordinates, 4);
            let mut branches = vec![tree.root()];
            for _ in 0..tree.depth() {
                branches = branches.into_iter().flat_map(|branch| tree.children(branch)).collect();
            }
            let found: Vec<_> = branches.iter().map(|voxel| (voxel.voxel_id(), voxel.cell)).collect();
            let ids = 0..tree.voxel_count() as u32;
            let expected = ids.map(|id| (Some(id), Cell { low: tree.coordinate(id), side: 1 }));
            prop_assert_eq!(found, expected.collect::<Vec<_>>());
            prop_assert_eq!(branches.into_iter().flat_map(|voxel| tree.children(voxel)).count(), 0);
        }

        #[test]
        fn absent_coordinates_have_no_id(
            coordinates in prop::collection::vec(prop::array::uniform3(0u32..16), 1..50),
            probe in prop::array::uniform3(0u32..16)
        ) {
            let tree = build(&coordinates, 2);
            prop_assert_eq!(tree.id(probe).is_some(), coordinates.contains(&probe));
        }
    }
}
