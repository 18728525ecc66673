//! Triangles -> the voxels that they touch.
//!
//! A triangle is cut into slices one voxel wide along x, every slice likewise along y. What is left above one
//! column of voxels is convex, hence without gaps in z, and touches exactly the voxels from its lowest to its
//! highest point. The work grows with the voxels found and not with the bounding box of the triangle.

use std::sync::atomic::{AtomicU64, Ordering};

use glam::DVec3;
use rayon::prelude::*;
use thiserror::Error;

use crate::error::short;

/// Most voxels found for one surface, 12 bytes each and twice that while the lists of all tasks are joined.
/// A voxel that several triangles of one task touch counts repeatedly until the task is done.
pub const MAX_TRIANGLE_VOXELS: u64 = 1 << 27;
/// Largest coordinate of a vertex, in voxels: grid indices and their differences fit an i32.
pub const MAX_COORDINATE: f64 = (1 << 30) as f64;

/// Triangles that one task turns into one sorted list.
pub(super) const BATCH: usize = 4096;
/// Triangles of several tasks may lie on top of each other and share their voxels; more such layers than this
/// no mesh has.
const MOST_LAYERS: f64 = 4.0;
/// Voxels that a task finds before it reports them to the common count.
const COUNTING_STEP: u64 = 1 << 16;

/// Why triangles cannot be made voxels. The message of a variant is its documentation.
#[allow(missing_docs)]
#[derive(Debug, Clone, PartialEq, Error)]
pub enum TrianglesError {
    #[error(
        "vertex {vertex} is at ({}, {}, {}) in voxels from the origin; coordinates must be finite and within 2^30 voxels",
        short(*x), short(*y), short(*z)
    )]
    Vertex { vertex: usize, x: f64, y: f64, z: f64 },
    #[error("triangle {triangle} uses vertex {index}, but there are only {count} vertices")]
    VertexIndex { triangle: usize, index: u32, count: usize },
    #[error("triangles touch more than {bound} voxels. Use larger voxels")]
    TooManyVoxels { bound: u64 },
}

/// Grid indices, sorted and without repeats, of all voxels that a triangle touches.
///
/// `vertices` are in voxels from the origin of the terrain, so voxel (i, j, k) is the half-open box from
/// (i, j, k) to (i + 1, j + 1, k + 1); a triangle that ends exactly on the upper face of a voxel may count as
/// touching it, never the reverse (up to the rounding of f64). Triangles without area are lines or points and
/// still touch voxels. No triangles give no voxels.
pub fn voxelize_triangles(
    vertices: &[DVec3],
    triangles: &[[u32; 3]],
) -> Result<Vec<[i32; 3]>, TrianglesError> {
    voxelize_up_to(MAX_TRIANGLE_VOXELS, vertices, triangles)
}

fn voxelize_up_to(
    bound: u64,
    vertices: &[DVec3],
    triangles: &[[u32; 3]],
) -> Result<Vec<[i32; 3]>, TrianglesError> {
    check(vertices, triangles)?;
    let corners = |triangle: &[u32; 3]| triangle.map(|index| vertices[index as usize]);
    let fewest =
        |part: &[[u32; 3]]| part.iter().map(|triangle| fewest_voxels(corners(triangle))).sum::<f64>();
    // A gross mistake of scale is seen before any voxel is made.
    if fewest(triangles) > MOST_LAYERS * bound as f64 {
        return Err(TrianglesError::TooManyVoxels { bound });
    }
    let total = AtomicU64::new(0);
    let lists = triangles
        .par_chunks(BATCH)
        .map(|batch| {
            let mut list = VoxelList { voxels: Vec::new(), unreported: 0, total: &total, bound };
            if fewest(batch) > bound as f64 {
                return Err(TrianglesError::TooManyVoxels { bound });
            }
            for triangle in batch {
                list.add_triangle(corners(triangle))?;
            }
            Ok(list.finish())
        })
        .collect::<Result<Vec<_>, _>>()?;
    let mut voxels = lists.concat();
    drop(lists);
    voxels.par_sort_unstable();
    voxels.dedup();
    Ok(voxels)
}

fn check(vertices: &[DVec3], triangles: &[[u32; 3]]) -> Result<(), TrianglesError> {
    // Written so that NaN fails as well.
    let placeable = |vertex: &DVec3| vertex.to_array().iter().all(|c| c.abs() <= MAX_COORDINATE);
    if let Some(vertex) = vertices.par_iter().position_first(|vertex| !placeable(vertex)) {
        let DVec3 { x, y, z } = vertices[vertex];
        return Err(TrianglesError::Vertex { vertex, x, y, z });
    }
    let known = |index: u32| (index as usize) < vertices.len();
    let stray = |triangle: &[u32; 3]| triangle.iter().copied().find(|&index| !known(index));
    match triangles.par_iter().position_first(|triangle| stray(triangle).is_some()) {
        None => Ok(()),
        Some(triangle) => Err(TrianglesError::VertexIndex {
            triangle,
            index: stray(&triangles[triangle]).expect("this triangle has one"),
            count: vertices.len(),
        }),
    }
}

/// Every column that the triangle covers in plan has a voxel, whichever axis the columns run along.
fn fewest_voxels(corners: [DVec3; 3]) -> f64 {
    (corners[1] - corners[0]).cross(corners[2] - corners[0]).abs().max_element() / 2.0
}

/// Voxels of one batch. All batches share one count, so that memory stays bounded whatever the triangles are.
struct VoxelList<'a> {
    voxels: Vec<[i32; 3]>,
    /// Voxels found since the last report to `total`.
    unreported: u64,
    total: &'a AtomicU64,
    bound: u64,
}

impl VoxelList<'_> {
    fn add_triangle(&mut self, corners: [DVec3; 3]) -> Result<(), TrianglesError> {
        for (i, j, part) in columns(corners) {
            let levels = part.voxel_range(2);
            self.reserve(levels.end().abs_diff(*levels.start()))?;
            self.voxels.extend(levels.map(|k| [i, j, k]));
        }
        Ok(())
    }

    /// Called before a column is added, because one column alone may be too much.
    fn reserve(&mut self, steps: u32) -> Result<(), TrianglesError> {
        self.unreported += u64::from(steps) + 1;
        if self.unreported < COUNTING_STEP {
            return Ok(());
        }
        let found = std::mem::take(&mut self.unreported);
        if self.total.fetch_add(found, Ordering::Relaxed) + found > self.bound {
            return Err(TrianglesError::TooManyVoxels { bound: self.bound });
        }
        Ok(())
    }

    /// Neighbouring triangles share voxels, so the list shrinks here, and the common count with it.
    fn finish(mut self) -> Vec<[i32; 3]> {
        let reported = self.voxels.len() as u64 - self.unreported;
        self.voxels.sort_unstable();
        self.voxels.dedup();
        self.total.fetch_sub(reported, Ordering::Relaxed);
        self.total.fetch_add(self.voxels.len() as u64, Ordering::Relaxed);
        self.voxels
    }
}

/// Columns (i, j) that a triangle touches, each with the part of the triangle inside.
pub(super) fn columns(corners: [DVec3; 3]) -> impl Iterator<Item = (i32, i32, Polygon)> {
    let triangle = Polygon::triangle(corners);
    triangle.voxel_range(0).flat_map(move |i| {
        let slice = triangle.slice(0, i);
        slice.voxel_range(1).map(move |j| (i, j, slice.slice(1, j)))
    })
}

/// Convex polygon in space. Each of the four cuts adds at most one corner to the triangle.
#[derive(Clone, Copy)]
pub(super) struct Polygon {
    corners: [DVec3; 7],
    count: usize,
}

impl Polygon {
    fn triangle(corners: [DVec3; 3]) -> Polygon {
        let mut polygon = Polygon::EMPTY;
        corners.into_iter().for_each(|corner| polygon.push(corner));
        polygon
    }

    const EMPTY: Polygon = Polygon { corners: [DVec3::ZERO; 7], count: 0 };

    fn push(&mut self, corner: DVec3) {
        self.corners[self.count] = corner;
        self.count += 1;
    }

    fn corners(&self) -> &[DVec3] {
        &self.corners[..self.count]
    }

    /// Indices of the voxels between the lowest and the highest corner along `axis`.
    fn voxel_range(&self, axis: usize) -> std::ops::RangeInclusive<i32> {
        let (low, high) = self.bounds(axis);
        low.floor() as i32..=high.floor() as i32
    }

    /// Lowest and highest corner along `axis`.
    pub(super) fn bounds(&self, axis: usize) -> (f64, f64) {
        let along = self.corners().iter().map(|corner| corner[axis]);
        (along.clone().fold(f64::INFINITY, f64::min), along.fold(f64::NEG_INFINITY, f64::max))
    }

    /// The part between the planes `index` and `index + 1` across `axis`, both included.
    fn slice(&self, axis: usize, index: i32) -> Polygon {
        let range = self.voxel_range(axis);
        if range.start() == range.end() {
            return *self;
        }
        self.cut(axis, f64::from(index), 1.0).cut(axis, f64::from(index) + 1.0, -1.0)
    }

    /// The part on the positive (`side` = 1) or negative (`side` = -1) side of a plane across `axis`
    /// (Sutherland and Hodgman 1974).
    fn cut(&self, axis: usize, plane: f64, side: f64) -> Polygon {
        let inside = |corner: DVec3| (corner[axis] - plane) * side >= 0.0;
        let mut part = Polygon::EMPTY;
        let Some(&last) = self.corners().last() else {
            return part;
        };
        let mut from = last;
        for &to in self.corners() {
            if inside(from) != inside(to) {
                part.push(crossing(from, to, axis, plane));
            }
            if inside(to) {
                part.push(to);
            }
            from = to;
        }
        part
    }
}

/// Where an edge passes through a plane across `axis`. Rounding must not carry the point beyond the edge's
/// ends, or a level triangle on a grid plane would reach into the voxels below.
fn crossing(from: DVec3, to: DVec3, axis: usize, plane: f64) -> DVec3 {
    let share = (plane - from[axis]) / (to[axis] - from[axis]);
    let mut point = (from + (to - from) * share).clamp(from.min(to), from.max(to));
    point[axis] = plane;
    point
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn voxels(corners: [[f64; 3]; 3]) -> Vec<[i32; 3]> {
        voxelize_triangles(&corners.map(DVec3::from), &[[0, 1, 2]]).unwrap()
    }

    #[test]
    fn a_level_triangle_on_a_grid_plane_stays_in_the_layer_above_it() {
        // Corners (0, 0), (2, 0), (0, 2) at z = 3: the long side runs through the corner (1, 1). Voxels whose
        // lower face it ends on (x = 2 or y = 2) hold the two tips.
        let expected = [[0, 0, 3], [0, 1, 3], [0, 2, 3], [1, 0, 3], [1, 1, 3], [2, 0, 3]];
        assert_eq!(voxels([[0.0, 0.0, 3.0], [2.0, 0.0, 3.0], [0.0, 2.0, 3.0]]), expected);
    }

    #[test]
    fn an_upright_wall_fills_its_plane() {
        let wall = voxels([[0.5, 0.5, 0.5], [0.5, 3.5, 0.5], [0.5, 0.5, 2.5]]);
        // The slanted side passes y = 1, 2, 3 at z = 2.17, 1.5, 0.83.
        let expected = [
            [0, 0, 0],
            [0, 0, 1],
            [0, 0, 2],
            [0, 1, 0],
            [0, 1, 1],
            [0, 1, 2],
            [0, 2, 0],
            [0, 2, 1],
            [0, 3, 0],
        ];
        assert_eq!(wall, expected);
    }

    #[test]
    fn a_triangle_without_area_is_a_line_or_a_point() {
        let line = voxels([[0.5, 0.5, 0.5], [2.5, 0.5, 0.5], [1.0, 0.5, 0.5]]);
        assert_eq!(line, [[0, 0, 0], [1, 0, 0], [2, 0, 0]]);
        assert_eq!(voxels([[-0.5, 7.0, 1.25]; 3]), [[-1, 7, 1]]);
    }

    #[test]
    fn shared_voxels_are_listed_once_and_no_triangles_give_none() {
        let corners = [[0.1, 0.1, 0.1], [0.9, 0.1, 0.1], [0.1, 0.9, 0.1]].map(DVec3::from);
        assert_eq!(voxelize_triangles(&corners, &[[0, 1, 2]; 10_000]).unwrap(), [[0, 0, 0]]);
        assert_eq!(voxelize_triangles(&corners, &[]).unwrap(), [[0; 3]; 0]);
    }

    #[test]
    fn bad_vertices_and_indices_are_named() {
        let mut corners = [DVec3::ZERO, DVec3::X, DVec3::Y];
        let error = voxelize_triangles(&corners, &[[0, 1, 2], [0, 1, 3]]).unwrap_err();
        assert_eq!(error.to_string(), "triangle 1 uses vertex 3, but there are only 3 vertices");
        for bad in [f64::NAN, f64::INFINITY, -1.1e9] {
            corners[2].z = bad;
            let error = voxelize_triangles(&corners, &[[0, 1, 2]]).unwrap_err();
            assert!(error.to_string().starts_with("vertex 2 is at (0, 1, "), "{error}");
        }
    }

    #[test]
    fn too_many_voxels_are_refused_before_they_are_made() {
        // 10^18 voxels and twice 10^9: making them would end neither soon nor well.
        for corners in [
            [[0.0, 0.0, 0.0], [1e9, 0.0, 0.0], [0.0, 1e9, 0.0]],
            [[0.0, 0.0, 0.0], [0.0, 0.0, 1e9], [0.0, 0.5, 0.0]],
            [[0.0, 0.0, 0.0], [0.0, 1e9, 0.0], [0.0, 5e8, 0.0]],
        ] {
            let error = voxelize_up_to(200_000, &corners.map(DVec3::from), &[[0, 1, 2]]).unwrap_err();
            assert_eq!(error, TrianglesError::TooManyVoxels { bound: 200_000 });
        }
    }

    /// Separating axes of a triangle and the closed unit box at `voxel`, grown by `margin` on every side
    /// (Akenine-Moeller 2001): an algorithm that shares nothing with cutting.
    fn overlaps(corners: [DVec3; 3], voxel: [i32; 3], margin: f64) -> bool {
        let center = DVec3::from(voxel.map(f64::from)) + 0.5;
        let corners = corners.map(|corner| corner - center);
        let edges = [corners[1] - corners[0], corners[2] - corners[1], corners[0] - corners[2]];
        let crossed = DVec3::AXES.iter().flat_map(|axis| edges.map(|edge| axis.cross(edge)));
        let mut axes = DVec3::AXES.iter().copied().chain([edges[0].cross(edges[1])]).chain(crossed);
        axes.all(|axis| {
            let reach = (0.5 + margin) * axis.abs().element_sum();
            let along = corners.map(|corner| corner.dot(axis));
            let low = along.iter().copied().fold(f64::INFINITY, f64::min);
            let high = along.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            low <= reach && high >= -reach
        })
    }

    fn corner() -> impl Strategy<Value = DVec3> {
        // Halves put corners on grid planes, edges and corners; the rest is anywhere.
        let coordinate = || prop_oneof![(-12..12).prop_map(|n| f64::from(n) / 2.0), -6.0..6.0];
        (coordinate(), coordinate(), coordinate()).prop_map(|(x, y, z)| DVec3::new(x, y, z))
    }

    proptest! {
        #[test]
        fn every_point_of_the_triangle_lies_in_one_of_its_voxels(corners in [corner(), corner(), corner()]) {
            let found = voxelize_triangles(&corners, &[[0, 1, 2]]).unwrap();
            const STEPS: u32 = 60;
            for a in 0..=STEPS {
                for b in 0..=STEPS - a {
                    let [u, v] = [a, b].map(|n| f64::from(n) / f64::from(STEPS));
                    let point = corners[0] + (corners[1] - corners[0]) * u + (corners[2] - corners[0]) * v;
                    // The sample itself is rounded, so next to a face its voxel is uncertain.
                    if (point - point.round()).abs().min_element() < 1e-9 {
                        continue;
                    }
                    let voxel = point.floor().to_array().map(|c| c as i32);
                    prop_assert!(found.binary_search(&voxel).is_ok(), "{point} in {voxel:?}");
                }
            }
        }

        #[test]
        fn the_voxels_are_those_that_no_axis_separates(corners in [corner(), corner(), corner()]) {
            let found = voxelize_triangles(&corners, &[[0, 1, 2]]).unwrap();
            for voxel in (0..14 * 14 * 14).map(|n| [n / 196 - 7, n / 14 % 14 - 7, n % 14 - 7]) {
                let listed = found.binary_search(&voxel).is_ok();
                prop_assert!(!listed || overlaps(corners, voxel, 1e-9), "{voxel:?} is not touched");
                prop_assert!(listed || !overlaps(corners, voxel, -1e-9), "{voxel:?} is missing");
            }
        }

        #[test]
        fn arbitrary_numbers_never_panic(
            corners in proptest::array::uniform3(proptest::array::uniform3(proptest::num::f64::ANY)),
            triangle in proptest::array::uniform3(0_u32..5),
        ) {
            let _ = voxelize_triangles(&corners.map(DVec3::from), &[triangle]);
        }
    }
}
