mod crowd_mass;

use std::sync::Arc;

use super::*;
use crate::camera::{Camera, Distortion};
use crate::view::{Heatmap, Pose};

/// Columns of the camera axes in the world for a camera that looks straight down, image top to the north.
const DOWN: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
/// Looks north, level.
const NORTH: [[f64; 3]; 3] = [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]];

fn view(axes: [[f64; 3]; 3], at: [f64; 3], image: [u32; 2], focal: f64, heatmap: Heatmap) -> View {
    let [width, height] = image;
    let center = [f64::from(width) / 2.0, f64::from(height) / 2.0];
    let camera = Camera::new(width, height, focal, focal, center[0], center[1], Distortion::None).unwrap();
    let pose = Pose { rotation: glam::DMat3::from_cols_array_2d(&axes), translation: at.into() };
    View::new("uav1", 0, Arc::new(camera), pose, heatmap).unwrap()
}

fn uniform(value: f32) -> Heatmap {
    Heatmap::new(vec![value], 1, 1).unwrap()
}

/// A level floor of voxels at z index 0.
fn floor(side: i32) -> Vec<[i32; 3]> {
    (0..side).flat_map(|x| (0..side).map(move |y| [x, y, 0])).collect()
}

fn terrain(voxels: &[[i32; 3]]) -> Terrain {
    Terrain::from_indices(voxels, 1.0, DVec3::ZERO).unwrap()
}

fn rays(range: f64) -> Projection {
    Projection::new(range, 0.0, Coverage::Rays).unwrap().with_surface(Surface::Voxels)
}

fn full(range: f64) -> Projection {
    Projection::new(range, 0.0, Coverage::Full).unwrap().with_surface(Surface::Voxels)
}

fn sees_nothing(observation: &Observation) -> bool {
    observation.voxel_ids().is_empty() && observation.occluded_ids().is_empty()
}

fn at(terrain: &Terrain, observation: &Observation, index: [i32; 3]) -> Option<(f64, u32)> {
    let id = terrain.id(index).unwrap();
    let row = observation.voxel_ids().binary_search(&id).ok()?;
    Some((observation.mean()[row], observation.pixel_count()[row]))
}

#[test]
fn a_nadir_view_averages_the_pixels_of_each_voxel() {
    // 10 m above the top of the floor (z = 1), f = 20 px: a voxel is 2 x 2 pixels. The 4 x 4 image covers the
    // 2 x 2 voxels around (5, 5); the image's top is north, its left is west.
    let map = terrain(&floor(10));
    #[rustfmt::skip]
    let heatmap = Heatmap::new(vec![
        0.1, 0.3, 0.0, 0.0,
        0.5, 0.7, 0.0, 1.0,
        0.0, 0.0, 0.2, 0.2,
        0.0, 0.0, 0.2, 0.2,
    ], 4, 4).unwrap();
    let observation = project(&view(DOWN, [5.0, 5.0, 11.0], [4, 4], 20.0, heatmap), &map, &rays(100.0));
    let close = |index, mean: f64| {
        let (actual, count) = at(&map, &observation, index).unwrap();
        assert_eq!(count, 4);
        assert!((actual - mean).abs() < 1e-7, "{index:?}: {actual} != {mean}");
    };
    assert_eq!(observation.voxel_ids().len(), 4);
    close([4, 5, 0], 0.4); // north-west
    close([5, 5, 0], 0.25);
    close([4, 4, 0], 0.0);
    close([5, 4, 0], 0.2); // south-east
}

#[test]
fn a_roof_hides_the_floor_below_it() {
    let mut voxels = floor(10);
    voxels.push([5, 5, 4]);
    let map = terrain(&voxels);
    let observation = project(&view(DOWN, [5.5, 5.5, 20.0], [9, 9], 40.0, uniform(0.5)), &map, &full(100.0));
    assert!(at(&map, &observation, [5, 5, 4]).is_some());
    assert_eq!(at(&map, &observation, [5, 5, 0]), None);
    assert_eq!(observation.occluded_ids(), [map.id([5, 5, 0]).unwrap()]);
}

#[test]
fn what_lies_beyond_the_range_is_not_seen() {
    let map = terrain(&floor(10));
    let seen = |range| {
        let view = view(DOWN, [5.0, 5.0, 11.0], [4, 4], 20.0, uniform(1.0));
        project(&view, &map, &rays(range)).voxel_ids().len()
    };
    assert_eq!(seen(9.9), 0);
    assert_eq!(seen(10.2), 4);
}

#[test]
fn full_coverage_sees_the_far_plain_that_pixels_step_over() {
    // 10 m above the floor with a level camera whose image is the lower half of a 90 degree view: at distance
    // d a row of voxels is about 16 * 10 / d^2 rows high, under one row beyond 13 m.
    let map = terrain(&floor(60));
    let camera = Camera::new(32, 16, 16.0, 16.0, 16.0, 0.0, Distortion::None).unwrap();
    let pose =
        Pose { rotation: glam::DMat3::from_cols_array_2d(&NORTH), translation: DVec3::new(30.0, -5.0, 11.0) };
    let view = View::new("uav1", 0, Arc::new(camera), pose, uniform(0.25)).unwrap();
    let by_rays = project(&view, &map, &rays(200.0));
    let by_both = project(&view, &map, &full(200.0));
    // Every voxel of the column straight ahead from 6 m on has its top in view.
    for y in 6..60 {
        assert!(at(&map, &by_both, [30, y, 0]).is_some(), "y = {y}");
    }
    assert!((6..60).any(|y| at(&map, &by_rays, [30, y, 0]).is_none()));
    assert!(by_both.pixel_count().contains(&0));
    assert!(by_both.occluded_ids().is_empty(), "nothing hides anything on a plain");
    // What pixels hit is untouched by the other coverage.
    for (row, id) in by_rays.voxel_ids().iter().enumerate() {
        let same = by_both.voxel_ids().binary_search(id).unwrap();
        assert_eq!(by_both.mean()[same], by_rays.mean()[row]);
        assert_eq!(by_both.pixel_count()[same], by_rays.pixel_count()[row]);
    }
}

#[test]
fn a_raised_target_lowers_the_ray() {
    // Level plain seen at 45 degrees: what the pixel shows 1 m above the ground stands 1 m nearer.
    let map = terrain(&floor(40));
    let diagonal = std::f64::consts::FRAC_1_SQRT_2;
    let axes = [[1.0, 0.0, 0.0], [0.0, -diagonal, -diagonal], [0.0, diagonal, -diagonal]];
    let seen = |target_height_m| {
        let view = view(axes, [5.5, 0.25, 11.0], [1, 1], 100.0, uniform(1.0));
        let projection =
            Projection::new(100.0, target_height_m, Coverage::Rays).unwrap().with_surface(Surface::Voxels);
        map.index(project(&view, &map, &projection).voxel_ids()[0])
    };
    assert_eq!(seen(0.0), [5, 10, 0]);
    assert_eq!(seen(1.0), [5, 9, 0]);
    assert_eq!(seen(3.0), [5, 7, 0]);
}

#[test]
fn a_camera_inside_the_terrain_or_pushed_through_it_sees_nothing() {
    let map = terrain(&floor(10));
    let seen = |z, target_height_m| {
        let view = view(DOWN, [5.5, 5.5, z], [4, 4], 4.0, uniform(1.0));
        let projection =
            Projection::new(100.0, target_height_m, Coverage::Full).unwrap().with_surface(Surface::Voxels);
        project(&view, &map, &projection)
    };
    assert!(sees_nothing(&seen(0.5, 0.0)));
    assert!(sees_nothing(&seen(1.5, 0.9)));
    assert!(!seen(2.5, 0.9).voxel_ids().is_empty());
}

#[test]
fn terrain_and_pose_that_do_not_overlap_give_an_empty_observation() {
    let map = terrain(&floor(10));
    let observation = project(&view(DOWN, [1e6, 1e6, 50.0], [8, 8], 8.0, uniform(1.0)), &map, &full(300.0));
    assert!(sees_nothing(&observation));
}

#[test]
fn range_and_tilt_lead_to_the_middle_of_the_top() {
    // From (5.5, 5.5, 11): straight down 10 m to the top at (5.5, 5.5, 1); 10 m north of there the line is
    // 45 degrees below the horizon and 10 sqrt(2) m long.
    let map = terrain(&floor(30));
    let below = project(&view(DOWN, [5.5, 5.5, 11.0], [1, 1], 100.0, uniform(1.0)), &map, &rays(100.0));
    assert_eq!((below.range_m(), below.tilt_deg()), (&[10.0][..], &[90.0][..]));
    let diagonal = std::f64::consts::FRAC_1_SQRT_2;
    let axes = [[1.0, 0.0, 0.0], [0.0, -diagonal, -diagonal], [0.0, diagonal, -diagonal]];
    let view = view(axes, [5.5, 5.5, 11.0], [1, 1], 100.0, uniform(1.0));
    let ahead = project(&view, &map, &rays(100.0));
    let by_rays = project_by_rays(&view, &map, &rays(100.0));
    assert!((ahead.range_m()[0] - by_rays.range_m()[0]).abs() < 1e-5);
    assert_eq!(map.index(ahead.voxel_ids()[0]), [5, 15, 0]);
    assert!((f64::from(ahead.range_m()[0]) - 200f64.sqrt()).abs() < 1e-6);
    assert!((ahead.tilt_deg()[0] - 45.0).abs() < 1e-5);
}
