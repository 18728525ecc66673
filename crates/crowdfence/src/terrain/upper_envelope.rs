//! Where triangles put the surface in their voxels: a plane through the highest of them in every solid.
//!
//! Every solid, a run of voxels in one column, keeps the highest of its triangles at 4 x 4 places of the column and
//! the highest point of all. What belongs together at the top of these samples is the sheet that the plane is fitted to:
//! exact where one flat sheet covers the column, and what covers a corner of it only takes part in proportion. Triangles
//! on edge cover nothing; where they alone reach the top, it is level at its highest point.

use std::ops::Range;
use std::sync::atomic::{AtomicU16, Ordering};

use glam::DVec3;
use rayon::prelude::*;

use super::plane_fit::PlaneFit;
use super::tree::{Ascent, Descent, Place, Tree};
use super::triangles::{BATCH, columns};
use super::{Plane, Terrain};

/// Samples along either side of a column.
const SIDE: usize = 4;
const SAMPLES: usize = SIDE * SIDE;
/// Kept heights of a solid: at the samples and the highest of all.
const HEIGHTS: usize = SAMPLES + 1;
/// How far below the uppermost voxel's floor a sheet that reaches this voxel may begin: its drop at the steepest slopes.
const DROP: i32 = 4;
/// Steps that a voxel's height is kept in: ten times finer than a plane shows.
const STEPS: f64 = 13_000.0;
/// Between neighbouring samples, a sheet as steep as a plane can be and a little more.
const STEP_UP: f64 = Plane::STEEPEST / SIDE as f64 + 0.02;
/// What stands higher than that above all samples is no sheet: this far rises the steepest one from the outermost
/// samples to the column's corners.
const KERB: f64 = Plane::STEEPEST / SIDE as f64 + 0.01;

/// Planes by voxel id of a terrain whose voxels are those that the triangles touch; vertices in voxels from its origin.
pub(super) fn planes(terrain: &Terrain, vertices: &[DVec3], triangles: &[[u32; 3]]) -> Vec<Plane> {
    let solids = Solids::of(terrain.tree());
    triangles.par_chunks(BATCH).for_each(|batch| {
        let mut descent = Descent::new(terrain.tree());
        for triangle in batch {
            solids.add(triangle.map(|index| vertices[index as usize]), terrain, &mut descent);
        }
    });
    solids.planes()
}

/// The highest points of every solid, in steps above [`DROP`] below its uppermost voxel; 0 is none. The largest of
/// numbers is the same in any order, so the result does not depend on the threads.
struct Solids {
    /// By voxel id: number of the solid whose uppermost voxel it is, or NONE.
    numbers: Vec<u32>,
    heights: Vec<AtomicU16>,
}

const NONE: u32 = u32::MAX;

impl Solids {
    fn of(tree: &Tree) -> Solids {
        const CHUNK: usize = 1 << 14;
        let mut numbers = vec![NONE; tree.voxel_count()];
        numbers.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, numbers)| {
            let (mut ascent, mut descent) = (Ascent::new(tree), Descent::new(tree));
            for (id, number) in (chunk * CHUNK..).zip(numbers) {
                let [x, y, z] = ascent.coordinate(id as u32);
                if voxel_at(tree, &mut descent, [x, y, z + 1]).is_none() {
                    *number = 0;
                }
            }
        });
        let mut count = 0;
        for number in numbers.iter_mut().filter(|number| **number != NONE) {
            *number = count;
            count += 1;
        }
        let heights = (0..count as usize * HEIGHTS).into_par_iter().map(|_| AtomicU16::new(0)).collect();
        Solids { numbers, heights }
    }

    /// `corners` in voxels from the terrain's origin.
    fn add(&self, corners: [DVec3; 3], terrain: &Terrain, descent: &mut Descent) {
        let facet = Facet::new(corners);
        for (i, j, part) in columns(corners) {
            let (lowest, highest) = part.bounds(2);
            let top = [i, j, highest.floor() as i32];
            let Some((level, id)) = uppermost(terrain, descent, top) else {
                continue;
            };
            let floor = f64::from(level - DROP);
            let heights = &self.heights[self.numbers[id as usize] as usize * HEIGHTS..][..HEIGHTS];
            let raise = |at: usize, z: f64| {
                let steps = ((z - floor).min(f64::from(DROP + 1)) * STEPS).round();
                if steps >= 0.0 && heights[at].load(Ordering::Relaxed) <= steps as u16 {
                    heights[at].fetch_max(steps as u16 + 1, Ordering::Relaxed);
                }
            };
            raise(SAMPLES, highest);
            let [across, along] = [samples_between(i, part.bounds(0)), samples_between(j, part.bounds(1))];
            for at in across.flat_map(|row| along.clone().map(move |n| row * SIDE + n)) {
                let [x, y] = offset(at);
                if let Some(z) = facet.height(f64::from(i) + 0.5 + x, f64::from(j) + 0.5 + y) {
                    raise(at, z.clamp(lowest, highest));
                }
            }
        }
    }

    fn planes(self) -> Vec<Plane> {
        let Solids { numbers, mut heights } = self;
        let heights: &[AtomicU16] = &mut heights;
        let of_solid = |number: u32| {
            let heights = &heights[number as usize * HEIGHTS..][..HEIGHTS];
            std::array::from_fn(|at| {
                let steps = heights[at].load(Ordering::Relaxed);
                steps.checked_sub(1).map(|steps| f64::from(steps) / STEPS - f64::from(DROP))
            })
        };
        let plane = |number: u32| if number == NONE { Plane::CEILING } else { plane(of_solid(number)) };
        numbers.into_par_iter().map(plane).collect()
    }
}

/// Samples of a column along one axis that may lie between two coordinates.
fn samples_between(column: i32, (low, high): (f64, f64)) -> Range<usize> {
    let place = |coordinate: f64| (coordinate - f64::from(column)) * SIDE as f64 - 0.5;
    const ROUNDING: f64 = 1e-6;
    (place(low) - ROUNDING).ceil().max(0.0) as usize
        ..((place(high) + ROUNDING).floor() + 1.0).clamp(0.0, SIDE as f64) as usize
}

/// Place of a sample, in voxels from the column's centre.
fn offset(at: usize) -> [f64; 2] {
    [at / SIDE, at % SIDE].map(|n| (n as f64 + 0.5) / SIDE as f64 - 0.5)
}

fn voxel_at(tree: &Tree, descent: &mut Descent, coordinate: [u32; 3]) -> Option<u32> {
    if coordinate[2] >= tree.root().cell.side {
        return None;
    }
    match descent.locate(coordinate) {
        Place::Voxel(id) => Some(id),
        Place::Empty(_) => None,
    }
}

/// Level and id of the uppermost voxel of the solid that an occupied voxel belongs to, unless it lies too far above.
fn uppermost(terrain: &Terrain, descent: &mut Descent, [i, j, k]: [i32; 3]) -> Option<(i32, u32)> {
    let [x, y] = [terrain.coordinate(0, i)?, terrain.coordinate(1, j)?];
    let mut found = None;
    for level in k..=k + DROP + 1 {
        let z = terrain.coordinate(2, level);
        match z.and_then(|z| voxel_at(terrain.tree(), descent, [x, y, z])) {
            Some(id) => found = Some((level, id)),
            None => return found,
        }
    }
    None
}

/// A triangle as a height over the plan.
struct Facet {
    corners: [DVec3; 3],
    /// Twice its area in plan, positive where the corners run counterclockwise.
    area: f64,
    slope: [f64; 2],
}

impl Facet {
    fn new(corners: [DVec3; 3]) -> Facet {
        let normal = (corners[1] - corners[0]).cross(corners[2] - corners[0]);
        Facet { corners, area: normal.z, slope: [-normal.x / normal.z, -normal.y / normal.z] }
    }

    /// Where it covers (x, y). Triangles side by side leave no place between them uncovered.
    fn height(&self, x: f64, y: f64) -> Option<f64> {
        const ON_EDGE: f64 = -1e-9;
        let [a, b, c] = self.corners;
        let covers = |from: DVec3, to: DVec3| {
            let turn = (to.x - from.x) * (y - from.y) - (to.y - from.y) * (x - from.x);
            turn * self.area.signum() >= ON_EDGE * ((to.x - from.x).abs() + (to.y - from.y).abs())
        };
        let z = a.z + self.slope[0] * (x - a.x) + self.slope[1] * (y - a.y);
        // On edge in plan, it has no slope.
        (z.is_finite() && covers(a, b) && covers(b, c) && covers(c, a)).then_some(z)
    }
}

/// The plane of a solid from its highest points: those of [`SAMPLES`], the last one anywhere in the column.
fn plane(heights: [Option<f64>; HEIGHTS]) -> Plane {
    let (samples, highest) = (&heights[..SAMPLES], heights[SAMPLES].unwrap_or(1.0));
    let crest = (0..SAMPLES).filter_map(|at| Some((at, samples[at]?))).max_by(|a, b| a.1.total_cmp(&b.1));
    let Some((crest, _)) = crest.filter(|&(_, height)| highest <= height + KERB) else {
        return Plane::new(highest, [0.0; 2]);
    };
    let mut fit = PlaneFit::default();
    let sheet = sheet(samples, crest);
    for at in (0..SAMPLES).filter(|at| sheet >> at & 1 != 0) {
        let ([x, y], z) = (offset(at), samples[at].expect("a sheet has heights"));
        fit.add([x, y, z], 1.0);
    }
    let (height, slope) = fit.plane();
    // Beyond its edge, a sheet does not go on rising.
    Plane::new(height.min(highest), slope)
}

/// The samples that hang together with one of them, as bits.
fn sheet(samples: &[Option<f64>], crest: usize) -> u32 {
    let (mut sheet, mut waiting) = (1 << crest, vec![crest]);
    while let Some(at) = waiting.pop() {
        for next in beside(at) {
            let near = samples[next].zip(samples[at]).is_some_and(|(a, b)| (a - b).abs() <= STEP_UP);
            if near && sheet >> next & 1 == 0 {
                sheet |= 1 << next;
                waiting.push(next);
            }
        }
    }
    sheet
}

/// Samples to the west, east, south and north.
fn beside(at: usize) -> impl Iterator<Item = usize> {
    let (i, j) = (at / SIDE, at % SIDE);
    [
        (i > 0, at.wrapping_sub(SIDE)),
        (i + 1 < SIDE, at + SIDE),
        (j > 0, at.wrapping_sub(1)),
        (j + 1 < SIDE, at + 1),
    ]
    .into_iter()
    .filter_map(|(inside, next)| inside.then_some(next))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn terrain(corners: &[[f64; 3]], triangles: &[[u32; 3]]) -> Terrain {
        let vertices: Vec<DVec3> = corners.iter().map(|&corner| corner.into()).collect();
        Terrain::from_triangles(&vertices, triangles, 1.0, DVec3::ZERO).unwrap()
    }

    /// Four corners around one surface.
    fn patch(corners: [[f64; 3]; 4]) -> Terrain {
        terrain(&corners, &[[0, 1, 2], [0, 2, 3]])
    }

    /// A level rectangle over [x0, x1] x [y0, y1].
    fn slab([x0, x1]: [f64; 2], [y0, y1]: [f64; 2], z: f64) -> [[f64; 3]; 4] {
        [[x0, y0, z], [x1, y0, z], [x1, y1, z], [x0, y1, z]]
    }

    /// Level of the uppermost voxel of a column and its plane.
    fn top(terrain: &Terrain, i: i32, j: i32) -> (i32, Plane) {
        let (level, id) = terrain.column(i, j).last().unwrap();
        (level, terrain.plane(id))
    }

    fn level(height: f64) -> Plane {
        Plane::new(height, [0.0; 2])
    }

    /// Steps in which heights are kept on the way here, and by the plane.
    const STEP: f64 = 0.5 / STEPS + 0.5 / 8192.0;

    #[test]
    fn a_roof_edge_is_the_roof_and_the_facade_below_it_ends_there() {
        // Roof at 9.25 from x = 4.7 on, ground at 0.5, facade between: the roof covers three tenths of column 4.
        let mut corners = slab([0.0, 4.7], [0.0, 4.0], 0.5).to_vec();
        corners.extend(slab([4.7, 9.0], [0.0, 4.0], 9.25));
        let quad = |[a, b, c, d]: [u32; 4]| [[a, b, c], [a, c, d]];
        let triangles = [quad([0, 1, 2, 3]), quad([4, 5, 6, 7]), quad([1, 4, 7, 2])].concat();
        let terrain = terrain(&corners, &triangles);
        assert_eq!(terrain.column(4, 1).count(), 10);
        assert_eq!(
            [3, 4, 5].map(|i| top(&terrain, i, 1)),
            [(0, level(0.5)), (9, level(0.25)), (9, level(0.25))]
        );
    }

    #[test]
    fn a_fence_ends_at_its_highest_point_and_a_kerb_is_no_fence() {
        // On edge at x = 2.5, from the ground up to 3.2 and, from y = 2 on, only to 0.8.
        let ground = slab([0.0, 5.0], [0.0, 5.0], 0.5);
        let fence = [[2.5, 0.0, 0.5], [2.5, 2.0, 0.5], [2.5, 2.0, 3.2], [2.5, 0.0, 3.2]];
        let kerb = [[2.5, 2.0, 0.5], [2.5, 5.0, 0.5], [2.5, 5.0, 0.8], [2.5, 2.0, 0.8]];
        let quad = |a: u32| [[a, a + 1, a + 2], [a, a + 2, a + 3]];
        let terrain = terrain(&[ground, fence, kerb].concat(), &[quad(0), quad(4), quad(8)].concat());
        assert_eq!(top(&terrain, 2, 1), (3, level(0.2)));
        assert_eq!(top(&terrain, 2, 3), (0, level(0.5)));
        assert_eq!(top(&terrain, 1, 1), (0, level(0.5)));
    }

    #[test]
    fn of_sheets_in_one_voxel_the_upper_one_counts() {
        let [low, high] = [slab([0.0, 5.0], [0.0, 5.0], 0.1), slab([0.0, 5.0], [0.0, 5.0], 0.6)];
        let terrain = terrain(&[high, low].concat(), &[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]);
        assert_eq!(top(&terrain, 2, 2), (0, level(0.6)));
    }

    #[test]
    fn sheets_with_air_between_have_their_own_planes() {
        let mut corners = slab([0.0, 5.0], [0.0, 5.0], 0.5).to_vec();
        corners.extend([[0.0, 0.0, 7.0], [5.0, 0.0, 9.5], [5.0, 5.0, 9.5], [0.0, 5.0, 7.0]]);
        let terrain = terrain(&corners, &[[0, 1, 2], [0, 2, 3], [4, 5, 6], [4, 6, 7]]);
        assert_eq!(terrain.plane(terrain.id([2, 2, 0]).unwrap()), level(0.5));
        let (level, roof) = top(&terrain, 2, 2);
        assert!((f64::from(level) + roof.height() - 8.25).abs() < STEP);
        assert_eq!(roof.slope(), [0.5, 0.0]);
    }

    #[test]
    fn a_sheet_is_continued_over_the_part_of_a_column_that_it_leaves_open() {
        // It rises by 1 in 1 along x and ends at x = 3.55: column 3 is known up to a little beyond its middle.
        let terrain = patch([[0.0, 0.0, 0.2], [3.55, 0.0, 3.75], [3.55, 4.0, 3.75], [0.0, 4.0, 0.2]]);
        let (floor, plane) = top(&terrain, 3, 1);
        assert!((f64::from(floor) + plane.height() - 3.7).abs() < STEP, "{plane:?}");
        assert_eq!(plane.slope(), [1.0, 0.0]);
    }

    #[test]
    fn triangles_that_cover_no_sample_are_level_at_their_highest_point() {
        let terrain = patch([[2.0, 2.0, 1.4], [2.05, 2.0, 1.5], [2.05, 2.05, 1.6], [2.0, 2.05, 1.5]]);
        let (floor, plane) = top(&terrain, 2, 2);
        assert_eq!(floor, 1);
        assert!((plane.height() - 0.6).abs() < STEP && plane.slope() == [0.0; 2], "{plane:?}");
    }

    /// A mesh over heights at whole numbers of 3 voxels.
    fn mesh(heights: &[f64]) -> (Vec<DVec3>, Vec<[u32; 3]>) {
        let side = heights.len().isqrt();
        let place = |n: usize| [3.0 * (n / side) as f64, 3.0 * (n % side) as f64];
        let vertices =
            heights.iter().enumerate().map(|(n, &z)| DVec3::new(place(n)[0], place(n)[1], z)).collect();
        let cells = (0..side - 1).flat_map(|i| (0..side - 1).map(move |j| i * side + j));
        let triangles = cells
            .flat_map(|n| [[n, n + side, n + side + 1], [n, n + side + 1, n + 1]])
            .map(|corners| corners.map(|n| n as u32));
        (vertices, triangles.collect())
    }

    /// Height of a mesh at a place, from barycentric weights.
    fn height_at(vertices: &[DVec3], triangles: &[[u32; 3]], x: f64, y: f64) -> f64 {
        let heights = triangles.iter().filter_map(|triangle| {
            let [a, b, c] = triangle.map(|n| vertices[n as usize]);
            let area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
            let second = ((x - a.x) * (c.y - a.y) - (c.x - a.x) * (y - a.y)) / area;
            let third = ((b.x - a.x) * (y - a.y) - (x - a.x) * (b.y - a.y)) / area;
            let inside = second >= -1e-9 && third >= -1e-9 && second + third <= 1.0 + 1e-9;
            inside.then_some(a.z + second * (b.z - a.z) + third * (c.z - a.z))
        });
        heights.fold(f64::NEG_INFINITY, f64::max)
    }

    fn corner() -> impl Strategy<Value = DVec3> {
        let coordinate = || prop_oneof![(-12..12).prop_map(|n| f64::from(n) / 2.0), -6.0..6.0];
        (coordinate(), coordinate(), coordinate()).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn one_flat_sheet_is_kept_to_the_steps_of_a_plane(
            x in -1.9..1.9, lean in -1.0..1.0, at in -50.0..50.0, share in 0.0..1.0,
        ) {
            // Steeper along both axes at once, its middle would lie too far below the uppermost voxel.
            let y = lean * f64::min(1.9, 2.0 - f64::abs(x));
            let height = |u: f64, v: f64| at + x * u + y * v;
            let corner = |u: f64, v: f64| [u, v, height(u, v)];
            // Seven triangles around a place inside: columns have up to three.
            let middle = corner(2.0 + 6.0 * share, 7.0 - 3.0 * share);
            let rim = [[0.0, 0.0], [5.0, 0.0], [11.0, 0.0], [11.0, 6.0], [11.0, 11.0], [4.0, 11.0], [0.0, 11.0]];
            let corners: Vec<[f64; 3]> = rim.map(|[u, v]| corner(u, v)).into_iter().chain([middle]).collect();
            let fan: Vec<[u32; 3]> = (0..7).map(|n| [n, (n + 1) % 7, 7]).collect();
            let terrain = terrain(&corners, &fan);
            for (i, j) in (0..11).flat_map(|i| (0..11).map(move |j| (i, j))) {
                let (floor, plane) = top(&terrain, i, j);
                let off = f64::from(floor) + plane.height() - height(f64::from(i) + 0.5, f64::from(j) + 0.5);
                prop_assert!(off.abs() <= STEP + 1e-6, "{off} in column ({i}, {j})");
                for (kept, slope) in plane.slope().into_iter().zip([x, y]) {
                    prop_assert!((kept - slope).abs() < 0.51 / 64.0, "{kept} instead of {slope}");
                }
            }
        }

        /// Against the same least squares over 40 x 40 heights a column, found in another way.
        #[test]
        fn a_mesh_is_what_dense_samples_of_it_say(heights in prop::collection::vec(0.0..3.0, 16)) {
            let (vertices, triangles) = mesh(&heights);
            let terrain = Terrain::from_triangles(&vertices, &triangles, 1.0, DVec3::ZERO).unwrap();
            for (i, j) in (0..9).flat_map(|i| (0..9).map(move |j| (i, j))) {
                let mut fit = PlaneFit::default();
                for n in 0..1600 {
                    let [x, y] = [n / 40, n % 40].map(|n| (f64::from(n) + 0.5) / 40.0 - 0.5);
                    let z = height_at(&vertices, &triangles, f64::from(i) + 0.5 + x, f64::from(j) + 0.5 + y);
                    fit.add([x, y, z], 1.0);
                }
                let (height, slope) = fit.plane();
                let (floor, plane) = top(&terrain, i, j);
                prop_assert!((f64::from(floor) + plane.height() - height).abs() < 0.06, "{plane:?}");
                for (kept, slope) in plane.slope().into_iter().zip(slope) {
                    prop_assert!((kept - slope).abs() < 0.25, "{kept} instead of {slope}");
                }
            }
        }

        #[test]
        fn no_plane_rises_above_the_highest_triangle(
            corners in prop::collection::vec(corner(), 3..30), picks in prop::collection::vec(any::<prop::sample::Index>(), 3..60),
        ) {
            let triangles: Vec<[u32; 3]> = picks
                .chunks_exact(3)
                .map(|picks| [0, 1, 2].map(|n: usize| picks[n].index(corners.len()) as u32))
                .collect();
            let terrain = Terrain::from_triangles(&corners, &triangles, 1.0, DVec3::ZERO).unwrap();
            for id in 0..terrain.voxel_count() as u32 {
                let [i, j, k] = terrain.index(id);
                if terrain.id([i, j, k + 1]).is_none() {
                    prop_assert!(terrain.plane(id).height() <= 1.0);
                }
            }
        }
    }
}
