//! The lens models with their coefficients.

use super::CameraError;

/// Lens model with its coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// Plain pinhole.
    None,
    /// Radial and tangential distortion of the image plane, as in OpenCV's calibration.
    #[allow(missing_docs)]
    BrownConrady { k1: f64, k2: f64, p1: f64, p2: f64, k3: f64 },
    /// Polynomial in the angle off the axis, as in OpenCV's fisheye module.
    #[allow(missing_docs)]
    KannalaBrandt { k1: f64, k2: f64, k3: f64, k4: f64 },
}

impl Distortion {
    /// Brown-Conrady distortion from (k1, k2, p1, p2) or (k1, k2, p1, p2, k3), OpenCV's order.
    pub fn brown_conrady(coefficients: &[f64]) -> Result<Self, CameraError> {
        match *coefficients {
            [k1, k2, p1, p2] => Ok(Self::BrownConrady { k1, k2, p1, p2, k3: 0.0 }),
            [k1, k2, p1, p2, k3] => Ok(Self::BrownConrady { k1, k2, p1, p2, k3 }),
            _ => Err(CameraError::DistortionLength {
                model: "brown_conrady",
                expected: "4 (k1, k2, p1, p2) or 5 (k1, k2, p1, p2, k3)",
                count: coefficients.len(),
            }),
        }
    }

    /// Kannala-Brandt distortion from (k1, k2, k3, k4).
    pub fn kannala_brandt(coefficients: &[f64]) -> Result<Self, CameraError> {
        match *coefficients {
            [k1, k2, k3, k4] => Ok(Self::KannalaBrandt { k1, k2, k3, k4 }),
            _ => Err(CameraError::DistortionLength {
                model: "kannala_brandt",
                expected: "4 (k1, k2, k3, k4)",
                count: coefficients.len(),
            }),
        }
    }

    /// Name of the lens model: "pinhole", "brown_conrady" or "kannala_brandt".
    pub fn model(&self) -> &'static str {
        match self {
            Self::None => "pinhole",
            Self::BrownConrady { .. } => "brown_conrady",
            Self::KannalaBrandt { .. } => "kannala_brandt",
        }
    }

    /// Coefficients in the order that the constructors take; empty for a plain pinhole.
    pub fn coefficients(&self) -> Vec<f64> {
        self.named_coefficients().into_iter().map(|(_, value)| value).collect()
    }

    pub(super) fn named_coefficients(&self) -> Vec<(&'static str, f64)> {
        match *self {
            Self::None => vec![],
            Self::BrownConrady { k1, k2, p1, p2, k3 } => {
                vec![("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3)]
            }
            Self::KannalaBrandt { k1, k2, k3, k4 } => {
                vec![("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4)]
            }
        }
    }
}
