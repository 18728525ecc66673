use super::header::{BINARY_FIRST_LINE, FULL_FIRST_LINE};

/// Why bytes are no usable OctoMap, or why voxels cannot be written as one. Byte positions count
/// from the start of the file. The message of a variant is its documentation.
#[allow(missing_docs)]
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum OctomapError {
    #[error(
        "not an OctoMap file: the first line is {found:?} instead of {BINARY_FIRST_LINE:?} \
         or {FULL_FIRST_LINE:?}"
    )]
    FirstLine { found: String },
    #[error("OctoMap header without `{field}`")]
    MissingField { field: &'static str },
    #[error("OctoMap header gives `{field} {found}`, but {field} must be {expected}")]
    InvalidField { field: &'static str, found: String, expected: &'static str },
    #[error("OctoMap header gives `{field}` twice")]
    RepeatedField { field: &'static str },
    #[error("OctoMap header has the unknown keyword {keyword:?}; if it is a comment, start its line with #")]
    UnknownKeyword { keyword: String },
    #[error(
        "OctoMap tree type {id:?} cannot be read from an .ot file (OcTree, OcTreeStamped and \
         ColorOcTree can); save it as .bt, which has the same layout for every type"
    )]
    UnsupportedTree { id: String },
    #[error("OctoMap of 0 nodes: nothing was mapped")]
    NoNodes,
    #[error(
        "OctoMap cut short: a node at byte {node_byte} needs more than the {file_bytes} bytes of the file"
    )]
    Truncated { node_byte: usize, file_bytes: usize },
    #[error("OctoMap node at byte {byte} has children below level 16, the deepest of an OctoMap")]
    TooDeep { byte: usize },
    #[error("OctoMap inner node at byte {byte} has no children, so it is neither free nor occupied")]
    EmptyInnerNode { byte: usize },
    #[error("OctoMap node at byte {byte} has log-odds that are not a number")]
    LogOddsNan { byte: usize },
    #[error("OctoMap of {read} nodes, but its header says {declared}")]
    NodeCount { declared: u64, read: u64 },
    #[error("OctoMap ends at byte {byte}, but {extra} more bytes follow")]
    TrailingBytes { byte: usize, extra: usize },
    #[error("OctoMap without an occupied leaf: all {leaves} leaves are free")]
    NoOccupiedLeaf { leaves: usize },
    #[error("OctoMap stands for {voxels} occupied voxels, more than the bound of {max_voxels}")]
    TooManyVoxels { voxels: u64, max_voxels: u64 },

    #[error("voxel size {voxel_size_m} m cannot be written to an OctoMap: it must be finite and above 0")]
    VoxelSize { voxel_size_m: f64 },
    #[error("voxel {voxel:?} does not fit an OctoMap, whose indices go from -32768 to 32767")]
    VoxelOutOfRange { voxel: [i32; 3] },
    #[error(
        "{voxels} voxels with {colors} colours and {probabilities} probabilities; \
         there must be one of each per voxel"
    )]
    LengthMismatch { voxels: usize, colors: usize, probabilities: usize },
    #[error("voxel {voxel:?} has the probability {probability}; it must lie in [0, 1]")]
    Probability { voxel: [i32; 3], probability: f64 },
    #[error("voxel {voxel:?} is given more than once, so its colour and probability are ambiguous")]
    RepeatedVoxel { voxel: [i32; 3] },
}
