//! How strongly a look speaks for crowd: ln P(m | crowd) / P(m | no crowd), as measured on missions whose truth is known.

use super::borders::Borders;
use crate::error::{Error, Result, require};
use crate::method::VoxelLook;

/// Table of the log likelihood ratio by ground sample distance, tilt and mean heatmap value.
#[derive(Debug, Clone, PartialEq)]
pub struct LikelihoodRatio {
    gsd_m: Borders,
    tilt_deg: Borders,
    mean: Borders,
    log_ratio: Vec<f32>,
    finer: Option<Box<Finer>>,
}

/// What was measured of cameras that are so many times as fine: their focal length in pixels over that of the others.
#[derive(Debug, Clone, PartialEq)]
pub struct Finer {
    times: f32,
    table: LikelihoodRatio,
}

/// A look of a camera that is finer than those of the calibration weighs as one of a camera so many times as fine as
/// these at most, where it shows crowd, and as one of theirs where it shows none; where nothing was measured of finer
/// cameras, it also says what such a one says. A finer picture finds crowds that theirs missed, but on the ground it is
/// as far off as theirs: poses are off in degrees, whatever the picture, and what stands before a crowd hides it from
/// both. Otherwise people 200 m away stand on ground that one look calls empty.
const FINER: f32 = 1.5;
/// More pixels across than any camera has.
const MOST_TIMES: f32 = 1e3;

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
        let [gsd_m, tilt_deg, mean] = [gsd_m, tilt_deg, mean].map(Borders::new);
        Ok(LikelihoodRatio { gsd_m, tilt_deg, mean, log_ratio, finer: None })
    }

    /// The same, and beside it the table of cameras that are `times` as fine, by their own metres per pixel. Looks of
    /// cameras between the two lie between what both say, and none speaks more against crowd than with this one.
    pub fn with_finer(self, times: f32, table: LikelihoodRatio) -> Result<LikelihoodRatio> {
        require(times > 1.0 && times <= MOST_TIMES, "times", f64::from(times), "above 1, at most 1000")?;
        let LikelihoodRatio { gsd_m, tilt_deg, mean, log_ratio, .. } = table;
        let table = LikelihoodRatio { gsd_m, tilt_deg, mean, log_ratio, finer: None };
        Ok(LikelihoodRatio { finer: Some(Box::new(Finer { times, table })), ..self })
    }

    /// What was measured of finer cameras.
    pub fn finer(&self) -> Option<&Finer> {
        self.finer.as_deref()
    }

    /// ln P(m | crowd) / P(m | no crowd) of a mean heatmap value inside [0, 1], seen at so many metres per pixel, > 0, and
    /// at such a tilt, from -90 to 90.
    pub fn of(&self, gsd_m: f32, tilt_deg: f32, mean: f32) -> Result<f32> {
        require(gsd_m.is_finite() && gsd_m > 0.0, "gsd_m", gsd_m.into(), "finite and > 0")?;
        require((-90.0..=90.0).contains(&tilt_deg), "tilt_deg", tilt_deg.into(), "inside [-90, 90]")?;
        require((0.0..=1.0).contains(&mean), "mean", mean.into(), "inside [0, 1]")?;
        Ok(self.log_ratio(gsd_m, tilt_deg, mean))
    }

    /// The same of a look, which was checked when it was made.
    pub(super) fn log_ratio(&self, gsd_m: f32, tilt_deg: f32, mean: f32) -> f32 {
        let row = self.gsd_m.up_to(gsd_m) * (self.tilt_deg.count() + 1) + self.tilt_deg.up_to(tilt_deg);
        self.log_ratio[row * (self.mean.count() + 1) + self.mean.below(mean)]
    }

    /// l of a look, and the metres per pixel that it weighs with, by the focal length of the calibration's cameras in
    /// pixels; see [`FINER`].
    pub(in crate::method) fn of_look(&self, look: &VoxelLook, focal_px: f32) -> (f32, f32) {
        let (fine_m, as_theirs_m) = (look.gsd_m(focal_px), look.range_m / focal_px);
        let log_ratio = |gsd_m: f32| self.log_ratio(gsd_m, look.tilt_deg, look.mean as f32);
        if fine_m >= as_theirs_m {
            return (log_ratio(fine_m), fine_m);
        }
        let little_finer_m = fine_m.max(as_theirs_m / FINER);
        let said = match &self.finer {
            Some(finer) => {
                let part = ((as_theirs_m / fine_m - 1.0) / (finer.times - 1.0)).min(1.0);
                let theirs = log_ratio(as_theirs_m);
                let mixed = (1.0 - part) * theirs + part * finer.of_distance(as_theirs_m, look);
                // Where a finer camera finds nobody, crowds that none finds are as many as with theirs.
                mixed.max(theirs.min(0.0))
            }
            None => match log_ratio(little_finer_m) {
                crowd if crowd > 0.0 => crowd,
                _ => log_ratio(as_theirs_m),
            },
        };
        (said, if said > 0.0 { little_finer_m } else { as_theirs_m })
    }

    /// The mean heatmap value up to which no look, however close and steep, has a ratio that `is_large`; infinite where
    /// none has.
    pub(super) fn never_up_to(&self, is_large: impl Fn(f32) -> bool) -> f32 {
        let finer = self.finer.as_ref().map(|finer| finer.table.never_up_to_by_itself(&is_large));
        self.never_up_to_by_itself(&is_large).min(finer.unwrap_or(f32::INFINITY))
    }

    fn never_up_to_by_itself(&self, is_large: impl Fn(f32) -> bool) -> f32 {
        let count = self.mean.count() + 1;
        let bins = self.log_ratio.iter().zip((0..count).cycle());
        match bins.filter(|&(&ratio, _)| is_large(ratio)).map(|(_, bin)| bin).min() {
            Some(0) => f32::NEG_INFINITY,
            Some(bin) => self.mean.as_slice()[bin - 1],
            None => f32::INFINITY,
        }
    }

    /// Borders between the bins, and the table: `gsd_m`, `tilt_deg`, `mean`, `log_ratio`.
    pub fn columns(&self) -> [&[f32]; 4] {
        [self.gsd_m.as_slice(), self.tilt_deg.as_slice(), self.mean.as_slice(), &self.log_ratio]
    }
}

impl Finer {
    /// How many times as fine.
    pub fn times(&self) -> f32 {
        self.times
    }

    /// The table, which has no finer one.
    pub fn table(&self) -> &LikelihoodRatio {
        &self.table
    }

    /// l as far away as the coarser cameras see so many metres per pixel.
    fn of_distance(&self, coarse_m: f32, look: &VoxelLook) -> f32 {
        self.table.log_ratio(coarse_m / self.times, look.tilt_deg, look.mean as f32)
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
