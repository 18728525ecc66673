use std::collections::BTreeMap;

use glam::{DMat3, DVec3};
use proptest::prelude::*;

use super::*;
use crate::back_projection::Coverage;
use crate::camera::{Camera, Distortion};
use crate::method::{
    DecayUnit, Evidence, EvidenceSettings, FromBelow, Initial, LikelihoodRatio, LinearPool, LogOdds, LogPool,
    MovingAverage, Or, Paper, three_step_calibration,
};
use crate::observation::{CrowdMass, SeenVoxels};
use crate::opinion_pool::{OpinionPool, Rates, Unseen};
use crate::temporal_blend::TemporalBlend;
use crate::view::{Heatmap, Pose};

const SECOND: i64 = 1_000_000_000;
// Rates .9 / .05 and prior .2: P(A|1) = .18 / .22, P(A|0) = .02 / .78.
const POSITIVE: f64 = 0.18 / 0.22;
const NEGATIVE: f64 = 0.02 / 0.78;

/// Two voxels far apart; `look` points a one-pixel camera at one of them.
fn two_voxels() -> Arc<Terrain> {
    Arc::new(Terrain::from_indices(&[[0, 0, 0], [50, 0, 0]], 1.0, DVec3::ZERO).unwrap())
}

fn look(drone: &str, voxel_x: f64, m: f32, stamp_ns: i64) -> View {
    let camera = Camera::new(1, 1, 100.0, 100.0, 0.5, 0.5, Distortion::None).unwrap();
    let down = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
    let pose = Pose { rotation: down, translation: DVec3::new(voxel_x + 0.5, 0.5, 10.0) };
    View::new(drone, stamp_ns, Arc::new(camera), pose, Heatmap::new(vec![m], 1, 1).unwrap()).unwrap()
}

fn paper(alpha: f64, decay: f64, unit: DecayUnit, initial: Initial) -> Method {
    let rates = Rates::new(0.9, 0.05).unwrap();
    let pool = OpinionPool::new(rates, 0.2, 0.5, Unseen::Fleet, false).unwrap();
    Method::Paper(Paper::new(pool, TemporalBlend::new(alpha, decay).unwrap(), 3, initial, unit).unwrap())
}

/// Up to .5 a look says -2, above it 3; it is sharp from .1 m a pixel on: from 10 m, as `look` sees.
fn evidence() -> Method {
    evidence_of(two_ratios())
}

fn evidence_of_what_opens_ground() -> Method {
    evidence_with(two_ratios(), FromBelow::Against)
}

fn two_ratios() -> LikelihoodRatio {
    LikelihoodRatio::new(vec![], vec![], vec![0.5], vec![-2.0, 3.0]).unwrap()
}

/// The same, but above .5 a look says 5, above .75 7: with a doubt of 1 one alone leaves log odds of 2.5 and 3.5 above
/// the prior's -1.386.
fn evidence_that_shows() -> Method {
    evidence_of(LikelihoodRatio::new(vec![], vec![], vec![0.5, 0.75], vec![-2.0, 5.0, 7.0]).unwrap())
}

fn evidence_of(likelihood: LikelihoodRatio) -> Method {
    evidence_with(likelihood, FromBelow::For)
}

fn evidence_with(likelihood: LikelihoodRatio, from_below: FromBelow) -> Method {
    let settings = EvidenceSettings {
        prior: 0.2,
        memory_s: 10.0,
        sharp_gsd_m: 0.1,
        doubt: 1.0,
        agreement: 0.5,
        threshold: 0.5,
        cleared: 0.1,
        focal_px: 100.0,
        from_below,
    };
    Method::Evidence(Evidence::new(Arc::new(likelihood), settings).unwrap())
}

fn map(method: Method) -> CrowdMap {
    CrowdMap::new(two_voxels(), method, Projection::new(100.0, 0.0, Coverage::Rays).unwrap(), 3600.0).unwrap()
}

#[track_caller]
fn assert_close(actual: f64, expected: f64) {
    assert!((actual - expected).abs() < 1e-9, "{actual} != {expected}");
}

#[track_caller]
fn assert_all_within(actual: &[f64], expected: &[f64], bound: f64) {
    assert_eq!(actual.len(), expected.len());
    assert!(actual.iter().zip(expected).all(|(a, b)| (a - b).abs() <= bound), "{actual:?} != {expected:?}");
}

#[test]
fn three_instants_by_hand() {
    // lambda = ln 2 / 10 s: beliefs halve every 10 s.
    let mut map = map(paper(0.1, std::f64::consts::LN_2 / 10.0, DecayUnit::Second, Initial::Zero));
    // One of three drones is sure of crowd at voxel 0, one is sure of none at voxel 1.
    let one_sure = (POSITIVE + 2.0 * NEGATIVE) / 3.0;
    map.integrate(&[look("a", 0.0, 1.0, 0), look("b", 50.0, 0.0, 0)], 0).unwrap();
    assert_close(map.probability(0).unwrap()[0], 0.1 * one_sure);
    assert_close(map.probability(0).unwrap()[1], 0.1 * NEGATIVE);
    // 10 s later two drones see voxel 0 at m = .75 (weight .5 / 3 each); voxel 1 only fades.
    let stamp = 10 * SECOND;
    map.integrate(&[look("a", 0.0, 0.75, stamp), look("c", 0.0, 0.75, stamp)], stamp).unwrap();
    let pooled = 2.0 * 0.5 / 3.0 * POSITIVE + NEGATIVE / 3.0;
    let expected = 0.1 * pooled + 0.9 * 0.5 * 0.1 * one_sure;
    assert_close(map.probability(stamp).unwrap()[0], expected);
    assert_close(map.probability(stamp).unwrap()[1], 0.5 * 0.1 * NEGATIVE);
    // Reading later fades both, from their own last look; reading changes nothing.
    for _ in 0..2 {
        let later = map.probability(30 * SECOND).unwrap();
        assert_close(later[0], 0.25 * expected);
        assert_close(later[1], 0.125 * 0.1 * NEGATIVE);
    }
}

#[test]
fn decay_per_frame_counts_instants() {
    let mut map = map(paper(1.0, std::f64::consts::LN_2, DecayUnit::Frame, Initial::Zero));
    map.integrate(&[look("a", 0.0, 1.0, 0)], 0).unwrap();
    let sure = map.probability(0).unwrap()[0];
    for frame in 1..=3 {
        map.integrate(&[look("a", 50.0, 0.0, frame * SECOND)], frame * SECOND).unwrap();
    }
    assert_close(map.probability(100 * SECOND).unwrap()[0], sure / 8.0);
}

#[test]
fn instants_since_the_last_look_are_counted_once_where_a_view_comes_late() {
    // Half is left per instant. The late view was taken before the look of the first instant: it joins it as it was then.
    let mut map = map(paper(0.5, std::f64::consts::LN_2, DecayUnit::Frame, Initial::Zero));
    map.integrate(&[look("a", 0.0, 1.0, 10 * SECOND)], 10 * SECOND).unwrap();
    let first = map.probability(10 * SECOND).unwrap()[0];
    map.integrate(&[], 11 * SECOND).unwrap();
    map.integrate(&[look("b", 0.0, 1.0, 5 * SECOND)], 12 * SECOND).unwrap();
    // .5 P + .5 of the first, .5 P; two instants later a quarter of that.
    assert_close(map.probability(12 * SECOND).unwrap()[0], 1.5 * first / 4.0);
}

#[test]
fn the_first_look_follows_the_switch() {
    let first = |initial| {
        let mut map = map(paper(0.25, 0.0, DecayUnit::Second, initial));
        map.integrate(&[look("a", 0.0, 1.0, 0)], 0).unwrap();
        map.probability(0).unwrap()
    };
    let pooled = (POSITIVE + 2.0 * NEGATIVE) / 3.0;
    assert_close(first(Initial::Zero)[0], 0.25 * pooled);
    assert_close(first(Initial::Prior)[0], 0.25 * pooled + 0.75 * 0.2);
    assert_close(first(Initial::FirstLook)[0], pooled);
    assert_eq!(first(Initial::Zero)[1], 0.0);
    assert_eq!(first(Initial::Prior)[1], 0.2);
}

#[test]
fn or_never_forgets() {
    let mut map = map(Method::Or(Or::new(0.5).unwrap()));
    map.integrate(&[look("a", 0.0, 0.51, 0), look("b", 50.0, 0.5, 0)], 0).unwrap();
    map.integrate(&[look("a", 0.0, 0.0, SECOND)], SECOND).unwrap();
    assert_eq!(map.probability(1000 * SECOND).unwrap(), [1.0, 0.0]);
}

#[test]
fn only_voxels_that_somebody_saw_count_as_seen() {
    let mut map = map(Method::Or(Or::new(0.5).unwrap()));
    assert!(map.seen_ids().is_empty());
    map.integrate(&[look("a", 50.0, 0.0, 0)], 0).unwrap();
    assert_eq!(map.seen_ids(), [1]);
    assert_eq!(map.last_seen_ns().collect::<Vec<_>>(), [None, Some(0)]);
}

#[test]
fn a_voxel_at_the_threshold_is_crowd() {
    let mut map = map(Method::Or(Or::new(0.5).unwrap()));
    map.integrate(&[look("a", 0.0, 1.0, 0)], 0).unwrap();
    assert_eq!(map.state(0, 1.0, 30.0).unwrap()[0], VoxelState::Crowd);
    let message = map.state(0, 0.0, 30.0).unwrap_err().to_string();
    assert_eq!(message, "threshold is 0; it must be in (0, 1]");
}

#[test]
fn unseen_empty_stale_and_crowd_are_different_states() {
    let mut map = map(paper(1.0, 0.0, DecayUnit::Second, Initial::Zero));
    let states = |map: &CrowdMap, stamp| map.state(stamp, 0.1, 30.0).unwrap();
    assert_eq!(states(&map, 0), [VoxelState::NeverSeen; 2]);
    map.integrate(&[look("a", 0.0, 0.0, 0)], 0).unwrap();
    assert_eq!(states(&map, 30 * SECOND), [VoxelState::Empty, VoxelState::NeverSeen]);
    assert_eq!(states(&map, 31 * SECOND), [VoxelState::Stale, VoxelState::NeverSeen]);
    map.integrate(&[look("a", 0.0, 1.0, 40 * SECOND)], 40 * SECOND).unwrap();
    assert_eq!(states(&map, 400 * SECOND), [VoxelState::Crowd, VoxelState::NeverSeen]);
}

#[test]
fn a_place_behind_something_is_occluded_until_it_is_seen() {
    let terrain = Terrain::from_indices(&[[0, 0, 0], [0, 0, 5]], 1.0, DVec3::ZERO).unwrap();
    let projection = Projection::new(100.0, 0.0, Coverage::Full).unwrap();
    let method = paper(0.1, 0.0, DecayUnit::Second, Initial::Zero);
    let mut map = CrowdMap::new(Arc::new(terrain), method, projection, 3600.0).unwrap();
    let mut above = look("a", 0.0, 0.0, 0);
    map.integrate(&[above.clone()], 0).unwrap();
    assert_eq!(map.state(0, 0.1, 30.0).unwrap(), [VoxelState::Occluded, VoxelState::Empty]);
    above.world_from_camera.translation.z = 3.0; // below the roof
    map.integrate(&[above], SECOND).unwrap();
    assert_eq!(map.state(SECOND, 0.1, 30.0).unwrap()[0], VoxelState::Empty);
}

#[test]
fn refused_input_leaves_the_map_as_it_was() {
    let mut map = map(paper(0.1, 0.01, DecayUnit::Second, Initial::Zero));
    map.integrate(&[look("a", 0.0, 1.0, 0)], 0).unwrap();
    let before = map.to_bytes();
    let hours = 5 * 3600 * SECOND;
    let cases: [(Vec<View>, i64, &str); 7] = [
        (vec![], 0, "not after the last instant"),
        (vec![], -SECOND, "stamp -1000000000 ns is negative"),
        (vec![], hours, "18000 s after the last instant; the bound max_gap_s is 3600 s"),
        (vec![look("a", 0.0, 1.0, hours)], SECOND, "stamped 17999 s away from its instant"),
        (vec![look("a", 0.0, 1.0, SECOND); 2], SECOND, "'a' appears twice"),
        (
            ["b", "c", "d"].map(|drone| look(drone, 0.0, 1.0, SECOND)).to_vec(),
            SECOND,
            "'d' makes the fleet 4 drones large; fleet_size is 3",
        ),
        (vec![look("a", 0.0, 1.0, 0)], i64::MAX, "after the last instant"),
    ];
    for (views, stamp_ns, words) in cases {
        let message = map.integrate(&views, stamp_ns).unwrap_err().to_string();
        assert!(message.contains(words), "{message}");
        assert_eq!(map.to_bytes(), before);
    }
    map.integrate(&[], SECOND).unwrap();
    let message = map.probability(0).unwrap_err().to_string();
    assert!(message.contains("cannot be read in its past"), "{message}");
    let message = map.probability(-1).unwrap_err().to_string();
    assert!(message.contains("stamp -1 ns is negative"), "{message}");
}

#[test]
fn by_default_a_crowd_that_one_drone_sees_is_marked_at_the_fourth_look() {
    // One sure view of three pools to P = (POSITIVE + 2 NEGATIVE) / 3 = .290; the threshold is a quarter of the
    // way from NEGATIVE to it, .0917. After n looks P~ = P (1 - .9^n): .0786 for n = 3, .0997 for n = 4.
    let method = paper(0.1, 0.0, DecayUnit::Second, Initial::Zero);
    let mut map = map(method.clone());
    let looks = [0, 1, 2, 3].map(|second| {
        map.integrate(&[look("a", 0.0, 1.0, second * SECOND)], second * SECOND).unwrap();
        map.state(second * SECOND, method.default_threshold(), 30.0).unwrap()[0]
    });
    assert_eq!(looks, [VoxelState::Empty, VoxelState::Empty, VoxelState::Empty, VoxelState::Crowd]);
    let one_view = (POSITIVE + 2.0 * NEGATIVE) / 3.0;
    assert_close(method.default_threshold(), 0.75 * NEGATIVE + 0.25 * one_view);
}

#[test]
fn views_projected_before_give_the_same_map() {
    let method = paper(0.3, 0.01, DecayUnit::Second, Initial::Zero);
    let (mut by_views, mut by_observations) = (map(method.clone()), map(method));
    for second in 0..5 {
        let stamp = second * SECOND;
        let views = [look("a", 0.0, 0.2 * second as f32, stamp), look("b", 0.0, 0.9, stamp)];
        let update = by_views.integrate(&views, stamp).unwrap();
        by_observations.integrate_observations(update.observations, stamp).unwrap();
    }
    assert_eq!(by_views.to_bytes(), by_observations.to_bytes());
}

#[test]
fn an_observation_of_another_terrain_is_refused() {
    let mut map = map(paper(0.3, 0.01, DecayUnit::Second, Initial::Zero));
    let three = Terrain::from_indices(&[[0, 0, 0], [1, 0, 0], [2, 0, 0]], 1.0, DVec3::ZERO).unwrap();
    let foreign =
        Observation::new(three.key(), "a", 0, SeenVoxels::default(), vec![], CrowdMass::default()).unwrap();
    let message = map.integrate_observations(vec![foreign], 0).unwrap_err().to_string();
    assert!(message.starts_with("observation belongs to another terrain"), "{message}");
    assert_eq!(map.instant_count(), 0);
}

/// Those of another terrain, for instance: they were ground that nobody had seen, or a panic.
#[test]
fn voxels_that_the_terrain_does_not_have_are_refused() {
    let mut map = map(evidence());
    map.integrate(&[look("a", 0.0, 1.0, 0)], 0).unwrap();
    for id in [2, 1_000_000_000] {
        let refused = Some(Error::VoxelId { id: i64::from(id), last: 1 });
        assert_eq!(map.probability_of(&[0, id], 0).err(), refused);
        assert_eq!(map.interval_of(&[id, 1], 0, 0.9).err(), refused);
        assert_eq!(map.knowledge(&[id], 0, 0.5, 9.0).err(), refused);
        assert_eq!(map.columns_of(&[0, id], 0).err(), refused);
        assert_eq!(map.last_seen_ns_of(&[id]).err(), refused);
        assert_eq!(map.seen_by(&[id, 0]).err(), refused);
        assert_eq!(map.spoke_for_crowd(&[0, id]).err(), refused);
    }
    assert_eq!(map.columns_of(&[1, 0], 0).unwrap().voxel_ids, [0]);
}

#[test]
fn a_view_far_older_than_its_instant_counts_at_its_own_age() {
    // Seen at 0 s; integrated at 1000 s: the place is as stale as the view, and has faded for as long.
    let lambda = std::f64::consts::LN_2 / 1000.0;
    let mut map = map(paper(1.0, lambda, DecayUnit::Second, Initial::Zero));
    let stamp = 1000 * SECOND;
    let update =
        map.integrate(&[look("a", 0.0, 1.0, 0), look("b", 50.0, 0.0, stamp - SECOND)], stamp).unwrap();
    assert_eq!(map.last_seen_ns().collect::<Vec<_>>(), [Some(0), Some(stamp)]);
    assert_close(update.probability[0], 0.5 * (POSITIVE + 2.0 * NEGATIVE) / 3.0);
    assert_eq!(map.state(stamp, 0.5, 30.0).unwrap(), [VoxelState::Stale, VoxelState::Empty]);
}

#[test]
fn an_old_view_does_not_make_a_newer_look_older() {
    let mut map = map(paper(0.5, 0.0, DecayUnit::Second, Initial::Zero));
    map.integrate(&[look("a", 0.0, 0.0, 10 * SECOND)], 10 * SECOND).unwrap();
    map.integrate(&[look("b", 0.0, 1.0, 5 * SECOND)], 20 * SECOND).unwrap();
    assert_eq!(map.last_seen_ns_of(&[0]).unwrap(), [Some(10 * SECOND)]);
}

#[test]
fn a_view_from_the_future_of_its_instant_is_refused() {
    let mut map = map(paper(0.5, 0.0, DecayUnit::Second, Initial::Zero));
    let message = map.integrate(&[look("a", 0.0, 0.0, 12 * SECOND)], 10 * SECOND).unwrap_err().to_string();
    assert_eq!(
        message,
        "view of drone 'a' is stamped 2 s away from its instant; the bound is 1 s. Is a clock wrong?"
    );
}

#[test]
fn stamps_in_seconds_are_found_out_at_the_second_instant() {
    let mut map = map(paper(0.5, 0.0, DecayUnit::Second, Initial::Zero));
    map.integrate(&[], 1_763_780_000).unwrap();
    let message = map.integrate(&[], 1_763_780_001).unwrap_err().to_string();
    assert!(message.contains("look like seconds"), "{message}");
}

#[test]
fn or_takes_instants_in_any_order() {
    let looks = [("a", 0.0, 0.9, 0), ("b", 50.0, 0.1, 3), ("a", 50.0, 0.6, 1), ("c", 0.0, 0.0, 2)];
    let state = |order: [usize; 4]| {
        let mut map = map(Method::Or(Or::new(0.5).unwrap()));
        for at in order {
            let (drone, x, m, second) = looks[at];
            map.integrate(&[look(drone, x, m, second * SECOND)], second * SECOND).unwrap();
        }
        (map.probability(9 * SECOND).unwrap(), map.last_seen_ns().collect::<Vec<_>>(), map.span_ns())
    };
    let in_order = state([0, 2, 3, 1]);
    assert_eq!(in_order.0, [1.0, 1.0]);
    assert_eq!(in_order.1, [Some(2 * SECOND), Some(3 * SECOND)]);
    assert_eq!(in_order.2, Some((0, 3 * SECOND)));
    assert_eq!(state([1, 0, 3, 2]), in_order);
    assert_eq!(state([3, 2, 1, 0]), in_order);
}

#[test]
fn evidence_worked_by_hand() {
    let log_odds = |p: f64| (p / (1.0 - p)).ln();
    let prior = log_odds(0.2);
    let mut map = map(evidence());
    // Two drones at once: (3 + 3) / (2 + 1) sqrt 2. Nobody looks at voxel 1.
    map.integrate(&[look("a", 0.0, 0.9, 0), look("b", 0.0, 0.8, 0)], 0).unwrap();
    let first = map.probability(0).unwrap();
    assert!((log_odds(first[0]) - prior - 2.0 * 2f64.sqrt()).abs() < 1e-5);
    assert_close(first[1], 0.2);
    // After one memory 1 / e of it is left, and drone a sees nothing: weights 1 + 1 / e and 1 / e.
    let stamp = 10 * SECOND;
    map.integrate(&[look("a", 0.0, 0.1, stamp)], stamp).unwrap();
    let left = (-1f64).exp();
    let (a, b) = (1.0 + left, left);
    let drones = (a + b).powi(2) / (a * a + b * b);
    let expected = (6.0 * left - 2.0) / (a + b + 1.0) * drones.sqrt();
    assert!((log_odds(map.probability(stamp).unwrap()[0]) - prior - expected).abs() < 1e-5);
}

/// A camera beside voxel 0 and lower than its top sees its side only.
fn beside(drone: &str, m: f32, stamp_ns: i64) -> View {
    let camera = Camera::new(1, 1, 100.0, 100.0, 0.5, 0.5, Distortion::None).unwrap();
    let east = DMat3::from_cols(DVec3::NEG_Y, DVec3::NEG_Z, DVec3::X);
    let pose = Pose { rotation: east, translation: DVec3::new(-9.0, 0.5, 0.25) };
    View::new(drone, stamp_ns, Arc::new(camera), pose, Heatmap::new(vec![m], 1, 1).unwrap()).unwrap()
}

/// No crowd at its side says nothing of who stands on it.
#[test]
fn a_place_seen_from_below_is_not_found_empty() {
    let mut below = map(evidence());
    let update = below.integrate(&[beside("a", 0.1, 0)], 0).unwrap();
    assert_eq!(update.observations[0].voxel_ids(), [0]);
    assert_eq!((update.voxel_ids.len(), below.seen_count()), (0, 0));
    assert_eq!(below.state(0, 0.5, 30.0).unwrap(), [VoxelState::Occluded, VoxelState::NeverSeen]);
    assert!(below.seen_by(&[0]).unwrap().is_empty());
    // Crowd that shows there counts, beside the look of another drone that shows none.
    below.integrate(&[beside("a", 0.9, SECOND), beside("b", 0.1, SECOND)], SECOND).unwrap();
    assert_eq!(below.last_seen_ns_of(&[0]).unwrap(), [Some(SECOND)]);
    assert_eq!(below.seen_by(&[0]).unwrap(), ["a"]);
    let crowd = below.probability(SECOND).unwrap()[0];
    assert_close((crowd / (1.0 - crowd)).ln(), (0.2f64 / 0.8).ln() + 3.0 / 2.0);
    // None there, later, does not make the look any newer, nor the place any emptier.
    below.integrate(&[beside("a", 0.1, 2 * SECOND)], 2 * SECOND).unwrap();
    assert_eq!(below.last_seen_ns_of(&[0]).unwrap(), [Some(SECOND)]);
    assert_eq!(below.crowd_ids_at_last_looks(0.5).unwrap(), [0]);
    // The paper's rule has every drone vote.
    let mut literal = map(paper(0.1, 0.05, DecayUnit::Second, Initial::Prior));
    literal.integrate(&[beside("a", 0.1, 0)], 0).unwrap();
    assert_eq!(literal.seen_count(), 1);
}

/// A wall that looks like a landing site says nothing of the roof; people at its edge do.
#[test]
fn what_opens_ground_is_not_found_from_below_and_is_taken_back_from_there() {
    let mut map = map(evidence_of_what_opens_ground());
    map.integrate(&[beside("a", 0.9, 0)], 0).unwrap();
    assert_eq!(map.seen_count(), 0);
    map.integrate(&[look("a", 0.0, 0.9, SECOND)], SECOND).unwrap();
    let log_ratio = |map: &CrowdMap, stamp_ns| {
        let p = map.probability(stamp_ns).unwrap()[0];
        (p / (1.0 - p)).ln() - (0.2f64 / 0.8).ln()
    };
    assert_close(log_ratio(&map, SECOND), 3.0 / 2.0);
    map.integrate(&[beside("b", 0.9, SECOND), beside("a", 0.1, SECOND)], SECOND).unwrap();
    assert_close(log_ratio(&map, SECOND), (3.0 - 2.0) / (2.0 + 1.0));
    assert_eq!(map.seen_by(&[0]).unwrap(), ["a"]);
}

#[test]
fn looked_at_is_not_empty() {
    let mut map = map(evidence());
    let state = |map: &CrowdMap, stamp| map.state(stamp, 0.5, 30.0).unwrap()[0];
    // From 40 m a look has a sixteenth of the pixels: it says nearly nothing, and clears nothing.
    let mut far = look("a", 0.0, 0.0, 0);
    far.world_from_camera.translation.z = 40.0;
    map.integrate(&[far], 0).unwrap();
    assert_eq!(state(&map, 0), VoxelState::NotCleared);
    map.integrate(&[look("a", 0.0, 0.0, SECOND)], SECOND).unwrap();
    assert_eq!(state(&map, SECOND), VoxelState::Empty);
    // What it says fades before it counts as old.
    assert_eq!(state(&map, 30 * SECOND), VoxelState::NotCleared);
    assert_eq!(state(&map, 32 * SECOND), VoxelState::Stale);
}

#[test]
fn time_alone_makes_no_place_one_that_was_empty() {
    let state = |map: &CrowdMap, stamp| map.state(stamp, 0.25, 30.0).unwrap()[0];
    // A look from 40 m clears nothing; an hour later it still has not.
    let mut unsure = map(evidence());
    let mut far = look("a", 0.0, 0.0, 0);
    far.world_from_camera.translation.z = 40.0;
    unsure.integrate(&[far], 0).unwrap();
    assert_eq!(state(&unsure, 3600 * SECOND), VoxelState::NotCleared);
    // Crowd that is forgotten was not empty either, neither where forgetting ends at the prior nor where at free.
    for method in [evidence(), paper(1.0, 0.01, DecayUnit::Second, Initial::Zero)] {
        let mut crowd = map(method);
        crowd.integrate(&[look("a", 0.0, 1.0, 0)], 0).unwrap();
        assert_eq!(state(&crowd, 0), VoxelState::Crowd);
        assert_eq!(state(&crowd, 3600 * SECOND), VoxelState::NotCleared);
    }
}

#[test]
fn all_that_is_known_about_a_voxel() {
    let mut map = map(evidence());
    map.integrate(&[look("a", 0.0, 0.9, 0), look("b", 0.0, 0.8, 0)], 0).unwrap();
    let stamp = 10 * SECOND;
    let known = map.knowledge(&[0, 1], stamp, 0.5, 30.0).unwrap();
    assert_eq!(known[0].state, VoxelState::Crowd);
    assert_eq!(known[0].probability, map.probability(stamp).unwrap()[0]);
    assert_eq!((known[0].age_s, known[0].drones), (Some(10.0), 2));
    assert!((known[0].looks.unwrap() - 2.0 * (-1f64).exp()).abs() < 1e-6);
    let unknown = VoxelKnowledge {
        state: VoxelState::NeverSeen,
        probability: map.probability(stamp).unwrap()[1],
        age_s: None,
        looks: None,
        drones: 0,
    };
    assert_eq!(known[1], unknown);
    let message = map.knowledge(&[0], stamp, 0.0, 30.0).unwrap_err().to_string();
    assert_eq!(message, "threshold is 0; it must be in (0, 1]");
}

proptest! {
    #[test]
    fn evidence_is_the_same_in_any_order_and_grouping(
        looks in prop::collection::vec((0usize..3, any::<bool>(), 0.0f32..=1.0, 0i64..100), 1..40),
        shuffled in any::<prop::sample::Index>(),
    ) {
        // One view per drone and stamp; every look is an instant of its own, in some other order.
        let views: BTreeMap<(i64, usize), View> = looks.iter().map(|&(drone, at_second, m, second)| {
            let x = if at_second { 50.0 } else { 0.0 };
            ((second, drone), look(["a", "b", "c"][drone], x, m, second * SECOND))
        }).collect();
        let mut grouped = map(evidence());
        for second in 0..100 {
            let together: Vec<View> =
                views.iter().filter(|((at, _), _)| *at == second).map(|(_, view)| view.clone()).collect();
            if !together.is_empty() {
                grouped.integrate(&together, second * SECOND).unwrap();
            }
        }
        let mut alone: Vec<&View> = views.values().collect();
        let middle = shuffled.index(alone.len());
        alone.rotate_left(middle);
        alone.reverse();
        let mut single = map(evidence());
        for view in alone {
            single.integrate(std::slice::from_ref(view), view.stamp_ns).unwrap();
        }
        let stamp = 120 * SECOND;
        assert_all_within(&single.probability(stamp).unwrap(), &grouped.probability(stamp).unwrap(), 1e-5);
        prop_assert_eq!(single.last_seen_ns().collect::<Vec<_>>(), grouped.last_seen_ns().collect::<Vec<_>>());
    }

    #[test]
    fn a_view_that_comes_late_weighs_what_its_age_leaves(m in 0.0f32..=1.0, late_s in 2i64..60) {
        // Drone b's view arrives with the instant at 100 s, though it was taken before.
        let taken = (100 - late_s) * SECOND;
        let (mut in_time, mut late) = (map(evidence()), map(evidence()));
        in_time.integrate(&[look("b", 0.0, m, taken)], taken).unwrap();
        for map in [&mut in_time, &mut late] {
            map.integrate(&[look("a", 0.0, 0.7, 99 * SECOND)], 99 * SECOND).unwrap();
        }
        late.integrate(&[look("b", 0.0, m, taken)], 100 * SECOND).unwrap();
        let at = 100 * SECOND;
        assert_all_within(&late.probability(at).unwrap(), &in_time.probability(at).unwrap(), 1e-5);
    }
}

#[test]
fn or_needs_no_fleet_size() {
    let mut map = map(Method::Or(Or::new(0.5).unwrap()));
    let views: Vec<View> = (0..100).map(|at| look(&format!("uav{at}"), 0.0, 0.1, 0)).collect();
    map.integrate(&views, 0).unwrap();
    assert_eq!(map.drones().count(), 100);
}

#[test]
fn a_look_that_by_itself_shows_crowd_stands_whatever_others_show() {
    let mut map = map(evidence_that_shows());
    let shown = |map: &CrowdMap, second: i64| map.shown_ids(second * SECOND, 0.5).unwrap();
    let blind = |name: &str, second: i64| look(name, 0.0, 0.0, second * SECOND);
    // One that shows it among four that do not: ln(.2 / .8) + (7 - 4 * 2) / (5 + 1) * 5^.5 is no crowd.
    let mut views: Vec<View> = ["a", "b", "c", "d"].map(|name| blind(name, 10)).into();
    views.push(look("e", 0.0, 0.8, 10 * SECOND));
    map.integrate(&views, 10 * SECOND).unwrap();
    assert!(map.probability(10 * SECOND).unwrap()[0] < 0.2);
    assert_eq!(shown(&map, 10), [0]);
    // 3.5 above -1.386 are 2.114: clearly above .5, and not above .6, which is at .405.
    assert!(map.shown_ids(10 * SECOND, 0.6).unwrap().is_empty());
    // Neither one that shows nobody, nor one that shows it barely, nor one from before it makes it newer.
    map.integrate(&[blind("a", 11), look("e", 0.0, 0.7, 11 * SECOND)], 11 * SECOND).unwrap();
    map.integrate(&[look("e", 0.0, 0.8, 9 * SECOND)], 12 * SECOND).unwrap();
    assert_eq!(shown(&map, 12), [0]);
    assert!(map.shown_ids(12 * SECOND + 1, 0.5).unwrap().is_empty());
    // A view that comes late shows what it showed when it was taken.
    map.integrate(&[blind("a", 14), look("e", 0.0, 0.8, 25 * SECOND / 2)], 14 * SECOND).unwrap();
    let read = CrowdMap::from_bytes(&map.to_bytes(), two_voxels()).unwrap();
    for map in [&map, &read] {
        assert_eq!(shown(map, 14), [0]);
        assert!(shown(map, 15).is_empty());
        assert!(map.shown_ids(13 * SECOND, 0.5).is_err() && map.shown_ids(14 * SECOND, 0.0).is_err());
    }
}

#[test]
fn what_a_look_shows_is_not_empty_until_somebody_looks_after_that() {
    let mut map = map(evidence_that_shows());
    // Sixty looks that say -2 each, against one that says 7: far below .1, up to which ground is empty.
    for second in 0..12 {
        let mut views: Vec<View> =
            ["a", "b", "c", "d", "e"].map(|name| look(name, 0.0, 0.0, second * SECOND)).into();
        if second == 11 {
            views.push(look("f", 0.0, 0.8, second * SECOND));
        }
        map.integrate(&views, second * SECOND).unwrap();
    }
    let state = |map: &CrowdMap, second: i64| {
        let (stamp, rule) = (second * SECOND, (0.5, 30.0));
        let state = map.state(stamp, rule.0, rule.1).unwrap()[0];
        assert_eq!(map.knowledge(&[0], stamp, rule.0, rule.1).unwrap()[0].state, state);
        let is_empty = !map.empty_ids(stamp, rule.0, rule.1).unwrap().is_empty();
        assert_eq!(is_empty, state == VoxelState::Empty);
        state
    };
    assert!(map.probability(13 * SECOND).unwrap()[0] < 0.1);
    let mut map = CrowdMap::from_bytes(&map.to_bytes(), two_voxels()).unwrap();
    // Closed for 2 s; and time alone makes no place one that was empty.
    for (second, shown) in [(13, 1), (14, 0), (41, 0), (42, 0), (400, 0)] {
        assert_eq!(state(&map, second), VoxelState::NotCleared);
        assert_eq!(map.shown_ids(second * SECOND, 0.5).unwrap().len(), shown);
        assert_eq!(map.shown_ids_at_last_looks(0.5).unwrap(), [0]);
    }
    // Nor does a look that the clear one outlives.
    map.integrate(&[look("a", 0.0, 0.0, 13 * SECOND)], 13 * SECOND).unwrap();
    assert_eq!(state(&map, 16), VoxelState::NotCleared);
    map.integrate(&[look("a", 0.0, 0.0, 14 * SECOND)], 14 * SECOND).unwrap();
    assert_eq!(map.shown_ids_at_last_looks(0.5).unwrap(), [0_u32; 0]);
    assert_eq!((state(&map, 16), state(&map, 45)), (VoxelState::Empty, VoxelState::Stale));
}

#[test]
fn a_look_that_comes_late_shows_crowd_to_those_who_looked_just_after_it() {
    // e shows crowd at 10 s, four who see nobody look at 11 s; its link was down for a minute, or it was not.
    let mut maps = [map(evidence_that_shows()), map(evidence_that_shows())];
    let clear = look("e", 0.0, 0.8, 10 * SECOND);
    let blind: Vec<View> = ["a", "b", "c", "d"].map(|name| look(name, 0.0, 0.0, 11 * SECOND)).into();
    maps[0].integrate(std::slice::from_ref(&clear), 10 * SECOND).unwrap();
    for map in &mut maps {
        map.integrate(&blind, 11 * SECOND).unwrap();
        map.integrate(&[], 70 * SECOND).unwrap();
    }
    maps[1].integrate(&[clear], 70 * SECOND).unwrap();
    for map in &maps {
        assert!(map.crowd_ids_at_last_looks(0.5).unwrap().is_empty());
        assert_eq!(map.shown_ids_at_last_looks(0.5).unwrap(), [0]);
        assert_eq!(map.state(70 * SECOND, 0.5, 100.0).unwrap()[0], VoxelState::NotCleared);
    }
}

#[test]
fn only_evidence_tells_by_itself_what_shows_crowd() {
    for method in compared_methods().into_iter().chain([Method::Or(Or::new(0.5).unwrap())]) {
        let mut map = map(method);
        map.integrate(&[look("a", 0.0, 1.0, 0)], 0).unwrap();
        assert!(map.shown_ids(0, 0.01).unwrap().is_empty());
    }
}

#[test]
fn a_map_knows_who_saw_a_place() {
    let mut map = map(Method::Or(Or::new(0.5).unwrap()));
    map.integrate(&[look("b", 0.0, 0.0, 0), look("a", 0.0, 0.0, 0), look("c", 50.0, 1.0, 0)], 0).unwrap();
    assert_eq!(map.seen_by(&[0]).unwrap(), ["a", "b"]);
    assert_eq!(map.seen_by(&[1]).unwrap(), ["c"]);
    assert_eq!(map.seen_by(&[0, 1]).unwrap(), ["a", "b", "c"]);
    assert!(map.seen_by(&[]).unwrap().is_empty());
}

#[test]
fn weeks_of_instants_are_not_kept() {
    // Two voxels: at most two instants are named by one, and one more is open while the next is taken in.
    let mut map = map(paper(0.5, 0.0, DecayUnit::Second, Initial::Zero));
    for second in 0..10_000 {
        let x = if second % 7 == 0 { 50.0 } else { 0.0 };
        map.integrate(&[look("a", x, 0.5, second * SECOND)], second * SECOND).unwrap();
    }
    assert_eq!(map.instant_count(), 10_000);
    assert_eq!(map.span_ns(), Some((0, 9_999 * SECOND)));
    assert!(map.history.instants.kept() <= 3, "{}", map.history.instants.kept());
}

#[test]
fn a_file_of_an_older_version_gives_the_probabilities_that_it_was_saved_with() {
    // `reference/paper_v1.crowdmap` and the others were written by the last builds of their version, with these
    // views; what they answered then stands beside them. Up to version 2, P~ was kept as f64.
    let views = |second: i64| {
        let m = (second as f32 * 0.37) % 1.0;
        let x = if second % 3 == 0 { 50.0 } else { 0.0 };
        vec![look("a", x, m, second * SECOND)]
    };
    for (name, method) in [
        ("paper_v1", paper(0.1, 0.05, DecayUnit::Frame, Initial::Prior)),
        ("or_v1", Method::Or(Or::new(0.25).unwrap())),
        ("paper_v2", paper(0.1, 0.05, DecayUnit::Frame, Initial::Prior)),
        ("or_v2", Method::Or(Or::new(0.25).unwrap())),
        ("paper_v3", paper(0.1, 0.05, DecayUnit::Frame, Initial::Prior)),
        ("or_v3", Method::Or(Or::new(0.25).unwrap())),
    ] {
        let path = format!("{}/../../reference/{name}", env!("CARGO_MANIFEST_DIR"));
        let saved = std::fs::read(format!("{path}.crowdmap")).unwrap();
        let answers = std::fs::read_to_string(format!("{path}.txt")).unwrap();
        let answer = |line| f64::from_bits(u64::from_str_radix(line, 16).unwrap());
        let answers: Vec<f64> = answers.lines().map(answer).collect();
        let mut old = CrowdMap::from_bytes(&saved, two_voxels()).unwrap();
        assert_eq!(old.method(), method);
        assert_all_within(&old.probability(12 * SECOND).unwrap(), &answers, (-33f64).exp2());
        // It goes on as a map that was never saved.
        let mut new = map(method);
        (0..10).for_each(|second| drop(new.integrate(&views(second), second * SECOND).unwrap()));
        for map in [&mut old, &mut new] {
            (10..20).for_each(|second| drop(map.integrate(&views(second), second * SECOND).unwrap()));
        }
        let later = [&old, &new].map(|map| map.probability(25 * SECOND).unwrap());
        assert_all_within(&later[0], &later[1], (-32f64).exp2() / 0.1);
        assert_eq!(old.last_seen_ns().collect::<Vec<_>>(), new.last_seen_ns().collect::<Vec<_>>());
    }
}

/// Version 7 ended the method where version 8 says that of looks from below those count that show crowd, version 6 ended
/// each table of likelihood ratios where version 7 says that there is none of finer cameras.
#[test]
fn maps_of_before_there_were_these_settings_go_on() {
    let mut map = map(evidence());
    (0..5).for_each(|second| {
        drop(map.integrate(&[look("a", 0.0, 0.9, second * SECOND)], second * SECOND).unwrap())
    });
    let new = map.to_bytes();
    // Head, terrain, method; 8 settings; no borders of gsd and tilt, 1 of the mean, 2 ratios, each with its count.
    let says = 20 + 16 + 1 + 8 * 8 + 4 + 4 + (4 + 4) + (4 + 2 * 4);
    assert_eq!(new[says..says + 4], 0f32.to_le_bytes());
    assert_eq!(new[says + 4], 0);
    for (version, unknown) in [(7u32, says + 4..says + 5), (6, says..says + 5)] {
        let mut old = new[..new.len() - 4].to_vec();
        old.drain(unknown);
        old[8..12].copy_from_slice(&version.to_le_bytes());
        let payload = (old.len() - 20) as u64;
        old[12..20].copy_from_slice(&payload.to_le_bytes());
        old.extend(crc32fast::hash(&old).to_le_bytes());
        assert_eq!(CrowdMap::from_bytes(&old, two_voxels()).unwrap().to_bytes(), new);
    }
}

#[test]
fn drones_may_come_and_go_within_the_fleet() {
    let mut map = map(paper(0.1, 0.0, DecayUnit::Second, Initial::Zero));
    for (second, drones) in [&["a", "b"][..], &["b"], &[], &["c", "a"]].into_iter().enumerate() {
        let stamp = second as i64 * SECOND;
        let views: Vec<View> = drones.iter().map(|drone| look(drone, 0.0, 0.5, stamp)).collect();
        map.integrate(&views, stamp).unwrap();
    }
    assert_eq!(map.instant_count(), 4);
}

/// Those that `evidence` is compared with.
fn compared_methods() -> [Method; 4] {
    let (rates, blend) = (Rates::new(0.9, 0.1).unwrap(), TemporalBlend::new(0.3, 0.02).unwrap());
    let calibration = three_step_calibration;
    [
        Method::LinearPool(LinearPool::new(rates, 0.2, 0.5, blend).unwrap()),
        Method::LogPool(LogPool::new(calibration(), blend, 0.4).unwrap()),
        Method::LogOdds(LogOdds::new(rates, 0.2, 0.5, [-2.0, 3.5]).unwrap()),
        Method::MovingAverage(MovingAverage::new(calibration(), 4.0, 0.4).unwrap()),
    ]
}

#[test]
fn a_saved_map_goes_on_as_if_it_had_never_stopped() {
    let instants = |map: &mut CrowdMap, seconds: std::ops::Range<i64>| {
        for second in seconds {
            let m = (second as f32 * 0.37) % 1.0;
            map.integrate(&[look("a", 0.0, m, second * SECOND)], second * SECOND).unwrap();
        }
    };
    let or = Method::Or(Or::new(0.25).unwrap());
    let table = |ratios| LikelihoodRatio::new(vec![], vec![], vec![0.5], ratios).unwrap();
    let finer = evidence_of(table(vec![-2.0, 3.0]).with_finer(3.0, table(vec![-1.0, 2.0])).unwrap());
    let stored = [
        finer,
        evidence_of_what_opens_ground(),
        evidence_that_shows(),
        paper(0.1, 0.05, DecayUnit::Frame, Initial::Prior),
        or,
    ];
    for method in stored.into_iter().chain(compared_methods()) {
        let mut whole = map(method);
        instants(&mut whole, 0..10);
        let mut resumed = CrowdMap::from_bytes(&whole.to_bytes(), two_voxels()).unwrap();
        instants(&mut whole, 10..20);
        instants(&mut resumed, 10..20);
        assert_eq!(whole.to_bytes(), resumed.to_bytes());
    }
}

#[test]
fn a_file_of_another_terrain_version_or_kind_is_refused() {
    let mut map = map(paper(0.1, 0.0, DecayUnit::Second, Initial::Zero));
    map.integrate(&[look("a", 0.0, 1.0, 0)], 0).unwrap();
    let bytes = map.to_bytes();
    let message = |data: &[u8]| CrowdMap::from_bytes(data, two_voxels()).unwrap_err().to_string();

    let other = Terrain::from_indices(&[[0, 0, 0], [51, 0, 0]], 1.0, DVec3::ZERO).unwrap();
    let refused = CrowdMap::from_bytes(&bytes, Arc::new(other)).unwrap_err().to_string();
    assert!(refused.contains("another terrain"), "{refused}");
    assert!(message(b"PNG").contains("too short"));
    assert!(message(&[b'x'; 100]).contains("does not begin with CROWDMAP"));
    let mut newer = bytes.clone();
    newer[8] = 9;
    assert!(message(&newer).contains("version 9; this build reads version 1 to 8"));
    assert!(message(&bytes[..bytes.len() - 1]).contains("shorter or longer"));
    let mut flipped = bytes.clone();
    flipped[100] ^= 1;
    assert!(message(&flipped).contains("checksum"));
}
