//! Who looked at which voxel, and when last.

use std::collections::BTreeMap;

use super::instants::{Instant, Instants};
use super::pages::{PAGE_LENGTH, Pages, by_page};
use super::shown::{Shown, ShownLook};

#[derive(Debug, Clone)]
pub(super) struct History {
    /// Coded as in [`Look`].
    pub looks: Pages<u32>,
    pub shown: Shown,
    pub instants: Instants,
    /// Every drone that ever gave a view, by name.
    pub drones: BTreeMap<String, Drone>,
    voxel_count: usize,
}

#[derive(Debug, Clone)]
pub(super) struct Drone {
    /// How many gave a view before it did.
    pub number: u32,
    /// The voxels that it has seen, one bit each.
    pub seen: Pages<u64>,
}

/// The last look at a voxel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Look {
    Never,
    /// Nobody has seen it; a camera pointed at it and something hid it.
    Occluded,
    /// Slot of its instant.
    At(u32),
}

impl Look {
    pub const NEVER: u32 = u32::MAX;
    pub const OCCLUDED: u32 = u32::MAX - 1;
    /// Set beside a slot where the look spoke for crowd.
    const FOR_CROWD: u32 = 1 << 31;

    pub fn from_code(code: u32) -> Look {
        match code {
            Look::NEVER => Look::Never,
            Look::OCCLUDED => Look::Occluded,
            code => Look::At(code & !Look::FOR_CROWD),
        }
    }

    /// Code of a look at the instant of a slot.
    pub fn had(slot: u32, for_crowd: bool) -> u32 {
        if for_crowd { slot | Look::FOR_CROWD } else { slot }
    }

    /// Something hides a voxel from a camera. What was seen before stays seen.
    pub fn hide(code: &mut u32) {
        if *code == Look::NEVER {
            *code = Look::OCCLUDED;
        }
    }

    /// Whether somebody looked and the look spoke for crowd.
    pub fn is_for_crowd(code: u32) -> bool {
        code < Look::OCCLUDED && code & Look::FOR_CROWD != 0
    }
}

/// Voxels of which a word of bits says whether a drone has seen them.
const WORD_VOXELS: usize = u64::BITS as usize;

fn word(id: u32) -> usize {
    id as usize / WORD_VOXELS
}

fn bit(id: u32) -> u64 {
    1 << (id as usize % WORD_VOXELS)
}

impl Drone {
    pub fn has_seen(&self, id: u32) -> bool {
        self.seen.get(word(id)) & bit(id) != 0
    }
}

impl History {
    pub fn new(voxel_count: usize) -> History {
        History {
            looks: Pages::new(voxel_count, Look::NEVER),
            shown: Shown::default(),
            instants: Instants::default(),
            drones: BTreeMap::new(),
            voxel_count,
        }
    }

    pub fn look(&self, id: u32) -> Look {
        Look::from_code(self.looks.get(id as usize))
    }

    pub fn last_look(&self, id: u32) -> Option<Instant> {
        match self.look(id) {
            Look::At(slot) => Some(self.instants.at(slot)),
            Look::Never | Look::Occluded => None,
        }
    }

    /// Whether the last look at a voxel spoke for crowd: it left more of it than the looks before, and more than is
    /// held of ground that nobody has seen.
    pub fn spoke_for_crowd(&self, id: u32) -> bool {
        Look::is_for_crowd(self.looks.get(id as usize))
    }

    /// Takes in looks that by themselves may show crowd.
    pub fn remember_shown(&mut self, looks: &[ShownLook]) {
        let mut shown = std::mem::take(&mut self.shown);
        shown.add(looks, |id| self.last_look(id).map(|last| last.stamp_ns));
        self.shown = shown;
    }

    /// Something hides voxels, sorted, from a camera.
    pub fn hide(&mut self, ids: &[u32]) {
        for (page, ids) in by_page(ids) {
            let codes = self.looks.page_mut(page);
            ids.iter().for_each(|&id| Look::hide(&mut codes[id as usize % PAGE_LENGTH]));
        }
    }

    /// Number of a drone that gives a view.
    pub fn enlist(&mut self, drone: &str) -> u32 {
        if let Some(known) = self.drones.get(drone) {
            return known.number;
        }
        let number = self.drones.len() as u32;
        self.drones.insert(drone.to_owned(), Drone { number, seen: self.none_seen() });
        number
    }

    /// Adds voxels to those that a drone, which is enlisted, has seen.
    pub fn add_seen(&mut self, drone: &str, ids: &[u32]) {
        let Drone { seen, .. } = self.drones.get_mut(drone).expect("the drone is enlisted");
        for ids in ids.chunk_by(|&a, &b| word(a) == word(b)) {
            *seen.get_mut(word(ids[0])) |= ids.iter().fold(0, |bits, &id| bits | bit(id));
        }
    }

    /// The voxels seen by a drone that has seen none.
    pub fn none_seen(&self) -> Pages<u64> {
        Pages::new(self.voxel_count.div_ceil(WORD_VOXELS), 0)
    }

    pub fn drones(&self) -> impl Iterator<Item = &str> {
        self.drones.keys().map(String::as_str)
    }

    pub fn knows(&self, drone: &str) -> bool {
        self.drones.contains_key(drone)
    }

    /// Drones that have ever seen one of the voxels, by name.
    pub fn seen_by(&self, ids: &[u32]) -> Vec<&str> {
        let sees = |drone: &Drone| ids.iter().any(|&id| drone.has_seen(id));
        self.drones.iter().filter(|(_, drone)| sees(drone)).map(|(name, _)| name.as_str()).collect()
    }

    /// How many drones have ever seen a voxel.
    pub fn drone_count(&self, id: u32) -> u32 {
        self.drones.values().filter(|drone| drone.has_seen(id)).count() as u32
    }

    /// Voxels that somebody has seen, sorted. Costs what was seen, not the map.
    pub fn seen_ids(&self) -> Vec<u32> {
        let seen = self.looks.values().filter(|&(_, code)| matches!(Look::from_code(code), Look::At(_)));
        seen.map(|(id, _)| id as u32).collect()
    }
}
