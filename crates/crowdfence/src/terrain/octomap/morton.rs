//! Voxels in the order of the tree.

use std::array;

use super::{KEY_OF_ZERO, MAX_DEPTH, OctomapError};

/// Path from the root to a voxel: three bits per level, the index of the child, highest level first.
/// Sorted by code, the voxels of every node are neighbours.
pub(super) fn morton_code(voxel: &[i32; 3]) -> Result<u64, OctomapError> {
    let mut code = 0;
    for (axis, index) in voxel.iter().enumerate() {
        let key = index.checked_add(KEY_OF_ZERO).and_then(|key| u16::try_from(key).ok());
        let key = u64::from(key.ok_or(OctomapError::VoxelOutOfRange { voxel: *voxel })?);
        for bit in 0..16 {
            code |= (key >> bit & 1) << (3 * bit + axis);
        }
    }
    Ok(code)
}

pub(super) fn voxel_of(morton_code: u64) -> [i32; 3] {
    let bit = |axis: usize, bit: usize| (morton_code >> (3 * bit + axis) & 1) as i32;
    let key = |axis| (0..16).rev().fold(0, |key, i| key << 1 | bit(axis, i));
    array::from_fn(|axis| key(axis) - KEY_OF_ZERO)
}

/// The voxels under each of the eight children of a node at `depth`; `sorted` by code.
pub(super) fn split<T>(mut sorted: &[T], depth: u8, code: impl Fn(&T) -> u64) -> [&[T]; 8] {
    let shift = code_bits(depth + 1);
    array::from_fn(|index| {
        let end = sorted.partition_point(|voxel| (code(voxel) >> shift & 7) as usize <= index);
        let (child, rest) = sorted.split_at(end);
        sorted = rest;
        child
    })
}

/// Whether that many different voxels fill a node at `depth`.
pub(super) fn is_full(voxel_count: usize, depth: u8) -> bool {
    voxel_count as u64 == 1 << code_bits(depth)
}

/// Bits of a code that lie below a node at `depth`.
fn code_bits(depth: u8) -> u32 {
    3 * u32::from(MAX_DEPTH - depth)
}
