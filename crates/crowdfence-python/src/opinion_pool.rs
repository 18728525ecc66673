use crowdfence::{OpinionPool, Rates, TemporalBlend, Unseen};
use numpy::{IntoPyArray, PyArray1};
use pyo3::prelude::*;

use crate::arrays::{Array, refuse};
use crate::errors::CrowdfenceError;

/// What a detector is worth: two rates strictly between 0 and 1, the true positive rate the larger one.
///
/// true_positive   P(B = 1 | A = 1), how often it calls crowd what is crowd
/// false_positive  P(B = 1 | A = 0), how often it calls crowd what is none
///
/// CrowdfenceError names a rate out of bounds or two rates that are swapped. Rates cannot change; they
/// can be compared, hashed and pickled.
#[pyclass(frozen, name = "Rates", module = "crowdfence", eq)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyRates(pub Rates);

#[pymethods]
impl PyRates {
    #[new]
    fn new(true_positive: f64, false_positive: f64) -> PyResult<Self> {
        Rates::new(true_positive, false_positive).map(PyRates).map_err(refuse)
    }

    /// P(B = 1 | A = 1).
    #[getter]
    fn true_positive(&self) -> f64 {
        self.0.true_positive()
    }

    /// P(B = 1 | A = 0).
    #[getter]
    fn false_positive(&self) -> f64 {
        self.0.false_positive()
    }

    /// P(B = 0 | A = 1) = 1 - true_positive.
    #[getter]
    fn false_negative(&self) -> f64 {
        1.0 - self.0.true_positive()
    }

    /// P(B = 0 | A = 0) = 1 - false_positive.
    #[getter]
    fn true_negative(&self) -> f64 {
        1.0 - self.0.false_positive()
    }

    fn __getnewargs__(&self) -> (f64, f64) {
        (self.true_positive(), self.false_positive())
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.__getnewargs__().into_pyobject(py)?.hash()
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
            return Err(CrowdfenceError::new_err(format!(
                "unseen is {unseen:?}; it must be \"fleet\" or \"visible\""
            )));
        }
    };
    OpinionPool::new(rates.0, prior, b_threshold, unseen, normalise).map_err(refuse)
}

/// Probability and "somebody saw it" per voxel.
type Pooled<'py> = (Bound<'py, PyArray1<f64>>, Bound<'py, PyArray1<bool>>);

/// Equations 1-2, the linear opinion pool over the drones of a fleet: (probability [V], seen [V]).
///
/// P(A = 1) = sum over drones i of w_i P(A = 1 | B_i = b_i) with w_i = |m_i - 0.5| / (0.5 N) and b_i =
/// 1 where m_i > b_threshold; P(A | B) follows from rates and prior by Bayes' rule. The weights need
/// not sum to 1.
///
/// m            [N drones, V voxels] mean heatmap values in [0, 1], read only where `visible`
/// visible      [N, V] bool, which drone sees which voxel
/// rates        of the detector
/// prior        P(A = 1), strictly between 0 and 1
/// b_threshold  in [0, 1)
/// unseen       "fleet": a drone that does not see the voxel enters with m = 0, as printed; "visible": it is
///              left out, N counts those that see it, and what nobody sees has the prior
/// normalise    divide the weights by their sum; where they are all 0 the result is the prior
///
/// probability is float64 and seen bool: whether any drone sees the voxel. CrowdfenceError names the
/// value out of bounds, or the array whose shape does not fit.
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

/// Equation 3, temporal blending with decay: P~ per voxel [V] float64.
///
/// With beta = exp(-decay_per_s * elapsed_s): alpha * pooled + (1 - alpha) * beta * previous where a
/// voxel is seen, beta * previous where it is not.
///
/// previous     [V] P~ after the last look, in [0, 1]
/// elapsed_s    [V] time since that look, >= 0
/// pooled       [V] probability by equation 1, in [0, 1], read only where `seen`
/// seen         [V] bool
/// alpha        weight of the newest instant, in (0, 1]
/// decay_per_s  lambda, >= 0
///
/// CrowdfenceError names the value out of bounds, or the array whose length does not fit.
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
