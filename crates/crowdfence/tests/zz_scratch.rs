use crowdfence::Terrain;
use glam::DVec3;
use proptest::prelude::*;
fn number() -> impl Strategy<Value = f64> {
    prop_oneof![
        any::<f64>(),
        -10.0..10.0,
        (-1e20..1e20),
        Just(0.0),
        Just(1.0),
        Just(f64::MAX),
        Just(f64::MIN_POSITIVE),
        (-320.0..308.0f64).prop_map(|e| 10f64.powf(e)),
        (-320.0..308.0f64).prop_map(|e| -(10f64.powf(e)))
    ]
}
proptest! {
    #![proptest_config(ProptestConfig{cases: 200_000, failure_persistence: None, ..Default::default()})]
    #[test]
    fn any_ray(o in prop::array::uniform3(number()), d in prop::array::uniform3(number())) {
        let t = Terrain::from_indices(&[[0,0,0],[1,1,1],[3,2,1],[20,3,7]], 0.5, DVec3::ZERO).unwrap();
        let _ = t.raycast_many(&[DVec3::from(o)], &[DVec3::from(d)], f64::INFINITY);
    }
}
