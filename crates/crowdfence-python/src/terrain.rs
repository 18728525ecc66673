use std::array;
use std::borrow::Cow;
use std::sync::{Arc, RwLock};

use crowdfence::Terrain;
use crowdfence::terrain::Plane;
use crowdfence::terrain::height_map::HeightMap;
use crowdfence::terrain::octomap;
use crowdfence::terrain::outstanding;
use glam::DVec3;
use numpy::{IntoPyArray, PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arrays::{Array, id_array, origin, points, refuse, rows};
use crate::errors::CrowdfenceError;
use crate::observation::surface;
use crate::released::released;

/// The known terrain: a sparse voxel surface.
///
/// Voxel (i, j, k) is the half-open box from origin + (i, j, k) * voxel_size_m to
/// origin + (i + 1, j + 1, k + 1) * voxel_size_m, in world metres. Voxel ids are ranks 0 .. voxel_count - 1
/// in the terrain's tree and index every per-voxel array.
///
/// `Terrain.open` reads map files, the `from_` constructors take arrays; all of them raise CrowdfenceError
/// for a terrain without a voxel, with more than 2^31 of them or more than 2^20 along an axis, for a
/// voxel_size_m that is not positive, for values that are not finite, for heights beyond +-9000 m, which no
/// ground has, and for arrays of another shape or element type. The voxels cannot change. A terrain can be
/// pickled (16 bytes per voxel).
#[pyclass(frozen, name = "Terrain", module = "crowdfence")]
pub struct PyTerrain {
    pub terrain: Arc<Terrain>,
    georeference: RwLock<Option<Py<PyAny>>>,
}

impl PyTerrain {
    pub fn new(terrain: Terrain) -> Self {
        PyTerrain { terrain: Arc::new(terrain), georeference: RwLock::new(None) }
    }

    fn place(&self, georeference: Option<Py<PyAny>>) {
        *self.georeference.write().expect("no writer panics") = georeference;
    }

    fn checked_ids(&self, ids: &Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
        checked_ids(&self.terrain, ids)
    }
}

/// Voxel id and distance per ray.
type Hits<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>);

/// Voxel ids [N] that all exist.
pub fn checked_ids(terrain: &Terrain, ids: &Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
    Array::<i64>::new(ids, "ids", &[None])?
        .to_vec()?
        .into_iter()
        .map(|id| terrain.check_id(id).map_err(refuse))
        .collect()
}

fn grid_index<const N: usize>(index: &[i64]) -> Option<[i32; N]> {
    let mut own = [0; N];
    for (own, &given) in own.iter_mut().zip(index) {
        *own = i32::try_from(given).ok()?;
    }
    Some(own)
}

/// Rows of N grid indices each: N = 3 for voxels, 2 for columns.
fn grid_indices<const N: usize>(indices: &Bound<'_, PyAny>, name: &'static str) -> PyResult<Vec<[i32; N]>> {
    let flat = Array::<i64>::new(indices, name, &[None, Some(N)])?.to_vec()?;
    let rows = flat.chunks_exact(N).enumerate();
    rows.map(|(row, index)| grid_index(index).ok_or_else(|| index_too_large(row, index))).collect()
}

fn index_too_large(row: usize, index: &[i64]) -> PyErr {
    CrowdfenceError::new_err(format!("grid index {row} is {index:?}; each must fit in 32 bits"))
}

/// Grid indices, planes, voxel size, origin and columns that nobody measured.
type Parts<'py> =
    (Bound<'py, PyArray2<i32>>, Bound<'py, PyArray1<u32>>, f64, (f64, f64, f64), Bound<'py, PyArray2<i64>>);
/// What makes the same terrain again: `from_voxels`, its arguments, and the georeference to be set.
type Reduced<'py> = (Bound<'py, PyAny>, Parts<'py>, Option<Py<PyAny>>);

#[pymethods]
impl PyTerrain {
    /// Occupied cells of a bool array [X, Y, Z] become voxels; cell (0, 0, 0) starts at `origin`.
    ///
    /// CrowdfenceError as for the class.
    #[staticmethod]
    #[pyo3(signature = (occupied, voxel_size_m, origin=[0.0; 3]), text_signature = "(occupied, voxel_size_m, origin=(0.0, 0.0, 0.0))")]
    fn from_occupancy(
        py: Python<'_>,
        occupied: &Bound<'_, PyAny>,
        voxel_size_m: f64,
        #[pyo3(from_py_with = origin)] origin: [f64; 3],
    ) -> PyResult<Self> {
        let occupied = Array::<bool>::new(occupied, "occupied", &[None, None, None])?;
        let shape = [occupied.shape()[0], occupied.shape()[1], occupied.shape()[2]];
        let occupied = occupied.to_vec()?;
        released(py, || Terrain::from_occupancy(&occupied, shape, voxel_size_m, origin.into()))
            .map(PyTerrain::new)
            .map_err(refuse)
    }

    /// Closed surface of a height map [X, Y] (first axis east, second north), float32.
    ///
    /// height_m      height of each cell's centre, metres above origin z; NaN is a hole
    /// cell_size_m   cell (i, j) covers origin + [i, i + 1) x [j, j + 1) * cell_size_m
    /// voxel_size_m  None = cell_size_m
    /// origin        world coordinates (x, y, z) of the corner of cell (0, 0), metres
    ///
    /// A column also fills the step down to its lowest neighbour, so that no ray slips through. In voxels
    /// larger than the cells it has the height at its middle, but that of its highest cell where this stands
    /// out of it by a metre and half a voxel: what a wall hides would be called seen.
    /// CrowdfenceError as for the class.
    #[staticmethod]
    #[pyo3(signature = (height_m, cell_size_m, voxel_size_m=None, origin=[0.0; 3]), text_signature = "(height_m, cell_size_m, voxel_size_m=None, origin=(0.0, 0.0, 0.0))")]
    fn from_height_map(
        py: Python<'_>,
        height_m: &Bound<'_, PyAny>,
        cell_size_m: f64,
        voxel_size_m: Option<f64>,
        #[pyo3(from_py_with = origin)] origin: [f64; 3],
    ) -> PyResult<Self> {
        let heights = Array::<f32>::new(height_m, "height_m", &[None, None])?;
        let shape = [heights.shape()[0], heights.shape()[1]];
        let heights = heights.to_vec()?;
        released(py, || {
            let map = HeightMap::new(&heights, shape, cell_size_m)?;
            Terrain::from_height_map(&map, voxel_size_m.unwrap_or(cell_size_m), origin.into())
        })
        .map(PyTerrain::new)
        .map_err(refuse)
    }

    /// Every voxel that holds at least one of the points [N, 3] (world metres).
    ///
    /// The surface goes through the mean points of neighbouring voxels; one point a voxel is enough.
    /// CrowdfenceError as for the class, naming the first point that has no place on the grid.
    #[staticmethod]
    #[pyo3(name = "from_points", signature = (points, voxel_size_m, origin=[0.0; 3]), text_signature = "(points, voxel_size_m, origin=(0.0, 0.0, 0.0))")]
    fn py_from_points(
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        voxel_size_m: f64,
        #[pyo3(from_py_with = origin)] origin: [f64; 3],
    ) -> PyResult<Self> {
        let points = self::points(points, "points")?;
        released(py, || Terrain::from_points(&points, voxel_size_m, origin.into()))
            .map(PyTerrain::new)
            .map_err(refuse)
    }

    /// Every voxel that a triangle touches: vertices [N, 3] world metres, triangles [M, 3] indices.
    ///
    /// The surface is the highest triangle in a column of voxels.
    /// CrowdfenceError as for the class, naming the vertex or triangle that cannot be used.
    #[staticmethod]
    #[pyo3(signature = (vertices, triangles, voxel_size_m, origin=[0.0; 3]), text_signature = "(vertices, triangles, voxel_size_m, origin=(0.0, 0.0, 0.0))")]
    fn from_triangles(
        py: Python<'_>,
        vertices: &Bound<'_, PyAny>,
        triangles: &Bound<'_, PyAny>,
        voxel_size_m: f64,
        #[pyo3(from_py_with = origin)] origin: [f64; 3],
    ) -> PyResult<Self> {
        let vertices = points(vertices, "vertices")?;
        let flat = Array::<i64>::new(triangles, "triangles", &[None, Some(3)])?.to_vec()?;
        // A negative index becomes one that cannot exist, so that the core names the triangle.
        let corner = |index: i64| u32::try_from(index).unwrap_or(u32::MAX);
        let triangles: Vec<[u32; 3]> =
            flat.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]).collect();
        released(py, || Terrain::from_triangles(&vertices, &triangles, voxel_size_m, origin.into()))
            .map(PyTerrain::new)
            .map_err(refuse)
    }

    /// Voxels by their grid indices (i, j, k) [N, 3], in any order; the inverse of `voxel_indices`.
    ///
    /// Where in them the surface lies is estimated from the voxels around.
    /// CrowdfenceError as for the class, naming the first index beyond 32 bits.
    #[staticmethod]
    #[pyo3(signature = (indices, voxel_size_m, origin=[0.0; 3]), text_signature = "(indices, voxel_size_m, origin=(0.0, 0.0, 0.0))")]
    fn from_indices(
        py: Python<'_>,
        indices: &Bound<'_, PyAny>,
        voxel_size_m: f64,
        #[pyo3(from_py_with = origin)] origin: [f64; 3],
    ) -> PyResult<Self> {
        let indices = grid_indices(indices, "indices")?;
        released(py, || Terrain::from_indices(&indices, voxel_size_m, origin.into()))
            .map(PyTerrain::new)
            .map_err(refuse)
    }

    /// Voxels by their grid indices (i, j, k) [N, 3], with the surface in them as `planes` [N] gives it.
    ///
    /// From `voxel_indices` of all ids, `planes` and `unmeasured` comes the very terrain that they were taken
    /// from. CrowdfenceError as for the class.
    #[staticmethod]
    #[pyo3(signature = (indices, planes, voxel_size_m, origin=[0.0; 3], unmeasured=None), text_signature = "(indices, planes, voxel_size_m, origin=(0.0, 0.0, 0.0), unmeasured=None)")]
    fn from_voxels(
        py: Python<'_>,
        indices: &Bound<'_, PyAny>,
        planes: &Bound<'_, PyAny>,
        voxel_size_m: f64,
        #[pyo3(from_py_with = origin)] origin: [f64; 3],
        unmeasured: Option<&Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let indices = grid_indices(indices, "indices")?;
        let unmeasured = unmeasured.map_or(Ok(Vec::new()), |columns| grid_indices(columns, "unmeasured"))?;
        let planes = Array::<u32>::new(planes, "planes", &[Some(indices.len())])?.to_vec()?;
        released(py, || {
            let planes: Vec<Plane> = planes.into_iter().map(Plane::from_bits).collect();
            Terrain::from_voxels(&indices, &planes, voxel_size_m, origin.into())
                .map(|terrain| terrain.with_unmeasured(&unmeasured))
        })
        .map(PyTerrain::new)
        .map_err(refuse)
    }

    /// Occupied leaves of an OctoMap (the bytes of its .bt or .ot file); pruned leaves are expanded.
    ///
    /// `origin` is added to the file's coordinates. MapFileError says what is wrong and at which byte.
    #[staticmethod]
    #[pyo3(signature = (data, *, origin=[0.0; 3]), text_signature = "(data, *, origin=(0.0, 0.0, 0.0))")]
    fn from_octomap(
        py: Python<'_>,
        data: Cow<'_, [u8]>,
        #[pyo3(from_py_with = origin)] origin: [f64; 3],
    ) -> PyResult<Self> {
        released(py, || Terrain::from_octomap(&octomap::read(&data)?, origin.into()))
            .map(PyTerrain::new)
            .map_err(refuse)
    }

    /// Terrain of a map file: OctoMap .bt .ot, heights .tif .tiff, lidar points .las .laz, mesh .ply .obj.
    ///
    /// voxel_size_m   None lets the file decide
    /// georeference   anchor of the local frame, as a rule that of the recording. A map with a coordinate
    ///                reference system is brought into its frame; without an anchor it gets one in its middle
    /// options        of the kind of file, see `crowdfence.maps.open_terrain`
    ///
    /// `terrain.georeference` says where the frame lies. MapFileError names the file, what is wrong with it
    /// and what to do; TypeError for an option that the kind of file does not have.
    #[staticmethod]
    #[pyo3(signature = (path, **options), text_signature = "(path, *, voxel_size_m=None, georeference=None, **options)")]
    fn open<'py>(
        py: Python<'py>,
        path: &Bound<'py, PyAny>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        // Reading files is Python's part.
        py.import("crowdfence.maps")?.call_method("open_terrain", (path,), options)
    }

    /// Number of voxels V; their ids are 0 .. V - 1.
    #[getter]
    fn voxel_count(&self) -> usize {
        self.terrain.voxel_count()
    }

    /// Side of a voxel in metres.
    #[getter]
    fn voxel_size_m(&self) -> f64 {
        self.terrain.voxel_size_m()
    }

    /// World coordinates (x, y, z) at which grid index (0, 0, 0) starts.
    #[getter]
    fn origin(&self) -> (f64, f64, f64) {
        self.terrain.origin().into()
    }

    /// [2, 3] float64: lowest and highest corner of the occupied voxels, world metres.
    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (low, high) = self.terrain.bounds();
        rows(py, [low.to_array(), high.to_array()].concat(), 3)
    }

    /// Memory of the tree in bytes.
    #[getter]
    fn tree_bytes(&self) -> usize {
        self.terrain.tree_bytes()
    }

    /// Memory of voxels and surface in bytes.
    #[getter]
    fn bytes(&self) -> usize {
        self.terrain.bytes()
    }

    /// Where in each voxel the surface lies [V] uint32: numbers for `from_voxels`.
    #[getter]
    fn planes<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        let planes: Vec<u32> = self.terrain.planes().iter().map(|plane| plane.to_bits()).collect();
        planes.into_pyarray(py)
    }

    /// Columns (i, j) [U, 2] int64, sorted, whose surface nobody measured: it was bridged from what lies
    /// around when the map was read, and no landing site holds it.
    #[getter]
    fn unmeasured<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        rows(py, self.terrain.unmeasured().iter().flatten().copied().map(i64::from).collect(), 2)
    }

    /// Checksum of geometry and voxels; equal terrains have equal fingerprints.
    #[getter]
    fn fingerprint(&self) -> u64 {
        self.terrain.fingerprint()
    }

    /// Where on Earth the local frame lies; None when unknown. Can be set.
    #[getter]
    fn georeference(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        let georeference = self.georeference.read().expect("no writer panics");
        georeference.as_ref().map(|g| g.clone_ref(py))
    }

    #[setter]
    fn set_georeference(&self, georeference: Option<Bound<'_, PyAny>>) -> PyResult<()> {
        if let Some(given) = &georeference {
            let class = given.py().import("crowdfence.georeference")?.getattr("Georeference")?;
            if !given.is_instance(&class)? {
                let shown = given.repr()?.to_string();
                return Err(PyTypeError::new_err(format!(
                    "georeference is {shown:.60}; it must be a Georeference or None"
                )));
            }
        }
        self.place(georeference.map(Bound::unbind));
        Ok(())
    }

    /// Where each ray first meets the terrain: (voxel ids [N], -1 = nowhere; metres [N], inf = nowhere).
    ///
    /// origins and directions are [N, 3] in the world; directions need not have unit length
    /// surface   "planes": where in the voxels the map says that it lies; "voxels": the voxels as cubes
    ///
    /// A ray that starts inside has distance 0; farther than `max_range_m` is no hit. CrowdfenceError names
    /// the first ray that is not finite or has no direction, or the shape that does not fit.
    #[pyo3(signature = (origins, directions, max_range_m, *, surface="planes"))]
    fn raycast<'py>(
        &self,
        py: Python<'py>,
        origins: &Bound<'py, PyAny>,
        directions: &Bound<'py, PyAny>,
        max_range_m: f64,
        surface: &str,
    ) -> PyResult<Hits<'py>> {
        let surface = self::surface(surface)?;
        let origins = points(origins, "origins")?;
        let directions = points(directions, "directions")?;
        let (ids, distances): (Vec<i64>, Vec<f64>) =
            released(py, || self.terrain.raycast_many(surface, &origins, &directions, max_range_m))
                .map_err(refuse)?
                .into_iter()
                .map(|hit| hit.map_or((-1, f64::INFINITY), |h| (i64::from(h.voxel_id), h.distance_m)))
                .unzip();
        Ok((ids.into_pyarray(py), distances.into_pyarray(py)))
    }

    /// World coordinates [N, 3] of the centres of the voxels `ids` [N].
    ///
    /// CrowdfenceError for an id that does not exist.
    fn voxel_centers<'py>(
        &self,
        py: Python<'py>,
        ids: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let ids = self.checked_ids(ids)?;
        let centers = released(py, || self.terrain.centers(&ids).iter().flat_map(DVec3::to_array).collect());
        rows(py, centers, 3)
    }

    /// Heights [N] of the surface over the middle of the voxels `ids` [N], world metres.
    ///
    /// Of a voxel under another one it is its upper face. CrowdfenceError for an id that does not exist.
    fn surface_heights<'py>(
        &self,
        py: Python<'py>,
        ids: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let ids = self.checked_ids(ids)?;
        Ok(released(py, || self.terrain.surface_heights(&ids)).into_pyarray(py))
    }

    /// Grid indices (i, j, k) [N, 3] of the voxels `ids` [N].
    ///
    /// CrowdfenceError for an id that does not exist.
    fn voxel_indices<'py>(
        &self,
        py: Python<'py>,
        ids: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let ids = self.checked_ids(ids)?;
        let indices =
            released(py, || self.terrain.indices_of(&ids).into_iter().flatten().map(i64::from).collect());
        rows(py, indices, 3)
    }

    /// Ids [N] int64 of the voxels without a voxel on top, on which somebody can stand: sorted by column
    /// (i, then j), then from below. Costs the map, 0.02 s a million voxels.
    fn standing_places<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        let ids = released(py, || self.terrain.standing_places());
        id_array(py, &ids)
    }

    /// Every column of voxels, sorted [C, 4] int64: grid indices i and j, k of its lowest and of its
    /// highest voxel. Costs the map, 0.03 s a million voxels.
    fn columns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let ends = released(py, || {
            let columns = self.terrain.columns();
            columns.iter().flat_map(|one| [one.i, one.j, one.bottom, one.top]).map(i64::from).collect()
        });
        rows(py, ends, 4)
    }

    /// The terrain from above [X, Y] float32: height of the highest surface over the middle of every
    /// column, metres above the lowest face, from the smallest grid indices in use on. NaN in a column
    /// without a voxel. Costs the map, 0.03 s a million voxels.
    fn surface_map<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        rows(py, released(py, || self.terrain.surface_map()), self.terrain.extent_xy()[1])
    }

    /// Ids [N] of grid indices [N, 3], -1 where there is no voxel. CrowdfenceError for another shape.
    fn voxel_ids<'py>(
        &self,
        py: Python<'py>,
        indices: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let flat = Array::<i64>::new(indices, "indices", &[None, Some(3)])?.to_vec()?;
        let id = |index: &[i64]| self.terrain.id(grid_index(index)?);
        let ids: Vec<i64> = flat.chunks_exact(3).map(|index| id(index).map_or(-1, i64::from)).collect();
        Ok(ids.into_pyarray(py))
    }

    /// The same voxels in a frame shifted so that grid index (0, 0, 0) starts at `origin` (x, y, z).
    ///
    /// CrowdfenceError for an origin that is not finite.
    fn with_origin(&self, py: Python<'_>, #[pyo3(from_py_with = origin)] origin: [f64; 3]) -> PyResult<Self> {
        let moved = PyTerrain::new(self.terrain.with_origin(DVec3::from(origin)).map_err(refuse)?);
        moved.place(self.georeference(py));
        Ok(moved)
    }

    /// The same terrain, of which nobody measured the surface in the columns (i, j) [N, 2] either.
    ///
    /// CrowdfenceError for another shape.
    fn with_unmeasured(&self, py: Python<'_>, columns: &Bound<'_, PyAny>) -> PyResult<Self> {
        let columns = grid_indices(columns, "columns")?;
        let marked = released(py, || Terrain::clone(&self.terrain).with_unmeasured(&columns));
        let marked = PyTerrain::new(marked);
        marked.place(self.georeference(py));
        Ok(marked)
    }

    /// The voxels of this terrain and of another one of the same grid, with their surfaces.
    ///
    /// In a voxel of both, this terrain's surface counts. The georeference is this one's.
    /// CrowdfenceError for another voxel_size_m, origin or georeference.
    fn joined(&self, py: Python<'_>, other: &Self) -> PyResult<Self> {
        if let (Some(own), Some(others)) = (self.georeference(py), other.georeference(py)) {
            // Two tiles that were opened by themselves count from two middles, often with the same numbers.
            if !own.bind(py).eq(&others)? {
                return Err(CrowdfenceError::new_err(format!(
                    "georeference is {others}; it must be the same in both terrains"
                )));
            }
        }
        let joined = released(py, || self.terrain.joined(&other.terrain)).map_err(refuse)?;
        let joined = PyTerrain::new(joined);
        joined.place(self.georeference(py));
        Ok(joined)
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<Reduced<'py>> {
        let (py, terrain) = (slf.py(), &slf.get().terrain);
        let ids: Vec<u32> = (0..terrain.voxel_count() as u32).collect();
        let indices = released(py, || terrain.indices_of(&ids).into_iter().flatten().collect());
        let planes = slf.get().planes(py);
        let this = slf.get();
        let parts =
            (rows(py, indices, 3)?, planes, terrain.voxel_size_m(), this.origin(), this.unmeasured(py)?);
        Ok((slf.get_type().getattr("from_voxels")?, parts, slf.get().georeference(py)))
    }

    fn __setstate__(&self, georeference: Option<Py<PyAny>>) {
        self.place(georeference);
    }

    fn __repr__(&self) -> String {
        let (low, high) = self.terrain.bounds();
        let size = high - low;
        format!(
            "Terrain({} voxels of {} m, {:.1} x {:.1} x {:.1} m)",
            self.voxel_count(),
            self.voxel_size_m(),
            size.x,
            size.y,
            size.z
        )
    }
}

/// OctoMap `.bt` file content: the voxels `ids` [N] of a terrain, occupied.
///
/// CrowdfenceError for an id that does not exist, MapFileError for a grid index beyond the format's -32768 to
/// 32767. The terrain's origin is not part of it; `moved` [3] is how many voxels are added to each index.
#[pyfunction]
#[pyo3(signature = (terrain, ids, moved=(0, 0, 0)), text_signature = "(terrain, ids, moved=(0, 0, 0))")]
pub fn write_octomap_binary<'py>(
    py: Python<'py>,
    terrain: &PyTerrain,
    ids: &Bound<'py, PyAny>,
    moved: (i32, i32, i32),
) -> PyResult<Bound<'py, PyBytes>> {
    let voxels = voxels(&terrain.terrain, ids, moved)?;
    let bytes = released(py, || octomap::write_binary(&voxels, terrain.voxel_size_m())).map_err(refuse)?;
    Ok(PyBytes::new(py, &bytes))
}

/// OctoMap `.ot` file content (ColorOcTree) of the voxels `ids` [N] of a terrain.
///
/// colors       [N, 3] uint8, red green blue
/// probability  [N] in [0, 1], written as the occupancy
///
/// CrowdfenceError for an id that does not exist or an array of another shape, MapFileError for a probability
/// out of bounds, an id given twice and a grid index beyond the format's -32768 to 32767. The terrain's
/// origin is not part of it; `moved` [3] is how many voxels are added to each index.
#[pyfunction]
#[pyo3(signature = (terrain, ids, colors, probability, moved=(0, 0, 0)), text_signature = "(terrain, ids, colors, probability, moved=(0, 0, 0))")]
pub fn write_octomap_color<'py>(
    py: Python<'py>,
    terrain: &PyTerrain,
    ids: &Bound<'py, PyAny>,
    colors: &Bound<'py, PyAny>,
    probability: &Bound<'py, PyAny>,
    moved: (i32, i32, i32),
) -> PyResult<Bound<'py, PyBytes>> {
    let voxels = voxels(&terrain.terrain, ids, moved)?;
    let colors = Array::<u8>::new(colors, "colors", &[Some(voxels.len()), Some(3)])?.to_vec()?;
    let colors: Vec<[u8; 3]> = colors.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    let probability = Array::<f64>::new(probability, "probability", &[Some(voxels.len())])?.to_vec()?;
    let bytes = released(py, || octomap::write_color(&voxels, &colors, &probability, terrain.voxel_size_m()))
        .map_err(refuse)?;
    Ok(PyBytes::new(py, &bytes))
}

/// An index beyond what 32 bits hold is beyond the format too, which says so.
fn voxels(terrain: &Terrain, ids: &Bound<'_, PyAny>, moved: (i32, i32, i32)) -> PyResult<Vec<[i32; 3]>> {
    let moved: [i32; 3] = moved.into();
    let voxels = terrain.indices_of(&checked_ids(terrain, ids)?).into_iter();
    Ok(voxels.map(|voxel| array::from_fn(|axis| voxel[axis].saturating_add(moved[axis]))).collect())
}

/// Heights [X, Y] of the middles of voxel columns, and of their highest points where these stand out.
///
/// The height of a column is that of the surface at its middle. A wall of half a metre falls between the
/// middles of columns of two metres, and the ground that it hides would be called seen and empty. A column
/// whose highest point stands out of the ground by a metre, and by half a voxel, is therefore as high as
/// that: a little too much is hidden, never too little. People stand beside a wall, and in its column they
/// are counted all the same. On a slope the upper edge of a column lies above its middle; what its neighbours
/// on both sides make of that does not count.
///
/// height_m, top_m  float32 [X, Y], metres, of middles and of highest points; NaN is a hole, and stays one
/// voxel_size_m     side of a column, > 0
///
/// CrowdfenceError for arrays of different shapes and for another size.
#[pyfunction]
pub fn raised<'py>(
    py: Python<'py>,
    height_m: &Bound<'py, PyAny>,
    top_m: &Bound<'py, PyAny>,
    voxel_size_m: f64,
) -> PyResult<Bound<'py, PyArray2<f32>>> {
    let heights = Array::<f32>::new(height_m, "height_m", &[None, None])?;
    let shape = [heights.shape()[0], heights.shape()[1]];
    let tops = Array::<f32>::new(top_m, "top_m", &shape.map(Some))?;
    let (heights, tops) = (heights.to_vec()?, tops.to_vec()?);
    released(py, || outstanding::raised(&heights, &tops, shape, voxel_size_m))
        .map_err(refuse)?
        .into_pyarray(py)
        .reshape(shape)
}
