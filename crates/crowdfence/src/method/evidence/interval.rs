//! Between which bounds the probability of a place lies.
//!
//! L is what the calibration says on average. Where the looks at a place sum to (E, W), the log odds of its crowd lie
//! beside L, logistically distributed, with the scale
//!
//!   s = sqrt(scene^2 + look^2 / (W + doubt))
//!
//! `scene` is how far whole scenes are off the calibration, which no number of looks mends; `look` is how far one sharp
//! look is off, which further ones average away. Both were measured on missions whose truth is known
//! (`benchmarks/evidence/README.md`), and are larger downwards: where nobody is, the calibration says too much.

/// Scales of the log odds.
#[derive(Debug, Clone, Copy)]
struct Spread {
    scene: f64,
    look: f64,
}

const UP: Spread = Spread { scene: 0.9, look: 0.6 };
const DOWN: Spread = Spread { scene: 1.1, look: 0.8 };

/// Where nobody has looked, anything may be true.
pub(super) const UNSEEN: [f64; 2] = [0.0, 1.0];

/// Bounds of the probability at the level, in (0, 1), from its log odds and W + doubt.
pub(super) fn interval(log_odds: f64, looks: f64, level: f64) -> [f64; 2] {
    let reach = ((1.0 + level) / (1.0 - level)).ln();
    let probability = |log_odds: f64| 1.0 / (1.0 + (-log_odds).exp());
    [probability(log_odds - reach * DOWN.scale(looks)), probability(log_odds + reach * UP.scale(looks))]
}

impl Spread {
    fn scale(self, looks: f64) -> f64 {
        (self.scene * self.scene + self.look * self.look / looks).sqrt()
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn nineteen_in_twenty_on_either_side() {
        // ln 19 = 2.9444; s = sqrt(.81 + .36) upwards and sqrt(1.21 + .64) downwards.
        let [low, high] = interval(0.0, 1.0, 0.9);
        let log_odds = |p: f64| (p / (1.0 - p)).ln();
        assert!((log_odds(high) - 2.9444 * 1.0817).abs() < 1e-3);
        assert!((log_odds(low) + 2.9444 * 1.3601).abs() < 1e-3);
    }

    proptest! {
        #[test]
        fn it_holds_the_probability_and_narrows_with_looks(
            log_odds in -15.0f64..15.0, looks in 0.05..50.0, more in 0.0..50.0, level in 0.01..0.98,
        ) {
            let p = 1.0 / (1.0 + (-log_odds).exp());
            let [low, high] = interval(log_odds, looks, level);
            prop_assert!(0.0 <= low && low <= p && p <= high && high <= 1.0);
            let [low_after, high_after] = interval(log_odds, looks + more, level);
            prop_assert!(low_after >= low && high_after <= high);
            let [low_wider, high_wider] = interval(log_odds, looks, level + 0.01);
            prop_assert!(low_wider <= low && high_wider >= high);
        }
    }
}
