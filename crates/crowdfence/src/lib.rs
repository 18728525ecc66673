//! Multiview Bayesian fusion of human crowd detections onto known 3D terrain.
//!
//! The method in one line: [`project`] every view onto the [`Terrain`], pool the views of one instant
//! ([`OpinionPool`], equations 1-2), blend over time ([`TemporalBlend`], equation 3); [`CrowdMap`] does
//! the three in that order. Everything is arithmetic: no files, no network, no clock.
//!
//! World coordinates are local east-north-up metres, cameras have OpenCV axes (x right, y down, z forward)
//! and stamps are nanoseconds since the Unix epoch.
#![forbid(unsafe_code)]

pub mod back_projection;
pub mod camera;
pub mod crowd_map;
pub mod error;
pub mod opinion_pool;
mod raycast;
pub mod temporal_blend;
pub mod terrain;
pub mod view;

pub use back_projection::{Coverage, Observation, Projection, project};
pub use camera::{Camera, Distortion};
pub use crowd_map::{CrowdMap, Method, Or, Paper, Update, VoxelState};
pub use error::{Error, Result};
pub use opinion_pool::{OpinionPool, Rates, Unseen};
pub use raycast::Hit;
pub use temporal_blend::TemporalBlend;
pub use terrain::Terrain;
pub use view::{Heatmap, View};
