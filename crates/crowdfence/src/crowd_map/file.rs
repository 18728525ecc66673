//! The crowd map's file format, version 1. All numbers are little-endian.
//!
//! ```text
//! magic            8 bytes  "CROWDMAP"
//! version          u32
//! payload length   u64
//! payload          (below)
//! checksum         u32      CRC-32 of everything before it
//!
//! payload:
//!   terrain        u64 fingerprint, u64 voxel count
//!   method         u8 0 = paper: f64 true_positive, false_positive, prior, b_threshold; u8 unseen (0 fleet,
//!                  1 visible); u8 normalise; f64 alpha, decay; u64 fleet size; u8 initial (0 zero, 1 prior,
//!                  2 first look); u8 decay unit (0 second, 1 frame)
//!                  u8 1 = or: u64 fleet size, f64 b_threshold
//!   projection     f64 max_range_m, target_height_m; u8 coverage (0 rays, 1 full)
//!   max_gap_s      f64
//!   drones         u32 count, then per drone: u32 length, UTF-8 bytes
//!   instants       u32 count, then i64 stamps, strictly increasing
//!   pages          u32 count, then per page: u32 number (increasing), 1024 x f64 P~, 1024 x u32 look
//!                  (instant, 2^32 - 2 occluded, 2^32 - 1 never)
//! ```

use std::collections::BTreeSet;
use std::sync::Arc;

use crate::back_projection::{Coverage, Projection};
use crate::error::{Error, Result};
use crate::opinion_pool::{OpinionPool, Rates, Unseen};
use crate::temporal_blend::TemporalBlend;
use crate::terrain::Terrain;

use super::CrowdMap;
use super::belief::{BeliefStore, Look, PAGE_VOXELS};
use super::method::{Decay, Initial, Method, Or, Paper};

const MAGIC: &[u8; 8] = b"CROWDMAP";
const VERSION: u32 = 1;
/// Magic, version and payload length.
const HEAD_BYTES: usize = 8 + 4 + 8;

impl CrowdMap {
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut payload = Writer::default();
        payload.u64(self.terrain.fingerprint());
        payload.u64(self.terrain.voxel_count() as u64);
        payload.method(&self.method);
        payload.projection(&self.projection);
        payload.f64(self.max_gap_s);
        payload.u32(self.drones.len() as u32);
        for drone in &self.drones {
            payload.u32(drone.len() as u32);
            payload.0.extend(drone.as_bytes());
        }
        payload.u32(self.stamps_ns.len() as u32);
        for &stamp_ns in &self.stamps_ns {
            payload.0.extend(stamp_ns.to_le_bytes());
        }
        payload.beliefs(&self.beliefs);

        let mut file = Writer::default();
        file.0.extend(MAGIC);
        file.u32(VERSION);
        file.u64(payload.0.len() as u64);
        file.0.extend(payload.0);
        let checksum = crc32fast::hash(&file.0);
        file.u32(checksum);
        file.0
    }

    pub fn from_bytes(data: &[u8], terrain: Arc<Terrain>) -> Result<CrowdMap> {
        let mut reader = Reader { data: payload(data)?, at: 0 };
        let fingerprint = reader.u64()?;
        let voxel_count = reader.u64()?;
        if fingerprint != terrain.fingerprint() || voxel_count != terrain.voxel_count() as u64 {
            return Err(Error::OtherTerrain { found: fingerprint, expected: terrain.fingerprint() });
        }
        let method = reader.method()?;
        let projection = reader.projection()?;
        let max_gap_s = reader.f64()?;
        let mut map = CrowdMap::new(terrain, method, projection, max_gap_s)?;
        map.drones = reader.drones(method.fleet_size())?;
        map.stamps_ns = reader.stamps()?;
        reader.beliefs(&mut map)?;
        if reader.at != reader.data.len() {
            return Err(reader.damaged("bytes after the last page"));
        }
        Ok(map)
    }
}

/// Checks the frame around the payload.
fn payload(data: &[u8]) -> Result<&[u8]> {
    if data.len() < HEAD_BYTES + 4 {
        return Err(Error::NotACrowdMap { what: "the file is too short" });
    }
    if &data[..8] != MAGIC {
        return Err(Error::NotACrowdMap { what: "it does not begin with CROWDMAP" });
    }
    let version = u32::from_le_bytes(data[8..12].try_into().expect("4 bytes"));
    if version != VERSION {
        return Err(Error::CrowdMapVersion { version, supported: VERSION });
    }
    let length = u64::from_le_bytes(data[12..HEAD_BYTES].try_into().expect("8 bytes"));
    let body = data.len() - HEAD_BYTES - 4;
    if length != body as u64 {
        return Err(Error::DamagedCrowdMap {
            offset: data.len(),
            what: "the file is shorter or longer than its header says",
        });
    }
    let (content, checksum) = data.split_at(data.len() - 4);
    if crc32fast::hash(content).to_le_bytes() != checksum {
        return Err(Error::DamagedCrowdMap { offset: data.len() - 4, what: "the checksum does not match" });
    }
    Ok(&content[HEAD_BYTES..])
}

#[derive(Default)]
struct Writer(Vec<u8>);

impl Writer {
    fn u8(&mut self, value: u8) {
        self.0.push(value);
    }

    fn u32(&mut self, value: u32) {
        self.0.extend(value.to_le_bytes());
    }

    fn u64(&mut self, value: u64) {
        self.0.extend(value.to_le_bytes());
    }

    fn f64(&mut self, value: f64) {
        self.0.extend(value.to_le_bytes());
    }

    fn method(&mut self, method: &Method) {
        match method {
            Method::Paper(paper) => {
                self.u8(0);
                let rates = paper.pool.rates();
                self.f64(rates.true_positive());
                self.f64(rates.false_positive());
                self.f64(paper.pool.prior());
                self.f64(paper.pool.b_threshold());
                self.u8(u8::from(paper.pool.unseen() == Unseen::Visible));
                self.u8(u8::from(paper.pool.normalise()));
                self.f64(paper.blend.alpha());
                self.f64(paper.blend.decay());
                self.u64(paper.fleet_size as u64);
                self.u8(match paper.initial {
                    Initial::Zero => 0,
                    Initial::Prior => 1,
                    Initial::FirstLook => 2,
                });
                self.u8(u8::from(paper.decay == Decay::PerFrame));
            }
            Method::Or(or) => {
                self.u8(1);
                self.u64(or.fleet_size() as u64);
                self.f64(or.b_threshold());
            }
        }
    }

    fn projection(&mut self, projection: &Projection) {
        self.f64(projection.max_range_m());
        self.f64(projection.target_height_m());
        self.u8(u8::from(projection.coverage() == Coverage::Full));
    }

    fn beliefs(&mut self, beliefs: &BeliefStore) {
        self.u32(beliefs.pages().iter().flatten().count() as u32);
        for (number, page) in beliefs.pages().iter().enumerate() {
            let Some(page) = page else { continue };
            self.u32(number as u32);
            page.probability.iter().for_each(|&p| self.f64(p));
            page.look.iter().for_each(|&look| self.u32(look));
        }
    }
}

struct Reader<'a> {
    data: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn damaged(&self, what: &'static str) -> Error {
        Error::DamagedCrowdMap { offset: HEAD_BYTES + self.at, what }
    }

    fn take(&mut self, count: usize) -> Result<&'a [u8]> {
        let rest = &self.data[self.at..];
        if rest.len() < count {
            return Err(self.damaged("the payload ends early"));
        }
        self.at += count;
        Ok(&rest[..count])
    }

    fn u8(&mut self) -> Result<u8> {
        Ok(self.take(1)?[0])
    }

    fn u32(&mut self) -> Result<u32> {
        Ok(u32::from_le_bytes(self.take(4)?.try_into().expect("4 bytes")))
    }

    fn u64(&mut self) -> Result<u64> {
        Ok(u64::from_le_bytes(self.take(8)?.try_into().expect("8 bytes")))
    }

    fn f64(&mut self) -> Result<f64> {
        self.u64().map(f64::from_bits)
    }

    /// One of a few alternatives, numbered from 0.
    fn choice<T: Copy>(&mut self, alternatives: &[T]) -> Result<T> {
        let number = self.u8()?;
        alternatives
            .get(usize::from(number))
            .copied()
            .ok_or_else(|| self.damaged("an alternative that does not exist"))
    }

    fn method(&mut self) -> Result<Method> {
        let is_or = self.choice(&[false, true])?;
        if is_or {
            return Ok(Method::Or(Or::new(self.u64()? as usize, self.f64()?)?));
        }
        let rates = Rates::new(self.f64()?, self.f64()?)?;
        let (prior, b_threshold) = (self.f64()?, self.f64()?);
        let unseen = self.choice(&[Unseen::Fleet, Unseen::Visible])?;
        let normalise = self.choice(&[false, true])?;
        let pool = OpinionPool::new(rates, prior, b_threshold, unseen, normalise)?;
        let blend = TemporalBlend::new(self.f64()?, self.f64()?)?;
        let fleet_size = self.u64()? as usize;
        let initial = self.choice(&[Initial::Zero, Initial::Prior, Initial::FirstLook])?;
        let decay = self.choice(&[Decay::PerSecond, Decay::PerFrame])?;
        Ok(Method::Paper(Paper::new(pool, blend, fleet_size, initial, decay)?))
    }

    fn projection(&mut self) -> Result<Projection> {
        let (max_range_m, target_height_m) = (self.f64()?, self.f64()?);
        let coverage = self.choice(&[Coverage::Rays, Coverage::Full])?;
        Projection::new(max_range_m, target_height_m, coverage)
    }

    fn drones(&mut self, fleet_size: usize) -> Result<BTreeSet<String>> {
        let count = self.u32()? as usize;
        if count > fleet_size {
            return Err(self.damaged("more drones than the fleet has"));
        }
        let mut drones = BTreeSet::new();
        for _ in 0..count {
            let length = self.u32()? as usize;
            let name = std::str::from_utf8(self.take(length)?)
                .map_err(|_| self.damaged("a drone name that is not UTF-8"))?;
            drones.insert(name.to_owned());
        }
        Ok(drones)
    }

    fn stamps(&mut self) -> Result<Vec<i64>> {
        let count = self.u32()? as usize;
        let bytes = self.take(count.saturating_mul(8))?;
        let stamps_ns: Vec<i64> = bytes
            .chunks_exact(8)
            .map(|stamp| i64::from_le_bytes(stamp.try_into().expect("8 bytes")))
            .collect();
        if stamps_ns.is_sorted_by(|a, b| a < b) {
            Ok(stamps_ns)
        } else {
            Err(self.damaged("stamps that do not increase"))
        }
    }

    fn beliefs(&mut self, map: &mut CrowdMap) -> Result<()> {
        let instants = map.stamps_ns.len() as u32;
        let mut previous = None;
        for _ in 0..self.u32()? {
            let number = self.u32()?;
            if previous.is_some_and(|p| p >= number) || number as usize >= map.beliefs.pages().len() {
                return Err(self.damaged("a page that does not belong to the map"));
            }
            previous = Some(number);
            let probability: Vec<f64> = self
                .take(PAGE_VOXELS * 8)?
                .chunks_exact(8)
                .map(|p| f64::from_le_bytes(p.try_into().expect("8 bytes")))
                .collect();
            let look: Vec<u32> = self
                .take(PAGE_VOXELS * 4)?
                .chunks_exact(4)
                .map(|look| u32::from_le_bytes(look.try_into().expect("4 bytes")))
                .collect();
            if !probability.iter().all(|p| (0.0..=1.0).contains(p)) {
                return Err(self.damaged("a probability outside [0, 1]"));
            }
            let exists = |&look: &u32| !matches!(Look::from_code(look), Look::At(at) if at >= instants);
            if !look.iter().all(exists) {
                return Err(self.damaged("a look at an instant that does not exist"));
            }
            map.beliefs.put_page(number as usize, probability, look);
        }
        Ok(())
    }
}
