#![doc = include_str!("../README.md")]
#![forbid(unsafe_code)]
#![warn(missing_docs)]

pub mod back_projection;
pub mod camera;
pub mod crowd_map;
pub mod error;
pub mod method;
pub mod observation;
pub mod opinion_pool;
mod raycast;
mod sealed;
mod stamp;
pub mod temporal_blend;
pub mod terrain;
pub mod vibrance;
pub mod view;

/// Vectors and matrices in the signatures.
pub use glam;

pub use back_projection::{Coverage, Projection, project, project_by_rays};
pub use camera::{Camera, Distortion};
pub use crowd_map::{CrowdColumn, CrowdColumns, CrowdMap, Update, VoxelKnowledge, VoxelState};
pub use error::{Error, Result};
pub use method::{
    Calibration, Evidence, EvidenceSettings, Finer, FromBelow, LikelihoodRatio, LinearPool, LogOdds, LogPool,
    Method, MovingAverage, Or, Paper,
};
pub use observation::{CrowdMass, Observation, SeenVoxels};
pub use opinion_pool::{OpinionPool, Rates, Unseen};
pub use raycast::Hit;
pub use temporal_blend::TemporalBlend;
pub use terrain::{Terrain, TerrainKey};
pub use vibrance::vibrant;
pub use view::{Heatmap, View};
