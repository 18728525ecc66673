//! Ray -> the first solid on it. The ray is followed over the grid from above: through squares of the tree, passing
//! those that it flies over, down to single columns, in which every solid is tested. Every line of the grid is
//! crossed at a distance worked out from its integer coordinate, so squares of all sizes meet without a gap.

use glam::DVec3;

use crate::terrain::tree::{Square, Stacks};
use crate::terrain::{Solid, Surface, Terrain};

/// Voxel id and distance in voxels of the first solid met at no more than `range`; `direction` has length 1.
pub(super) fn first_hit(
    terrain: &Terrain,
    surface: Surface,
    origin: DVec3,
    direction: DVec3,
    range: f64,
) -> Option<(u32, f64)> {
    let stacks = Stacks::new(terrain.tree());
    let root = stacks.root();
    let mut search = Search { terrain, surface, origin, direction, stacks };
    search.within(&root, 0.0, range)
}

struct Search<'a> {
    terrain: &'a Terrain,
    surface: Surface,
    /// Tree coordinates.
    origin: DVec3,
    direction: DVec3,
    stacks: Stacks<'a>,
}

impl Search<'_> {
    /// First hit in a square, of the part of the ray from `enter` to `leave`, where it may also be outside.
    fn within(&mut self, square: &Square, enter: f64, leave: f64) -> Option<(u32, f64)> {
        let (enter, leave) = self.clipped(square, enter, leave)?;
        if square.is_column() {
            return self.in_column(square, enter, leave);
        }
        let side = f64::from(square.side() / Stacks::SIDE);
        let low = square.low.map(f64::from);
        let mut cell: [i32; 2] = std::array::from_fn(|axis| {
            let at = self.origin[axis] + self.direction[axis] * enter;
            (((at - low[axis]) / side).floor() as i32).clamp(0, Stacks::SIDE as i32 - 1)
        });
        let mut from = enter;
        loop {
            let exits: [f64; 2] = std::array::from_fn(|axis| self.exit(axis, low[axis], cell[axis], side));
            let axis = usize::from(exits[1] < exits[0]);
            let to = exits[axis].max(from);
            if let Some(child) = self.stacks.child(square, cell[0] as u32, cell[1] as u32) {
                let hit = self.within(&child, from, to.min(leave));
                self.stacks.release(&child);
                if hit.is_some() {
                    return hit;
                }
            }
            cell[axis] += self.direction[axis].signum() as i32;
            if to >= leave || !(0..Stacks::SIDE as i32).contains(&cell[axis]) {
                return None;
            }
            from = to;
        }
    }

    /// Distance at which the ray leaves a cell along an axis.
    fn exit(&self, axis: usize, low: f64, cell: i32, side: f64) -> f64 {
        let direction = self.direction[axis];
        if direction == 0.0 {
            return f64::INFINITY;
        }
        let line = low + side * f64::from(if direction > 0.0 { cell + 1 } else { cell });
        (line - self.origin[axis]) / direction
    }

    /// The part from `enter` to `leave` that may meet what stands on a square.
    fn clipped(&self, square: &Square, mut enter: f64, mut leave: f64) -> Option<(f64, f64)> {
        let (lowest, highest) = self.stacks.span(square);
        let [x, y] = square.low.map(f64::from);
        let side = f64::from(square.side());
        let sides = [
            (x, x + side),
            (y, y + side),
            (f64::from(lowest) - f64::from(Solid::SINK), f64::from(highest + Solid::RISE)),
        ];
        for (axis, (low, high)) in sides.into_iter().enumerate() {
            let (origin, direction) = (self.origin[axis], self.direction[axis]);
            if direction == 0.0 {
                // On a line of the grid, a ray along it belongs to the upper side.
                if !(low <= origin && origin < high) {
                    return None;
                }
                continue;
            }
            let (to_low, to_high) = ((low - origin) / direction, (high - origin) / direction);
            enter = enter.max(to_low.min(to_high));
            leave = leave.min(to_low.max(to_high));
        }
        (enter <= leave && enter.is_finite()).then_some((enter, leave))
    }

    fn in_column(&self, column: &Square, enter: f64, leave: f64) -> Option<(u32, f64)> {
        let center = DVec3::new(f64::from(column.low[0]) + 0.5, f64::from(column.low[1]) + 0.5, 0.0);
        let layers = self.stacks.layers(column);
        Solid::of_column(layers, self.terrain.planes(), self.surface)
            .filter_map(|(solid, run)| {
                let distance = self.meets(&solid, center, enter, leave)?;
                let height = self.origin.z + self.direction.z * distance;
                let voxel = run[(solid.voxel_at(height) - solid.lowest) as usize];
                Some((voxel.voxel_id(), distance))
            })
            .min_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Distance at which the ray is first inside a solid, in the part of it over the solid's column.
    fn meets(&self, solid: &Solid, center: DVec3, mut enter: f64, mut leave: f64) -> Option<f64> {
        let top = center.with_z(solid.top());
        let bottom = center.with_z(solid.bottom);
        for (normal, point) in [(solid.plane.normal(), top), (DVec3::NEG_Z, bottom)] {
            let (above, climb) = (normal.dot(self.origin - point), normal.dot(self.direction));
            if climb == 0.0 {
                if above > 0.0 {
                    return None;
                }
                continue;
            }
            let crossing = -above / climb;
            if climb < 0.0 {
                enter = enter.max(crossing);
            } else {
                leave = leave.min(crossing);
            }
        }
        (enter <= leave).then_some(enter)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::terrain::Plane;
    use crate::terrain::height_map::HeightMap;
    use proptest::prelude::*;

    fn ray(terrain: &Terrain, origin: DVec3, direction: DVec3) -> Option<(u32, f64)> {
        let origin = terrain.tree_from_world(origin);
        first_hit(terrain, Surface::Planes, origin, direction.normalize(), f64::INFINITY)
    }

    fn field(heights: &[f32], shape: [usize; 2]) -> Terrain {
        let map = HeightMap::new(heights, shape, 1.0).unwrap();
        Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap()
    }

    #[test]
    fn a_level_plain_is_hit_at_its_height() {
        let terrain = field(&[0.0; 400], [20, 20]);
        for tilt in [5.0f64, 20.0, 45.0, 90.0] {
            let direction = DVec3::new(tilt.to_radians().cos(), 0.0, -tilt.to_radians().sin());
            let (_, distance) = ray(&terrain, DVec3::new(0.5, 10.3, 1.0), direction).unwrap();
            assert!((distance * direction.z + 1.0).abs() < 1e-12, "{tilt} degrees: {distance}");
        }
    }

    #[test]
    fn the_wall_of_a_step_is_hit_at_its_voxel() {
        // Two halves, at 0.5 and at 4.5.
        let heights: Vec<f32> = (0..100).map(|cell| if cell < 50 { 0.5 } else { 4.5 }).collect();
        let terrain = field(&heights, [10, 10]);
        for (height, level) in [(4.2, 4), (3.2, 3), (1.7, 1), (0.6, 1)] {
            let (id, distance) = ray(&terrain, DVec3::new(0.0, 5.5, height), DVec3::X).unwrap();
            assert_eq!((terrain.index(id), distance), ([5, 5, level], 5.0), "at {height}");
        }
        assert_eq!(ray(&terrain, DVec3::new(0.0, 5.5, 4.6), DVec3::X), None);
    }

    /// Steps of whole voxels, seen from everywhere: a hit of a terrace is none of the wall below it.
    #[test]
    fn a_top_on_the_floor_of_its_voxel_is_hit_as_a_top() {
        let heights: Vec<f32> = (0..400).map(|cell| (cell / 20 / 4 * 3) as f32).collect();
        let terrain = field(&heights, [20, 20]);
        for number in 0..400 {
            let turn = 0.37 * f64::from(number);
            let target = DVec3::new(9.0 + 2.0 * turn.sin(), 10.3 + 3.0 * turn.cos(), 6.0);
            let origin = target + 15.0 * DVec3::new((2.0 * turn).cos(), (3.0 * turn).sin(), 1.3);
            let (id, distance) = ray(&terrain, origin, target - origin).unwrap();
            let hit = origin + (target - origin).normalize() * distance;
            if (hit.z - 6.0).abs() < 1e-9 {
                assert_eq!(terrain.index(id)[2], 6, "{hit}");
            }
        }
    }

    #[test]
    fn a_ray_passes_under_what_overhangs() {
        // Ground at z = 0 to 1 and a roof of one voxel at 5.
        let mut voxels: Vec<[i32; 3]> = (0..100).map(|cell| [cell / 10, cell % 10, 0]).collect();
        voxels.extend((30..60).map(|cell| [cell / 10, cell % 10, 5]));
        let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
        let (id, _) = ray(&terrain, DVec3::new(-5.0, 5.5, 4.0), DVec3::new(10.0, 0.0, -3.2)).unwrap();
        assert_eq!(terrain.index(id)[2], 0);
        let (id, distance) = ray(&terrain, DVec3::new(4.5, 5.5, 3.0), DVec3::Z).unwrap();
        assert_eq!((terrain.index(id), distance), ([4, 5, 5], 2.0), "its underside");
    }

    /// Whether a point lies inside a solid of its column, from the definition.
    fn is_inside(terrain: &Terrain, point: DVec3, margin: f64) -> bool {
        let [i, j] = [point.x.floor(), point.y.floor()];
        let column: Vec<(i32, u32)> = terrain.column(i as i32, j as i32).collect();
        let runs: Vec<&[(i32, u32)]> = column.chunk_by(|a, b| a.0 + 1 == b.0).collect();
        runs.iter().enumerate().any(|(order, run)| {
            let ((lowest, _), (uppermost, id)) = (run[0], run[run.len() - 1]);
            let plane: Plane = terrain.plane(id);
            let [x, y] = plane.slope();
            let top =
                f64::from(uppermost) + plane.height() + x * (point.x - i - 0.5) + y * (point.y - j - 0.5);
            let skirt = if order == 0 { 2.0 } else { 0.0 };
            let bottom = (f64::from(lowest) - skirt).min(f64::from(uppermost) + plane.lowest_corner());
            point.z <= top + margin && point.z >= bottom - margin
        })
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(500))]

        /// Voxels without planes are solids too: both casters meet the same.
        #[test]
        fn agrees_with_the_caster_of_cubes(
            voxels in prop::collection::vec(prop::array::uniform3(0i32..24), 1..200),
            origin in prop::array::uniform3(-10.0f64..40.0),
            target in prop::array::uniform3(0.0f64..24.0),
        ) {
            let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
            let (origin, target) = (DVec3::from(origin), DVec3::from(target));
            prop_assume!((target - origin).length() > 1e-3);
            let direction = (target - origin).normalize();
            let cubes = terrain.raycast(Surface::Voxels, origin, direction, 100.0);
            let from = terrain.tree_from_world(origin);
            let solids = first_hit(&terrain, Surface::Voxels, from, direction, 100.0);
            prop_assert_eq!(cubes.map(|hit| hit.voxel_id), solids.map(|hit| hit.0));
            if let (Some(cubes), Some(solids)) = (cubes, solids) {
                prop_assert!((cubes.distance_m - solids.1).abs() < 1e-9);
            }
        }

        /// General planes, walls and overhangs against dense sampling of the ray.
        #[test]
        fn agrees_with_dense_sampling(
            voxels in prop::collection::vec(prop::array::uniform3(0i32..16), 1..150),
            planes in prop::collection::vec((-1.0..2.0f64, -2.0..2.0f64, -2.0..2.0f64), 8),
            origin in prop::array::uniform3(-10.0f64..30.0),
            target in prop::array::uniform3(0.0f64..16.0),
        ) {
            let plane = |[i, j, k]: [i32; 3]| {
                let (height, x, y) = planes[(7 * i + 3 * j + 5 * k) as usize % 8];
                Plane::new(height, [x, y])
            };
            let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap().with_planes(plane);
            let (origin, target) = (DVec3::from(origin), DVec3::from(target));
            prop_assume!((target - origin).length() > 1e-3);
            let direction = (target - origin).normalize();
            let hit = ray(&terrain, origin, direction);
            let free_until = hit.map_or(80.0, |hit| hit.1) - 1e-6;
            let mut distance = 0.0;
            while distance < free_until {
                let point = origin + direction * distance;
                prop_assert!(!is_inside(&terrain, point, -1e-6), "inside at {distance}, hit {hit:?}");
                distance += 0.01;
            }
            if let Some((id, distance)) = hit {
                let point = origin + direction * (distance + 1e-7);
                let [i, j, _] = terrain.index(id);
                let in_column = DVec3::new(f64::from(i) + 0.5, f64::from(j) + 0.5, point.z);
                let inside_column = point + (in_column - point) * 1e-5;
                prop_assert!(is_inside(&terrain, inside_column, 1e-3), "at {point}, hit {hit:?}");
            }
        }

        /// A plane of a height map is met where it is, at any tilt, whatever the quantisation.
        #[test]
        fn a_plane_is_hit_to_a_hundredth_of_a_voxel(
            height in -50.0..50.0f64,
            slope in prop::array::uniform2(-1.9..1.9f64),
            place in prop::array::uniform2(8.0..22.0f64),
            from in prop::array::uniform3(-1.0..1.0f64),
        ) {
            let at = |x: f64, y: f64| height + slope[0] * x + slope[1] * y;
            let heights: Vec<f32> =
                (0..900).map(|cell| at((cell / 30) as f64 + 0.5, (cell % 30) as f64 + 0.5) as f32).collect();
            let terrain = field(&heights, [30, 30]);
            let target = DVec3::new(place[0], place[1], at(place[0], place[1]));
            let normal = DVec3::new(-slope[0], -slope[1], 1.0).normalize();
            // From the front side of the plane, and no closer to it than 5 degrees.
            let mut offset = DVec3::from(from);
            offset += normal * (0.1 - offset.dot(normal)).max(0.0);
            prop_assume!(offset.length() < 2.0 && offset.dot(normal) > 0.09 * offset.length());
            let origin = target + offset * 4.0;
            let (_, distance) = ray(&terrain, origin, -offset).expect("a closed surface");
            let met = origin - offset.normalize() * distance;
            let error = met.z - at(met.x, met.y);
            prop_assert!(error.abs() < 0.02, "{error} voxels above the plane");
        }

        /// No ray from above slips through a rough height map.
        #[test]
        fn a_rough_surface_is_closed(
            heights in prop::collection::vec(-6.0..6.0f32, 144),
            origin in prop::array::uniform2(1.0..11.0f64),
            target in prop::array::uniform2(1.0..11.0f64),
        ) {
            let terrain = field(&heights, [12, 12]);
            let origin = DVec3::new(origin[0], origin[1], 9.0);
            let target = DVec3::new(target[0], target[1], -9.0);
            prop_assert!(ray(&terrain, origin, target - origin).is_some());
        }

        /// Absurd numbers end in a hit or in none, not in a panic or an endless march.
        #[test]
        fn any_finite_ray_ends(
            origin in prop::array::uniform3(-1e300..1e300f64),
            exponent in prop::array::uniform3(-320.0..300.0f64),
            near in any::<bool>(),
        ) {
            let terrain = field(&[0.5; 100], [10, 10]);
            let direction = DVec3::from(exponent.map(|e| -(10f64.powf(e))));
            prop_assume!(direction != DVec3::ZERO);
            let origin = DVec3::from(origin) * if near { 1e-299 } else { 1.0 };
            let hit = terrain.raycast(Surface::Planes, origin, direction, f64::INFINITY);
            prop_assert!(hit.is_none_or(|hit| hit.distance_m >= 0.0 && hit.distance_m.is_finite()));
        }
    }
}
