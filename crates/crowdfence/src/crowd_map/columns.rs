//! The columns of the terrain that hold crowd: the ground that zones are drawn on.

use rayon::prelude::*;

use super::beliefs::Beliefs;
use super::reading::Reading;
use super::{CrowdMap, check_threshold};
use crate::error::Result;
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
    /// How many of its voxels are crowd.
    pub crowd_count: u32,
    /// Largest probability over the voxels that were ever seen.
    pub probability: f64,
    /// Newest look at any of its voxels, crowd or not.
    pub last_seen_ns: i64,
}

/// A voxel at or above the threshold.
struct CrowdVoxel {
    id: u32,
    index: [i32; 3],
    probability: f64,
}

impl CrowdMap {
    /// The columns that hold crowd, P >= `threshold`, at a stamp not before the last instant. Costs what was
    /// seen, not the map.
    pub fn crowd_columns(&self, stamp_ns: i64, threshold: f64) -> Result<CrowdColumns> {
        let now = self.moment(stamp_ns)?;
        check_threshold(threshold)?;
        let mut crowd = each_method!(&self.beliefs, Beliefs, beliefs => {
            self.crowd_voxels(Reading::new(beliefs, &self.history, now), threshold)
        });
        crowd.par_sort_unstable_by_key(|voxel| (voxel.index[0], voxel.index[1], voxel.id));
        let columns = crowd
            .par_chunk_by(|a, b| a.index[..2] == b.index[..2])
            .map(|crowd| self.crowd_column(crowd))
            .collect();
        Ok(CrowdColumns { columns, voxel_ids: crowd.into_iter().map(|voxel| voxel.id).collect() })
    }

    fn crowd_voxels<M: FusionMethod>(&self, reading: Reading<'_, M>, threshold: f64) -> Vec<CrowdVoxel> {
        let crowd = reading.of_seen(|id, p| (p >= threshold).then_some((id, p)));
        let (ids, probability): (Vec<u32>, Vec<f64>) = crowd.into_iter().unzip();
        let indices = self.terrain.indices_of(&ids);
        (0..ids.len())
            .map(|row| CrowdVoxel { id: ids[row], index: indices[row], probability: probability[row] })
            .collect()
    }

    /// `crowd` are the crowd voxels of one column.
    fn crowd_column(&self, crowd: &[CrowdVoxel]) -> CrowdColumn {
        let [i, j, _] = crowd[0].index;
        let mut column = CrowdColumn {
            i,
            j,
            bottom: i32::MAX,
            top: i32::MIN,
            crowd_count: crowd.len() as u32,
            // What is below the threshold is below this too.
            probability: crowd.iter().fold(0.0, |largest, voxel| voxel.probability.max(largest)),
            last_seen_ns: i64::MIN,
        };
        for (k, id) in self.terrain.column(i, j) {
            column.bottom = column.bottom.min(k);
            column.top = column.top.max(k);
            column.last_seen_ns = column.last_seen_ns.max(self.last_seen_ns_of(id).unwrap_or(i64::MIN));
        }
        column
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::sync::Arc;

    use glam::DVec3;
    use proptest::prelude::*;

    use super::*;
    use crate::back_projection::{Coverage, Projection};
    use crate::method::{DecayUnit, Initial, Method, Or, Paper};
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

    fn map(voxels: &[[i32; 3]], method: Method) -> CrowdMap {
        let terrain = Arc::new(Terrain::from_indices(voxels, 1.0, DVec3::ZERO).unwrap());
        CrowdMap::new(terrain, method, Projection::new(100.0, 0.0, Coverage::Rays).unwrap(), 3600.0).unwrap()
    }

    /// One drone says what it thinks of some voxels, at second `second`.
    fn look(map: &mut CrowdMap, second: i64, means: &BTreeMap<u32, f64>) {
        let seen = SeenVoxels {
            ids: means.keys().copied().collect(),
            mean: means.values().copied().collect(),
            pixel_count: vec![1; means.len()],
            range_m: vec![10.0; means.len()],
            tilt_deg: vec![90.0; means.len()],
        };
        let stamp_ns = second * SECOND;
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
}
