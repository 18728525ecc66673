//! f64 prior, memory_s, sharp_gsd_m, doubt, agreement, threshold, cleared, focal_px; then the borders and the table of
//! the likelihood ratio, each a u32 count and f32 numbers: gsd_m, tilt_deg, mean, log_ratio; since version 7 of the file
//! f32 how many times as fine the cameras of another table are and that table alike, or 0 for none; since version 8 u8
//! which looks from below count: 0 = those for the class, as before, 1 = those against it. A belief is f32 evidence and
//! three f32 weights.

use std::sync::Arc;

use super::likelihood::MOST_ENTRIES;
use super::{DRONE_WEIGHTS, Evidence, EvidenceSettings, Finer, FromBelow, LikelihoodRatio, LooksSum};
use crate::error::Result;
use crate::method::Stored;
use crate::sealed::{Reader, Writer};

impl Stored for Evidence {
    fn write(&self, payload: &mut Writer) {
        self.settings.numbers().into_iter().for_each(|(_, number)| payload.f64(number));
        self.likelihood.write(payload);
        payload.u8(u8::from(self.settings.from_below == FromBelow::Against));
    }

    fn read(reader: &mut Reader<'_>, version: u32) -> Result<Evidence> {
        let mut settings = EvidenceSettings {
            prior: reader.f64()?,
            memory_s: reader.f64()?,
            sharp_gsd_m: reader.f64()?,
            doubt: reader.f64()?,
            agreement: reader.f64()?,
            threshold: reader.f64()?,
            cleared: reader.f64()?,
            focal_px: reader.f64()?,
            from_below: FromBelow::For,
        };
        let likelihood = LikelihoodRatio::read(reader, version)?;
        if version >= FROM_BELOW_SINCE {
            settings.from_below = reader.choice(&[FromBelow::For, FromBelow::Against])?;
        }
        Evidence::new(Arc::new(likelihood), settings)
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

/// From this version of the file on a map says which looks from below count.
const FROM_BELOW_SINCE: u32 = 8;
/// From this version of the file on tables may have that of finer cameras beside them.
const FINER_SINCE: u32 = 7;

impl LikelihoodRatio {
    pub(in crate::method) fn write(&self, payload: &mut Writer) {
        self.write_table(payload);
        payload.f32(self.finer().map_or(0.0, Finer::times));
        if let Some(finer) = self.finer() {
            finer.table().write_table(payload);
        }
    }

    pub(in crate::method) fn read(reader: &mut Reader<'_>, version: u32) -> Result<LikelihoodRatio> {
        let table = LikelihoodRatio::read_table(reader)?;
        match if version < FINER_SINCE { 0.0 } else { reader.f32()? } {
            0.0 => Ok(table),
            times => table.with_finer(times, LikelihoodRatio::read_table(reader)?),
        }
    }

    fn write_table(&self, payload: &mut Writer) {
        for column in self.columns() {
            payload.u32(column.len() as u32);
            column.iter().for_each(|&number| payload.f32(number));
        }
    }

    fn read_table(reader: &mut Reader<'_>) -> Result<LikelihoodRatio> {
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
