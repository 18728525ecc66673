//! The raster against the ray of every pixel.

use std::collections::BTreeSet;
use std::sync::Arc;

use glam::{DMat3, DVec2};

use super::canvas::NOBODY;
use super::*;
use crate::back_projection::{Coverage, Projection, project, project_by_rays};
use crate::camera::{Camera, Distortion};
use crate::observation::Observation;
use crate::terrain::height_map::HeightMap;
use crate::terrain::{Plane, Surface, Terrain};
use crate::view::{Heatmap, Pose, View};

const WIDTH: u32 = 96;
const HEIGHT: u32 = 72;

fn view(at: DVec3, rotation: DMat3, focal: f64) -> View {
    let camera = Camera::new(WIDTH, HEIGHT, focal, focal, 47.0, 37.0, Distortion::None).unwrap();
    let values = (0..WIDTH * HEIGHT).map(|pixel| (pixel % 101) as f32 / 100.0).collect();
    let heatmap = Heatmap::new(values, HEIGHT as usize, WIDTH as usize).unwrap();
    let pose = Pose { rotation, translation: at };
    View::new("drone", 0, Arc::new(camera), pose, heatmap).unwrap()
}

/// Camera axes for looking along a compass direction, down from the horizon, with some roll; radians.
fn looking(heading: f64, tilt: f64, roll: f64) -> DMat3 {
    let forward = DVec3::new(heading.sin() * tilt.cos(), heading.cos() * tilt.cos(), -tilt.sin());
    let right = DVec3::new(heading.cos(), -heading.sin(), 0.0);
    let axes = DMat3::from_cols(right, forward.cross(right), forward);
    axes * DMat3::from_rotation_z(roll)
}

fn lens_of(view: &View) -> Option<&IdealPixels> {
    match view.camera.distortion() {
        Distortion::None => None,
        _ => Some(view.camera.ideal_pixels().expect("not too wide")),
    }
}

/// Pixels on which the raster and the rays disagree: those that only one of the two calls ground, and those in
/// another voxel.
fn disagreements(terrain: &Terrain, surface: Surface, view: &View, max_range_m: f64) -> [usize; 2] {
    let origin = view.world_from_camera.translation;
    let vantage = Vantage { view, terrain, surface, origin, max_range_m };
    let mut counts = [0; 2];
    for (pixel, painted) in (0..).zip(painted_ids(&vantage)) {
        let (column, row) = (pixel % WIDTH, pixel / WIDTH);
        let ray = view.camera.pixel_ray(column, row).map(|ray| view.world_from_camera.rotation * ray);
        let cast = ray.and_then(|ray| vantage.cast(ray)).map(|hit| hit.voxel_id);
        match (cast, painted) {
            (Some(_), None) | (None, Some(_)) => counts[0] += 1,
            (a, b) if a != b => counts[1] += 1,
            _ => (),
        }
    }
    counts
}

/// The voxel that was painted on each pixel, row after row.
fn painted_ids(vantage: &Vantage) -> Vec<Option<u32>> {
    let mut painter = Painter::new(vantage, lens_of(vantage.view), true);
    let root = painter.stacks.root();
    painter.walk(&root, &mut Box::default());
    let pixels = (0..HEIGHT as usize).flat_map(|row| (0..WIDTH as usize).map(move |column| (column, row)));
    let owners = pixels.map(|(column, row)| painter.canvas.owner(column, row));
    owners.map(|owner| (owner != NOBODY).then(|| painter.rows[owner as usize].id)).collect()
}

/// Hills with cliffs, houses with overhanging roofs, canopies and holes; 64 x 64 columns of 1 m.
fn landscape(seed: f64) -> Terrain {
    let ground = |x: f64, y: f64| {
        6.0 * (0.11 * x + seed).sin() * (0.09 * y - seed).cos() + if x + 0.3 * y > 60.0 { 9.0 } else { 0.0 }
    };
    let heights: Vec<f32> = (0..64 * 64)
        .map(|cell| {
            let (x, y) = ((cell / 64) as f64 + 0.5, (cell % 64) as f64 + 0.5);
            let is_hole = (x - 40.0).hypot(y - 44.0) < 2.5;
            if is_hole { f32::NAN } else { ground(x, y) as f32 }
        })
        .collect();
    let map = HeightMap::new(&heights, [64, 64], 1.0).unwrap();
    let columns = map.columns(1.0).unwrap();
    let mut voxels = columns.voxels().unwrap();
    // A roof on a wall, reaching out by two columns, and a round canopy.
    for (i, j) in (10..22).flat_map(|i| (30..42).map(move |j| (i, j))) {
        voxels.push([i, j, 14]);
        if (12..20).contains(&i) && (32..40).contains(&j) {
            voxels.extend((-4..14).map(|k| [i, j, k]));
        }
    }
    for (i, j, k) in (0..9).flat_map(|i| (0..9).flat_map(move |j| (0..5).map(move |k| (i, j, k)))) {
        let inside = (f64::from(i) - 4.0).hypot(f64::from(j) - 4.0).hypot(1.8 * (f64::from(k) - 2.0)) < 4.2;
        if inside {
            voxels.push([34 + i, 14 + j, 12 + k]);
        }
    }
    let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
    let of_ground = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
    terrain.with_planes(|[i, j, k]| {
        let on_ground = of_ground.id([i, j, k]).map(|id| of_ground.plane(id));
        on_ground.unwrap_or(Plane::new(0.5, [0.0, 0.03 * f64::from(i.rem_euclid(2))]))
    })
}

/// A hill across the whole map, behind which lies a plain; the camera is lower than its top. Through a hole in the
/// near slope, or from beside a map that begins on the ridge, lines of sight go under the ground: what they meet is the
/// far slope, from below, and nothing of the plain.
#[test]
fn a_pixel_that_shows_what_lies_under_the_ground_belongs_to_what_its_ray_meets() {
    let hill = |y: f64| (20.0 - (y - 20.0).abs()).max(0.0);
    for (hole, from) in [(Some(5..14), 0), (None, 20), (None, 16)] {
        let heights: Vec<f32> = (0..60 * (60 - from))
            .map(|cell| {
                let (x, y) = (cell / (60 - from), from + cell % (60 - from));
                let is_hole = (20..40).contains(&x) && hole.as_ref().is_some_and(|hole| hole.contains(&y));
                if is_hole { f32::NAN } else { hill(y as f64 + 0.5) as f32 }
            })
            .collect();
        let map = HeightMap::new(&heights, [60, 60 - from], 1.0).unwrap();
        let terrain = Terrain::from_height_map(&map, 1.0, DVec3::new(0.0, from as f64, 0.0)).unwrap();
        for (height, tilt) in [(12.0, 0.25), (9.0, 0.1), (15.0, 0.4)] {
            let view = view(DVec3::new(30.2, from as f64 - 5.0, height), looking(0.0, tilt, 0.0), 60.0);
            // Of a column that is turned to the camera nobody paints the underside: its rays meet nothing.
            if from != 16 {
                let [one_sided, elsewhere] = disagreements(&terrain, Surface::Planes, &view, 100.0);
                assert_eq!(one_sided, 0, "hole {hole:?}, from {from}, camera at {height}");
                assert!(elsewhere <= 2, "{elsewhere} pixels on the border of two columns");
            }
            let seen = project(&view, &terrain, &Projection::new(100.0, 0.0, Coverage::Full).unwrap());
            let behind = |id: u32| terrain.center(id).y > 41.0;
            assert!(!seen.voxel_ids().iter().any(|&id| behind(id)), "the plain lies behind the hill");
        }
    }
}

#[test]
fn a_pixel_of_a_lens_that_distorts_belongs_to_what_its_ray_meets() {
    let terrain = landscape(0.7);
    let lenses = [
        Distortion::brown_conrady(&[-0.25, 0.06, 1e-3, -2e-3, 0.0]).unwrap(),
        Distortion::brown_conrady(&[0.2, 0.1, 0.0, 0.0, 0.0]).unwrap(),
        Distortion::KannalaBrandt { k1: 0.02, k2: -0.003, k3: 0.001, k4: 0.0 },
    ];
    for (number, lens) in (0..12).zip(lenses.iter().cycle()) {
        let turn = f64::from(number);
        let rotation = looking(0.55 * turn, 0.1 + 0.12 * turn, 0.2 * (turn % 3.0 - 1.0));
        let at = DVec3::new(10.3 + 4.0 * turn, 50.7 - 3.7 * turn, 17.2 + 2.0 * (turn % 4.0));
        let camera = Camera::new(WIDTH, HEIGHT, 52.0, 55.0, 47.0, 37.0, *lens).unwrap();
        let view = View { camera: Arc::new(camera), ..view(at, rotation, 60.0) };
        assert_eq!(disagreements(&terrain, Surface::Planes, &view, 45.0), [0, 0], "view {number}");
    }
}

/// Of heatmaps of 24 x 18 cells on 96 x 72 pixels: all but what lies above a slanting line, a corner, and every third
/// cell, some of it in the middle of everything.
fn parts() -> Vec<Vec<bool>> {
    let cells = |is_looked_at: fn(usize, usize) -> bool| -> Vec<bool> {
        (0..18 * 24).map(|cell| is_looked_at(cell % 24, cell / 24)).collect()
    };
    vec![
        cells(|column, row| 3 * row > 20 + column),
        cells(|column, row| column < 9 && row < 7),
        cells(|column, row| (column + 2 * row) % 3 != 0),
        cells(|_, _| false),
    ]
}

/// Wherever nobody looked nothing is painted, and everywhere else what the whole picture shows there: tiles of which
/// nothing was looked at are passed over, and with them goes nothing that hides something else.
#[test]
fn a_part_of_a_picture_shows_what_the_whole_picture_shows_there() {
    let lens = Distortion::brown_conrady(&[-0.25, 0.06, 1e-3, -2e-3, 0.0]).unwrap();
    let (mut seen, mut between) = ([0; 2], [0; 4]);
    for (seed, lens) in [(0.0, Distortion::None), (1.3, Distortion::None), (0.7, lens)] {
        let terrain = landscape(seed);
        for number in 0..12 {
            let turn = f64::from(number);
            let rotation = looking(0.55 * turn, 0.05 + 0.1 * turn, 0.2 * (turn % 3.0 - 1.0));
            let at = DVec3::new(10.3 + 4.0 * turn, 50.7 - 3.7 * turn, 17.2 + 2.0 * (turn % 4.0));
            let camera = Arc::new(Camera::new(WIDTH, HEIGHT, 52.0, 55.0, 47.0, 37.0, lens).unwrap());
            let whole = View { camera, ..view(at, rotation, 60.0) };
            let ids = |view: &View| {
                let surface = Surface::Planes;
                painted_ids(&Vantage { view, terrain: &terrain, surface, origin: at, max_range_m: 60.0 })
            };
            let painted = ids(&whole);
            let full = Projection::new(60.0, 0.0, Coverage::Full).unwrap();
            let of_whole = project(&whole, &terrain, &full);
            for looked_at in parts() {
                let heatmap = Heatmap::new(vec![0.5; 18 * 24], 18, 24).unwrap().of_part(looked_at).unwrap();
                let part = View { heatmap, ..whole.clone() };
                for ((pixel, id), id_of_part) in (0..).zip(&painted).zip(ids(&part)) {
                    let (column, row) = (pixel % WIDTH, pixel / WIDTH);
                    let expected = id.filter(|_| part.is_looked_at(column, row));
                    assert_eq!(id_of_part, expected, "view {number}, pixel ({column}, {row})");
                    seen[usize::from(expected.is_some())] += 1;
                }
                let of_part = project(&part, &terrain, &full);
                let is_of_whole = |id| of_whole.voxel_ids().binary_search(id).is_ok();
                assert!(of_part.voxel_ids().iter().all(is_of_whole), "view {number}");
                let counts = between_pixels(&terrain, &part, 60.0);
                (0..4).for_each(|k| between[k] += counts[k]);
                let rays = Projection::new(60.0, 0.0, Coverage::Rays).unwrap();
                let rays = rays.with_crowd_threshold(0.4).unwrap();
                let [painted, cast] =
                    [project, project_by_rays].map(|project| project(&part, &terrain, &rays));
                assert_eq!(painted.crowd_mass(), cast.crowd_mass());
            }
        }
    }
    assert!(seen.iter().all(|&pixels| pixels > 50_000), "{seen:?}");
    let [both, _, cast_alone, _] = between;
    assert!(cast_alone as f64 <= 0.03 * both as f64, "{between:?}");
}

#[test]
fn a_pixel_belongs_to_what_its_ray_meets() {
    let (mut pixels, mut one_sided, mut elsewhere) = (0, 0, 0);
    for (seed, surface) in [(0.0, Surface::Planes), (1.3, Surface::Planes), (2.1, Surface::Voxels)] {
        let terrain = landscape(seed);
        for number in 0..12 {
            let turn = f64::from(number);
            let rotation = looking(0.55 * turn, 0.1 + 0.12 * turn, 0.2 * (turn % 3.0 - 1.0));
            let at = DVec3::new(10.3 + 4.0 * turn, 50.7 - 3.7 * turn, 17.2 + 2.0 * (turn % 4.0));
            let counts = disagreements(&terrain, surface, &view(at, rotation, 60.0), 45.0);
            pixels += (WIDTH * HEIGHT) as usize;
            one_sided += counts[0];
            elsewhere += counts[1];
        }
    }
    assert_eq!(one_sided, 0, "of {pixels} pixels");
    assert!(elsewhere as f64 <= 2e-5 * pixels as f64, "{elsewhere} of {pixels} pixels");
}

/// Open hills without walls, where columns are painted a row at once; from low and high, along the ground and straight
/// down, with the camera over and beside the map and the range ending on it.
#[test]
fn a_pixel_of_smooth_ground_belongs_to_what_its_ray_meets() {
    let height = |x: f64, y: f64| 9.0 * (0.05 * x).sin() * (0.06 * y).cos() + 0.7 * (0.4 * x + 0.3 * y).sin();
    let heights: Vec<f32> =
        (0..128 * 128).map(|cell| height((cell / 128) as f64, (cell % 128) as f64) as f32).collect();
    let map = HeightMap::new(&heights, [128, 128], 1.0).unwrap();
    let terrain = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
    let (mut pixels, mut one_sided, mut elsewhere) = (0, 0, 0);
    for number in 0..40 {
        let turn = f64::from(number);
        let (x, y) = (6.1 + (37.7 * turn) % 116.0, 3.3 + (53.9 * turn) % 120.0);
        let above = [1.7, 4.0, 12.0, 40.0, 90.0][number as usize % 5];
        let tilt = [0.02, 0.2, 0.6, 1.1, std::f64::consts::FRAC_PI_2][number as usize / 5 % 5];
        let rotation = looking(0.7 * turn, tilt, 0.1 * (turn % 5.0 - 2.0));
        let at = DVec3::new(x, y, height(x, y) + above);
        let focal = [30.0, 60.0, 200.0][number as usize % 3];
        let counts = disagreements(&terrain, Surface::Planes, &view(at, rotation, focal), 70.0);
        pixels += (WIDTH * HEIGHT) as usize;
        one_sided += counts[0];
        elsewhere += counts[1];
    }
    assert_eq!(one_sided, 0, "of {pixels} pixels");
    assert!(elsewhere as f64 <= 2e-5 * pixels as f64, "{elsewhere} of {pixels} pixels");
}

/// Walls one column wide and three voxels high on a plain, whose surface lies anywhere in its voxels: from 9 m above it
/// nothing is seen of the two columns behind each, though the foot of the wall, which owns the pixels over them, is
/// hardly higher than they are where the plain lies high in its voxels.
#[test]
fn the_foot_of_a_wall_is_not_the_ground_behind_it() {
    let is_wall = |y: usize| y % 20 == 10;
    for fraction in [0.0, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99, 0.999] {
        let height = |cell: usize| 1.0 + fraction + if is_wall(cell % 128) { 3.0 } else { 0.0 };
        let heights: Vec<f32> = (0..128 * 128).map(height).collect();
        let map = HeightMap::new(&heights, [128, 128], 1.0).unwrap();
        let terrain = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
        let at = DVec3::new(64.2, 2.3, 10.0 + f64::from(fraction));
        let view = view(at, looking(0.0, 0.15, 0.05), 300.0);
        let projection = Projection::new(90.0, 0.0, Coverage::Full).unwrap();
        let seen = project(&view, &terrain, &projection);
        let is_behind = |&id: &u32| {
            let [_, y, z] = terrain.index(id);
            z < 2 && [y - 1, y - 2].iter().any(|&y| y >= 0 && is_wall(y as usize))
        };
        let (behind, open): (Vec<u32>, Vec<u32>) = seen.voxel_ids().iter().copied().partition(is_behind);
        assert!(behind.is_empty(), "{} columns behind walls, surface at {fraction}", behind.len());
        assert!(open.len() > 100);
    }
}

/// A lens whose model ends inside of the picture, before a wall that fills the picture: some tops behind the wall lie in
/// the last pixels, whose centres have no ray, so that nothing was ever painted on these.
#[test]
fn a_wall_hides_what_lies_behind_it_where_the_lens_model_ends() {
    let heights: Vec<f32> = (0..64 * 64).map(|cell| if cell % 64 == 20 { 30.5 } else { 0.5 }).collect();
    let map = HeightMap::new(&heights, [64, 64], 1.0).unwrap();
    let terrain = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
    for number in 0..24 {
        let turn = f64::from(number);
        // r - 0.4 r^3 turns back at r = 0.913, where it is 0.609: pixels further than 27 from the middle are blind.
        let lens = Distortion::brown_conrady(&[-0.4, 0.0, 0.0, 0.0, 0.0]).unwrap();
        let rotation = looking(0.02 * turn, 0.3 + 0.02 * turn, 0.1 * turn);
        let at = DVec3::new(32.3, 18.7, 12.0 + 0.3 * turn);
        let camera = Camera::new(WIDTH, HEIGHT, 45.0, 45.0, 47.0, 37.0, lens).unwrap();
        assert!(camera.blind_pixel_count() > 1000);
        let view = View { camera: Arc::new(camera), ..view(at, rotation, 45.0) };
        let seen = project(&view, &terrain, &Projection::new(90.0, 0.0, Coverage::Full).unwrap());
        let behind = seen.voxel_ids().iter().filter(|&&id| terrain.index(id)[1] > 20).count();
        assert_eq!(behind, 0, "view {number}");
    }
}

/// A wall as high as 20 voxels across a plain, from 9.5 above it and far enough for a pixel to be wider than a voxel. The
/// shadow reaches from y = 21 to y = 21 + 20 * 11 / 9.5 = 44.2. Straight ahead, the centre of the pixel over a middle may look
/// along the next row of columns, whose wall comes after the ground of this one.
#[test]
fn a_wall_hides_the_ground_straight_behind_it_whichever_row_comes_first() {
    let heights: Vec<f32> = (0..64 * 64).map(|cell| if cell % 64 == 20 { 20.5 } else { 0.5 }).collect();
    let map = HeightMap::new(&heights, [64, 64], 1.0).unwrap();
    let terrain = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
    for number in 0..60 {
        let turn = f64::from(number);
        let at = DVec3::new(31.0 + turn / 30.0, 10.0, 30.0);
        let view = view(at, looking(0.01 * turn, 0.9, 0.03 * turn), 14.0 + 0.3 * turn);
        let seen = project(&view, &terrain, &Projection::new(90.0, 0.0, Coverage::Full).unwrap());
        let in_shadow = |&id: &u32| (21..38).contains(&terrain.index(id)[1]);
        let behind: Vec<u32> = seen.voxel_ids().iter().copied().filter(in_shadow).collect();
        assert!(behind.is_empty(), "view {number}: {:?}", terrain.indices_of(&behind));
    }
}

/// A row of columns like a kerb on a plain at z = 0.5: 0.9 high in the middle, rising by 1.5 a voxel away from the camera, so
/// that its edge at y = 21 is 1.65 high. From (y, z) = (0, 6), the line over that edge falls by 4.35 in 21: it is at 1.13 over
/// the middle of y = 23, more than half a voxel above the plain.
#[test]
fn a_ramp_hides_by_its_edge_what_lies_behind_it() {
    let voxels: Vec<[i32; 3]> = (0..64 * 64).map(|cell| [cell / 64, cell % 64, 0]).collect();
    let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
    let terrain = terrain.with_planes(|[_, y, _]| match y {
        20 => Plane::new(0.9, [0.0, 1.5]),
        _ => Plane::new(0.5, [0.0, 0.0]),
    });
    for number in 0..8 {
        let rotation = looking(0.05 * f64::from(number), 0.25, 0.02 * f64::from(number));
        let view = view(DVec3::new(24.3, 0.0, 6.0), rotation, 100.0);
        let seen = project(&view, &terrain, &Projection::new(90.0, 0.0, Coverage::Full).unwrap());
        let count = |rows: std::ops::Range<i32>| {
            seen.voxel_ids().iter().filter(|&&id| rows.contains(&terrain.index(id)[1])).count()
        };
        assert_eq!(count(21..24), 0, "view {number}");
        assert!(count(20..21) > 10 && count(28..64) > 100);
    }
}

/// A wall 3 voxels high across a plain, from 1.2 voxels above it and 48 away, where a pixel is 0.8 voxels high and shows 32 of
/// the plain: half of the pixel at its foot may show the ground before it, and the other half is in front of that behind.
#[test]
fn a_wall_within_the_footprint_of_a_pixel_hides_what_lies_behind_it() {
    let heights: Vec<f32> = (0..64 * 64).map(|cell| if cell % 64 == 48 { 3.5 } else { 0.5 }).collect();
    let map = HeightMap::new(&heights, [64, 64], 1.0).unwrap();
    let terrain = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
    for number in 0..40 {
        let turn = f64::from(number);
        let view = view(DVec3::new(32.3, 0.2, 1.7), looking(0.0, 0.02 + 0.001 * turn, 0.0), 60.0);
        let seen = project(&view, &terrain, &Projection::new(90.0, 0.0, Coverage::Full).unwrap());
        let behind = seen.voxel_ids().iter().filter(|&&id| terrain.index(id)[1] > 48).count();
        assert_eq!(behind, 0, "view {number}");
        assert!(seen.voxel_ids().len() > 200);
    }
}

/// Towers of all heights side by side, some of them with plates that reach over their neighbours, seen from the streets
/// and from above: most walls are hidden, wholly or from below, and what is not is a single voxel or dozens.
#[test]
fn a_pixel_of_towers_belongs_to_what_its_ray_meets() {
    let mut voxels = Vec::new();
    for (i, j) in (0..64).flat_map(|i| (0..64).map(move |j| (i, j))) {
        let lot = (i / 7) * 31 + (j / 5) * 17;
        let is_street = i % 7 < 2 || j % 5 == 0;
        let height = if is_street { 0 } else { lot % 23 };
        voxels.extend((0..=height).map(|k| [i, j, k]));
        if lot % 4 == 0 {
            voxels.push([i, j, lot % 23 + 3]);
        }
    }
    let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
    let (mut pixels, mut one_sided, mut elsewhere) = (0, 0, 0);
    for number in 0..32 {
        let turn = f64::from(number);
        let rotation = looking(0.83 * turn, -0.3 + 0.06 * turn, 0.1 * (turn % 5.0 - 2.0));
        let above = [1.6, 7.3, 28.4, 41.7][number as usize % 4];
        // In the middle of a street.
        let at = DVec3::new(0.93 + 7.0 * (turn % 9.0), 3.37 + 1.9 * turn, above);
        let surface = [Surface::Planes, Surface::Voxels][number as usize / 4 % 2];
        let counts = disagreements(&terrain, surface, &view(at, rotation, 60.0), 50.0);
        pixels += (WIDTH * HEIGHT) as usize;
        one_sided += counts[0];
        elsewhere += counts[1];
    }
    assert_eq!(one_sided, 0, "of {pixels} pixels");
    assert!(elsewhere as f64 <= 2e-5 * pixels as f64, "{elsewhere} of {pixels} pixels");
}

/// Tops between the pixels: seen by the raster and by their own ray, by one of the two alone, by neither.
fn between_pixels(terrain: &Terrain, view: &View, max_range_m: f64) -> [usize; 4] {
    let projection = Projection::new(max_range_m, 0.0, Coverage::Full).unwrap();
    let painted = project(view, terrain, &projection);
    let cast = project_by_rays(view, terrain, &projection);
    let rays = Projection::new(max_range_m, 0.0, Coverage::Rays).unwrap();
    let hit = project_by_rays(view, terrain, &rays);
    let between = |observation: &Observation| -> BTreeSet<u32> {
        let ids = observation.voxel_ids().iter().copied();
        ids.filter(|id| hit.voxel_ids().binary_search(id).is_err()).collect()
    };
    let (painted_ids, cast_ids) = (between(&painted), between(&cast));
    let both = painted_ids.intersection(&cast_ids).count();
    let hidden = painted.occluded_ids().iter().filter(|id| cast.occluded_ids().binary_search(id).is_ok());
    [both, painted_ids.len() - both, cast_ids.len() - both, hidden.count()]
}

#[test]
fn what_lies_between_the_pixels_is_seen_where_its_own_ray_sees_it() {
    let mut sum = [0; 4];
    for seed in [0.0, 1.3, 2.1] {
        let terrain = landscape(seed);
        for number in 0..12 {
            let turn = f64::from(number);
            let rotation = looking(0.55 * turn, 0.05 + 0.05 * turn, 0.2 * (turn % 3.0 - 1.0));
            let at = DVec3::new(10.3 + 4.0 * turn, 50.7 - 3.7 * turn, 17.2 + 2.0 * (turn % 4.0));
            for focal in [12.0, 40.0] {
                let counts = between_pixels(&terrain, &view(at, rotation, focal), 60.0);
                (0..4).for_each(|k| sum[k] += counts[k]);
            }
        }
    }
    let [both, painted_alone, cast_alone, hidden] = sum;
    assert!(cast_alone as f64 <= 0.03 * both as f64, "{cast_alone} of {both} are missed");
    assert!(painted_alone as f64 <= 0.1 * both as f64, "{painted_alone} beside {both}, {hidden} hidden");
}

/// Level ground and hills that fill their tiles of 16 columns up to the edge of the map, seen from beside it.
#[test]
fn a_pixel_of_the_side_of_the_map_belongs_to_what_its_ray_meets() {
    let height =
        |cell: usize| 0.5 + if cell % 64 < 32 { 0.0 } else { 4.0 * (0.1 * (cell / 64) as f64).sin() };
    let heights: Vec<f32> = (0..64 * 64).map(|cell| height(cell) as f32).collect();
    let map = HeightMap::new(&heights, [64, 64], 1.0).unwrap();
    let terrain = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
    let (mut pixels, mut one_sided, mut elsewhere) = (0, 0, 0);
    for number in 0..32 {
        let turn = f64::from(number);
        let heading = std::f64::consts::FRAC_PI_2 * f64::from(number % 4) + 0.07 * (turn % 5.0 - 2.0);
        let tilt = [0.2, 0.5, 0.9, 1.3][number as usize / 4 % 4];
        let edge = [[30.3, 0.0], [0.0, 30.3], [30.3, 64.0], [64.0, 30.3]][number as usize % 4];
        let rotation = looking(heading, tilt, 0.1 * (turn % 3.0 - 1.0));
        let at = DVec3::new(edge[0], edge[1], 0.5) - rotation * DVec3::Z * (25.0 + turn);
        let focal = [50.0, 200.0][number as usize / 16];
        let counts = disagreements(&terrain, Surface::Planes, &view(at, rotation, focal), 150.0);
        pixels += (WIDTH * HEIGHT) as usize;
        one_sided += counts[0];
        elsewhere += counts[1];
    }
    assert_eq!(one_sided, 0, "of {pixels} pixels");
    assert!(elsewhere as f64 <= 2e-5 * pixels as f64, "{elsewhere} of {pixels} pixels");
}

/// A house cut off by the edge of a map that has no hole: from beside the map one looks in under its roof, and meets the
/// walls behind from inside, not the ground beyond them.
#[test]
fn a_wall_that_is_met_from_under_a_roof_hides_what_lies_behind_it() {
    let is_house = |x: usize, y: usize| (16..26).contains(&x) && y < 9;
    let heights: Vec<f32> =
        (0..48 * 48).map(|cell| if is_house(cell / 48, cell % 48) { 8.9 } else { 0.3 }).collect();
    let map = HeightMap::new(&heights, [48, 48], 1.0).unwrap();
    let terrain = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
    for (number, height) in [8.95, 7.0, 5.0, 3.0].into_iter().enumerate() {
        let rotation = looking(0.1 * number as f64, 0.35, 0.0);
        let view = view(DVec3::new(20.3, -8.1, height), rotation, 60.0);
        let counts = disagreements(&terrain, Surface::Planes, &view, 100.0);
        assert!(counts[0] == 0 && counts[1] <= 2, "{counts:?} from {height}");
    }
}

/// Mean values of what the raster and the rays both see with as many pixels: how many there are, and how many of the rim
/// and of the rest differ.
fn means(terrain: &Terrain, view: &View) -> [usize; 3] {
    let projection = Projection::new(120.0, 0.0, Coverage::Full).unwrap();
    let painted = project(view, terrain, &projection);
    let cast = project_by_rays(view, terrain, &projection);
    let mut counts = [0; 3];
    for (row, id) in painted.voxel_ids().iter().enumerate() {
        let Ok(other) = cast.voxel_ids().binary_search(id) else { continue };
        if painted.pixel_count()[row] == cast.pixel_count()[other] {
            counts[0] += 1;
            let [i, j, _] = terrain.index(*id);
            let around = [[i - 1, j], [i + 1, j], [i, j - 1], [i, j + 1]];
            let is_rim = around.iter().any(|&[i, j]| terrain.column(i, j).next().is_none());
            let differs = (painted.mean()[row] - cast.mean()[other]).abs() > 1e-6;
            counts[if is_rim { 1 } else { 2 }] += usize::from(differs);
        }
    }
    counts
}

/// Around the edge of a map, over its hole, and within it; through a pinhole and through a lens that distorts.
#[test]
fn the_rim_of_the_map_reads_what_its_rays_read() {
    let (mut compared, mut of_rim, mut of_rest) = (0, 0, 0);
    for (seed, number) in
        [0.0, 1.3, 2.1].into_iter().flat_map(|seed| (0..16).map(move |number| (seed, number)))
    {
        let terrain = landscape(seed);
        let turn = f64::from(number);
        let heading = 0.4 * turn;
        let tilt = [0.15, 0.4, 0.8, 1.3][number as usize % 4];
        let target = [DVec3::new(32.0, 1.0, 4.0), DVec3::new(40.0, 44.0, 2.0), DVec3::new(63.0, 30.0, 6.0)];
        let rotation = looking(heading, tilt, 0.1 * (turn % 3.0 - 1.0));
        let at = target[number as usize % 3] - rotation * DVec3::Z * (18.0 + turn);
        let pinhole = view(at, rotation, 70.0);
        let lens = Distortion::brown_conrady(&[-0.2, 0.05, 1e-3, -2e-3, 0.0]).unwrap();
        let camera = Camera::new(WIDTH, HEIGHT, 70.0, 72.0, 47.0, 37.0, lens).unwrap();
        for view in [&pinhole, &View { camera: Arc::new(camera), ..pinhole.clone() }] {
            let counts = means(&terrain, view);
            compared += counts[0];
            of_rim += counts[1];
            of_rest += counts[2];
        }
    }
    assert!(compared > 10_000, "{compared} voxels");
    // Pixels on the border of two columns.
    assert!(of_rim + of_rest <= 30, "{of_rim} of the rim and {of_rest} of the rest, of {compared} voxels");
}

/// People on a quay, up to the edge of a map whose surface lies anywhere in its voxels, and nobody on the water before it.
#[test]
fn nothing_beside_the_map_thins_out_a_crowd_at_its_rim() {
    for (fraction, tilt, distance) in
        [(0.5, 0.2, 30.0), (0.9, 0.6, 30.0), (0.1, 1.2, 30.0), (0.9, 0.15, 200.0)]
    {
        let map_heights = vec![fraction as f32; 40 * 40];
        let map = HeightMap::new(&map_heights, [40, 40], 1.0).unwrap();
        let terrain = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
        let rotation = looking(0.0, tilt, 0.0);
        let at = DVec3::new(20.3, 0.0, fraction) - rotation * DVec3::Z * distance;
        let empty = view(at, rotation, 60.0);
        let crowd = |pixel: u32| {
            // The upper edge of a pixel that shows some of the crowd.
            let edge = DVec2::new(f64::from(pixel % WIDTH) + 0.5, f64::from(pixel / WIDTH));
            let ray = rotation * empty.camera.unproject(edge).unwrap();
            let foot = at - ray * ((at.z - fraction) / ray.z);
            if ray.z < 0.0 && foot.y >= 0.0 { 0.6 } else { 0.0 }
        };
        let values = (0..WIDTH * HEIGHT).map(crowd).collect();
        let heatmap = Heatmap::new(values, HEIGHT as usize, WIDTH as usize).unwrap();
        let view = View { heatmap, ..empty.clone() };
        for coverage in [Coverage::Rays, Coverage::Full] {
            let projection = Projection::new(300.0, 0.0, coverage).unwrap();
            for seen in [project(&view, &terrain, &projection), project_by_rays(&view, &terrain, &projection)]
            {
                let first_row = |id: u32| terrain.index(id)[1] == 0;
                let means = seen.voxel_ids().iter().zip(seen.mean()).filter(|(id, _)| first_row(**id));
                let means: Vec<f64> = means.map(|(_, &mean)| mean).collect();
                assert!(means.len() > 5, "{} voxels, {distance} m away", means.len());
                let least = means.iter().fold(1.0, |least: f64, &mean| least.min(mean));
                assert!(least > 0.3, "{least} at {fraction}, tilt {tilt}, {distance} m away, {coverage:?}");
            }
        }
    }
}

/// Crowd beside the map counts for its rim, which is the nearest ground that the map knows.
#[test]
fn crowd_beside_the_map_is_one_at_its_rim() {
    let map = HeightMap::new(&[0.5; 1600], [40, 40], 1.0).unwrap();
    let terrain = Terrain::from_height_map(&map, 1.0, DVec3::ZERO).unwrap();
    let rotation = looking(0.0, 0.5, 0.0);
    let at = DVec3::new(20.3, 0.0, 0.5) - rotation * DVec3::Z * 30.0;
    let empty = view(at, rotation, 60.0);
    let values: Vec<f32> = (0..WIDTH * HEIGHT)
        .map(|pixel| {
            let ray = rotation * empty.camera.pixel_ray(pixel % WIDTH, pixel / WIDTH).unwrap();
            let foot = at - ray * ((at.z - 0.5) / ray.z);
            f32::from(u8::from((-2.0..0.0).contains(&foot.y)))
        })
        .collect();
    let heatmap = Heatmap::new(values, HEIGHT as usize, WIDTH as usize).unwrap();
    let seen = project(
        &View { heatmap, ..empty.clone() },
        &terrain,
        &Projection::new(300.0, 0.0, Coverage::Full).unwrap(),
    );
    let rim = seen.voxel_ids().iter().zip(seen.mean()).filter(|(id, _)| terrain.index(**id)[1] == 0);
    assert!(
        rim.clone().count() > 5 && rim.clone().all(|(_, &mean)| mean > 0.3),
        "{:?}",
        rim.collect::<Vec<_>>()
    );
}
