//! Kannala-Brandt distortion: the distance from the image centre is a polynomial of the angle off the axis.
//!
//! Source: J. Kannala and S. Brandt, "A generic camera model and calibration method for conventional,
//! wide-angle, and fish-eye lenses", IEEE TPAMI 28(8), 2006, in the form of OpenCV's fisheye module:
//!
//! theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
//!
//! Directions beyond 90 degrees are images like any other. The lens sees up to the angle where the polynomial
//! turns back, and never the direction straight behind it, which has no place in the image.

use std::f64::consts::PI;

use glam::{DVec2, DVec3};

use super::radial::{RadialPolynomial, first_root};

#[derive(Debug, Clone, PartialEq)]
pub(super) struct KannalaBrandt {
    radial: RadialPolynomial<4>,
    /// Angle off the axis, in radians, at which the field of view ends.
    field_angle: f64,
}

impl KannalaBrandt {
    pub fn new(k1: f64, k2: f64, k3: f64, k4: f64) -> KannalaBrandt {
        let radial = RadialPolynomial::new([k1, k2, k3, k4]);
        let field_angle = first_root(&radial.slope_coefficients(), PI);
        KannalaBrandt { radial, field_angle }
    }

    /// Distorted image of a direction of any finite length that is not zero; None outside the field of view.
    pub fn distort(&self, direction: DVec3) -> Option<DVec2> {
        // Brought to length about one, so that neither tiny nor huge coordinates lose their ratio.
        let direction = direction / direction.abs().max_element();
        let off_axis = direction.truncate();
        let sine = off_axis.length();
        let angle = sine.atan2(direction.z);
        // Close to the axis the angle and its sine are proportional; their quotient would be 0 / 0 on it.
        let angle_per_sine = if sine > 0.0 { angle / sine } else { 1.0 };
        let scale = angle_per_sine * self.radial.magnification(angle * angle);
        (angle < self.field_angle).then(|| off_axis * scale)
    }

    /// Unit direction that the lens images at `distorted`; None if there is none in the field of view.
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec3> {
        let distorted_angle = distorted.length();
        let angle = self.radial.invert(distorted_angle, self.field_angle)?;
        let (sine, cosine) = angle.sin_cos();
        let scale = if distorted_angle > 0.0 { sine / distorted_angle } else { 1.0 };
        Some((distorted * scale).extend(cosine))
    }
}
