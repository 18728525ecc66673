use crowdfence::{OpinionPool, Rates, TemporalBlend, Unseen};
use numpy::{IntoPyArray, PyArray1};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::arrays::{Array, refuse};

#[pyclass(frozen, name = "Rates", module = "crowdfence", eq)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyRates(pub Rates);

#[pymethods]
impl PyRates {
    #[new]
    fn new(true_positive: f64, false_positive: f64) -> PyResult<Self> {
        Rates::new(true_positive, false_positive).map(PyRates).map_err(refuse)
    }

    #[getter]
    fn true_positive(&self) -> f64 {
        self.0.true_positive()
    }

    #[getter]
    fn false_positive(&self) -> f64 {
        self.0.false_positive()
    }

    #[getter]
    fn false_negative(&self) -> f64 {
        1.0 - self.0.true_positive()
    }

    #[getter]
    fn true_negative(&self) -> f64 {
        1.0 - self.0.false_positive()
    }

    pub fn __repr__(&self) -> String {
        format!("Rates(true_positive={}, false_positive={})", self.true_positive(), self.false_positive())
    }
}

pub fn opinion_pool(
    rates: &PyRates,
    prior: f64,
    b_threshold: f64,
    unseen: &str,
    normalise: bool,
) -> PyResult<OpinionPool> {
    let unseen = match unseen {
        "fleet" => Unseen::Fleet,
        "visible" => Unseen::Visible,
        _ => {
            return Err(PyValueError::new_err(format!(
                "unseen is {unseen:?}; it must be \"fleet\" or \"visible\""
            )));
        }
    };
    OpinionPool::new(rates.0, prior, b_threshold, unseen, normalise).map_err(refuse)
}

/// Probability and "somebody saw it" per voxel.
type Pooled<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>);

#[pyfunction]
#[pyo3(signature = (m, visible, rates, prior, *, b_threshold=0.5, unseen="fleet", normalise=false))]
#[allow(clippy::too_many_arguments)] // the switches of equation 1, keyword-only in Python
pub fn pool<'py>(
    py: Python<'py>,
    m: &Bound<'py, PyAny>,
    visible: &Bound<'py, PyAny>,
    rates: &PyRates,
    prior: f64,
    b_threshold: f64,
    unseen: &str,
    normalise: bool,
) -> PyResult<Pooled<'py>> {
    let pool = opinion_pool(rates, prior, b_threshold, unseen, normalise)?;
    let m = Array::<f64>::new(m, "m", &[None, None])?;
    let [drones, voxels] = [m.shape()[0], m.shape()[1]];
    let visible = Array::<bool>::new(visible, "visible", &[Some(drones), Some(voxels)])?.to_vec()?;
    let (probability, seen): (Vec<f64>, Vec<bool>) =
        pool.pool_all(&m.to_vec()?, &visible, drones).map_err(refuse)?.into_iter().unzip();
    Ok((probability.into_pyarray(py), seen.into_pyarray(py)))
}

#[pyfunction]
#[pyo3(signature = (previous, elapsed_s, pooled, seen, *, alpha, decay_per_s))]
pub fn blend<'py>(
    py: Python<'py>,
    previous: &Bound<'py, PyAny>,
    elapsed_s: &Bound<'py, PyAny>,
    pooled: &Bound<'py, PyAny>,
    seen: &Bound<'py, PyAny>,
    alpha: f64,
    decay_per_s: f64,
) -> PyResult<Bound<'py, PyArray1<f64>>> {
    let blend = TemporalBlend::new(alpha, decay_per_s).map_err(refuse)?;
    let previous = Array::<f64>::new(previous, "previous", &[None])?.to_vec()?;
    let shape = [Some(previous.len())];
    let elapsed_s = Array::<f64>::new(elapsed_s, "elapsed_s", &shape)?.to_vec()?;
    let pooled = Array::<f64>::new(pooled, "pooled", &shape)?.to_vec()?;
    let seen = Array::<bool>::new(seen, "seen", &shape)?.to_vec()?;
    blend
        .blend_all(&previous, &elapsed_s, &pooled, &seen)
        .map(|blended| blended.into_pyarray(py))
        .map_err(refuse)
}
