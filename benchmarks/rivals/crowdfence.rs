//! crowdfence as one of the rivals: the same files, the same orders (see `rival.h`), the public API and nothing else.
//! It starts first: before it takes orders it writes the voxels of the scene, from which the others number the cells.

use std::error::Error;
use std::fs::File;
use std::io::{self, BufRead, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use crowdfence::method::{DecayUnit, Initial};
use crowdfence::terrain::Surface;
use crowdfence::terrain::height_map::HeightMap;
use crowdfence::view::Pose;
use crowdfence::{
    Camera, Coverage, CrowdMap, Distortion, Heatmap, Method, Observation, OpinionPool, Paper, Projection,
    Rates, TemporalBlend, Terrain, Unseen, Update, View, project,
};
use glam::DVec3;
use rayon::prelude::*;
use rayon::{ThreadPool, ThreadPoolBuilder};
use rustix::time::{ClockId, clock_gettime};

type Result<T> = std::result::Result<T, Box<dyn Error>>;

const MAX_RANGE_M: f64 = 300.0;
const PICTURES: usize = 12;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().collect();
    let folder = PathBuf::from(&arguments[1]);
    let scene = Scene::read(&folder)?;
    let start = Instant::now();
    let terrain = Arc::new(scene.terrain()?);
    let build_s = start.elapsed().as_secs_f64();
    let columns = Columns::of(&terrain, scene.shape);
    columns.write(&folder, terrain.voxel_size_m())?;
    println!(
        "{{\"build_s\": {build_s}, \"voxels\": {}, \"tree_mb\": {}}}",
        columns.levels.len(),
        megabytes(&terrain)
    );
    let mut bench = Bench::new(folder, terrain, columns)?;
    for line in io::stdin().lock().lines() {
        let line = line?;
        println!("{}", bench.obey(&line.split_whitespace().collect::<Vec<_>>())?);
    }
    Ok(())
}

fn megabytes(terrain: &Terrain) -> f64 {
    terrain.tree_bytes() as f64 / 1e6
}

struct Scene {
    shape: [usize; 2],
    cell_size_m: f64,
    heights_m: Vec<f32>,
    vertices: Vec<DVec3>,
    triangles: Vec<[u32; 3]>,
}

impl Scene {
    fn read(folder: &Path) -> Result<Scene> {
        let mut file = File::open(folder.join("scene.bin"))?;
        let shape = [u32::from_le_bytes(bytes(&mut file)?), u32::from_le_bytes(bytes(&mut file)?)];
        let shape = shape.map(|cells| cells as usize);
        let cell_size_m = f64::from_le_bytes(bytes(&mut file)?);
        let [vertices, triangles] =
            [u64::from_le_bytes(bytes(&mut file)?), u64::from_le_bytes(bytes(&mut file)?)];
        let heights_m = numbers(&mut file, shape[0] * shape[1], f32::from_le_bytes)?;
        let vertices = numbers(&mut file, 3 * vertices as usize, f32::from_le_bytes)?;
        let triangles = numbers(&mut file, 3 * triangles as usize, u32::from_le_bytes)?;
        Ok(Scene {
            shape,
            cell_size_m,
            heights_m,
            vertices: vertices
                .chunks_exact(3)
                .map(|v| DVec3::new(v[0].into(), v[1].into(), v[2].into()))
                .collect(),
            triangles: triangles.chunks_exact(3).map(|t| [t[0], t[1], t[2]]).collect(),
        })
    }

    /// The height map and what overhangs it, voxels as large as the cells of the map.
    fn terrain(&self) -> Result<Terrain> {
        let (voxel_size_m, origin) = (self.cell_size_m, DVec3::ZERO);
        let map = HeightMap::new(&self.heights_m, self.shape, self.cell_size_m)?;
        let ground = Terrain::from_height_map(&map, voxel_size_m, origin)?;
        if self.triangles.is_empty() {
            return Ok(ground);
        }
        let above = Terrain::from_triangles(&self.vertices, &self.triangles, voxel_size_m, origin)?;
        Ok(ground.joined(&above)?)
    }
}

/// The voxels column by column, from south-west to north-east and upwards: the order in which all rivals count cells.
struct Columns {
    shape: [usize; 2],
    start: Vec<u32>,
    levels: Vec<i16>,
}

impl Columns {
    fn of(terrain: &Terrain, shape: [usize; 2]) -> Columns {
        let mut columns =
            Columns { shape, start: vec![0], levels: Vec::with_capacity(terrain.voxel_count()) };
        for column in 0..shape[0] * shape[1] {
            let (i, j) = (column / shape[1], column % shape[1]);
            let voxels = terrain.column(i as i32, j as i32);
            columns.levels.extend(voxels.map(|(level, _)| level as i16));
            columns.start.push(columns.levels.len() as u32);
        }
        assert_eq!(columns.levels.len(), terrain.voxel_count(), "voxels outside the height map");
        columns
    }

    fn cell(&self, [i, j, k]: [i32; 3]) -> u32 {
        let column = i as usize * self.shape[1] + j as usize;
        let (first, end) = (self.start[column], self.start[column + 1]);
        let levels = &self.levels[first as usize..end as usize];
        first + levels.binary_search(&(k as i16)).expect("a voxel of the terrain") as u32
    }

    fn write(&self, folder: &Path, voxel_size_m: f64) -> Result<()> {
        let mut file = BufWriter::new(File::create(folder.join("columns.bin"))?);
        self.shape.iter().try_for_each(|&cells| file.write_all(&(cells as u32).to_le_bytes()))?;
        file.write_all(&voxel_size_m.to_le_bytes())?;
        self.start.iter().try_for_each(|start| file.write_all(&start.to_le_bytes()))?;
        self.levels.iter().try_for_each(|level| file.write_all(&level.to_le_bytes()))?;
        Ok(file.flush()?)
    }
}

struct Bench {
    folder: PathBuf,
    terrain: Arc<Terrain>,
    columns: Columns,
    pools: [ThreadPool; 2],
    /// What `map` was made for: mode and drones.
    made_for: (String, usize),
    map: CrowdMap,
    /// What `views` shows: name and width.
    shown: (String, u32),
    views: Vec<View>,
    stamp_ns: i64,
}

impl Bench {
    fn new(folder: PathBuf, terrain: Arc<Terrain>, columns: Columns) -> Result<Bench> {
        let pool = |threads| ThreadPoolBuilder::new().num_threads(threads).build();
        let (made_for, map) = (("rays".to_string(), 1), crowd_map(&terrain, "rays", 1)?);
        let (pools, shown) = ([pool(1)?, pool(2)?], (String::new(), 0));
        Ok(Bench { folder, terrain, columns, pools, made_for, map, shown, views: Vec::new(), stamp_ns: 0 })
    }

    fn obey(&mut self, words: &[&str]) -> Result<String> {
        let &[order, mode, name, width, height, ref others @ ..] = words else {
            return Err("an order has at least five words".into());
        };
        self.show(name, width.parse()?, height.parse()?)?;
        if order == "dump" {
            self.dump(mode, others[0].parse()?, others[1])?;
            return Ok("{}".to_string());
        }
        let [drones, threads, _, instants] = [0, 1, 2, 3].map(|at| others[at].parse::<usize>());
        let (drones, threads) = (drones?, threads?);
        self.make_map(mode, drones)?;
        let times = (0..instants?).map(|at| self.instant(mode, at * drones..(at + 1) * drones, threads));
        Ok(format!("[{}]", times.collect::<Result<Vec<_>>>()?.join(", ")))
    }

    fn instant(&mut self, mode: &str, views: std::ops::Range<usize>, threads: usize) -> Result<String> {
        self.stamp_ns += 100_000_000;
        for (drone, view) in self.views[views.clone()].iter_mut().enumerate() {
            let (pose, heatmap) = (view.world_from_camera(), view.heatmap().clone());
            *view = View::new(format!("drone {drone}"), self.stamp_ns, view.camera().clone(), pose, heatmap)?;
        }
        let (terrain, views, map) = (&self.terrain, &self.views[views], &mut self.map);
        let (projection, stamp_ns) = (projection(mode)?, self.stamp_ns);
        let (cpu, wall) = (cpu_ms(), Instant::now());
        let (projected, update) = self.pools[threads - 1].install(|| -> (f64, crowdfence::Result<Update>) {
            let observations: Vec<Observation> =
                views.par_iter().map(|view| project(view, terrain, &projection)).collect();
            (cpu_ms(), map.integrate_observations(observations, stamp_ns))
        });
        let (integrated, wall_ms) = (cpu_ms(), wall.elapsed().as_secs_f64() * 1e3);
        Ok(format!(
            "{{\"rays\": {}, \"average\": 0, \"fuse\": {}, \"cpu\": {}, \"wall\": {wall_ms}, \"touched\": {}}}",
            projected - cpu,
            integrated - projected,
            integrated - cpu,
            update?.voxel_ids.len(),
        ))
    }

    /// Per cell of one view: u32 cell, u32 pixels, f32 mean, f32 probability after this first instant.
    fn dump(&mut self, mode: &str, view: usize, path: &str) -> Result<()> {
        let view = &self.views[view];
        let mut map = crowd_map(&self.terrain, mode, 1)?;
        let update = map.integrate(std::slice::from_ref(view), view.stamp_ns())?;
        let seen = update.observations[0].seen();
        let mut file = BufWriter::new(File::create(path)?);
        for (at, index) in self.terrain.indices_of(&seen.ids).into_iter().enumerate() {
            file.write_all(&self.columns.cell(index).to_le_bytes())?;
            file.write_all(&seen.pixel_count[at].to_le_bytes())?;
            file.write_all(&(seen.mean[at] as f32).to_le_bytes())?;
            file.write_all(&(update.probability[at] as f32).to_le_bytes())?;
        }
        Ok(file.flush()?)
    }

    fn make_map(&mut self, mode: &str, drones: usize) -> Result<()> {
        let wanted = (mode.to_string(), drones);
        if wanted != self.made_for {
            (self.map, self.made_for) = (crowd_map(&self.terrain, mode, drones)?, wanted);
        }
        Ok(())
    }

    fn show(&mut self, name: &str, width: u32, height: u32) -> Result<()> {
        let wanted = (name.to_string(), width);
        if wanted != self.shown {
            (self.views, self.shown) = (read_views(&self.folder, name, width, height)?, wanted);
        }
        Ok(())
    }
}

/// `mode` names the coverage.
/// "rays" and "full" onto the surface, "voxels" by rays onto the cubes. No pixel counts as lost crowd: no rival says what
/// became of the pixels that meet no ground, and these heatmaps would have thousands of them.
fn projection(mode: &str) -> Result<Projection> {
    let coverage = if mode == "full" { Coverage::Full } else { Coverage::Rays };
    let surface = if mode == "voxels" { Surface::Voxels } else { Surface::Planes };
    Ok(Projection::new(MAX_RANGE_M, 0.0, coverage)?.with_surface(surface).with_crowd_threshold(1.0)?)
}

/// The parameters are those of `Fusion` in `rival.h`.
fn crowd_map(terrain: &Arc<Terrain>, mode: &str, drones: usize) -> Result<CrowdMap> {
    let pool = OpinionPool::new(Rates::new(0.9, 0.05)?, 0.2, 0.5, Unseen::Fleet, false)?;
    let blend = TemporalBlend::new(0.1, 0.05)?;
    let paper = Paper::new(pool, blend, drones, Initial::Zero, DecayUnit::Second)?;
    Ok(CrowdMap::new(terrain.clone(), Method::Paper(paper), projection(mode)?, f64::INFINITY)?)
}

fn read_views(folder: &Path, name: &str, width: u32, height: u32) -> Result<Vec<View>> {
    let mut heat = File::open(folder.join(format!("../heatmaps-{width}x{height}.bin")))?;
    let pixels = width as usize * height as usize;
    let pictures = (0..PICTURES)
        .map(|_| {
            let mut values = vec![0; pixels];
            heat.read_exact(&mut values)?;
            Ok(Heatmap::from_u8(&values, height as usize, width as usize)?)
        })
        .collect::<Result<Vec<_>>>()?;
    let mut file = File::open(folder.join(format!("{name}.bin")))?;
    let count = u32::from_le_bytes(bytes(&mut file)?) as usize;
    let focal_px = f64::from_le_bytes(bytes(&mut file)?) * f64::from(width);
    let (cx, cy) = (f64::from(width) / 2.0, f64::from(height) / 2.0);
    let camera = Arc::new(Camera::new(width, height, focal_px, focal_px, cx, cy, Distortion::None)?);
    (0..count)
        .map(|at| {
            let pose = numbers(&mut file, 12, f64::from_le_bytes)?;
            let row = |row: usize| std::array::from_fn(|column| pose[4 * row + column]);
            let pose = Pose::from_matrix(&[row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]])?;
            Ok(View::new("drone 0", 0, camera.clone(), pose, pictures[at % PICTURES].clone())?)
        })
        .collect()
}

fn bytes<const N: usize>(file: &mut File) -> Result<[u8; N]> {
    let mut bytes = [0; N];
    file.read_exact(&mut bytes)?;
    Ok(bytes)
}

fn numbers<T, const N: usize>(file: &mut File, count: usize, from_bytes: fn([u8; N]) -> T) -> Result<Vec<T>> {
    let mut bytes = vec![0; count * N];
    file.read_exact(&mut bytes)?;
    Ok(bytes.chunks_exact(N).map(|number| from_bytes(number.try_into().expect("N bytes"))).collect())
}

/// CPU time of all threads.
fn cpu_ms() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 * 1e3 + time.tv_nsec as f64 * 1e-6
}
