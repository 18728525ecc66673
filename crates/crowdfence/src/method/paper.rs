//! Method `paper`: equations 1-3 with a switch for everything that the paper leaves open.

use super::{Elapsed, FusionMethod, InstantOrder, Parameter, Stored, VoxelLook};
use crate::error::{Result, require};
use crate::opinion_pool::{OpinionPool, Rates, Unseen};
use crate::sealed::{Reader, Writer};
use crate::temporal_blend::TemporalBlend;

/// Of a fleet so large no view says anything: equation 2 weighs each by 1 / N.
const MAX_FLEET: usize = 10_000;

/// Method `paper`. Not safe to fly by: who does not see a place votes against crowd, and forgetting means free.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Paper {
    pool: OpinionPool,
    blend: TemporalBlend,
    fleet_size: usize,
    initial: Initial,
    decay_unit: DecayUnit,
}

/// P~ before the first look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Initial {
    /// 0: nobody there.
    Zero,
    /// P(A = 1).
    Prior,
    /// The first look is taken whole, as if alpha were 1.
    FirstLook,
}

/// What lambda counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DecayUnit {
    /// Seconds since the last look.
    Second,
    /// Instants integrated.
    Frame,
}

impl FusionMethod for Paper {
    /// P~ as of the last look: decayed once, when read. In steps of 2^-32.
    type Belief = u32;
    const NO_BELIEF: u32 = 0;
    /// beta of equation 3.
    type Fading = f64;
    const NAME: &'static str = "paper";
    const ORDER: InstantOrder = InstantOrder::ByTime;

    fn max_drones(&self) -> Option<usize> {
        Some(self.fleet_size)
    }

    fn fading(&self, since: Elapsed) -> f64 {
        self.blend.beta(self.counted(since))
    }

    fn update(&self, before: Option<(u32, f64)>, looks: &[(VoxelLook, f64)]) -> u32 {
        let pooled = self.pool.pool(looks.iter().map(|(look, _)| look.mean), self.fleet_size); // equations 1-2
        let faded = match (before, self.initial) {
            (Some((previous, beta)), _) => beta * from_steps(previous),
            (None, Initial::Zero) => 0.0,
            (None, Initial::Prior) => self.pool.prior(),
            (None, Initial::FirstLook) => return in_steps(pooled),
        };
        in_steps(self.blend.join(faded, pooled)) // equation 3
    }

    fn probability(&self, belief: u32, beta: f64) -> f64 {
        beta * from_steps(belief) // equation 3 without a look
    }

    fn unseen_probability(&self) -> f64 {
        match self.initial {
            Initial::Zero | Initial::FirstLook => 0.0,
            Initial::Prior => self.pool.prior(),
        }
    }

    /// As printed, a place that all see empty has P(A|0), and a crowd that one of N drones sees with certainty
    /// reaches (P(A|1) + (N - 1) P(A|0)) / N. The default lies a quarter of the way from the first to the
    /// second: with alpha = 0.1 such a crowd is marked within four to six looks. A fixed 0.5 would never mark
    /// what a single drone of three sees.
    fn default_threshold(&self) -> f64 {
        let empty = self.pool.post_negative();
        let one_view = self.pool.pool([1.0], self.fleet_size);
        empty + 0.25 * (one_view - empty)
    }

    /// Equation 3 fades towards 0.
    fn stays_below(&self, _probability: f64) -> bool {
        true
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
            ("fleet_size", Parameter::Count(self.fleet_size)),
            ("unseen", Parameter::Choice(self.pool.unseen().name())),
            ("normalise", Parameter::Switch(self.pool.normalise())),
            ("alpha", Parameter::Number(self.blend.alpha())),
            ("decay", Parameter::Number(self.blend.decay())),
            ("decay_unit", Parameter::Choice(self.decay_unit.name())),
            ("initial", Parameter::Choice(self.initial.name())),
        ]
    }
}

/// So many steps lead from 0 to 1, which are both exact.
const STEPS: f64 = u32::MAX as f64;

/// A probability as a belief keeps it, to the nearest step: at most 2^-33 off. As every look forgets the share
/// alpha of what was before, P~ is never further from its equation than 2^-33 / alpha: 1.2e-9 for alpha = 0.1.
fn in_steps(probability: f64) -> u32 {
    (probability * STEPS + 0.5) as u32
}

fn from_steps(belief: u32) -> f64 {
    f64::from(belief) / STEPS
}

impl Paper {
    /// `fleet_size` is N of equation 1, in [1, 10000]; no more drones than that may ever give a view.
    pub fn new(
        pool: OpinionPool,
        blend: TemporalBlend,
        fleet_size: usize,
        initial: Initial,
        decay_unit: DecayUnit,
    ) -> Result<Paper> {
        require((1..=MAX_FLEET).contains(&fleet_size), "fleet_size", fleet_size as f64, "in [1, 10000]")?;
        Ok(Paper { pool, blend, fleet_size, initial, decay_unit })
    }

    /// Equations 1-2.
    pub fn pool(&self) -> &OpinionPool {
        &self.pool
    }

    /// Equation 3.
    pub fn blend(&self) -> &TemporalBlend {
        &self.blend
    }

    /// N of equation 1.
    pub fn fleet_size(&self) -> usize {
        self.fleet_size
    }

    /// P~ before the first look.
    pub fn initial(&self) -> Initial {
        self.initial
    }

    /// What lambda counts.
    pub fn decay_unit(&self) -> DecayUnit {
        self.decay_unit
    }

    /// t - t' in the unit of lambda.
    fn counted(&self, since: Elapsed) -> f64 {
        match self.decay_unit {
            DecayUnit::Second => since.seconds,
            DecayUnit::Frame => since.instants as f64,
        }
    }
}

impl Initial {
    /// As in configurations and reports: `zero`, `prior` or `first`.
    pub fn name(self) -> &'static str {
        match self {
            Initial::Zero => "zero",
            Initial::Prior => "prior",
            Initial::FirstLook => "first",
        }
    }
}

impl DecayUnit {
    /// As in configurations and reports: `second` or `frame`.
    pub fn name(self) -> &'static str {
        match self {
            DecayUnit::Second => "second",
            DecayUnit::Frame => "frame",
        }
    }
}

/// f64 true_positive, false_positive, prior, b_threshold; u8 unseen (0 fleet, 1 visible); u8 normalise; f64 alpha,
/// decay; u64 fleet size; u8 initial (0 zero, 1 prior, 2 first look); u8 decay unit (0 second, 1 frame). A belief
/// is a u32, P~ (2^32 - 1), up to version 2 an f64, P~.
impl Stored for Paper {
    fn write(&self, payload: &mut Writer) {
        let rates = self.pool.rates();
        payload.f64(rates.true_positive());
        payload.f64(rates.false_positive());
        payload.f64(self.pool.prior());
        payload.f64(self.pool.b_threshold());
        payload.u8(u8::from(self.pool.unseen() == Unseen::Visible));
        payload.u8(u8::from(self.pool.normalise()));
        payload.f64(self.blend.alpha());
        payload.f64(self.blend.decay());
        payload.u64(self.fleet_size as u64);
        payload.u8(match self.initial {
            Initial::Zero => 0,
            Initial::Prior => 1,
            Initial::FirstLook => 2,
        });
        payload.u8(u8::from(self.decay_unit == DecayUnit::Frame));
    }

    fn read(reader: &mut Reader<'_>, _version: u32) -> Result<Paper> {
        let rates = Rates::new(reader.f64()?, reader.f64()?)?;
        let (prior, b_threshold) = (reader.f64()?, reader.f64()?);
        let unseen = reader.choice(&[Unseen::Fleet, Unseen::Visible])?;
        let normalise = reader.choice(&[false, true])?;
        let pool = OpinionPool::new(rates, prior, b_threshold, unseen, normalise)?;
        let blend = TemporalBlend::new(reader.f64()?, reader.f64()?)?;
        let fleet_size = reader.u64()? as usize;
        let initial = reader.choice(&[Initial::Zero, Initial::Prior, Initial::FirstLook])?;
        let decay_unit = reader.choice(&[DecayUnit::Second, DecayUnit::Frame])?;
        Paper::new(pool, blend, fleet_size, initial, decay_unit)
    }

    fn write_belief(belief: u32, payload: &mut Writer) {
        payload.u32(belief);
    }

    fn read_beliefs(reader: &mut Reader<'_>, version: u32, count: usize) -> Result<Vec<u32>> {
        if version > 2 {
            return reader.numbers(count, u32::from_le_bytes);
        }
        let beliefs = reader.numbers(count, f64::from_le_bytes)?;
        if beliefs.iter().all(|p| (0.0..=1.0).contains(p)) {
            Ok(beliefs.into_iter().map(in_steps).collect())
        } else {
            Err(reader.damaged("a probability outside [0, 1]"))
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn look(mean: f64) -> VoxelLook {
        VoxelLook {
            voxel_id: 0,
            view: 0,
            drone: 0,
            mean,
            pixel_count: 1,
            range_m: 10.0,
            tilt_deg: 90.0,
            focal_px: 0.0,
        }
    }

    #[test]
    fn zero_and_one_are_kept_exactly() {
        assert_eq!([0.0, 1.0].map(|p| from_steps(in_steps(p))), [0.0, 1.0]);
        assert_eq!(
            [0, 1, u32::MAX - 1, u32::MAX].map(|steps| in_steps(from_steps(steps))),
            [0, 1, u32::MAX - 1, u32::MAX]
        );
    }

    proptest! {
        #[test]
        fn beliefs_stay_as_close_to_equation_3_as_is_said(
            alpha in 0.01f64..=1.0,
            decay in 0.0f64..0.1,
            looks in prop::collection::vec((0.0f64..=1.0, 0.0f64..100.0), 1..500),
        ) {
            let pool = OpinionPool::new(Rates::new(0.9, 0.05).unwrap(), 0.2, 0.5, Unseen::Visible, false).unwrap();
            let blend = TemporalBlend::new(alpha, decay).unwrap();
            let paper = Paper::new(pool, blend, 1, Initial::Zero, DecayUnit::Second).unwrap();
            let (mut kept, mut exact) = (None, 0.0);
            for (mean, seconds) in looks {
                let beta = paper.fading(Elapsed { seconds, instants: 1 });
                kept = Some(paper.update(kept.map(|belief| (belief, beta)), &[(look(mean), 1.0)]));
                exact = blend.blend(exact, seconds, pool.pool([mean], 1));
                let off = (paper.probability(kept.unwrap(), 1.0) - exact).abs();
                prop_assert!(off <= 1.001 * (-33f64).exp2() / alpha, "{off}");
            }
        }
    }
}
