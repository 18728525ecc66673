use std::borrow::Cow;
use std::sync::{Arc, RwLock};

use crowdfence::{CrowdMap, Observation, Update, View};
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;
use pyo3::types::PyBytes;

use crate::arrays::{id_array, refuse, rows};
use crate::crowd_columns::PyCrowdColumns;
use crate::errors::MapFileError;
use crate::method::{MethodArgument, method_object};
use crate::observation::{PyObservation, projection};
use crate::released::released;
use crate::stamps::stamp_ns;
use crate::terrain::{PyTerrain, checked_ids};
use crate::view::PyView;
use crate::voxel_knowledge::PyVoxelKnowledge;

/// What one instant changed; `CrowdMap.integrate` makes it. It can be compared and pickled.
#[pyclass(frozen, name = "Update", module = "crowdfence", eq)]
#[derive(PartialEq)]
pub struct PyUpdate {
    stamp_ns: i64,
    voxel_ids: Vec<u32>,
    probability: Vec<f64>,
    observations: Vec<PyObservation>,
}

impl PyUpdate {
    fn new(update: Update) -> Self {
        PyUpdate {
            stamp_ns: update.stamp_ns,
            voxel_ids: update.voxel_ids,
            probability: update.probability,
            observations: update.observations.into_iter().map(PyObservation).collect(),
        }
    }
}

type UpdateParts = (i64, Vec<u32>, Vec<f64>, Vec<PyObservation>);

#[pymethods]
impl PyUpdate {
    /// The instant, nanoseconds since the Unix epoch.
    #[getter]
    fn stamp_ns(&self) -> i64 {
        self.stamp_ns
    }

    /// Voxels seen at this instant by any drone [V] int64, sorted.
    #[getter]
    fn voxel_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        id_array(py, &self.voxel_ids)
    }

    /// Their probability of crowd after the instant [V] float64.
    #[getter]
    fn probability<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.probability.clone().into_pyarray(py)
    }

    /// What each view says about the terrain, in the order of the views.
    #[getter]
    fn observations(&self) -> Vec<PyObservation> {
        self.observations.clone()
    }

    /// Makes a pickled update again.
    #[staticmethod]
    fn _from_parts(
        stamp_ns: i64,
        voxel_ids: Vec<u32>,
        probability: Vec<f64>,
        observations: Vec<PyRef<'_, PyObservation>>,
    ) -> Self {
        let observations = observations.iter().map(|observation| (*observation).clone()).collect();
        PyUpdate { stamp_ns, voxel_ids, probability, observations }
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, UpdateParts)> {
        let update = slf.get();
        let parts =
            (update.stamp_ns, update.voxel_ids.clone(), update.probability.clone(), update.observations());
        Ok((slf.get_type().getattr("_from_parts")?, parts))
    }

    fn __repr__(&self) -> String {
        format!(
            "Update(stamp_ns={}, {} voxels, {} views)",
            self.stamp_ns,
            self.voxel_ids.len(),
            self.observations.len()
        )
    }
}

/// Probability of crowd per terrain voxel over time.
///
/// terrain          what the views are projected onto
/// method           `Evidence`, `Paper`, `Or`, or one of those for comparison (`LinearPool`, `LogPool`,
///                  `LogOdds`, `MovingAverage`)
/// max_range_m      > 0, rays end here
/// target_height_m  in [0, 100], height above the ground at which people are marked
/// coverage         "full" or "rays", see `project`
/// surface          "planes" or "voxels", see `project`
/// max_gap_s        > 0, longest time between two instants, and between a view and its instant; a longer one
///                  is taken for a wrong clock
///
/// A voxel keeps its belief as of its last look, so that an update costs what was seen and not the
/// map. One thread may integrate while others read: a reader sees whole instants. CrowdfenceError for
/// a parameter out of bounds.
//
// The lock lets one thread integrate while others read, with the interpreter released.
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
        released(py, || question(&self.map.read().expect("no writer panics"))).map_err(refuse)
    }

    /// The same with a threshold, the method's own where none is given.
    fn read_at<T: Send>(
        &self,
        py: Python<'_>,
        threshold: Option<f64>,
        question: impl FnOnce(&CrowdMap, f64) -> crowdfence::Result<T> + Send,
    ) -> PyResult<T> {
        self.read(py, |map| question(map, threshold.unwrap_or_else(|| map.method().default_threshold())))
    }

    fn ids(&self, py: Python<'_>, ids: &Bound<'_, PyAny>) -> PyResult<Vec<u32>> {
        checked_ids(&self.terrain.borrow(py).terrain, ids)
    }
}

/// Ids and probability.
type SeenProbability<'py> = (Bound<'py, PyArray1<i64>>, Bound<'py, PyArray1<f64>>);

#[pymethods]
impl PyCrowdMap {
    #[new]
    #[pyo3(signature = (terrain, method, *, max_range_m=300.0, target_height_m=0.0, coverage="full",
                        surface="planes", max_gap_s=3600.0))]
    #[allow(clippy::too_many_arguments)] // They are keywords in Python.
    fn new(
        py: Python<'_>,
        terrain: Py<PyTerrain>,
        method: MethodArgument<'_>,
        max_range_m: f64,
        target_height_m: f64,
        coverage: &str,
        surface: &str,
        max_gap_s: f64,
    ) -> PyResult<Self> {
        let projection = projection(max_range_m, target_height_m, coverage, surface)?;
        let voxels = terrain.borrow(py).terrain.clone();
        let map = CrowdMap::new(voxels, method.method(), projection, max_gap_s).map_err(refuse)?;
        Ok(PyCrowdMap { map: RwLock::new(map), terrain })
    }

    /// What the views are projected onto.
    #[getter]
    fn terrain(&self, py: Python<'_>) -> Py<PyTerrain> {
        self.terrain.clone_ref(py)
    }

    /// The method with its parameters.
    #[getter]
    fn method(&self, py: Python<'_>) -> PyResult<Py<PyAny>> {
        method_object(py, self.read(py, |map| Ok(map.method()))?)
    }

    /// Rays end here, metres.
    #[getter]
    fn max_range_m(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, |map| Ok(map.projection().max_range_m()))
    }

    /// Height above the ground at which people are marked, metres.
    #[getter]
    fn target_height_m(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, |map| Ok(map.projection().target_height_m()))
    }

    /// "full" or "rays", see `project`.
    #[getter]
    fn coverage(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.read(py, |map| Ok(map.projection().coverage().name()))
    }

    /// "planes" or "voxels", see `project`.
    #[getter]
    fn surface(&self, py: Python<'_>) -> PyResult<&'static str> {
        self.read(py, |map| Ok(map.projection().surface().name()))
    }

    /// Longest time between two instants, and between a view and its instant, seconds.
    #[getter]
    fn max_gap_s(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, |map| Ok(map.max_gap_s()))
    }

    /// Instants integrated so far.
    #[getter]
    fn instant_count(&self, py: Python<'_>) -> PyResult<u64> {
        self.read(py, |map| Ok(map.instant_count()))
    }

    /// Stamps of the first and of the newest instant, nanoseconds since the Unix epoch; None before
    /// the first.
    #[getter]
    fn span_ns(&self, py: Python<'_>) -> PyResult<Option<(i64, i64)>> {
        self.read(py, |map| Ok(map.span_ns()))
    }

    /// Every drone that ever gave a view, by name.
    #[getter]
    fn drones(&self, py: Python<'_>) -> PyResult<Vec<String>> {
        self.read(py, |map| Ok(map.drones().map(str::to_owned).collect()))
    }

    /// Take in the views of one instant, each drone at most once: project, fuse, store.
    ///
    /// stamp_ns  the instant; for `Paper` after the one before, for the others in any order
    ///
    /// A view within 1 s of its instant counts as taken then, an older one at its own stamp. An error
    /// leaves the map as it was: StampError for an instant or a view whose stamp cannot be right,
    /// ViewError for a drone that appears twice or makes the fleet larger than `Paper.fleet_size`.
    fn integrate(
        &self,
        py: Python<'_>,
        views: Vec<PyRef<'_, PyView>>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
    ) -> PyResult<PyUpdate> {
        let views: Vec<View> = views.iter().map(|view| view.0.clone()).collect();
        released(py, || {
            let mut map = self.map.write().expect("no writer panics");
            map.integrate(&views, stamp_ns)
        })
        .map(PyUpdate::new)
        .map_err(refuse)
    }

    /// The same for views that were projected before, onto this very terrain, here or on another
    /// machine.
    ///
    /// Errors as for `integrate`, and MapFileError for an observation of another terrain.
    fn integrate_observations(
        &self,
        py: Python<'_>,
        observations: Vec<PyRef<'_, PyObservation>>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
    ) -> PyResult<PyUpdate> {
        let observations: Vec<Arc<Observation>> =
            observations.iter().map(|observation| observation.0.clone()).collect();
        released(py, || {
            let mut map = self.map.write().expect("no writer panics");
            map.integrate_observations(observations, stamp_ns)
        })
        .map(PyUpdate::new)
        .map_err(refuse)
    }

    /// Probability of crowd per voxel [V] float64, or of the voxels `ids` [N], at a stamp not before
    /// the newest instant.
    ///
    /// A voxel that nobody has seen holds the method's initial value, which is no evidence of absence:
    /// see `state`. StampError for an earlier stamp, CrowdfenceError for an id that does not exist.
    #[pyo3(signature = (stamp_ns, ids=None))]
    fn probability<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        ids: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<f64>>> {
        let probability = match ids {
            None => self.read(py, |map| map.probability(stamp_ns))?,
            Some(ids) => {
                let ids = self.ids(py, ids)?;
                self.read(py, |map| map.probability_of(&ids, stamp_ns))?
            }
        };
        Ok(probability.into_pyarray(py))
    }

    /// Bounds between which the probability of crowd lies, per voxel [V, 2] float64 or of the voxels
    /// `ids` [N, 2], at a stamp not before the newest instant. None for all but `Evidence`, whose
    /// probability is no measured rate.
    ///
    /// level  in (0, 1): how many of such intervals hold the share of crowd among places like theirs
    ///
    /// 0 and 1 where nobody has looked. StampError for an earlier stamp, CrowdfenceError for an id that
    /// does not exist and for a level out of bounds.
    #[pyo3(signature = (stamp_ns, ids=None, *, level=0.9))]
    fn interval<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        ids: Option<&Bound<'py, PyAny>>,
        level: f64,
    ) -> PyResult<Option<Bound<'py, PyArray2<f64>>>> {
        let ids = match ids {
            None => (0..self.terrain.borrow(py).terrain.voxel_count() as u32).collect(),
            Some(ids) => self.ids(py, ids)?,
        };
        let bounds = self.read(py, |map| map.interval_of(&ids, stamp_ns, level))?;
        bounds.map(|bounds| rows(py, bounds.into_flattened(), 2)).transpose()
    }

    /// `VoxelState` per voxel [V] uint8: unseen is never the same as empty.
    ///
    /// threshold      in (0, 1]: a voxel at or above it is crowd; None = the method's `default_threshold`
    /// stale_after_s  >= 0: what its last look left empty is stale once that look is older than this
    ///
    /// What is not crowd is empty where the method clears it: `Evidence` asks for evidence, the others do
    /// not. What its last look did not leave empty stays not cleared, however long ago that was.
    ///
    /// StampError for a stamp before the newest instant, CrowdfenceError for a parameter out of bounds.
    #[pyo3(signature = (stamp_ns, *, threshold=None, stale_after_s=30.0))]
    fn state<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        threshold: Option<f64>,
        stale_after_s: f64,
    ) -> PyResult<Bound<'py, PyArray1<u8>>> {
        let codes: Vec<u8> = self.read_at(py, threshold, |map, threshold| {
            let states = map.state(stamp_ns, threshold, stale_after_s)?;
            Ok(states.into_iter().map(|state| state as u8).collect())
        })?;
        Ok(codes.into_pyarray(py))
    }

    /// The voxels in state `EMPTY`, sorted ids [N] int64. Costs what was seen, not the map.
    ///
    /// Arguments and errors as for `state`.
    #[pyo3(signature = (stamp_ns, *, threshold=None, stale_after_s=30.0))]
    fn empty_ids<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        threshold: Option<f64>,
        stale_after_s: f64,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let ids =
            self.read_at(py, threshold, |map, threshold| map.empty_ids(stamp_ns, threshold, stale_after_s))?;
        Ok(id_array(py, &ids))
    }

    /// All that is known about the voxels `ids` [N] at a stamp not before the newest instant.
    ///
    /// Threshold and stale_after_s as for `state`; CrowdfenceError for an id that does not exist.
    #[pyo3(signature = (ids, stamp_ns, *, threshold=None, stale_after_s=30.0))]
    fn knowledge(
        &self,
        py: Python<'_>,
        ids: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        threshold: Option<f64>,
        stale_after_s: f64,
    ) -> PyResult<PyVoxelKnowledge> {
        let ids = self.ids(py, ids)?;
        self.read_at(py, threshold, |map, threshold| map.knowledge(&ids, stamp_ns, threshold, stale_after_s))
            .map(PyVoxelKnowledge)
    }

    /// The columns of the terrain that hold crowd at a stamp not before the newest instant: what zones
    /// are drawn on. Costs what holds crowd and what was seen since the last call, not the map.
    ///
    /// threshold  in (0, 1]: a voxel at or above it is crowd; None = the method's `default_threshold`
    ///
    /// StampError for an earlier stamp, CrowdfenceError for a threshold out of bounds.
    #[pyo3(signature = (stamp_ns, *, threshold=None))]
    fn crowd_columns(
        &self,
        py: Python<'_>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        threshold: Option<f64>,
    ) -> PyResult<PyCrowdColumns> {
        let columns = self.read_at(py, threshold, |map, threshold| map.crowd_columns(stamp_ns, threshold))?;
        Ok(PyCrowdColumns(columns))
    }

    /// The voxels that held crowd when somebody last looked at them, sorted ids [N] int64. What was
    /// forgotten since takes none away, and crowd that a late view showed is among them.
    ///
    /// threshold  in (0, 1]: what was at or above it held crowd; None = the method's `default_threshold`
    ///
    /// CrowdfenceError for a threshold out of bounds.
    #[pyo3(signature = (*, threshold=None))]
    fn crowd_ids_at_last_looks<'py>(
        &self,
        py: Python<'py>,
        threshold: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let ids = self.read_at(py, threshold, |map, threshold| map.crowd_ids_at_last_looks(threshold))?;
        Ok(id_array(py, &ids))
    }

    /// The voxels that hold crowd at a stamp not before the newest instant, sorted ids [N] int64. Costs
    /// what holds crowd and what was seen since the last call, not the map.
    ///
    /// threshold  in (0, 1]: a voxel at or above it is crowd; None = the method's `default_threshold`
    ///
    /// StampError for an earlier stamp, CrowdfenceError for a threshold out of bounds.
    #[pyo3(signature = (stamp_ns, *, threshold=None))]
    fn crowd_ids<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        threshold: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let ids = self.read_at(py, threshold, |map, threshold| map.crowd_ids(stamp_ns, threshold))?;
        Ok(id_array(py, &ids))
    }

    /// The columns of the voxels `ids` [N], each given once, at a stamp not before the newest instant.
    /// Voxels that nobody has seen are left out.
    ///
    /// StampError for an earlier stamp, CrowdfenceError for an id that does not exist.
    fn columns_of(
        &self,
        py: Python<'_>,
        ids: &Bound<'_, PyAny>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
    ) -> PyResult<PyCrowdColumns> {
        let ids = self.ids(py, ids)?;
        Ok(PyCrowdColumns(self.read(py, |map| map.columns_of(&ids, stamp_ns))?))
    }

    /// The voxels that a look of the last 2 s by itself showed as crowd, whatever other drones saw there
    /// at the time; at a stamp not before the newest instant, sorted ids [N] int64. Only `evidence` tells
    /// looks apart.
    ///
    /// threshold  in (0, 1]: the look alone leaves crowd 2 in log odds above it, and above the prior; None =
    ///            the method's `default_threshold`
    ///
    /// StampError for an earlier stamp, CrowdfenceError for a threshold out of bounds.
    #[pyo3(signature = (stamp_ns, *, threshold=None))]
    fn shown_ids<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        threshold: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let ids = self.read_at(py, threshold, |map, threshold| map.shown_ids(stamp_ns, threshold))?;
        Ok(id_array(py, &ids))
    }

    /// The voxels that such a look showed as crowd when somebody last looked at them, by that look or
    /// in the 2 s before it, sorted ids [N] int64. How long ago that was takes none away.
    ///
    /// threshold  as for `shown_ids`
    ///
    /// CrowdfenceError for a threshold out of bounds.
    #[pyo3(signature = (*, threshold=None))]
    fn shown_ids_at_last_looks<'py>(
        &self,
        py: Python<'py>,
        threshold: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let ids = self.read_at(py, threshold, |map, threshold| map.shown_ids_at_last_looks(threshold))?;
        Ok(id_array(py, &ids))
    }

    /// Whether the last look at each of the voxels `ids` [N] spoke for crowd, [N] bool: it left more of it
    /// than there was, and more than the method holds of ground that nobody has seen. Of looks that
    /// an older build wrote to a file it says no. CrowdfenceError for an id that does not exist.
    fn spoke_for_crowd<'py>(
        &self,
        py: Python<'py>,
        ids: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let ids = self.ids(py, ids)?;
        Ok(self.read(py, |map| map.spoke_for_crowd(&ids))?.into_pyarray(py))
    }

    /// Union of the fields of view so far (equation 4): [V] bool per voxel.
    fn seen<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<bool>>> {
        let seen: Vec<bool> =
            self.read(py, |map| Ok(map.last_seen_ns().map(|stamp| stamp.is_some()).collect()))?;
        Ok(seen.into_pyarray(py))
    }

    /// The same as sorted voxel ids [N] int64. Costs what was seen, not the map.
    fn seen_ids<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray1<i64>>> {
        Ok(id_array(py, &self.read(py, |map| Ok(map.seen_ids()))?))
    }

    /// How many voxels somebody has seen.
    #[getter]
    fn seen_count(&self, py: Python<'_>) -> PyResult<usize> {
        self.read(py, |map| Ok(map.seen_count()))
    }

    /// The voxels that somebody has seen, sorted ids [N] int64, and their probability of crowd [N]
    /// float64 at a stamp not before the newest instant. Costs what was seen, not the map. StampError
    /// for an earlier stamp.
    fn seen_probability<'py>(
        &self,
        py: Python<'py>,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
    ) -> PyResult<SeenProbability<'py>> {
        let (ids, probability) = self.read(py, |map| map.seen_probability(stamp_ns))?;
        Ok((id_array(py, &ids), probability.into_pyarray(py)))
    }

    /// Stamp of the last look per voxel [V] int64, or at the voxels `ids` [N]; -1 = never.
    ///
    /// CrowdfenceError for an id that does not exist.
    #[pyo3(signature = (ids=None))]
    fn last_seen_ns<'py>(
        &self,
        py: Python<'py>,
        ids: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let stamp = |stamp_ns: Option<i64>| stamp_ns.unwrap_or(-1);
        let stamps: Vec<i64> = match ids {
            None => self.read(py, |map| Ok(map.last_seen_ns().map(stamp).collect()))?,
            Some(ids) => {
                let ids = self.ids(py, ids)?;
                self.read(py, |map| Ok(map.last_seen_ns_of(&ids)?.into_iter().map(stamp).collect()))?
            }
        };
        Ok(stamps.into_pyarray(py))
    }

    /// Drones that have ever seen one of the voxels `ids` [N], by name. A map that was saved by a
    /// build that did not keep this knows nobody. CrowdfenceError for an id that does not exist.
    fn seen_by(&self, py: Python<'_>, ids: &Bound<'_, PyAny>) -> PyResult<Vec<String>> {
        let ids = self.ids(py, ids)?;
        self.read(py, |map| Ok(map.seen_by(&ids)?.into_iter().map(str::to_owned).collect()))
    }

    /// Probability from which a voxel is called crowd unless the caller says otherwise: the method's.
    fn default_threshold(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, |map| Ok(map.method().default_threshold()))
    }

    /// The map as bytes, with a checksum; the terrain is not among them.
    fn to_bytes<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.read(py, |map| Ok(map.to_bytes()))?;
        Ok(PyBytes::new(py, &bytes))
    }

    /// The map that `to_bytes` wrote, on its terrain. MapFileError for bytes that are damaged, of
    /// another kind, of a newer version or of another terrain.
    #[staticmethod]
    fn from_bytes(py: Python<'_>, data: Cow<'_, [u8]>, terrain: Py<PyTerrain>) -> PyResult<Self> {
        let voxels = terrain.borrow(py).terrain.clone();
        let map = released(py, || CrowdMap::from_bytes(&data, voxels)).map_err(refuse)?;
        Ok(PyCrowdMap { map: RwLock::new(map), terrain })
    }

    /// Write the map to a file, in one step: what stood there stays until the new file is whole.
    /// OSError when it cannot be written.
    //
    // Files are Python's part.
    fn save(&self, py: Python<'_>, path: &Bound<'_, PyAny>) -> PyResult<()> {
        py.import("crowdfence.atomic_file")?.call_method1("write_bytes", (path, self.to_bytes(py)?))?;
        Ok(())
    }

    /// The map that `save` wrote, on its terrain. MapFileError as for `from_bytes`, OSError when the
    /// file cannot be read.
    #[staticmethod]
    fn load(py: Python<'_>, path: &Bound<'_, PyAny>, terrain: Py<PyTerrain>) -> PyResult<Self> {
        let path = py.import("pathlib")?.call_method1("Path", (path,))?;
        let data = path.call_method0("read_bytes")?;
        PyCrowdMap::from_bytes(py, data.extract()?, terrain)
            .map_err(|error| MapFileError::new_err(format!("{path}: {}", error.value(py))))
    }

    fn __repr__(&self, py: Python<'_>) -> PyResult<String> {
        self.read(py, |map| {
            Ok(format!(
                "CrowdMap({} voxels, {}, {} instants)",
                map.terrain().voxel_count(),
                map.method().name(),
                map.instant_count()
            ))
        })
    }
}
