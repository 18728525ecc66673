//! Least squares of a plane over points around the centre of a column.

use super::plane::Plane;

/// Where points lie on one line in plan, or are one, the slope across them comes out as 0.
const ACROSS: f64 = 1e-6;

/// Sums over the points, each with its weight.
#[derive(Default)]
pub(super) struct PlaneFit {
    pub weight: f64,
    pub x: f64,
    pub y: f64,
    pub xx: f64,
    pub xy: f64,
    pub yy: f64,
    pub z: f64,
    pub xz: f64,
    pub yz: f64,
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

    /// Height at the column's centre and the slopes, these cut to what a [`Plane`] keeps. There must be a point. Without
    /// closures, so that it becomes vectors where many are worked out.
    #[inline(always)]
    pub fn plane(&self) -> (f64, [f64; 2]) {
        let (x, y, z) = (self.x / self.weight, self.y / self.weight, self.z / self.weight);
        let xx = self.xx / self.weight - x * x + ACROSS;
        let yy = self.yy / self.weight - y * y + ACROSS;
        let xy = self.xy / self.weight - x * y;
        let (xz, yz) = (self.xz / self.weight - x * z, self.yz / self.weight - y * z);
        let determinant = xx * yy - xy * xy;
        let (along_x, along_y) = (xz * yy - yz * xy, yz * xx - xz * xy);
        let slope_x = (along_x / determinant).clamp(-Plane::STEEPEST, Plane::STEEPEST);
        let slope_y = (along_y / determinant).clamp(-Plane::STEEPEST, Plane::STEEPEST);
        (z - slope_x * x - slope_y * y, [slope_x, slope_y])
    }
}
