use std::sync::Arc;

use crowdfence::{Coverage, Observation, Projection};
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{id_array, refuse};
use crate::terrain::PyTerrain;
use crate::view::PyView;

#[pyclass(frozen, name = "Observation", module = "crowdfence")]
#[derive(Clone)]
pub struct PyObservation(pub Arc<Observation>);

#[pymethods]
impl PyObservation {
    #[getter]
    fn voxel_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        id_array(py, &self.0.voxel_ids)
    }

    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.0.mean.clone().into_pyarray(py)
    }

    #[getter]
    fn pixel_count<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        id_array(py, &self.0.pixel_count)
    }

    #[getter]
    fn occluded_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        id_array(py, &self.0.occluded_ids)
    }

    fn __len__(&self) -> usize {
        self.0.voxel_ids.len()
    }

    fn __repr__(&self) -> String {
        format!("Observation({} voxels)", self.0.voxel_ids.len())
    }
}

pub fn projection(max_range_m: f64, target_height_m: f64, coverage: &str) -> PyResult<Projection> {
    let coverage = match coverage {
        "rays" => Coverage::Rays,
        "full" => Coverage::Full,
        _ => {
            return Err(PyValueError::new_err(format!(
                "coverage is {coverage:?}; it must be \"rays\" or \"full\""
            )));
        }
    };
    Projection::new(max_range_m, target_height_m, coverage).map_err(refuse)
}

#[pyfunction]
#[pyo3(signature = (view, terrain, *, max_range_m, target_height_m=0.0, coverage="rays"))]
pub fn project(
    py: Python<'_>,
    view: &PyView,
    terrain: &PyTerrain,
    max_range_m: f64,
    target_height_m: f64,
    coverage: &str,
) -> PyResult<PyObservation> {
    let projection = projection(max_range_m, target_height_m, coverage)?;
    let observation = py.detach(|| crowdfence::project(&view.0, &terrain.terrain, &projection));
    Ok(PyObservation(Arc::new(observation)))
}
