use proptest::prelude::*;

use super::*;

const TERRAIN: TerrainKey = TerrainKey { fingerprint: 7, voxel_count: 100 };

fn seen(ids: &[u32]) -> SeenVoxels {
    let count = ids.len();
    SeenVoxels {
        ids: ids.to_vec(),
        mean: vec![0.5; count],
        pixel_count: vec![1; count],
        range_m: vec![20.0; count],
        tilt_deg: vec![45.0; count],
    }
}

fn refusal(seen: SeenVoxels, occluded_ids: &[u32]) -> String {
    Observation::new(TERRAIN, "uav1", 0, seen, occluded_ids.to_vec(), CrowdMass::default())
        .unwrap_err()
        .to_string()
}

#[test]
fn what_would_lie_later_is_refused_now() {
    assert_eq!(refusal(seen(&[3, 2]), &[]), "voxel_ids must be sorted and unique: 2 follows 3 at position 1");
    assert_eq!(refusal(seen(&[2, 2]), &[]), "voxel_ids must be sorted and unique: 2 follows 2 at position 1");
    assert_eq!(
        refusal(seen(&[]), &[5, 4]),
        "occluded_ids must be sorted and unique: 4 follows 5 at position 1"
    );
    assert_eq!(refusal(seen(&[100]), &[]), "voxel id 100 does not exist; the terrain has ids 0 to 99");
    assert_eq!(refusal(seen(&[]), &[100]), "voxel id 100 does not exist; the terrain has ids 0 to 99");
    assert_eq!(refusal(seen(&[1, 4]), &[4]), "voxel 4 is both seen and occluded in one view");
    let mut short = seen(&[1, 2]);
    short.mean.pop();
    assert_eq!(refusal(short, &[]), "mean has 1 values; 2 are needed");
}

#[test]
fn no_number_may_be_outside_its_bound() {
    for mean in [f64::NAN, -0.1, 1.1, f64::INFINITY] {
        let broken = SeenVoxels { mean: vec![0.5, mean], ..seen(&[1, 2]) };
        assert!(refusal(broken, &[]).contains("it must be inside [0, 1]"));
    }
    for range_m in [f32::NAN, -1.0, f32::INFINITY] {
        let broken = SeenVoxels { range_m: vec![1.0, range_m], ..seen(&[1, 2]) };
        assert!(refusal(broken, &[]).contains("range_m is"));
    }
    for tilt_deg in [f32::NAN, -90.1, 91.0] {
        let broken = SeenVoxels { tilt_deg: vec![1.0, tilt_deg], ..seen(&[1, 2]) };
        assert!(refusal(broken, &[]).contains("it must be inside [-90, 90]"));
    }
}

#[test]
fn crowd_mass_is_what_pixels_can_add_up_to() {
    for lost in [f64::NAN, -0.5, f64::INFINITY] {
        let crowd_mass = CrowdMass { hole: lost, ..CrowdMass::default() };
        let refused = Observation::new(TERRAIN, "uav1", 0, seen(&[]), vec![], crowd_mass).unwrap_err();
        assert_eq!(refused.to_string(), format!("hole is {lost}; it must be finite and >= 0"));
    }
}

#[test]
fn crowd_masses_add_up_fate_by_fate() {
    let one = CrowdMass { ground: 1.0, hole: 2.0, sky: 0.25, ..CrowdMass::default() };
    let other = CrowdMass { ground: 4.0, out_of_range: 8.0, off_map: 16.0, unusable: 32.0, ..one };
    let sum: CrowdMass = [one, other].into_iter().sum();
    assert_eq!(sum.by_fate().map(|(_, mass)| mass), [5.0, 8.0, 4.0, 16.0, 0.5, 32.0]);
    assert_eq!((sum.total(), sum.lost()), (65.5, 60.5));
}

#[test]
fn a_view_without_a_drone_or_from_before_all_clocks_is_refused() {
    let error = Observation::new(TERRAIN, "", 0, seen(&[]), vec![], CrowdMass::default()).unwrap_err();
    assert!(error.to_string().contains("drone name is empty"), "{error}");
    let error = Observation::new(TERRAIN, "uav1", -1, seen(&[]), vec![], CrowdMass::default()).unwrap_err();
    assert!(error.to_string().contains("stamp -1 ns is negative"), "{error}");
}

prop_compose! {
    fn observation()(
        voxels in prop::collection::btree_map(
            0u32..100, (0.0f64..=1.0, any::<u32>(), 0.0f32..1e4, -90.0f32..=90.0), 0..40),
        hidden in prop::collection::btree_set(0u32..100, 0..40),
        drone in "[a-z]{1,8}",
        stamp_ns in 0i64..,
        mass in prop::array::uniform6(0.0f64..1e9),
        focal_px in 0.0f32..1e4,
    ) -> Observation {
        let hidden = hidden.into_iter().filter(|id| !voxels.contains_key(id)).collect();
        let seen = SeenVoxels {
            ids: voxels.keys().copied().collect(),
            mean: voxels.values().map(|voxel| voxel.0).collect(),
            pixel_count: voxels.values().map(|voxel| voxel.1).collect(),
            range_m: voxels.values().map(|voxel| voxel.2).collect(),
            tilt_deg: voxels.values().map(|voxel| voxel.3).collect(),
        };
        let [ground, out_of_range, hole, off_map, sky, unusable] = mass;
        let crowd_mass = CrowdMass { ground, out_of_range, hole, off_map, sky, unusable };
        let observation = Observation::new(TERRAIN, drone, stamp_ns, seen, hidden, crowd_mass).unwrap();
        observation.with_focal_px(focal_px).unwrap()
    }
}

#[test]
fn a_focal_length_is_one() {
    for focal_px in [f32::NAN, -1.0, f32::INFINITY] {
        let observation =
            Observation::new(TERRAIN, "uav1", 0, seen(&[]), vec![], CrowdMass::default()).unwrap();
        let refused = observation.with_focal_px(focal_px).unwrap_err().to_string();
        assert!(refused.starts_with("focal_px is"), "{refused}");
    }
}

#[test]
fn bytes_without_a_focal_length_are_read() {
    // Version 1 ended with the crowd mass.
    let observation =
        Observation::new(TERRAIN, "uav1", 5, seen(&[3, 9]), vec![4], CrowdMass::default()).unwrap();
    let mut bytes = observation.to_bytes();
    let (checksum, focal, length) = (4, 4, bytes.len());
    bytes.truncate(length - checksum - focal);
    bytes[8..12].copy_from_slice(&1u32.to_le_bytes());
    let payload = (bytes.len() - 20) as u64;
    bytes[12..20].copy_from_slice(&payload.to_le_bytes());
    let sum = crc32fast::hash(&bytes);
    bytes.extend(sum.to_le_bytes());
    assert_eq!(Observation::from_bytes(&bytes).unwrap(), observation);
}

proptest! {
    #[test]
    fn bytes_bring_back_the_same(observation in observation()) {
        prop_assert_eq!(Observation::from_bytes(&observation.to_bytes()).unwrap(), observation);
    }
}
