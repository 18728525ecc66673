use std::borrow::Cow;
use std::sync::{Arc, RwLock};

use crowdfence::Terrain;
use crowdfence::terrain::height_map::HeightMap;
use crowdfence::terrain::octomap;
use glam::DVec3;
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

use crate::arrays::{Array, points, refuse, rows};

#[pyclass(frozen, name = "Terrain", module = "crowdfence")]
pub struct PyTerrain {
    pub terrain: Arc<Terrain>,
    georeference: RwLock<Option<Py<PyAny>>>,
}

impl PyTerrain {
    pub fn new(terrain: Terrain) -> Self {
        PyTerrain { terrain: Arc::new(terrain), georeference: RwLock::new(None) }
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

#[pymethods]
impl PyTerrain {
    #[staticmethod]
    #[pyo3(signature = (occupied, voxel_size_m, origin=[0.0; 3]), text_signature = "(occupied, voxel_size_m, origin=(0.0, 0.0, 0.0))")]
    fn from_occupancy(
        py: Python<'_>,
        occupied: &Bound<'_, PyAny>,
        voxel_size_m: f64,
        origin: [f64; 3],
    ) -> PyResult<Self> {
        let occupied = Array::<bool>::new(occupied, "occupied", &[None, None, None])?;
        let shape = [occupied.shape()[0], occupied.shape()[1], occupied.shape()[2]];
        let occupied = occupied.to_vec()?;
        py.detach(|| Terrain::from_occupancy(&occupied, shape, voxel_size_m, origin.into()))
            .map(PyTerrain::new)
            .map_err(refuse)
    }

    #[staticmethod]
    #[pyo3(signature = (height_m, cell_size_m, voxel_size_m=None, origin=[0.0; 3]), text_signature = "(height_m, cell_size_m, voxel_size_m=None, origin=(0.0, 0.0, 0.0))")]
    fn from_height_map(
        py: Python<'_>,
        height_m: &Bound<'_, PyAny>,
        cell_size_m: f64,
        voxel_size_m: Option<f64>,
        origin: [f64; 3],
    ) -> PyResult<Self> {
        let heights = Array::<f32>::new(height_m, "height_m", &[None, None])?;
        let shape = [heights.shape()[0], heights.shape()[1]];
        let heights = heights.to_vec()?;
        py.detach(|| {
            let map = HeightMap::new(&heights, shape, cell_size_m)?;
            Terrain::from_height_map(&map, voxel_size_m.unwrap_or(cell_size_m), origin.into())
        })
        .map(PyTerrain::new)
        .map_err(refuse)
    }

    #[staticmethod]
    #[pyo3(name = "from_points", signature = (points, voxel_size_m, origin=[0.0; 3]), text_signature = "(points, voxel_size_m, origin=(0.0, 0.0, 0.0))")]
    fn py_from_points(
        py: Python<'_>,
        points: &Bound<'_, PyAny>,
        voxel_size_m: f64,
        origin: [f64; 3],
    ) -> PyResult<Self> {
        let points = self::points(points, "points")?;
        py.detach(|| Terrain::from_points(&points, voxel_size_m, origin.into()))
            .map(PyTerrain::new)
            .map_err(refuse)
    }

    #[staticmethod]
    #[pyo3(signature = (vertices, triangles, voxel_size_m, origin=[0.0; 3]), text_signature = "(vertices, triangles, voxel_size_m, origin=(0.0, 0.0, 0.0))")]
    fn from_triangles(
        py: Python<'_>,
        vertices: &Bound<'_, PyAny>,
        triangles: &Bound<'_, PyAny>,
        voxel_size_m: f64,
        origin: [f64; 3],
    ) -> PyResult<Self> {
        let vertices = points(vertices, "vertices")?;
        let flat = Array::<i64>::new(triangles, "triangles", &[None, Some(3)])?.to_vec()?;
        // A negative index becomes one that cannot exist, so that the core names the triangle.
        let corner = |index: i64| u32::try_from(index).unwrap_or(u32::MAX);
        let triangles: Vec<[u32; 3]> =
            flat.chunks_exact(3).map(|t| [corner(t[0]), corner(t[1]), corner(t[2])]).collect();
        py.detach(|| Terrain::from_triangles(&vertices, &triangles, voxel_size_m, origin.into()))
            .map(PyTerrain::new)
            .map_err(refuse)
    }

    #[staticmethod]
    #[pyo3(signature = (data, *, origin=[0.0; 3]), text_signature = "(data, *, origin=(0.0, 0.0, 0.0))")]
    fn from_octomap(py: Python<'_>, data: Cow<'_, [u8]>, origin: [f64; 3]) -> PyResult<Self> {
        py.detach(|| Terrain::from_octomap(&octomap::read(&data)?, origin.into()))
            .map(PyTerrain::new)
            .map_err(refuse)
    }

    /// Reading files is Python's part: `crowdfence.maps` does it.
    #[staticmethod]
    #[pyo3(signature = (path, **options))]
    fn open<'py>(
        py: Python<'py>,
        path: &Bound<'py, PyAny>,
        options: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        py.import("crowdfence.maps")?.call_method("open_terrain", (path,), options)
    }

    #[getter]
    fn voxel_count(&self) -> usize {
        self.terrain.voxel_count()
    }

    #[getter]
    fn voxel_size_m(&self) -> f64 {
        self.terrain.voxel_size_m()
    }

    #[getter]
    fn origin(&self) -> (f64, f64, f64) {
        self.terrain.origin().into()
    }

    #[getter]
    fn bounds<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let (low, high) = self.terrain.bounds();
        rows(py, [low.to_array(), high.to_array()].concat(), 3)
    }

    #[getter]
    fn tree_bytes(&self) -> usize {
        self.terrain.tree_bytes()
    }

    #[getter]
    fn fingerprint(&self) -> u64 {
        self.terrain.fingerprint()
    }

    #[getter]
    fn georeference(&self, py: Python<'_>) -> Option<Py<PyAny>> {
        let georeference = self.georeference.read().expect("no writer panics");
        georeference.as_ref().map(|g| g.clone_ref(py))
    }

    #[setter]
    fn set_georeference(&self, georeference: Option<Py<PyAny>>) {
        *self.georeference.write().expect("no writer panics") = georeference;
    }

    fn raycast<'py>(
        &self,
        py: Python<'py>,
        origins: &Bound<'py, PyAny>,
        directions: &Bound<'py, PyAny>,
        max_range_m: f64,
    ) -> PyResult<Hits<'py>> {
        let origins = points(origins, "origins")?;
        let directions = points(directions, "directions")?;
        let (ids, distances): (Vec<i64>, Vec<f64>) = py
            .detach(|| self.terrain.raycast_many(&origins, &directions, max_range_m))
            .map_err(refuse)?
            .into_iter()
            .map(|hit| hit.map_or((-1, f64::INFINITY), |h| (i64::from(h.voxel_id), h.distance_m)))
            .unzip();
        Ok((ids.into_pyarray(py), distances.into_pyarray(py)))
    }

    fn voxel_centers<'py>(
        &self,
        py: Python<'py>,
        ids: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let ids = self.checked_ids(ids)?;
        let centers = py.detach(|| ids.iter().flat_map(|&id| self.terrain.center(id).to_array()).collect());
        rows(py, centers, 3)
    }

    fn voxel_indices<'py>(
        &self,
        py: Python<'py>,
        ids: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let ids = self.checked_ids(ids)?;
        let indices =
            py.detach(|| ids.iter().flat_map(|&id| self.terrain.index(id).map(i64::from)).collect());
        rows(py, indices, 3)
    }

    fn voxel_ids<'py>(
        &self,
        py: Python<'py>,
        indices: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let flat = Array::<i64>::new(indices, "indices", &[None, Some(3)])?.to_vec()?;
        let id = |index: &[i64]| {
            let index =
                [i32::try_from(index[0]).ok()?, i32::try_from(index[1]).ok()?, i32::try_from(index[2]).ok()?];
            self.terrain.id(index)
        };
        let ids: Vec<i64> = flat.chunks_exact(3).map(|index| id(index).map_or(-1, i64::from)).collect();
        Ok(ids.into_pyarray(py))
    }

    fn with_origin(&self, py: Python<'_>, origin: [f64; 3]) -> PyResult<Self> {
        let moved = PyTerrain::new(self.terrain.with_origin(DVec3::from(origin)).map_err(refuse)?);
        moved.set_georeference(self.georeference(py));
        Ok(moved)
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

/// OctoMap `.bt` bytes of some voxels of a terrain.
#[pyfunction]
pub fn write_octomap_binary<'py>(
    py: Python<'py>,
    terrain: &PyTerrain,
    ids: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyBytes>> {
    let voxels = voxels(&terrain.terrain, ids)?;
    let bytes = py.detach(|| octomap::write_binary(&voxels, terrain.voxel_size_m())).map_err(refuse)?;
    Ok(PyBytes::new(py, &bytes))
}

/// OctoMap ColorOcTree `.ot` bytes of some voxels of a terrain.
#[pyfunction]
pub fn write_octomap_color<'py>(
    py: Python<'py>,
    terrain: &PyTerrain,
    ids: &Bound<'py, PyAny>,
    colors: &Bound<'py, PyAny>,
    probability: &Bound<'py, PyAny>,
) -> PyResult<Bound<'py, PyBytes>> {
    let voxels = voxels(&terrain.terrain, ids)?;
    let colors = Array::<u8>::new(colors, "colors", &[Some(voxels.len()), Some(3)])?.to_vec()?;
    let colors: Vec<[u8; 3]> = colors.chunks_exact(3).map(|c| [c[0], c[1], c[2]]).collect();
    let probability = Array::<f64>::new(probability, "probability", &[Some(voxels.len())])?.to_vec()?;
    let bytes = py
        .detach(|| octomap::write_color(&voxels, &colors, &probability, terrain.voxel_size_m()))
        .map_err(refuse)?;
    Ok(PyBytes::new(py, &bytes))
}

fn voxels(terrain: &Terrain, ids: &Bound<'_, PyAny>) -> PyResult<Vec<[i32; 3]>> {
    let ids = checked_ids(terrain, ids)?;
    Ok(ids.into_iter().map(|id| terrain.index(id)).collect())
}
