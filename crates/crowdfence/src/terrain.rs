//! The known terrain: a sparse voxel surface. Voxel (i, j, k) is the half-open box from
//! `origin + (i, j, k) * voxel_size_m` to `origin + (i + 1, j + 1, k + 1) * voxel_size_m`; ids are ranks in
//! the tree and index every per-voxel array.

mod column_ends;
mod estimate;
pub mod height_map;
mod key;
pub mod octomap;
mod outline;
pub mod outstanding;
mod plane;
mod plane_fit;
mod point_means;
mod solid;
mod surroundings;
mod terraces;
pub(crate) mod tree;
pub mod triangles;
mod upper_envelope;

use std::sync::OnceLock;

use glam::DVec3;
use rayon::prelude::*;

use crate::error::{Error, Result, require};
pub use column_ends::ColumnEnds;
pub use key::TerrainKey;
pub use plane::Plane;
pub(crate) use solid::Solid;
pub use solid::Surface;

use height_map::HeightMap;
use octomap::Octomap;
use outline::Outline;
use point_means::PointMeans;
use tree::{Ascent, MAX_EXTENT, Tree};

/// Voxels of one terrain: ids stay below the two largest u32, which the crowd map uses as marks.
pub const MAX_VOXELS: u64 = 1 << 31;

/// Voxels that an OctoMap may expand to. A file of a hundred bytes can claim 2^48 of them; this many take
/// about 3 GB while they are sorted in.
pub const MAX_OCTOMAP_VOXELS: u64 = 1 << 27;

/// Bound of a height that is given for ground, metres: all of Earth's lies within. The usual marks of missing data
/// (-9999, -32768, 1e30) lie beyond, and would be walls and pits.
pub const MAX_HEIGHT_M: f64 = 9000.0;
/// The same in words.
pub(crate) const MAX_HEIGHT: &str = "9000 m";

/// Bound of a voxel's side, metres. Far larger ones would have distances that no float32 holds.
const MAX_VOXEL_SIZE_M: f64 = 1e6;
/// Bound of the coordinates of a terrain's origin, metres: all of Earth lies within of its middle.
const MAX_ORIGIN_M: f64 = 1e9;

/// What places the grid in the world.
const FRAME: [&str; 4] = ["voxel_size_m", "origin x", "origin y", "origin z"];

/// Grid index of a voxel.
type Index = [i32; 3];

/// The known terrain: voxels, and where in each the surface lies. Never changed once it is made, so views of many
/// drones share one in an `Arc`.
#[derive(Debug, Clone)]
pub struct Terrain {
    origin: DVec3,
    voxel_size_m: f64,
    tree: Tree,
    /// By voxel id. Of a solid, a run of voxels in one column, the uppermost voxel's counts.
    planes: Vec<Plane>,
    /// Grid index of tree coordinate (0, 0, 0): the lowest occupied index of each axis.
    base: [i32; 3],
    /// Occupied extent in voxels along each axis, counted from `base`.
    extent: [u32; 3],
    fingerprint: u64,
    /// Columns (i, j) whose surface nobody measured, sorted and distinct.
    unmeasured: Vec<[i32; 2]>,
    /// Worked out when it is first asked for: only views that lose crowd do.
    outline: OnceLock<Outline>,
}

impl Terrain {
    /// Voxels given by their grid indices; repeated indices count once. Where in them the surface lies is
    /// estimated from the voxels around.
    pub fn from_indices(indices: &[[i32; 3]], voxel_size_m: f64, origin: DVec3) -> Result<Terrain> {
        let terrain = Terrain::of_cubes(indices, voxel_size_m, origin)?;
        let mut planes = estimate::planes(&terrain, None);
        terraces::ramp(&terrain, &mut planes);
        Ok(Terrain { planes, ..terrain })
    }

    /// Voxels given by their grid indices, of which the surface is the upper face.
    fn of_cubes(indices: &[[i32; 3]], voxel_size_m: f64, origin: DVec3) -> Result<Terrain> {
        check_frame(voxel_size_m, origin)?;
        let (base, extent) = bounds(indices)?;
        let depth = depth_for(extent)?;
        if indices.len() as u64 > MAX_VOXELS {
            return Err(Error::TooManyVoxels { count: indices.len() as u64, bound: MAX_VOXELS });
        }
        let mut keys: Vec<u64> = indices
            .par_iter()
            .map(|index| Tree::key(std::array::from_fn(|k| index[k].abs_diff(base[k])), depth))
            .collect();
        keys.par_sort_unstable();
        let tree = Tree::from_sorted_keys(&keys, depth);
        let fingerprint = fingerprint(origin, voxel_size_m, base, &tree);
        let planes = vec![Plane::CEILING; tree.voxel_count()];
        Ok(Terrain {
            origin,
            voxel_size_m,
            tree,
            planes,
            base,
            extent,
            fingerprint,
            unmeasured: Vec::new(),
            outline: OnceLock::new(),
        })
    }

    /// The same voxels with planes by grid index.
    pub(crate) fn with_planes(mut self, plane: impl Fn([i32; 3]) -> Plane + Sync) -> Terrain {
        const CHUNK: usize = 1 << 14;
        let mut planes = std::mem::take(&mut self.planes);
        planes.par_chunks_mut(CHUNK).enumerate().for_each(|(chunk, planes)| {
            let mut ascent = Ascent::new(&self.tree);
            for (id, own) in (chunk * CHUNK..).zip(planes) {
                *own = plane(self.index_at(ascent.coordinate(id as u32)));
            }
        });
        Terrain { planes, ..self }
    }

    /// The same terrain, of which nobody measured the surface in some columns (i, j) besides those known: it was
    /// bridged from what lies around. It holds people and hides ground as any other, and is no place to land on.
    pub fn with_unmeasured(mut self, columns: &[[i32; 2]]) -> Terrain {
        self.unmeasured.extend_from_slice(columns);
        self.unmeasured.sort_unstable();
        self.unmeasured.dedup();
        self
    }

    /// Occupied cells of a row-major [X, Y, Z] array.
    pub fn from_occupancy(
        occupied: &[bool],
        shape: [usize; 3],
        voxel_size_m: f64,
        origin: DVec3,
    ) -> Result<Terrain> {
        let cells = shape.iter().product::<usize>();
        if occupied.len() != cells {
            return Err(Error::Length { name: "occupied", actual: occupied.len(), expected: cells });
        }
        for (axis, &cells) in ['x', 'y', 'z'].iter().zip(&shape) {
            if cells as u64 > MAX_EXTENT {
                return Err(Error::TerrainExtent { axis: *axis, cells: cells as u64, bound: MAX_EXTENT });
            }
        }
        let plane = shape[1] * shape[2];
        let indices: Vec<[i32; 3]> = occupied
            .par_iter()
            .enumerate()
            .filter(|&(_, &occupied)| occupied)
            .map(|(at, _)| [(at / plane) as i32, (at % plane / shape[2]) as i32, (at % shape[2]) as i32])
            .collect();
        Terrain::from_indices(&indices, voxel_size_m, origin)
    }

    /// The closed surface of a height map, see [`height_map::SurfaceColumns`].
    pub fn from_height_map(map: &HeightMap, voxel_size_m: f64, origin: DVec3) -> Result<Terrain> {
        check_frame(voxel_size_m, origin)?;
        let columns = map.columns(voxel_size_m)?;
        let terrain = Terrain::of_cubes(&columns.voxels()?, voxel_size_m, origin)?;
        Ok(terrain.with_planes(|index| columns.plane(index)))
    }

    /// Every voxel that holds at least one of the points (world metres). The surface goes through the mean points of
    /// neighbouring voxels; one point a voxel is enough, and where there is no neighbour, it is level at its height.
    pub fn from_points(points: &[DVec3], voxel_size_m: f64, origin: DVec3) -> Result<Terrain> {
        check_frame(voxel_size_m, origin)?;
        let in_voxels = |&point: &DVec3| (point - origin) / voxel_size_m;
        let indices = points
            .par_iter()
            .enumerate()
            .map(|(index, point)| {
                let cell = in_voxels(point).floor();
                if cell.is_finite() && cell.abs().max_element() < f64::from(i32::MAX) {
                    Ok([cell.x as i32, cell.y as i32, cell.z as i32])
                } else {
                    Err(Error::PointOffGrid { index, x: point.x, y: point.y, z: point.z })
                }
            })
            .collect::<Result<Vec<_>>>()?;
        check_heights("point", points)?;
        let terrain = Terrain::of_cubes(&indices, voxel_size_m, origin)?;
        let means = PointMeans::of(&terrain, points.iter().map(in_voxels), &indices);
        let planes = estimate::planes(&terrain, Some(&means));
        Ok(Terrain { planes, ..terrain })
    }

    /// Every voxel that one of the triangles touches. `vertices` are world metres. The surface is the highest
    /// triangle in a column.
    pub fn from_triangles(
        vertices: &[DVec3],
        triangles: &[[u32; 3]],
        voxel_size_m: f64,
        origin: DVec3,
    ) -> Result<Terrain> {
        check_frame(voxel_size_m, origin)?;
        check_heights("vertex", vertices)?;
        let vertices: Vec<DVec3> = vertices.iter().map(|&vertex| (vertex - origin) / voxel_size_m).collect();
        let indices = triangles::voxelize_triangles(&vertices, triangles)?;
        let terrain = Terrain::of_cubes(&indices, voxel_size_m, origin)?;
        drop(indices);
        let planes = upper_envelope::planes(&terrain, &vertices, triangles);
        Ok(Terrain { planes, ..terrain })
    }

    /// Occupied leaves of an OctoMap, pruned leaves expanded to at most [`MAX_OCTOMAP_VOXELS`]; `origin` is
    /// added to the file's coordinates.
    pub fn from_octomap(map: &Octomap, origin: DVec3) -> Result<Terrain> {
        let indices = map.occupied_voxels(MAX_OCTOMAP_VOXELS)?;
        Terrain::from_indices(&indices, map.header.voxel_size_m, origin)
    }

    /// Voxels with the planes that go with them, as [`Terrain::indices_of`] and [`Terrain::planes`] give them; a
    /// terrain taken apart comes together exactly as it was. Of a repeated voxel, the first plane counts.
    pub fn from_voxels(
        indices: &[[i32; 3]],
        planes: &[Plane],
        voxel_size_m: f64,
        origin: DVec3,
    ) -> Result<Terrain> {
        if planes.len() != indices.len() {
            return Err(Error::Length { name: "planes", actual: planes.len(), expected: indices.len() });
        }
        let mut terrain = Terrain::of_cubes(indices, voxel_size_m, origin)?;
        let id = |&index: &[i32; 3]| terrain.id(index).expect("every index has become a voxel");
        let ids: Vec<u32> = indices.par_iter().map(id).collect();
        for (&id, &plane) in ids.iter().zip(planes).rev() {
            terrain.planes[id as usize] = plane;
        }
        Ok(terrain)
    }

    /// The voxels of two terrains of one grid, with their planes; in a voxel of both, the plane of this one counts.
    pub fn joined(&self, other: &Terrain) -> Result<Terrain> {
        let frame =
            |terrain: &Terrain| [terrain.voxel_size_m, terrain.origin.x, terrain.origin.y, terrain.origin.z];
        for ((name, own), other) in FRAME.into_iter().zip(frame(self)).zip(frame(other)) {
            require(own == other, name, other, "the same in both terrains")?;
        }
        let indices_of =
            |terrain: &Terrain| terrain.indices_of(&Vec::from_iter(0..terrain.voxel_count() as u32));
        let indices = [indices_of(self), indices_of(other)].concat();
        let planes = [self.planes(), other.planes()].concat();
        let joined = Terrain::from_voxels(&indices, &planes, self.voxel_size_m, self.origin)?;
        Ok(joined.with_unmeasured(&self.unmeasured).with_unmeasured(&other.unmeasured))
    }

    /// The same voxels in a frame in which grid index (0, 0, 0) starts at `origin`.
    pub fn with_origin(&self, origin: DVec3) -> Result<Terrain> {
        check_frame(self.voxel_size_m, origin)?;
        let fingerprint = fingerprint(origin, self.voxel_size_m, self.base, &self.tree);
        Ok(Terrain { origin, fingerprint, ..self.clone() })
    }

    /// How many voxels; their ids are 0 to one less.
    pub fn voxel_count(&self) -> usize {
        self.tree.voxel_count()
    }

    /// Side of a voxel, metres.
    pub fn voxel_size_m(&self) -> f64 {
        self.voxel_size_m
    }

    /// Where voxel (0, 0, 0) begins, world metres.
    pub fn origin(&self) -> DVec3 {
        self.origin
    }

    /// Memory of the tree.
    pub fn tree_bytes(&self) -> usize {
        self.tree.bytes()
    }

    /// Memory of tree and planes.
    pub fn bytes(&self) -> usize {
        self.tree.bytes() + size_of_val(self.planes.as_slice())
    }

    /// Heights of the surface over the middle of some voxels, world metres, fastest for sorted ids. Of a voxel under
    /// another one it is its upper face.
    pub fn surface_heights(&self, ids: &[u32]) -> Vec<f64> {
        let height = |(&id, index): (&u32, [i32; 3])| {
            let top = self.top_plane(id, index).map_or(1.0, Plane::height);
            self.origin.z + (f64::from(index[2]) + top) * self.voxel_size_m
        };
        ids.iter().zip(self.indices_of(ids)).map(height).collect()
    }

    /// None when another voxel lies on top.
    pub(crate) fn top_plane(&self, id: u32, [i, j, k]: [i32; 3]) -> Option<Plane> {
        let above = k.checked_add(1).and_then(|k| self.id([i, j, k]));
        above.is_none().then(|| self.plane(id))
    }

    /// Where in voxel `id` the surface lies. It counts where no voxel lies on top.
    pub fn plane(&self, id: u32) -> Plane {
        self.planes[id as usize]
    }

    /// The planes by voxel id.
    pub fn planes(&self) -> &[Plane] {
        &self.planes
    }

    /// Columns (i, j) whose surface nobody measured, sorted.
    pub fn unmeasured(&self) -> &[[i32; 2]] {
        &self.unmeasured
    }

    /// Lowest and highest corner of the occupied voxels, world metres.
    pub fn bounds(&self) -> (DVec3, DVec3) {
        let low = DVec3::from(self.base.map(f64::from));
        let high = low + DVec3::from(self.extent.map(f64::from));
        (self.origin + low * self.voxel_size_m, self.origin + high * self.voxel_size_m)
    }

    /// Id of the voxel at a grid index.
    pub fn id(&self, index: [i32; 3]) -> Option<u32> {
        let [x, y, z] = std::array::from_fn(|axis| self.coordinate(axis, index[axis]));
        self.tree.id([x?, y?, z?])
    }

    /// Grid index of voxel `id`, which must be below `voxel_count`.
    pub fn index(&self, id: u32) -> [i32; 3] {
        self.index_at(self.tree.coordinate(id))
    }

    /// The same for many voxels, at a fraction of the cost where the ids are sorted.
    pub fn indices_of(&self, ids: &[u32]) -> Vec<[i32; 3]> {
        let mut ascent = Ascent::new(&self.tree);
        ids.iter().map(|&id| self.index_at(ascent.coordinate(id))).collect()
    }

    /// Grid index k and id of every voxel (i, j, k), from the lowest upwards.
    pub fn column(&self, i: i32, j: i32) -> impl Iterator<Item = (i32, u32)> {
        let place = self.coordinate(0, i).zip(self.coordinate(1, j));
        let voxels = place.into_iter().flat_map(|(x, y)| self.tree.column(x, y));
        voxels.map(|(z, id)| (self.base[2].wrapping_add_unsigned(z), id))
    }

    /// Centre of voxel `id`, world metres.
    pub fn center(&self, id: u32) -> DVec3 {
        self.center_of(self.index(id))
    }

    fn center_of(&self, index: [i32; 3]) -> DVec3 {
        self.origin + (DVec3::from(index.map(f64::from)) + 0.5) * self.voxel_size_m
    }

    /// Centres of some voxels, fastest for sorted ids.
    pub fn centers(&self, ids: &[u32]) -> Vec<DVec3> {
        self.indices_of(ids).into_iter().map(|index| self.center_of(index)).collect()
    }

    /// Checks an id that came from outside.
    pub fn check_id(&self, id: i64) -> Result<u32> {
        self.key().check_id(id)
    }

    /// What tells it from other terrains.
    pub fn key(&self) -> TerrainKey {
        TerrainKey { fingerprint: self.fingerprint(), voxel_count: self.voxel_count() }
    }

    /// Checksum of geometry and voxels: what indexes voxels by id keeps it to recognise its terrain.
    pub fn fingerprint(&self) -> u64 {
        self.fingerprint
    }

    pub(crate) fn tree(&self) -> &Tree {
        &self.tree
    }

    pub(crate) fn extent(&self) -> [u32; 3] {
        self.extent
    }

    pub(crate) fn outline(&self) -> &Outline {
        self.outline.get_or_init(|| Outline::of(&self.tree, self.extent))
    }

    /// World point -> continuous tree coordinates, in which voxel (a, b, c) is the box from (a, b, c).
    pub(crate) fn tree_from_world(&self, point_world: DVec3) -> DVec3 {
        (point_world - self.origin) / self.voxel_size_m - DVec3::from(self.base.map(f64::from))
    }

    /// Tree coordinate of a grid index along one axis, if it lies inside the occupied extent.
    fn coordinate(&self, axis: usize, index: i32) -> Option<u32> {
        let coordinate = i64::from(index) - i64::from(self.base[axis]);
        (0..i64::from(self.extent[axis])).contains(&coordinate).then_some(coordinate as u32)
    }

    fn index_at(&self, coordinate: [u32; 3]) -> Index {
        std::array::from_fn(|k| self.base[k].wrapping_add_unsigned(coordinate[k]))
    }
}

fn fingerprint(origin: DVec3, voxel_size_m: f64, base: [i32; 3], tree: &Tree) -> u64 {
    let mut geometry = crc32fast::Hasher::new();
    let numbers = origin.to_array().into_iter().chain([voxel_size_m]);
    numbers.for_each(|number| geometry.update(&number.to_bits().to_le_bytes()));
    base.iter().for_each(|index| geometry.update(&index.to_le_bytes()));
    u64::from(geometry.finalize()) << 32 | u64::from(tree.checksum())
}

fn check_frame(voxel_size_m: f64, origin: DVec3) -> Result<()> {
    require(voxel_size_m.is_finite() && voxel_size_m > 0.0, "voxel_size_m", voxel_size_m, "finite and > 0")?;
    require(voxel_size_m <= MAX_VOXEL_SIZE_M, "voxel_size_m", voxel_size_m, "at most 1000 km")?;
    for (name, value) in FRAME.into_iter().skip(1).zip(origin.to_array()) {
        require(value.is_finite(), name, value, "finite")?;
        require(value.abs() <= MAX_ORIGIN_M, name, value, "within a million km")?;
    }
    Ok(())
}

/// Refuses points of which one is higher or lower than ground; what is not finite is found where it is placed.
fn check_heights(what: &'static str, points: &[DVec3]) -> Result<()> {
    match points.par_iter().position_first(|point| point.z.is_finite() && point.z.abs() > MAX_HEIGHT_M) {
        None => Ok(()),
        Some(index) => Err(Error::NoGround { what, index, height: points[index].z }),
    }
}

fn bounds(indices: &[[i32; 3]]) -> Result<([i32; 3], [u32; 3])> {
    let (low, high) = indices
        .par_iter()
        .map(|&index| (index, index))
        .reduce_with(|a, b| {
            (std::array::from_fn(|k| a.0[k].min(b.0[k])), std::array::from_fn(|k| a.1[k].max(b.1[k])))
        })
        .ok_or(Error::EmptyTerrain)?;
    // An extent that overflows is refused by `depth_for`, which allows far less.
    Ok((low, std::array::from_fn(|k| high[k].abs_diff(low[k]).saturating_add(1))))
}

fn depth_for(extent: [u32; 3]) -> Result<u32> {
    let (axis, cells) = ['x', 'y', 'z']
        .into_iter()
        .zip(extent.map(u64::from))
        .max_by_key(|&(_, cells)| cells)
        .expect("three axes");
    Tree::depth_for(cells).ok_or(Error::TerrainExtent { axis, cells, bound: MAX_EXTENT })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn occupancy_cells_become_voxels_at_their_place() {
        let mut occupied = vec![false; 2 * 3 * 4];
        occupied[4 * 3 + 4 * 2 + 3] = true; // (1, 2, 3) of a [2, 3, 4] array
        let terrain =
            Terrain::from_occupancy(&occupied, [2, 3, 4], 0.5, DVec3::new(10.0, 20.0, 30.0)).unwrap();
        assert_eq!(terrain.voxel_count(), 1);
        assert_eq!(terrain.index(0), [1, 2, 3]);
        assert_eq!(terrain.center(0), DVec3::new(10.75, 21.25, 31.75));
        assert_eq!(terrain.bounds(), (DVec3::new(10.5, 21.0, 31.5), DVec3::new(11.0, 21.5, 32.0)));
    }

    #[test]
    fn points_far_from_the_origin_keep_their_voxel() {
        let utm = DVec3::new(4.5e5, 5.2e6, 1.2e3);
        let points = [utm + DVec3::new(0.24, 0.26, -0.01), utm + DVec3::new(0.1, 0.3, -0.2)];
        let terrain = Terrain::from_points(&points, 0.25, DVec3::ZERO).unwrap();
        assert_eq!(terrain.voxel_count(), 1);
        assert_eq!(terrain.index(0), [1_800_000, 20_800_001, 4_799]);
        assert_eq!(terrain.id([1_800_000, 20_800_001, 4_799]), Some(0));
        assert_eq!(terrain.id([1_800_000, 20_800_001, 4_800]), None);
    }

    #[test]
    fn the_surface_lies_on_the_points() {
        // A point in every column of a plane that rises by 1 in 2 along x, none at the centre of its column.
        let columns = (0..100).map(|n| [f64::from(n / 10), f64::from(n % 10)]);
        let points: Vec<DVec3> = columns
            .map(|[i, j]| (i + 0.1 + 0.08 * j, j + 0.9 - 0.08 * i))
            .map(|(x, y)| DVec3::new(x, y, 0.3 + x / 2.0))
            .collect();
        let terrain = Terrain::from_points(&points, 1.0, DVec3::ZERO).unwrap();
        for point in points {
            let index = point.to_array().map(|c| c as i32);
            let plane = terrain.plane(terrain.id(index).unwrap());
            let height = 0.3 + (point.x.floor() + 0.5) / 2.0 - point.z.floor();
            assert!((plane.height() - height).abs() < 1e-3, "{plane:?} at {index:?} instead of {height}");
            assert_eq!(plane.slope(), [0.5, 0.0]);
        }
    }

    #[test]
    fn points_that_stand_alone_give_a_level_surface_at_their_mean_height() {
        let points = [[0.5, 0.5, 3.25], [0.9, 0.1, 3.75], [90.2, 7.0, -0.75]].map(DVec3::from);
        let terrain = Terrain::from_points(&points, 1.0, DVec3::ZERO).unwrap();
        assert_eq!(terrain.plane(terrain.id([0, 0, 3]).unwrap()), Plane::new(0.5, [0.0; 2]));
        assert_eq!(terrain.plane(terrain.id([90, 7, -1]).unwrap()), Plane::new(0.25, [0.0; 2]));
    }

    #[test]
    fn a_terrain_taken_apart_comes_together_as_it_was() {
        let corners = [[0.0, 0.0, 0.0], [9.0, 0.0, 4.0], [0.0, 9.0, -3.0]].map(DVec3::from);
        let terrain = Terrain::from_triangles(&corners, &[[0, 1, 2]], 1.0, DVec3::X).unwrap();
        let ids: Vec<u32> = (0..terrain.voxel_count() as u32).rev().collect();
        let planes: Vec<Plane> = ids.iter().map(|&id| terrain.plane(id)).collect();
        let again = Terrain::from_voxels(&terrain.indices_of(&ids), &planes, 1.0, DVec3::X).unwrap();
        assert_eq!((again.fingerprint(), again.planes()), (terrain.fingerprint(), terrain.planes()));
        let short = Terrain::from_voxels(&[[0; 3]; 2], &[Plane::CEILING], 1.0, DVec3::ZERO);
        assert_eq!(short.unwrap_err().to_string(), "planes has 1 values; 2 are needed");
    }

    #[test]
    fn joined_terrains_keep_their_planes() {
        let points = |points: &[[f64; 3]]| {
            let points: Vec<DVec3> = points.iter().map(|&point| point.into()).collect();
            Terrain::from_points(&points, 1.0, DVec3::ZERO).unwrap()
        };
        let ground = points(&[[0.5, 0.5, 0.25], [8.5, 0.5, 0.25]]);
        let canopy = points(&[[0.5, 0.5, 0.75], [8.5, 0.5, 1.75]]);
        let joined = ground.joined(&canopy).unwrap();
        assert_eq!(joined.voxel_count(), 3);
        let height = |index| joined.plane(joined.id(index).unwrap()).height();
        // The ground's where it has a voxel as well; the canopy's where it stands on top.
        assert_eq!([height([0, 0, 0]), height([8, 0, 0]), height([8, 0, 1])], [0.25, 0.25, 0.75]);
        let moved = canopy.with_origin(DVec3::Y).unwrap();
        let refusal = ground.joined(&moved).unwrap_err().to_string();
        assert_eq!(refusal, "origin y is 1; it must be the same in both terrains");
    }

    #[test]
    fn what_nobody_measured_stays_known_as_such() {
        let row = [[0, 0, 0], [1, 0, 0], [2, 0, 0]];
        let terrain = Terrain::from_indices(&row, 1.0, DVec3::ZERO).unwrap();
        assert_eq!(terrain.unmeasured(), [[0; 2]; 0]);
        let bridged = terrain.clone().with_unmeasured(&[[2, 0], [0, 0]]).with_unmeasured(&[[0, 0]]);
        assert_eq!(bridged.unmeasured(), [[0, 0], [2, 0]]);
        assert_eq!(bridged.fingerprint(), terrain.fingerprint());
        assert_eq!(bridged.with_origin(DVec3::X).unwrap().unmeasured(), bridged.unmeasured());
        let other = terrain.clone().with_unmeasured(&[[1, 0]]);
        assert_eq!(other.joined(&bridged).unwrap().unmeasured(), [[0, 0], [1, 0], [2, 0]]);
    }

    #[test]
    fn what_cannot_be_a_terrain_is_refused_with_its_value() {
        let refused = |result: Result<Terrain>| result.unwrap_err().to_string();
        assert!(refused(Terrain::from_indices(&[], 1.0, DVec3::ZERO)).contains("no occupied voxel"));
        assert!(
            refused(Terrain::from_indices(&[[0; 3]], 0.0, DVec3::ZERO))
                .contains("voxel_size_m is 0; it must be finite and > 0")
        );
        for (size_m, east_m, words) in [
            (1e300, 0.0, "voxel_size_m is 1e300; it must be at most 1000 km"),
            (1.0, -1e300, "origin x is -1e300; it must be within a million km"),
            (f64::NAN, 0.0, "voxel_size_m is NaN; it must be finite and > 0"),
            (1.0, f64::NAN, "origin x is NaN; it must be finite"),
        ] {
            let message = refused(Terrain::from_indices(&[[0; 3]], size_m, DVec3::X * east_m));
            assert!(message.contains(words), "{message}");
        }
        let far = [[0; 3], [0, 1 << 20, 0]];
        assert!(refused(Terrain::from_indices(&far, 1.0, DVec3::ZERO)).contains("1048577 voxels along y"));
        let nan = [DVec3::ZERO, DVec3::new(0.0, f64::NAN, 0.0)];
        assert!(refused(Terrain::from_points(&nan, 1.0, DVec3::ZERO)).contains("point 1 at (0, NaN, 0)"));
        let mark = [DVec3::ZERO, DVec3::X, DVec3::new(0.0, 1.0, -32768.0)];
        let words = " 2 has the height -32768; heights of ground are within 9000 m.";
        assert!(refused(Terrain::from_points(&mark, 1.0, DVec3::ZERO)).starts_with(&format!("point{words}")));
        let triangles = Terrain::from_triangles(&mark, &[[0, 1, 2]], 1.0, DVec3::ZERO);
        assert!(refused(triangles).starts_with(&format!("vertex{words}")));
    }

    #[test]
    fn the_fingerprint_tells_terrains_apart() {
        let one = Terrain::from_indices(&[[0, 0, 0], [1, 0, 0]], 1.0, DVec3::ZERO).unwrap();
        let other_voxel = Terrain::from_indices(&[[0, 0, 0], [2, 0, 0]], 1.0, DVec3::ZERO).unwrap();
        let moved = one.with_origin(DVec3::X).unwrap();
        assert_eq!(one.fingerprint(), one.clone().fingerprint());
        assert_ne!(one.fingerprint(), other_voxel.fingerprint());
        assert_ne!(one.fingerprint(), moved.fingerprint());
        assert_eq!(moved.with_origin(DVec3::ZERO).unwrap().fingerprint(), one.fingerprint());
    }

    #[test]
    fn a_column_is_told_in_grid_indices() {
        let voxels = [[-5, 7, -90], [-5, 7, 3], [-5, 7, 40], [60, 8, 0]];
        let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
        let column = |i, j| terrain.column(i, j).collect::<Vec<_>>();
        let expected = |voxel: [i32; 3]| (voxel[2], terrain.id(voxel).unwrap());
        assert_eq!(column(-5, 7), [expected(voxels[0]), expected(voxels[1]), expected(voxels[2])]);
        assert_eq!(column(60, 8), [expected(voxels[3])]);
        for (i, j) in [(-5, 8), (-4, 7), (-6, 7), (61, 8), (-5, i32::MAX), (i32::MIN, 7)] {
            assert_eq!(column(i, j), [], "({i}, {j})");
        }
    }

    proptest! {
        #[test]
        fn many_indices_are_those_of_single_look_ups(
            voxels in prop::collection::vec(prop::array::uniform3(-90i32..90), 1..200),
            picks in prop::collection::vec(any::<prop::sample::Index>(), 0..100),
        ) {
            let terrain = Terrain::from_indices(&voxels, 1.0, DVec3::ZERO).unwrap();
            let all: Vec<u32> = (0..terrain.voxel_count() as u32).collect();
            let some: Vec<u32> = picks.iter().map(|pick| *pick.get(&all)).collect();
            for ids in [all, some] {
                let singly: Vec<[i32; 3]> = ids.iter().map(|&id| terrain.index(id)).collect();
                prop_assert_eq!(terrain.indices_of(&ids), singly);
            }
        }
    }
}
