//! Least squares of a plane over points around the centre of a column.

use super::plane::Plane;

/// Where points lie on one line in plan, or are one, the slope across them comes out as 0.
const ACROSS: f64 = 1e-6;

#[derive(Default)]
pub(super) struct PlaneFit {
    weight: f64,
    x: f64,
    y: f64,
    xx: f64,
    xy: f64,
    yy: f64,
    z: f64,
    xz: f64,
    yz: f64,
}

impl PlaneFit {
    /// A point in voxels from the column's centre, above any height that is the same for all.
    pub fn add(&mut self, [x, y, z]: [f64; 3], weight: f64) {
        self.weight += weight;
        self.x += weight * x;
        self.y += weight * y;
        self.xx += weight * x * x;
        self.xy += weight * x * y;
        self.yy += weight * y * y;
        self.z += weight * z;
        self.xz += weight * x * z;
        self.yz += weight * y * z;
    }

    /// Height at the column's centre and the slopes, these cut to what a [`Plane`] keeps. There must be a point.
    pub fn plane(&self) -> (f64, [f64; 2]) {
        let mean = |sum: f64| sum / self.weight;
        let [x, y, z] = [self.x, self.y, self.z].map(mean);
        let [xx, yy] = [mean(self.xx) - x * x, mean(self.yy) - y * y].map(|spread| spread + ACROSS);
        let xy = mean(self.xy) - x * y;
        let (xz, yz) = (mean(self.xz) - x * z, mean(self.yz) - y * z);
        let determinant = xx * yy - xy * xy;
        let slope = [(xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant]
            .map(|slope| slope.clamp(-Plane::STEEPEST, Plane::STEEPEST));
        (z - slope[0] * x - slope[1] * y, slope)
    }
}
