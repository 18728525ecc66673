//! Where in its voxel the surface lies: the plane that a column's solid ends in, in four bytes.
//!
//! A column of the terrain is a stack of solids with air between them. Each is a run of voxels without a gap, and
//! its top is the plane of its uppermost voxel; the planes of the voxels below are not looked at. It is the idea of
//! the contours of sparse voxel octrees (Laine and Karras, 2010), with one sheet a column in the place of two.

use glam::DVec3;

/// A plane over the column of a voxel: height at the column's centre and slopes, in voxels. It may leave its voxel
/// by [`Plane::RISE`] upwards and [`Plane::DROP`] downwards, so that a slope is one surface a column and not a stair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Plane {
    /// Above the voxel's floor, in steps of 2^-13 voxels.
    height: i16,
    /// Rise along x and y, in steps of 2^-6 voxels a voxel.
    slope: [i8; 2],
}

const HEIGHT_STEPS: f64 = 8192.0;
const SLOPE_STEPS: f64 = 64.0;

impl Plane {
    /// The upper face of the voxel: what is left where nothing finer is known, and the terrain as cubes.
    pub const CEILING: Plane = Plane { height: HEIGHT_STEPS as i16, slope: [0, 0] };
    /// Heights at the column's centre, above the voxel's floor, that a plane may have.
    const LOWEST: f64 = -2.0;
    const HIGHEST: f64 = 2.0;
    /// Steeper than that, and a slope is a wall that the voxels below the uppermost one show.
    pub const STEEPEST: f64 = 127.0 / SLOPE_STEPS;
    /// How many voxels a plane may reach above its own at a corner of the column: half a voxel along both axes at the
    /// steepest slope.
    pub const RISE: u32 = 3;
    /// The same below its voxel's floor.
    pub const DROP: u32 = 4;

    /// The nearest plane that can be kept: heights and slopes beyond the bounds are cut to them.
    pub fn new(height: f64, slope: [f64; 2]) -> Plane {
        let slope = slope.map(|rise| (rise * SLOPE_STEPS).round().clamp(-127.0, 127.0) as i8);
        let height = (height.clamp(Plane::LOWEST, Plane::HIGHEST) * HEIGHT_STEPS).round() as i16;
        Plane { height, slope }
    }

    /// As one number, for files and pickles.
    #[inline(always)]
    pub fn to_bits(self) -> u32 {
        let [x, y] = self.slope.map(|rise| rise as u8);
        let [low, high] = self.height.to_le_bytes();
        u32::from_le_bytes([low, high, x, y])
    }

    /// The inverse; numbers that no plane has are cut to the bounds.
    #[inline(always)]
    pub fn from_bits(bits: u32) -> Plane {
        const BOUNDS: [i16; 2] =
            [(Plane::LOWEST * HEIGHT_STEPS) as i16, (Plane::HIGHEST * HEIGHT_STEPS) as i16];
        let [low, high, x, y] = bits.to_le_bytes();
        let height = i16::from_le_bytes([low, high]).clamp(BOUNDS[0], BOUNDS[1]);
        Plane { height, slope: [(x as i8).max(-127), (y as i8).max(-127)] }
    }

    /// At the centre of the column, voxels above the voxel's floor.
    pub fn height(self) -> f64 {
        f64::from(self.height) / HEIGHT_STEPS
    }

    /// Rise along x and y, voxels a voxel.
    pub fn slope(self) -> [f64; 2] {
        self.slope.map(|rise| f64::from(rise) / SLOPE_STEPS)
    }

    /// Height and slopes in half the width, as exact, of a plane as one number.
    #[inline(always)]
    pub fn single(bits: u32) -> (f32, [f32; 2]) {
        let (step, slope_step) = (1.0 / HEIGHT_STEPS as f32, 1.0 / SLOPE_STEPS as f32);
        let slope = |shift: u32| f32::from((bits >> shift) as i8) * slope_step;
        (f32::from(bits as i16) * step, [slope(16), slope(24)])
    }

    /// Away from the solid under it, 1 upwards.
    pub fn normal(self) -> DVec3 {
        let [x, y] = self.slope();
        DVec3::new(-x, -y, 1.0)
    }

    /// Height at the lowest corner of the column, voxels above the voxel's floor.
    pub fn lowest_corner(self) -> f64 {
        let [x, y] = self.slope();
        self.height() - 0.5 * (x.abs() + y.abs())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_plane_takes_four_bytes() {
        assert_eq!(size_of::<Plane>(), 4);
    }

    #[test]
    fn heights_and_slopes_are_kept_to_half_a_step() {
        for (height, slope) in [(0.3, [0.1, -0.7]), (-0.99, [1.9, 0.0]), (1.99, [0.0, -1.98])] {
            let plane = Plane::new(height, slope);
            assert!((plane.height() - height).abs() <= 0.5 / 8192.0);
            assert!(plane.slope().iter().zip(slope).all(|(kept, rise)| (kept - rise).abs() <= 0.5 / 64.0));
        }
        assert_eq!(Plane::new(1.0, [0.0, 0.0]), Plane::CEILING);
    }

    #[test]
    fn half_the_width_is_as_exact() {
        for plane in [Plane::CEILING, Plane::new(-1.7, [1.98, -0.02]), Plane::new(0.1234, [0.5, -1.9])] {
            let (height, slope) = Plane::single(plane.to_bits());
            assert_eq!((f64::from(height), slope.map(f64::from)), (plane.height(), plane.slope()));
        }
    }

    #[test]
    fn a_plane_is_the_same_after_it_was_a_number() {
        for plane in [Plane::CEILING, Plane::new(-0.7, [1.2, -1.9]), Plane::new(1.99, [-0.3, 0.0])] {
            assert_eq!(Plane::from_bits(plane.to_bits()), plane);
        }
        let cut = Plane::from_bits(u32::from_le_bytes([0, 0x80, 0x80, 0x7f]));
        assert_eq!((cut.height(), cut.slope()), (Plane::LOWEST, [-Plane::STEEPEST, Plane::STEEPEST]));
    }

    #[test]
    fn no_corner_leaves_the_bounds() {
        for (height, slope) in [(1e9, [1e9, -1e9]), (-1e9, [-1e9, 1e9]), (f64::MAX, [f64::MIN, f64::MAX])] {
            let plane = Plane::new(height, slope);
            let highest = 2.0 * plane.height() - plane.lowest_corner();
            assert!(highest <= 1.0 + f64::from(Plane::RISE), "{highest}");
            assert!(plane.lowest_corner() >= -f64::from(Plane::DROP), "{}", plane.lowest_corner());
        }
    }
}
