//! What a back-projection is told: how far, at which height, and which voxels count as seen.

use crate::error::{Result, require};

/// Which voxels count as seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coverage {
    /// The voxels first hit by the ray of some pixel centre, as in the paper.
    Rays,
    /// Also voxels that no pixel centre hits (far away, at grazing angles) but of which a face centre lies in
    /// the image with nothing in front of it. They read the heatmap there and have pixel count 0.
    Full,
}

impl Coverage {
    pub fn name(self) -> &'static str {
        match self {
            Coverage::Rays => "rays",
            Coverage::Full => "full",
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    max_range_m: f64,
    target_height_m: f64,
    coverage: Coverage,
}

impl Projection {
    /// `max_range_m` > 0 limits the distance along the ray. `target_height_m` >= 0 raises the terrain by the
    /// height at which people are marked, which is the same as lowering the camera by it.
    pub fn new(max_range_m: f64, target_height_m: f64, coverage: Coverage) -> Result<Projection> {
        require(max_range_m.is_finite() && max_range_m > 0.0, "max_range_m", max_range_m, "finite and > 0")?;
        require(
            target_height_m.is_finite() && target_height_m >= 0.0,
            "target_height_m",
            target_height_m,
            "finite and >= 0",
        )?;
        Ok(Projection { max_range_m, target_height_m, coverage })
    }

    pub fn max_range_m(&self) -> f64 {
        self.max_range_m
    }

    pub fn target_height_m(&self) -> f64 {
        self.target_height_m
    }

    pub fn coverage(&self) -> Coverage {
        self.coverage
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_of_the_projection_are_named() {
        let message = |range, height| Projection::new(range, height, Coverage::Rays).unwrap_err().to_string();
        assert_eq!(message(0.0, 0.0), "max_range_m is 0; it must be finite and > 0");
        assert_eq!(message(1.0, -0.1), "target_height_m is -0.1; it must be finite and >= 0");
    }
}
