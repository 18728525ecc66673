//! Painting the terrain stays many times cheaper than casting the ray of every pixel, which means the same. Both are
//! timed here, in the CPU time of one thread of one run: a ratio, whatever the machine does besides. Benchmarks tell
//! figures; this tells when a change has lost the fast way.

use std::sync::Arc;

use crowdfence::terrain::height_map::HeightMap;
use crowdfence::view::Pose;
use crowdfence::{
    Camera, Coverage, Distortion, Heatmap, Observation, Projection, Terrain, View, project, project_by_rays,
};
use glam::{DMat3, DVec3};

/// Of a build for tests, on open hills: half of the least that it was on a busy machine. Without the fast way it would be 1.
const LEAST_RATIO: f64 = 8.0;

/// A painting is so short that whatever else the machine does can double the time of a few; a cast is as long as many.
const PAINTINGS_PER_CAST: usize = 10;
const CASTS: usize = 3;

/// Cells along each side of the hills, of 0.5 m.
const SIDE: usize = 600;

/// Hills of 300 x 300 m.
fn height_m(x: f64, y: f64) -> f64 {
    8.0 * (x / 40.0).sin() * (y / 55.0).cos() + 0.5 * (x / 6.0 + y / 9.0).sin()
}

/// One voxel in most columns.
fn hills() -> Terrain {
    let height = |cell: usize| height_m((cell / SIDE) as f64 * 0.5, (cell % SIDE) as f64 * 0.5) as f32;
    let heights: Vec<f32> = (0..SIDE * SIDE).map(height).collect();
    let map = HeightMap::new(&heights, [SIDE, SIDE], 0.5).unwrap();
    Terrain::from_height_map(&map, 0.5, DVec3::ZERO).unwrap()
}

/// The same as a mesh: on slopes two voxels in a column, and planes that meet but for their roundings.
fn hills_of_triangles() -> Terrain {
    let row = SIDE as u32 + 1;
    let vertex = |at: u32| {
        let (x, y) = (f64::from(at / row) * 0.5, f64::from(at % row) * 0.5);
        DVec3::new(x, y, height_m(x, y))
    };
    let vertices: Vec<DVec3> = (0..row * row).map(vertex).collect();
    let squares = (0..row - 1).flat_map(|i| (0..row - 1).map(move |j| i * row + j));
    let triangles: Vec<[u32; 3]> =
        squares.flat_map(|low| [[low, low + row, low + 1], [low + 1, low + row, low + row + 1]]).collect();
    Terrain::from_triangles(&vertices, &triangles, 0.5, DVec3::ZERO).unwrap()
}

/// From 50 m above the middle, 35 degrees down.
fn view() -> View {
    let (width, height) = (640, 480);
    let (sin, cos) = 35f64.to_radians().sin_cos();
    let forward = DVec3::new(0.0, cos, -sin);
    let rotation = DMat3::from_cols(DVec3::X, forward.cross(DVec3::X), forward);
    let camera = Camera::new(width, height, 320.0, 320.0, 320.0, 240.0, Distortion::None).unwrap();
    let values = (0..width * height).map(|pixel| (pixel % 97) as f32 / 200.0).collect();
    let heatmap = Heatmap::new(values, height as usize, width as usize).unwrap();
    let pose = Pose::new(rotation, DVec3::new(150.0, 120.0, 50.0)).unwrap();
    View::new("drone", 0, Arc::new(camera), pose, heatmap).unwrap()
}

/// CPU time of this thread so far; None where the system does not tell.
fn cpu_s() -> Option<f64> {
    let told = std::fs::read_to_string("/proc/thread-self/schedstat").ok()?;
    Some(told.split(' ').next()?.parse::<f64>().ok()? * 1e-9)
}

fn cpu_s_of(look: impl Fn() -> Observation) -> Option<f64> {
    let start = cpu_s()?;
    std::hint::black_box(look());
    Some(cpu_s()? - start)
}

#[test]
fn painting_is_many_times_cheaper_than_casting() {
    for (name, terrain) in [("height map", hills()), ("mesh", hills_of_triangles())] {
        is_many_times_cheaper(name, &terrain);
    }
}

fn is_many_times_cheaper(name: &str, terrain: &Terrain) {
    let view = view();
    let projection = Projection::new(300.0, 0.0, Coverage::Rays).unwrap();
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let (mut painted_s, mut cast_s) = (f64::INFINITY, f64::INFINITY);
    let timed = one_thread.install(|| {
        for _ in 0..CASTS {
            for _ in 0..PAINTINGS_PER_CAST {
                painted_s = painted_s.min(cpu_s_of(|| project(&view, terrain, &projection))?);
            }
            cast_s = cast_s.min(cpu_s_of(|| project_by_rays(&view, terrain, &projection))?);
        }
        Some(())
    });
    if timed.is_none() {
        return;
    }
    let ratio = cast_s / painted_s;
    println!("{name}: painted {:.1} ms, cast {:.1} ms: {ratio:.1} x", 1e3 * painted_s, 1e3 * cast_s);
    assert!(
        ratio >= LEAST_RATIO,
        "{name}: casting takes {ratio:.1} times as long as painting, less than {LEAST_RATIO}"
    );
}
