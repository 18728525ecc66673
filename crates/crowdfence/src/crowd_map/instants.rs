//! The instants at which voxels were last seen. A voxel names its instant by a slot, and a slot that no voxel
//! names is used again: a process that runs for weeks keeps as many instants as it needs, not as many as it saw.

use crate::method::Elapsed;
use crate::stamp::seconds_between;

#[derive(Debug, Clone, Default)]
pub(super) struct Instants {
    slots: Vec<Slot>,
    free: Vec<u32>,
    /// How many were integrated so far.
    pub integrated: u64,
    /// Stamps of the first and of the newest of them.
    pub span_ns: Option<(i64, i64)>,
}

/// When something was looked at: on the clock, and counted in instants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Instant {
    pub stamp_ns: i64,
    /// Instants integrated before it.
    pub number: u64,
}

impl Instant {
    /// Time to `later`, none if that is older.
    pub fn until(self, later: Instant) -> Elapsed {
        Elapsed {
            seconds: seconds_between(self.stamp_ns, later.stamp_ns).max(0.0),
            instants: later.number.saturating_sub(self.number),
        }
    }
}

#[derive(Debug, Clone, Copy)]
struct Slot {
    instant: Instant,
    /// How many voxels name it.
    voxels: u32,
}

impl Instants {
    pub fn newest_ns(&self) -> Option<i64> {
        self.span_ns.map(|(_, newest_ns)| newest_ns)
    }

    /// A slot for an instant that voxels are about to name.
    pub fn open(&mut self, instant: Instant) -> u32 {
        let slot = Slot { instant, voxels: 0 };
        match self.free.pop() {
            Some(free) => {
                self.slots[free as usize] = slot;
                free
            }
            None => {
                self.slots.push(slot);
                (self.slots.len() - 1) as u32
            }
        }
    }

    /// To be called once all voxels name it that ever will.
    pub fn close(&mut self, slot: u32) {
        if self.slots[slot as usize].voxels == 0 {
            self.free.push(slot);
        }
    }

    /// So many voxels more name `slot`, which is open.
    pub fn enter(&mut self, slot: u32, voxels: u32) {
        self.slots[slot as usize].voxels += voxels;
    }

    /// So many voxels fewer name `slot`, which is closed.
    pub fn leave(&mut self, slot: u32, voxels: u32) {
        self.slots[slot as usize].voxels -= voxels;
        self.close(slot);
    }

    pub fn at(&self, slot: u32) -> Instant {
        self.slots[slot as usize].instant
    }

    /// Time from the instant of each slot to `now`, none where `now` is older.
    pub fn elapsed(&self, now: Instant) -> impl Iterator<Item = Elapsed> + '_ {
        self.slots.iter().map(move |slot| slot.instant.until(now))
    }

    /// How many voxels name an instant: those that somebody has seen.
    pub fn voxels(&self) -> usize {
        self.slots.iter().map(|slot| slot.voxels as usize).sum()
    }

    /// Slots that voxels name, oldest instant first.
    pub fn named(&self) -> Vec<u32> {
        let mut named: Vec<u32> =
            (0..self.slots.len() as u32).filter(|&slot| self.slots[slot as usize].voxels > 0).collect();
        named.sort_unstable_by_key(|&slot| self.at(slot));
        named
    }

    /// How many instants are kept, in use or free.
    #[cfg(test)]
    pub fn kept(&self) -> usize {
        self.slots.len()
    }
}
