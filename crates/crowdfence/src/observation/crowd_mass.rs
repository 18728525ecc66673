//! Where the crowd in a picture went, so that none is lost without a word.

use std::iter::Sum;
use std::ops::Add;

use crate::error::{Result, require};

/// Heatmap value summed over the pixels that show crowd (those above the crowd threshold), by what their rays met.
/// Every such pixel counts in exactly one of the six; only what met ground is on the map.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct CrowdMass {
    /// A voxel in range.
    pub ground: f64,
    /// A voxel, but beyond the range.
    pub out_of_range: f64,
    /// No voxel, on a way down through a place that the map encloses and has nothing at.
    pub hole: f64,
    /// No voxel, on a way down to ground that lies beside the map.
    pub off_map: f64,
    /// No voxel, on a way that is level or leads up.
    pub sky: f64,
    /// Nothing that could be told: the lens model gives the pixel no ray, or the camera is under ground.
    pub unusable: f64,
}

impl CrowdMass {
    /// Names and values, ground first.
    pub fn by_fate(&self) -> [(&'static str, f64); 6] {
        [
            ("ground", self.ground),
            ("out_of_range", self.out_of_range),
            ("hole", self.hole),
            ("off_map", self.off_map),
            ("sky", self.sky),
            ("unusable", self.unusable),
        ]
    }

    /// All that the pixels showed.
    pub fn total(&self) -> f64 {
        self.ground + self.lost()
    }

    /// What met no ground.
    pub fn lost(&self) -> f64 {
        self.out_of_range + self.hole + self.off_map + self.sky + self.unusable
    }

    /// Refuses what no pixels can add up to.
    pub fn check(&self) -> Result<()> {
        let check = |(name, mass): (&'static str, f64)| {
            require(mass.is_finite() && mass >= 0.0, name, mass, "finite and >= 0")
        };
        self.by_fate().into_iter().try_for_each(check)
    }
}

impl Add for CrowdMass {
    type Output = CrowdMass;

    fn add(self, other: CrowdMass) -> CrowdMass {
        CrowdMass {
            ground: self.ground + other.ground,
            out_of_range: self.out_of_range + other.out_of_range,
            hole: self.hole + other.hole,
            off_map: self.off_map + other.off_map,
            sky: self.sky + other.sky,
            unusable: self.unusable + other.unusable,
        }
    }
}

impl Sum for CrowdMass {
    fn sum<I: Iterator<Item = CrowdMass>>(masses: I) -> CrowdMass {
        masses.fold(CrowdMass::default(), CrowdMass::add)
    }
}
