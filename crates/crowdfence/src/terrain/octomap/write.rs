//! Voxels -> bytes, pruned: eight equal leaves become their parent.

use std::array;

use rayon::prelude::*;

use super::header::is_voxel_size;
use super::morton::{is_full, morton_code, split, voxel_of};
use super::{OctomapError, OctomapHeader};

/// Certainty has infinite log-odds; probabilities are written at least this far from 0 and 1, so
/// that every reader gets finite numbers.
const SMALLEST_PROBABILITY: f64 = 1e-6;
/// The library's "no colour": does not count in the colours of the nodes above.
const WHITE: [u8; 3] = [255; 3];

/// Codes of a `.bt` node's children, see `NodeReader::read_binary_node`.
const UNKNOWN: u16 = 0;
const OCCUPIED_LEAF: u16 = 2;
const INNER_NODE: u16 = 3;

/// Writes a `.bt` file (`OcTree`) in which the voxels are occupied and everything else is unknown.
/// Indices count cells of `voxel_size_m` metres from coordinate 0, in any order; repeated ones
/// count once. No voxels make a valid file of 0 nodes.
pub fn write_binary(voxels: &[[i32; 3]], voxel_size_m: f64) -> Result<Vec<u8>, OctomapError> {
    let mut codes: Vec<u64> = voxels.par_iter().map(morton_code).collect::<Result<_, _>>()?;
    codes.par_sort_unstable();
    codes.dedup();
    let mut nodes = Nodes::default();
    if !codes.is_empty() {
        nodes.write_binary_node(&codes, 0);
    }
    nodes.into_file("OcTree", voxel_size_m, true)
}

/// Writes an `.ot` file (`ColorOcTree`): per voxel a colour (red, green, blue) and the probability
/// that the library reads as occupancy, in [0, 1]; everything else is unknown.
///
/// Inner nodes get the highest log-odds and the mean colour of their children, as from the
/// library's `updateInnerOccupancy`. Leaves are pruned only where their colours are equal too, so
/// that no colour is lost; the library's own `prune` averages them.
pub fn write_color(
    voxels: &[[i32; 3]],
    colors: &[[u8; 3]],
    probability: &[f64],
    voxel_size_m: f64,
) -> Result<Vec<u8>, OctomapError> {
    let voxels = sorted_values(voxels, colors, probability)?;
    let mut nodes = Nodes::default();
    if !voxels.is_empty() {
        nodes.write_color_node(&voxels, 0);
    }
    nodes.into_file("ColorOcTree", voxel_size_m, false)
}

/// What a node of a `ColorOcTree` says.
#[derive(Clone, Copy, PartialEq)]
struct Value {
    log_odds: f32,
    color: [u8; 3],
}

impl Value {
    fn new(voxel: [i32; 3], color: [u8; 3], probability: f64) -> Result<Self, OctomapError> {
        if !(0.0..=1.0).contains(&probability) {
            return Err(OctomapError::Probability { voxel, probability });
        }
        let probability = probability.clamp(SMALLEST_PROBABILITY, 1.0 - SMALLEST_PROBABILITY);
        let log_odds = (probability / (1.0 - probability)).ln() as f32;
        Ok(Self { log_odds, color })
    }

    /// Value of a node above these, at least one.
    fn of_parent(children: &[Self]) -> Self {
        let log_odds = children.iter().map(|child| child.log_odds);
        Self {
            log_odds: log_odds.fold(f32::NEG_INFINITY, f32::max),
            color: mean_color(children.iter().map(|child| child.color)),
        }
    }

    fn to_bytes(self) -> [u8; 7] {
        let ([a, b, c, d], [red, green, blue]) = (self.log_odds.to_le_bytes(), self.color);
        [a, b, c, d, red, green, blue]
    }
}

/// Rounded down, as the library does.
fn mean_color(colors: impl Iterator<Item = [u8; 3]>) -> [u8; 3] {
    let (mut sum, mut count) = ([0_u32; 3], 0);
    for color in colors.filter(|color| *color != WHITE) {
        sum = array::from_fn(|channel| sum[channel] + u32::from(color[channel]));
        count += 1;
    }
    if count == 0 {
        return WHITE;
    }
    sum.map(|sum| (sum / count) as u8)
}

fn sorted_values(
    voxels: &[[i32; 3]],
    colors: &[[u8; 3]],
    probability: &[f64],
) -> Result<Vec<(u64, Value)>, OctomapError> {
    if voxels.len() != colors.len() || voxels.len() != probability.len() {
        return Err(OctomapError::LengthMismatch {
            voxels: voxels.len(),
            colors: colors.len(),
            probabilities: probability.len(),
        });
    }
    let mut sorted = Vec::with_capacity(voxels.len());
    for ((voxel, color), probability) in voxels.iter().zip(colors).zip(probability) {
        let value = Value::new(*voxel, *color, *probability)?;
        sorted.push((morton_code(voxel)?, value));
    }
    sorted.par_sort_unstable_by_key(|(code, _)| *code);
    if let Some(pair) = sorted.windows(2).find(|pair| pair[0].0 == pair[1].0) {
        let voxel = voxel_of(pair[0].0);
        return Err(OctomapError::RepeatedVoxel { voxel });
    }
    Ok(sorted)
}

#[derive(Default)]
struct Nodes {
    bytes: Vec<u8>,
    count: u64,
}

impl Nodes {
    /// Writes an inner node and all below it. Its leaves have no bytes of their own.
    fn write_binary_node(&mut self, codes: &[u64], depth: u8) {
        self.count += 1;
        let children = split(codes, depth, |code| *code);
        let kinds = children.map(|child| match child.len() {
            0 => UNKNOWN,
            count if is_full(count, depth + 1) => OCCUPIED_LEAF,
            _ => INNER_NODE,
        });
        let bits = kinds.iter().rev().fold(0_u16, |bits, kind| bits << 2 | kind);
        self.bytes.extend(bits.to_le_bytes());
        for (child, kind) in children.iter().zip(kinds) {
            match kind {
                INNER_NODE => self.write_binary_node(child, depth + 1),
                OCCUPIED_LEAF => self.count += 1,
                _ => {}
            }
        }
    }

    /// Writes a leaf, or an inner node and all below it.
    fn write_color_node(&mut self, voxels: &[(u64, Value)], depth: u8) -> Value {
        self.count += 1;
        let (_, first) = voxels[0];
        if is_full(voxels.len(), depth) && voxels.iter().all(|(_, value)| *value == first) {
            self.bytes.extend(first.to_bytes());
            self.bytes.push(0);
            return first;
        }
        // The value of an inner node is known only after its children, which follow it.
        let start = self.bytes.len();
        self.bytes.extend([0; 8]);
        let mut values = Vec::with_capacity(8);
        let children = split(voxels, depth, |(code, _)| *code);
        for (index, child) in children.iter().enumerate().filter(|(_, child)| !child.is_empty()) {
            self.bytes[start + 7] |= 1 << index;
            values.push(self.write_color_node(child, depth + 1));
        }
        let value = Value::of_parent(&values);
        self.bytes[start..start + 7].copy_from_slice(&value.to_bytes());
        value
    }

    fn into_file(self, id: &str, voxel_size_m: f64, binary: bool) -> Result<Vec<u8>, OctomapError> {
        if !is_voxel_size(&voxel_size_m) {
            return Err(OctomapError::VoxelSize { voxel_size_m });
        }
        let header = OctomapHeader { id: id.to_owned(), node_count: self.count, voxel_size_m, binary };
        let mut file = header.to_text().into_bytes();
        file.extend(self.bytes);
        Ok(file)
    }
}
