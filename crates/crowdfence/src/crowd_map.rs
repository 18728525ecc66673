//! The crowd map: probability of crowd per terrain voxel over time. One instant is project -> method -> store.
//!
//! Decay is lazy: a voxel keeps its belief as of its last look and when that was, so an update costs what was
//! seen, never the map, and reading at any later stamp is exact.

mod beliefs;
mod columns;
mod file;
mod fuse;
mod history;
mod instants;
mod pages;
mod quiet;
mod reading;
mod shown;
mod voxel_state;

use std::borrow::Cow;
use std::collections::BTreeSet;
use std::sync::Arc;

use rayon::prelude::*;

use crate::back_projection::{Projection, project};
use crate::error::{Error, Result, require};
use crate::method::{FusionMethod, InstantOrder, Method, each_method};
use crate::observation::Observation;
use crate::stamp::{check_stamp, check_unit, seconds_between};
use crate::terrain::Terrain;
use crate::view::View;

pub use columns::{CrowdColumn, CrowdColumns};
pub use voxel_state::{VoxelKnowledge, VoxelState};

use beliefs::Beliefs;
use fuse::{Fused, Views, fuse};
use history::History;
use instants::Instant;
use quiet::Quiet;
use reading::{Reading, StateRule};

/// A view stamped this close to its instant counts as taken then. One that is older counts at its own stamp: what
/// it saw is as old as it is.
pub const SIMULTANEOUS_S: f64 = 1.0;

/// Belief in crowd per voxel of one terrain, and who looked when. Same views in, same map out, to the bit.
#[derive(Debug, Clone)]
pub struct CrowdMap {
    terrain: Arc<Terrain>,
    projection: Projection,
    max_gap_s: f64,
    history: History,
    beliefs: Beliefs,
    /// Pages without crowd: as the map fades, and as the last looks left them.
    quiet: Quiet,
    quiet_at_last_looks: Quiet,
}

/// What one instant changed.
#[derive(Debug, Clone, PartialEq)]
pub struct Update {
    /// Stamp of the instant.
    pub stamp_ns: i64,
    /// Voxels seen by any drone, sorted, and their probability after the instant.
    pub voxel_ids: Vec<u32>,
    /// P(A = 1) of each of `voxel_ids`, at `stamp_ns`.
    pub probability: Vec<f64>,
    /// One per view, in the order given.
    pub observations: Vec<Arc<Observation>>,
}

impl CrowdMap {
    /// The method decides which pixels show crowd: those above its `b_threshold`, whatever `projection` says.
    /// `max_gap_s` bounds the time between instants and between a view and its instant: a larger one is
    /// taken for a wrong clock.
    pub fn new(
        terrain: Arc<Terrain>,
        method: Method,
        projection: Projection,
        max_gap_s: f64,
    ) -> Result<CrowdMap> {
        require(max_gap_s > 0.0, "max_gap_s", max_gap_s, "> 0")?;
        let projection = projection.with_crowd_threshold(method.b_threshold())?;
        let voxel_count = terrain.voxel_count();
        Ok(CrowdMap {
            terrain,
            projection,
            max_gap_s,
            history: History::new(voxel_count),
            beliefs: Beliefs::new(method, voxel_count),
            quiet: Quiet::default(),
            quiet_at_last_looks: Quiet::default(),
        })
    }

    /// Takes in the views of one instant, each drone at most once. An error leaves the map as it was.
    pub fn integrate(&mut self, views: &[View], stamp_ns: i64) -> Result<Update> {
        self.check_instant(stamp_ns, views.iter().map(|view| (view.drone.as_str(), view.stamp_ns)))?;
        let observations: Vec<Observation> =
            views.par_iter().map(|view| project(view, &self.terrain, &self.projection)).collect();
        self.integrate_observations(observations, stamp_ns)
    }

    /// The same for views that were projected before, here or on another machine.
    pub fn integrate_observations(
        &mut self,
        observations: Vec<impl Into<Arc<Observation>>>,
        stamp_ns: i64,
    ) -> Result<Update> {
        let observations: Vec<Arc<Observation>> = observations.into_iter().map(Into::into).collect();
        self.check_instant(stamp_ns, observations.iter().map(|seen| (seen.drone(), seen.stamp_ns())))?;
        for observation in &observations {
            self.terrain.key().check_same(observation.terrain(), "observation")?;
        }
        let now = Instant { stamp_ns, number: self.history.instants.integrated };
        let taken = instants_of(&observations, now);
        let drones: Vec<u32> = observations.iter().map(|seen| self.history.enlist(seen.drone())).collect();
        let views = Views { observations: &observations, drones: &drones, taken: &taken };
        let fused = each_method!(&mut self.beliefs, Beliefs, beliefs => {
            fuse(beliefs, &mut self.history, views, now)
        });
        self.quiet.wrote(&fused.pages, stamp_ns);
        self.quiet_at_last_looks.wrote(&fused.pages_at_last_looks(), columns::NEVER_LATER_NS);
        self.remember(&observations, &fused.untold, stamp_ns);
        self.history.remember_shown(&fused.shown);
        let Fused { voxel_ids, probability, .. } = fused;
        Ok(Update { stamp_ns, voxel_ids, probability, observations })
    }

    /// Stores who saw what, and what nobody could see; `untold` are the voxels of each view that it does not count for.
    fn remember(&mut self, observations: &[Arc<Observation>], untold: &[Vec<u32>], stamp_ns: i64) {
        for (observation, untold) in observations.iter().zip(untold) {
            self.history.hide(observation.occluded_ids());
            let ids = match untold.as_slice() {
                [] => Cow::from(observation.voxel_ids()),
                untold => Cow::from(without(observation.voxel_ids(), untold)),
            };
            self.history.add_seen(observation.drone(), &ids);
        }
        self.history.instants.integrated += 1;
        let (first_ns, newest_ns) = self.history.instants.span_ns.unwrap_or((stamp_ns, stamp_ns));
        self.history.instants.span_ns = Some((first_ns.min(stamp_ns), newest_ns.max(stamp_ns)));
    }

    /// Probability of crowd of every voxel at a stamp not before the last instant. A voxel that nobody has seen
    /// holds the method's initial value, which says nothing about the place: see [`CrowdMap::state`].
    pub fn probability(&self, stamp_ns: i64) -> Result<Vec<f64>> {
        let ids = (0..self.terrain.voxel_count() as u32).into_par_iter();
        self.probability_at(ids, stamp_ns)
    }

    /// The same for some voxels; an error for an id that the terrain does not have, as below.
    pub fn probability_of(&self, ids: &[u32], stamp_ns: i64) -> Result<Vec<f64>> {
        self.check_ids(ids)?;
        self.probability_at(ids.par_iter().copied(), stamp_ns)
    }

    fn probability_at(
        &self,
        ids: impl IndexedParallelIterator<Item = u32>,
        stamp_ns: i64,
    ) -> Result<Vec<f64>> {
        let now = self.moment(stamp_ns)?;
        Ok(each_method!(&self.beliefs, Beliefs, beliefs => {
            let reading = Reading::new(beliefs, &self.history, now);
            ids.map(|id| reading.probability(id)).collect()
        }))
    }

    /// Bounds between which the probability of some voxels lies at `level`, in (0, 1); None where the method has
    /// none. Where nobody has looked they are 0 and 1.
    pub fn interval_of(&self, ids: &[u32], stamp_ns: i64, level: f64) -> Result<Option<Vec<[f64; 2]>>> {
        self.check_ids(ids)?;
        let now = self.moment(stamp_ns)?;
        require(level > 0.0 && level < 1.0, "level", level, "strictly between 0 and 1")?;
        Ok(each_method!(&self.beliefs, Beliefs, beliefs => {
            let reading = Reading::new(beliefs, &self.history, now);
            beliefs.method.interval(None, level).map(|_| {
                ids.par_iter().filter_map(|&id| reading.interval(id, level)).collect()
            })
        }))
    }

    /// The voxels that somebody has seen, sorted, and their probability of crowd, in one go.
    pub fn seen_probability(&self, stamp_ns: i64) -> Result<(Vec<u32>, Vec<f64>)> {
        let now = self.moment(stamp_ns)?;
        let seen = each_method!(&self.beliefs, Beliefs, beliefs => {
            Reading::new(beliefs, &self.history, now).of_seen(|id, p| Some((id, p)))
        });
        Ok(seen.into_iter().unzip())
    }

    /// What is known about every voxel: crowd is P >= `threshold`; what is not crowd is empty only where the method
    /// clears it, and stale once that was more than `stale_after_s` ago. What no look left empty stays not cleared.
    pub fn state(&self, stamp_ns: i64, threshold: f64, stale_after_s: f64) -> Result<Vec<VoxelState>> {
        let now = self.moment(stamp_ns)?;
        let rule = StateRule::new(threshold, stale_after_s)?;
        let ids = (0..self.terrain.voxel_count() as u32).into_par_iter();
        Ok(each_method!(&self.beliefs, Beliefs, beliefs => {
            let reading = Reading::new(beliefs, &self.history, now);
            ids.map(|id| reading.state(id, rule)).collect()
        }))
    }

    /// The voxels that are [`VoxelState::Empty`] by the same rules, sorted. Costs what was seen, not the map.
    pub fn empty_ids(&self, stamp_ns: i64, threshold: f64, stale_after_s: f64) -> Result<Vec<u32>> {
        let now = self.moment(stamp_ns)?;
        let rule = StateRule::new(threshold, stale_after_s)?;
        Ok(each_method!(&self.beliefs, Beliefs, beliefs => {
            Reading::new(beliefs, &self.history, now).empty_ids(rule)
        }))
    }

    /// All that is known about some voxels; states as in [`CrowdMap::state`].
    pub fn knowledge(
        &self,
        ids: &[u32],
        stamp_ns: i64,
        threshold: f64,
        stale_after_s: f64,
    ) -> Result<Vec<VoxelKnowledge>> {
        self.check_ids(ids)?;
        let now = self.moment(stamp_ns)?;
        let rule = StateRule::new(threshold, stale_after_s)?;
        Ok(each_method!(&self.beliefs, Beliefs, beliefs => {
            let reading = Reading::new(beliefs, &self.history, now);
            ids.par_iter().map(|&id| reading.knowledge(id, rule)).collect()
        }))
    }

    fn check_ids(&self, ids: &[u32]) -> Result<()> {
        ids.iter().max().map_or(Ok(()), |&largest| self.terrain.check_id(largest.into()).map(drop))
    }

    /// Voxels that somebody has seen, sorted: the union of the fields of view so far (equation 4). Costs what
    /// was seen, not the map.
    pub fn seen_ids(&self) -> Vec<u32> {
        self.history.seen_ids()
    }

    /// How many voxels somebody has seen.
    pub fn seen_count(&self) -> usize {
        self.history.instants.voxels()
    }

    /// Stamp of the last look at every voxel, None = never.
    pub fn last_seen_ns(&self) -> impl Iterator<Item = Option<i64>> + '_ {
        (0..self.terrain.voxel_count() as u32).map(|id| self.last_look_ns(id))
    }

    /// The same for some voxels.
    pub fn last_seen_ns_of(&self, ids: &[u32]) -> Result<Vec<Option<i64>>> {
        self.check_ids(ids)?;
        Ok(ids.iter().map(|&id| self.last_look_ns(id)).collect())
    }

    fn last_look_ns(&self, id: u32) -> Option<i64> {
        self.history.last_look(id).map(|look| look.stamp_ns)
    }

    /// Drones that have ever seen one of the voxels, by name.
    pub fn seen_by(&self, ids: &[u32]) -> Result<Vec<&str>> {
        self.check_ids(ids)?;
        Ok(self.history.seen_by(ids))
    }

    /// Every drone that ever gave a view, by name.
    pub fn drones(&self) -> impl Iterator<Item = &str> {
        self.history.drones()
    }

    /// The terrain whose voxels it is about.
    pub fn terrain(&self) -> &Arc<Terrain> {
        &self.terrain
    }

    /// How looks become belief, with its parameters.
    pub fn method(&self) -> Method {
        self.beliefs.method()
    }

    /// How views become observations. Its crowd threshold is the method's.
    pub fn projection(&self) -> &Projection {
        &self.projection
    }

    /// Longest time between instants, and between a view and its instant, seconds.
    pub fn max_gap_s(&self) -> f64 {
        self.max_gap_s
    }

    /// Instants integrated so far.
    pub fn instant_count(&self) -> u64 {
        self.history.instants.integrated
    }

    /// Stamps of the first and of the newest instant.
    pub fn span_ns(&self) -> Option<(i64, i64)> {
        self.history.instants.span_ns
    }

    /// Refuses an instant that cannot be integrated now; each drone comes with the stamp of its view.
    fn check_instant<'a>(
        &self,
        stamp_ns: i64,
        views: impl Iterator<Item = (&'a str, i64)> + Clone,
    ) -> Result<()> {
        self.check_order(stamp_ns)?;
        for (drone, view_ns) in views.clone() {
            let late_s = seconds_between(view_ns, stamp_ns);
            if late_s > self.max_gap_s || late_s < -SIMULTANEOUS_S {
                let bound_s = if late_s > 0.0 { self.max_gap_s } else { SIMULTANEOUS_S };
                return Err(Error::ViewStamp { drone: drone.to_owned(), offset_s: -late_s, bound_s });
            }
        }
        self.check_drones(views.map(|(drone, _)| drone))
    }

    fn check_order(&self, stamp_ns: i64) -> Result<()> {
        check_stamp(stamp_ns)?;
        let Some(last_ns) = self.history.instants.newest_ns() else {
            return Ok(());
        };
        let order = each_method!(&self.beliefs, Beliefs, beliefs => order_of(&beliefs.method));
        if order == InstantOrder::ByTime && stamp_ns <= last_ns {
            return Err(Error::StampNotAfter { stamp_ns, last_ns });
        }
        check_unit(last_ns, stamp_ns)?;
        let gap_s = seconds_between(last_ns, stamp_ns);
        if gap_s.abs() > self.max_gap_s {
            return Err(Error::StampJump { stamp_ns, gap_s, bound_s: self.max_gap_s });
        }
        Ok(())
    }

    /// Each drone at most once, and no more of them over time than the method allows.
    fn check_drones<'a>(&self, here: impl Iterator<Item = &'a str> + Clone) -> Result<()> {
        let mut seen_here = BTreeSet::new();
        for drone in here.clone() {
            if !seen_here.insert(drone) {
                return Err(Error::DuplicateDrone { drone: drone.to_owned() });
            }
        }
        let Some(fleet_size) = self.method().max_drones() else {
            return Ok(());
        };
        let newcomers = here.filter(|drone| !self.history.knows(drone));
        for (drone, count) in newcomers.zip(self.history.drones().count() + 1..) {
            if count > fleet_size {
                return Err(Error::FleetTooLarge { drone: drone.to_owned(), count, fleet_size });
            }
        }
        Ok(())
    }

    /// The moment at which the map is read.
    fn moment(&self, stamp_ns: i64) -> Result<Instant> {
        check_stamp(stamp_ns)?;
        match self.history.instants.newest_ns() {
            Some(last_ns) if stamp_ns < last_ns => Err(Error::ReadInPast { stamp_ns, last_ns }),
            _ => Ok(Instant { stamp_ns, number: self.history.instants.integrated.saturating_sub(1) }),
        }
    }
}

/// A probability from which a voxel is called crowd.
fn check_threshold(threshold: f64) -> Result<()> {
    require(threshold > 0.0 && threshold <= 1.0, "threshold", threshold, "in (0, 1]")
}

fn order_of<M: FusionMethod>(_: &M) -> InstantOrder {
    M::ORDER
}

/// When each view of the instant `now` counts as taken.
fn instants_of(observations: &[Arc<Observation>], now: Instant) -> Vec<Instant> {
    let taken_ns = |view_ns| {
        let is_simultaneous = seconds_between(view_ns, now.stamp_ns) <= SIMULTANEOUS_S;
        if is_simultaneous { now.stamp_ns } else { view_ns }
    };
    observations.iter().map(|seen| Instant { stamp_ns: taken_ns(seen.stamp_ns()), ..now }).collect()
}

/// Sorted ids but for some of them, sorted too.
fn without(ids: &[u32], some: &[u32]) -> Vec<u32> {
    let mut left_out = some.iter().peekable();
    ids.iter().filter(|id| left_out.next_if_eq(id).is_none()).copied().collect()
}

#[cfg(test)]
mod tests;
