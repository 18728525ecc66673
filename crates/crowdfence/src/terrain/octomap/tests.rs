use proptest::prelude::*;

use super::*;

const HEADER_BT: &str = "# Octomap OcTree binary file\nid OcTree\nres 0.5\n";
const HEADER_OT: &str = "# Octomap OcTree file\nid ColorOcTree\nres 0.5\n";

fn file(header: &str, node_count: u64, payload: &[u8]) -> Vec<u8> {
    [format!("{header}size {node_count}\ndata\n").as_bytes(), payload].concat()
}

fn binary_leaf(key: [u16; 3], depth: u8, log_odds: f32) -> Leaf {
    Leaf { key, depth, log_odds, color: None }
}

/// An `.ot` node with a colour: 1.0 is 0x3f800000, -1.0 is 0xbf800000.
fn color_node(log_odds: f32, color: [u8; 3], children: u8) -> Vec<u8> {
    [&log_odds.to_le_bytes()[..], &color, &[children]].concat()
}

/// The node bytes of a file.
fn payload(file: &[u8]) -> &[u8] {
    let data = file.windows(6).position(|bytes| bytes == b"\ndata\n").unwrap();
    &file[data + 6..]
}

#[test]
fn one_node_binary_file_is_all_of_space() {
    let map = read(&file(HEADER_BT, 1, &[0, 0])).unwrap();
    let header = OctomapHeader { id: "OcTree".into(), node_count: 1, voxel_size_m: 0.5, binary: true };
    assert_eq!(map, Octomap { header, leaves: vec![binary_leaf([0, 0, 0], 0, 3.5)] });

    let too_many = OctomapError::TooManyVoxels { voxels: 1 << 48, max_voxels: 1_000_000 };
    assert_eq!(map.occupied_voxels(1_000_000), Err(too_many));
}

#[test]
fn root_of_a_binary_file_bit_by_bit() {
    // Children 0..3: occupied 2, free 1, unknown 0, free 1 -> 0b01_00_01_10; children 4..7: 1, 1,
    // 1, 2 -> 0b10_01_01_01.
    let map = read(&file(HEADER_BT, 8, &[0b01_00_01_10, 0b10_01_01_01])).unwrap();
    let half = 1 << 15;
    let expected = [
        binary_leaf([0, 0, 0], 1, 3.5),
        binary_leaf([half, 0, 0], 1, -2.0),
        binary_leaf([half, half, 0], 1, -2.0),
        binary_leaf([0, 0, half], 1, -2.0),
        binary_leaf([half, 0, half], 1, -2.0),
        binary_leaf([0, half, half], 1, -2.0),
        binary_leaf([half, half, half], 1, 3.5),
    ];
    assert_eq!(map.leaves, expected);
}

#[test]
fn nine_node_color_file_byte_by_byte() {
    let mut nodes = color_node(1.0, [9, 9, 9], 0xff);
    for child in 0..8 {
        nodes.extend(color_node(if child == 5 { 1.0 } else { -1.0 }, [child, 20, 30], 0));
    }
    assert_eq!(nodes[..8], [0x00, 0x00, 0x80, 0x3f, 9, 9, 9, 0xff]);
    assert_eq!(nodes.len(), 9 * 8);

    let map = read(&file(HEADER_OT, 9, &nodes)).unwrap();
    assert_eq!((map.leaves.len(), map.header.binary), (8, false));
    let child_5 = Leaf { key: [1 << 15, 0, 1 << 15], depth: 1, log_odds: 1.0, color: Some([5, 20, 30]) };
    assert_eq!(map.leaves.iter().filter(|leaf| leaf.is_occupied()).collect::<Vec<_>>(), [&child_5]);
}

#[test]
fn uncolored_nodes_are_five_bytes() {
    let header = HEADER_OT.replace("ColorOcTree", "OcTreeStamped");
    let map = read(&file(&header, 1, &[0, 0, 0x80, 0x3f, 0])).unwrap();
    assert_eq!(map.leaves, [binary_leaf([0, 0, 0], 0, 1.0)]);
}

#[test]
fn occupied_starts_at_probability_one_half() {
    for (log_odds, occupied) in [(0.0, true), (-0.0, true), (1e-7, true), (-1e-7, false)] {
        assert_eq!(binary_leaf([0, 0, 0], 16, log_odds).is_occupied(), occupied, "{log_odds}");
    }
}

#[test]
fn single_voxel_is_a_path_of_seventeen_nodes() {
    // Key of index 0 is 2^15: child 7 (bits 14, 15) of the root, then child 0 all the way down.
    let mut expected = vec![0x00, 0b11_00_00_00];
    expected.extend([0b11, 0x00].repeat(14));
    expected.extend([0b10, 0x00]);
    let file = write_binary(&[[0, 0, 0]], 0.25).unwrap();
    assert_eq!(payload(&file), expected);

    let map = read(&file).unwrap();
    assert_eq!((map.header.node_count, map.header.voxel_size_m), (17, 0.25));
    assert_eq!(map.leaves, [binary_leaf([1 << 15; 3], 16, 3.5)]);
    assert_eq!(map.occupied_voxels(1).unwrap(), [[0, 0, 0]]);
}

#[test]
fn child_bits_are_x_then_y_then_z() {
    // In the block of eight whose lowest index is (-2, -2, -2), (-1, -2, -2) is child 1, then y is
    // 2 and z is 4.
    for (voxel, last) in [([-1, -2, -2], [2 << 2, 0]), ([-2, -1, -2], [2 << 4, 0]), ([-2, -2, -1], [0, 2])] {
        let file = write_binary(&[voxel], 1.0).unwrap();
        // Key 32766 or 32767: child 0 of the root, then child 7 down to that block.
        let mut expected = vec![0b11, 0x00];
        expected.extend([0x00, 0b11_00_00_00].repeat(14));
        expected.extend(last);
        assert_eq!(payload(&file), expected, "{voxel:?}");
    }
}

#[test]
fn eight_voxels_collapse_and_expand_again() {
    let mut block: Vec<_> = (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2]).collect();
    let map = read(&write_binary(&block, 1.0).unwrap()).unwrap();
    assert_eq!(map.leaves, [binary_leaf([1 << 15; 3], 15, 3.5)]);
    assert_eq!(map.header.node_count, 16);
    let mut expanded = map.occupied_voxels(8).unwrap();
    block.sort();
    expanded.sort();
    assert_eq!(expanded, block);
    assert_eq!(map.occupied_voxels(7), Err(OctomapError::TooManyVoxels { voxels: 8, max_voxels: 7 }));

    let color =
        |colors: &[[u8; 3]]| read(&write_color(&block, colors, &[0.75; 8], 1.0).unwrap()).unwrap().leaves;
    assert_eq!(color(&[[1, 2, 3]; 8]).len(), 1);
    let mut one_differs = [[1, 2, 3]; 8];
    one_differs[4] = [1, 2, 4];
    assert_eq!(color(&one_differs).len(), 8, "a colour would be lost");
}

#[test]
fn inner_color_nodes_hold_highest_log_odds_and_mean_color() {
    // ln(0.75 / 0.25) = ln 3; white counts for nothing in the mean: ((10 + 21) / 2, (0 + 3) / 2,
    // (200 + 101) / 2).
    let voxels = [[0, 0, 0], [1, 0, 0], [0, 1, 0]];
    let colors = [[10, 0, 200], [21, 3, 101], [255, 255, 255]];
    let file = write_color(&voxels, &colors, &[0.25, 0.75, 0.5], 1.0).unwrap();
    let root = color_node(3_f32.ln(), [15, 1, 150], 1 << 7);
    assert_eq!(payload(&file)[..8], root);
    assert_eq!(payload(&file)[15 * 8..16 * 8], color_node(3_f32.ln(), [15, 1, 150], 0b111));
    assert_eq!(payload(&file)[16 * 8..17 * 8], color_node(-(3_f32.ln()), [10, 0, 200], 0));
    assert_eq!(payload(&file).len(), 19 * 8);
}

#[test]
fn certainty_is_written_as_finite_log_odds() {
    // ln(1e6 - 1) = 13.8155...
    let map = read(&write_color(&[[0, 0, 0], [5, 5, 5]], &[[0; 3]; 2], &[0.0, 1.0], 1.0).unwrap()).unwrap();
    let log_odds: Vec<_> = map.leaves.iter().map(|leaf| leaf.log_odds).collect();
    assert!((log_odds[0] + 13.8155).abs() < 1e-4 && (log_odds[1] - 13.8155).abs() < 1e-4, "{log_odds:?}");
}

#[test]
fn no_voxels_make_a_file_of_no_nodes() {
    for file in [write_binary(&[], 1.0), write_color(&[], &[], &[], 1.0)] {
        let file = file.unwrap();
        assert!(payload(&file).is_empty());
        assert_eq!(read(&file), Err(OctomapError::NoNodes));
    }
}

#[test]
fn header_fields_come_in_any_order_with_comments() {
    let expected = read(&file(HEADER_BT, 1, &[0, 0])).unwrap();
    for header in [
        "# Octomap OcTree binary file\n# (a comment)\n#\nres 0.5\nsize 1\nid OcTree\ndata\n",
        "# Octomap OcTree binary file, 2\r\n#data\r\n\r\n  id\tOcTree\r\nsize 1\r\nres 5e-1\r\ndata of it\r\n",
        "# Octomap OcTree binary file\nid OcTree size 1 res 0.5 # id Other\ndata\n",
    ] {
        assert_eq!(read(&[header.as_bytes(), &[0, 0]].concat()).as_ref(), Ok(&expected), "{header}");
    }
}

#[test]
fn headers_are_refused_by_name() {
    let cases = [
        ("", r#"the first line is """#),
        ("P6\n640 480\n", r#"the first line is "P6""#),
        ("# Octomap OcTree", "the first line is \"# Octomap OcTree\""),
        ("# Octomap OcTree file\nid OcTree\nsize 1\nres 1\n", "without `data`"),
        ("# Octomap OcTree file\nsize 1\nres 1\ndata\n", "without `id`"),
        ("# Octomap OcTree file\nid OcTree\nres 1\ndata\n", "without `size`"),
        ("# Octomap OcTree file\nid OcTree\nsize 1\ndata\n", "without `res`"),
        ("# Octomap OcTree file\nid OcTree\nsize 1\nres", "without `data`"),
        (
            "# Octomap OcTree file\nid OcTree\nsize 1\nres -0.5\ndata\n",
            "`res -0.5`, but res must be finite and above 0",
        ),
        ("# Octomap OcTree file\nid OcTree\nsize 1\nres 0\ndata\n", "`res 0`"),
        ("# Octomap OcTree file\nid OcTree\nsize 1\nres nan\ndata\n", "`res nan`"),
        ("# Octomap OcTree file\nid OcTree\nsize 1\nres 1e999\ndata\n", "`res 1e999`"),
        (
            "# Octomap OcTree file\nid OcTree\nres 1\nsize -1\ndata\n",
            "`size -1`, but size must be a whole number",
        ),
        ("# Octomap OcTree file\nres 1\nres 2\n", "`res` twice"),
        ("# Octomap OcTree file\ndepth 12\n", r#"unknown keyword "depth""#),
        ("# Octomap OcTree file\nid SemanticOcTree\nsize 1\nres 1\ndata\n", r#"tree type "SemanticOcTree""#),
        ("# Octomap OcTree file\nid OcTree\nsize 0\nres 1\ndata\n", "OctoMap of 0 nodes"),
    ];
    for (header, message) in cases {
        let error = read(header.as_bytes()).unwrap_err().to_string();
        assert!(error.contains(message), "{header:?}: {error}");
    }
    let endless = "x".repeat(100_000);
    for header in
        [&endless, &format!("# Octomap OcTree file\n{endless}"), &HEADER_OT.replace("ColorOcTree", &endless)]
    {
        let error = read(&file(header, 1, &[0; 8])).unwrap_err().to_string();
        assert!(error.len() < 300, "quotes too much: {error}");
    }
}

#[test]
fn damaged_nodes_are_refused_with_their_position() {
    let start = file(HEADER_BT, 9, &[]).len();
    let path = |levels: usize, last: [u8; 2]| [[3, 0].repeat(levels), last.to_vec()].concat();
    let cases = [
        (file(HEADER_BT, 1, &[]), OctomapError::Truncated { node_byte: start, file_bytes: start }),
        (file(HEADER_BT, 1, &[2]), OctomapError::Truncated { node_byte: start, file_bytes: start + 1 }),
        (
            file(HEADER_BT, 2, &[3, 0]),
            OctomapError::Truncated { node_byte: start + 2, file_bytes: start + 2 },
        ),
        (file(HEADER_BT, 2, &[3, 0, 0, 0]), OctomapError::EmptyInnerNode { byte: start + 2 }),
        (file(HEADER_BT, 3, &[2, 0]), OctomapError::NodeCount { declared: 3, read: 2 }),
        (file(HEADER_BT, 2, &[2, 0, 0]), OctomapError::TrailingBytes { byte: start + 2, extra: 1 }),
        (file(HEADER_BT, 9, &path(16, [2, 0])), OctomapError::TooDeep { byte: start + 32 }),
        (file(HEADER_OT, 1, &color_node(f32::NAN, [0; 3], 0)), OctomapError::LogOddsNan { byte: start - 2 }),
        (
            file(HEADER_OT, 9, &color_node(0.0, [0; 3], 1).repeat(17)),
            OctomapError::TooDeep { byte: start + 126 },
        ),
    ];
    for (file, error) in cases {
        assert_eq!(read(&file), Err(error));
    }
    let free = read(&file(HEADER_BT, 2, &[1, 0])).unwrap();
    assert_eq!(free.occupied_voxels(9), Err(OctomapError::NoOccupiedLeaf { leaves: 1 }));
}

#[test]
fn unwritable_voxels_are_refused() {
    let color = |voxels: &[[i32; 3]], probability: &[f64]| write_color(voxels, &[[0; 3]], probability, 1.0);
    for voxel in [[32768, 0, 0], [0, -32769, 0], [0, 0, i32::MAX], [i32::MIN, 0, 0]] {
        assert_eq!(write_binary(&[voxel], 1.0), Err(OctomapError::VoxelOutOfRange { voxel }));
        assert_eq!(color(&[voxel], &[0.5]), Err(OctomapError::VoxelOutOfRange { voxel }));
    }
    assert!(write_binary(&[[32767; 3], [-32768; 3]], 1.0).is_ok());
    for voxel_size_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert!(matches!(write_binary(&[[0; 3]], voxel_size_m), Err(OctomapError::VoxelSize { .. })));
    }
    for probability in [-0.1, 1.1, f64::NAN] {
        assert!(matches!(color(&[[0; 3]], &[probability]), Err(OctomapError::Probability { .. })));
    }
    assert!(matches!(color(&[[0; 3]], &[]), Err(OctomapError::LengthMismatch { .. })));
    let twice = write_color(&[[7, -8, 9]; 2], &[[0; 3]; 2], &[0.5; 2], 1.0);
    assert_eq!(twice, Err(OctomapError::RepeatedVoxel { voxel: [7, -8, 9] }));
}

/// Voxels in clumps (so that some prune) around a few places, two of them the corners of the tree.
fn voxels() -> impl Strategy<Value = Vec<[i32; 3]>> {
    let place = prop_oneof![Just(-32768), Just(32764), Just(-2), -30_000..30_000];
    let clump = (
        prop::array::uniform3(place),
        prop::collection::vec(prop::array::uniform3(0..4), 1..64),
        any::<bool>(),
    );
    prop::collection::vec(clump, 1..5).prop_map(|clumps| {
        let mut voxels = Vec::new();
        for (place, offsets, is_solid) in clumps {
            let solid = (0..64).map(|i| [i & 3, i >> 2 & 3, i >> 4]).filter(|_| is_solid);
            voxels.extend(
                solid.chain(offsets).map(|offset| std::array::from_fn(|axis| place[axis] + offset[axis])),
            );
        }
        voxels.sort();
        voxels.dedup();
        voxels
    })
}

proptest! {
    #![proptest_config(ProptestConfig { failure_persistence: None, ..Default::default() })]

    #[test]
    fn binary_round_trip(voxels in voxels(), voxel_size_m in 1e-3..1e3) {
        let map = read(&write_binary(&voxels, voxel_size_m).unwrap()).unwrap();
        prop_assert_eq!(map.header.voxel_size_m, voxel_size_m);
        let mut read_back = map.occupied_voxels(voxels.len() as u64).unwrap();
        read_back.sort();
        prop_assert_eq!(read_back, voxels);
    }

    #[test]
    fn color_round_trip(voxels in voxels(), bits in any::<u64>()) {
        // Few distinct values, so that some blocks are uniform.
        let bit = |voxel: &[i32; 3]| (bits >> (voxel[2] & 63) & 1) as u8;
        let colors: Vec<_> = voxels.iter().map(|voxel| [7, 200 * bit(voxel), 255]).collect();
        let probability: Vec<_> = voxels.iter().map(|voxel| [0.9, 0.6][usize::from(bit(voxel))]).collect();
        let map = read(&write_color(&voxels, &colors, &probability, 0.1).unwrap()).unwrap();
        let mut read_back = Vec::new();
        for leaf in &map.leaves {
            let one = Octomap { header: map.header.clone(), leaves: vec![*leaf] };
            for voxel in one.occupied_voxels(1 << 20).unwrap() {
                read_back.push((voxel, leaf.color.unwrap(), 1.0 / (1.0 + f64::from(-leaf.log_odds).exp())));
            }
        }
        read_back.sort_by_key(|(voxel, ..)| *voxel);
        prop_assert_eq!(read_back.len(), voxels.len());
        for (i, (voxel, color, read_probability)) in read_back.into_iter().enumerate() {
            prop_assert_eq!((voxel, color), (voxels[i], colors[i]));
            prop_assert!((read_probability - probability[i]).abs() < 1e-6);
        }
    }

    #[test]
    fn every_prefix_is_refused(voxels in voxels(), kept in 0.0..1.0) {
        for file in [
            write_binary(&voxels, 1.0).unwrap(),
            write_color(&voxels, &vec![[1; 3]; voxels.len()], &vec![0.5; voxels.len()], 1.0).unwrap(),
        ] {
            let kept = (file.len() as f64 * kept) as usize;
            prop_assert!(read(&file[..kept]).is_err(), "{} of {} bytes", kept, file.len());
        }
    }
}
