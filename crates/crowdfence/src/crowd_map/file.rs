//! The crowd map's file format, version 8, in the frame of [`crate::sealed`]; versions 1 to 7 are read too.
//!
//! ```text
//! terrain          u64 fingerprint, u64 voxel count
//! method           u8 0 = paper, 1 = or, 2 = evidence, 3 = linear-pool, 4 = log-pool, 5 = log-odds,
//!                  6 = moving-average, then its parameters as its file in `method/` says
//! projection       f64 max_range_m, target_height_m; u8 coverage and surface (0 rays, 1 full onto
//!                  voxels, 2 rays, 3 full onto planes)
//! max_gap_s        f64
//! instants         u64 integrated so far, i64 first stamp, i64 newest stamp (0, 0 before the first)
//! named instants   u32 count, then i64 stamp, u64 number each, strictly increasing: those that voxels name
//! looks            pages of u32: position among the named instants, 2^31 more where the look spoke for crowd;
//!                  2^32 - 2 occluded, 2^32 - 1 never
//! shown            u32 count, then per look that by itself may show crowd: u32 voxel, i64 stamp, f32 log odds; by voxel,
//!                  newest first, each with more than the newer ones
//! beliefs          pages of the method's beliefs
//! drones           u32 count, then per drone: name (u32 length, UTF-8), u32 how many gave a view before it, pages of
//!                  u64: a bit a voxel that it saw
//! pages            u32 count, then per page: u32 number (increasing), 1024 values
//!
//! version 7 counts of looks from below only those that show crowd; version 6 also knows no likelihood ratios of finer
//! cameras; version 5 also does not say which looks showed crowd by themselves; version 4 also not which spoke for it;
//! version 3 also not which drone came first; version 2 also differs in the beliefs of `paper`; version 1 in beliefs, and
//! after max_gap_s:
//!   drones         u32 count, names
//!   instants       u32 count, i64 stamps, strictly increasing
//!   pages          u32 count, then per page: u32 number (increasing), 1024 beliefs, 1024 x u32 look (position
//!                  among the instants, or as above)
//! ```

use std::collections::BTreeSet;
use std::sync::Arc;

use super::CrowdMap;
use super::beliefs::{Beliefs, BeliefsOf};
use super::history::{Drone, History, Look};
use super::instants::Instant;
use super::pages::{PAGE_LENGTH, Pages};
use super::shown::ShownLook;
use crate::back_projection::{Coverage, Projection};
use crate::error::Result;
use crate::method::{
    Evidence, LinearPool, LogOdds, LogPool, Method, MovingAverage, Or, Paper, Stored, each_method,
};
use crate::sealed::{Kind, Reader, Writer};
use crate::terrain::{Surface, Terrain, TerrainKey};

/// By their number in the file. Maps that were written before there were planes are of voxels.
const SEEN_HOW: [(Coverage, Surface); 4] = [
    (Coverage::Rays, Surface::Voxels),
    (Coverage::Full, Surface::Voxels),
    (Coverage::Rays, Surface::Planes),
    (Coverage::Full, Surface::Planes),
];

const KIND: Kind = Kind { magic: b"CROWDMAP", name: "crowd map", version: 8 };

impl CrowdMap {
    /// The whole map in the format above, to go on with later: the terrain is not in it, only its key.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut payload = Writer::default();
        let key = self.terrain.key();
        payload.u64(key.fingerprint);
        payload.u64(key.voxel_count as u64);
        payload.u8(match self.method() {
            Method::Paper(_) => 0,
            Method::Or(_) => 1,
            Method::Evidence(_) => 2,
            Method::LinearPool(_) => 3,
            Method::LogPool(_) => 4,
            Method::LogOdds(_) => 5,
            Method::MovingAverage(_) => 6,
        });
        each_method!(&self.beliefs, Beliefs, beliefs => beliefs.method.write(&mut payload));
        payload.f64(self.projection.max_range_m());
        payload.f64(self.projection.target_height_m());
        let seen_how = (self.projection.coverage(), self.projection.surface());
        payload.u8(SEEN_HOW.iter().position(|&how| how == seen_how).expect("all are listed") as u8);
        payload.f64(self.max_gap_s);
        write_looks(&self.history, &mut payload);
        each_method!(&self.beliefs, Beliefs, beliefs => write_beliefs(beliefs, &mut payload));
        payload.u32(self.history.drones.len() as u32);
        for (name, Drone { number, seen }) in &self.history.drones {
            payload.text(name);
            payload.u32(*number);
            write_pages(seen, &mut payload, |&word, payload| payload.u64(word));
        }
        KIND.seal(payload)
    }

    /// The inverse, on the terrain that the map was made on.
    ///
    /// Errors: [`Error::OtherTerrain`](crate::Error::OtherTerrain) on any other, [`Error::NotOfKind`](crate::Error::NotOfKind),
    /// [`Error::FormatVersion`](crate::Error::FormatVersion) and [`Error::Damaged`](crate::Error::Damaged) for what is no map of ours.
    pub fn from_bytes(data: &[u8], terrain: Arc<Terrain>) -> Result<CrowdMap> {
        let (version, mut reader) = KIND.open(data)?;
        let key = TerrainKey { fingerprint: reader.u64()?, voxel_count: reader.u64()? as usize };
        terrain.key().check_same(key, KIND.name)?;
        let method = match reader.choice(&[0, 1, 2, 3, 4, 5, 6])? {
            0 => Method::Paper(Paper::read(&mut reader, version)?),
            1 => Method::Or(Or::read(&mut reader, version)?),
            2 => Method::Evidence(Evidence::read(&mut reader, version)?),
            3 => Method::LinearPool(LinearPool::read(&mut reader, version)?),
            4 => Method::LogPool(LogPool::read(&mut reader, version)?),
            5 => Method::LogOdds(LogOdds::read(&mut reader, version)?),
            _ => Method::MovingAverage(MovingAverage::read(&mut reader, version)?),
        };
        let (max_range_m, target_height_m) = (reader.f64()?, reader.f64()?);
        let (coverage, surface) = reader.choice(&SEEN_HOW)?;
        let projection = Projection::new(max_range_m, target_height_m, coverage)?.with_surface(surface);
        let mut map = CrowdMap::new(terrain, method, projection, reader.f64()?)?;
        match version {
            1 => read_version_1(&mut reader, &mut map)?,
            _ => read_since_version_2(&mut reader, &mut map, version)?,
        }
        reader.end()?;
        Ok(map)
    }
}

fn write_looks(history: &History, payload: &mut Writer) {
    let instants = &history.instants;
    let (first_ns, newest_ns) = instants.span_ns.unwrap_or((0, 0));
    payload.u64(instants.integrated);
    payload.i64(first_ns);
    payload.i64(newest_ns);
    // Slots depend on what was freed when; in the file instants stand in order of time.
    let named = instants.named();
    payload.u32(named.len() as u32);
    for &slot in &named {
        let Instant { stamp_ns, number } = instants.at(slot);
        payload.i64(stamp_ns);
        payload.u64(number);
    }
    let mut position = vec![0; named.iter().map(|&slot| slot as usize + 1).max().unwrap_or(0)];
    named.iter().zip(0..).for_each(|(&slot, at)| position[slot as usize] = at);
    write_pages(&history.looks, payload, |&code, payload| {
        payload.u32(match Look::from_code(code) {
            Look::At(slot) => Look::had(position[slot as usize], Look::is_for_crowd(code)),
            Look::Never | Look::Occluded => code,
        });
    });
    let shown = history.shown.looks();
    payload.u32(shown.len() as u32);
    for look in shown {
        payload.u32(look.id);
        payload.i64(look.stamp_ns);
        payload.f32(look.log_odds);
    }
}

fn write_beliefs<M: Stored>(beliefs: &BeliefsOf<M>, payload: &mut Writer) {
    write_pages(&beliefs.pages, payload, |&belief, payload| M::write_belief(belief, payload));
}

fn write_pages<T: Copy>(pages: &Pages<T>, payload: &mut Writer, write: impl Fn(&T, &mut Writer)) {
    payload.u32(pages.written().count() as u32);
    for (number, page) in pages.written() {
        payload.u32(number as u32);
        page.iter().for_each(|value| write(value, payload));
    }
}

/// Fills `pages`; `read` gives the values of one page.
fn read_pages<'a, T: Copy>(
    reader: &mut Reader<'a>,
    pages: &mut Pages<T>,
    read: impl Fn(&mut Reader<'a>) -> Result<Vec<T>>,
) -> Result<()> {
    let mut lowest = 0;
    for _ in 0..reader.u32()? {
        let number = page_number(reader, lowest, pages.count())?;
        lowest = number + 1;
        let page = read(reader)?;
        pages.put(number, page);
    }
    Ok(())
}

fn page_number(reader: &mut Reader<'_>, lowest: usize, count: usize) -> Result<usize> {
    let number = reader.u32()? as usize;
    if (lowest..count).contains(&number) {
        Ok(number)
    } else {
        Err(reader.damaged("a page that does not belong to the map"))
    }
}

fn read_since_version_2(reader: &mut Reader<'_>, map: &mut CrowdMap, version: u32) -> Result<()> {
    let history = &mut map.history;
    let (integrated, first_ns, newest_ns) = (reader.u64()?, reader.i64()?, reader.i64()?);
    if first_ns < 0 || newest_ns < first_ns || integrated > u64::from(u32::MAX) << 16 {
        return Err(reader.damaged("instants that no clock gives"));
    }
    history.instants.integrated = integrated;
    history.instants.span_ns = (integrated > 0).then_some((first_ns, newest_ns));
    let count = reader.u32()? as usize;
    let mut named = Vec::new();
    for _ in 0..count {
        named.push(Instant { stamp_ns: reader.i64()?, number: reader.u64()? });
    }
    let inside =
        |instant: &Instant| (0..=newest_ns).contains(&instant.stamp_ns) && instant.number < integrated;
    if !named.is_sorted_by(|a, b| a < b) || !named.iter().all(inside) {
        return Err(reader.damaged("instants that do not increase or lie outside the map's time"));
    }
    let mut looks = Pages::new(map.terrain.voxel_count(), Look::NEVER);
    read_pages(reader, &mut looks, |reader| reader.numbers(PAGE_LENGTH, u32::from_le_bytes))?;
    take_looks(reader, history, &named, looks)?;
    if version >= 6 {
        read_shown(reader, history, map.terrain.voxel_count())?;
    }
    each_method!(&mut map.beliefs, Beliefs, beliefs => read_beliefs(reader, beliefs, version))?;
    read_drones(reader, history, version)
}

fn read_shown(reader: &mut Reader<'_>, history: &mut History, voxel_count: usize) -> Result<()> {
    let newest_ns = history.instants.newest_ns().unwrap_or(-1);
    let mut looks = Vec::new();
    for _ in 0..reader.u32()? {
        let look = ShownLook { id: reader.u32()?, stamp_ns: reader.i64()?, log_odds: reader.f32()? };
        let is_sound = look.log_odds.is_finite() && (0..=newest_ns).contains(&look.stamp_ns);
        if look.id as usize >= voxel_count || !is_sound {
            return Err(reader.damaged("a look that shows crowd where or when nobody can have looked"));
        }
        looks.push(look);
    }
    history.remember_shown(&looks);
    Ok(())
}

fn read_beliefs<M: Stored>(reader: &mut Reader<'_>, beliefs: &mut BeliefsOf<M>, version: u32) -> Result<()> {
    read_pages(reader, &mut beliefs.pages, |reader| M::read_beliefs(reader, version, PAGE_LENGTH))
}

fn read_drones(reader: &mut Reader<'_>, history: &mut History, version: u32) -> Result<()> {
    let count = reader.u32()?;
    let mut numbers = BTreeSet::new();
    for at in 0..count {
        let name = reader.text()?;
        let number = if version >= 4 { reader.u32()? } else { at };
        if number >= count || !numbers.insert(number) {
            return Err(reader.damaged("drones that came in no order"));
        }
        let mut seen = history.none_seen();
        read_pages(reader, &mut seen, |reader| reader.numbers(PAGE_LENGTH, u64::from_le_bytes))?;
        history.drones.insert(name, Drone { number, seen });
    }
    Ok(())
}

fn read_version_1(reader: &mut Reader<'_>, map: &mut CrowdMap) -> Result<()> {
    let history = &mut map.history;
    for _ in 0..reader.u32()? {
        let drone = reader.text()?;
        history.enlist(&drone);
    }
    let count = reader.u32()? as usize;
    let stamps_ns = reader.numbers(count, i64::from_le_bytes)?;
    if !stamps_ns.is_sorted_by(|a, b| a < b) || stamps_ns.first().is_some_and(|&first_ns| first_ns < 0) {
        return Err(reader.damaged("stamps that are negative or do not increase"));
    }
    history.instants.integrated = count as u64;
    history.instants.span_ns = stamps_ns.first().copied().zip(stamps_ns.last().copied());
    let named: Vec<Instant> =
        stamps_ns.iter().zip(0..).map(|(&stamp_ns, number)| Instant { stamp_ns, number }).collect();
    let mut looks = Pages::new(map.terrain.voxel_count(), Look::NEVER);
    each_method!(&mut map.beliefs, Beliefs, beliefs => read_pages_1(reader, beliefs, &mut looks))?;
    take_looks(reader, history, &named, looks)
}

fn read_pages_1<M: Stored>(
    reader: &mut Reader<'_>,
    beliefs: &mut BeliefsOf<M>,
    looks: &mut Pages<u32>,
) -> Result<()> {
    let mut lowest = 0;
    for _ in 0..reader.u32()? {
        let number = page_number(reader, lowest, looks.count())?;
        lowest = number + 1;
        beliefs.pages.put(number, M::read_beliefs(reader, 1, PAGE_LENGTH)?);
        looks.put(number, reader.numbers(PAGE_LENGTH, u32::from_le_bytes)?);
    }
    Ok(())
}

/// Looks that name instants by their position in `named` become the history's.
fn take_looks(
    reader: &Reader<'_>,
    history: &mut History,
    named: &[Instant],
    looks: Pages<u32>,
) -> Result<()> {
    let exists = |code| !matches!(Look::from_code(code), Look::At(at) if at as usize >= named.len());
    if !looks.values().all(|(_, code)| exists(code)) {
        return Err(reader.damaged("a look at an instant that does not exist"));
    }
    // In an empty history, slots are given out in order: position and slot are the same number.
    for &instant in named {
        history.instants.open(instant);
    }
    for (_, code) in looks.values() {
        if let Look::At(slot) = Look::from_code(code) {
            history.instants.enter(slot, 1);
        }
    }
    (0..named.len() as u32).for_each(|slot| history.instants.close(slot));
    history.looks = looks;
    Ok(())
}
