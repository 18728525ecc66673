//! What a back-projection is told: how far, at which height, which voxels count as seen, and which pixels as crowd.

use crate::error::{Result, require};
use crate::terrain::Surface;

/// Which voxels count as seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Coverage {
    /// The voxels first hit by the ray of some pixel centre, as in the paper.
    Rays,
    /// Also voxels that no pixel centre hits (far away, at grazing angles, finer than the pixels) but of which the
    /// middle of the top lies in the image with nothing in front of it. They read the heatmap there and have pixel
    /// count 0.
    Full,
}

impl Coverage {
    /// As in configurations and reports: `rays` or `full`.
    pub fn name(self) -> &'static str {
        match self {
            Coverage::Rays => "rays",
            Coverage::Full => "full",
        }
    }
}

/// Heatmap value above which a pixel shows crowd unless somebody knows better: the `b_threshold` of every method
/// unless told otherwise.
pub const DEFAULT_CROWD_THRESHOLD: f64 = 0.5;

/// People are marked at their heads at most, on a stage or a float at most so high.
const HIGHEST_TARGET_M: f64 = 100.0;

/// Bound of the range, metres; ranges are kept as float32.
const MAX_RANGE_M: f64 = 1e30;

/// How views are back-projected, checked once. The default surface is [`Surface::Planes`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Projection {
    max_range_m: f64,
    target_height_m: f64,
    coverage: Coverage,
    crowd_threshold: f64,
    surface: Surface,
}

impl Projection {
    /// `max_range_m` > 0 limits the distance along the ray. `target_height_m`, in [0, 100], raises the terrain by the
    /// height at which people are marked, which is the same as lowering the camera by it.
    pub fn new(max_range_m: f64, target_height_m: f64, coverage: Coverage) -> Result<Projection> {
        require(max_range_m.is_finite() && max_range_m > 0.0, "max_range_m", max_range_m, "finite and > 0")?;
        require(max_range_m <= MAX_RANGE_M, "max_range_m", max_range_m, "at most 1e30")?;
        let raised = (0.0..=HIGHEST_TARGET_M).contains(&target_height_m);
        require(raised, "target_height_m", target_height_m, "in [0, 100]")?;
        Ok(Projection {
            max_range_m,
            target_height_m,
            coverage,
            crowd_threshold: DEFAULT_CROWD_THRESHOLD,
            surface: Surface::default(),
        })
    }

    /// The same for pixels that show crowd above another value, in [0, 1]. It decides which pixels are in
    /// [`CrowdMass`](crate::observation::CrowdMass) and nothing else.
    pub fn with_crowd_threshold(self, crowd_threshold: f64) -> Result<Projection> {
        let is_value = (0.0..=1.0).contains(&crowd_threshold);
        require(is_value, "crowd_threshold", crowd_threshold, "inside [0, 1]")?;
        Ok(Projection { crowd_threshold, ..self })
    }

    /// The same onto another surface of the terrain.
    pub fn with_surface(self, surface: Surface) -> Projection {
        Projection { surface, ..self }
    }

    /// Largest distance along a ray, metres.
    pub fn max_range_m(&self) -> f64 {
        self.max_range_m
    }

    /// Height above ground at which people are marked, metres.
    pub fn target_height_m(&self) -> f64 {
        self.target_height_m
    }

    /// Which voxels count as seen.
    pub fn coverage(&self) -> Coverage {
        self.coverage
    }

    /// Heatmap value above which a pixel shows crowd.
    pub fn crowd_threshold(&self) -> f64 {
        self.crowd_threshold
    }

    /// What of the terrain rays meet.
    pub fn surface(&self) -> Surface {
        self.surface
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bounds_of_the_projection_are_named() {
        let message = |range, height| Projection::new(range, height, Coverage::Rays).unwrap_err().to_string();
        assert_eq!(message(0.0, 0.0), "max_range_m is 0; it must be finite and > 0");
        assert_eq!(message(1e300, 0.0), "max_range_m is 1e300; it must be at most 1e30");
        assert_eq!(message(1.0, -0.1), "target_height_m is -0.1; it must be in [0, 100]");
        let projection = Projection::new(1.0, 0.0, Coverage::Rays).unwrap();
        let message = projection.with_crowd_threshold(f64::NAN).unwrap_err().to_string();
        assert_eq!(message, "crowd_threshold is NaN; it must be inside [0, 1]");
    }
}
