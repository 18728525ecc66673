//! The columns of the terrain that hold crowd: the ground that zones are drawn on.

use rayon::prelude::*;

use super::beliefs::Beliefs;
use super::quiet::Quiet;
use super::reading::Reading;
use super::{CrowdMap, check_threshold};
use crate::error::Result;
use crate::method::{FusionMethod, each_method};

/// Crowd seen from above.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CrowdColumns {
    /// Every column with one of the voxels that were asked for, sorted by i, then j.
    pub columns: Vec<CrowdColumn>,
    /// Those voxels, column by column, sorted within each.
    pub voxel_ids: Vec<u32>,
}

/// One column of voxels, of which at least one was asked for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrowdColumn {
    /// Grid index along x.
    pub i: i32,
    /// Grid index along y.
    pub j: i32,
    /// Grid index k of the lowest voxel of the terrain there.
    pub bottom: i32,
    /// Grid index k of the highest.
    pub top: i32,
    /// How many of its voxels were asked for.
    pub crowd_count: u32,
    /// Largest probability of these.
    pub probability: f64,
    /// Newest look at any of these: a look at a roof says nothing about who stands below it.
    pub last_seen_ns: i64,
}

impl CrowdMap {
    /// The columns that hold crowd, P >= `threshold`, at a stamp not before the last instant; costs what
    /// [`CrowdMap::crowd_ids`] costs.
    pub fn crowd_columns(&self, stamp_ns: i64, threshold: f64) -> Result<CrowdColumns> {
        self.columns_of(&self.crowd_ids(stamp_ns, threshold)?, stamp_ns)
    }

    /// The voxels that hold crowd, P >= `threshold`, at a stamp not before the last instant, sorted.
    ///
    /// Costs what holds crowd and what was seen since the last call, where nothing becomes crowd by being forgotten
    /// ([`FusionMethod::stays_below`]), and what was seen so far elsewhere.
    pub fn crowd_ids(&self, stamp_ns: i64, threshold: f64) -> Result<Vec<u32>> {
        let now = self.moment(stamp_ns)?;
        check_threshold(threshold)?;
        Ok(each_method!(&self.beliefs, Beliefs, beliefs => {
            let reading = Reading::new(beliefs, &self.history, now);
            if reading.method().stays_below(threshold) {
                self.crowd_of(&reading, &self.quiet, stamp_ns, threshold)
            } else {
                reading.of_seen(|id, p| (p >= threshold).then_some(id))
            }
        }))
    }

    /// The voxels that held crowd, P >= `threshold`, when somebody last looked, sorted. What was forgotten since
    /// takes none away, and crowd that a late view showed is among them. Costs as [`CrowdMap::crowd_ids`] at best.
    pub fn crowd_ids_at_last_looks(&self, threshold: f64) -> Result<Vec<u32>> {
        check_threshold(threshold)?;
        let Some(stamp_ns) = self.history.instants.newest_ns() else { return Ok(vec![]) };
        let now = self.moment(stamp_ns)?;
        Ok(each_method!(&self.beliefs, Beliefs, beliefs => {
            let reading = Reading::at_last_looks(beliefs, &self.history, now);
            self.crowd_of(&reading, &self.quiet_at_last_looks, NEVER_LATER_NS, threshold)
        }))
    }

    /// The voxels that a look of the last 2 s by itself showed as crowd, clearly above `threshold`, whatever other drones
    /// saw there; at a stamp not before the last instant, sorted. None where the method does not tell looks apart.
    pub fn shown_ids(&self, stamp_ns: i64, threshold: f64) -> Result<Vec<u32>> {
        self.moment(stamp_ns)?;
        check_threshold(threshold)?;
        Ok(self.history.shown.ids(stamp_ns, threshold))
    }

    /// The voxels that were shown so when somebody last looked at them, sorted: since then nobody has looked who could
    /// have told otherwise.
    pub fn shown_ids_at_last_looks(&self, threshold: f64) -> Result<Vec<u32>> {
        check_threshold(threshold)?;
        Ok(self.history.shown.ids_at_last_looks(threshold))
    }

    /// Whether the last look at each of some voxels spoke for crowd: it left more of it than there was, and more than
    /// the method holds of ground that nobody has seen. Files that older builds wrote do not say so of any look.
    pub fn spoke_for_crowd(&self, ids: &[u32]) -> Result<Vec<bool>> {
        self.check_ids(ids)?;
        Ok(ids.iter().map(|&id| self.history.spoke_for_crowd(id)).collect())
    }

    /// The voxels at or above a threshold; pages that hold none are known to `quiet`, as of `stamp_ns`.
    fn crowd_of<M: FusionMethod>(
        &self,
        reading: &Reading<'_, M>,
        quiet: &Quiet,
        stamp_ns: i64,
        threshold: f64,
    ) -> Vec<u32> {
        let mut pages = quiet.take(threshold, self.history.looks.written().map(|(number, _)| number));
        let numbers = pages.to_read(stamp_ns);
        let mut crowd = Vec::new();
        for (&number, (largest, ids)) in numbers.iter().zip(reading.crowd_of(&numbers, threshold)) {
            pages.found(number, largest, stamp_ns);
            crowd.extend(ids);
        }
        quiet.put(pages);
        crowd
    }

    /// The columns of some voxels, each given once and in any order, at a stamp not before the last instant. Of
    /// voxels that nobody has seen nothing is told.
    pub fn columns_of(&self, ids: &[u32], stamp_ns: i64) -> Result<CrowdColumns> {
        self.check_ids(ids)?;
        let now = self.moment(stamp_ns)?;
        let seen = ids.iter().filter_map(|&id| self.history.last_look(id).map(|look| (id, look.stamp_ns)));
        let mut voxels: Vec<(u32, i64)> = seen.collect();
        voxels.par_sort_unstable();
        let seen_ids: Vec<u32> = voxels.iter().map(|voxel| voxel.0).collect();
        let probability: Vec<f64> = each_method!(&self.beliefs, Beliefs, beliefs => {
            let reading = Reading::new(beliefs, &self.history, now);
            seen_ids.par_iter().map(|&id| reading.probability(id)).collect()
        });
        let mut placed: Vec<Placed> = self
            .terrain
            .indices_of(&seen_ids)
            .iter()
            .zip(voxels)
            .zip(probability)
            .map(|((&[i, j, _], (id, seen_ns)), probability)| Placed {
                column: [i, j],
                id,
                seen_ns,
                probability,
            })
            .collect();
        placed.par_sort_by_key(|voxel| voxel.column);
        let columns: Vec<&[Placed]> = placed.chunk_by(|a, b| a.column == b.column).collect();
        Ok(CrowdColumns {
            columns: columns.par_iter().map(|voxels| self.column(voxels)).collect(),
            voxel_ids: placed.iter().map(|voxel| voxel.id).collect(),
        })
    }

    /// The column of some voxels, at least one.
    fn column(&self, voxels: &[Placed]) -> CrowdColumn {
        let [i, j] = voxels[0].column;
        let heights = self.terrain.column(i, j).map(|(k, _)| k);
        let (bottom, top) = heights.fold((i32::MAX, i32::MIN), |(low, high), k| (low.min(k), high.max(k)));
        CrowdColumn {
            i,
            j,
            bottom,
            top,
            crowd_count: voxels.len() as u32,
            probability: voxels.iter().fold(0.0, |largest, voxel| voxel.probability.max(largest)),
            last_seen_ns: voxels.iter().fold(i64::MIN, |newest, voxel| voxel.seen_ns.max(newest)),
        }
    }
}

/// What a page was at the last looks, it is at every stamp.
pub(super) const NEVER_LATER_NS: i64 = 0;

/// One of the voxels that were asked for.
struct Placed {
    column: [i32; 2],
    id: u32,
    seen_ns: i64,
    probability: f64,
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::back_projection::{Coverage, Projection};
    use crate::crowd_map::VoxelState;
    use crate::method::{
        DecayUnit, Evidence, EvidenceSettings, FromBelow, Initial, LikelihoodRatio, Method, Or, Paper,
    };
    use crate::observation::{CrowdMass, Observation, SeenVoxels};
    use crate::opinion_pool::{OpinionPool, Rates, Unseen};
    use crate::temporal_blend::TemporalBlend;
    use crate::terrain::Terrain;

    const SECOND: i64 = 1_000_000_000;
    const THRESHOLD: f64 = 0.3;

    /// One drone that is sure of crowd makes P = .9, sure of none .1; P halves every 10 s.
    fn paper() -> Method {
        let pool = OpinionPool::new(Rates::new(0.9, 0.1).unwrap(), 0.5, 0.5, Unseen::Visible, false).unwrap();
        let blend = TemporalBlend::new(1.0, std::f64::consts::LN_2 / 10.0).unwrap();
        Method::Paper(Paper::new(pool, blend, 1, Initial::Zero, DecayUnit::Second).unwrap())
    }

    /// A look says between an evidence of -1 and of 1.7 above the prior; a third of it is left after 10 s.
    fn evidence(prior: f64) -> Method {
        let ratios = vec![-2.0, 0.3, 1.4, 2.0, 3.4];
        let likelihood = LikelihoodRatio::new(vec![], vec![], vec![0.2, 0.4, 0.6, 0.8], ratios).unwrap();
        let settings = EvidenceSettings {
            prior,
            memory_s: 10.0,
            sharp_gsd_m: 1.0,
            doubt: 1.0,
            agreement: 0.5,
            threshold: 0.5,
            cleared: prior / 2.0,
            focal_px: 100.0,
            from_below: FromBelow::For,
        };
        Method::Evidence(Evidence::new(Arc::new(likelihood), settings).unwrap())
    }

    fn map(voxels: &[[i32; 3]], method: Method) -> CrowdMap {
        let terrain = Arc::new(Terrain::from_indices(voxels, 1.0, DVec3::ZERO).unwrap());
        CrowdMap::new(terrain, method, Projection::new(100.0, 0.0, Coverage::Rays).unwrap(), 3600.0).unwrap()
    }

    /// One drone says what it thinks of some voxels, at second `second`.
    fn look(map: &mut CrowdMap, second: i64, means: &BTreeMap<u32, f64>) {
        look_at(map, second * SECOND, 0, means);
    }

    /// The instant is `late_ns` after the view was taken.
    fn look_at(map: &mut CrowdMap, stamp_ns: i64, late_ns: i64, means: &BTreeMap<u32, f64>) {
        let seen = SeenVoxels {
            ids: means.keys().copied().collect(),
            mean: means.values().copied().collect(),
            pixel_count: vec![1; means.len()],
            range_m: vec![10.0; means.len()],
            tilt_deg: vec![90.0; means.len()],
        };
        let (key, taken_ns) = (map.terrain.key(), stamp_ns - late_ns);
        let observation = Observation::new(key, "a", taken_ns, seen, vec![], CrowdMass::default()).unwrap();
        map.integrate_observations(vec![observation], stamp_ns).unwrap();
    }

    /// All voxels of the terrain, one by one.
    fn slow_columns(map: &CrowdMap, stamp_ns: i64) -> CrowdColumns {
        let probability = map.probability(stamp_ns).unwrap();
        let mut voxels: BTreeMap<[i32; 2], Vec<(i32, u32)>> = BTreeMap::new();
        for id in 0..map.terrain.voxel_count() as u32 {
            let [i, j, k] = map.terrain.index(id);
            voxels.entry([i, j]).or_default().push((k, id));
        }
        let mut crowd_columns = CrowdColumns::default();
        for ([i, j], column) in voxels {
            let seen: Vec<u32> =
                column.iter().map(|voxel| voxel.1).filter(|id| map.seen_ids().contains(id)).collect();
            let mut crowd: Vec<u32> = seen.clone();
            crowd.retain(|&id| probability[id as usize] >= THRESHOLD);
            if crowd.is_empty() {
                continue;
            }
            crowd.sort_unstable();
            crowd_columns.columns.push(CrowdColumn {
                i,
                j,
                bottom: column.iter().map(|voxel| voxel.0).min().unwrap(),
                top: column.iter().map(|voxel| voxel.0).max().unwrap(),
                crowd_count: crowd.len() as u32,
                probability: seen.iter().map(|&id| probability[id as usize]).reduce(f64::max).unwrap(),
                last_seen_ns: map.last_seen_ns_of(&crowd).unwrap().into_iter().max().unwrap().unwrap(),
            });
            crowd_columns.voxel_ids.extend(crowd);
        }
        crowd_columns
    }

    #[test]
    fn a_newer_look_below_the_crowd_says_nothing_of_it() {
        let mut map = map(&[[4, -7, 0], [4, -7, 9], [5, -7, 2]], paper());
        let id = |index| map.terrain.id(index).unwrap();
        let (ground, roof, beside) = (id([4, -7, 0]), id([4, -7, 9]), id([5, -7, 2]));
        look(&mut map, 0, &BTreeMap::from([(roof, 1.0), (beside, 0.25)]));
        look(&mut map, 10, &BTreeMap::from([(ground, 0.0)]));
        let seen = map.crowd_columns(10 * SECOND, THRESHOLD).unwrap();
        let column = CrowdColumn {
            i: 4,
            j: -7,
            bottom: 0,
            top: 9,
            crowd_count: 1,
            probability: map.probability_of(&[roof], 10 * SECOND).unwrap()[0],
            last_seen_ns: 0,
        };
        assert_eq!(seen, CrowdColumns { columns: vec![column], voxel_ids: vec![roof] });
        assert_eq!(map.crowd_columns(30 * SECOND, THRESHOLD).unwrap(), CrowdColumns::default());
    }

    #[test]
    fn a_threshold_out_of_bounds_and_a_stamp_in_the_past_are_refused() {
        let mut map = map(&[[0; 3]], Method::Or(Or::new(0.5).unwrap()));
        assert_eq!(map.crowd_columns(0, 0.5).unwrap(), CrowdColumns::default());
        look(&mut map, 1, &BTreeMap::from([(0, 1.0)]));
        assert!(map.crowd_columns(0, 0.5).unwrap_err().to_string().contains("cannot be read in its past"));
        for threshold in [0.0, 1.1, f64::NAN] {
            let message = map.crowd_columns(SECOND, threshold).unwrap_err().to_string();
            assert!(message.contains("it must be in (0, 1]"), "{message}");
        }
    }

    proptest! {
        #[test]
        fn columns_are_those_of_a_scan_of_the_terrain(
            voxels in prop::collection::vec((-4i32..4, -4i32..4, -20i32..20).prop_map(<[i32; 3]>::from), 1..150),
            looks in prop::collection::vec(
                prop::collection::vec((any::<prop::sample::Index>(), 0.0..=1.0), 0..60), 0..5),
            is_paper in any::<bool>(),
        ) {
            let method = if is_paper { paper() } else { Method::Or(Or::new(0.5).unwrap()) };
            let mut map = map(&voxels, method);
            let count = map.terrain.voxel_count();
            for (second, means) in (0..).zip(&looks) {
                let means = means.iter().map(|(at, mean)| (at.index(count) as u32, *mean)).collect();
                look(&mut map, 3 * second, &means);
            }
            let stamp_ns = 20 * SECOND;
            prop_assert_eq!(map.crowd_columns(stamp_ns, THRESHOLD).unwrap(), slow_columns(&map, stamp_ns));
        }
    }

    /// A square of 64 x 64 columns: four pages.
    fn square(method: Method) -> CrowdMap {
        let voxels: Vec<[i32; 3]> = (0..64 * 64).map(|at| [at / 64, at % 64, (at / 7) % 3]).collect();
        map(&voxels, method)
    }

    fn method_of(number: u8) -> Method {
        match number {
            0 => paper(),
            1 => Method::Or(Or::new(0.5).unwrap()),
            _ => evidence(0.01),
        }
    }

    #[derive(Debug, Clone)]
    struct Deed {
        /// Of the look after the one before, in tenths of a second: methods whose order is free are given older ones.
        after: i64,
        corner: (i32, i32),
        side: i32,
        mean: f64,
        /// When the map is read, tenths of a second after its newest instant.
        read_after: i64,
        /// Of the view, tenths of a second.
        late: i64,
    }

    fn deeds() -> impl Strategy<Value = Vec<Deed>> {
        let deed = (
            -30i64..80,
            (0..60i32, 0..60i32),
            1..30i32,
            prop_oneof![Just(1.0), Just(0.0), 0.0..=1.0],
            0..60i64,
            prop_oneof![2 => Just(0), 1 => 0..150i64],
        );
        let deed = deed.prop_map(|(after, corner, side, mean, read_after, late)| Deed {
            after,
            corner,
            side,
            mean,
            read_after,
            late,
        });
        prop::collection::vec(deed, 1..14)
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(60))]

        /// Whatever was read before, at whichever stamps, and wherever nobody looked since.
        #[test]
        fn reading_what_changed_finds_what_reading_everything_finds(
            deeds in deeds(), number in 0u8..3, threshold in prop_oneof![Just(0.3), Just(0.07), 0.005..0.6],
        ) {
            let mut map = square(method_of(number));
            let in_order = number == 0;
            let (mut stamp_ns, mut newest_ns) = (1000 * SECOND, 0);
            for deed in deeds {
                let step = if in_order { deed.after.abs() + 1 } else { deed.after };
                stamp_ns += step * SECOND / 10;
                newest_ns = newest_ns.max(stamp_ns);
                let (low, high) = (deed.corner, (deed.corner.0 + deed.side, deed.corner.1 + deed.side));
                let inside = |[i, j, _]: [i32; 3]| i >= low.0 && i < high.0 && j >= low.1 && j < high.1;
                let all = 0..map.terrain.voxel_count() as u32;
                let means = all.filter(|&id| inside(map.terrain.index(id))).map(|id| (id, deed.mean)).collect();
                look_at(&mut map, stamp_ns, if in_order { 0 } else { deed.late * SECOND / 10 }, &means);
                let read_ns = newest_ns + deed.read_after * SECOND / 10;
                let fresh = map.clone();
                prop_assert_eq!(
                    map.crowd_columns(read_ns, threshold).unwrap(),
                    fresh.crowd_columns(read_ns, threshold).unwrap()
                );
                prop_assert_eq!(
                    map.crowd_ids_at_last_looks(threshold).unwrap(),
                    fresh.crowd_ids_at_last_looks(threshold).unwrap()
                );
            }
        }

        #[test]
        fn columns_of_voxels_are_those_of_a_scan(
            means in prop::collection::vec(0.0..=1.0, 0..40), wanted in prop::collection::btree_set(0u32..40, 0..40),
        ) {
            let voxels: Vec<[i32; 3]> = (0..40).map(|at| [at % 5, at / 5 % 4, at / 20 * 3]).collect();
            let mut map = map(&voxels, evidence(0.2));
            let seen = means.len() as u32;
            look(&mut map, 0, &(0..).zip(means).collect());
            let wanted: Vec<u32> = wanted.into_iter().rev().collect();
            let found = map.columns_of(&wanted, 10 * SECOND).unwrap();
            let mut expected: BTreeMap<[i32; 2], Vec<u32>> = BTreeMap::new();
            for &id in wanted.iter().filter(|&&id| id < seen) {
                let [i, j, _] = map.terrain.index(id);
                expected.entry([i, j]).or_default().push(id);
            }
            expected.values_mut().for_each(|ids| ids.sort_unstable());
            let told: Vec<[i32; 2]> = found.columns.iter().map(|column| [column.i, column.j]).collect();
            prop_assert_eq!(told, expected.keys().copied().collect::<Vec<_>>());
            prop_assert_eq!(found.voxel_ids, expected.values().flatten().copied().collect::<Vec<_>>());
            for (column, ids) in found.columns.iter().zip(expected.values()) {
                let values = map.probability_of(ids, 10 * SECOND).unwrap();
                prop_assert_eq!(column.probability, values.into_iter().fold(0.0, f64::max));
                prop_assert_eq!(column.crowd_count as usize, ids.len());
            }
        }

        #[test]
        fn the_empty_voxels_are_those_in_that_state(
            deeds in deeds(), number in 0u8..3, threshold in 0.005..0.6, stale_after_s in 0.0..4.0, later in 0i64..5,
        ) {
            let mut map = square(method_of(number));
            let mut stamp_ns: i64 = 1000 * SECOND;
            for deed in deeds {
                stamp_ns += (deed.after.abs() + 1) * SECOND / 10;
                let all = 0..map.terrain.voxel_count() as u32;
                let inside = |id: &u32| {
                    let [i, j, _] = map.terrain.index(*id);
                    (0..deed.side).contains(&(i - deed.corner.0)) && (0..deed.side).contains(&(j - deed.corner.1))
                };
                let means = all.clone().filter(inside).map(|id| (id, deed.mean)).collect();
                look_at(&mut map, stamp_ns, 0, &means);
                let asked_ns = stamp_ns + later * SECOND;
                let states = map.state(asked_ns, threshold, stale_after_s).unwrap();
                let expected: Vec<u32> = all.filter(|&id| states[id as usize] == VoxelState::Empty).collect();
                prop_assert_eq!(map.empty_ids(asked_ns, threshold, stale_after_s).unwrap(), expected);
            }
        }

        /// Each voxel is read as if it had been looked at just now.
        #[test]
        fn crowd_at_last_looks_is_that_of_no_time_gone_by(
            deeds in deeds(), number in 0u8..3, threshold in prop_oneof![Just(0.3), Just(0.07), 0.005..0.6],
        ) {
            let mut map = square(method_of(number));
            let (mut stamp_ns, mut after): (i64, BTreeMap<u32, f64>) = (1000 * SECOND, BTreeMap::new());
            for deed in deeds {
                stamp_ns += (deed.after.abs() + 1) * SECOND / 10;
                let (low, high) = (deed.corner, (deed.corner.0 + deed.side, deed.corner.1 + deed.side));
                let inside = |[i, j, _]: [i32; 3]| i >= low.0 && i < high.0 && j >= low.1 && j < high.1;
                let all = 0..map.terrain.voxel_count() as u32;
                let ids: Vec<u32> = all.filter(|&id| inside(map.terrain.index(id))).collect();
                look_at(&mut map, stamp_ns, 0, &ids.iter().map(|&id| (id, deed.mean)).collect());
                after.extend(ids.iter().copied().zip(map.probability_of(&ids, stamp_ns).unwrap()));
                let expected: Vec<u32> =
                    after.iter().filter(|(_, p)| **p >= threshold).map(|(&id, _)| id).collect();
                prop_assert_eq!(map.crowd_ids_at_last_looks(threshold).unwrap(), expected);
            }
        }
    }

    /// Looks at .9, .5, .3 and 0 speak for crowd by 3.4, 1.4, .3 and -2; the log odds above the prior are E / (W + 1).
    #[test]
    fn a_look_speaks_for_crowd_when_it_leaves_more_of_it() {
        let mut map = map(&[[0, 0, 0], [1, 0, 0], [2, 0, 0]], evidence(0.1));
        let means = |values: [f64; 3]| (0..3).zip(values).collect();
        look(&mut map, 0, &means([0.9, 0.3, 0.0]));
        assert_eq!(map.spoke_for_crowd(&[0, 1, 2]).unwrap(), [true, true, false]);
        look(&mut map, 1, &means([0.3, 0.9, 0.5]));
        // 3.4 / 2 falls to about 3.4 / 3. What spoke against crowd, -2 / 2, rises to -.4 / 3 and is still below.
        assert_eq!(map.spoke_for_crowd(&[0, 1, 2]).unwrap(), [false, true, false]);
        // 100 s later nothing is left of all that, and .3 / 2 is more than nothing.
        look(&mut map, 101, &means([0.3, 0.0, 0.3]));
        assert_eq!(map.spoke_for_crowd(&[0, 1, 2]).unwrap(), [true, false, true]);
        let read = CrowdMap::from_bytes(&map.to_bytes(), map.terrain.clone()).unwrap();
        assert_eq!(read.spoke_for_crowd(&[0, 1, 2]).unwrap(), [true, false, true]);
    }

    /// A look at .9 leaves odds of .25 e^(3.4 / 2), P = .58; after ten seconds P = .38.
    #[test]
    fn crowd_of_a_late_view_is_found_on_a_page_without_crowd() {
        let mut map = map(&[[0, 0, 0], [1, 0, 0]], evidence(0.2));
        look(&mut map, 0, &BTreeMap::from([(1, 0.0)]));
        assert_eq!(map.crowd_ids_at_last_looks(0.5).unwrap(), Vec::<u32>::new());
        look_at(&mut map, 100 * SECOND, 10 * SECOND, &BTreeMap::from([(0, 0.9)]));
        assert_eq!(map.crowd_ids(100 * SECOND, 0.5).unwrap(), Vec::<u32>::new());
        assert_eq!(map.crowd_ids_at_last_looks(0.5).unwrap(), [0]);
    }

    #[test]
    fn pages_without_crowd_are_not_read_again() {
        let mut map = square(evidence(0.2));
        look(&mut map, 0, &(0..64 * 64).map(|id| (id, 0.0)).collect());
        map.crowd_columns(0, THRESHOLD).unwrap();
        let read = |map: &CrowdMap, second: i64| {
            let pages = map.quiet.take(THRESHOLD, 0..0);
            let numbers = pages.to_read(second * SECOND);
            map.quiet.put(pages);
            numbers
        };
        assert_eq!(read(&map, 0), Vec::<usize>::new());
        // Nothing of crowd is written to a page that held none.
        look(&mut map, 0, &(0..64).map(|id| (id, 0.0)).collect());
        assert_eq!(read(&map, 0), Vec::<usize>::new());
        // Crowd is found on the second page: only that one is read, as long as it has crowd.
        for second in 1..4 {
            look(&mut map, second, &BTreeMap::from([(1030, 1.0)]));
        }
        assert_eq!(read(&map, 3), [1]);
        assert_eq!(map.crowd_columns(3 * SECOND, THRESHOLD).unwrap().voxel_ids, [1030]);
        assert_eq!(read(&map, 4), [1]);
        // What is read at a later stamp says nothing of an earlier one.
        assert!(map.crowd_columns(1000 * SECOND, THRESHOLD).unwrap().columns.is_empty());
        assert_eq!((read(&map, 1000), read(&map, 4)), (vec![], vec![1]));
        assert_eq!(map.crowd_columns(4 * SECOND, THRESHOLD).unwrap().voxel_ids, [1030]);
    }
}
