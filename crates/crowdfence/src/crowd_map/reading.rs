//! The map as it stands at one moment.

use rayon::prelude::*;

use super::beliefs::BeliefsOf;
use super::history::{History, Look};
use super::instants::{Instant, Instants};
use super::pages::PAGE_LENGTH;
use crate::method::FusionMethod;

/// Few voxels of a page are seen as a rule: so many pages are one piece of work.
const PAGES_AT_ONCE: usize = 16;

pub(super) struct Reading<'a, M: FusionMethod> {
    beliefs: &'a BeliefsOf<M>,
    history: &'a History,
    /// What is left of the beliefs of each slot.
    fading: Vec<M::Fading>,
}

impl<'a, M: FusionMethod> Reading<'a, M> {
    pub fn new(beliefs: &'a BeliefsOf<M>, history: &'a History, now: Instant) -> Reading<'a, M> {
        Reading { beliefs, history, fading: fading(&beliefs.method, &history.instants, now) }
    }

    /// Probability of crowd of a voxel; the method's initial value where nobody has looked.
    pub fn probability(&self, id: u32) -> f64 {
        match self.history.look(id) {
            Look::At(slot) => self.faded(self.beliefs.pages.get(id as usize), slot),
            Look::Never | Look::Occluded => self.beliefs.method.unseen_probability(),
        }
    }

    /// Whether a voxel below the threshold is empty.
    pub fn clears(&self, probability: f64) -> bool {
        self.beliefs.method.clears(probability)
    }

    /// What `answer` says of the voxels that somebody has seen and of their probabilities, in the order of their
    /// ids. Costs what was seen, not the map.
    pub fn of_seen<T: Send>(&self, answer: impl Fn(u32, f64) -> Option<T> + Sync) -> Vec<T> {
        let pages: Vec<(usize, &[u32])> = self.history.looks.written().collect();
        let answers = |&(number, looks): &(usize, &'a [u32])| {
            let beliefs = self.beliefs.pages.page(number).unwrap_or(&[]);
            let (answer, first) = (&answer, (number * PAGE_LENGTH) as u32);
            looks.iter().zip(beliefs).zip(first..).filter_map(move |((&code, &belief), id)| {
                match Look::from_code(code) {
                    Look::At(slot) => answer(id, self.faded(belief, slot)),
                    Look::Never | Look::Occluded => None,
                }
            })
        };
        pages.par_iter().with_min_len(PAGES_AT_ONCE).flat_map_iter(answers).collect()
    }

    fn faded(&self, belief: M::Belief, slot: u32) -> f64 {
        self.beliefs.method.probability(belief, self.fading[slot as usize])
    }
}

/// What is left at `now` of the beliefs of each slot.
pub(super) fn fading<M: FusionMethod>(method: &M, instants: &Instants, now: Instant) -> Vec<M::Fading> {
    instants.elapsed(now).map(|since| method.fading(since)).collect()
}
