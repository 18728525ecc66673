//! Method `log-pool`: the logarithmic opinion pool of the calibrated views of an instant, blended as in equation 3.
//!
//!   L = (sum of l_i over the n drones that see it) / n             log odds above the prior
//!   L~ = alpha L + (1 - alpha) beta L~,  beta = exp(-lambda (t - t'))
//!
//! P is proportional to the product of the drones' posteriors, each to the power 1 / n. For comparison: further drones
//! never make it surer, and every instant has the same weight, however coarse its looks.

use super::{Calibration, Elapsed, FusionMethod, InstantOrder, Parameter, Stored, VoxelLook};
use crate::error::{Result, require};
use crate::sealed::{Reader, Writer};
use crate::temporal_blend::TemporalBlend;

/// Method `log-pool`: the mean log ratio of the views of an instant, blended over time.
#[derive(Debug, Clone, PartialEq)]
pub struct LogPool {
    calibration: Calibration,
    blend: TemporalBlend,
    threshold: f64,
}

impl FusionMethod for LogPool {
    /// L~ as of the last look.
    type Belief = f32;
    const NO_BELIEF: f32 = 0.0;
    /// beta.
    type Fading = f64;
    const NAME: &'static str = "log-pool";
    const ORDER: InstantOrder = InstantOrder::ByTime;

    fn max_drones(&self) -> Option<usize> {
        None
    }

    fn fading(&self, since: Elapsed) -> f64 {
        self.blend.beta(since.seconds)
    }

    fn update(&self, before: Option<(f32, f64)>, looks: &[(VoxelLook, f64)]) -> f32 {
        let sum: f64 = looks.iter().map(|(look, _)| self.calibration.log_ratio(look)).sum();
        let faded = before.map_or(0.0, |(belief, beta)| beta * f64::from(belief));
        self.blend.join(faded, sum / looks.len() as f64) as f32
    }

    fn probability(&self, belief: f32, beta: f64) -> f64 {
        self.calibration.posterior(beta * f64::from(belief))
    }

    fn unseen_probability(&self) -> f64 {
        self.calibration.prior()
    }

    fn default_threshold(&self) -> f64 {
        self.threshold
    }

    /// As `evidence`.
    fn b_threshold(&self) -> f64 {
        0.5
    }

    fn parameters(&self) -> Vec<(&'static str, Parameter)> {
        vec![
            ("prior", Parameter::Number(self.calibration.prior())),
            ("alpha", Parameter::Number(self.blend.alpha())),
            ("decay", Parameter::Number(self.blend.decay())),
            ("threshold", Parameter::Number(self.threshold)),
            ("focal_px", Parameter::Number(self.calibration.focal_px())),
        ]
    }
}

impl LogPool {
    /// The decay of `blend` is per second; `threshold` is strictly between 0 and 1.
    pub fn new(calibration: Calibration, blend: TemporalBlend, threshold: f64) -> Result<LogPool> {
        require(threshold > 0.0 && threshold < 1.0, "threshold", threshold, "strictly between 0 and 1")?;
        Ok(LogPool { calibration, blend, threshold })
    }

    /// What a look says.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// Equation 3, of log odds above the prior.
    pub fn blend(&self) -> &TemporalBlend {
        &self.blend
    }
}

/// The calibration; f64 alpha, decay, threshold. A belief is an f32, L~.
impl Stored for LogPool {
    fn write(&self, payload: &mut Writer) {
        self.calibration.write(payload);
        payload.f64(self.blend.alpha());
        payload.f64(self.blend.decay());
        payload.f64(self.threshold);
    }

    fn read(reader: &mut Reader<'_>, version: u32) -> Result<LogPool> {
        let calibration = Calibration::read(reader, version)?;
        LogPool::new(calibration, TemporalBlend::new(reader.f64()?, reader.f64()?)?, reader.f64()?)
    }

    fn write_belief(belief: f32, payload: &mut Writer) {
        payload.f32(belief);
    }

    fn read_beliefs(reader: &mut Reader<'_>, _version: u32, count: usize) -> Result<Vec<f32>> {
        let beliefs = reader.numbers(count, f32::from_le_bytes)?;
        if beliefs.iter().all(|log_odds| log_odds.is_finite()) {
            Ok(beliefs)
        } else {
            Err(reader.damaged("log odds that are no number"))
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::method::{looks_from_above, three_step_calibration};

    fn log_pool(alpha: f64, decay: f64) -> LogPool {
        LogPool::new(three_step_calibration(), TemporalBlend::new(alpha, decay).unwrap(), 0.5).unwrap()
    }

    #[test]
    fn drones_average_in_log_odds_and_time_leads_back_to_the_prior() {
        let method = log_pool(0.5, std::f64::consts::LN_2 / 10.0);
        // l = 3 and -1: their mean is 1, and half of that counts. Prior .5: P = 1 / (1 + e^-0.5).
        let first = method.update(None, &looks_from_above(&[0.9, 0.1], 1.0));
        assert!((method.probability(first, 1.0) - 0.622_459).abs() < 1e-6);
        // 10 s later L = .25; then a look that says -1: .5 * -1 + .5 * .25 = -.375.
        let later = method.fading(Elapsed { seconds: 10.0, instants: 7 });
        let second = method.update(Some((first, later)), &looks_from_above(&[0.1], 1.0));
        assert!((second + 0.375).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn drones_that_agree_are_no_surer_than_one(mean in 0.0f64..=1.0, drones in 1usize..6, alpha in 0.01f64..=1.0) {
            let method = log_pool(alpha, 0.0);
            let one = method.update(None, &looks_from_above(&[mean], 1.0));
            let all = method.update(None, &looks_from_above(&vec![mean; drones], 1.0));
            prop_assert!((one - all).abs() < 1e-6);
        }

        #[test]
        fn the_order_of_drones_does_not_matter(
            (means, other) in prop::collection::vec(0.0f64..=1.0, 1..6)
                .prop_flat_map(|means| (Just(means.clone()), Just(means).prop_shuffle())),
        ) {
            let method = log_pool(0.3, 0.0);
            let [one, another] = [&means, &other].map(|some| method.update(None, &looks_from_above(some, 1.0)));
            prop_assert!((one - another).abs() < 1e-6);
        }
    }
}
