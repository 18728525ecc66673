//! A method beside what it believes about every voxel that was seen.

use rayon::prelude::*;

use super::history::History;
use super::instants::Instant;
use super::newest;
use super::pages::Pages;
use crate::method::{Elapsed, FusionMethod, Method, Or, Paper, VoxelLook, each_method};

#[derive(Debug, Clone)]
pub(super) enum Beliefs {
    Paper(BeliefsOf<Paper>),
    Or(BeliefsOf<Or>),
}

#[derive(Debug, Clone)]
pub(super) struct BeliefsOf<M: FusionMethod> {
    pub method: M,
    pub pages: Pages<M::Belief>,
}

impl<M: FusionMethod> BeliefsOf<M> {
    pub fn new(method: M, voxel_count: usize) -> BeliefsOf<M> {
        BeliefsOf { method, pages: Pages::new(voxel_count, M::NO_BELIEF) }
    }

    fn update(&mut self, looks: &[VoxelLook], history: &History, now: &[Instant]) {
        let after: Vec<(u32, M::Belief)> = looks
            .par_chunk_by(|a, b| a.voxel_id == b.voxel_id)
            .map(|looks| {
                let id = looks[0].voxel_id;
                let elapsed = history.elapsed(id, newest(looks, now));
                let before = elapsed.map(|elapsed| (self.pages.get(id as usize), elapsed));
                (id, self.method.update(before, looks))
            })
            .collect();
        for (id, belief) in after {
            *self.pages.get_mut(id as usize) = belief;
        }
    }

    fn probability(&self, id: u32, since: Option<Elapsed>) -> f64 {
        match since {
            Some(since) => self.method.probability(self.pages.get(id as usize), since),
            None => self.method.unseen_probability(),
        }
    }
}

impl Beliefs {
    pub fn new(method: Method, voxel_count: usize) -> Beliefs {
        match method {
            Method::Paper(paper) => Beliefs::Paper(BeliefsOf::new(paper, voxel_count)),
            Method::Or(or) => Beliefs::Or(BeliefsOf::new(or, voxel_count)),
        }
    }

    pub fn method(&self) -> Method {
        match self {
            Beliefs::Paper(beliefs) => Method::Paper(beliefs.method),
            Beliefs::Or(beliefs) => Method::Or(beliefs.method),
        }
    }

    /// Takes in what the views of an instant say, sorted by voxel; `now` is when each view was taken. `history`
    /// is as it was before.
    pub fn update(&mut self, looks: &[VoxelLook], history: &History, now: &[Instant]) {
        each_method!(self, Beliefs, beliefs => beliefs.update(looks, history, now));
    }

    /// Probability of crowd that long after the last look, or where nobody has looked.
    pub fn probability(&self, id: u32, since: Option<Elapsed>) -> f64 {
        each_method!(self, Beliefs, beliefs => beliefs.probability(id, since))
    }
}
