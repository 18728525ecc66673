use super::CameraError;

/// Lens model with its coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Distortion {
    /// A plain pinhole.
    None,
    /// Radial (k1, k2, k3) and tangential (p1, p2) distortion of the image plane, as in OpenCV's calibration.
    #[allow(missing_docs)]
    BrownConrady { k1: f64, k2: f64, p1: f64, p2: f64, k3: f64 },
    /// Polynomial in the angle off the axis, as in OpenCV's fisheye module.
    #[allow(missing_docs)]
    KannalaBrandt { k1: f64, k2: f64, k3: f64, k4: f64 },
}

impl Distortion {
    /// From (k1, k2, p1, p2) or (k1, k2, p1, p2, k3), OpenCV's order.
    pub fn brown_conrady(coefficients: &[f64]) -> Result<Distortion, CameraError> {
        match *coefficients {
            [k1, k2, p1, p2] => Ok(Distortion::BrownConrady { k1, k2, p1, p2, k3: 0.0 }),
            [k1, k2, p1, p2, k3] => Ok(Distortion::BrownConrady { k1, k2, p1, p2, k3 }),
            _ => Err(CameraError::DistortionLength {
                model: "brown_conrady",
                expected: "4 (k1, k2, p1, p2) or 5 (k1, k2, p1, p2, k3)",
                count: coefficients.len(),
            }),
        }
    }

    /// From (k1, k2, k3, k4).
    pub fn kannala_brandt(coefficients: &[f64]) -> Result<Distortion, CameraError> {
        match *coefficients {
            [k1, k2, k3, k4] => Ok(Distortion::KannalaBrandt { k1, k2, k3, k4 }),
            _ => Err(CameraError::DistortionLength {
                model: "kannala_brandt",
                expected: "4 (k1, k2, k3, k4)",
                count: coefficients.len(),
            }),
        }
    }

    /// "pinhole", "brown_conrady" or "kannala_brandt".
    pub fn model(&self) -> &'static str {
        match self {
            Distortion::None => "pinhole",
            Distortion::BrownConrady { .. } => "brown_conrady",
            Distortion::KannalaBrandt { .. } => "kannala_brandt",
        }
    }

    /// In the order that the constructors take; empty for a plain pinhole.
    pub fn coefficients(&self) -> Vec<f64> {
        self.named_coefficients().into_iter().map(|(_, value)| value).collect()
    }

    pub(super) fn named_coefficients(&self) -> Vec<(&'static str, f64)> {
        match *self {
            Distortion::None => vec![],
            Distortion::BrownConrady { k1, k2, p1, p2, k3 } => {
                vec![("k1", k1), ("k2", k2), ("p1", p1), ("p2", p2), ("k3", k3)]
            }
            Distortion::KannalaBrandt { k1, k2, k3, k4 } => {
                vec![("k1", k1), ("k2", k2), ("k3", k3), ("k4", k4)]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coefficients_keep_their_order() {
        let brown = [0.1, 0.2, 0.3, 0.4, 0.5];
        assert_eq!(Distortion::brown_conrady(&brown).unwrap().coefficients(), brown);
        assert_eq!(Distortion::brown_conrady(&brown[..4]).unwrap().coefficients(), [0.1, 0.2, 0.3, 0.4, 0.0]);
        assert_eq!(Distortion::kannala_brandt(&brown[..4]).unwrap().coefficients(), brown[..4]);
        for count in [0, 3, 8] {
            let error = Distortion::brown_conrady(&vec![0.0; count]).unwrap_err().to_string();
            assert!(error.starts_with(&format!("{count} distortion coefficients")), "{error}");
        }
        assert!(Distortion::kannala_brandt(&brown).is_err());
    }
}
