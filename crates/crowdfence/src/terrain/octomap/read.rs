//! Bytes -> leaves.

use super::header::quoted;
use super::{Leaf, MAX_DEPTH, Octomap, OctomapError, OctomapHeader};

/// What the library gives a free and an occupied leaf of a `.bt` file: its clamping bounds,
/// probability 0.12 and 0.97.
const FREE_LOG_ODDS: f32 = -2.0;
const OCCUPIED_LOG_ODDS: f32 = 3.5;

/// Reads a whole `.bt` or `.ot` file.
///
/// Time and memory are bounded by the bytes present, whatever the header claims: a `.bt` node of 2
/// bytes holds at most 8 leaves.
pub fn read(data: &[u8]) -> Result<Octomap, OctomapError> {
    let (header, first_node) = OctomapHeader::parse(data)?;
    if header.node_count == 0 {
        return Err(OctomapError::NoNodes);
    }
    let mut nodes = NodeReader { data, position: first_node, node_count: 0, leaves: Vec::new() };
    if header.binary {
        nodes.read_binary_node(Cube::ROOT)?;
    } else {
        nodes.read_full_node(Cube::ROOT, has_color(&header.id)?)?;
    }
    let NodeReader { position, node_count, leaves, .. } = nodes;
    if node_count != header.node_count {
        return Err(OctomapError::NodeCount { declared: header.node_count, read: node_count });
    }
    if position != data.len() {
        return Err(OctomapError::TrailingBytes { byte: position, extra: data.len() - position });
    }
    Ok(Octomap { header, leaves })
}

/// Whether the nodes of an `.ot` file carry a colour after their log-odds.
fn has_color(id: &str) -> Result<bool, OctomapError> {
    match id {
        // "1" is what the library wrote before 1.0; OcTreeStamped does not store its stamps.
        "OcTree" | "OcTreeStamped" | "1" => Ok(false),
        "ColorOcTree" => Ok(true),
        _ => Err(OctomapError::UnsupportedTree { id: quoted(id.as_bytes()) }),
    }
}

/// Where a node lies: key of its lowest cell, and level.
#[derive(Clone, Copy)]
struct Cube {
    key: [u16; 3],
    depth: u8,
}

impl Cube {
    const ROOT: Self = Self { key: [0; 3], depth: 0 };

    /// Only for depth < MAX_DEPTH.
    fn child(self, index: u8) -> Self {
        let depth = self.depth + 1;
        let half = 1_u16 << (MAX_DEPTH - depth);
        let [x, y, z] = self.key;
        let upper = |axis: u8| u16::from(index >> axis & 1) * half;
        Self { key: [x + upper(0), y + upper(1), z + upper(2)], depth }
    }
}

struct NodeReader<'a> {
    data: &'a [u8],
    position: usize,
    node_count: u64,
    leaves: Vec<Leaf>,
}

impl NodeReader<'_> {
    /// A `.bt` node is 16 bits, low byte and low bits first, two per child: 0 = unknown, 1 = free
    /// leaf, 2 = occupied leaf, 3 = inner node. The inner nodes follow in order.
    fn read_binary_node(&mut self, cube: Cube) -> Result<(), OctomapError> {
        let byte = self.position;
        let children = u16::from_le_bytes(self.take(byte)?);
        if cube.depth == MAX_DEPTH {
            return Err(OctomapError::TooDeep { byte });
        }
        if children == 0 && cube.depth == 0 {
            // The root has no parent to tell what kind of leaf it is; the library takes it for
            // occupied.
            self.push_leaf(cube, OCCUPIED_LOG_ODDS, None);
            return Ok(());
        }
        if children == 0 {
            return Err(OctomapError::EmptyInnerNode { byte });
        }
        for index in 0..8 {
            let child = || cube.child(index);
            match children >> (2 * index) & 3 {
                1 => self.push_leaf(child(), FREE_LOG_ODDS, None),
                2 => self.push_leaf(child(), OCCUPIED_LOG_ODDS, None),
                3 => self.read_binary_node(child())?,
                _ => {}
            }
        }
        self.node_count += 1;
        Ok(())
    }

    /// An `.ot` node is its log-odds (f32, low byte first), red, green and blue if the tree has
    /// colours, and one byte with a bit per child that exists. The children follow in order.
    fn read_full_node(&mut self, cube: Cube, has_color: bool) -> Result<(), OctomapError> {
        let byte = self.position;
        let log_odds = f32::from_le_bytes(self.take(byte)?);
        let color = if has_color { Some(self.take(byte)?) } else { None };
        let [children] = self.take(byte)?;
        if log_odds.is_nan() {
            return Err(OctomapError::LogOddsNan { byte });
        }
        if children == 0 {
            self.push_leaf(cube, log_odds, color);
            return Ok(());
        }
        if cube.depth == MAX_DEPTH {
            return Err(OctomapError::TooDeep { byte });
        }
        for index in (0..8).filter(|index| children >> index & 1 == 1) {
            self.read_full_node(cube.child(index), has_color)?;
        }
        self.node_count += 1;
        Ok(())
    }

    /// Leaves are counted here, inner nodes where they are read.
    fn push_leaf(&mut self, cube: Cube, log_odds: f32, color: Option<[u8; 3]>) {
        let Cube { key, depth } = cube;
        self.leaves.push(Leaf { key, depth, log_odds, color });
        self.node_count += 1;
    }

    fn take<const N: usize>(&mut self, node_byte: usize) -> Result<[u8; N], OctomapError> {
        let truncated = OctomapError::Truncated { node_byte, file_bytes: self.data.len() };
        let bytes = self.data[self.position..].first_chunk().ok_or(truncated)?;
        self.position += N;
        Ok(*bytes)
    }
}
