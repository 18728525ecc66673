//! Fusion methods: how what the views of an instant say about a voxel becomes a belief, and how long it lasts.
//!
//! A method is a value with its parameters. It owns what is kept per voxel and everything that follows from
//! that; the crowd map knows only [`FusionMethod`]. A new method is one file here, one variant of [`Method`] and
//! one of the crowd map's beliefs.

mod calibration;
mod evidence;
mod linear_pool;
mod log_odds;
mod log_pool;
mod moving_average;
mod or;
mod paper;

use crate::error::Result;
use crate::sealed::{Reader, Writer};

pub use calibration::Calibration;
pub use evidence::{Evidence, EvidenceSettings, Finer, FromBelow, LikelihoodRatio};
pub use linear_pool::LinearPool;
pub use log_odds::LogOdds;
pub use log_pool::LogPool;
pub use moving_average::MovingAverage;
pub use or::Or;
pub use paper::{DecayUnit, Initial, Paper};

/// What one view says about one voxel that it sees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VoxelLook {
    /// Voxel of the terrain.
    pub voxel_id: u32,
    /// Position of the view among those of the instant.
    pub view: u32,
    /// Number of its drone, in the order in which drones first gave a view.
    pub drone: u32,
    /// m_i of equation 1.
    pub mean: f64,
    /// Pixels whose ray first hits the voxel; 0 where it lies between them.
    pub pixel_count: u32,
    /// From the camera to the place, metres.
    pub range_m: f32,
    /// Of the line of sight below the horizon, degrees: 90 is straight down, negative upwards.
    pub tilt_deg: f32,
    /// Focal length of the camera in pixels; 0 = nobody said.
    pub focal_px: f32,
}

impl VoxelLook {
    /// Metres per pixel across the line of sight; `focal_px` is taken where nobody said.
    fn gsd_m(&self, focal_px: f32) -> f32 {
        self.range_m / if self.focal_px > 0.0 { self.focal_px } else { focal_px }
    }
}

/// Log odds above a threshold from which one look by itself shows crowd: far more than what closes ground, because a
/// false alarm would stand against all others.
pub(crate) const CLEARLY: f64 = 2.0;

/// Whether the log odds of one look show crowd by themselves.
pub(crate) fn clearly_above(log_odds: f32, threshold: f64) -> bool {
    f64::from(log_odds) >= (threshold / (1.0 - threshold)).ln() + CLEARLY
}

/// Time since the last look at a voxel, in the units that methods count in.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Elapsed {
    /// Of the views' clocks.
    pub seconds: f64,
    /// Instants that were integrated since.
    pub instants: u64,
}

/// Does the belief depend on the order in which instants come?
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum InstantOrder {
    /// They must come in order of time.
    ByTime,
    /// Any order gives the same map.
    Any,
}

/// What a method of fusion decides: what is kept of looks, what time leaves of it, and what that says of crowd.
pub trait FusionMethod: Clone + Send + Sync {
    /// What is kept per voxel that was seen, as of its last look.
    type Belief: Copy + Send + Sync;
    /// Fills a page of beliefs before its voxels are seen; never read.
    const NO_BELIEF: Self::Belief;
    /// What time leaves of a belief: the same for all voxels that were last seen together, so worked out once
    /// for them.
    type Fading: Copy + Send + Sync;
    /// As in configurations, files and reports.
    const NAME: &'static str;
    /// In which order instants may come.
    const ORDER: InstantOrder;

    /// Most drones that may ever give a view; None = any number.
    fn max_drones(&self) -> Option<usize>;

    /// What is left of a belief that long after its last look.
    fn fading(&self, since: Elapsed) -> Self::Fading;

    /// The belief after the views `looks` (at least one, each of another drone) of one instant, as of the newest look
    /// at the voxel; `before` is None for a voxel that nobody has seen yet. Beside each is what time leaves of it
    /// until that look.
    fn update(
        &self,
        before: Option<(Self::Belief, Self::Fading)>,
        looks: &[(VoxelLook, Self::Fading)],
    ) -> Self::Belief;

    /// Does a look say anything about who stands at the place? If not, the place was not seen by it.
    fn tells(&self, _look: &VoxelLook) -> bool {
        true
    }

    /// Probability of crowd that is left of a belief.
    fn probability(&self, belief: Self::Belief, fading: Self::Fading) -> f64;

    /// The same where nobody has looked yet, which says nothing about the place.
    fn unseen_probability(&self) -> f64;

    /// Do looks that made `after` of `before` (None = nobody had looked) speak for crowd? They leave more of it than
    /// there was, and more than where nobody has looked.
    fn speaks_for_crowd(
        &self,
        before: Option<(Self::Belief, Self::Fading)>,
        (belief, fading): (Self::Belief, Self::Fading),
    ) -> bool {
        let probability = self.probability(belief, fading);
        let was = before.map(|(belief, fading)| self.probability(belief, fading));
        probability > self.unseen_probability() && was.is_none_or(|was| probability > was)
    }

    /// Log odds of crowd by one look, as if nobody else had ever looked, where they can be clearly above a threshold;
    /// None elsewhere, and where the method cannot tell.
    fn log_odds_alone(&self, _look: &VoxelLook) -> Option<f32> {
        None
    }

    /// Looks that a belief still remembers, in those that weigh 1; None where they are not counted.
    fn looks(&self, _belief: Self::Belief, _fading: Self::Fading) -> Option<f64> {
        None
    }

    /// Bounds between which the probability of crowd lies at a level in (0, 1): of a belief, or where nobody has
    /// looked. None where the method knows none.
    fn interval(&self, _belief: Option<(Self::Belief, Self::Fading)>, _level: f64) -> Option<[f64; 2]> {
        None
    }

    /// Probability from which a voxel is called crowd unless the caller says otherwise.
    fn default_threshold(&self) -> f64;

    /// Is every belief below this probability below it for as long as nobody looks? Whoever asks for crowd then reads
    /// what was seen since, and not what was seen before.
    fn stays_below(&self, _probability: f64) -> bool {
        false
    }

    /// Does a place with this probability, below the threshold, count as empty? If not it was looked at, and that
    /// showed neither.
    fn clears(&self, _probability: f64) -> bool {
        true
    }

    /// A view calls a voxel crowd when its mean heatmap value is above this.
    fn b_threshold(&self) -> f64;

    /// What the method was told, for reports.
    fn parameters(&self) -> Vec<(&'static str, Parameter)>;
}

/// A parameter as a report shows it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Parameter {
    /// A quantity or a probability.
    Number(f64),
    /// How many.
    Count(usize),
    /// On or off.
    Switch(bool),
    /// One of several, by name.
    Choice(&'static str),
}

/// How a method and its beliefs stand in a file.
pub(crate) trait Stored: FusionMethod {
    fn write(&self, payload: &mut Writer);
    /// `version` is that of the crowd map's format.
    fn read(reader: &mut Reader<'_>, version: u32) -> Result<Self>;
    fn write_belief(belief: Self::Belief, payload: &mut Writer);
    fn read_beliefs(reader: &mut Reader<'_>, version: u32, count: usize) -> Result<Vec<Self::Belief>>;
}

/// One of the methods.
#[derive(Debug, Clone, PartialEq)]
pub enum Method {
    /// The default: calibrated log odds, averaged; see [`Evidence`].
    Evidence(Evidence),
    /// Equations 1-3 as printed, unsafe; see [`Paper`].
    Paper(Paper),
    /// The paper's baseline, which never forgets; see [`Or`].
    Or(Or),
    /// For comparison: the paper's equations, repaired; see [`LinearPool`].
    LinearPool(LinearPool),
    /// For comparison: the logarithmic opinion pool; see [`LogPool`].
    LogPool(LogPool),
    /// For comparison: log odds between clamps, as in OctoMap; see [`LogOdds`].
    LogOdds(LogOdds),
    /// For comparison: the mean of all looks; see [`MovingAverage`].
    MovingAverage(MovingAverage),
}

/// The same expression for whichever method it is.
macro_rules! each_method {
    ($value:expr, $kind:ident, $method:ident => $answer:expr) => {
        match $value {
            $kind::Evidence($method) => $answer,
            $kind::Paper($method) => $answer,
            $kind::Or($method) => $answer,
            $kind::LinearPool($method) => $answer,
            $kind::LogPool($method) => $answer,
            $kind::LogOdds($method) => $answer,
            $kind::MovingAverage($method) => $answer,
        }
    };
}
pub(crate) use each_method;

fn name_of<M: FusionMethod>(_: &M) -> &'static str {
    M::NAME
}

impl Method {
    /// See [`FusionMethod::NAME`].
    pub fn name(&self) -> &'static str {
        each_method!(self, Method, method => name_of(method))
    }

    /// See [`FusionMethod::max_drones`].
    pub fn max_drones(&self) -> Option<usize> {
        each_method!(self, Method, method => method.max_drones())
    }

    /// See [`FusionMethod::default_threshold`].
    pub fn default_threshold(&self) -> f64 {
        each_method!(self, Method, method => method.default_threshold())
    }

    /// See [`FusionMethod::b_threshold`].
    pub fn b_threshold(&self) -> f64 {
        each_method!(self, Method, method => FusionMethod::b_threshold(method))
    }

    /// See [`FusionMethod::parameters`].
    pub fn parameters(&self) -> Vec<(&'static str, Parameter)> {
        each_method!(self, Method, method => method.parameters())
    }
}

/// Looks of as many drones at one voxel straight below them, for tests.
#[cfg(test)]
pub(crate) fn looks_from_above<F: Copy>(means: &[f64], fading: F) -> Vec<(VoxelLook, F)> {
    let look = |(drone, &mean): (u32, &f64)| VoxelLook {
        voxel_id: 0,
        view: drone,
        drone,
        mean,
        pixel_count: 1,
        range_m: 10.0,
        tilt_deg: 90.0,
        focal_px: 0.0,
    };
    (0..).zip(means).map(|numbered| (look(numbered), fading)).collect()
}

/// Values up to .3 speak against crowd by 1, above .7 for it by 3, those between not at all; the prior is even. For tests.
#[cfg(test)]
pub(crate) fn three_step_calibration() -> Calibration {
    let likelihood = LikelihoodRatio::new(vec![], vec![], vec![0.3, 0.7], vec![-1.0, 0.0, 3.0]).unwrap();
    Calibration::new(std::sync::Arc::new(likelihood), 0.5, 400.0).unwrap()
}
