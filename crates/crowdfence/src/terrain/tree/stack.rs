//! The tree from above: squares of the grid, each with the nodes that lie over it.

use super::{Node, SIDE, SIDE_BITS, SIDE_MASK, Tree, set_bits};

/// A part of the tree in one stack: a node, or a voxel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Layer {
    /// Lowest z.
    pub low: u32,
    /// Of the node, or the voxel's id.
    index: u32,
}

impl Layer {
    /// Of a layer of a column.
    pub fn voxel_id(self) -> u32 {
        self.index
    }
}

/// A node of the lowest level: the voxels of 4 x 4 columns, four on each.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Brick {
    /// Lowest z.
    pub low: u32,
    pub(super) node: Node,
}

impl Brick {
    /// Without a voxel.
    pub const EMPTY: Brick = Brick { low: 0, node: Node { mask: 0, base: 0 } };
    /// Columns along one side, and voxels upwards.
    pub const SIDE: u32 = SIDE;

    /// Bit x + 4 y for the voxel of each column at a height from 0 to 3.
    #[inline(always)]
    pub fn level(&self, z: u32) -> u16 {
        (self.node.mask >> (z * SIDE * SIDE)) as u16
    }

    /// Bit z for each voxel of column x + 4 y.
    #[inline(always)]
    pub fn column(&self, number: u32) -> u32 {
        let bits = self.node.mask >> number & 0x0001_0001_0001_0001;
        (bits | bits >> 15 | bits >> 30 | bits >> 45) as u32 & 0xf
    }

    /// Of a voxel of column x + 4 y that is there.
    #[inline(always)]
    pub fn voxel_id(&self, number: u32, z: u32) -> u32 {
        self.node.child(number + (z & SIDE_MASK) * SIDE * SIDE)
    }

    /// Its ids follow each other.
    #[inline(always)]
    pub fn first_id(&self) -> u32 {
        self.node.base
    }

    /// Whether a height lies in it.
    #[inline(always)]
    pub fn contains(&self, z: u32) -> bool {
        self.low == z & !SIDE_MASK
    }
}

/// A square of the grid with something over it. The one without levels below is a column of voxels.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Square {
    /// Lowest corner.
    pub low: [u32; 2],
    levels: u32,
    /// Its layers in the list.
    first: usize,
    end: usize,
}

impl Square {
    /// Levels of a square of 4 x 4 columns.
    pub const LEAF: u32 = 1;

    pub fn levels(&self) -> u32 {
        self.levels
    }

    /// Voxels along one side.
    pub fn side(&self) -> u32 {
        1 << (SIDE_BITS * self.levels)
    }

    pub fn is_column(&self) -> bool {
        self.levels == 0
    }
}

/// A walk down the tree, one square inside the other. Squares are let go in the reverse order of their taking.
pub(crate) struct Stacks<'a> {
    tree: &'a Tree,
    /// Of the squares taken so far: each one's layers in a row, from the lowest upwards.
    layers: Vec<Layer>,
}

impl<'a> Stacks<'a> {
    /// Children of a square along one side.
    pub const SIDE: u32 = SIDE;

    pub fn new(tree: &'a Tree) -> Stacks<'a> {
        Stacks { tree, layers: vec![Layer { low: 0, index: 0 }] }
    }

    /// The whole grid.
    pub fn root(&self) -> Square {
        Square { low: [0; 2], levels: self.tree.depth(), first: 0, end: 1 }
    }

    /// Square (x, y) of the 4 x 4 of a square that is no column; None where there is nothing.
    #[inline]
    pub fn child(&mut self, square: &Square, x: u32, y: u32) -> Option<Square> {
        let levels = square.levels - 1;
        let (side, shift) = (1 << (SIDE_BITS * levels), x | y << SIDE_BITS);
        let first = self.layers.len();
        for at in square.first..square.end {
            let parent = self.layers[at];
            let node = self.tree.node(levels, parent.index);
            for z in 0..SIDE {
                let number = shift | z << (2 * SIDE_BITS);
                if node.has(number) {
                    self.layers.push(Layer { low: parent.low + z * side, index: node.child(number) });
                }
            }
        }
        let low = [square.low[0] + x * side, square.low[1] + y * side];
        let end = self.layers.len();
        (first < end).then_some(Square { low, levels, first, end })
    }

    /// The square of a few levels that a place lies in, if there is anything in it.
    pub fn square_at(&mut self, at: [u32; 2], levels: u32) -> Option<Square> {
        let start = self.layers.len();
        let mut square = self.root();
        if at.iter().any(|&coordinate| coordinate >= square.side()) {
            return None;
        }
        while square.levels > levels {
            let shift = SIDE_BITS * (square.levels - 1);
            let [x, y] = at.map(|coordinate| coordinate >> shift & (SIDE - 1));
            let Some(child) = self.child(&square, x, y) else {
                self.layers.truncate(start);
                return None;
            };
            square = child;
        }
        if square.levels == self.tree.depth() {
            // The root is let go of by nobody: its layer is taken once more.
            self.layers.extend_from_within(square.first..square.end);
        } else {
            // Its own layers alone are kept.
            self.layers.drain(start..square.first);
        }
        Some(Square { first: start, end: self.layers.len(), ..square })
    }

    /// The bricks over a square of one or two levels, each with the place of its columns among the 4 x 4 of the square;
    /// those of one place from the lowest upwards.
    #[inline(always)]
    pub fn for_bricks(&self, square: &Square, mut each: impl FnMut([u32; 2], Brick)) {
        for layer in self.layers(square) {
            let brick = |low, index| Brick { low, node: self.tree.node(0, index) };
            if square.levels == Square::LEAF {
                each([0; 2], brick(layer.low, layer.index));
                continue;
            }
            let node = self.tree.node(1, layer.index);
            for (number, index) in set_bits(node.mask).zip(node.base..) {
                let [x, y, z] = super::corner(number);
                each([x, y], brick(layer.low + z * SIDE, index));
            }
        }
    }

    /// Lets go of a square and of all that were taken after it.
    pub fn release(&mut self, square: &Square) {
        self.layers.truncate(square.first);
    }

    /// From the lowest upwards.
    pub fn layers(&self, square: &Square) -> &[Layer] {
        &self.layers[square.first..square.end]
    }

    /// Lowest and highest z between which all voxels of a square lie.
    pub fn span(&self, square: &Square) -> (u32, u32) {
        let layers = self.layers(square);
        (layers[0].low, layers[layers.len() - 1].low + square.side())
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::tests::build;
    use super::*;

    fn columns(stacks: &mut Stacks, square: Square, found: &mut Vec<[u32; 4]>) {
        if square.is_column() {
            let [x, y] = square.low;
            found.extend(stacks.layers(&square).iter().map(|layer| [x, y, layer.low, layer.voxel_id()]));
            return;
        }
        for (x, y) in (0..4).flat_map(|x| (0..4).map(move |y| (x, y))) {
            if let Some(child) = stacks.child(&square, x, y) {
                columns(stacks, child, found);
                stacks.release(&child);
            }
        }
    }

    proptest! {
        #[test]
        fn a_place_leads_to_its_column(
            voxels in prop::collection::vec(prop::array::uniform3(0u32..64), 1..200),
            place in prop::array::uniform2(0u32..70),
        ) {
            let tree = build(&voxels, 3);
            let mut stacks = Stacks::new(&tree);
            let expected: Vec<(u32, u32)> =
                if place.iter().all(|&at| at < 64) { tree.column(place[0], place[1]).collect() } else { vec![] };
            let mut found = Vec::new();
            if let Some(tile) = stacks.square_at(place, 2) {
                let [x, y] = place.map(|at| at % 16);
                let number = x % 4 + 4 * (y % 4);
                stacks.for_bricks(&tile, |at, brick| {
                    if at == [x / 4, y / 4] {
                        let heights = (brick.low..brick.low + 4).filter(|z| brick.level(z - brick.low) >> number & 1 != 0);
                        found.extend(heights.map(|z| (z, brick.voxel_id(number, z))));
                        assert!(brick.contains(brick.low + 3) && !brick.contains(brick.low + 4));
                    }
                });
                stacks.release(&tile);
            }
            prop_assert_eq!(found, expected);
            prop_assert_eq!(stacks.layers.len(), 1);
        }

        #[test]
        fn the_walk_meets_every_voxel_once_in_its_column(
            mut voxels in prop::collection::vec(prop::array::uniform3(0u32..64), 1..200),
        ) {
            let tree = build(&voxels, 3);
            let mut stacks = Stacks::new(&tree);
            let root = stacks.root();
            let mut found = Vec::new();
            columns(&mut stacks, root, &mut found);
            for pair in found.windows(2).filter(|pair| pair[0][..2] == pair[1][..2]) {
                prop_assert!(pair[0][2] < pair[1][2], "a column goes upwards");
            }
            voxels.sort_unstable();
            voxels.dedup();
            let mut expected: Vec<[u32; 4]> =
                voxels.iter().map(|&voxel| [voxel[0], voxel[1], voxel[2], tree.id(voxel).unwrap()]).collect();
            expected.sort_unstable();
            found.sort_unstable();
            prop_assert_eq!(found, expected);
        }
    }
}
