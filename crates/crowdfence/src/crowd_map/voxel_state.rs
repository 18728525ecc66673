//! The six states, as whoever reads the map sees them.

/// What is known about a voxel. Unseen is never the same as empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum VoxelState {
    /// No view has ever seen it.
    NeverSeen = 0,
    /// Never seen: a camera pointed at it and something hid it.
    Occluded = 1,
    /// Seen lately, and the looks speak against crowd.
    Empty = 2,
    /// Seen, not crowd, but too long ago to be evidence of absence.
    Stale = 3,
    Crowd = 4,
    /// Seen lately, not crowd, but in a way that would not have shown one: from too far, too flat, too little.
    NotCleared = 5,
}
