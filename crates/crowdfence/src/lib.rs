//! Multiview Bayesian fusion of human crowd detections onto known 3D terrain.
//!
//! In one line: [`project`] every view onto the [`Terrain`], let a [`Method`] fuse what the views of one instant
//! say ([`Paper`]: [`OpinionPool`], equations 1-2, then [`TemporalBlend`], equation 3), store it; [`CrowdMap`]
//! does the three in that order. Everything is arithmetic: no files, no network, no clock.
//!
//! World coordinates are local east-north-up metres, cameras have OpenCV axes (x right, y down, z forward)
//! and stamps are nanoseconds since the Unix epoch.
#![forbid(unsafe_code)]

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

pub use back_projection::{Coverage, Projection, project, project_by_rays};
pub use camera::{Camera, Distortion};
pub use crowd_map::{CrowdColumn, CrowdColumns, CrowdMap, Update, VoxelKnowledge, VoxelState};
pub use error::{Error, Result};
pub use method::{
    Calibration, Evidence, EvidenceSettings, LikelihoodRatio, LinearPool, LogOdds, LogPool, Method,
    MovingAverage, Or, Paper,
};
pub use observation::{CrowdMass, Observation, SeenVoxels};
pub use opinion_pool::{OpinionPool, Rates, Unseen};
pub use raycast::Hit;
pub use temporal_blend::TemporalBlend;
pub use terrain::{Terrain, TerrainKey};
pub use vibrance::vibrant;
pub use view::{Heatmap, View};
