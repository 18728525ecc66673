//! The map as it stands at one moment.

use rayon::prelude::*;

use super::beliefs::BeliefsOf;
use super::check_threshold;
use super::history::{History, Look};
use super::instants::{Instant, Instants};
use super::pages::PAGE_LENGTH;
use super::voxel_state::{VoxelKnowledge, VoxelState};
use crate::error::{Result, require};
use crate::method::{Elapsed, FusionMethod};
use crate::stamp::seconds_between;

/// Few voxels of a page are seen as a rule: so many pages are one piece of work.
const PAGES_AT_ONCE: usize = 16;

pub(super) struct Reading<'a, M: FusionMethod> {
    beliefs: &'a BeliefsOf<M>,
    history: &'a History,
    now: Instant,
    /// What is left of the beliefs of each slot.
    fading: Vec<M::Fading>,
}

/// What decides about a state beside the method.
#[derive(Debug, Clone, Copy)]
pub(super) struct StateRule {
    threshold: f64,
    stale_after_s: f64,
}

impl StateRule {
    pub fn new(threshold: f64, stale_after_s: f64) -> Result<StateRule> {
        check_threshold(threshold)?;
        require(stale_after_s >= 0.0, "stale_after_s", stale_after_s, ">= 0")?;
        Ok(StateRule { threshold, stale_after_s })
    }
}

impl<'a, M: FusionMethod> Reading<'a, M> {
    pub fn new(beliefs: &'a BeliefsOf<M>, history: &'a History, now: Instant) -> Reading<'a, M> {
        Reading { beliefs, history, now, fading: fading(&beliefs.method, &history.instants, now) }
    }

    /// As the last look at each voxel left it, whatever was forgotten since.
    pub fn at_last_looks(beliefs: &'a BeliefsOf<M>, history: &'a History, now: Instant) -> Reading<'a, M> {
        let none = beliefs.method.fading(Elapsed { seconds: 0.0, instants: 0 });
        let fading = history.instants.elapsed(now).map(|_| none).collect();
        Reading { beliefs, history, now, fading }
    }

    pub fn method(&self) -> &M {
        &self.beliefs.method
    }

    /// Probability of crowd of a voxel; the method's initial value where nobody has looked.
    pub fn probability(&self, id: u32) -> f64 {
        match self.history.look(id) {
            Look::At(slot) => self.faded(self.beliefs.pages.get(id as usize), slot),
            Look::Never | Look::Occluded => self.beliefs.method.unseen_probability(),
        }
    }

    /// Bounds of the probability at a level; None where the method has none.
    pub fn interval(&self, id: u32, level: f64) -> Option<[f64; 2]> {
        let belief = match self.history.look(id) {
            Look::At(slot) => Some((self.beliefs.pages.get(id as usize), self.fading[slot as usize])),
            Look::Never | Look::Occluded => None,
        };
        self.beliefs.method.interval(belief, level)
    }

    pub fn state(&self, id: u32, rule: StateRule) -> VoxelState {
        let slot = match self.history.look(id) {
            Look::Never => return VoxelState::NeverSeen,
            Look::Occluded => return VoxelState::Occluded,
            Look::At(slot) => slot,
        };
        let probability = self.faded(self.beliefs.pages.get(id as usize), slot);
        if probability >= rule.threshold {
            VoxelState::Crowd
        } else if self.is_fresh(slot, rule) {
            if self.is_cleared(id, probability, rule) { VoxelState::Empty } else { VoxelState::NotCleared }
        } else if self.was_empty(id, rule) {
            VoxelState::Stale
        } else {
            VoxelState::NotCleared
        }
    }

    /// Did the last look leave it empty? Time alone makes no place one that was empty.
    fn was_empty(&self, id: u32, rule: StateRule) -> bool {
        let method = &self.beliefs.method;
        let none = method.fading(Elapsed { seconds: 0.0, instants: 0 });
        let then = method.probability(self.beliefs.pages.get(id as usize), none);
        self.is_cleared(id, then, rule)
    }

    pub fn knowledge(&self, id: u32, rule: StateRule) -> VoxelKnowledge {
        let (age_s, looks) = match self.history.look(id) {
            Look::At(slot) => {
                let belief = self.beliefs.pages.get(id as usize);
                (Some(self.age_s(slot)), self.beliefs.method.looks(belief, self.fading[slot as usize]))
            }
            Look::Never | Look::Occluded => (None, None),
        };
        VoxelKnowledge {
            state: self.state(id, rule),
            probability: self.probability(id),
            age_s,
            looks,
            drones: self.history.drone_count(id),
        }
    }

    /// The voxels that are empty, in the order of their ids. Costs what was seen, not the map.
    pub fn empty_ids(&self, rule: StateRule) -> Vec<u32> {
        let is_fresh: Vec<bool> =
            (0..self.fading.len()).map(|slot| self.is_fresh(slot as u32, rule)).collect();
        let pages: Vec<usize> = self.history.looks.written().map(|(number, _)| number).collect();
        let empty_of = |&number: &usize| {
            self.looks_of(number).filter_map(|(id, slot, belief)| {
                let is_empty = is_fresh[slot as usize] && self.is_cleared(id, self.faded(belief, slot), rule);
                is_empty.then_some(id)
            })
        };
        pages.par_iter().with_min_len(PAGES_AT_ONCE).flat_map_iter(empty_of).collect()
    }

    /// Do the looks speak against crowd, and none of those up to the last one, which the others outweigh, clearly for it?
    fn is_cleared(&self, id: u32, probability: f64, rule: StateRule) -> bool {
        probability < rule.threshold
            && self.beliefs.method.clears(probability)
            && !self.history.shown.holds(id)
    }

    fn is_fresh(&self, slot: u32, rule: StateRule) -> bool {
        self.age_s(slot) <= rule.stale_after_s
    }

    fn age_s(&self, slot: u32) -> f64 {
        seconds_between(self.history.instants.at(slot).stamp_ns, self.now.stamp_ns)
    }

    /// What `answer` says of the voxels that somebody has seen and of their probabilities, in the order of their
    /// ids. Costs what was seen, not the map.
    pub fn of_seen<T: Send>(&self, answer: impl Fn(u32, f64) -> Option<T> + Sync) -> Vec<T> {
        let pages: Vec<usize> = self.history.looks.written().map(|(number, _)| number).collect();
        let answers = |&number: &usize| self.of_page(number).filter_map(|(id, p)| answer(id, p));
        pages.par_iter().with_min_len(PAGES_AT_ONCE).flat_map_iter(answers).collect()
    }

    /// The largest probability of each of some pages, and the voxels that are at or above a threshold.
    pub fn crowd_of(&self, pages: &[usize], threshold: f64) -> Vec<(f64, Vec<u32>)> {
        let crowd_of = |&number: &usize| {
            let (mut largest, mut crowd) = (0.0, Vec::new());
            for (id, probability) in self.of_page(number) {
                largest = probability.max(largest);
                if probability >= threshold {
                    crowd.push(id);
                }
            }
            (largest, crowd)
        };
        pages.par_iter().with_min_len(PAGES_AT_ONCE).map(crowd_of).collect()
    }

    /// The voxels of a page that somebody has seen, in the order of their ids, and their probabilities.
    fn of_page(&self, number: usize) -> impl Iterator<Item = (u32, f64)> + '_ {
        self.looks_of(number).map(|(id, slot, belief)| (id, self.faded(belief, slot)))
    }

    /// The same voxels, each with the slot of its last look and its belief then.
    fn looks_of(&self, number: usize) -> impl Iterator<Item = (u32, u32, M::Belief)> + '_ {
        let looks = self.history.looks.page(number).unwrap_or(&[]);
        let beliefs = self.beliefs.pages.page(number).unwrap_or(&[]);
        let first = (number * PAGE_LENGTH) as u32;
        looks.iter().zip(beliefs).zip(first..).filter_map(|((&code, &belief), id)| {
            match Look::from_code(code) {
                Look::At(slot) => Some((id, slot, belief)),
                Look::Never | Look::Occluded => None,
            }
        })
    }

    fn faded(&self, belief: M::Belief, slot: u32) -> f64 {
        self.beliefs.method.probability(belief, self.fading[slot as usize])
    }
}

/// What is left at `now` of the beliefs of each slot.
pub(super) fn fading<M: FusionMethod>(method: &M, instants: &Instants, now: Instant) -> Vec<M::Fading> {
    instants.elapsed(now).map(|since| method.fading(since)).collect()
}
