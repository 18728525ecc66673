use thiserror::Error;

use super::{
    FOCAL_LENGTH_PX, MAX_DISTORTION_COEFFICIENT, MAX_IMAGE_PIXELS, MAX_IMAGE_SIDE, MAX_PRINCIPAL_POINT_PX,
};
use crate::error::short;

/// Why a camera cannot be made, or cannot answer. The message of a variant is its documentation.
#[allow(missing_docs)]
#[derive(Debug, Clone, PartialEq, Error)]
pub enum CameraError {
    #[error("image is {width} x {height} pixels: width and height must be at least 1")]
    EmptyImage { width: u32, height: u32 },
    #[error(
        "image is {width} x {height} pixels: at most {MAX_IMAGE_SIDE} along a side and {MAX_IMAGE_PIXELS} in all"
    )]
    ImageTooLarge { width: u32, height: u32 },
    #[error(
        "focal length {name} is {} pixels: it must be positive, between {} and {}",
        short(*value),
        FOCAL_LENGTH_PX.start(),
        FOCAL_LENGTH_PX.end()
    )]
    FocalLength { name: &'static str, value: f64 },
    #[error(
        "principal point {name} is {} pixels: it must be finite and at most {MAX_PRINCIPAL_POINT_PX} from 0",
        short(*value)
    )]
    PrincipalPoint { name: &'static str, value: f64 },
    #[error(
        "distortion coefficient {name} is {}: it must be finite and at most {MAX_DISTORTION_COEFFICIENT} from 0",
        short(*value)
    )]
    DistortionCoefficient { name: &'static str, value: f64 },
    #[error("{count} distortion coefficients: {model} takes {expected}")]
    DistortionLength { model: &'static str, expected: &'static str, count: usize },
    #[error("pixel ({u}, {v}) is not finite")]
    PixelNotFinite { u: f64, v: f64 },
    #[error(
        "no ray through pixel ({}, {}): the distortion cannot be inverted there; check the calibration or crop the image",
        short(*u), short(*v)
    )]
    NotInvertible { u: f64, v: f64 },
}
