//! Every way the core can refuse its input. Each message names the offending value and its bound.

use std::fmt::{Display, LowerExp};

use thiserror::Error;

use crate::camera::CameraError;
use crate::terrain::MAX_HEIGHT;
use crate::terrain::octomap::OctomapError;
use crate::terrain::triangles::TrianglesError;

/// Of everything here that can refuse its input.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why an input was refused; [`Error::kind`] says which kind of input. The message of a variant is its documentation.
#[allow(missing_docs)]
#[derive(Debug, Clone, PartialEq, Error)]
pub enum Error {
    #[error(transparent)]
    Camera(#[from] CameraError),
    #[error(transparent)]
    Octomap(#[from] OctomapError),
    #[error(transparent)]
    Triangles(#[from] TrianglesError),

    #[error("{name} is {}; it must be {bound}", short(*value))]
    OutOfRange { name: &'static str, value: f64, bound: &'static str },
    #[error("{name} has {actual} values; {expected} are needed")]
    Length { name: &'static str, actual: usize, expected: usize },

    // --- views
    #[error("drone name is empty; every view needs the name of its drone")]
    UnnamedDrone,
    #[error("heatmap of {height} x {width} (rows x columns) is empty")]
    EmptyHeatmap { height: usize, width: usize },
    #[error("heatmap value at row {row}, column {column} is {value}; it must be inside [0, 1]")]
    HeatmapValue { row: usize, column: usize, value: f32 },
    #[error(
        "heatmap of {height} x {width} (rows x columns) is no reduction of an image of {image_height} x {image_width} by one stride; resize it to the aspect of the image"
    )]
    HeatmapShape { height: usize, width: usize, image_height: u32, image_width: u32 },
    #[error("pose holds {value} at row {row}, column {column}; every entry must be finite")]
    PoseNotFinite { row: usize, column: usize, value: f64 },
    #[error(
        "pose is not rigid: {what} is off by {error:.3e}, bound {bound:.0e}; pass [R t; 0 0 0 1] with an orthonormal R of determinant +1"
    )]
    PoseNotRigid { what: &'static str, error: f64, bound: f64 },

    // --- terrain
    #[error("terrain has no occupied voxel")]
    EmptyTerrain,
    #[error("terrain spans {cells} voxels along {axis}; the tree holds at most {bound}. Use larger voxels")]
    TerrainExtent { axis: char, cells: u64, bound: u64 },
    #[error("terrain has {count} voxels; the bound is {bound}. Use larger voxels")]
    TooManyVoxels { count: u64, bound: u64 },
    #[error(
        "point {index} at ({}, {}, {}) cannot be placed on the voxel grid; coordinates must be finite and within 2^31 voxels of the origin",
        short(*x), short(*y), short(*z)
    )]
    PointOffGrid { index: usize, x: f64, y: f64, z: f64 },
    #[error(
        "height at cell ({column}, {row}) is {}; heights must be within {bound} of the origin, or NaN for a hole",
        short(*value)
    )]
    Height { column: usize, row: usize, value: f32, bound: &'static str },
    #[error(
        "{what} {index} has the height {}; heights of ground are within {MAX_HEIGHT}. Is it a mark of missing data, or in another unit?",
        short(*height)
    )]
    NoGround { what: &'static str, index: usize, height: f64 },
    #[error("voxel id {id} does not exist; the terrain has ids 0 to {last}")]
    VoxelId { id: i64, last: usize },
    #[error("{what} belongs to another terrain (fingerprint {found:016x}, this terrain has {expected:016x})")]
    OtherTerrain { what: &'static str, found: u64, expected: u64 },
    #[error("ray {index}: {what}")]
    Ray { index: usize, what: &'static str },

    // --- observations
    #[error("{name} must be sorted and unique: {id} follows {before} at position {at}")]
    IdsNotSorted { name: &'static str, at: usize, id: u32, before: u32 },
    #[error("voxel {id} is both seen and occluded in one view")]
    SeenAndOccluded { id: u32 },

    // --- method
    #[error(
        "true_positive is {} and false_positive {}; a detector must call crowd more often where there is one. Are they swapped?",
        short(*true_positive), short(*false_positive)
    )]
    UselessRates { true_positive: f64, false_positive: f64 },

    // --- stamps
    #[error("stamp {stamp_ns} ns is negative; stamps are nanoseconds since the Unix epoch")]
    NegativeStamp { stamp_ns: i64 },
    #[error(
        "stamps {before_ns} and {stamp_ns} look like {unit}: as nanoseconds they are {apart_ns} ns apart, soon after 1970. Stamps are nanoseconds since the Unix epoch"
    )]
    StampUnit { before_ns: i64, stamp_ns: i64, apart_ns: u64, unit: &'static str },
    #[error(
        "stamp {stamp_ns} ns is not after the last instant, {last_ns} ns; instants must be integrated in order of time"
    )]
    StampNotAfter { stamp_ns: i64, last_ns: i64 },
    #[error(
        "stamp {stamp_ns} ns lies before the last instant, {last_ns} ns; a crowd map cannot be read in its past"
    )]
    ReadInPast { stamp_ns: i64, last_ns: i64 },
    #[error(
        "stamp {stamp_ns} ns is {gap_s} s after the last instant; the bound max_gap_s is {bound_s} s. Is a clock wrong?"
    )]
    StampJump { stamp_ns: i64, gap_s: f64, bound_s: f64 },
    #[error(
        "view of drone '{drone}' is stamped {offset_s} s away from its instant; the bound is {bound_s} s. Is a clock wrong?"
    )]
    ViewStamp { drone: String, offset_s: f64, bound_s: f64 },

    // --- instants
    #[error("drone '{drone}' appears twice in one instant; each drone gives at most one view")]
    DuplicateDrone { drone: String },
    #[error("drone '{drone}' makes the fleet {count} drones large; fleet_size is {fleet_size}")]
    FleetTooLarge { drone: String, count: usize, fleet_size: usize },

    // --- crowd maps and observations as bytes
    #[error("not {}: {why}", with_article(name))]
    NotOfKind { name: &'static str, why: String },
    #[error("{name} has format version {version}; this build reads version {}", versions(*supported))]
    FormatVersion { name: &'static str, version: u32, supported: u32 },
    #[error("{name} is damaged at byte {offset}: {what}")]
    Damaged { name: &'static str, offset: usize, what: &'static str },
}

/// What a refused input was: bindings have one exception for each.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ErrorKind {
    /// A camera, heatmap or pose, or the drone that they are of.
    View,
    /// A stamp: out of order, in the past, or too far from the others.
    Stamp,
    /// The bytes of an OctoMap or a crowd map, or the terrain that a crowd map belongs to.
    MapFile,
    /// Any other value: a parameter, the content of an array, a terrain.
    Other,
}

impl Error {
    /// Without a wildcard, so that a new variant has to choose.
    pub fn kind(&self) -> ErrorKind {
        match self {
            Error::Camera(_)
            | Error::UnnamedDrone
            | Error::EmptyHeatmap { .. }
            | Error::HeatmapValue { .. }
            | Error::HeatmapShape { .. }
            | Error::PoseNotFinite { .. }
            | Error::PoseNotRigid { .. }
            | Error::DuplicateDrone { .. }
            | Error::FleetTooLarge { .. } => ErrorKind::View,
            Error::NegativeStamp { .. }
            | Error::StampUnit { .. }
            | Error::StampNotAfter { .. }
            | Error::ReadInPast { .. }
            | Error::StampJump { .. }
            | Error::ViewStamp { .. } => ErrorKind::Stamp,
            Error::Octomap(_)
            | Error::NotOfKind { .. }
            | Error::FormatVersion { .. }
            | Error::Damaged { .. }
            | Error::OtherTerrain { .. } => ErrorKind::MapFile,
            Error::Triangles(_)
            | Error::OutOfRange { .. }
            | Error::Length { .. }
            | Error::EmptyTerrain
            | Error::TerrainExtent { .. }
            | Error::TooManyVoxels { .. }
            | Error::PointOffGrid { .. }
            | Error::Height { .. }
            | Error::NoGround { .. }
            | Error::VoxelId { .. }
            | Error::IdsNotSorted { .. }
            | Error::SeenAndOccluded { .. }
            | Error::UselessRates { .. }
            | Error::Ray { .. } => ErrorKind::Other,
        }
    }
}

/// Refuses a value that does not satisfy its bound (NaN satisfies none).
pub(crate) fn require(ok: bool, name: &'static str, value: f64, bound: &'static str) -> Result<()> {
    if ok { Ok(()) } else { Err(Error::OutOfRange { name, value, bound }) }
}

/// A number as people write it: 1e308 rather than its 309 digits.
pub(crate) fn short<T: Into<f64> + Copy + Display + LowerExp>(value: T) -> String {
    match value.into().abs() {
        0.0 | 1e-4..1e9 => value.to_string(),
        size if size.is_finite() => format!("{value:e}"),
        _ => value.to_string(), // NaN, inf
    }
}

fn with_article(name: &str) -> String {
    let article = if name.starts_with(['a', 'e', 'i', 'o', 'u']) { "an" } else { "a" };
    format!("{article} {name}")
}

fn versions(newest: u32) -> String {
    if newest == 1 { "1".into() } else { format!("1 to {newest}") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_messages_stay_readable() {
        for (value, words) in [
            (0.0, "x is 0;"),
            (-7.25, "x is -7.25;"),
            (1e308, "x is 1e308;"),
            (-2.5e-300, "x is -2.5e-300;"),
            (f64::NAN, "x is NaN;"),
            (f64::NEG_INFINITY, "x is -inf;"),
        ] {
            let message = require(false, "x", value, "something else").unwrap_err().to_string();
            assert!(message.starts_with(words), "{message}");
        }
    }
}
