//! Method `log-odds`: every look adds to the log odds, between two clamps, as in OctoMap.
//!
//!   L <- clamp(L + sum over the drones that see it of l_i)
//!   l_i = ln(TPR / FPR) where m_i is above the threshold, else ln((1 - TPR) / (1 - FPR))
//!
//! For comparison: looks count as independent of each other and nothing is forgotten; the clamps alone keep a place from
//! being settled for ever.

use super::{Elapsed, FusionMethod, InstantOrder, Parameter, Stored, VoxelLook};
use crate::error::{Result, require};
use crate::opinion_pool::{Rates, require_b_threshold};
use crate::sealed::{Reader, Writer};

/// Method `log-odds`: the sum of all looks between two clamps.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LogOdds {
    rates: Rates,
    prior: f64,
    b_threshold: f64,
    /// Log odds that L stays between.
    clamp: [f64; 2],
}

impl FusionMethod for LogOdds {
    /// L.
    type Belief = f32;
    const NO_BELIEF: f32 = 0.0;
    /// Nothing fades.
    type Fading = ();
    const NAME: &'static str = "log-odds";
    /// Clamps know an order.
    const ORDER: InstantOrder = InstantOrder::ByTime;

    fn max_drones(&self) -> Option<usize> {
        None
    }

    fn fading(&self, _since: Elapsed) {}

    fn update(&self, before: Option<(f32, ())>, looks: &[(VoxelLook, ())]) -> f32 {
        let before = before.map_or(self.prior_log_odds(), |(log_odds, ())| f64::from(log_odds));
        let [hit, miss] = self.log_ratios();
        let said: f64 =
            looks.iter().map(|(look, ())| if look.mean > self.b_threshold { hit } else { miss }).sum();
        (before + said).clamp(self.clamp[0], self.clamp[1]) as f32
    }

    fn probability(&self, log_odds: f32, _fading: ()) -> f64 {
        1.0 / (1.0 + (-f64::from(log_odds)).exp())
    }

    fn unseen_probability(&self) -> f64 {
        self.prior
    }

    /// As likely as not, as in OctoMap.
    fn default_threshold(&self) -> f64 {
        0.5
    }

    fn b_threshold(&self) -> f64 {
        self.b_threshold
    }

    fn parameters(&self) -> Vec<(&'static str, Parameter)> {
        vec![
            ("true_positive_rate", Parameter::Number(self.rates.true_positive())),
            ("false_positive_rate", Parameter::Number(self.rates.false_positive())),
            ("prior", Parameter::Number(self.prior)),
            ("b_threshold", Parameter::Number(self.b_threshold)),
            ("clamp_low", Parameter::Number(self.clamp[0])),
            ("clamp_high", Parameter::Number(self.clamp[1])),
        ]
    }
}

impl LogOdds {
    /// `clamp`: the lowest log odds, below 0, and the highest, above 0; both finite.
    pub fn new(rates: Rates, prior: f64, b_threshold: f64, clamp: [f64; 2]) -> Result<LogOdds> {
        require(prior > 0.0 && prior < 1.0, "prior", prior, "strictly between 0 and 1")?;
        require_b_threshold(b_threshold)?;
        let [low, high] = clamp;
        require(low.is_finite() && low < 0.0, "clamp_low", low, "finite and below 0")?;
        require(high.is_finite() && high > 0.0, "clamp_high", high, "finite and above 0")?;
        Ok(LogOdds { rates, prior, b_threshold, clamp })
    }

    /// The detector's rates.
    pub fn rates(&self) -> Rates {
        self.rates
    }

    /// P(A = 1) where nobody has looked.
    pub fn prior(&self) -> f64 {
        self.prior
    }

    /// Lowest and highest log odds.
    pub fn clamp(&self) -> [f64; 2] {
        self.clamp
    }

    fn prior_log_odds(&self) -> f64 {
        (self.prior / (1.0 - self.prior)).ln()
    }

    /// Of a look that shows crowd, and of one that shows none.
    fn log_ratios(&self) -> [f64; 2] {
        let (found, alarm) = (self.rates.true_positive(), self.rates.false_positive());
        [(found / alarm).ln(), ((1.0 - found) / (1.0 - alarm)).ln()]
    }
}

/// f64 true_positive, false_positive, prior, b_threshold, lowest and highest log odds. A belief is an f32, L.
impl Stored for LogOdds {
    fn write(&self, payload: &mut Writer) {
        payload.f64(self.rates.true_positive());
        payload.f64(self.rates.false_positive());
        payload.f64(self.prior);
        payload.f64(self.b_threshold);
        self.clamp.into_iter().for_each(|bound| payload.f64(bound));
    }

    fn read(reader: &mut Reader<'_>, _version: u32) -> Result<LogOdds> {
        let rates = Rates::new(reader.f64()?, reader.f64()?)?;
        let (prior, b_threshold) = (reader.f64()?, reader.f64()?);
        LogOdds::new(rates, prior, b_threshold, [reader.f64()?, reader.f64()?])
    }

    fn write_belief(log_odds: f32, payload: &mut Writer) {
        payload.f32(log_odds);
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
    use crate::method::looks_from_above;

    /// A look that shows crowd adds ln 8, one that shows none takes ln 4.5.
    fn log_odds() -> LogOdds {
        LogOdds::new(Rates::new(0.8, 0.1).unwrap(), 0.5, 0.5, [-2.0, 3.5]).unwrap()
    }

    fn after(means: &[&[f64]]) -> f64 {
        let method = log_odds();
        let sum = means.iter().fold(None, |before: Option<f32>, means| {
            Some(method.update(before.map(|belief| (belief, ())), &looks_from_above(means, ())))
        });
        f64::from(sum.unwrap())
    }

    #[test]
    fn looks_add_up_between_the_clamps() {
        assert!((after(&[&[0.9]]) - 8f64.ln()).abs() < 1e-6);
        assert!((after(&[&[0.9], &[0.2]]) - (8.0 / 4.5f64).ln()).abs() < 1e-6);
        assert_eq!(after(&[&[0.9], &[0.9], &[0.9]]), 3.5); // 6.24 without
        assert_eq!(after(&[&[0.1, 0.1], &[0.5]]), -2.0); // .5 is not above the threshold
        // 3.5 - 3 ln 4.5 = -1.01: three looks at nobody undo any number of looks at a crowd.
        assert!((after(&[&[0.9; 9], &[0.1; 3]]) + 1.012_232).abs() < 1e-6);
    }

    proptest! {
        #[test]
        fn it_never_leaves_the_clamps_and_time_changes_nothing(
            instants in prop::collection::vec(prop::collection::vec(0.0f64..=1.0, 1..4), 1..20),
        ) {
            let instants: Vec<&[f64]> = instants.iter().map(Vec::as_slice).collect();
            prop_assert!((-2.0..=3.5).contains(&after(&instants)));
            log_odds().fading(Elapsed { seconds: 1e6, instants: 9 });
        }
    }
}
