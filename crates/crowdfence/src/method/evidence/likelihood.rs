//! How strongly a look speaks for crowd: ln P(m | crowd) / P(m | no crowd), as measured on missions whose truth is known.

use crate::error::{Error, Result, require};

/// Table of the log likelihood ratio by ground sample distance, tilt and mean heatmap value.
#[derive(Debug, Clone, PartialEq)]
pub struct LikelihoodRatio {
    gsd_m: Vec<f32>,
    tilt_deg: Vec<f32>,
    mean: Vec<f32>,
    log_ratio: Vec<f32>,
}

/// Beyond e^20 a ratio is a guess.
const MOST: f32 = 20.0;
/// A table is small; a file that claims more is damaged.
pub(super) const MOST_ENTRIES: usize = 1 << 16;

impl LikelihoodRatio {
    /// `gsd_m` [D - 1], `tilt_deg` [T - 1] and `mean` [M - 1]: where one bin ends and the next begins, increasing; what lies
    /// beyond belongs to the first or the last. A value on a border of `gsd_m` or `tilt_deg` belongs to the bin
    /// above, one of `mean` to the bin below. `log_ratio` [D, T, M], natural logarithm.
    pub fn new(
        gsd_m: Vec<f32>,
        tilt_deg: Vec<f32>,
        mean: Vec<f32>,
        log_ratio: Vec<f32>,
    ) -> Result<LikelihoodRatio> {
        for (name, borders) in [("gsd_m", &gsd_m), ("tilt_deg", &tilt_deg), ("mean", &mean)] {
            check_borders(name, borders)?;
        }
        let expected = (gsd_m.len() + 1) * (tilt_deg.len() + 1) * (mean.len() + 1);
        let actual = log_ratio.len();
        if actual != expected || actual > MOST_ENTRIES {
            return Err(Error::Length { name: "log_ratio", actual, expected: expected.min(MOST_ENTRIES) });
        }
        for &ratio in &log_ratio {
            require(ratio.abs() <= MOST, "log_ratio", f64::from(ratio), "inside [-20, 20]")?;
        }
        Ok(LikelihoodRatio { gsd_m, tilt_deg, mean, log_ratio })
    }

    pub fn log_ratio(&self, gsd_m: f32, tilt_deg: f32, mean: f32) -> f32 {
        // Counted and not searched: so few borders are compared at once, and no branch is guessed.
        let below = |borders: &[f32], value: f32| borders.iter().filter(|&&border| border <= value).count();
        let gsd = below(&self.gsd_m, gsd_m);
        let tilt = below(&self.tilt_deg, tilt_deg);
        let value = self.mean.iter().filter(|&&border| border < mean).count();
        let row = gsd * (self.tilt_deg.len() + 1) + tilt;
        self.log_ratio[row * (self.mean.len() + 1) + value]
    }

    /// Borders between the bins, and the table: `gsd_m`, `tilt_deg`, `mean`, `log_ratio`.
    pub fn columns(&self) -> [&[f32]; 4] {
        [&self.gsd_m, &self.tilt_deg, &self.mean, &self.log_ratio]
    }
}

fn check_borders(name: &'static str, borders: &[f32]) -> Result<()> {
    let mut lowest = 0.0;
    for &border in borders {
        require(
            border.is_finite() && border > lowest,
            name,
            f64::from(border),
            "finite, > 0 and increasing",
        )?;
        lowest = border;
    }
    Ok(())
}
