use proptest::prelude::*;

use super::*;

const SHARP_PX: f32 = 100.0;

/// From .1 m a pixel on sharp. Up to .5 a look says -2 from near and -.5 from .2 m a pixel on, above it says 3.
fn evidence() -> Evidence {
    let likelihood = LikelihoodRatio::new(vec![0.2], vec![], vec![0.5], vec![-2.0, 3.0, -0.5, 3.0]).unwrap();
    Evidence::new(Arc::new(likelihood), settings()).unwrap()
}

fn settings() -> EvidenceSettings {
    EvidenceSettings {
        prior: 0.2,
        memory_s: 10.0,
        sharp_gsd_m: 0.1,
        doubt: 1.0,
        agreement: 0.5,
        threshold: 0.5,
        cleared: 0.1,
        focal_px: 100.0,
        from_below: FromBelow::For,
    }
}

/// From 10 m: .1 m a pixel.
fn look(drone: u32, mean: f64) -> VoxelLook {
    VoxelLook {
        voxel_id: 0,
        view: drone,
        drone,
        mean,
        pixel_count: 1,
        range_m: 10.0,
        tilt_deg: 90.0,
        focal_px: SHARP_PX,
    }
}

/// L without the prior.
fn log_ratio(evidence: &Evidence, sum: LooksSum, seconds: f64) -> f64 {
    let fading = evidence.fading(Elapsed { seconds, instants: 0 });
    let p = evidence.probability(sum, fading);
    (p / (1.0 - p)).ln() - (0.2f64 / 0.8).ln()
}

#[track_caller]
fn assert_close(actual: f64, expected: f64) {
    assert!((actual - expected).abs() < 1e-5, "{actual} != {expected}");
}

#[test]
fn looks_are_averaged_against_the_doubt() {
    let evidence = evidence();
    let after = |means: &[f64]| {
        let sum =
            means.iter().fold(None, |sum, &mean| Some((evidence.update(sum, &[(look(0, mean), 1.0)]), 1.0)));
        log_ratio(&evidence, sum.unwrap().0, 0.0)
    };
    assert_close(after(&[0.9]), 3.0 / 2.0);
    assert_close(after(&[0.9, 0.9, 0.9]), 9.0 / 4.0);
    assert_close(after(&[0.9, 0.2]), (3.0 - 2.0) / 3.0);
    assert_close(after(&[0.5]), -2.0 / 2.0);
}

#[test]
fn another_drone_adds_what_the_same_one_does_not() {
    let evidence = evidence();
    let both = |second| evidence.update(None, &[(look(0, 0.9), 1.0), (look(second, 0.9), 1.0)]);
    assert_close(log_ratio(&evidence, both(0), 0.0), 6.0 / 3.0);
    assert_close(log_ratio(&evidence, both(1), 0.0), 6.0 / 3.0 * 2f64.sqrt());
    // Two looks of one drone and one of another: 3^2 / (2^2 + 1) = 1.8 drones.
    let third = evidence.update(Some((both(0), 1.0)), &[(look(1, 0.9), 1.0)]);
    assert_close(log_ratio(&evidence, third, 0.0), 9.0 / 4.0 * 1.8f64.sqrt());
}

#[test]
fn a_coarse_look_weighs_by_its_pixels_and_says_less() {
    let evidence = evidence();
    // Twice as far: a quarter of the pixels, and by the table -.5 instead of -2.
    let far = VoxelLook { range_m: 20.0, ..look(0, 0.1) };
    let sum = evidence.update(None, &[(far, 1.0)]);
    assert_close(log_ratio(&evidence, sum, 0.0), 0.25 * -0.5 / 1.25);
    // A camera of half the focal length sees from 10 m what the other sees from there.
    let wide = VoxelLook { focal_px: 50.0, ..look(0, 0.1) };
    assert_eq!(evidence.update(None, &[(wide, 1.0)]), sum);
    // A view that does not say its focal length has that of the calibration.
    let unknown = VoxelLook { focal_px: 0.0, ..far };
    assert_eq!(evidence.update(None, &[(unknown, 1.0)]), sum);
}

#[test]
fn what_nobody_looks_at_returns_to_the_prior() {
    let evidence = evidence();
    let sum = evidence.update(None, &[(look(0, 0.9), 1.0)]);
    let left = 0.5; // after ln 2 memories
    let seconds = 10.0 * std::f64::consts::LN_2;
    assert_close(log_ratio(&evidence, sum, seconds), 3.0 * left / (left + 1.0));
    assert_close(log_ratio(&evidence, sum, 1e6), 0.0);
    assert_close(evidence.unseen_probability(), 0.2);
}

#[test]
fn empty_is_a_claim() {
    let evidence = evidence();
    let after = |mean| evidence.probability(evidence.update(None, &[(look(0, mean), 1.0)]), 1.0);
    assert!(evidence.clears(after(0.1))); // 1 / (1 + 4 e)
    assert!(!evidence.clears(evidence.unseen_probability()));
    let far = VoxelLook { range_m: 40.0, ..look(0, 0.1) };
    let unsure = evidence.probability(evidence.update(None, &[(far, 1.0)]), 1.0);
    assert!(unsure < 0.2 && !evidence.clears(unsure));
}

#[test]
fn a_belief_takes_sixteen_bytes() {
    assert_eq!(size_of::<LooksSum>(), 16);
}

#[test]
fn what_makes_no_sense_is_refused_by_its_name() {
    let refusal = |settings| {
        let likelihood = evidence().likelihood().clone();
        Evidence::new(Arc::new(likelihood), settings).unwrap_err().to_string()
    };
    let good = settings();
    assert!(refusal(EvidenceSettings { prior: 0.0, ..good }).starts_with("prior is 0;"));
    assert!(refusal(EvidenceSettings { memory_s: f64::INFINITY, ..good }).starts_with("memory_s is inf;"));
    assert!(refusal(EvidenceSettings { doubt: 0.0, ..good }).starts_with("doubt is 0;"));
    assert!(refusal(EvidenceSettings { agreement: 1.5, ..good }).starts_with("agreement is 1.5;"));
    assert!(
        refusal(EvidenceSettings { cleared: 0.3, ..good }).contains("below both the prior and the threshold")
    );
    assert!(refusal(EvidenceSettings { focal_px: f64::NAN, ..good }).starts_with("focal_px is NaN;"));
    let table = |gsd_m: Vec<f32>, log_ratio: Vec<f32>| {
        LikelihoodRatio::new(gsd_m, vec![], vec![0.5], log_ratio).unwrap_err().to_string()
    };
    assert_eq!(table(vec![0.2], vec![0.0; 3]), "log_ratio has 3 values; 4 are needed");
    assert!(table(vec![0.2, 0.2], vec![0.0; 6]).contains("finite, > 0 and increasing"));
    assert!(table(vec![0.2], vec![0.0, 0.0, f32::NAN, 0.0]).starts_with("log_ratio is NaN;"));
}

/// 30 m away theirs see .3 m a pixel, which is no finer for a look that shows nobody, and .2 m for one that shows crowd.
#[test]
fn a_look_of_a_camera_finer_than_those_of_the_calibration_is_hardly_finer() {
    let evidence = evidence();
    let left = |mean: f64, focal_px: f32| {
        let look = VoxelLook { range_m: 30.0, focal_px, ..look(0, mean) };
        log_ratio(&evidence, evidence.update(None, &[(look, 1.0)]), 0.0)
    };
    let (theirs, half_as_fine) = (1.0 / 9.0, 1.0 / 36.0);
    assert_close(left(0.4, 100.0), -0.5 * theirs / (theirs + 1.0));
    assert_close(left(0.4, 400.0), -0.5 * theirs / (theirs + 1.0));
    assert_close(left(0.4, 50.0), -0.5 * half_as_fine / (half_as_fine + 1.0));
    assert_close(left(0.9, 100.0), 3.0 * theirs / (theirs + 1.0));
    assert_close(left(0.9, 120.0), 3.0 * 0.16 / 1.16);
    assert_close(left(0.9, 400.0), 3.0 * 0.25 / 1.25);
}

/// Theirs of 100 px say -0.5 and 3.0 up to .2 m a pixel. Of cameras 4 times as fine, another table is known.
#[test]
fn what_a_finer_camera_says_was_measured_of_such_cameras() {
    let finer = LikelihoodRatio::new(vec![0.05], vec![], vec![0.5], vec![-1.5, 1.0, -4.0, 0.6]).unwrap();
    let both = evidence().likelihood().clone().with_finer(4.0, finer).unwrap();
    let says = |mean: f64, range_m: f32, focal_px: f32| {
        both.of_look(&VoxelLook { range_m, focal_px, ..look(0, mean) }, 100.0)
    };
    let near = 10.0;
    // As coarse as theirs, or coarser: theirs alone.
    assert_eq!(
        says(0.9, near, 100.0),
        evidence().likelihood().of_look(&VoxelLook { range_m: near, ..look(0, 0.9) }, 100.0)
    );
    assert_eq!(says(0.4, near, 50.0).0, both.log_ratio(0.2, 90.0, 0.4));
    // 10 m away they see .1 m a pixel, cameras 4 times as fine .025 m, which is below .05 m.
    assert_eq!(says(0.9, near, 400.0).0, 1.0);
    assert_eq!(says(0.4, near, 400.0).0, -1.5);
    assert_eq!(says(0.4, near, 4000.0).0, -1.5); // what is finer still is one of these
    assert_eq!(says(0.9, 30.0, 4000.0).0, 0.6); // 30 m away .075 m
    assert_eq!(says(0.4, 30.0, 4000.0).0, -0.5); // that nobody shows speaks no more against crowd than with theirs
    // 2.5 times as fine lies in the middle.
    let theirs = both.log_ratio(0.1, 90.0, 0.9);
    assert!((says(0.9, near, 250.0).0 - (theirs + 1.0) / 2.0).abs() < 1e-6);
    // It weighs by .1 m where nobody shows, else 1.5 times as fine at most.
    assert_eq!([says(0.4, near, 400.0).1, says(0.4, near, 250.0).1], [0.1, 0.1]);
    assert!((says(0.9, near, 400.0).1 - 0.1 / 1.5).abs() < 1e-6);
    assert!((says(0.9, near, 125.0).1 - 0.08).abs() < 1e-6);
}

#[test]
fn a_table_of_cameras_that_are_not_finer_is_refused() {
    for times in [1.0, 0.5, f32::NAN, f32::INFINITY, 1001.0] {
        let table = evidence().likelihood().clone();
        let refusal = table.clone().with_finer(times, table).unwrap_err().to_string();
        assert!(refusal.starts_with("times is"), "{refusal}");
    }
    // The last of several is the one that is known.
    let table = evidence().likelihood().clone();
    let twice = table.clone().with_finer(3.0, table.clone()).unwrap();
    let thrice = table.clone().with_finer(2.0, twice).unwrap();
    assert_eq!((thrice.finer().unwrap().times(), thrice.finer().unwrap().table()), (2.0, &table));
}

prop_compose! {
    /// A look and its age in seconds.
    fn aged_look()(
        drone in 0u32..3, mean in 0.0f64..=1.0, range_m in 1.0f32..100.0, age in 0.0f64..60.0,
    ) -> (VoxelLook, f64) {
        (VoxelLook { range_m, ..look(drone, mean) }, age)
    }
}

/// The sums straight from their definition, in f64.
fn slow_log_ratio(evidence: &Evidence, looks: &[(VoxelLook, f64)]) -> f64 {
    let (mut sum, mut weights) = (0.0, [0.0; 3]);
    for (look, age) in looks {
        let gsd_m = look.range_m / look.focal_px;
        let weight = f64::from((0.1 / gsd_m).min(1.0)).powi(2) * (-age / 10.0).exp();
        sum += weight * f64::from(evidence.likelihood().log_ratio(gsd_m, look.tilt_deg, look.mean as f32));
        weights[look.drone as usize] += weight;
    }
    let weight: f64 = weights.iter().sum();
    let drones = weight * weight / weights.iter().map(|weight| weight * weight).sum::<f64>();
    sum / (weight + 1.0) * drones.sqrt()
}

proptest! {
    /// It shows what the method makes of it where nobody else has looked, and nothing is passed over for its mean.
    #[test]
    fn a_look_alone_shows_what_it_leaves_where_nobody_else_looked(
        table in prop::collection::vec(-4.0f32..8.0, 12),
        mean in prop_oneof![Just(0.0), Just(0.25), Just(0.5), 0.0f64..=1.0],
        range_m in 1.0f32..60.0,
        doubt in 0.1f64..2.0,
    ) {
        let likelihood = LikelihoodRatio::new(vec![0.1, 0.3], vec![], vec![0.25, 0.5, 0.8], table).unwrap();
        let evidence = Evidence::new(Arc::new(likelihood), EvidenceSettings { doubt, ..settings() }).unwrap();
        let look = VoxelLook { range_m, ..look(0, mean) };
        let left = log_ratio(&evidence, evidence.update(None, &[(look, 1.0)]), 0.0);
        prop_assume!((left - CLEARLY).abs() > 1e-4);
        match evidence.log_odds_alone(&look) {
            Some(log_odds) => {
                prop_assert!(left > CLEARLY);
                prop_assert!((f64::from(log_odds) - left - (0.2f64 / 0.8).ln()).abs() < 1e-4);
            }
            None => prop_assert!(left < CLEARLY),
        }
    }

    #[test]
    fn the_sums_are_those_of_the_definition(looks in prop::collection::vec(aged_look(), 1..60)) {
        let evidence = evidence();
        let late = looks.iter().map(|&(look, age)| (look, evidence.fading(Elapsed { seconds: age, instants: 0 })));
        let sum = evidence.update(None, &late.collect::<Vec<_>>());
        prop_assert!((log_ratio(&evidence, sum, 0.0) - slow_log_ratio(&evidence, &looks)).abs() < 1e-4);
    }

    #[test]
    fn more_crowd_never_makes_crowd_less_likely(
        looks in prop::collection::vec(aged_look(), 1..20), which in any::<prop::sample::Index>(),
    ) {
        let evidence = evidence();
        let p = |looks: &[(VoxelLook, f64)]| {
            let late = looks.iter().map(|&(look, age)| (look, evidence.fading(Elapsed { seconds: age, instants: 0 })));
            evidence.probability(evidence.update(None, &late.collect::<Vec<_>>()), 1.0)
        };
        let mut more = looks.clone();
        more[which.index(looks.len())].0.mean = 1.0;
        prop_assert!(p(&more) >= p(&looks) - 1e-9);
        prop_assert!((0.0..=1.0).contains(&p(&looks)));
    }

    #[test]
    fn forgetting_leads_towards_the_prior_and_never_past_it(
        looks in prop::collection::vec(aged_look(), 1..20), seconds in 0.0f64..100.0, more in 0.0f64..100.0,
    ) {
        let evidence = evidence();
        let late: Vec<_> = looks.iter().map(|&(look, _)| (look, 1.0)).collect();
        let sum = evidence.update(None, &late);
        let (sooner, later) = (log_ratio(&evidence, sum, seconds), log_ratio(&evidence, sum, seconds + more));
        prop_assert!(later.abs() <= sooner.abs() + 1e-6 && later * sooner >= -1e-9);
    }

    #[test]
    fn a_look_that_comes_twice_says_nothing_new(looks in prop::collection::vec(aged_look(), 1..20)) {
        // Every look twice: the mean stays, only the doubt counts for less. No more is claimed than the mean.
        let evidence = evidence();
        let late: Vec<_> = looks.iter().map(|&(look, _)| (look, 1.0)).collect();
        let once = evidence.update(None, &late);
        let twice = evidence.update(Some((once, 1.0)), &late);
        let (before, after) = (log_ratio(&evidence, once, 0.0), log_ratio(&evidence, twice, 0.0));
        prop_assert!(after.abs() <= 2.0 * before.abs() + 1e-5 && after * before >= -1e-9);
        prop_assert!(after.abs() <= 3.0 * 3f64.sqrt() + 1e-5);
    }
}
