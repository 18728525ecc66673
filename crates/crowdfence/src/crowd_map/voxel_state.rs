//! What is known about a voxel, as whoever reads the map sees it.

/// In one word. Unseen is never the same as empty.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[repr(u8)]
pub enum VoxelState {
    /// No view has ever seen it.
    NeverSeen = 0,
    /// Never seen: a camera pointed at it and something hid it.
    Occluded = 1,
    /// Seen lately, and the looks speak against crowd: on the whole, and none of the last one and of 2 s before it for it,
    /// 2 in log odds above the prior by itself.
    Empty = 2,
    /// The last look left it empty, but too long ago to be evidence of absence.
    Stale = 3,
    /// P is at or above the threshold.
    Crowd = 4,
    /// Seen, not crowd now, and never mind how long ago: the last look did not leave it empty. From too far, too flat,
    /// too little; or crowd was seen, and is forgotten by now, or outweighed by drones that see nobody.
    NotCleared = 5,
}

/// In full.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelKnowledge {
    /// In one word.
    pub state: VoxelState,
    /// Of crowd; of a voxel that nobody has seen the method's initial value, which says nothing about the place.
    pub probability: f64,
    /// Age of the last look; None = nobody has seen it.
    pub age_s: Option<f64>,
    /// Looks that the method still remembers, in those that weigh 1; None where it does not count them.
    pub looks: Option<f64>,
    /// How many drones have ever seen it.
    pub drones: u32,
}
