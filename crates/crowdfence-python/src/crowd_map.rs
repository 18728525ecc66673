use std::borrow::Cow;
use std::sync::{Arc, RwLock};

use crowdfence::crowd_map::{Decay, Initial};
use crowdfence::{CrowdMap, Method, Or, Paper, TemporalBlend, Update, View};
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays::{id_array, refuse};
use crate::back_projection::{PyObservation, projection};
use crate::opinion_pool::{PyRates, opinion_pool};
use crate::terrain::{PyTerrain, checked_ids};
use crate::view::PyView;

#[pyclass(frozen, name = "Paper", module = "crowdfence", eq)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyPaper(Paper);

#[pymethods]
impl PyPaper {
    #[new]
    #[pyo3(signature = (rates, prior, *, alpha=0.1, decay_per_s=0.0005, fleet_size, b_threshold=0.5,
                        unseen="fleet", normalise=false, initial="zero", decay_unit="second"))]
    #[allow(clippy::too_many_arguments)] // the switches of the paper, keyword-only in Python
    fn new(
        rates: &PyRates,
        prior: f64,
        alpha: f64,
        decay_per_s: f64,
        fleet_size: usize,
        b_threshold: f64,
        unseen: &str,
        normalise: bool,
        initial: &str,
        decay_unit: &str,
    ) -> PyResult<Self> {
        let initial = match initial {
            "zero" => Initial::Zero,
            "prior" => Initial::Prior,
            "first" => Initial::FirstLook,
            _ => return Err(not_one_of("initial", initial, "\"zero\", \"prior\" or \"first\"")),
        };
        let decay = match decay_unit {
            "second" => Decay::PerSecond,
            "frame" => Decay::PerFrame,
            _ => return Err(not_one_of("decay_unit", decay_unit, "\"second\" or \"frame\"")),
        };
        let pool = opinion_pool(rates, prior, b_threshold, unseen, normalise)?;
        TemporalBlend::new(alpha, decay_per_s)
            .and_then(|blend| Paper::new(pool, blend, fleet_size, initial, decay))
            .map(PyPaper)
            .map_err(refuse)
    }

    #[getter]
    fn rates(&self) -> PyRates {
        PyRates(self.0.pool().rates())
    }

    #[getter]
    fn prior(&self) -> f64 {
        self.0.pool().prior()
    }

    #[getter]
    fn alpha(&self) -> f64 {
        self.0.blend().alpha()
    }

    #[getter]
    fn decay_per_s(&self) -> f64 {
        self.0.blend().decay()
    }

    #[getter]
    fn fleet_size(&self) -> usize {
        self.0.fleet_size()
    }

    #[getter]
    fn post_positive(&self) -> f64 {
        self.0.pool().post_positive()
    }

    #[getter]
    fn post_negative(&self) -> f64 {
        self.0.pool().post_negative()
    }

    fn __repr__(&self) -> String {
        format!(
            "Paper({}, prior={}, alpha={}, decay_per_s={}, fleet_size={})",
            self.rates().__repr__(),
            self.prior(),
            self.alpha(),
            self.decay_per_s(),
            self.fleet_size()
        )
    }
}

fn not_one_of(name: &str, value: &str, allowed: &str) -> PyErr {
    PyValueError::new_err(format!("{name} is {value:?}; it must be {allowed}"))
}

#[pyclass(frozen, name = "Or", module = "crowdfence", eq)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyOr(Or);

#[pymethods]
impl PyOr {
    #[new]
    #[pyo3(signature = (*, fleet_size, b_threshold=0.5))]
    fn new(fleet_size: usize, b_threshold: f64) -> PyResult<Self> {
        Or::new(fleet_size, b_threshold).map(PyOr).map_err(refuse)
    }

    #[getter]
    fn fleet_size(&self) -> usize {
        self.0.fleet_size()
    }

    #[getter]
    fn b_threshold(&self) -> f64 {
        self.0.b_threshold()
    }

    fn __repr__(&self) -> String {
        format!("Or(fleet_size={}, b_threshold={})", self.fleet_size(), self.b_threshold())
    }
}

#[derive(FromPyObject)]
enum MethodArgument<'py> {
    Paper(PyRef<'py, PyPaper>),
    Or(PyRef<'py, PyOr>),
}

#[pyclass(frozen, name = "Update", module = "crowdfence")]
pub struct PyUpdate {
    update: Update,
    observations: Vec<PyObservation>,
}

impl PyUpdate {
    fn new(mut update: Update) -> Self {
        let observations = std::mem::take(&mut update.observations)
            .into_iter()
            .map(|observation| PyObservation(Arc::new(observation)))
            .collect();
        PyUpdate { update, observations }
    }
}

#[pymethods]
impl PyUpdate {
    #[getter]
    fn stamp_ns(&self) -> i64 {
        self.update.stamp_ns
    }

    #[getter]
    fn voxel_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        id_array(py, &self.update.voxel_ids)
    }

    #[getter]
    fn probability<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.update.probability.clone().into_pyarray(py)
    }

    #[getter]
    fn observations(&self) -> Vec<PyObservation> {
        self.observations.clone()
    }

    fn __repr__(&self) -> String {
        format!(
            "Update(stamp_ns={}, {} voxels, {} views)",
            self.update.stamp_ns,
            self.update.voxel_ids.len(),
            self.observations.len()
        )
    }
}

/// The lock lets one thread integrate while others read, with the interpreter released.
#[pyclass(frozen, name = "CrowdMap", module = "crowdfence")]
pub struct PyCrowdMap {
    map: RwLock<CrowdMap>,
    terrain: Py<PyTerrain>,
}

impl PyCrowdMap {
    fn read<T: Send>(
        &self,
        py: Python<'_>,
        question: impl FnOnce(&CrowdMap) -> crowdfence::Result<T> + Send,
    ) -> PyResult<T> {
        py.detach(|| question(&self.map.read().expect("no writer panics"))).map_err(refuse)
    }
}

#[pymethods]
impl PyCrowdMap {
    #[new]
    #[pyo3(signature = (terrain, method, *, max_range_m=300.0, target_height_m=0.0, coverage="rays",
                        max_gap_s=3600.0))]
    fn new(
        py: Python<'_>,
        terrain: Py<PyTerrain>,
        method: MethodArgument<'_>,
        max_range_m: f64,
        target_height_m: f64,
        coverage: &str,
        max_gap_s: f64,
    ) -> PyResult<Self> {
        let method = match method {
            MethodArgument::Paper(paper) => Method::Paper(paper.0),
            MethodArgument::Or(or) => Method::Or(or.0),
        };
        let projection = projection(max_range_m, target_height_m, coverage)?;
        let map = CrowdMap::new(terrain.borrow(py).terrain.clone(), method, projection, max_gap_s)
            .map_err(refuse)?;
        Ok(PyCrowdMap { map: RwLock::new(map), terrain })
    }

    #[getter]
    fn terrain(&self, py: Python<'_>) -> Py<PyTerrain> {
        self.terrain.clone_ref(py)
    }

    #[getter]
    fn method(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        match self.read(py, |map| Ok(*map.method()))? {
            Method::Paper(paper) => Ok(Py::new(py, PyPaper(paper))?.into_any()),
            Method::Or(or) => Ok(Py::new(py, PyOr(or))?.into_any()),
        }
    }

    #[getter]
    fn stamps_ns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        Ok(self.read(py, |map| Ok(map.stamps_ns().to_vec()))?.into_pyarray(py))
    }

    fn integrate(&self, py: Python<'_>, views: Vec<PyRef<'_, PyView>>, stamp_ns: i64) -> PyResult<PyUpdate> {
        let views: Vec<View> = views.iter().map(|view| view.0.clone()).collect();
        py.detach(|| {
            let mut map = self.map.write().expect("no writer panics");
            map.integrate(&views, stamp_ns)
        })
        .map(PyUpdate::new)
        .map_err(refuse)
    }

    fn integrate_observations(
        &self,
        py: Python<'_>,
        drones: Vec<String>,
        observations: Vec<PyRef<'_, PyObservation>>,
        stamp_ns: i64,
    ) -> PyResult<PyUpdate> {
        let observations = observations.iter().map(|observation| (*observation.0).clone()).collect();
        py.detach(|| {
            let drones: Vec<&str> = drones.iter().map(String::as_str).collect();
            let mut map = self.map.write().expect("no writer panics");
            map.integrate_observations(&drones, observations, stamp_ns)
        })
        .map(PyUpdate::new)
        .map_err(refuse)
    }

    #[pyo3(signature = (stamp_ns, ids=None))]
    fn probability<'py>(
        &self,
        py: Python<'py>,
        stamp_ns: i64,
        ids: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let probability = match ids {
            None => self.read(py, |map| map.probability(stamp_ns))?,
            Some(ids) => {
                let ids = checked_ids(&self.terrain.borrow(py).terrain, ids)?;
                self.read(py, |map| map.probability_of(&ids, stamp_ns))?
            }
        };
        Ok(probability.into_pyarray(py))
    }

    #[pyo3(signature = (stamp_ns, *, threshold=None, stale_after_s=30.0))]
    fn state<'py>(
        &self,
        py: Python<'py>,
        stamp_ns: i64,
        threshold: Option<f64>,
        stale_after_s: f64,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let codes: Vec<u8> = self.read(py, |map| {
            let threshold = threshold.unwrap_or_else(|| map.method().default_threshold());
            let states = map.state(stamp_ns, threshold, stale_after_s)?;
            Ok(states.into_iter().map(|state| state as u8).collect())
        })?;
        Ok(codes.into_pyarray(py))
    }

    fn seen<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let seen: Vec<bool> =
            self.read(py, |map| Ok(map.last_seen_ns().map(|stamp| stamp.is_some()).collect()))?;
        Ok(seen.into_pyarray(py))
    }

    fn seen_ids<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        Ok(id_array(py, &self.read(py, |map| Ok(map.seen_ids()))?))
    }

    fn last_seen_ns<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let stamps: Vec<i64> =
            self.read(py, |map| Ok(map.last_seen_ns().map(|stamp| stamp.unwrap_or(-1)).collect()))?;
        Ok(stamps.into_pyarray(py))
    }

    fn default_threshold(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, |map| Ok(map.method().default_threshold()))
    }

    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.read(py, |map| Ok(map.to_bytes()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: Cow<'_, [u8]>, terrain: Py<PyTerrain>) -> PyResult<Self> {
        let voxels = terrain.borrow(py).terrain.clone();
        let map = py.detach(|| CrowdMap::from_bytes(&data, voxels)).map_err(refuse)?;
        Ok(PyCrowdMap { map: RwLock::new(map), terrain })
    }

    /// Files are Python's part: `crowdfence.exports.atomic` replaces the file in one step.
    fn save(&self, py: Python<'_>, path: &Bound<'_, PyAny>) -> PyResult<()> {
        py.import("crowdfence.exports.atomic")?.call_method1("write_bytes", (path, self.to_bytes(py)?))?;
        Ok(())
    }

    #[staticmethod]
    fn load(py: Python<'_>, path: &Bound<'_, PyAny>, terrain: Py<PyTerrain>) -> PyResult<Self> {
        let path = py.import("pathlib")?.call_method1("Path", (path,))?;
        let data = path.call_method0("read_bytes")?;
        PyCrowdMap::from_bytes(py, data.extract()?, terrain)
            .map_err(|error| PyValueError::new_err(format!("{path}: {}", error.value(py))))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        self.read(py, |map| {
            Ok(format!(
                "CrowdMap({} voxels, {} instants)",
                map.terrain().voxel_count(),
                map.stamps_ns().len()
            ))
        })
    }
}
