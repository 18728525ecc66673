//! Equation 3: temporal blending with decay.
//!
//! With t' the last instant at which the voxel was seen and beta = exp(-lambda (t - t')):
//! seen now: P~_t = alpha P_t + (1 - alpha) beta P~_t'; not seen: P~_t = beta P~_t'.
//! P~ is stored undecayed at t' and decayed once, when read.

use crate::error::{Error, Result, require};

/// Equation 3 with its parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemporalBlend {
    alpha: f64,
    decay: f64,
}

impl TemporalBlend {
    /// `alpha` in (0, 1]: weight of the newest instant, 1 = the paper's Policy 1. `decay` >= 0: lambda, per
    /// unit of the elapsed time that `blend` and `fade` are given.
    pub fn new(alpha: f64, decay: f64) -> Result<TemporalBlend> {
        require(alpha > 0.0 && alpha <= 1.0, "alpha", alpha, "in (0, 1]")?;
        require(decay.is_finite() && decay >= 0.0, "decay", decay, "finite and >= 0")?;
        Ok(TemporalBlend { alpha, decay })
    }

    /// Weight of the newest instant.
    pub fn alpha(&self) -> f64 {
        self.alpha
    }

    /// lambda, per unit of the elapsed time.
    pub fn decay(&self) -> f64 {
        self.decay
    }

    /// beta: what `elapsed` without a look leaves of P~.
    pub fn beta(&self, elapsed: f64) -> f64 {
        (-self.decay * elapsed).exp()
    }

    /// P~ after `elapsed` without a look.
    pub fn fade(&self, previous: f64, elapsed: f64) -> f64 {
        self.beta(elapsed) * previous
    }

    /// P~ after a look that pooled to `pooled`.
    pub fn blend(&self, previous: f64, elapsed: f64, pooled: f64) -> f64 {
        self.join(self.fade(previous, elapsed), pooled)
    }

    /// The same where `faded` is already what is left of the P~ before.
    pub fn join(&self, faded: f64, pooled: f64) -> f64 {
        self.alpha * pooled + (1.0 - self.alpha) * faded
    }

    /// The same for arrays of equal length; where `seen` is false P~ only fades.
    pub fn blend_all(
        &self,
        previous: &[f64],
        elapsed: &[f64],
        pooled: &[f64],
        seen: &[bool],
    ) -> Result<Vec<f64>> {
        let expected = previous.len();
        for (name, actual) in [("elapsed_s", elapsed.len()), ("pooled", pooled.len()), ("seen", seen.len())] {
            if actual != expected {
                return Err(Error::Length { name, actual, expected });
            }
        }
        (0..expected)
            .map(|at| {
                let elapsed_s = elapsed[at];
                require(
                    elapsed_s.is_finite() && elapsed_s >= 0.0,
                    "elapsed_s",
                    elapsed_s,
                    "finite and >= 0",
                )?;
                require((0.0..=1.0).contains(&previous[at]), "previous", previous[at], "inside [0, 1]")?;
                if !seen[at] {
                    return Ok(self.fade(previous[at], elapsed[at]));
                }
                require((0.0..=1.0).contains(&pooled[at]), "pooled", pooled[at], "inside [0, 1]")?;
                Ok(self.blend(previous[at], elapsed[at], pooled[at]))
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn assert_close(actual: f64, expected: f64) {
        assert!((actual - expected).abs() < 1e-12, "{actual} != {expected}");
    }

    #[test]
    fn worked_by_hand() {
        // exp(-0.05 * 20) = 1/e
        let blend = TemporalBlend::new(0.1, 0.05).unwrap();
        assert_close(blend.fade(0.8, 20.0), 0.294_303_552_937_153_9);
        assert_close(blend.blend(0.8, 20.0, 0.5), 0.05 + 0.9 * 0.294_303_552_937_153_9);
    }

    #[test]
    fn policy_one_forgets_everything_else() {
        assert_close(TemporalBlend::new(1.0, 0.3).unwrap().blend(0.9, 5.0, 0.2), 0.2);
    }

    #[test]
    fn without_decay_nothing_fades() {
        assert_close(TemporalBlend::new(0.1, 0.0).unwrap().fade(0.7, 1e9), 0.7);
    }

    #[test]
    fn a_watched_voxel_settles_below_its_look_because_decay_acts_on_it_too() {
        // Fixed point alpha P / (1 - (1 - alpha) exp(-lambda)): alpha .1, lambda .05 a look.
        let blend = TemporalBlend::new(0.1, 0.05).unwrap();
        let settled = (0..2000).fold(0.0, |p, _| blend.blend(p, 1.0, 1.0));
        assert_close(settled, 0.1 / (1.0 - 0.9 * (-0.05f64).exp()));
    }

    #[test]
    fn an_endless_gap_is_refused() {
        // Without decay it would be 0 * infinity.
        let blend = TemporalBlend::new(0.5, 0.0).unwrap();
        let message = blend.blend_all(&[0.5], &[f64::INFINITY], &[0.5], &[true]).unwrap_err().to_string();
        assert_eq!(message, "elapsed_s is inf; it must be finite and >= 0");
    }

    #[test]
    fn bounds_are_named() {
        for (alpha, decay, words) in [
            (0.0, 0.0, "alpha is 0; it must be in (0, 1]"),
            (1.1, 0.0, "alpha is 1.1"),
            (0.1, -1.0, "decay is -1; it must be finite and >= 0"),
            (0.1, f64::NAN, "decay is NaN"),
        ] {
            let message = TemporalBlend::new(alpha, decay).unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
    }
}
