use std::sync::Arc;
use std::time::Instant;
use crowdfence::terrain::height_map::HeightMap;
use crowdfence::view::Pose;
use crowdfence::{Camera, Coverage, Distortion, Heatmap, Projection, Terrain, View, project};
use glam::{DMat3, DVec3};
fn cpu_ns() -> f64 {
    std::fs::read_to_string("/proc/thread-self/schedstat").unwrap().split(' ').next().unwrap().parse().unwrap()
}
fn main() {
    let n = 2000usize;
    let mut heights = vec![0f32; n * n];
    let hash = |a: usize, b: usize| (a.wrapping_mul(73856093) ^ b.wrapping_mul(19349663)).wrapping_mul(2654435761) >> 7;
    for i in 0..n { for j in 0..n {
        let (x, y) = (i as f64 * 0.5, j as f64 * 0.5);
        let mut z = 20.0 * (x / 110.0).sin() * (y / 140.0).cos() + 4.0 * (x / 31.0 + y / 23.0).sin() + 0.4 * (x / 5.0).sin() * (y / 4.0).cos();
        let (ci, cj) = (i / 200, j / 200);
        let h = hash(ci, cj);
        let (bx, by) = (40 + h % 100, 40 + h / 128 % 100);
        let (li, lj) = (i % 200, j % 200);
        if li >= bx && li < bx + 24 && lj >= by && lj < by + 30 { z += 6.0 + (h % 20) as f64; }
        heights[i * n + j] = z as f32;
    } }
    let map = HeightMap::new(&heights, [n, n], 0.5).unwrap();
    let t = Instant::now();
    let terrain = Terrain::from_height_map(&map, 0.5, DVec3::ZERO).unwrap();
    println!("build {:?} {} voxels {:.2} B/voxel", t.elapsed(), terrain.voxel_count(), terrain.bytes() as f64 / terrain.voxel_count() as f64);
    for (w, h) in [(640u32, 480u32), (1920, 1080)] {
        for (tilt, above) in [(45.0f64, 80.0), (20.0, 30.0), (10.0, 30.0), (90.0, 80.0)] {
            let t = tilt.to_radians();
            let (heading, at) = (0.4f64, DVec3::new(500.3, 480.7, 40.0 + above));
            let f = DVec3::new(heading.sin() * t.cos(), heading.cos() * t.cos(), -t.sin());
            let r = DVec3::new(heading.cos(), -heading.sin(), 0.0);
            let rotation = DMat3::from_cols(r, f.cross(r), f);
            let focal = f64::from(w) / 2.0;
            let camera = Camera::new(w, h, focal, focal, f64::from(w) / 2.0, f64::from(h) / 2.0, Distortion::None).unwrap();
            let heat = (0..w * h).map(|p| (p % 97) as f32 / 194.0).collect();
            let view = View::new("d", 0, Arc::new(camera), Pose { rotation, translation: at }, Heatmap::new(heat, h as usize, w as usize).unwrap()).unwrap();
            for coverage in [Coverage::Rays, Coverage::Full] {
                let projection = Projection::new(300.0, 0.0, coverage).unwrap();
                let mut best = f64::MAX;
                let mut seen = 0;
                for _ in 0..12 {
                    let t = cpu_ns();
                    let o = project(&view, &terrain, &projection);
                    best = best.min((cpu_ns() - t) / 1e6);
                    seen = o.voxel_ids().len();
                }
                println!("{w}x{h} tilt {tilt}: {coverage:?} {best:.1} ms, {seen} voxels, {:.0} ns each", best * 1e6 / seen as f64);
            }
        }
    }
}
