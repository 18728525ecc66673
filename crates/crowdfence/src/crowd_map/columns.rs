//! The columns of the terrain that hold crowd: the ground that zones are drawn on.

use rayon::prelude::*;

use super::beliefs::Beliefs;
use super::reading::Reading;
use super::{CrowdMap, check_threshold};
use crate::error::{Result, require};
use crate::method::{FusionMethod, each_method};

/// Crowd seen from above.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct CrowdColumns {
    /// Every column with a voxel at or above the threshold, sorted by i, then j.
    pub columns: Vec<CrowdColumn>,
    /// Those voxels, column by column, sorted within each.
    pub voxel_ids: Vec<u32>,
}

/// One column of voxels, of which at least one is crowd.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CrowdColumn {
    /// Grid indices.
    pub i: i32,
    pub j: i32,
    /// Grid indices k of the lowest and of the highest voxel of the terrain.
    pub bottom: i32,
    pub top: i32,
    /// How many of its voxels count: those at or above the threshold.
    pub crowd_count: u32,
    /// Largest probability over the voxels that were ever seen.
    pub probability: f64,
    /// Newest look at any of its voxels, crowd or not.
    pub last_seen_ns: i64,
}

/// From which probability on columns are closed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClosedFrom {
    /// A column is closed when one of its voxels is at or above it.
    pub threshold: f64,
    /// One that is closed stays so down to this one, at most as high.
    pub off_threshold: f64,
    /// One that is closed is told down to this one, at most as high, for callers who know other reasons.
    pub least: f64,
}

impl CrowdMap {
    /// The columns that hold crowd, P >= `threshold`, at a stamp not before the last instant.
    ///
    /// Costs what holds crowd and what was seen since the last call, where nothing becomes crowd by being forgotten
    /// ([`FusionMethod::stays_below`]), and what was seen so far elsewhere.
    pub fn crowd_columns(&self, stamp_ns: i64, threshold: f64) -> Result<CrowdColumns> {
        self.closed_columns(
            stamp_ns,
            ClosedFrom { threshold, off_threshold: threshold, least: threshold },
            &[],
        )
    }

    /// The columns that hold crowd, and those of `closed` (i, j), in any order, that are not known to hold none. The
    /// voxels of a column are those at or above the off threshold or, where there are none, `least`. Costs `closed`
    /// beside what [`CrowdMap::crowd_columns`] costs.
    pub fn closed_columns(
        &self,
        stamp_ns: i64,
        from: ClosedFrom,
        closed: &[[i32; 2]],
    ) -> Result<CrowdColumns> {
        let now = self.moment(stamp_ns)?;
        from.check()?;
        let columns: Vec<Column> = each_method!(&self.beliefs, Beliefs, beliefs => {
            let reading = Reading::new(beliefs, &self.history, now);
            let places = self.with_crowd_places(&reading, now.stamp_ns, from.threshold, closed);
            places.par_iter().filter_map(|&place| self.column(&reading, from, place)).collect()
        });
        let mut crowd_columns = CrowdColumns::default();
        for Column { told, voxel_ids } in columns {
            crowd_columns.columns.push(told);
            crowd_columns.voxel_ids.extend(voxel_ids);
        }
        Ok(crowd_columns)
    }

    /// Places of columns with crowd and those of `closed`, sorted.
    fn with_crowd_places<M: FusionMethod>(
        &self,
        reading: &Reading<'_, M>,
        stamp_ns: i64,
        threshold: f64,
        closed: &[[i32; 2]],
    ) -> Vec<[i32; 2]> {
        let ids = self.crowd_ids(reading, stamp_ns, threshold);
        let mut places: Vec<[i32; 2]> =
            self.terrain.indices_of(&ids).iter().map(|&[i, j, _]| [i, j]).collect();
        places.extend(closed);
        places.par_sort_unstable();
        places.dedup();
        places
    }

    fn crowd_ids<M: FusionMethod>(
        &self,
        reading: &Reading<'_, M>,
        stamp_ns: i64,
        threshold: f64,
    ) -> Vec<u32> {
        if !reading.method().stays_below(threshold) {
            return reading.of_seen(|id, p| (p >= threshold).then_some(id));
        }
        let mut pages = self.quiet.take(threshold, self.history.looks.written().map(|(number, _)| number));
        let numbers = pages.to_read(stamp_ns);
        let mut crowd = Vec::new();
        for (&number, (largest, ids)) in numbers.iter().zip(reading.crowd_of(&numbers, threshold)) {
            pages.found(number, largest, stamp_ns);
            crowd.extend(ids);
        }
        self.quiet.put(pages);
        crowd
    }

    /// The column at a place; None where none of its voxels is at or above any of the three.
    fn column<M: FusionMethod>(
        &self,
        reading: &Reading<'_, M>,
        from: ClosedFrom,
        [i, j]: [i32; 2],
    ) -> Option<Column> {
        let (mut bottom, mut top, mut last_seen_ns) = (i32::MAX, i32::MIN, i64::MIN);
        let mut seen: Vec<(u32, f64)> = Vec::new();
        for (k, id) in self.terrain.column(i, j) {
            (bottom, top) = (bottom.min(k), top.max(k));
            if let Some(look) = self.history.last_look(id) {
                last_seen_ns = last_seen_ns.max(look.stamp_ns);
                seen.push((id, reading.probability(id)));
            }
        }
        let probability = seen.iter().fold(0.0, |largest: f64, voxel| voxel.1.max(largest));
        let least = [from.off_threshold, from.least].into_iter().find(|&least| probability >= least)?;
        let mut voxel_ids: Vec<u32> =
            seen.iter().filter(|voxel| voxel.1 >= least).map(|voxel| voxel.0).collect();
        voxel_ids.sort_unstable();
        let crowd_count = voxel_ids.len() as u32;
        Some(Column {
            told: CrowdColumn { i, j, bottom, top, crowd_count, probability, last_seen_ns },
            voxel_ids,
        })
    }
}

impl ClosedFrom {
    fn check(self) -> Result<()> {
        check_threshold(self.threshold)?;
        let ClosedFrom { threshold, off_threshold, least } = self;
        let off = off_threshold > 0.0 && off_threshold <= threshold;
        require(off, "off_threshold", off_threshold, "above 0 and at most the threshold")?;
        require(least > 0.0 && least <= off_threshold, "least", least, "above 0 and at most off_threshold")
    }
}

/// A column and those of its voxels that count.
struct Column {
    told: CrowdColumn,
    voxel_ids: Vec<u32>,
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::back_projection::{Coverage, Projection};
    use crate::method::{DecayUnit, Evidence, EvidenceSettings, Initial, LikelihoodRatio, Method, Or, Paper};
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
        };
        Method::Evidence(Evidence::new(Arc::new(likelihood), settings).unwrap())
    }

    fn map(voxels: &[[i32; 3]], method: Method) -> CrowdMap {
        let terrain = Arc::new(Terrain::from_indices(voxels, 1.0, DVec3::ZERO).unwrap());
        CrowdMap::new(terrain, method, Projection::new(100.0, 0.0, Coverage::Rays).unwrap(), 3600.0).unwrap()
    }

    /// One drone says what it thinks of some voxels, at second `second`.
    fn look(map: &mut CrowdMap, second: i64, means: &BTreeMap<u32, f64>) {
        look_at(map, second * SECOND, means);
    }

    fn look_at(map: &mut CrowdMap, stamp_ns: i64, means: &BTreeMap<u32, f64>) {
        let seen = SeenVoxels {
            ids: means.keys().copied().collect(),
            mean: means.values().copied().collect(),
            pixel_count: vec![1; means.len()],
            range_m: vec![10.0; means.len()],
            tilt_deg: vec![90.0; means.len()],
        };
        let observation =
            Observation::new(map.terrain.key(), "a", stamp_ns, seen, vec![], CrowdMass::default()).unwrap();
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
                last_seen_ns: seen.iter().map(|&id| map.last_seen_ns_of(id).unwrap()).max().unwrap(),
            });
            crowd_columns.voxel_ids.extend(crowd);
        }
        crowd_columns
    }

    #[test]
    fn a_newer_look_below_the_crowd_counts() {
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
            last_seen_ns: 10 * SECOND,
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
    }

    fn deeds() -> impl Strategy<Value = Vec<Deed>> {
        let deed = (
            -30i64..80,
            (0..60i32, 0..60i32),
            1..30i32,
            prop_oneof![Just(1.0), Just(0.0), 0.0..=1.0],
            0..60i64,
        );
        let deed = deed.prop_map(|(after, corner, side, mean, read_after)| Deed {
            after,
            corner,
            side,
            mean,
            read_after,
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
                look_at(&mut map, stamp_ns, &means);
                let read_ns = newest_ns + deed.read_after * SECOND / 10;
                let fresh = map.clone();
                prop_assert_eq!(
                    map.crowd_columns(read_ns, threshold).unwrap(),
                    fresh.crowd_columns(read_ns, threshold).unwrap()
                );
            }
        }

        #[test]
        fn closed_columns_are_those_of_a_scan(
            means in prop::collection::vec(0.0..=1.0, 40), closed in prop::collection::vec((0i32..9, 0i32..9), 0..30),
        ) {
            let voxels: Vec<[i32; 3]> = (0..40).map(|at| [at % 5, at / 5 % 4, at / 20 * 3]).collect();
            let mut map = map(&voxels, evidence(0.2));
            look(&mut map, 0, &(0..).zip(means).collect());
            let from = ClosedFrom { threshold: 0.5, off_threshold: 0.3, least: 0.1 };
            let closed: Vec<[i32; 2]> = closed.into_iter().map(<[i32; 2]>::from).collect();
            let found = map.closed_columns(0, from, &closed).unwrap();
            let mut told = Vec::new();
            for column in &found.columns {
                told.push((column.i, column.j));
            }
            let mut expected = Vec::new();
            let mut ids = Vec::new();
            for (i, j) in (0..5).flat_map(|i| (0..4).map(move |j| (i, j))) {
                let mut column: Vec<u32> = map.terrain.column(i, j).map(|voxel| voxel.1).collect();
                column.sort_unstable();
                let values = map.probability_of(&column, 0).unwrap();
                let largest = values.iter().copied().fold(0.0, f64::max);
                let least = if closed.contains(&[i, j]) { 0.1 } else { 0.5 };
                if largest >= least {
                    let level = if largest >= 0.3 { 0.3 } else { 0.1 };
                    expected.push((i, j));
                    ids.extend(column.iter().zip(&values).filter(|(_, value)| **value >= level).map(|(id, _)| *id));
                }
            }
            prop_assert_eq!(told, expected);
            prop_assert_eq!(found.voxel_ids, ids);
        }
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
