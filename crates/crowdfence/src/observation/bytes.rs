//! An observation as bytes, version 2, in the frame of [`crate::sealed`]; version 1 is read too.
//!
//! ```text
//! terrain          u64 fingerprint, u64 voxel count
//! drone            u32 length, UTF-8 bytes
//! stamp            i64
//! seen             u32 count, then the columns one after the other: u32 ids, f64 mean, u32 pixel count,
//!                  f32 range_m, f32 tilt_deg
//! occluded         u32 count, u32 ids
//! crowd mass       f64 ground, out_of_range, hole, off_map, sky, unusable
//! focal length     f32 pixels, 0 = not known; not in version 1
//! ```

use super::{CrowdMass, Observation, SeenVoxels};
use crate::error::Result;
use crate::sealed::{Kind, Reader, Writer};
use crate::terrain::TerrainKey;

const KIND: Kind = Kind { magic: b"CROWDOBS", name: "observation", version: 2 };

impl Observation {
    /// In the format above, for another machine.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut payload = Writer::default();
        payload.u64(self.terrain.fingerprint);
        payload.u64(self.terrain.voxel_count as u64);
        payload.text(&self.drone);
        payload.i64(self.stamp_ns);
        payload.u32(self.seen.ids.len() as u32);
        self.seen.ids.iter().for_each(|&id| payload.u32(id));
        self.seen.mean.iter().for_each(|&mean| payload.f64(mean));
        self.seen.pixel_count.iter().for_each(|&count| payload.u32(count));
        self.seen.range_m.iter().for_each(|&range_m| payload.f32(range_m));
        self.seen.tilt_deg.iter().for_each(|&tilt_deg| payload.f32(tilt_deg));
        payload.u32(self.occluded_ids.len() as u32);
        self.occluded_ids.iter().for_each(|&id| payload.u32(id));
        self.crowd_mass.by_fate().iter().for_each(|&(_, mass)| payload.f64(mass));
        payload.f32(self.focal_px);
        KIND.seal(payload)
    }

    /// Bytes are checked as any other input is; whether they belong to a certain terrain, the crowd map checks.
    pub fn from_bytes(data: &[u8]) -> Result<Observation> {
        let (version, mut reader) = KIND.open(data)?;
        let fingerprint = reader.u64()?;
        let voxel_count = reader.u64()? as usize;
        let (drone, stamp_ns) = (reader.text()?, reader.i64()?);
        let seen = seen(&mut reader)?;
        let occluded = reader.u32()? as usize;
        let occluded_ids = reader.numbers(occluded, u32::from_le_bytes)?;
        let crowd_mass = crowd_mass(&mut reader)?;
        let focal_px = if version >= 2 { reader.f32()? } else { 0.0 };
        reader.end()?;
        let terrain = TerrainKey { fingerprint, voxel_count };
        Observation::new(terrain, drone, stamp_ns, seen, occluded_ids, crowd_mass)?.with_focal_px(focal_px)
    }
}

fn seen(reader: &mut Reader<'_>) -> Result<SeenVoxels> {
    let count = reader.u32()? as usize;
    Ok(SeenVoxels {
        ids: reader.numbers(count, u32::from_le_bytes)?,
        mean: reader.numbers(count, f64::from_le_bytes)?,
        pixel_count: reader.numbers(count, u32::from_le_bytes)?,
        range_m: reader.numbers(count, f32::from_le_bytes)?,
        tilt_deg: reader.numbers(count, f32::from_le_bytes)?,
    })
}

fn crowd_mass(reader: &mut Reader<'_>) -> Result<CrowdMass> {
    Ok(CrowdMass {
        ground: reader.f64()?,
        out_of_range: reader.f64()?,
        hole: reader.f64()?,
        off_map: reader.f64()?,
        sky: reader.f64()?,
        unusable: reader.f64()?,
    })
}
