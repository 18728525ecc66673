//! Hostile crowd-map files: whatever the bytes are, reading ends in a map that works or in an error, never in
//! a panic. CROWDFENCE_FUZZ_CASES sets the number of cases per property.

mod damage;

use std::sync::{Arc, LazyLock};

use crowdfence::method::{DecayUnit, Initial};
use crowdfence::view::Pose;
use crowdfence::{
    Calibration, Camera, Coverage, CrowdMap, Distortion, Error, Evidence, EvidenceSettings, FromBelow,
    Heatmap, LikelihoodRatio, LinearPool, LogOdds, LogPool, Method, MovingAverage, Or, Paper, Projection,
    Rates, TemporalBlend, Terrain, Unseen, View,
};
use glam::{DMat3, DVec3};
use proptest::prelude::*;
use proptest::sample::Index;

use damage::{config, mutation};

/// Magic, version, payload length.
const HEAD_BYTES: usize = 20;
const CHECKSUM_BYTES: usize = 4;
/// Fingerprint and voxel count.
const TERRAIN_BYTES: usize = 16;
const SECOND_NS: i64 = 1_000_000_000;

/// Two pages of voxels, the second one not full, with a roof over some of them.
static TERRAIN: LazyLock<Arc<Terrain>> = LazyLock::new(|| {
    let floor = (0..36).flat_map(|x| (0..36).map(move |y| [x, y, 0]));
    let roof = (10..14).flat_map(|x| (10..14).map(move |y| [x, y, 4]));
    let voxels: Vec<[i32; 3]> = floor.chain(roof).collect();
    Arc::new(Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap())
});

/// That of the files in `reference/`.
static OLDER_TERRAIN: LazyLock<Arc<Terrain>> =
    LazyLock::new(|| Arc::new(Terrain::from_indices(&[[0, 0, 0], [50, 0, 0]], 1.0, DVec3::ZERO).unwrap()));

fn read(data: &[u8]) -> Result<CrowdMap, Error> {
    CrowdMap::from_bytes(data, TERRAIN.clone())
}

fn check(data: &[u8]) {
    match read(data) {
        Ok(map) => check_map(map),
        Err(error) => check_error(&error, data.len()),
    }
}

fn check_error(error: &Error, length: usize) {
    assert!(error.to_string().len() < 300, "{error}");
    if let Error::Damaged { offset, .. } = error {
        assert!(*offset <= length, "{error} in {length} bytes");
    }
}

/// A map that was read answers, survives another round, and goes on.
fn check_map(mut map: CrowdMap) {
    let bytes = map.to_bytes();
    assert_eq!(read(&bytes).unwrap().to_bytes(), bytes);
    let now = map.span_ns().map_or(0, |(_, newest_ns)| newest_ns);
    for stamp_ns in [now, now.saturating_add(SECOND_NS), i64::MAX] {
        for probability in map.probability(stamp_ns).unwrap() {
            assert!((0.0..=1.0).contains(&probability), "{probability}");
        }
        map.state(stamp_ns, 0.5, 30.0).unwrap();
    }
    let next = now.saturating_add(SECOND_NS);
    match map.integrate(&[look("newcomer", [12.0, 12.0, 9.0], 0.75, next)], next) {
        Ok(update) => assert!(update.probability.iter().all(|p| (0.0..=1.0).contains(p))),
        Err(Error::FleetTooLarge { .. } | Error::StampNotAfter { .. } | Error::StampJump { .. }) => {
            assert_eq!(map.to_bytes(), bytes);
        }
        Err(error) => panic!("{error}"),
    }
}

/// A camera of 4 x 4 pixels that looks straight down on about as many voxels.
fn look(drone: &str, at: [f64; 3], m: f32, stamp_ns: i64) -> View {
    let camera = Camera::new(4, 4, 8.0, 8.0, 2.0, 2.0, Distortion::None).unwrap();
    let down = DMat3::from_cols(DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z);
    let pose = Pose::new(down, at.into()).unwrap();
    View::new(drone, stamp_ns, Arc::new(camera), pose, Heatmap::new(vec![m], 1, 1).unwrap()).unwrap()
}

/// Values up to .5 speak against crowd, more strongly from near.
fn likelihood() -> Arc<LikelihoodRatio> {
    Arc::new(LikelihoodRatio::new(vec![0.2], vec![], vec![0.5], vec![-3.0, 4.0, -0.5, 2.0]).unwrap())
}

/// Those that `evidence` is compared with.
fn compared() -> impl Strategy<Value = Method> {
    let calibration = Calibration::new(likelihood(), 0.02, 100.0).unwrap();
    let (rates, blend) = (Rates::new(0.9, 0.05).unwrap(), TemporalBlend::new(0.3, 0.1).unwrap());
    prop_oneof![
        Just(Method::LinearPool(LinearPool::new(rates, 0.2, 0.5, blend).unwrap())),
        Just(Method::LogPool(LogPool::new(calibration.clone(), blend, 0.1).unwrap())),
        Just(Method::LogOdds(LogOdds::new(rates, 0.5, 0.5, [-2.0, 3.5]).unwrap())),
        Just(Method::MovingAverage(MovingAverage::new(calibration, 10.0, 0.1).unwrap())),
    ]
}

fn evidence() -> Evidence {
    let settings = EvidenceSettings {
        prior: 0.02,
        memory_s: 10.0,
        sharp_gsd_m: 0.1,
        doubt: 0.5,
        agreement: 0.5,
        threshold: 0.1,
        cleared: 0.01,
        focal_px: 100.0,
        from_below: FromBelow::For,
    };
    Evidence::new(likelihood(), settings).unwrap()
}

fn method() -> impl Strategy<Value = Method> {
    let unseen = prop_oneof![Just(Unseen::Fleet), Just(Unseen::Visible)];
    let initial = prop_oneof![Just(Initial::Zero), Just(Initial::Prior), Just(Initial::FirstLook)];
    let decay = prop_oneof![Just(DecayUnit::Second), Just(DecayUnit::Frame)];
    let paper = (unseen, any::<bool>(), initial, decay, 0.01..1.0, 0.0..1.0).prop_map(
        |(unseen, normalise, initial, decay, alpha, lambda)| {
            let rates = Rates::new(0.9, 0.05).unwrap();
            let pool = crowdfence::OpinionPool::new(rates, 0.2, 0.5, unseen, normalise).unwrap();
            let blend = TemporalBlend::new(alpha, lambda).unwrap();
            Method::Paper(Paper::new(pool, blend, 3, initial, decay).unwrap())
        },
    );
    prop_oneof![
        3 => paper,
        1 => Just(Method::Or(Or::new(0.5).unwrap())),
        2 => Just(Method::Evidence(evidence())),
        2 => compared(),
    ]
}

/// A file by the writer, after a few instants of up to three drones.
fn valid_file() -> impl Strategy<Value = Vec<u8>> {
    let views = prop::collection::vec((0..3_usize, 0.0..36.0, 0.0..36.0, 0.0..=1.0_f32), 0..4);
    (method(), any::<bool>(), prop::collection::vec(views, 0..5)).prop_map(|(method, full, instants)| {
        let coverage = if full { Coverage::Full } else { Coverage::Rays };
        let projection = Projection::new(100.0, 0.0, coverage).unwrap();
        let mut map = CrowdMap::new(TERRAIN.clone(), method, projection, 3600.0).unwrap();
        for (number, views) in instants.iter().enumerate() {
            let stamp_ns = number as i64 * SECOND_NS;
            let mut views: Vec<View> = views
                .iter()
                .map(|&(drone, x, y, m)| look(["a", "b", "c"][drone], [x, y, 9.0], m, stamp_ns))
                .collect();
            views.sort_by(|a, b| a.drone().cmp(b.drone()));
            views.dedup_by(|a, b| a.drone() == b.drone());
            map.integrate(&views, stamp_ns).unwrap();
        }
        map.to_bytes()
    })
}

/// Writes length and checksum anew, so that the parser behind them is reached.
fn repair(file: &mut [u8]) {
    if file.len() < HEAD_BYTES + CHECKSUM_BYTES {
        return;
    }
    let body_end = file.len() - CHECKSUM_BYTES;
    let length = (body_end - HEAD_BYTES) as u64;
    file[12..HEAD_BYTES].copy_from_slice(&length.to_le_bytes());
    let checksum = crc32fast::hash(&file[..body_end]);
    file[body_end..].copy_from_slice(&checksum.to_le_bytes());
}

/// Numbers that mean something in the format, put over a field or across two.
fn telling_number() -> impl Strategy<Value = Vec<u8>> {
    let counts = [0, 1, 2, 3, 1023, 1024, 1 << 31, u32::MAX - 2, u32::MAX - 1, u32::MAX];
    let reals = [0.0, -0.0, 1.0, 1.0 + f64::EPSILON, -1.0, 1e308, f64::MIN_POSITIVE, f64::INFINITY, f64::NAN];
    prop_oneof![
        prop::sample::select(counts.to_vec()).prop_map(|count| count.to_le_bytes().to_vec()),
        prop::sample::select(reals.to_vec()).prop_map(|real| real.to_le_bytes().to_vec()),
        prop::sample::select(vec![i64::MIN, -1, 0, i64::MAX]).prop_map(|n| n.to_le_bytes().to_vec()),
    ]
}

/// Most fields lie in the first few hundred bytes, most bytes in the pages behind them.
fn place() -> impl Strategy<Value = (Index, usize)> {
    (any::<Index>(), prop_oneof![3 => Just(300_usize), 1 => Just(usize::MAX)])
}

fn overwrite(file: &mut [u8], (at, within): (Index, usize), number: &[u8]) {
    let start = at.index(file.len().min(within));
    let end = file.len().min(start + number.len());
    file[start..end].copy_from_slice(&number[..end - start]);
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn written_files_are_read_back(file in valid_file()) {
        prop_assert_eq!(read(&file).unwrap().to_bytes(), file.clone());
        check(&file);
    }

    #[test]
    fn random_bytes(data in prop::collection::vec(any::<u8>(), 0..300)) {
        check(&data);
    }

    #[test]
    fn truncated_files(file in valid_file(), length in any::<Index>()) {
        let length = length.index(file.len());
        let error = read(&file[..length]).expect_err("a file cut short must be refused");
        check_error(&error, length);
    }

    #[test]
    fn mutated_files(file in valid_file(), mutations in prop::collection::vec(mutation(), 1..6)) {
        let mut file = file;
        mutations.iter().for_each(|mutation| mutation.apply(&mut file));
        check(&file);
    }

    /// With length and checksum put right, only the payload can be wrong.
    #[test]
    fn mutated_payloads(file in valid_file(), mutations in prop::collection::vec(mutation(), 1..6)) {
        let mut file = file;
        mutations.iter().for_each(|mutation| mutation.apply(&mut file));
        repair(&mut file);
        check(&file);
    }

    #[test]
    fn fields_with_telling_numbers(
        file in valid_file(), numbers in prop::collection::vec((place(), telling_number()), 1..4),
    ) {
        let mut file = file;
        for (place, number) in numbers {
            overwrite(&mut file, place, &number);
        }
        repair(&mut file);
        check(&file);
    }

    /// The readers of older versions, on files that their last builds wrote.
    #[test]
    fn mutated_files_of_older_versions(
        which in 0..6_usize, mutations in prop::collection::vec(mutation(), 0..6), numbers in
        prop::collection::vec((place(), telling_number()), 0..3),
    ) {
        let name = ["paper_v1", "or_v1", "paper_v2", "or_v2", "paper_v3", "or_v3"][which];
        let path = format!("{}/../../reference/{name}.crowdmap", env!("CARGO_MANIFEST_DIR"));
        let mut file = std::fs::read(path).unwrap();
        mutations.iter().for_each(|mutation| mutation.apply(&mut file));
        for (place, number) in numbers {
            if !file.is_empty() {
                overwrite(&mut file, place, &number);
            }
        }
        repair(&mut file);
        match CrowdMap::from_bytes(&file, OLDER_TERRAIN.clone()) {
            Ok(map) => {
                let bytes = map.to_bytes();
                let again = CrowdMap::from_bytes(&bytes, OLDER_TERRAIN.clone()).unwrap();
                prop_assert_eq!(again.to_bytes(), bytes);
            }
            Err(error) => check_error(&error, file.len()),
        }
    }

    #[test]
    fn random_payload_of_the_right_terrain(
        file in valid_file(), payload in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        let mut file = [&file[..HEAD_BYTES + TERRAIN_BYTES], &payload, &[0; CHECKSUM_BYTES]].concat();
        repair(&mut file);
        check(&file);
    }
}
