//! Method `moving-average`: the mean of the calibrated scores of all looks, which fade with their age.
//!
//!   P = sum of w p / sum of w,  w = exp(-age / memory),  p = P(A = 1 | m) of one look by the calibration
//!
//! For comparison: `evidence` averages log odds and not probabilities, against a doubt, sharp looks before coarse ones,
//! and adds up drones. What nobody looks at keeps its last value.

use super::{Calibration, Elapsed, FusionMethod, InstantOrder, Parameter, Stored, VoxelLook};
use crate::error::{Result, require};
use crate::sealed::{Reader, Writer};

/// Method `moving-average`: the mean probability over all looks, newer ones weighing more.
#[derive(Debug, Clone, PartialEq)]
pub struct MovingAverage {
    calibration: Calibration,
    memory_s: f64,
    threshold: f64,
}

/// What looks leave at a voxel, as of the last of them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScoreSum {
    /// Sum of w p.
    score: f32,
    /// Sum of w.
    weight: f32,
}

impl FusionMethod for MovingAverage {
    type Belief = ScoreSum;
    const NO_BELIEF: ScoreSum = ScoreSum { score: 0.0, weight: 0.0 };
    /// The factor that time leaves of a weight.
    type Fading = f32;
    const NAME: &'static str = "moving-average";
    const ORDER: InstantOrder = InstantOrder::Any;

    fn max_drones(&self) -> Option<usize> {
        None
    }

    fn fading(&self, since: Elapsed) -> f32 {
        (-since.seconds / self.memory_s).exp() as f32
    }

    fn update(&self, before: Option<(ScoreSum, f32)>, looks: &[(VoxelLook, f32)]) -> ScoreSum {
        let mut sum = before.map_or(Self::NO_BELIEF, |(sum, fading)| ScoreSum {
            score: fading * sum.score,
            weight: fading * sum.weight,
        });
        for (look, fading) in looks {
            sum.score += fading * self.calibration.posterior(self.calibration.log_ratio(look)) as f32;
            sum.weight += fading;
        }
        sum
    }

    /// Time takes as much of both sums.
    fn probability(&self, sum: ScoreSum, _fading: f32) -> f64 {
        if sum.weight > 0.0 { f64::from(sum.score / sum.weight).min(1.0) } else { self.calibration.prior() }
    }

    fn looks(&self, sum: ScoreSum, fading: f32) -> Option<f64> {
        Some(f64::from(fading * sum.weight))
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
            ("memory_s", Parameter::Number(self.memory_s)),
            ("threshold", Parameter::Number(self.threshold)),
            ("focal_px", Parameter::Number(self.calibration.focal_px())),
        ]
    }
}

impl MovingAverage {
    /// After `memory_s` > 0 a look weighs 1 / e; `threshold` is strictly between 0 and 1.
    pub fn new(calibration: Calibration, memory_s: f64, threshold: f64) -> Result<MovingAverage> {
        require(memory_s.is_finite() && memory_s > 0.0, "memory_s", memory_s, "finite and > 0")?;
        require(threshold > 0.0 && threshold < 1.0, "threshold", threshold, "strictly between 0 and 1")?;
        Ok(MovingAverage { calibration, memory_s, threshold })
    }

    /// What a look says.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// After so many seconds a look weighs 1 / e of what it did.
    pub fn memory_s(&self) -> f64 {
        self.memory_s
    }
}

/// The calibration; f64 memory_s, threshold. A belief is two f32, the sums of w p and of w.
impl Stored for MovingAverage {
    fn write(&self, payload: &mut Writer) {
        self.calibration.write(payload);
        payload.f64(self.memory_s);
        payload.f64(self.threshold);
    }

    fn read(reader: &mut Reader<'_>, version: u32) -> Result<MovingAverage> {
        MovingAverage::new(Calibration::read(reader, version)?, reader.f64()?, reader.f64()?)
    }

    fn write_belief(sum: ScoreSum, payload: &mut Writer) {
        payload.f32(sum.score);
        payload.f32(sum.weight);
    }

    fn read_beliefs(reader: &mut Reader<'_>, _version: u32, count: usize) -> Result<Vec<ScoreSum>> {
        let numbers = reader.numbers(2 * count, f32::from_le_bytes)?;
        let is_sum = |pair: &[f32]| 0.0 <= pair[0] && pair[0] <= 1.001 * pair[1] && pair[1].is_finite();
        if numbers.chunks_exact(2).all(is_sum) {
            Ok(numbers.chunks_exact(2).map(|pair| ScoreSum { score: pair[0], weight: pair[1] }).collect())
        } else {
            Err(reader.damaged("a sum of scores that none add up to"))
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::method::{looks_from_above, three_step_calibration};

    fn moving_average() -> MovingAverage {
        MovingAverage::new(three_step_calibration(), 10.0 / std::f64::consts::LN_2, 0.5).unwrap()
    }

    fn probability(sum: ScoreSum) -> f64 {
        moving_average().probability(sum, 1.0)
    }

    #[test]
    fn newer_looks_weigh_more() {
        let method = moving_average();
        // p = 1 / (1 + e^-3) = .952574 and 1 / (1 + e) = .268941; their mean is .610758.
        let first = method.update(None, &looks_from_above(&[0.9, 0.1], 1.0));
        assert!((probability(first) - 0.610_758).abs() < 1e-6);
        // 10 s later both weigh half: (.5 * 1.221515 + .268941) / 2 = .439849.
        let half = method.fading(Elapsed { seconds: 10.0, instants: 1 });
        let second = method.update(Some((first, half)), &looks_from_above(&[0.1], 1.0));
        assert!((probability(second) - 0.439_849).abs() < 1e-6);
        // Without a look the mean stays; how much stands behind it does not.
        assert_eq!(method.probability(second, half), probability(second));
        assert!((method.looks(second, half).unwrap() - 1.0).abs() < 1e-6);
    }

    #[test]
    fn nothing_that_is_left_of_looks_says_nothing() {
        let method = moving_average();
        assert_eq!(method.probability(MovingAverage::NO_BELIEF, 0.0), method.unseen_probability());
    }

    proptest! {
        #[test]
        fn a_late_look_gives_what_it_would_have_given_in_time(
            first in 0.0f64..=1.0, second in 0.0f64..=1.0, seconds in 0.0f64..60.0,
        ) {
            let method = moving_average();
            let fading = method.fading(Elapsed { seconds, instants: 1 });
            let earlier = method.update(None, &looks_from_above(&[first], 1.0));
            let in_time = method.update(Some((earlier, fading)), &looks_from_above(&[second], 1.0));
            let newer = method.update(None, &looks_from_above(&[second], 1.0));
            let late = method.update(Some((newer, 1.0)), &looks_from_above(&[first], fading));
            prop_assert!((probability(in_time) - probability(late)).abs() < 1e-6);
        }

        #[test]
        fn it_lies_between_the_scores_of_its_looks(means in prop::collection::vec(0.0f64..=1.0, 1..6)) {
            let method = moving_average();
            let all = probability(method.update(None, &looks_from_above(&means, 1.0)));
            let each: Vec<f64> =
                means.iter().map(|&mean| probability(method.update(None, &looks_from_above(&[mean], 1.0)))).collect();
            let (low, high) = each.iter().fold((1.0, 0.0), |(low, high): (f64, f64), &p| (low.min(p), high.max(p)));
            prop_assert!(low - 1e-6 <= all && all <= high + 1e-6);
        }
    }
}
