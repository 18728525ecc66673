//! By which terrain a voxel id is meant.

use crate::error::{Error, Result};

/// Tells terrains apart, so that ids of one are never taken for those of another.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct TerrainKey {
    /// [`crate::Terrain::fingerprint`].
    pub fingerprint: u64,
    /// [`crate::Terrain::voxel_count`].
    pub voxel_count: usize,
}

impl TerrainKey {
    /// Checks an id that came from outside.
    pub fn check_id(&self, id: i64) -> Result<u32> {
        if (0..self.voxel_count as i64).contains(&id) {
            Ok(id as u32)
        } else {
            Err(Error::VoxelId { id, last: self.voxel_count.saturating_sub(1) })
        }
    }

    /// Refuses what belongs to another terrain; `what` is its name in the message.
    pub fn check_same(&self, found: TerrainKey, what: &'static str) -> Result<()> {
        if *self == found {
            return Ok(());
        }
        Err(Error::OtherTerrain { what, found: found.fingerprint, expected: self.fingerprint })
    }
}
