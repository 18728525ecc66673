//! Hostile observations, as they may come over a network: reading ends in an observation that keeps every promise
//! or in an error, never in a panic. CROWDFENCE_FUZZ_CASES sets the number of cases per property.

mod damage;

use crowdfence::{CrowdMass, Observation, SeenVoxels, TerrainKey};
use proptest::prelude::*;

use damage::{config, mutation};

const TERRAIN: TerrainKey = TerrainKey { fingerprint: 0x0123_4567_89ab_cdef, voxel_count: 1000 };

fn check(data: &[u8]) {
    match Observation::from_bytes(data) {
        Ok(observation) => {
            assert!(observation.voxel_ids().is_sorted_by(|a, b| a < b));
            assert!(observation.occluded_ids().is_sorted_by(|a, b| a < b));
            assert!(observation.mean().iter().all(|m| (0.0..=1.0).contains(m)));
            assert!(observation.crowd_mass().check().is_ok());
            assert_eq!(Observation::from_bytes(&observation.to_bytes()).unwrap(), observation);
        }
        Err(error) => assert!(error.to_string().len() < 300, "{error}"),
    }
}

/// Writes length and checksum anew, so that the parser behind them is reached.
fn repair(file: &mut [u8]) {
    if file.len() < 24 {
        return;
    }
    let end = file.len() - 4;
    file[12..20].copy_from_slice(&((end - 20) as u64).to_le_bytes());
    let checksum = crc32fast::hash(&file[..end]);
    file[end..].copy_from_slice(&checksum.to_le_bytes());
}

fn valid() -> impl Strategy<Value = Vec<u8>> {
    let voxels = prop::collection::btree_map(0u32..1000, 0.0f64..=1.0, 0..20);
    (voxels, prop::collection::btree_set(0u32..1000, 0..20)).prop_map(|(voxels, hidden)| {
        let count = voxels.len();
        let hidden = hidden.into_iter().filter(|id| !voxels.contains_key(id)).collect();
        let seen = SeenVoxels {
            ids: voxels.keys().copied().collect(),
            mean: voxels.values().copied().collect(),
            pixel_count: vec![3; count],
            range_m: vec![40.0; count],
            tilt_deg: vec![30.0; count],
        };
        let crowd_mass = CrowdMass { ground: 3.5, hole: 0.75, ..CrowdMass::default() };
        Observation::new(TERRAIN, "uav1", 5, seen, hidden, crowd_mass).unwrap().to_bytes()
    })
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn random_bytes(data in prop::collection::vec(any::<u8>(), 0..300)) {
        check(&data);
    }

    #[test]
    fn truncated(file in valid(), length in any::<prop::sample::Index>()) {
        prop_assert!(Observation::from_bytes(&file[..length.index(file.len())]).is_err());
    }

    #[test]
    fn mutated(
        file in valid(), mutations in prop::collection::vec(mutation(), 1..6), sealed in any::<bool>(),
    ) {
        let mut file = file;
        mutations.iter().for_each(|mutation| mutation.apply(&mut file));
        if sealed {
            repair(&mut file);
        }
        check(&file);
    }
}
