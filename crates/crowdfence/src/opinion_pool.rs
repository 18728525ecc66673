//! Equations 1-2: the linear opinion pool over the drones of the fleet.
//!
//! Equation 1: P(A = 1) = sum over drones i of w_i P(A = 1 | B_i = b_i), where b_i says whether drone i calls
//! the voxel crowd (m_i above a threshold) and P(A | B) follows from the detector's rates and the prior.
//! Equation 2: w_i = |m_i - 0.5| / (0.5 N). The weights do not sum to 1; that is how the paper has it.

use crate::error::{Error, Result, require};

/// Detector rates, both strictly between 0 and 1: a rate of 0 or 1 would let one look settle a voxel forever. The
/// true positive rate is the larger one: otherwise a look that shows a crowd would speak against it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rates {
    true_positive: f64,
    false_positive: f64,
}

impl Rates {
    /// `true_positive` = P(B = 1 | A = 1), `false_positive` = P(B = 1 | A = 0).
    pub fn new(true_positive: f64, false_positive: f64) -> Result<Rates> {
        for (name, rate) in [("true_positive", true_positive), ("false_positive", false_positive)] {
            require(rate > 0.0 && rate < 1.0, name, rate, "strictly between 0 and 1")?;
        }
        if true_positive <= false_positive {
            return Err(Error::UselessRates { true_positive, false_positive });
        }
        Ok(Rates { true_positive, false_positive })
    }

    /// P(B = 1 | A = 1).
    pub fn true_positive(&self) -> f64 {
        self.true_positive
    }

    /// P(B = 1 | A = 0).
    pub fn false_positive(&self) -> f64 {
        self.false_positive
    }
}

/// What a drone that does not see the voxel says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unseen {
    /// As printed: it enters with m = 0, b = 0 and weight 1 / N, N being the fleet.
    Fleet,
    /// Nothing: it is left out and N counts the drones that see the voxel.
    Visible,
}

impl Unseen {
    /// As in configurations and reports: `fleet` or `visible`.
    pub fn name(self) -> &'static str {
        match self {
            Unseen::Fleet => "fleet",
            Unseen::Visible => "visible",
        }
    }
}

/// Equations 1-2 with their parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OpinionPool {
    rates: Rates,
    prior: f64,
    b_threshold: f64,
    unseen: Unseen,
    normalise: bool,
    post_positive: f64,
    post_negative: f64,
}

/// What a view's mean must exceed to call a voxel crowd.
pub(crate) fn require_b_threshold(b_threshold: f64) -> Result<()> {
    require((0.0..1.0).contains(&b_threshold), "b_threshold", b_threshold, "in [0, 1): no value is above 1")
}

impl OpinionPool {
    /// `prior` = P(A = 1); a view calls a voxel crowd when m > `b_threshold`; `normalise` divides the weights
    /// by their sum (and falls back on the prior when they are all 0).
    pub fn new(
        rates: Rates,
        prior: f64,
        b_threshold: f64,
        unseen: Unseen,
        normalise: bool,
    ) -> Result<OpinionPool> {
        require(prior > 0.0 && prior < 1.0, "prior", prior, "strictly between 0 and 1")?;
        require_b_threshold(b_threshold)?;
        let posterior = |given_crowd: f64, given_none: f64| {
            let crowd = given_crowd * prior;
            crowd / (crowd + given_none * (1.0 - prior))
        };
        Ok(OpinionPool {
            rates,
            prior,
            b_threshold,
            unseen,
            normalise,
            post_positive: posterior(rates.true_positive, rates.false_positive),
            post_negative: posterior(1.0 - rates.true_positive, 1.0 - rates.false_positive),
        })
    }

    /// The detector's rates.
    pub fn rates(&self) -> Rates {
        self.rates
    }

    /// P(A = 1).
    pub fn prior(&self) -> f64 {
        self.prior
    }

    /// What m must exceed for b = 1.
    pub fn b_threshold(&self) -> f64 {
        self.b_threshold
    }

    /// What a drone says that does not see the voxel.
    pub fn unseen(&self) -> Unseen {
        self.unseen
    }

    /// Whether weights are divided by their sum.
    pub fn normalise(&self) -> bool {
        self.normalise
    }

    /// P(A = 1 | B = 1) by Bayes' rule.
    pub fn post_positive(&self) -> f64 {
        self.post_positive
    }

    /// P(A = 1 | B = 0) by Bayes' rule.
    pub fn post_negative(&self) -> f64 {
        self.post_negative
    }

    /// Pooled probability of one voxel. `m` gives the mean heatmap value of each drone that sees it, at most
    /// `fleet_size` of them. A voxel that nobody sees gives the prior under [`Unseen::Visible`].
    pub fn pool<M>(&self, m: M, fleet_size: usize) -> f64
    where
        M: IntoIterator<Item = f64, IntoIter: ExactSizeIterator>,
    {
        let m = m.into_iter();
        let seeing = m.len();
        let n = match self.unseen {
            Unseen::Fleet => fleet_size,
            Unseen::Visible => seeing,
        };
        if n == 0 {
            return self.prior;
        }
        let (positive, negative) = (self.post_positive, self.post_negative);
        let weight = |m: f64| (m - 0.5).abs() / (0.5 * n as f64); // equation 2
        let blind = (n - seeing) as f64 * weight(0.0);
        let (probability, weights) = m.fold((blind * negative, blind), |(p, w), m| {
            let given_b = if m > self.b_threshold { positive } else { negative };
            (p + weight(m) * given_b, w + weight(m)) // equation 1
        });
        match self.normalise {
            false => probability,
            true if weights > 0.0 => probability / weights,
            true => self.prior,
        }
    }

    /// The same for arrays: row-major `m` and `visible` [N drones, V voxels] -> per voxel the pooled
    /// probability and whether any drone sees it. `m` is read only where `visible`.
    pub fn pool_all(&self, m: &[f64], visible: &[bool], drones: usize) -> Result<Vec<(f64, bool)>> {
        if drones == 0 {
            return Err(Error::Length { name: "m", actual: 0, expected: 1 });
        }
        if visible.len() != m.len() {
            return Err(Error::Length { name: "visible", actual: visible.len(), expected: m.len() });
        }
        let voxels = m.len() / drones;
        let expected = voxels * drones;
        if m.len() != expected {
            return Err(Error::Length { name: "m", actual: m.len(), expected });
        }
        let mut views = Vec::new();
        (0..voxels)
            .map(|voxel| {
                views.clear();
                for at in (0..drones).map(|drone| drone * voxels + voxel).filter(|&at| visible[at]) {
                    require((0.0..=1.0).contains(&m[at]), "m", m[at], "inside [0, 1]")?;
                    views.push(m[at]);
                }
                Ok((self.pool(views.iter().copied(), drones), !views.is_empty()))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn pool(unseen: Unseen, normalise: bool) -> OpinionPool {
        // P(A|1) = .9 .2 / (.9 .2 + .05 .8) = .18 / .22; P(A|0) = .1 .2 / (.1 .2 + .95 .8) = .02 / .78.
        OpinionPool::new(Rates::new(0.9, 0.05).unwrap(), 0.2, 0.5, unseen, normalise).unwrap()
    }

    const POSITIVE: f64 = 0.18 / 0.22;
    const NEGATIVE: f64 = 0.02 / 0.78;

    #[track_caller]
    fn assert_close(actual: f64, expected: f64) {
        assert!((actual - expected).abs() < 1e-12, "{actual} != {expected}");
    }

    #[test]
    fn arrays_that_are_not_so_many_values_a_drone_are_refused() {
        let error = pool(Unseen::Fleet, false).pool_all(&[0.5; 7], &[true; 7], 3).unwrap_err();
        assert_eq!(error, Error::Length { name: "m", actual: 7, expected: 6 });
        assert!(pool(Unseen::Fleet, false).pool_all(&[0.5], &[true], usize::MAX).is_err());
        assert_eq!(pool(Unseen::Fleet, false).pool_all(&[], &[], usize::MAX), Ok(vec![]));
    }

    #[test]
    fn posteriors_follow_bayes_rule() {
        assert_close(pool(Unseen::Fleet, false).post_positive(), POSITIVE);
        assert_close(pool(Unseen::Fleet, false).post_negative(), NEGATIVE);
    }

    #[test]
    fn one_drone_alone() {
        let alone = pool(Unseen::Fleet, false);
        assert_close(alone.pool([1.0], 1), POSITIVE);
        assert_close(alone.pool([0.0], 1), NEGATIVE);
        assert_close(alone.pool([0.9], 1), 0.8 * POSITIVE);
        assert_close(alone.pool([0.2], 1), 0.6 * NEGATIVE);
    }

    #[test]
    fn complete_uncertainty_gives_zero_as_printed() {
        assert_close(pool(Unseen::Fleet, false).pool([0.5, 0.5], 2), 0.0);
        assert_close(pool(Unseen::Visible, true).pool([0.5, 0.5], 2), 0.2);
    }

    #[test]
    fn a_drone_that_does_not_see_votes_no_crowd_with_full_weight() {
        // One of three sees m = .95: weights .3, 1/3, 1/3.
        let expected = 0.3 * POSITIVE + 2.0 / 3.0 * NEGATIVE;
        assert_close(pool(Unseen::Fleet, false).pool([0.95], 3), expected);
        assert_close(pool(Unseen::Visible, false).pool([0.95], 3), 0.9 * POSITIVE);
        assert_close(pool(Unseen::Fleet, true).pool([0.95], 3), expected / (0.3 + 2.0 / 3.0));
        assert_close(pool(Unseen::Visible, true).pool([0.95], 3), POSITIVE);
    }

    #[test]
    fn nobody_sees_the_voxel() {
        assert_close(pool(Unseen::Fleet, false).pool([], 3), NEGATIVE);
        assert_close(pool(Unseen::Visible, false).pool([], 3), 0.2);
    }

    #[test]
    fn the_threshold_itself_is_not_crowd() {
        let strict =
            OpinionPool::new(Rates::new(0.9, 0.05).unwrap(), 0.2, 0.7, Unseen::Fleet, false).unwrap();
        assert_close(strict.pool([0.7], 1), 0.4 * NEGATIVE);
        assert_close(strict.pool([0.7f64.next_up()], 1), 0.4 * POSITIVE);
    }

    #[test]
    fn rates_and_prior_of_zero_or_one_are_refused() {
        for rate in [0.0, 1.0, -0.1, f64::NAN] {
            assert!(Rates::new(rate, 0.5).is_err());
            assert!(Rates::new(0.5, rate).is_err());
            let rates = Rates::new(0.9, 0.1).unwrap();
            let error = OpinionPool::new(rates, rate, 0.5, Unseen::Fleet, false).unwrap_err();
            assert!(error.to_string().contains("strictly between 0 and 1"), "{error}");
        }
    }

    #[test]
    fn a_detector_that_knows_nothing_is_refused() {
        for (true_positive, false_positive) in [(0.02, 0.9), (0.5, 0.5)] {
            let message = Rates::new(true_positive, false_positive).unwrap_err().to_string();
            assert!(message.contains("must call crowd more often where there is one"), "{message}");
        }
    }

    proptest! {
        #[test]
        fn stays_a_probability_and_ignores_the_order_of_drones(
            m in prop::collection::vec(0.0f64..=1.0, 0..6),
            extra in 0usize..4,
            fleet in any::<bool>(),
            normalise in any::<bool>(),
        ) {
            let pool = pool(if fleet { Unseen::Fleet } else { Unseen::Visible }, normalise);
            let p = pool.pool(m.iter().copied(), m.len() + extra);
            prop_assert!((0.0..=1.0).contains(&p));
            let reversed: Vec<f64> = m.iter().rev().copied().collect();
            prop_assert!((p - pool.pool(reversed, m.len() + extra)).abs() < 1e-12);
        }
    }
}
