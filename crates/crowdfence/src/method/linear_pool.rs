//! Method `linear-pool`: the paper's equations, repaired. Only drones that see a place have a say, their weights sum
//! to 1, and forgetting leads back to the prior:
//!
//!   P = sum of w_i P(A = 1 | b_i) / sum of w_i,  w_i = |m_i - 0.5|, over the drones that see it
//!   P~ = alpha P + (1 - alpha) (prior + beta (P~ - prior)),  beta = exp(-lambda (t - t'))
//!
//! For comparison: what it keeps of `paper` is the threshold on m and the weight of a whole instant.

use super::{Elapsed, FusionMethod, InstantOrder, Parameter, Stored, VoxelLook};
use crate::error::Result;
use crate::opinion_pool::{OpinionPool, Rates, Unseen};
use crate::sealed::{Reader, Writer};
use crate::temporal_blend::TemporalBlend;

/// Method `linear-pool`: equations 1-3 over the drones that see a place, fading to the prior.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LinearPool {
    pool: OpinionPool,
    blend: TemporalBlend,
}

impl FusionMethod for LinearPool {
    /// P~ as of the last look.
    type Belief = f32;
    const NO_BELIEF: f32 = 0.0;
    /// beta.
    type Fading = f64;
    const NAME: &'static str = "linear-pool";
    const ORDER: InstantOrder = InstantOrder::ByTime;

    fn max_drones(&self) -> Option<usize> {
        None
    }

    fn fading(&self, since: Elapsed) -> f64 {
        self.blend.beta(since.seconds)
    }

    fn update(&self, before: Option<(f32, f64)>, looks: &[(VoxelLook, f64)]) -> f32 {
        let pooled = self.pool.pool(looks.iter().map(|(look, _)| look.mean), looks.len());
        let faded = before.map_or(self.pool.prior(), |(belief, beta)| self.probability(belief, beta));
        self.blend.join(faded, pooled) as f32
    }

    fn probability(&self, belief: f32, beta: f64) -> f64 {
        self.pool.prior() + beta * (f64::from(belief) - self.pool.prior())
    }

    fn unseen_probability(&self) -> f64 {
        self.pool.prior()
    }

    /// A quarter of the way from what all see empty to what all are sure of, the rule of `paper`.
    fn default_threshold(&self) -> f64 {
        let (empty, crowd) = (self.pool.post_negative(), self.pool.post_positive());
        empty + 0.25 * (crowd - empty)
    }

    fn b_threshold(&self) -> f64 {
        self.pool.b_threshold()
    }

    fn parameters(&self) -> Vec<(&'static str, Parameter)> {
        let rates = self.pool.rates();
        vec![
            ("true_positive_rate", Parameter::Number(rates.true_positive())),
            ("false_positive_rate", Parameter::Number(rates.false_positive())),
            ("prior", Parameter::Number(self.pool.prior())),
            ("b_threshold", Parameter::Number(self.pool.b_threshold())),
            ("alpha", Parameter::Number(self.blend.alpha())),
            ("decay", Parameter::Number(self.blend.decay())),
        ]
    }
}

impl LinearPool {
    /// Bounds as for [`OpinionPool`]; the decay of `blend` is per second.
    pub fn new(rates: Rates, prior: f64, b_threshold: f64, blend: TemporalBlend) -> Result<LinearPool> {
        let pool = OpinionPool::new(rates, prior, b_threshold, Unseen::Visible, true)?;
        Ok(LinearPool { pool, blend })
    }

    /// Equations 1-2, over visible drones and normalised.
    pub fn pool(&self) -> &OpinionPool {
        &self.pool
    }

    /// Equation 3.
    pub fn blend(&self) -> &TemporalBlend {
        &self.blend
    }
}

/// f64 true_positive, false_positive, prior, b_threshold, alpha, decay. A belief is an f32, P~.
impl Stored for LinearPool {
    fn write(&self, payload: &mut Writer) {
        let rates = self.pool.rates();
        payload.f64(rates.true_positive());
        payload.f64(rates.false_positive());
        payload.f64(self.pool.prior());
        payload.f64(self.pool.b_threshold());
        payload.f64(self.blend.alpha());
        payload.f64(self.blend.decay());
    }

    fn read(reader: &mut Reader<'_>, _version: u32) -> Result<LinearPool> {
        let rates = Rates::new(reader.f64()?, reader.f64()?)?;
        let (prior, b_threshold) = (reader.f64()?, reader.f64()?);
        LinearPool::new(rates, prior, b_threshold, TemporalBlend::new(reader.f64()?, reader.f64()?)?)
    }

    fn write_belief(belief: f32, payload: &mut Writer) {
        payload.f32(belief);
    }

    fn read_beliefs(reader: &mut Reader<'_>, _version: u32, count: usize) -> Result<Vec<f32>> {
        let beliefs = reader.numbers(count, f32::from_le_bytes)?;
        if beliefs.iter().all(|p| (0.0..=1.0).contains(p)) {
            Ok(beliefs)
        } else {
            Err(reader.damaged("a probability outside [0, 1]"))
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::method::looks_from_above;

    /// P(A | b = 1) = .9 and P(A | b = 0) = .1.
    fn linear_pool(alpha: f64, decay: f64) -> LinearPool {
        let blend = TemporalBlend::new(alpha, decay).unwrap();
        LinearPool::new(Rates::new(0.9, 0.1).unwrap(), 0.5, 0.5, blend).unwrap()
    }

    #[test]
    fn the_surer_drone_weighs_more_and_time_leads_back_to_the_prior() {
        let method = linear_pool(0.25, std::f64::consts::LN_2 / 10.0);
        // Weights |1 - .5| = .5 and |.25 - .5| = .25: (2 * .9 + .1) / 3 = .63333; from the prior
        // .25 * .63333 + .75 * .5 = .53333.
        let first = method.update(None, &looks_from_above(&[1.0, 0.25], 1.0));
        assert!((f64::from(first) - 0.533_333).abs() < 1e-6);
        // 10 s later half of what was above the prior is left.
        let later = method.fading(Elapsed { seconds: 10.0, instants: 1 });
        assert!((method.probability(first, later) - 0.516_667).abs() < 1e-6);
        // Another look at nobody: .25 * .1 + .75 * .516667 = .4125.
        let second = method.update(Some((first, later)), &looks_from_above(&[0.0], 1.0));
        assert!((f64::from(second) - 0.4125).abs() < 1e-6);
    }

    #[test]
    fn a_drone_that_is_not_there_changes_nothing() {
        // .1 + .25 * (.9 - .1), whatever the size of the fleet.
        assert!((linear_pool(0.1, 0.0).default_threshold() - 0.3).abs() < 1e-12);
        assert_eq!(linear_pool(0.1, 0.0).max_drones(), None);
    }

    proptest! {
        #[test]
        fn it_stays_between_the_posteriors_and_rises_where_a_view_turns_to_crowd(
            means in prop::collection::vec(0.0f64..=1.0, 1..5),
            before in 0.1f32..=0.9,
            alpha in 0.01f64..=1.0,
        ) {
            let method = linear_pool(alpha, 0.01);
            let after = method.update(Some((before, 1.0)), &looks_from_above(&means, 1.0));
            prop_assert!((0.1 - 1e-6..=0.9 + 1e-6).contains(&after), "{after}");
            let surer: Vec<f64> = [1.0].into_iter().chain(means[1..].iter().copied()).collect();
            let higher = method.update(Some((before, 1.0)), &looks_from_above(&surer, 1.0));
            prop_assert!(higher >= after - 1e-6, "{higher} after {after}");
        }
    }
}
