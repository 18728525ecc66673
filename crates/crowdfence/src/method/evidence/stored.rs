//! f64 prior, memory_s, sharp_gsd_m, doubt, agreement, threshold, cleared, focal_px; then the borders and the table of
//! the likelihood ratio, each a u32 count and f32 numbers: gsd_m, tilt_deg, mean, log_ratio. A belief is f32
//! evidence and three f32 weights.

use std::sync::Arc;

use super::likelihood::MOST_ENTRIES;
use super::{DRONE_WEIGHTS, Evidence, EvidenceSettings, LikelihoodRatio, LooksSum};
use crate::error::Result;
use crate::method::Stored;
use crate::sealed::{Reader, Writer};

impl Stored for Evidence {
    fn write(&self, payload: &mut Writer) {
        self.settings.named().into_iter().for_each(|(_, number)| payload.f64(number));
        self.likelihood.write(payload);
    }

    fn read(reader: &mut Reader<'_>, _version: u32) -> Result<Evidence> {
        let settings = EvidenceSettings {
            prior: reader.f64()?,
            memory_s: reader.f64()?,
            sharp_gsd_m: reader.f64()?,
            doubt: reader.f64()?,
            agreement: reader.f64()?,
            threshold: reader.f64()?,
            cleared: reader.f64()?,
            focal_px: reader.f64()?,
        };
        Evidence::new(Arc::new(LikelihoodRatio::read(reader)?), settings)
    }

    fn write_belief(sum: LooksSum, payload: &mut Writer) {
        payload.f32(sum.evidence);
        sum.weights.iter().for_each(|&weight| payload.f32(weight));
    }

    fn read_beliefs(reader: &mut Reader<'_>, _version: u32, count: usize) -> Result<Vec<LooksSum>> {
        let numbers = reader.numbers((1 + DRONE_WEIGHTS) * count, f32::from_le_bytes)?;
        let belief = |numbers: &[f32]| {
            let (evidence, weights) = (numbers[0], [numbers[1], numbers[2], numbers[3]]);
            let is_sum =
                evidence.is_finite() && weights.iter().all(|weight| weight.is_finite() && *weight >= 0.0);
            is_sum.then_some(LooksSum { evidence, weights })
        };
        let sums: Option<Vec<LooksSum>> = numbers.chunks_exact(1 + DRONE_WEIGHTS).map(belief).collect();
        sums.ok_or_else(|| reader.damaged("a sum of looks that none add up to"))
    }
}

impl LikelihoodRatio {
    /// The borders and the table, each a u32 count and f32 numbers.
    pub(in crate::method) fn write(&self, payload: &mut Writer) {
        for column in self.columns() {
            payload.u32(column.len() as u32);
            column.iter().for_each(|&number| payload.f32(number));
        }
    }

    pub(in crate::method) fn read(reader: &mut Reader<'_>) -> Result<LikelihoodRatio> {
        let (gsd_m, tilt_deg, mean, log_ratio) =
            (column(reader)?, column(reader)?, column(reader)?, column(reader)?);
        LikelihoodRatio::new(gsd_m, tilt_deg, mean, log_ratio)
    }
}

fn column(reader: &mut Reader<'_>) -> Result<Vec<f32>> {
    let count = reader.u32()? as usize;
    if count > MOST_ENTRIES {
        return Err(reader.damaged("a likelihood table that is too large"));
    }
    reader.numbers(count, f32::from_le_bytes)
}
