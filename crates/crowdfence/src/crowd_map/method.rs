//! How the views of an instant become a probability, and how long it lasts.

use crate::error::{Result, require};
use crate::opinion_pool::OpinionPool;
use crate::temporal_blend::TemporalBlend;

#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Method {
    Paper(Paper),
    Or(Or),
}

impl Method {
    /// N of equation 1.
    pub fn fleet_size(&self) -> usize {
        match self {
            Method::Paper(paper) => paper.fleet_size,
            Method::Or(or) => or.fleet_size,
        }
    }

    pub(super) fn decay(&self) -> Decay {
        match self {
            Method::Paper(paper) => paper.decay,
            Method::Or(_) => Decay::PerSecond,
        }
    }

    pub(super) fn unseen_probability(&self) -> f64 {
        match self {
            Method::Paper(paper) => paper.initial_probability().unwrap_or(0.0),
            Method::Or(_) => 0.0,
        }
    }

    /// Threshold above which a voxel is called crowd unless the caller says otherwise.
    ///
    /// As printed, a place that all see empty has P(A|0), and a crowd that one of N drones sees with certainty
    /// reaches (P(A|1) + (N - 1) P(A|0)) / N. The default lies a quarter of the way from the first to the
    /// second: with alpha = 0.1 such a crowd is marked within four to six looks. A fixed 0.5 would never mark
    /// what a single drone of three sees.
    pub fn default_threshold(&self) -> f64 {
        match self {
            Method::Or(_) => 0.5,
            Method::Paper(paper) => {
                let empty = paper.pool.post_negative();
                let one_view = paper.pool.pool(&[1.0], paper.fleet_size);
                empty + 0.25 * (one_view - empty)
            }
        }
    }
}

/// Equations 1-3 with a switch for everything that the paper leaves open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paper {
    pub(super) pool: OpinionPool,
    pub(super) blend: TemporalBlend,
    pub(super) fleet_size: usize,
    pub(super) initial: Initial,
    pub(super) decay: Decay,
}

/// P~ before the first look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Initial {
    Zero,
    Prior,
    /// The first look is taken whole, as if alpha were 1.
    FirstLook,
}

/// Unit of lambda.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Decay {
    PerSecond,
    /// Per instant integrated.
    PerFrame,
}

impl Paper {
    pub fn new(
        pool: OpinionPool,
        blend: TemporalBlend,
        fleet_size: usize,
        initial: Initial,
        decay: Decay,
    ) -> Result<Paper> {
        check_fleet_size(fleet_size)?;
        Ok(Paper { pool, blend, fleet_size, initial, decay })
    }

    pub fn pool(&self) -> &OpinionPool {
        &self.pool
    }

    pub fn blend(&self) -> &TemporalBlend {
        &self.blend
    }

    pub fn fleet_size(&self) -> usize {
        self.fleet_size
    }

    pub fn initial(&self) -> Initial {
        self.initial
    }

    pub fn decay(&self) -> Decay {
        self.decay
    }

    pub(super) fn initial_probability(&self) -> Option<f64> {
        match self.initial {
            Initial::Zero => Some(0.0),
            Initial::Prior => Some(self.pool.prior()),
            Initial::FirstLook => None,
        }
    }
}

/// Baseline: a voxel once called crowd by any view (m above the threshold) stays crowd.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Or {
    pub(super) fleet_size: usize,
    b_threshold: f64,
}

impl Or {
    pub fn new(fleet_size: usize, b_threshold: f64) -> Result<Or> {
        check_fleet_size(fleet_size)?;
        require((0.0..=1.0).contains(&b_threshold), "b_threshold", b_threshold, "inside [0, 1]")?;
        Ok(Or { fleet_size, b_threshold })
    }

    pub fn fleet_size(&self) -> usize {
        self.fleet_size
    }

    pub fn b_threshold(&self) -> f64 {
        self.b_threshold
    }
}

fn check_fleet_size(fleet_size: usize) -> Result<()> {
    require(fleet_size > 0, "fleet_size", fleet_size as f64, ">= 1")
}
