//! Intrinsics and distortion of one camera: pixel <-> ray.
//!
//! Camera axes are those of OpenCV: x right, y down, z forward. Pixel coordinates are continuous: the image
//! covers [0, width) x [0, height) and the centre of pixel (column i, row j) is (i + 0.5, j + 0.5).
//! Calibrations that put the centre of the first pixel at (0, 0), as OpenCV and ROS do, need 0.5 added to cx
//! and cy.
//!
//! A lens model is trusted only inside its field of view, the region around the axis where it is one-to-one.
//! Directions from outside have no pixel and pixels from outside have no ray: a wrong ray would mark the
//! wrong ground as seen.

mod brown_conrady;
mod distortion;
mod error;
mod ideal_pixels;
mod kannala_brandt;
mod radial;
#[cfg(test)]
mod tests;

use std::ops::RangeInclusive;
use std::sync::{Arc, OnceLock};

use glam::{DVec2, DVec3};
use rayon::prelude::*;

pub use distortion::Distortion;
pub use error::CameraError;
pub use ideal_pixels::IdealPixels;

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

/// A calibrated camera: image size, pinhole intrinsics, lens distortion. Checked when it is made.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    width: u32,
    height: u32,
    focal_px: DVec2,
    principal_px: DVec2,
    distortion: Distortion,
    lens: Lens,
    ideal_pixels: Kept<Option<Arc<IdealPixels>>>,
}

/// What is worked out when it is first asked for; equal to any other, as it follows from the rest.
#[derive(Debug, Clone, Default)]
struct Kept<T>(OnceLock<T>);

impl<T> PartialEq for Kept<T> {
    fn eq(&self, _: &Kept<T>) -> bool {
        true
    }
}

/// The distortion with what is worked out once per camera.
#[derive(Debug, Clone, PartialEq)]
enum Lens {
    Pinhole,
    BrownConrady(BrownConrady),
    KannalaBrandt(KannalaBrandt),
}

impl Lens {
    fn new(distortion: Distortion) -> Lens {
        match distortion {
            Distortion::None => Lens::Pinhole,
            Distortion::BrownConrady { k1, k2, p1, p2, k3 } => {
                Lens::BrownConrady(BrownConrady::new(k1, k2, p1, p2, k3))
            }
            Distortion::KannalaBrandt { k1, k2, k3, k4 } => {
                Lens::KannalaBrandt(KannalaBrandt::new(k1, k2, k3, k4))
            }
        }
    }
}

impl Camera {
    /// Image size, focal lengths and principal point in pixels.
    pub fn new(
        width: u32,
        height: u32,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        distortion: Distortion,
    ) -> Result<Camera, CameraError> {
        check_image(width, height)?;
        for (name, value) in [("fx", fx), ("fy", fy)] {
            let error = CameraError::FocalLength { name, value };
            require(FOCAL_LENGTH_PX.contains(&value), error)?;
        }
        for (name, value) in [("cx", cx), ("cy", cy)] {
            let error = CameraError::PrincipalPoint { name, value };
            require(value.abs() <= MAX_PRINCIPAL_POINT_PX, error)?;
        }
        for (name, value) in distortion.named_coefficients() {
            let error = CameraError::DistortionCoefficient { name, value };
            require(value.abs() <= MAX_DISTORTION_COEFFICIENT, error)?;
        }
        Ok(Camera {
            width,
            height,
            focal_px: DVec2::new(fx, fy),
            principal_px: DVec2::new(cx, cy),
            distortion,
            lens: Lens::new(distortion),
            ideal_pixels: Kept::default(),
        })
    }

    /// Pixels along a row of the image.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Rows of the image.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// Focal length along rows, pixels.
    pub fn fx(&self) -> f64 {
        self.focal_px.x
    }

    /// Focal length along columns, pixels.
    pub fn fy(&self) -> f64 {
        self.focal_px.y
    }

    /// Principal point, pixels from the left edge of the image.
    pub fn cx(&self) -> f64 {
        self.principal_px.x
    }

    /// Principal point, pixels from the upper edge of the image.
    pub fn cy(&self) -> f64 {
        self.principal_px.y
    }

    /// The lens model.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// Where a pinhole of the same intrinsics sees what the pixels see: None where it cannot, as they look too far
    /// aside. Takes as long as [`Camera::pixel_rays`] the first time.
    pub fn ideal_pixels(&self) -> Option<&IdealPixels> {
        self.ideal_pixels.0.get_or_init(|| IdealPixels::of(self).map(Arc::new)).as_deref()
    }

    /// Pixel at which a point in camera axes is imaged, perhaps outside the image, see [`Camera::contains`].
    /// None where the camera cannot see: behind a pinhole, outside the field of view in which the lens model
    /// is one-to-one, or at a point that is not finite.
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

    /// Pixel that sees what a pinhole of the same intrinsics sees at a pixel of its own.
    pub fn pixel_of_ideal(&self, pixel: DVec2) -> Option<DVec2> {
        self.project(((pixel - self.principal_px) / self.focal_px).extend(1.0))
    }

    /// Unit ray, in camera axes, through a pixel; the inverse of [`Camera::project`].
    pub fn unproject(&self, pixel: DVec2) -> Result<DVec3, CameraError> {
        let DVec2 { x: u, y: v } = pixel;
        require(pixel.is_finite(), CameraError::PixelNotFinite { u, v })?;
        self.ray(pixel).ok_or(CameraError::NotInvertible { u, v })
    }

    /// Unit ray, in camera axes, through the centre of a pixel; None where the distortion cannot be inverted.
    pub fn pixel_ray(&self, column: u32, row: u32) -> Option<DVec3> {
        self.ray(DVec2::new(f64::from(column) + 0.5, f64::from(row) + 0.5))
    }

    /// [`Camera::pixel_ray`] of every pixel, row after row from the top left. Takes 32 bytes a pixel and,
    /// with distortion, some Newton steps: worth keeping while the camera stays the same.
    pub fn pixel_rays(&self) -> Vec<Option<DVec3>> {
        self.pixels().map(|(column, row)| self.pixel_ray(column, row)).collect()
    }

    /// Pixels without a ray through their centre, because the distortion cannot be inverted there.
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
    require(width > 0 && height > 0, CameraError::EmptyImage { width, height })?;
    let pixels = u64::from(width) * u64::from(height);
    let fits = width.max(height) <= MAX_IMAGE_SIDE && pixels <= MAX_IMAGE_PIXELS;
    require(fits, CameraError::ImageTooLarge { width, height })
}

/// Refuses what does not satisfy its bound (NaN satisfies none).
fn require(ok: bool, error: CameraError) -> Result<(), CameraError> {
    if ok { Ok(()) } else { Err(error) }
}
