//! What one look says of crowd by the detector's calibration, for the methods that `evidence` is compared with.

use std::sync::Arc;

use super::{LikelihoodRatio, VoxelLook};
use crate::error::{Result, require};
use crate::sealed::{Reader, Writer};

/// How strongly a look speaks for crowd, and how much crowd there is anyway.
#[derive(Debug, Clone, PartialEq)]
pub struct Calibration {
    likelihood: Arc<LikelihoodRatio>,
    prior: f64,
    focal_px: f64,
}

impl Calibration {
    /// `prior` = P(A = 1) where nobody has looked, strictly between 0 and 1; `focal_px` of the cameras of the
    /// calibration, > 0: taken for a view that does not say its own.
    pub fn new(likelihood: Arc<LikelihoodRatio>, prior: f64, focal_px: f64) -> Result<Calibration> {
        require(prior > 0.0 && prior < 1.0, "prior", prior, "strictly between 0 and 1")?;
        require(focal_px.is_finite() && focal_px > 0.0, "focal_px", focal_px, "finite and > 0")?;
        Ok(Calibration { likelihood, prior, focal_px })
    }

    /// The table of likelihood ratios.
    pub fn likelihood(&self) -> &Arc<LikelihoodRatio> {
        &self.likelihood
    }

    /// P(A = 1) where nobody has looked.
    pub fn prior(&self) -> f64 {
        self.prior
    }

    /// Focal length of the cameras of the calibration, pixels.
    pub fn focal_px(&self) -> f64 {
        self.focal_px
    }

    /// l: ln P(m | crowd) / P(m | no crowd).
    pub fn log_ratio(&self, look: &VoxelLook) -> f64 {
        f64::from(self.likelihood.of_look(look, self.focal_px as f32).0)
    }

    /// The probability that lies `log_ratio` above the prior in log odds.
    pub fn posterior(&self, log_ratio: f64) -> f64 {
        1.0 / (1.0 + (1.0 - self.prior) / self.prior * (-log_ratio).exp())
    }

    /// f64 prior, focal_px; the table of the likelihood ratio.
    pub(super) fn write(&self, payload: &mut Writer) {
        payload.f64(self.prior);
        payload.f64(self.focal_px);
        self.likelihood.write(payload);
    }

    pub(super) fn read(reader: &mut Reader<'_>, version: u32) -> Result<Calibration> {
        let (prior, focal_px) = (reader.f64()?, reader.f64()?);
        Calibration::new(Arc::new(LikelihoodRatio::read(reader, version)?), prior, focal_px)
    }
}
