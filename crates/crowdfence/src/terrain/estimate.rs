//! Where the surface lies in voxels of which nothing else is known, as in an OctoMap: a plane through the tops of the
//! columns around.
//!
//! The tops of a sheet are its heights rounded down, so a plane fitted to 5 x 5 of them is the sheet to a fraction of
//! a voxel, except where it is so level that all of them are the same: then the middle of the voxel is the guess
//! with the smallest worst error, half a voxel. A voxel without neighbours gets it too; its upper face could be a
//! whole voxel off, and a surface that is too high draws a crowd towards the camera.
//!
//! Height at the columns' centres, in voxels, of voxels made from height maps and from triangles:
//!
//! | sheet | RMS error | worst |
//! |---|---|---|
//! | level, rising by whole numbers, or nearly so | 0.27 | 0.5 |
//! | rising 0.1 (with [`super::terraces`]) | 0.07 | 0.28 |
//! | rising 0.3 along x, 0.1 along y | 0.04 | 0.07 |
//! | rising 1.3 along x, falling 0.8 along y | 0.03 | 0.03 |
//! | hills of 4 voxels, dents of 0.6 voxels 6 columns apart | 0.15 | 0.65 |

mod rows;

use rayon::prelude::*;

use super::plane_fit::PlaneFit;
use super::point_means::PointMeans;
use super::surroundings::{Surroundings, Top};
use super::{Plane, Terrain};
use rows::Rows;

/// Columns to either side that a plane is fitted to.
const REACH: i32 = 2;
/// How far a top beside another one, and one two columns away from where those two lead, may lie to be of its sheet.
const NEAR_SLACK: f64 = 3.0;
const FAR_SLACK: f64 = 1.0;

/// Planes by voxel id, from bare voxels or from the points in them. A voxel with another one on top keeps its ceiling.
pub(super) fn planes(terrain: &Terrain, points: Option<&PointMeans>) -> Vec<Plane> {
    let tree = terrain.tree();
    let mut planes = vec![Plane::CEILING; tree.voxel_count()];
    let mut rest = planes.as_mut_slice();
    let mut tasks = Vec::new();
    for block in tree.blocks() {
        let (own, others) = rest.split_at_mut(block.ids.len());
        tasks.push((block, own));
        rest = others;
    }
    let new = || (Box::new(Surroundings::new()), Box::new(Rows::new()));
    tasks.into_par_iter().with_min_len(8).for_each_init(new, |(around, rows), (block, planes)| {
        around.gather(tree, &block);
        if points.is_none() {
            rows.fit(around);
        }
        for column in Surroundings::columns() {
            for top in around.tops(column) {
                planes[(around.id(top) - block.ids.start) as usize] = match points {
                    None => rows.plane(column).unwrap_or_else(|| plane(around, top)),
                    Some(points) => plane_of_points(around, top, points),
                };
            }
        }
    });
    planes
}

/// How far from where its rough slope leads a solid's top may lie to be of the same sheet.
#[inline(always)]
fn slack(x: i32, y: i32) -> f64 {
    (1.0 + 0.25 * f64::from(x.abs() + y.abs())).min(1.75)
}

/// The solids around that end in the same sheet: columns along x and y from this one, rise, and their tops.
fn sheet(around: &Surroundings, top: Top) -> impl Iterator<Item = ([f64; 3], Top)> {
    let rough = Surroundings::STEP.map(|step| rough_slope(around, top, step));
    let places = (-REACH..=REACH).flat_map(|x| (-REACH..=REACH).map(move |y| (x, y)));
    places.filter_map(move |(x, y)| {
        let expected = rough[0] * f64::from(x) + rough[1] * f64::from(y);
        let [step_x, step_y] = Surroundings::STEP;
        let column = top.column + x * step_x + y * step_y;
        let (other, rise) = around.nearest(column, top, expected, slack(x, y))?;
        Some(([x.into(), y.into(), rise], other))
    })
}

fn plane(around: &Surroundings, top: Top) -> Plane {
    let (mut fit, mut thickness) = (PlaneFit::default(), 0.0);
    for (place, other) in sheet(around, top) {
        fit.add(place, 1.0);
        thickness += f64::from(around.thickness(other));
    }
    fitted(&fit, thickness)
}

/// `thickness` of all solids together.
#[inline(always)]
fn fitted(fit: &PlaneFit, thickness: f64) -> Plane {
    let (height, slope) = fit.plane();
    Plane::new((height + 0.5).clamp(0.0, 1.0) - overhang(slope, thickness / fit.weight), slope)
}

/// The nearer a point, the more it counts; with less than one in a voxel it takes the neighbours to tell a slope.
fn plane_of_points(around: &Surroundings, top: Top, points: &PointMeans) -> Plane {
    let mut fit = PlaneFit::default();
    for ([x, y, rise], other) in sheet(around, top) {
        let [from_x, from_y, above] = points.of_voxel(around.id(other));
        fit.add([x + from_x, y + from_y, rise + above], 1.0 / (1.0 + x * x + y * y));
    }
    let (height, slope) = fit.plane();
    // The sheet passes through the voxel somewhere in its column.
    let half_rise = (slope[0].abs() + slope[1].abs()) / 2.0;
    Plane::new(height.clamp(-half_rise, 1.0 + half_rise), slope)
}

/// Slope of the sheet along one axis, `step` columns apart, from the side that continues it best: at the foot
/// and at the edge of a wall, that is the side away from the wall.
fn rough_slope(around: &Surroundings, top: Top, step: i32) -> f64 {
    let side = |step: i32| {
        let (_, near) = around.nearest(top.column + step, top, 0.0, NEAR_SLACK)?;
        let far = around.nearest(top.column + 2 * step, top, 2.0 * near, FAR_SLACK).map(|(_, rise)| rise);
        Some((near, far))
    };
    match (side(-step), side(step)) {
        (Some((before, far_before)), Some((after, far_after))) if (before + after).abs() <= 1.0 => {
            match (far_before, far_after) {
                (Some(far_before), Some(far_after)) => {
                    (2.0 * (far_after - far_before) + after - before) / 10.0
                }
                _ => (after - before) / 2.0,
            }
        }
        (before, after) => {
            let far = |side: Option<(f64, Option<f64>)>| side.and_then(|(_, far)| far);
            match (far(before).map(|far| -far / 2.0), far(after).map(|far| far / 2.0)) {
                (Some(a), Some(b)) if a * b <= 0.0 => 0.0,
                (Some(a), Some(b)) => a.abs().min(b.abs()).copysign(a),
                (Some(slope), None) | (None, Some(slope)) => slope,
                (None, None) => 0.0,
            }
        }
    }
}

/// How far the tops lie above those of the columns' centres. A column of a height map ends at its centre's height and
/// reaches down to its lowest neighbour; one that holds all that touches it ends at its highest corner and reaches
/// down to its lowest. The mean thickness of the solids tells which.
fn overhang(slope: [f64; 2], thickness: f64) -> f64 {
    let [x, y] = slope.map(f64::abs);
    let (of_centres, of_corners) = (x.max(y).max(1.0), 1.0 + x + y);
    if of_corners - of_centres < 1e-3 {
        return 0.0;
    }
    (x + y) / 2.0 * ((thickness - of_centres) / (of_corners - of_centres)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use proptest::prelude::*;

    use super::super::height_map::HeightMap;
    use super::*;

    const CELLS: i32 = 64;

    fn by_heights(height: impl Fn(f64, f64) -> f64) -> Terrain {
        let cells = (0..CELLS * CELLS).map(|n| (n / CELLS, n % CELLS));
        let heights: Vec<f32> =
            cells.map(|(i, j)| height(f64::from(i) + 0.5, f64::from(j) + 0.5) as f32).collect();
        let map = HeightMap::new(&heights, [CELLS as usize; 2], 1.0).unwrap();
        Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap()
    }

    fn by_triangles(height: impl Fn(f64, f64) -> f64) -> Terrain {
        let place = |n: i32| [n / (CELLS + 1), n % (CELLS + 1)].map(f64::from);
        let vertices: Vec<DVec3> = (0..(CELLS + 1) * (CELLS + 1))
            .map(|n| DVec3::new(place(n)[0], place(n)[1], height(place(n)[0], place(n)[1])))
            .collect();
        let corner = |i: i32, j: i32| (i * (CELLS + 1) + j) as u32;
        let triangles: Vec<[u32; 3]> = (0..CELLS * CELLS)
            .map(|n| (n / CELLS, n % CELLS))
            .flat_map(|(i, j)| {
                let [a, b, c, d] = [corner(i, j), corner(i + 1, j), corner(i + 1, j + 1), corner(i, j + 1)];
                [[a, b, c], [a, c, d]]
            })
            .collect();
        Terrain::from_triangles(&vertices, &triangles, 1.0, DVec3::ZERO).unwrap()
    }

    /// Bare voxels of a terrain, estimated.
    fn estimated(terrain: &Terrain) -> Terrain {
        let ids: Vec<u32> = (0..terrain.voxel_count() as u32).collect();
        Terrain::from_indices(&terrain.indices_of(&ids), 1.0, DVec3::ZERO).unwrap()
    }

    /// RMS and worst error of the height at the columns' centres and of the slopes, away from the border.
    fn errors(terrain: &Terrain, height: impl Fn(f64, f64) -> f64) -> [f64; 4] {
        let terrain = estimated(terrain);
        let (mut squares, mut worst, mut count) = ([0.0; 2], [0.0_f64; 2], 0.0);
        for (i, j) in (3..CELLS - 3).flat_map(|i| (3..CELLS - 3).map(move |j| (i, j))) {
            let (k, id) = terrain.column(i, j).last().unwrap();
            let plane = terrain.plane(id);
            let [x, y] = [i, j].map(|n| f64::from(n) + 0.5);
            let off = f64::from(k) + plane.height() - height(x, y);
            let slope = [height(x + 0.5, y) - height(x - 0.5, y), height(x, y + 0.5) - height(x, y - 0.5)];
            let tilt = (plane.slope()[0] - slope[0]).hypot(plane.slope()[1] - slope[1]);
            for (at, error) in [off, tilt].into_iter().enumerate() {
                squares[at] += error * error;
                worst[at] = worst[at].max(error.abs());
            }
            count += 1.0;
        }
        [(squares[0] / count).sqrt(), worst[0], (squares[1] / count).sqrt(), worst[1]]
    }

    fn rough(x: f64, y: f64) -> f64 {
        20.0 + 4.0 * (x / 9.0).sin() * (y / 7.0).cos() + 0.6 * (x / 2.3 + 1.0).sin() * (y / 1.9).sin()
    }

    #[test]
    fn errors_are_the_stated_ones() {
        // Rise along x and y; RMS and worst error of height, RMS of slope, from either kind of voxels.
        for (slope, stated) in [
            ([0.0, 0.0], [0.14, 0.14, 0.00]),
            ([0.02, 0.01], [0.27, 0.46, 0.08]),
            ([0.1, 0.0], [0.08, 0.29, 0.06]),
            ([0.3, 0.1], [0.05, 0.08, 0.05]),
            ([0.71, -0.3], [0.04, 0.09, 0.04]),
            ([1.3, -0.8], [0.03, 0.03, 0.03]),
            ([1.97, 0.0], [0.27, 0.44, 0.09]),
        ] {
            let height = |x: f64, y: f64| 40.37 + slope[0] * x + slope[1] * y;
            for terrain in [by_heights(height), by_triangles(height)] {
                let found = errors(&terrain, height);
                assert!(
                    found.iter().zip(stated).all(|(&found, stated)| found <= stated),
                    "{slope:?}: {found:?}"
                );
            }
        }
        for terrain in [by_heights(rough), by_triangles(rough)] {
            let found = errors(&terrain, rough);
            assert!(
                found.iter().zip([0.16, 0.65, 0.11]).all(|(&found, stated)| found <= stated),
                "{found:?}"
            );
        }
    }

    fn plane_at(terrain: &Terrain, voxel: [i32; 3]) -> Plane {
        terrain.plane(terrain.id(voxel).unwrap())
    }

    fn middle() -> Plane {
        Plane::new(0.5, [0.0; 2])
    }

    #[test]
    fn walls_stay_walls() {
        // A house of 6 x 6 columns, 9 voxels high, on level ground.
        let house = |n: i32| (5..11).contains(&n);
        let heights = |x: f64, y: f64| if house(x as i32) && house(y as i32) { 9.5 } else { 0.5 };
        let terrain = estimated(&by_heights(heights));
        for (i, j) in (0..CELLS).flat_map(|i| (0..CELLS).map(move |j| (i, j))) {
            let k = if house(i) && house(j) { 9 } else { 0 };
            assert_eq!(plane_at(&terrain, [i, j, k]), middle(), "({i}, {j})");
        }
    }

    #[test]
    fn what_stands_alone_lies_in_the_middle_of_its_voxel() {
        let voxels = [[0, 0, 0], [40, 0, 0], [40, 0, 1], [40, 0, 2]];
        let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
        assert_eq!(plane_at(&terrain, [0, 0, 0]), middle());
        assert_eq!(plane_at(&terrain, [40, 0, 2]), middle());
        assert_eq!(plane_at(&terrain, [40, 0, 1]), Plane::CEILING);
    }

    #[test]
    fn a_street_that_climbs_along_a_house_stays_a_street() {
        // Rises by 1 in 4 along y, facade at x = 30: the columns before it neither tilt towards it nor flatten.
        let height = |x: f64, y: f64| if x > 30.0 { 60.5 } else { 1.5 + y / 4.0 };
        let terrain = estimated(&by_heights(height));
        for j in 4..CELLS - 4 {
            let plane = plane_at(&terrain, [29, j, height(0.0, f64::from(j) + 0.5) as i32]);
            assert_eq!(plane.slope()[0], 0.0);
            assert!((plane.slope()[1] - 0.25).abs() < 0.08, "{plane:?}");
        }
    }

    #[test]
    fn sheets_above_each_other_keep_apart() {
        // Level ground below a roof that rises 1 in 1 from 4 voxels above it.
        let slab = (0..256).map(|n| [n / 16, n % 16]);
        let voxels: Vec<[i32; 3]> = slab.flat_map(|[i, j]| [[i, j, 0], [i, j, 4 + i]]).collect();
        let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
        for (i, j) in (0..16).flat_map(|i| (0..16).map(move |j| (i, j))) {
            assert_eq!(plane_at(&terrain, [i, j, 0]), middle());
            assert_eq!(plane_at(&terrain, [i, j, 4 + i]), Plane::new(0.5, [1.0, 0.0]), "({i}, {j})");
        }
    }

    #[test]
    fn a_ridge_is_level_and_its_sides_reach_it() {
        // Columns 28 to 32 of a roof whose ridge runs through the middle of column 30, 40 voxels up.
        let terrain = estimated(&by_heights(|x, _| 40.5 - (x - 30.5).abs()));
        let slopes = (28..=32).map(|i| plane_at(&terrain, [i, 20, 40 - (i - 30).abs()]).slope());
        assert_eq!(slopes.collect::<Vec<_>>(), [1.0, 1.0, 0.0, -1.0, -1.0].map(|x| [x, 0.0]));
    }

    proptest! {
        #[test]
        fn planes_come_out_straight(x in -1.2..1.2, y in -1.2..1.2, at in 60.0..61.0, corners in any::<bool>()) {
            let height = |u: f64, v: f64| at + x * (u - 32.0) + y * (v - 32.0);
            let found = errors(&if corners { by_triangles(height) } else { by_heights(height) }, height);
            prop_assert!(found[1] < 0.55 && found[3] < 0.4, "{:?}", found);
        }

        #[test]
        fn any_voxels_give_planes(
            voxels in prop::collection::vec(prop::array::uniform3(-40i32..40), 1..200),
            far in prop::array::uniform3(-500_000i32..500_000),
        ) {
            let voxels: Vec<_> = voxels.into_iter().chain([far]).collect();
            let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
            for &plane in terrain.planes() {
                let [x, y] = plane.slope().map(f64::abs);
                prop_assert!(plane.height() <= 1.0 && plane.height() >= -(x + y) / 2.0 - 1e-3, "{plane:?}");
            }
        }
    }
}
