//! Equations 1-3 against `reference/equations.json`, worked out by hand (see `reference/README.md`).

use std::sync::Arc;

use crowdfence::method::{DecayUnit, Initial};
use crowdfence::view::Pose;
use crowdfence::{
    Camera, Coverage, CrowdMap, Distortion, Heatmap, Method, OpinionPool, Paper, Projection, Rates,
    TemporalBlend, Terrain, Unseen, View,
};
use glam::{DMat3, DVec3};
use serde_json::Value;

const TOLERANCE: f64 = 1e-12;

fn reference() -> Value {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../reference/equations.json");
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

fn cases<'a>(reference: &'a Value, part: &str) -> &'a [Value] {
    let cases = reference[part].as_array().unwrap();
    assert!(!cases.is_empty());
    cases
}

fn number(value: &Value, key: &str) -> f64 {
    value[key].as_f64().unwrap_or_else(|| panic!("{key} in {value}"))
}

fn stamp_ns(value: &Value) -> i64 {
    value["stamp_s"].as_i64().unwrap() * 1_000_000_000
}

#[track_caller]
fn assert_close(actual: f64, case: &Value, key: &str) {
    let expected = number(case, key);
    assert!((actual - expected).abs() < TOLERANCE, "{actual}, not {expected}: {case}");
}

fn opinion_pool(detector: &Value, case: &Value) -> OpinionPool {
    let rates = Rates::new(number(detector, "true_positive"), number(detector, "false_positive")).unwrap();
    let b_threshold = case["b_threshold"].as_f64().unwrap_or(0.5);
    let unseen = match case["unseen"].as_str() {
        None => Unseen::Fleet,
        Some("visible") => Unseen::Visible,
        Some(other) => panic!("unseen is {other}"),
    };
    let normalise = case["normalise"].as_bool().unwrap_or(false);
    OpinionPool::new(rates, number(detector, "prior"), b_threshold, unseen, normalise).unwrap()
}

#[test]
fn posteriors_of_the_detectors() {
    for detector in reference()["detectors"].as_object().unwrap().values() {
        let pool = opinion_pool(detector, &Value::Null);
        assert_close(pool.post_positive(), detector, "post_positive");
        assert_close(pool.post_negative(), detector, "post_negative");
    }
}

#[test]
fn equations_1_and_2() {
    let reference = reference();
    for case in cases(&reference, "pool") {
        let pool = opinion_pool(&reference["detectors"][case["detector"].as_str().unwrap()], case);
        let fleet = case["m"].as_array().unwrap();
        let views: Vec<f64> = fleet.iter().filter_map(Value::as_f64).collect();
        assert_close(pool.pool(views, fleet.len()), case, "probability");
    }
}

#[test]
fn equation_3() {
    let reference = reference();
    for case in cases(&reference, "blend") {
        let blend = TemporalBlend::new(number(case, "alpha"), number(case, "decay_per_s")).unwrap();
        let (previous, elapsed_s) = (number(case, "previous"), number(case, "elapsed_s"));
        let blended = match case["pooled"].as_f64() {
            Some(pooled) => blend.blend(previous, elapsed_s, pooled),
            None => blend.fade(previous, elapsed_s),
        };
        assert_close(blended, case, "probability");
    }
}

#[test]
fn the_crowd_map_over_time() {
    let reference = reference();
    for case in cases(&reference, "crowd_map") {
        let mut map = one_voxel_map(paper(&reference["detectors"]["quarter"], case));
        for instant in case["instants"].as_array().unwrap() {
            let looks = instant["m"].as_object().unwrap().iter();
            let views: Vec<View> =
                looks.map(|(drone, m)| look(drone, m.as_f64().unwrap(), stamp_ns(instant))).collect();
            map.integrate(&views, stamp_ns(instant)).unwrap();
        }
        // P~ is kept in steps of 2^-32.
        let tolerance = TOLERANCE + (-33f64).exp2() / number(case, "alpha");
        for read in case["reads"].as_array().unwrap() {
            let probability = map.probability(stamp_ns(read)).unwrap()[0];
            assert!(
                (probability - number(read, "probability")).abs() < tolerance,
                "{probability} in {read} of {}",
                case["name"]
            );
        }
    }
}

fn paper(detector: &Value, case: &Value) -> Paper {
    let initial = match case["initial"].as_str().unwrap() {
        "zero" => Initial::Zero,
        "prior" => Initial::Prior,
        "first" => Initial::FirstLook,
        other => panic!("initial is {other}"),
    };
    let decay = match case["decay_unit"].as_str() {
        None => DecayUnit::Second,
        Some("frame") => DecayUnit::Frame,
        Some(other) => panic!("decay_unit is {other}"),
    };
    let blend = TemporalBlend::new(number(case, "alpha"), number(case, "decay")).unwrap();
    let fleet_size = case["fleet_size"].as_u64().unwrap() as usize;
    Paper::new(opinion_pool(detector, case), blend, fleet_size, initial, decay).unwrap()
}

fn one_voxel_map(paper: Paper) -> CrowdMap {
    let terrain = Terrain::from_indices(&[[0, 0, 0]], 1.0, DVec3::ZERO).unwrap();
    let projection = Projection::new(100.0, 0.0, Coverage::Rays).unwrap();
    CrowdMap::new(Arc::new(terrain), Method::Paper(paper), projection, f64::INFINITY).unwrap()
}

/// A camera of one pixel straight above the voxel.
fn look(drone: &str, m: f64, stamp_ns: i64) -> View {
    let camera = Camera::new(1, 1, 100.0, 100.0, 0.5, 0.5, Distortion::None).unwrap();
    let down = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
    let pose = Pose::new(down, DVec3::new(0.5, 0.5, 10.0)).unwrap();
    let heatmap = Heatmap::new(vec![m as f32], 1, 1).unwrap();
    View::new(drone, stamp_ns, Arc::new(camera), pose, heatmap).unwrap()
}
