//! Hostile OctoMap files: whatever the bytes are, reading ends in leaves that make sense or in an
//! error, never in a panic. CROWDFENCE_FUZZ_CASES sets the number of cases per property.

mod damage;

use crowdfence::terrain::octomap::{Leaf, Octomap, OctomapError, read, write_binary, write_color};
use proptest::prelude::*;
use proptest::sample::Index;

use damage::{config, mutation};

/// Enough for a pruned leaf of 16 cells per side; more would only make a case slower.
const MAX_VOXELS: u64 = 5_000;

fn check(data: &[u8]) {
    match read(data) {
        Ok(map) => check_map(&map),
        Err(error) => check_error(&error, data.len()),
    }
}

fn check_error(error: &OctomapError, length: usize) {
    assert!(error.to_string().len() < 600, "{error}");
    match *error {
        OctomapError::Truncated { node_byte, file_bytes } => {
            assert!(node_byte <= length && file_bytes == length)
        }
        OctomapError::TrailingBytes { byte, extra } => assert_eq!(byte + extra, length),
        OctomapError::TooDeep { byte }
        | OctomapError::EmptyInnerNode { byte }
        | OctomapError::LogOddsNan { byte } => {
            assert!(byte < length)
        }
        _ => {}
    }
}

fn check_map(map: &Octomap) {
    assert!(map.leaves.len() as u64 <= map.header.node_count);
    let mut free_from = 0;
    for leaf in &map.leaves {
        let (start, end) = morton_range(leaf);
        assert!(start >= free_from, "{leaf:?} overlaps the leaf before it");
        free_from = end;
    }
    match map.occupied_voxels(MAX_VOXELS) {
        Ok(mut voxels) => {
            let rewritten =
                write_binary(&voxels, map.header.voxel_size_m).expect("voxels of an OctoMap fit one");
            let mut read_back = read(&rewritten).unwrap().occupied_voxels(MAX_VOXELS).unwrap();
            voxels.sort();
            read_back.sort();
            assert_eq!(read_back, voxels);
        }
        Err(OctomapError::TooManyVoxels { voxels, .. }) => assert!(voxels > MAX_VOXELS),
        Err(OctomapError::NoOccupiedLeaf { .. }) => {
            assert!(!map.leaves.iter().any(Leaf::is_occupied))
        }
        Err(error) => panic!("{error}"),
    }
}

/// First and one past the last place of a leaf on the curve through all cells that the tree's order
/// follows.
fn morton_range(leaf: &Leaf) -> (u64, u64) {
    let mut start = 0;
    for bit in (0..16).rev() {
        for axis in [2, 1, 0] {
            start = start << 1 | u64::from(leaf.key[axis] >> bit & 1);
        }
    }
    let cells = 1 << (3 * (16 - u32::from(leaf.depth)));
    assert_eq!(start % cells, 0, "{leaf:?} does not start where a node of its level can");
    (start, start + cells)
}

/// A file by the writer, `.bt` or `.ot`.
fn valid_file() -> impl Strategy<Value = Vec<u8>> {
    let voxels = prop::collection::btree_set(prop::array::uniform3(-3..3), 1..80);
    (voxels, prop::array::uniform3(-32_765..32_765), any::<bool>(), any::<[u8; 3]>()).prop_map(
        |(offsets, place, binary, color)| {
            let voxel = |offset: [i32; 3]| std::array::from_fn(|axis| place[axis] + offset[axis]);
            let voxels: Vec<[i32; 3]> = offsets.into_iter().map(voxel).collect();
            let probability: Vec<_> = voxels.iter().map(|voxel| f64::from(voxel[0] & 3) / 3.0).collect();
            if binary {
                write_binary(&voxels, 0.1).unwrap()
            } else {
                write_color(&voxels, &vec![color; voxels.len()], &probability, 0.1).unwrap()
            }
        },
    )
}

fn header_word() -> impl Strategy<Value = Vec<u8>> {
    let known = prop::sample::select(vec![
        "id OcTree",
        "id",
        "size 1\n",
        "size",
        "res 0.5",
        "res",
        "data\n",
        "#",
        "\r\n",
        "\t",
    ]);
    prop_oneof![
        6 => known.prop_map(|word| word.as_bytes().to_vec()),
        1 => any::<f64>().prop_map(|number| number.to_string().into_bytes()),
        1 => any::<u64>().prop_map(|number| number.to_string().into_bytes()),
        1 => prop::collection::vec(any::<u8>(), 0..20),
    ]
    .prop_map(|word| [b" ", &word[..]].concat())
}

/// Nodes that are well-formed one by one but may not make a tree, below a path of inner nodes, so
/// that the leaves are not all huge.
fn loose_nodes(binary: bool) -> BoxedStrategy<Vec<u8>> {
    let path_node = if binary { vec![3, 0] } else { vec![0, 0, 0, 0, 1, 2, 3, 1] };
    let node = if binary { loose_binary_node() } else { loose_full_node() };
    (0..16_usize, prop::collection::vec(node, 1..60))
        .prop_map(move |(levels, nodes)| [path_node.repeat(levels), nodes.concat()].concat())
        .boxed()
}

/// Mostly leaves, so that trees end.
fn loose_binary_node() -> BoxedStrategy<Vec<u8>> {
    let child = prop_oneof![3 => Just(0_u16), 3 => Just(1), 3 => Just(2), 1 => Just(3)];
    let bits = |children: Vec<u16>| children.iter().fold(0, |bits, code| bits << 2 | code);
    prop::collection::vec(child, 8).prop_map(move |children| bits(children).to_le_bytes().to_vec()).boxed()
}

fn loose_full_node() -> BoxedStrategy<Vec<u8>> {
    let log_odds = prop_oneof![9 => -3.0..3.0_f32, 1 => any::<f32>()];
    let children = prop_oneof![2 => Just(0), 1 => (0..8).prop_map(|index| 1_u8 << index), 1 => any::<u8>()];
    (log_odds, any::<[u8; 3]>(), children)
        .prop_map(|(log_odds, color, children)| [&log_odds.to_le_bytes()[..], &color, &[children]].concat())
        .boxed()
}

fn first_line(binary: bool) -> &'static str {
    if binary { "# Octomap OcTree binary file\n" } else { "# Octomap OcTree file\n" }
}

fn file(binary: bool, node_count: u64, nodes: &[u8]) -> Vec<u8> {
    let header = format!("{}id ColorOcTree\nsize {node_count}\nres 1\ndata\n", first_line(binary));
    [header.as_bytes(), nodes].concat()
}

proptest! {
    #![proptest_config(config())]

    #[test]
    fn random_headers(binary in any::<bool>(), words in prop::collection::vec(header_word(), 0..30)) {
        check(&[first_line(binary).as_bytes(), &words.concat()].concat());
    }

    #[test]
    fn random_nodes_after_a_valid_header(
        binary in any::<bool>(), count in any::<u64>(), nodes in prop::collection::vec(any::<u8>(), 0..300),
    ) {
        check(&file(binary, count, &nodes));
    }

    #[test]
    fn mutated_files(file in valid_file(), mutations in prop::collection::vec(mutation(), 1..6)) {
        let mut file = file;
        mutations.iter().for_each(|mutation| mutation.apply(&mut file));
        check(&file);
    }

    #[test]
    fn truncated_files(file in valid_file(), length in any::<Index>()) {
        let length = length.index(file.len());
        let error = read(&file[..length]).expect_err("a file cut short must be refused");
        check_error(&error, length);
    }

    /// With the number of nodes and the length put right, only the nodes themselves can be wrong.
    #[test]
    fn repaired_trees((binary, nodes) in any::<bool>().prop_flat_map(|kind| (Just(kind), loose_nodes(kind)))) {
        let mut data = file(binary, u64::MAX, &nodes);
        if let Err(OctomapError::NodeCount { read, .. }) = read(&data) {
            data = file(binary, read, &nodes);
        }
        if let Err(OctomapError::TrailingBytes { byte, .. }) = read(&data) {
            data.truncate(byte);
        }
        check(&data);
        if let Err(error) = read(&data) {
            prop_assert!(matches!(
                error,
                OctomapError::Truncated { .. } | OctomapError::TooDeep { .. }
                    | OctomapError::EmptyInnerNode { .. } | OctomapError::LogOddsNan { .. }
            ), "{}", error);
        }
    }
}
