//! Brown-Conrady ("radtan", "plumb_bob") distortion of the normalised image plane x = X / Z, y = Y / Z.
//!
//! Source: D. C. Brown, "Close-range camera calibration", Photogrammetric Engineering 37(8), 1971, in the
//! form and order of OpenCV's calibration (k1, k2, p1, p2, k3):
//!
//! x_d = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2)
//! y_d = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y
//!
//! The model is only meaningful near the axis: farther out the polynomial turns back, and directions from
//! outside the field of view would land inside the image. The distortion is the gradient of a potential, so
//! its Jacobian is symmetric, and on a disc where the Jacobian is positive definite the potential is strictly
//! convex and the distortion one-to-one. The lens therefore sees the disc on which that is certain, and
//! nothing beyond.

use glam::{DMat2, DVec2};

use super::radial::{RadialPolynomial, first_root};

/// The field of view ends here at the latest: 0.2 arc seconds from 90 degrees off the axis.
const MAX_RADIUS: f64 = 1e6;

/// Residual, per unit of the distorted radius plus one, below which Newton's method stops.
const CONVERGED: f64 = 1e-15;

/// Residual above which a point is no solution; a millionth of a pixel at a focal length of ten million.
const ACCEPTED: f64 = 1e-13;

const MAX_STEPS: usize = 50;
const MAX_HALVINGS: i32 = 20;

#[derive(Debug, Clone, PartialEq)]
pub(super) struct BrownConrady {
    radial: RadialPolynomial<3>,
    /// Gradient of the tangential potential (p . x) |x|^2, that is (p2, p1).
    tangential: DVec2,
    /// Radius of the disc of undistorted points that the lens sees.
    field_radius: f64,
}

impl BrownConrady {
    pub fn new(k1: f64, k2: f64, p1: f64, p2: f64, k3: f64) -> BrownConrady {
        let radial = RadialPolynomial::new([k1, k2, k3]);
        let tangential = DVec2::new(p2, p1);
        // The radial part stretches by its slope along the radius and by its magnification across it; at
        // radius r the tangential part takes at most 6 |p| r away from either (smallest eigenvalue of its
        // Jacobian).
        let field_radius = [radial.slope_coefficients(), radial.magnification_coefficients()]
            .into_iter()
            .map(|mut stretch| {
                stretch[1] -= 6.0 * tangential.length();
                first_root(&stretch, MAX_RADIUS)
            })
            .fold(MAX_RADIUS, f64::min);
        BrownConrady { radial, tangential, field_radius }
    }

    /// Distorted image of a normalised point; None outside the field of view.
    pub fn distort(&self, point: DVec2) -> Option<DVec2> {
        self.sees(point).then(|| self.displaced(point))
    }

    /// The one point of the field of view that the lens images at `distorted`; None if there is none.
    pub fn undistort(&self, distorted: DVec2) -> Option<DVec2> {
        let start = self.undistort_radial(distorted);
        if self.tangential == DVec2::ZERO {
            return start;
        }
        self.refine(start.unwrap_or(DVec2::ZERO), distorted)
    }

    fn sees(&self, point: DVec2) -> bool {
        point.length() < self.field_radius
    }

    fn undistort_radial(&self, distorted: DVec2) -> Option<DVec2> {
        let distorted_radius = distorted.length();
        let radius = self.radial.invert(distorted_radius, self.field_radius)?;
        let scale = if distorted_radius > 0.0 { radius / distorted_radius } else { 1.0 };
        Some(distorted * scale)
    }

    /// Newton's method on both coordinates. Steps that leave the field of view or end farther from the target
    /// are halved, so that every accepted point stays on the branch that holds the axis.
    fn refine(&self, start: DVec2, distorted: DVec2) -> Option<DVec2> {
        let scale = 1.0 + distorted.length();
        let mut point = start;
        let mut residual = self.displaced(point) - distorted;
        for _ in 0..MAX_STEPS {
            if residual.length() <= CONVERGED * scale {
                break;
            }
            let step = self.jacobian(point).inverse() * residual;
            let fractions = (0..MAX_HALVINGS).map(|halvings| 0.5_f64.powi(halvings));
            let closer = fractions.map(|fraction| point - step * fraction).find_map(|candidate| {
                let next = self.displaced(candidate) - distorted;
                let better = self.sees(candidate) && next.length() < residual.length();
                better.then_some((candidate, next))
            });
            match closer {
                Some(next) => (point, residual) = next,
                None => break,
            }
        }
        (residual.length() <= ACCEPTED * scale).then_some(point)
    }

    fn displaced(&self, point: DVec2) -> DVec2 {
        let r_squared = point.length_squared();
        let radial = point * self.radial.magnification(r_squared);
        radial + self.tangential * r_squared + 2.0 * self.tangential.dot(point) * point
    }

    /// Symmetric, because the displacement is the gradient of a potential.
    fn jacobian(&self, point: DVec2) -> DMat2 {
        let r_squared = point.length_squared();
        let (p, slope) = (self.tangential, self.radial.magnification_slope(r_squared));
        let across = self.radial.magnification(r_squared) + 2.0 * p.dot(point);
        let outer = |a: DVec2, b: DVec2| DMat2::from_cols(a * b.x, a * b.y);
        DMat2::IDENTITY * across
            + outer(point, point) * (2.0 * slope)
            + (outer(p, point) + outer(point, p)) * 2.0
    }
}
