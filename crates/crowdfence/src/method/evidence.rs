//! Method `evidence`: the log odds of crowd, from calibrated looks.
//!
//! A look speaks for or against crowd by the logarithm of its likelihood ratio l, which depends on the heatmap's value
//! and on how the place was seen (`likelihood.rs`). Looks at one place agree far too well to be added up as if each
//! knew something new, so they are averaged, and only another drone's view adds to them:
//!
//!   L = logit(prior) + E / (W + doubt) * D ^ agreement
//!
//! with E = sum of w l and W = sum of w over all looks, and D = W^2 / (sum over drones of W_d^2), which counts the
//! drones that looked: n drones that looked alike are n. The weight of a look is w = sharpness * exp(-age / memory):
//! a coarse look and an old one say less. As W falls, `doubt` takes over and L returns to the prior: what nobody
//! looks at is not known for long, and it is never found free by forgetting.
//!
//! Sums do not depend on an order, and E, W and W_d fade by one factor: instants may come in any order and grouping, late
//! ones weigh what their age leaves, and reading at any stamp is exact.

mod borders;
mod from_below;
mod interval;
mod likelihood;
mod stored;

use std::sync::Arc;

use super::{CLEARLY, Elapsed, FusionMethod, InstantOrder, Parameter, VoxelLook};
use crate::error::{Result, require};

pub use from_below::FromBelow;
pub use likelihood::{Finer, LikelihoodRatio};

/// Drones of a larger fleet share so many weights, which counts them as fewer than they are.
pub const DRONE_WEIGHTS: usize = 3;

/// Log odds are kept this close to the prior's: no number of looks is proof.
const MOST_EVIDENCE: f64 = 12.0;

/// The default method: calibrated log odds of crowd, averaged over looks.
#[derive(Debug, Clone, PartialEq)]
pub struct Evidence {
    likelihood: Arc<LikelihoodRatio>,
    settings: EvidenceSettings,
    prior_log_odds: f64,
    /// Mean heatmap value up to which no look by itself shows crowd.
    shows_nothing_to: f32,
}

/// What [`Evidence`] is told beside the calibration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EvidenceSettings {
    /// P(A = 1) where nobody has looked: the share of such ground that crowds stand on.
    pub prior: f64,
    /// A look weighs 1 / e of what it did after so long.
    pub memory_s: f64,
    /// Metres per pixel up to which a look is sharp and weighs 1; a coarser one weighs as much less as it has fewer
    /// pixels on the same ground.
    pub sharp_gsd_m: f64,
    /// Sharp looks that the prior stands against.
    pub doubt: f64,
    /// How far looks of different drones are independent: 0 they only average, 1 they add up.
    pub agreement: f64,
    /// Probability from which a place is called crowd.
    pub threshold: f64,
    /// Probability up to which a place is called empty. Between the two it was looked at, and that showed neither.
    pub cleared: f64,
    /// Focal length of the cameras of the calibration, pixels: taken for a view that does not say its own, and a look of a
    /// finer camera weighs as little finer than theirs.
    pub focal_px: f64,
    /// Which looks from below the top of a place count.
    pub from_below: FromBelow,
}

/// What looks leave at a voxel, as of the last of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LooksSum {
    /// E: sum of w l.
    pub(super) evidence: f32,
    /// W_d: sums of w. Drone d has that of d mod [`DRONE_WEIGHTS`], in the order in which drones first gave a view.
    pub(super) weights: [f32; DRONE_WEIGHTS],
}

impl FusionMethod for Evidence {
    type Belief = LooksSum;
    const NO_BELIEF: LooksSum = LooksSum { evidence: 0.0, weights: [0.0; DRONE_WEIGHTS] };
    /// The factor that time leaves of a weight.
    type Fading = f32;
    const NAME: &'static str = "evidence";
    const ORDER: InstantOrder = InstantOrder::Any;

    fn max_drones(&self) -> Option<usize> {
        None
    }

    fn fading(&self, since: Elapsed) -> f32 {
        (-since.seconds / self.settings.memory_s).exp() as f32
    }

    fn update(&self, before: Option<(LooksSum, f32)>, looks: &[(VoxelLook, f32)]) -> LooksSum {
        let mut sum = before.map_or(Self::NO_BELIEF, |(sum, fading)| sum.faded(fading));
        for (look, fading) in looks {
            let (log_ratio, sharpness) = self.says(look);
            let weight = fading * sharpness;
            sum.evidence += weight * log_ratio;
            sum.weights[look.drone as usize % DRONE_WEIGHTS] += weight;
        }
        sum
    }

    /// From below its top, where the tilt is negative, a camera sees the side of a place, and of those who stand on it
    /// at most the nearest: that nobody shows there clears nothing. Nor does a look from under the ground, through a
    /// hole of the map. Of a class that opens ground it is the other way round ([`FromBelow`]).
    fn tells(&self, look: &VoxelLook) -> bool {
        look.tilt_deg > 0.0 || self.settings.from_below.tells(self.says(look).0)
    }

    fn probability(&self, sum: LooksSum, fading: f32) -> f64 {
        1.0 / (1.0 + (-self.log_odds(sum, fading)).exp())
    }

    fn looks(&self, sum: LooksSum, fading: f32) -> Option<f64> {
        Some(f64::from(fading) * sum.weight())
    }

    fn interval(&self, belief: Option<(LooksSum, f32)>, level: f64) -> Option<[f64; 2]> {
        let Some((sum, fading)) = belief else { return Some(interval::UNSEEN) };
        let looks = f64::from(fading) * sum.weight() + self.settings.doubt;
        Some(interval::interval(self.log_odds(sum, fading), looks, level))
    }

    fn unseen_probability(&self) -> f64 {
        self.settings.prior
    }

    /// From 2 above the prior on, as every threshold is above the prior.
    fn log_odds_alone(&self, look: &VoxelLook) -> Option<f32> {
        // Most looks are at ground without crowd.
        if look.mean as f32 <= self.shows_nothing_to {
            return None;
        }
        let (log_ratio, sharpness) = self.says(look);
        let evidence = alone(f64::from(sharpness), log_ratio, self.settings.doubt);
        (evidence >= CLEARLY).then_some((self.prior_log_odds + evidence) as f32)
    }

    /// By the log odds, of which probabilities are another reading.
    fn speaks_for_crowd(&self, before: Option<(LooksSum, f32)>, (sum, fading): (LooksSum, f32)) -> bool {
        // Most ground is without crowd, and the sign of the sum says so before anything is divided.
        if sum.evidence <= 0.0 {
            return false;
        }
        let evidence = self.evidence(sum, f64::from(fading));
        let was = before.map_or(0.0, |(sum, fading)| self.evidence(sum, f64::from(fading)));
        evidence > 0.0 && evidence > was
    }

    fn default_threshold(&self) -> f64 {
        self.settings.threshold
    }

    /// Log odds fade towards the prior, from above and from below, and never beyond.
    fn stays_below(&self, probability: f64) -> bool {
        self.settings.prior < probability * (1.0 - 1e-9)
    }

    fn clears(&self, probability: f64) -> bool {
        probability <= self.settings.cleared
    }

    /// Nothing is called crowd by one view alone; what becomes of crowd that meets no ground is told from here on.
    fn b_threshold(&self) -> f64 {
        0.5
    }

    fn parameters(&self) -> Vec<(&'static str, Parameter)> {
        let numbers = self.settings.numbers().map(|(name, number)| (name, Parameter::Number(number)));
        let from_below = ("from_below", Parameter::Choice(self.settings.from_below.name()));
        numbers.into_iter().chain([from_below]).collect()
    }
}

impl Evidence {
    /// Errors: a setting out of its bounds, by name. `cleared` must lie below both `prior` and `threshold`.
    pub fn new(likelihood: Arc<LikelihoodRatio>, settings: EvidenceSettings) -> Result<Evidence> {
        settings.check()?;
        let prior_log_odds = (settings.prior / (1.0 - settings.prior)).ln();
        let shows_nothing_to = likelihood.never_up_to(|ratio| alone(1.0, ratio, settings.doubt) >= CLEARLY);
        Ok(Evidence { likelihood, settings, prior_log_odds, shows_nothing_to })
    }

    /// The table of likelihood ratios.
    pub fn likelihood(&self) -> &LikelihoodRatio {
        &self.likelihood
    }

    /// All else that it was told.
    pub fn settings(&self) -> &EvidenceSettings {
        &self.settings
    }

    /// L.
    fn log_odds(&self, sum: LooksSum, fading: f32) -> f64 {
        self.prior_log_odds + self.evidence(sum, f64::from(fading))
    }

    /// L without the prior, where `fading` is left of the sums.
    fn evidence(&self, sum: LooksSum, fading: f64) -> f64 {
        let weight = sum.weight();
        if weight == 0.0 {
            return 0.0;
        }
        let mean = fading * f64::from(sum.evidence) / (fading * weight + self.settings.doubt);
        let drones = weight * weight / sum.squared_weights();
        // Most places are seen by one drone: D is 1 to the bit, and a power costs more than all else here.
        let stronger = if drones == 1.0 { 1.0 } else { drones.powf(self.settings.agreement) };
        (mean * stronger).clamp(-MOST_EVIDENCE, MOST_EVIDENCE)
    }

    /// l and the sharpness of a look.
    fn says(&self, look: &VoxelLook) -> (f32, f32) {
        let (log_ratio, gsd_m) = self.likelihood.of_look(look, self.settings.focal_px as f32);
        (log_ratio, self.sharpness(gsd_m))
    }

    fn sharpness(&self, gsd_m: f32) -> f32 {
        let sharp_m = self.settings.sharp_gsd_m as f32;
        if gsd_m <= sharp_m { 1.0 } else { (sharp_m / gsd_m).powi(2) }
    }
}

impl LooksSum {
    fn faded(self, fading: f32) -> LooksSum {
        LooksSum { evidence: fading * self.evidence, weights: self.weights.map(|weight| fading * weight) }
    }

    /// W.
    fn weight(&self) -> f64 {
        self.weights.iter().map(|&weight| f64::from(weight)).sum()
    }

    fn squared_weights(&self) -> f64 {
        self.weights.iter().map(|&weight| f64::from(weight) * f64::from(weight)).sum()
    }
}

/// What one look leaves above the prior, in log odds, where nobody else has ever looked.
fn alone(weight: f64, log_ratio: f32, doubt: f64) -> f64 {
    weight * f64::from(log_ratio) / (weight + doubt)
}

impl EvidenceSettings {
    /// All numbers by name, in the order of files.
    pub fn numbers(&self) -> [(&'static str, f64); 8] {
        [
            ("prior", self.prior),
            ("memory_s", self.memory_s),
            ("sharp_gsd_m", self.sharp_gsd_m),
            ("doubt", self.doubt),
            ("agreement", self.agreement),
            ("threshold", self.threshold),
            ("cleared", self.cleared),
            ("focal_px", self.focal_px),
        ]
    }

    fn check(&self) -> Result<()> {
        let inside = |value: f64| value > 0.0 && value < 1.0;
        let positive = |value: f64| value.is_finite() && value > 0.0;
        require(inside(self.prior), "prior", self.prior, "strictly between 0 and 1")?;
        require(positive(self.memory_s), "memory_s", self.memory_s, "finite and > 0")?;
        require(positive(self.sharp_gsd_m), "sharp_gsd_m", self.sharp_gsd_m, "finite and > 0")?;
        require(positive(self.doubt), "doubt", self.doubt, "finite and > 0")?;
        require((0.0..=1.0).contains(&self.agreement), "agreement", self.agreement, "inside [0, 1]")?;
        require(inside(self.threshold), "threshold", self.threshold, "strictly between 0 and 1")?;
        let below = self.cleared > 0.0 && self.cleared < self.prior.min(self.threshold);
        require(below, "cleared", self.cleared, "above 0 and below both the prior and the threshold")?;
        require(positive(self.focal_px), "focal_px", self.focal_px, "finite and > 0")
    }
}

#[cfg(test)]
mod tests;
