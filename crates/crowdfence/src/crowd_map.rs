//! The crowd map: probability of crowd per terrain voxel over time. One instant is project, pool, blend.
//!
//! Decay is lazy: a voxel keeps P~ as of its last look and the number of the instant of that look, so an
//! update costs what was seen, never the map, and reading at any later stamp is exact.

mod belief;
mod file;
mod method;

use std::collections::BTreeSet;
use std::sync::Arc;

use rayon::prelude::*;

use crate::back_projection::{Observation, Projection, project};
use crate::error::{Error, Result, require};
use crate::terrain::Terrain;
use crate::view::View;

pub use belief::{Look, VoxelState};
pub use method::{Decay, Initial, Method, Or, Paper};

use belief::BeliefStore;

#[derive(Debug, Clone)]
pub struct CrowdMap {
    terrain: Arc<Terrain>,
    method: Method,
    projection: Projection,
    max_gap_s: f64,
    /// Every drone that has ever given a view.
    drones: BTreeSet<String>,
    /// Stamps of the instants so far; beliefs refer to them by number.
    stamps_ns: Vec<i64>,
    beliefs: BeliefStore,
}

/// What one instant changed.
#[derive(Debug, Clone)]
pub struct Update {
    pub stamp_ns: i64,
    /// Voxels seen by any drone, sorted, and their probability after the instant.
    pub voxel_ids: Vec<u32>,
    pub probability: Vec<f64>,
    /// One per view, in the order given.
    pub observations: Vec<Observation>,
}

impl CrowdMap {
    /// `max_gap_s` bounds the time between instants and between a view and its instant: a larger one is
    /// taken for a wrong clock.
    pub fn new(
        terrain: Arc<Terrain>,
        method: Method,
        projection: Projection,
        max_gap_s: f64,
    ) -> Result<CrowdMap> {
        require(max_gap_s > 0.0, "max_gap_s", max_gap_s, "> 0")?;
        Ok(CrowdMap {
            beliefs: BeliefStore::new(terrain.voxel_count()),
            terrain,
            method,
            projection,
            max_gap_s,
            drones: BTreeSet::new(),
            stamps_ns: Vec::new(),
        })
    }

    /// Takes in the views of one instant, each drone at most once: project, pool, blend. An error leaves the
    /// map as it was.
    pub fn integrate(&mut self, views: &[View], stamp_ns: i64) -> Result<Update> {
        self.check_stamp(stamp_ns)?;
        self.check_view_stamps(views, stamp_ns)?;
        self.check_drones(views.iter().map(|view| view.drone.as_str()))?;
        let observations: Vec<Observation> =
            views.par_iter().map(|view| project(view, &self.terrain, &self.projection)).collect();
        let drones: Vec<&str> = views.iter().map(|view| view.drone.as_str()).collect();
        self.integrate_observations(&drones, observations, stamp_ns)
    }

    /// The same for views that were projected before, onto this terrain: pool, blend. One drone an
    /// observation.
    pub fn integrate_observations(
        &mut self,
        drones: &[&str],
        observations: Vec<Observation>,
        stamp_ns: i64,
    ) -> Result<Update> {
        self.check_stamp(stamp_ns)?;
        if drones.len() != observations.len() {
            return Err(Error::Length { name: "drones", actual: drones.len(), expected: observations.len() });
        }
        let fleet = self.check_drones(drones.iter().copied())?;
        for &id in
            observations.iter().flat_map(|o| o.voxel_ids.last().into_iter().chain(o.occluded_ids.last()))
        {
            self.terrain.check_id(i64::from(id))?; // ids are sorted: the last one is the largest
        }

        let seen = by_voxel(&observations);
        let probability: Vec<f64> = seen.par_iter().map(|(id, m)| self.fuse(*id, m, stamp_ns)).collect();

        let instant = self.stamps_ns.len() as u32;
        for ((id, _), &p) in seen.iter().zip(&probability) {
            self.beliefs.store(*id, p, instant);
        }
        for &id in observations.iter().flat_map(|o| &o.occluded_ids) {
            self.beliefs.mark_occluded(id);
        }
        self.drones = fleet;
        self.stamps_ns.push(stamp_ns);
        let voxel_ids = seen.into_iter().map(|(id, _)| id).collect();
        Ok(Update { stamp_ns, voxel_ids, probability, observations })
    }

    /// Pool, then blend: the new P~ of a voxel that the drones with mean values `m` see now.
    fn fuse(&self, id: u32, m: &[f64], stamp_ns: i64) -> f64 {
        match &self.method {
            Method::Or(or) => {
                let before = self.beliefs.belief(id).map_or(0.0, |belief| belief.probability);
                if m.iter().any(|&m| m > or.b_threshold()) { 1.0 } else { before }
            }
            Method::Paper(paper) => {
                let pooled = paper.pool.pool(m, paper.fleet_size);
                match (self.beliefs.belief(id), paper.initial_probability()) {
                    (Some(belief), _) => {
                        // The instant being integrated is one further than those stored.
                        let elapsed = self.elapsed(belief.instant, stamp_ns, self.stamps_ns.len());
                        paper.blend.blend(belief.probability, elapsed, pooled)
                    }
                    (None, Some(initial)) => paper.blend.blend(initial, 0.0, pooled),
                    (None, None) => pooled,
                }
            }
        }
    }

    /// Time since `instant` in the unit of the method's decay.
    fn elapsed(&self, instant: u32, stamp_ns: i64, now: usize) -> f64 {
        match self.method.decay() {
            Decay::PerSecond => seconds_between(self.stamps_ns[instant as usize], stamp_ns),
            Decay::PerFrame => (now - instant as usize) as f64,
        }
    }

    /// P~ of every voxel at a stamp not before the last instant. A voxel that nobody has seen holds the
    /// method's initial value, which says nothing about the place: see [`CrowdMap::state`].
    pub fn probability(&self, stamp_ns: i64) -> Result<Vec<f64>> {
        self.check_read(stamp_ns)?;
        Ok((0..self.terrain.voxel_count() as u32)
            .into_par_iter()
            .map(|id| self.probability_now(id, stamp_ns))
            .collect())
    }

    /// The same for some voxels.
    pub fn probability_of(&self, ids: &[u32], stamp_ns: i64) -> Result<Vec<f64>> {
        self.check_read(stamp_ns)?;
        Ok(ids.par_iter().map(|&id| self.probability_now(id, stamp_ns)).collect())
    }

    fn probability_now(&self, id: u32, stamp_ns: i64) -> f64 {
        match (self.beliefs.belief(id), &self.method) {
            (None, method) => method.unseen_probability(),
            (Some(belief), Method::Or(_)) => belief.probability,
            (Some(belief), Method::Paper(paper)) => {
                let last = self.stamps_ns.len() - 1;
                paper.blend.fade(belief.probability, self.elapsed(belief.instant, stamp_ns, last))
            }
        }
    }

    /// What is known about every voxel: crowd is P~ >= `threshold`, and what is not crowd is stale once its
    /// last look is more than `stale_after_s` old.
    pub fn state(&self, stamp_ns: i64, threshold: f64, stale_after_s: f64) -> Result<Vec<VoxelState>> {
        self.check_read(stamp_ns)?;
        require(threshold > 0.0 && threshold <= 1.0, "threshold", threshold, "in (0, 1]")?;
        require(stale_after_s >= 0.0, "stale_after_s", stale_after_s, ">= 0")?;
        let state = |id: u32| match self.beliefs.look(id) {
            Look::Never => VoxelState::NeverSeen,
            Look::Occluded => VoxelState::Occluded,
            Look::At(_) if self.probability_now(id, stamp_ns) >= threshold => VoxelState::Crowd,
            Look::At(instant)
                if seconds_between(self.stamps_ns[instant as usize], stamp_ns) > stale_after_s =>
            {
                VoxelState::Stale
            }
            Look::At(_) => VoxelState::Empty,
        };
        Ok((0..self.terrain.voxel_count() as u32).into_par_iter().map(state).collect())
    }

    /// Voxels that somebody has seen, sorted: the union of the fields of view so far (equation 4). Costs what
    /// was seen, not the map.
    pub fn seen_ids(&self) -> Vec<u32> {
        self.beliefs.seen_ids()
    }

    /// Stamp of the last look at every voxel, None = never.
    pub fn last_seen_ns(&self) -> impl Iterator<Item = Option<i64>> + '_ {
        (0..self.terrain.voxel_count() as u32).map(|id| match self.beliefs.look(id) {
            Look::At(instant) => Some(self.stamps_ns[instant as usize]),
            Look::Never | Look::Occluded => None,
        })
    }

    pub fn terrain(&self) -> &Arc<Terrain> {
        &self.terrain
    }

    pub fn method(&self) -> &Method {
        &self.method
    }

    pub fn projection(&self) -> &Projection {
        &self.projection
    }

    pub fn max_gap_s(&self) -> f64 {
        self.max_gap_s
    }

    pub fn stamps_ns(&self) -> &[i64] {
        &self.stamps_ns
    }

    fn check_stamp(&self, stamp_ns: i64) -> Result<()> {
        let Some(&last_ns) = self.stamps_ns.last() else {
            return Ok(());
        };
        if stamp_ns <= last_ns {
            return Err(Error::StampNotAfter { stamp_ns, last_ns });
        }
        let gap_s = seconds_between(last_ns, stamp_ns);
        if gap_s > self.max_gap_s {
            return Err(Error::StampJump { stamp_ns, gap_s, bound_s: self.max_gap_s });
        }
        Ok(())
    }

    fn check_read(&self, stamp_ns: i64) -> Result<()> {
        match self.stamps_ns.last() {
            Some(&last_ns) if stamp_ns < last_ns => Err(Error::ReadInPast { stamp_ns, last_ns }),
            _ => Ok(()),
        }
    }

    fn check_view_stamps(&self, views: &[View], stamp_ns: i64) -> Result<()> {
        for view in views {
            let offset_s = seconds_between(stamp_ns, view.stamp_ns);
            if offset_s.abs() > self.max_gap_s {
                let (drone, bound_s) = (view.drone.clone(), self.max_gap_s);
                return Err(Error::ViewStamp { drone, offset_s, bound_s });
            }
        }
        Ok(())
    }

    /// The drones known after an instant with these.
    fn check_drones<'a>(&self, here: impl Iterator<Item = &'a str>) -> Result<BTreeSet<String>> {
        let mut fleet = self.drones.clone();
        let mut seen_here = BTreeSet::new();
        for drone in here {
            if !seen_here.insert(drone) {
                return Err(Error::DuplicateDrone { drone: drone.to_owned() });
            }
            fleet.insert(drone.to_owned());
            if fleet.len() > self.method.fleet_size() {
                return Err(Error::FleetTooLarge {
                    drone: drone.to_owned(),
                    count: fleet.len(),
                    fleet_size: self.method.fleet_size(),
                });
            }
        }
        Ok(fleet)
    }
}

fn seconds_between(from_ns: i64, to_ns: i64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 / 1e9
}

/// Voxels that any view sees, sorted by id, each with the values m of the views that see it, in view order.
fn by_voxel(observations: &[Observation]) -> Vec<(u32, Vec<f64>)> {
    let mut looks: Vec<(u32, usize, f64)> = observations
        .iter()
        .enumerate()
        .flat_map(|(view, o)| o.voxel_ids.iter().zip(&o.mean).map(move |(&id, &m)| (id, view, m)))
        .collect();
    looks.par_sort_unstable_by_key(|&(id, view, _)| (id, view));
    looks
        .chunk_by(|a, b| a.0 == b.0)
        .map(|group| (group[0].0, group.iter().map(|&(_, _, m)| m).collect()))
        .collect()
}

#[cfg(test)]
mod tests;
