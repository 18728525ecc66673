//! Intrinsics and distortion of one camera: pixel <-> ray.
//!
//! Camera axes are those of OpenCV: x right, y down, z forward. Pixel coordinates are continuous: the image covers
//! [0, width) x [0, height) and the centre of pixel (column i, row j) is (i + 0.5, j + 0.5). Calibrations that put
//! the centre of the first pixel at (0, 0), as OpenCV and ROS do, need 0.5 added to cx and cy.
//!
//! A lens model is trusted only inside its field of view, the region around the axis where it is one-to-one.
//! Directions from outside have no pixel and pixels from outside have no ray: a wrong ray would mark the wrong
//! ground as seen.

mod brown_conrady;
mod distortion;
mod error;
mod kannala_brandt;
mod radial;
#[cfg(test)]
mod tests;

use std::ops::RangeInclusive;

use glam::{DVec2, DVec3};
use rayon::prelude::*;

pub use distortion::Distortion;
pub use error::CameraError;

use brown_conrady::BrownConrady;
use kannala_brandt::KannalaBrandt;

/// Most pixels along one side of an image.
pub const MAX_IMAGE_SIDE: u32 = 65_535;
/// Most pixels in an image; ten times the largest aerial cameras.
pub const MAX_IMAGE_PIXELS: u64 = 1 << 28;
/// Focal lengths that a camera may have, in pixels.
pub const FOCAL_LENGTH_PX: RangeInclusive<f64> = 1e-3..=1e7;
/// Largest distance of the principal point from the image's corner along each axis, in pixels.
pub const MAX_PRINCIPAL_POINT_PX: f64 = 1e7;
/// Largest magnitude of a distortion coefficient.
pub const MAX_DISTORTION_COEFFICIENT: f64 = 1e9;

/// Intrinsics of one camera.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    width: u32,
    height: u32,
    focal_px: DVec2,
    principal_px: DVec2,
    distortion: Distortion,
    lens: Lens,
}

/// The distortion with what is worked out once per camera.
#[derive(Debug, Clone, PartialEq)]
enum Lens {
    Pinhole,
    BrownConrady(BrownConrady),
    KannalaBrandt(KannalaBrandt),
}

impl From<Distortion> for Lens {
    fn from(distortion: Distortion) -> Self {
        match distortion {
            Distortion::None => Self::Pinhole,
            Distortion::BrownConrady { k1, k2, p1, p2, k3 } => {
                Self::BrownConrady(BrownConrady::new(k1, k2, p1, p2, k3))
            }
            Distortion::KannalaBrandt { k1, k2, k3, k4 } => {
                Self::KannalaBrandt(KannalaBrandt::new(k1, k2, k3, k4))
            }
        }
    }
}

impl Camera {
    /// Camera with an image of `width` x `height` pixels, focal lengths and principal point in pixels.
    ///
    /// # Errors
    /// The image is empty or too large, a focal length is not positive, or a parameter is not finite or absurd.
    pub fn new(
        width: u32,
        height: u32,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        distortion: Distortion,
    ) -> Result<Self, CameraError> {
        check_image(width, height)?;
        for (name, value) in [("fx", fx), ("fy", fy)] {
            if !FOCAL_LENGTH_PX.contains(&value) {
                return Err(CameraError::FocalLength { name, value });
            }
        }
        for (name, value) in [("cx", cx), ("cy", cy)] {
            if !is_within(value, MAX_PRINCIPAL_POINT_PX) {
                return Err(CameraError::PrincipalPoint { name, value });
            }
        }
        for (name, value) in distortion.named_coefficients() {
            if !is_within(value, MAX_DISTORTION_COEFFICIENT) {
                return Err(CameraError::DistortionCoefficient { name, value });
            }
        }
        let (focal_px, principal_px) = (DVec2::new(fx, fy), DVec2::new(cx, cy));
        Ok(Self { width, height, focal_px, principal_px, distortion, lens: distortion.into() })
    }

    /// Image width in pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Image height in pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Focal length along a row, in pixels.
    pub fn fx(&self) -> f64 {
        self.focal_px.x
    }

    /// Focal length along a column, in pixels.
    pub fn fy(&self) -> f64 {
        self.focal_px.y
    }

    /// Column coordinate of the principal point.
    pub fn cx(&self) -> f64 {
        self.principal_px.x
    }

    /// Row coordinate of the principal point.
    pub fn cy(&self) -> f64 {
        self.principal_px.y
    }

    /// Lens model with its coefficients.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// Pixel that a point in camera axes is imaged at; it may lie outside the image, see [`Camera::contains`].
    ///
    /// None if the camera cannot see in that direction: behind a pinhole, or outside the field of view in which the
    /// lens model is one-to-one. A point that is not finite is not seen either.
    pub fn project(&self, point_camera: DVec3) -> Option<DVec2> {
        if !point_camera.is_finite() {
            return None;
        }
        let image = match &self.lens {
            Lens::Pinhole => perspective(point_camera),
            Lens::BrownConrady(lens) => perspective(point_camera).and_then(|point| lens.distort(point)),
            Lens::KannalaBrandt(lens) => lens.distort(point_camera),
        };
        let pixel = image? * self.focal_px + self.principal_px;
        pixel.is_finite().then_some(pixel)
    }

    /// Unit ray, in camera axes, through a pixel; the inverse of [`Camera::project`].
    ///
    /// # Errors
    /// The pixel is not finite, or no direction in the field of view is imaged there.
    pub fn unproject(&self, pixel: DVec2) -> Result<DVec3, CameraError> {
        let DVec2 { x: u, y: v } = pixel;
        if !pixel.is_finite() {
            return Err(CameraError::PixelNotFinite { u, v });
        }
        self.ray(pixel).ok_or(CameraError::NotInvertible { u, v })
    }

    /// Unit ray, in camera axes, through the centre of a pixel; None if the distortion cannot be inverted there.
    pub fn pixel_ray(&self, column: u32, row: u32) -> Option<DVec3> {
        self.ray(DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5))
    }

    /// [`Camera::pixel_ray`] of every pixel, row after row from the top left.
    ///
    /// Takes 32 bytes a pixel and, with distortion, some Newton steps: worth keeping while the camera stays the same.
    pub fn pixel_rays(&self) -> Vec<Option<DVec3>> {
        self.pixels().map(|(column, row)| self.pixel_ray(column, row)).collect()
    }

    /// How many pixels have no ray through their centre because the distortion cannot be inverted there.
    pub fn blind_pixel_count(&self) -> usize {
        match self.lens {
            Lens::Pinhole => 0,
            _ => self.pixels().filter(|&(column, row)| self.pixel_ray(column, row).is_none()).count(),
        }
    }

    /// Whether the image [0, width) x [0, height) holds this pixel coordinate.
    pub fn contains(&self, pixel: DVec2) -> bool {
        let inside = |coordinate, side| (0.0..f64::from(side)).contains(&coordinate);
        inside(pixel.x, self.width) && inside(pixel.y, self.height)
    }

    fn ray(&self, pixel: DVec2) -> Option<DVec3> {
        let image = (pixel - self.principal_px) / self.focal_px;
        let ray = match &self.lens {
            Lens::Pinhole => image.extend(1.0),
            Lens::BrownConrady(lens) => lens.undistort(image)?.extend(1.0),
            Lens::KannalaBrandt(lens) => lens.undistort(image)?,
        };
        ray.try_normalize()
    }

    /// (column, row) of every pixel, row-major, in parallel.
    fn pixels(&self) -> impl IndexedParallelIterator<Item = (u32, u32)> {
        let width = self.width;
        // The constructor bounds the number of pixels far below what u32 holds.
        (0..width * self.height).into_par_iter().map(move |index| (index % width, index / width))
    }
}

fn perspective(point_camera: DVec3) -> Option<DVec2> {
    (point_camera.z > 0.0).then(|| point_camera.truncate() / point_camera.z)
}

fn check_image(width: u32, height: u32) -> Result<(), CameraError> {
    if width == 0 || height == 0 {
        return Err(CameraError::EmptyImage { width, height });
    }
    let pixels = u64::from(width) * u64::from(height);
    if width.max(height) > MAX_IMAGE_SIDE || pixels > MAX_IMAGE_PIXELS {
        return Err(CameraError::ImageTooLarge { width, height });
    }
    Ok(())
}

/// False for NaN.
fn is_within(value: f64, bound: f64) -> bool {
    value.abs() <= bound
}
