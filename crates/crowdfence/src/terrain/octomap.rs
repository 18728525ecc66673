//! OctoMap files (`.bt`, `.ot`) as bytes: read to leaves, written from voxels.
//!
//! An OctoMap is an octree of at most 16 levels over 2^16 cells per axis. A cell's key counts cells
//! from the lowest corner of the tree; coordinate 0 is at key 2^15, so the cell of a key covers
//! `[i, i + 1) * voxel_size_m` with index `i = key - 2^15`. Child `c` of a node lies in its upper half
//! along x, y, z where bit 0, 1, 2 of `c` is set. A leaf above level 16 ("pruned") stands for all
//! cells below it.
//!
//! Format: Hornung et al., "OctoMap: an efficient probabilistic 3D mapping framework based on
//! octrees", Autonomous Robots 34 (2013); the C++ library (1.10) decides where the paper is silent.

mod error;
mod header;
mod morton;
mod read;
mod write;

pub use error::OctomapError;
pub use header::OctomapHeader;
pub use read::read;
pub use write::{write_binary, write_color};

/// Level of the smallest cells.
const MAX_DEPTH: u8 = 16;
/// Key of coordinate 0.
const KEY_OF_ZERO: i32 = 1 << 15;
/// Log-odds from which the library calls a cell occupied: probability 0.5, inclusive.
const OCCUPANCY_THRESHOLD: f32 = 0.0;

/// A decoded file.
#[derive(Debug, Clone, PartialEq)]
pub struct Octomap {
    /// What the file says before its tree.
    pub header: OctomapHeader,
    /// Every leaf, free ones too, in the order of the tree; they do not overlap.
    pub leaves: Vec<Leaf>,
}

/// A cube of `2^(16 - depth)` cells per side with one value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leaf {
    /// Key (x, y, z) of the lowest cell.
    pub key: [u16; 3],
    /// Level in the tree: 16 is a single cell.
    pub depth: u8,
    /// `.bt` files tell only free from occupied; their leaves get the library's bounds, -2 and 3.5.
    pub log_odds: f32,
    /// Red, green, blue; `.ot` files of `ColorOcTree` only. White is the library's "no colour".
    pub color: Option<[u8; 3]>,
}

impl Leaf {
    /// Whether the library calls it occupied: probability 0.5 and more.
    pub fn is_occupied(&self) -> bool {
        self.log_odds >= OCCUPANCY_THRESHOLD
    }

    /// Cells along one side.
    fn side(&self) -> i32 {
        1 << (MAX_DEPTH - self.depth)
    }

    /// Index of the lowest cell.
    fn lowest_voxel(&self) -> [i32; 3] {
        self.key.map(|key| i32::from(key) - KEY_OF_ZERO)
    }
}

impl Octomap {
    /// Indices of all occupied cells of the smallest size, pruned leaves expanded: in the file's
    /// metres, cell (i, j, k) covers `[i, i + 1) * voxel_size_m` along x, and so on.
    ///
    /// A few bytes can stand for 2^48 cells, so more than `max_voxels` is an error, found before
    /// anything is allocated.
    pub fn occupied_voxels(&self, max_voxels: u64) -> Result<Vec<[i32; 3]>, OctomapError> {
        let occupied = || self.leaves.iter().filter(|leaf| leaf.is_occupied());
        let voxels: u64 = occupied().map(|leaf| (leaf.side() as u64).pow(3)).sum();
        if voxels == 0 {
            return Err(OctomapError::NoOccupiedLeaf { leaves: self.leaves.len() });
        }
        if voxels > max_voxels {
            return Err(OctomapError::TooManyVoxels { voxels, max_voxels });
        }
        let mut expanded = Vec::with_capacity(voxels as usize);
        for leaf in occupied() {
            let ([x, y, z], side) = (leaf.lowest_voxel(), leaf.side());
            for i in x..x + side {
                for j in y..y + side {
                    expanded.extend((z..z + side).map(|k| [i, j, k]));
                }
            }
        }
        Ok(expanded)
    }
}

#[cfg(test)]
mod tests;
