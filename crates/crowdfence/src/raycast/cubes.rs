//! Ray -> first occupied voxel: an exact grid traversal (Amanatides and Woo, 1987) that leaves out empty
//! cells of the tree. Every plane crossing is computed from its integer coordinate, never accumulated, so
//! skipping a cell visits the very voxels that stepping through it would visit.
//!
//! What a ray hits, case by case:
//! - a ray that starts inside an occupied voxel hits it at distance 0;
//! - a point on the plane between two voxels belongs to the upper one (half-open boxes), so a ray that runs
//!   along a plane stays in the voxels above it, and one that starts on a plane and moves down crosses it at
//!   distance 0;
//! - a ray through an edge or corner crosses the x plane before y before z and touches the voxels between:
//!   it cannot slip through two voxels that share an edge only;
//! - a voxel counts when the ray enters it at no more than the range.

use glam::DVec3;

use crate::terrain::Terrain;
use crate::terrain::tree::{Cell, Descent, Place, Tree};

/// Voxel id and distance in voxels of the first voxel entered at no more than `range`; `direction` has length 1.
pub(super) fn first_hit(
    terrain: &Terrain,
    origin: DVec3,
    direction: DVec3,
    range: f64,
) -> Option<(u32, f64)> {
    let inverse = direction.to_array().map(f64::recip);
    Ray { origin: origin.to_array(), inverse, range }.first_hit(terrain.tree(), terrain.extent())
}

/// A ray in tree coordinates: lengths count voxels.
struct Ray {
    origin: [f64; 3],
    /// 1 / direction; infinite along an axis on which the ray does not move.
    inverse: [f64; 3],
    range: f64,
}

/// Where the ray crosses a plane. Crossings are ordered by distance, then x before y before z.
#[derive(Clone, Copy, PartialEq, PartialOrd)]
struct Crossing {
    distance: f64,
    axis: usize,
}

impl Ray {
    fn first_hit(&self, tree: &Tree, extent: [u32; 3]) -> Option<(u32, f64)> {
        let (mut voxel, mut distance) = self.enter(extent)?;
        let mut descent = Descent::new(tree);
        loop {
            if distance > self.range {
                return None;
            }
            let empty = match descent.locate(voxel.map(|v| v as u32)) {
                Place::Voxel(id) => return Some((id, distance)),
                Place::Empty(cell) => cell,
            };
            let exit = self.leave(&mut voxel, empty);
            distance = exit.distance;
            if !(0..i64::from(extent[exit.axis])).contains(&voxel[exit.axis]) {
                return None;
            }
        }
    }

    /// First voxel of the box [0, extent) on the ray and the distance to it.
    fn enter(&self, extent: [u32; 3]) -> Option<([i64; 3], f64)> {
        let mut voxel = self.origin.map(|o| o.floor() as i64);
        let mut entry: Option<Crossing> = None;
        for axis in 0..3 {
            let last = i64::from(extent[axis]) - 1;
            let first_inside = if voxel[axis] < 0 {
                0
            } else if voxel[axis] > last {
                last
            } else {
                continue;
            };
            let ahead = (first_inside - voxel[axis]).signum() == self.step(axis);
            if !ahead {
                return None; // beside the box and not moving towards it
            }
            let crossing = self.crossing(axis, self.near_plane(axis, first_inside));
            voxel[axis] = first_inside;
            entry = entry.into_iter().chain([crossing]).reduce(latest);
        }
        let Some(entry) = entry else {
            return Some((voxel, 0.0));
        };
        for axis in (0..3).filter(|&axis| axis != entry.axis) {
            // A ray that passes the box far beside it must not be followed there voxel by voxel.
            let beside = self.origin[axis] + entry.distance / self.inverse[axis];
            if !(-1.0..=f64::from(extent[axis]) + 1.0).contains(&beside) {
                return None;
            }
            voxel[axis] = self.advance(axis, voxel[axis], entry);
            if !(0..i64::from(extent[axis])).contains(&voxel[axis]) {
                return None;
            }
        }
        Some((voxel, entry.distance))
    }

    /// Moves `voxel` out of the empty cell around it and says where it crossed.
    fn leave(&self, voxel: &mut [i64; 3], empty: Cell) -> Crossing {
        let exits = (0..3).map(|axis| {
            let low = empty.low[axis];
            let plane = i64::from(if self.step(axis) > 0 { low + empty.side } else { low });
            (self.crossing(axis, plane), plane)
        });
        let (exit, plane) =
            exits.reduce(|a, b| if b.0.distance < a.0.distance { b } else { a }).expect("three axes");
        if empty.side > 1 {
            for axis in (0..3).filter(|&axis| axis != exit.axis) {
                voxel[axis] = self.advance(axis, voxel[axis], exit);
            }
        }
        voxel[exit.axis] = if self.step(exit.axis) > 0 { plane } else { plane - 1 };
        exit
    }

    /// Voxel along `axis` after all crossings before `until`, starting at voxel `from`.
    fn advance(&self, axis: usize, from: i64, until: Crossing) -> i64 {
        let step = self.step(axis);
        if step == 0 {
            return from;
        }
        // The estimate may be off by rounding; the crossings decide.
        let estimate = (self.origin[axis] + until.distance / self.inverse[axis]).floor() as i64;
        let mut voxel = if step > 0 { estimate.max(from) } else { estimate.min(from) };
        while voxel != from && self.crossing(axis, self.near_plane(axis, voxel)) >= until {
            voxel -= step;
        }
        while self.crossing(axis, self.near_plane(axis, voxel + step)) < until {
            voxel += step;
        }
        voxel
    }

    /// -1, 0 or 1.
    fn step(&self, axis: usize) -> i64 {
        if self.inverse[axis].is_infinite() { 0 } else { self.inverse[axis].signum() as i64 }
    }

    /// Plane through which the ray enters a voxel.
    fn near_plane(&self, axis: usize, voxel: i64) -> i64 {
        if self.step(axis) > 0 { voxel } else { voxel + 1 }
    }

    fn crossing(&self, axis: usize, plane: i64) -> Crossing {
        let distance = if self.step(axis) == 0 {
            f64::INFINITY
        } else {
            (plane as f64 - self.origin[axis]) * self.inverse[axis]
        };
        Crossing { distance, axis }
    }
}

fn latest(a: Crossing, b: Crossing) -> Crossing {
    if b > a { b } else { a }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::Surface;
    use proptest::prelude::*;

    fn terrain(voxels: &[[i32; 3]]) -> Terrain {
        Terrain::from_indices(voxels, 1.0, DVec3::ZERO).unwrap()
    }

    fn cast(terrain: &Terrain, origin: [f64; 3], direction: [f64; 3], range: f64) -> Option<([i32; 3], f64)> {
        terrain
            .raycast(Surface::Voxels, origin.into(), direction.into(), range)
            .map(|hit| (terrain.index(hit.voxel_id), hit.distance_m))
    }

    #[test]
    fn a_ray_from_above_the_map_hits_the_first_voxel_below() {
        let map = terrain(&[[0, 0, 0], [0, 0, 5]]);
        assert_eq!(cast(&map, [0.5, 0.5, 100.0], [0.0, 0.0, -2.0], 1e3), Some(([0, 0, 5], 94.0)));
    }

    #[test]
    fn a_ray_that_starts_inside_a_voxel_hits_it_at_distance_zero() {
        let map = terrain(&[[3, 3, 3], [4, 3, 3]]);
        assert_eq!(cast(&map, [3.5, 3.5, 3.5], [1.0, 0.0, 0.0], 1e3), Some(([3, 3, 3], 0.0)));
    }

    #[test]
    fn the_range_is_inclusive_and_counts_to_the_entry_point() {
        let map = terrain(&[[10, 0, 0]]);
        let ray = |range| cast(&map, [0.5, 0.5, 0.5], [1.0, 0.0, 0.0], range);
        assert_eq!(ray(9.5), Some(([10, 0, 0], 9.5)));
        assert_eq!(ray(9.4), None);
    }

    #[test]
    fn a_ray_along_a_plane_stays_in_the_voxels_above_it() {
        let below = terrain(&[[5, 0, 0]]);
        let above = terrain(&[[5, 1, 0]]);
        let ray = |map| cast(map, [0.5, 1.0, 0.5], [1.0, 0.0, 0.0], 1e3);
        assert_eq!(ray(&below), None);
        assert_eq!(ray(&above), Some(([5, 1, 0], 4.5)));
    }

    #[test]
    fn a_ray_that_starts_on_a_plane_and_moves_down_crosses_it_at_once() {
        let map = terrain(&[[0, 0, 2]]);
        assert_eq!(cast(&map, [0.5, 0.5, 3.0], [0.0, 0.0, -1.0], 0.0), Some(([0, 0, 2], 0.0)));
    }

    #[test]
    fn a_ray_through_an_edge_does_not_slip_between_voxels() {
        // From column (0, 0) diagonally through the edge at (1, 1): x is crossed first, so (1, 0) is touched.
        let map = terrain(&[[1, 0, 0], [0, 1, 0], [3, 3, 0]]);
        let hit = cast(&map, [0.5, 0.5, 0.5], [1.0, 1.0, 0.0], 1e3).unwrap();
        assert_eq!(hit.0, [1, 0, 0]);
        assert!((hit.1 - 0.5f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn a_ray_that_leaves_the_map_or_never_meets_it_hits_nothing() {
        let map = terrain(&[[0, 0, 0], [9, 9, 9]]);
        assert_eq!(cast(&map, [5.5, 5.5, 5.5], [1.0, 0.0, 0.0], 1e3), None);
        assert_eq!(cast(&map, [5.5, 5.5, 50.0], [0.0, 0.0, 1.0], 1e3), None);
        assert_eq!(cast(&map, [-5.0, 5.5, 5.5], [1.0, 40.0, 0.0], 1e3), None);
    }

    #[test]
    fn the_length_of_the_direction_does_not_matter() {
        let map = terrain(&[[0, 0, 0]]);
        for length in [1e-300, 1e-160, 1.0, 1e160, 1e300] {
            let hit = cast(&map, [0.5, 0.5, 9.0], [0.0, 0.0, -length], 1e3);
            assert_eq!(hit, Some(([0, 0, 0], 8.0)), "length {length}");
        }
    }

    #[test]
    fn rays_that_pass_far_beside_the_map_end() {
        let map = terrain(&[[0, 0, 0], [9, 9, 9]]);
        for (origin, direction) in [
            ([0.5, -200.0, 0.5], [1.0, 1e-307, 0.0]), // would reach the map's side at an infinite distance
            ([0.5, -200.0, 0.5], [1.0, 1e-200, 0.0]),
            ([-1e308, 0.0, 0.0], [1.0, 1.0, 0.0]),
            ([0.5, 0.5, 1e20], [0.0, 0.0, -1.0]),
            ([0.5, 0.5, -1e300], [0.0, 0.0, 1.0]),
        ] {
            assert_eq!(cast(&map, origin, direction, f64::INFINITY), None, "from {origin:?}");
        }
    }

    /// Voxel by voxel, in exact arithmetic: all numbers are multiples of 1/8, so a crossing's distance is the
    /// fraction (plane - origin) / direction, compared by cross-multiplication.
    fn march(voxels: &[[i32; 3]], origin: [i64; 3], direction: [i64; 3], limit: i64) -> Option<[i32; 3]> {
        let mut voxel = origin.map(|o| o.div_euclid(8));
        loop {
            let here = voxel.map(|v| v as i32);
            if voxels.contains(&here) {
                return Some(here);
            }
            let fraction = |axis: usize| {
                let plane = 8 * if direction[axis] > 0 { voxel[axis] + 1 } else { voxel[axis] };
                ((plane - origin[axis]) * direction[axis].signum(), direction[axis].abs())
            };
            let next = (0..3).filter(|&axis| direction[axis] != 0).reduce(|a, b| {
                let ((na, da), (nb, db)) = (fraction(a), fraction(b));
                if nb * da < na * db { b } else { a }
            })?;
            voxel[next] += direction[next].signum();
            if voxel.iter().any(|v| v.abs() > limit) {
                return None;
            }
        }
    }

    /// From the smallest to the largest float64, either sign, and ordinary numbers.
    fn any_magnitude() -> impl Strategy<Value = f64> {
        let exponent = (-323.0..308.0f64, any::<bool>());
        prop_oneof![
            2 => exponent.prop_map(|(e, positive)| 10f64.powf(e) * if positive { 1.0 } else { -1.0 }),
            1 => -30.0..30.0f64,
            1 => Just(0.0),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Directions of powers of two keep every distance exact in floating point, so that even rays
        /// through edges and corners must agree with the exact march.
        #[test]
        fn agrees_with_an_exact_march_even_through_edges(
            voxels in prop::collection::vec(prop::array::uniform3(0i32..40), 1..60),
            origin in prop::array::uniform3(-200i64..520),
            direction in prop::array::uniform3(prop::sample::select(vec![-4i64, -2, -1, 0, 1, 2, 4])),
        ) {
            prop_assume!(direction != [0, 0, 0]);
            let map = terrain(&voxels);
            // Without normalisation the inverse direction is exact; `raycast` normalises, so go below it.
            let low = map.bounds().0;
            let ray = Ray {
                origin: std::array::from_fn(|k| origin[k] as f64 / 8.0 - low[k]),
                inverse: direction.map(|d| (d as f64).recip()),
                range: f64::INFINITY,
            };
            let hit = ray.first_hit(map.tree(), map.extent()).map(|(id, _)| map.index(id));
            prop_assert_eq!(hit, march(&voxels, origin, direction, 200));
        }

        /// Absurd numbers end in a hit or in none, not in a panic or an endless march.
        #[test]
        fn any_finite_ray_ends(
            origin in prop::array::uniform3(any_magnitude()),
            direction in prop::array::uniform3(any_magnitude()),
        ) {
            prop_assume!(direction != [0.0; 3]);
            let map = terrain(&[[0, 0, 0], [1, 1, 1], [20, 3, 7]]);
            let hit = cast(&map, origin, direction, f64::INFINITY);
            prop_assert!(hit.is_none_or(|(_, distance)| distance >= 0.0 && distance.is_finite()));
        }

        /// General directions against dense sampling of the ray.
        #[test]
        fn agrees_with_dense_sampling(
            voxels in prop::collection::vec(prop::array::uniform3(0i32..24), 1..200),
            origin in prop::array::uniform3(-10.0f64..40.0),
            direction in prop::array::uniform3(-1.0f64..1.0),
        ) {
            let unit = DVec3::from(direction).normalize();
            prop_assume!(unit.is_finite());
            let map = terrain(&voxels);
            let hit = cast(&map, origin, direction, 100.0);
            // Every sample before the hit is free; a sample just behind the entry is in the hit voxel
            // unless the ray only clips its corner.
            let sample = |t: f64| {
                let p = (DVec3::from(origin) + unit * t).floor();
                [p.x as i32, p.y as i32, p.z as i32]
            };
            let free_until = hit.map_or(100.0, |h| h.1) - 1e-9;
            let mut t = 0.0;
            while t < free_until {
                prop_assert!(!voxels.contains(&sample(t)), "occupied at {t}, hit {hit:?}");
                t += 0.01;
            }
            if let Some((index, distance)) = hit {
                let entry = DVec3::from(origin) + unit * distance;
                let low = DVec3::from(index.map(f64::from));
                prop_assert!((entry - entry.clamp(low, low + 1.0)).length() < 1e-9);
            }
        }
    }
}
