//! Where the crowd in a picture went, by hand and for all.

use glam::{DMat3, DQuat};
use proptest::prelude::*;

use super::*;
use crate::observation::CrowdMass;

fn mass_of(view: &View, map: &Terrain, projection: &Projection) -> CrowdMass {
    let by_rays = project(view, map, projection).crowd_mass();
    let full =
        Projection::new(projection.max_range_m(), projection.target_height_m(), Coverage::Full).unwrap();
    let full = full.with_surface(projection.surface());
    assert_eq!(project(view, map, &full).crowd_mass(), by_rays, "coverage is no matter of pixels");
    by_rays
}

/// Looks north, 45 degrees down.
fn diagonal() -> [[f64; 3]; 3] {
    let half = std::f64::consts::FRAC_1_SQRT_2;
    [[1.0, 0.0, 0.0], [0.0, -half, -half], [0.0, half, -half]]
}

/// A ray of heatmap value 1 through one pixel.
fn single(axes: [[f64; 3]; 3], at: [f64; 3], map: &Terrain) -> CrowdMass {
    mass_of(&view(axes, at, [1, 1], 100.0, uniform(1.0)), map, &rays(100.0))
}

const NONE: CrowdMass =
    CrowdMass { ground: 0.0, out_of_range: 0.0, hole: 0.0, off_map: 0.0, sky: 0.0, unusable: 0.0 };

#[test]
fn half_of_a_view_over_the_edge_is_off_the_map() {
    // 10 m above the floor, f = 20 px: a pixel is half a metre, the image covers x 9 to 11; the floor ends at 10.
    let view = view(DOWN, [10.0, 5.0, 11.0], [4, 4], 20.0, uniform(0.75));
    let mass = mass_of(&view, &terrain(&floor(10)), &rays(100.0));
    assert_eq!(mass, CrowdMass { ground: 8.0 * 0.75, off_map: 8.0 * 0.75, ..NONE });
}

#[test]
fn rays_through_a_missing_voxel_are_in_a_hole() {
    // Pixel centres at 4.75, 5.25, 5.75 and 6.25 m along both axes; the voxel from 5 to 6 is missing.
    let map = terrain(&floor(10).into_iter().filter(|voxel| *voxel != [5, 5, 0]).collect::<Vec<_>>());
    let view = view(DOWN, [5.5, 5.5, 11.0], [4, 4], 20.0, uniform(1.0));
    assert_eq!(mass_of(&view, &map, &rays(100.0)), CrowdMass { ground: 12.0, hole: 4.0, ..NONE });
}

#[test]
fn ground_beyond_the_range_is_out_of_range() {
    // The pixels meet the floor 10.006 m (4 of them), 10.031 m (8) and 10.056 m (4) away.
    let view = view(DOWN, [5.0, 5.0, 11.0], [4, 4], 20.0, uniform(1.0));
    let mass = |range| mass_of(&view, &terrain(&floor(10)), &rays(range));
    assert_eq!(mass(10.02), CrowdMass { ground: 4.0, out_of_range: 12.0, ..NONE });
    assert_eq!(mass(10.04), CrowdMass { ground: 12.0, out_of_range: 4.0, ..NONE });
    assert_eq!(mass(10.06), CrowdMass { ground: 16.0, ..NONE });
}

#[test]
fn above_the_horizon_is_sky_and_far_below_it_the_end_of_the_map() {
    // Level, rows of 2 pixels at slopes 3/8 and 1/8 up, 1/8 and 3/8 down: from 10 m above the floor the last two
    // come down 80 m and 26.7 m ahead; the floor lies 5 m to 35 m ahead.
    let view = view(NORTH, [15.0, -5.0, 11.0], [2, 4], 4.0, uniform(0.75));
    let mass = mass_of(&view, &terrain(&floor(30)), &rays(100.0));
    assert_eq!(mass, CrowdMass { sky: 4.0 * 0.75, off_map: 2.0 * 0.75, ground: 2.0 * 0.75, ..NONE });
    // A wall beyond the range behind the sky is ground out of range.
    let mut walled = floor(30);
    walled.extend((0..30).flat_map(|x| (1..60).map(move |z| [x, 29, z])));
    let mass = mass_of(&view, &terrain(&walled), &rays(30.0));
    assert_eq!(mass, CrowdMass { out_of_range: 6.0 * 0.75, ground: 2.0 * 0.75, ..NONE });
}

#[test]
fn pixels_that_the_lens_model_gives_no_ray_are_unusable() {
    // r - r^3 / 3 grows up to r = 1, so the image ends at 2/3; the 4 corner pixels lie at sqrt(4.5) / 2.6 = 0.82,
    // their neighbours at 0.61.
    let distortion = Distortion::brown_conrady(&[-1.0 / 3.0, 0.0, 0.0, 0.0]).unwrap();
    let camera = Camera::new(4, 4, 2.6, 2.6, 2.0, 2.0, distortion).unwrap();
    assert_eq!(camera.blind_pixel_count(), 4);
    let view = View { camera: Arc::new(camera), ..view(DOWN, [10.0, 10.0, 11.0], [4, 4], 2.6, uniform(1.0)) };
    let mass = mass_of(&view, &terrain(&floor(20)), &rays(100.0));
    assert_eq!(mass, CrowdMass { ground: 12.0, unusable: 4.0, ..NONE });
}

#[test]
fn nothing_of_a_camera_under_ground_is_usable() {
    let map = terrain(&floor(10));
    let view = view(DOWN, [5.5, 5.5, 1.5], [4, 4], 4.0, uniform(1.0));
    let pushed_through = Projection::new(100.0, 0.9, Coverage::Rays).unwrap().with_surface(Surface::Voxels);
    assert_eq!(mass_of(&view, &map, &pushed_through), CrowdMass { unusable: 16.0, ..NONE });
    assert_eq!(mass_of(&view, &map, &rays(100.0)), CrowdMass { ground: 16.0, ..NONE });
}

#[test]
fn nothing_of_a_camera_below_the_map_or_in_its_inside_is_usable() {
    let unusable = CrowdMass { unusable: 1.0, ..NONE };
    for axes in [DOWN, diagonal()] {
        assert_eq!(single(axes, [5.5, 5.5, -9.0], &terrain(&floor(10))), unusable);
    }
    // A block of 4 x 4 columns as a height map gives it, a roof and walls and nothing inside, 20 m above the floor.
    let block = |x: i32, y: i32| (3..7).contains(&x) && (3..7).contains(&y);
    let mut voxels: Vec<_> = floor(10).into_iter().filter(|[x, y, _]| !block(*x, *y)).collect();
    for (x, y) in (3..7).flat_map(|x| (3..7).map(move |y| (x, y))) {
        let is_rim = [3, 6].contains(&x) || [3, 6].contains(&y);
        voxels.extend((if is_rim { 1 } else { 20 }..21).map(|z| [x, y, z]));
    }
    let map = terrain(&voxels);
    assert_eq!(single(DOWN, [5.0, 5.0, 10.5], &map), unusable);
    // Over the block and beside it nothing changes.
    assert_eq!(single(DOWN, [5.0, 5.0, 30.5], &map), CrowdMass { ground: 1.0, ..NONE });
    assert_eq!(single(DOWN, [15.0, 5.0, 10.5], &map), CrowdMass { off_map: 1.0, ..NONE });
}

#[test]
fn a_camera_below_the_map_sees_nothing_of_what_lies_lower() {
    // A ridge 40 m high beside a plain. From 20 m above the plain and beside the ridge the plain is seen; from the same
    // height below the ridge, whose pose was 45 m too low, nothing is, though rays would leave the hill from below.
    let ridge = |x: i32| if x < 10 { 40 } else { 0 };
    let voxels: Vec<_> = floor(40).into_iter().map(|[x, y, _]| [x, y, ridge(x)]).collect();
    let map = terrain(&voxels);
    let east_and_down = [[0.0, -1.0, 0.0], [-0.6, 0.0, -0.8], [0.8, 0.0, -0.6]];
    for (x, ground) in [(12.0, 16.0), (5.0, 0.0)] {
        let view = view(east_and_down, [x, 20.0, 15.0], [4, 4], 20.0, uniform(1.0));
        for project in [project, project_by_rays] {
            let seen = project(&view, &map, &rays(100.0));
            assert_eq!(seen.crowd_mass(), CrowdMass { ground, unusable: 16.0 - ground, ..NONE });
            assert_eq!(seen.voxel_ids().is_empty(), ground == 0.0);
        }
    }
}

#[test]
fn only_pixels_above_the_threshold_count() {
    #[rustfmt::skip]
    let heatmap = Heatmap::new(vec![
        0.25, 0.5,
        0.75, 1.0,
    ], 2, 2).unwrap();
    let view = view(DOWN, [5.0, 5.0, 11.0], [4, 4], 20.0, heatmap);
    let mass = |threshold| {
        let projection = rays(100.0).with_crowd_threshold(threshold).unwrap();
        project(&view, &terrain(&floor(10)), &projection).crowd_mass()
    };
    assert_eq!(mass_of(&view, &terrain(&floor(10)), &rays(100.0)).ground, 4.0 * 1.75);
    assert_eq!(mass(0.25).ground, 4.0 * 2.25);
    assert_eq!(mass(1.0), NONE);
}

#[test]
fn under_the_ground_that_it_leaves_below_a_ray_came_through_a_hole() {
    // A plateau 20 m above the lowest voxel, with 2 m missing in the line of sight, which goes on below it and out
    // of the map's side 10 m above its bottom.
    let mut voxels: Vec<_> = floor(10).into_iter().map(|[x, y, _]| [x, y, 20]).collect();
    voxels.retain(|voxel| *voxel != [5, 5, 20] && *voxel != [5, 6, 20]);
    voxels.push([0, 0, 0]);
    let map = terrain(&voxels);
    assert_eq!(single(diagonal(), [5.5, -4.9, 31.0], &map), CrowdMass { hole: 1.0, ..NONE });
    assert_eq!(single(diagonal(), [5.5, -3.9, 31.0], &map), CrowdMass { ground: 1.0, ..NONE });
}

#[test]
fn over_the_ground_that_it_leaves_behind_a_ray_goes_off_the_map() {
    // A mast makes the box 21 m high; the ray leaves it 10 m above the floor.
    let mut voxels = floor(10);
    voxels.push([0, 0, 20]);
    let map = terrain(&voxels);
    assert_eq!(single(diagonal(), [5.5, 5.5, 15.0], &map), CrowdMass { off_map: 1.0, ..NONE });
    // Away from the map, and beside it.
    assert_eq!(single(diagonal(), [5.5, 20.0, 15.0], &map), CrowdMass { off_map: 1.0, ..NONE });
    assert_eq!(single(DOWN, [-3.0, 5.5, 15.0], &map), CrowdMass { off_map: 1.0, ..NONE });
}

#[test]
fn a_map_that_lies_askew_in_its_box_ends_where_it_ends() {
    let diamond = floor(21).into_iter().filter(|[x, y, _]| (x - 10).abs() + (y - 10).abs() <= 10);
    let map = terrain(&diamond.filter(|voxel| *voxel != [10, 10, 0]).collect::<Vec<_>>());
    assert_eq!(single(DOWN, [2.5, 2.5, 11.0], &map), CrowdMass { off_map: 1.0, ..NONE });
    assert_eq!(single(DOWN, [10.5, 10.5, 11.0], &map), CrowdMass { hole: 1.0, ..NONE });
}

proptest! {
    /// Every pixel that shows crowd has one fate, whatever camera and map; a longer range moves mass from ground
    /// out of range to ground and touches no other.
    #[test]
    fn fates_are_complete_and_disjoint(
        voxels in prop::collection::vec((0i32..12, 0i32..12, 0i32..5).prop_map(<[i32; 3]>::from), 1..200),
        at in prop::array::uniform3(-4.0f64..16.0),
        turn in prop::array::uniform4(-1.0f64..1.0),
        values in prop::collection::vec(0.0f32..=1.0, 48),
        threshold in 0.0f64..1.0,
        range in 0.5f64..30.0,
        k1 in -0.4f64..0.2,
        surface in prop::sample::select(vec![Surface::Planes, Surface::Voxels]),
    ) {
        let turn = DQuat::from_array(turn);
        prop_assume!(turn.length() > 0.1);
        let axes = DMat3::from_quat(turn.normalize()).to_cols_array_2d();
        let heatmap = Heatmap::new(values, 6, 8).unwrap();
        let lens = Distortion::brown_conrady(&[k1, 0.0, 0.0, 0.0]).unwrap();
        let camera = Camera::new(16, 12, 8.0, 8.0, 8.0, 6.0, lens).unwrap();
        let view = View { camera: Arc::new(camera), ..view(axes, at, [16, 12], 8.0, heatmap) };
        let map = terrain(&voxels);
        let mass = |range| {
            let projection = rays(range).with_surface(surface).with_crowd_threshold(threshold).unwrap();
            project(&view, &map, &projection).crowd_mass()
        };
        let (near, far) = (mass(range), mass(1e4));

        let pixels = || (0..12).flat_map(|row| (0..16).map(move |column| (column, row)));
        let crowd = |&(column, row): &(u32, u32)| f64::from(view.value_at(column, row)) > threshold;
        let value = |(column, row)| f64::from(view.value_at(column, row));
        let naive: f64 = pixels().filter(crowd).map(value).sum();
        prop_assert!((near.total() - naive).abs() <= 1e-9 * naive, "{near:?} is not {naive}");

        let meets_ground = |&(column, row): &(u32, u32)| {
            let ray = view.camera.pixel_ray(column, row);
            let cast = |ray| map.raycast(surface, at.into(), view.world_from_camera.rotation * ray, range);
            ray.is_some_and(|ray| cast(ray).is_some())
        };
        let ground: f64 = pixels().filter(crowd).filter(meets_ground).map(value).sum();
        let meets = |direction, range| map.raycast(surface, at.into(), direction, range).is_some();
        let inside = meets(DVec3::NEG_Z, 0.0);
        let below = meets(DVec3::Z, f64::INFINITY) && !meets(DVec3::NEG_Z, f64::INFINITY);
        let ground = if inside || below { 0.0 } else { ground };
        prop_assert!((near.ground - ground).abs() <= 1e-9 * naive, "{near:?}");

        let reached = |mass: CrowdMass| mass.ground + mass.out_of_range;
        prop_assert!((reached(near) - reached(far)).abs() <= 1e-9 * naive);
        let others = |mass: CrowdMass| (mass.hole, mass.off_map, mass.sky, mass.unusable);
        prop_assert_eq!(others(near), others(far));
        prop_assert_eq!(far.out_of_range, 0.0);
    }
}
