//! Voxels in the order of the tree.

use std::array;

use super::{KEY_OF_ZERO, MAX_DEPTH, OctomapError};

/// Path from the root to a voxel: three bits per level, the index of the child, highest level first.
/// Sorted by code, the voxels of every node are neighbours.
pub(super) fn morton_code(voxel: &[i32; 3]) -> Result<u64, OctomapError> {
    let mut code = 0;
    for (axis, index) in voxel.iter().enumerate() {
        let key = index.checked_add(KEY_OF_ZERO).and_then(|key| u16::try_from(key).ok());
        code |= every_third_bit(key.ok_or(OctomapError::VoxelOutOfRange { voxel: *voxel })?) << axis;
    }
    Ok(code)
}

/// Bit n becomes bit 3 n: halves are moved apart, then theirs, down to single bits.
fn every_third_bit(key: u16) -> u64 {
    let key = u64::from(key);
    let key = (key | key << 16) & 0xff00_00ff;
    let key = (key | key << 8) & 0x00f0_0f00_f00f;
    let key = (key | key << 4) & 0x0c30_c30c_30c3;
    (key | key << 2) & 0x2492_4924_9249
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

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn bits_are_moved_apart() {
        assert_eq!(
            [0b1, 0b11, 0b1010, 0xffff].map(every_third_bit),
            [0o1, 0o11, 0o1010, 0o1111_1111_1111_1111]
        );
    }

    proptest! {
        #[test]
        fn a_code_leads_back_to_its_voxel(voxel in prop::array::uniform3(-32_768i32..32_768)) {
            prop_assert_eq!(voxel_of(morton_code(&voxel).unwrap()), voxel);
        }
    }
}
