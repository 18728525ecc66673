// The methods that `evidence` is compared with, on the same engine.

use crowdfence::{Calibration, LinearPool, LogOdds, LogPool, Method, MovingAverage, TemporalBlend};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::refuse;
use crate::evidence::PyLikelihoodRatio;
use crate::method::parameters;
use crate::opinion_pool::PyRates;

/// Method `linear-pool`, for comparison: equations 1-3 with the drones that see a place alone, weights
/// that sum to 1, and forgetting towards the prior.
///
/// rates        of the detector, which decides P(A | B)
/// prior        P(A = 1), strictly between 0 and 1
/// alpha        weight of the newest instant, in (0, 1]
/// decay        lambda per second, >= 0
/// b_threshold  a view calls a voxel crowd when its mean heatmap value is above this, in [0, 1)
///
/// CrowdfenceError names the parameter that is out of bounds. It cannot change; it can be compared and
/// pickled.
#[pyclass(frozen, name = "LinearPool", module = "crowdfence", eq)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyLinearPool(pub LinearPool);

#[pymethods]
impl PyLinearPool {
    #[new]
    #[pyo3(signature = (rates, prior, *, alpha=0.1, decay=0.0005, b_threshold=0.5))]
    fn new(rates: &PyRates, prior: f64, alpha: f64, decay: f64, b_threshold: f64) -> PyResult<Self> {
        TemporalBlend::new(alpha, decay)
            .and_then(|blend| LinearPool::new(rates.0, prior, b_threshold, blend))
            .map(PyLinearPool)
            .map_err(refuse)
    }

    /// Name of the method: "linear-pool".
    #[getter]
    fn name(&self) -> &'static str {
        self.method().name()
    }

    /// A view calls a voxel crowd when its mean heatmap value is above this.
    #[getter]
    fn b_threshold(&self) -> f64 {
        self.method().b_threshold()
    }

    /// Probability from which a voxel is called crowd unless the caller says otherwise: a quarter of the
    /// way from what all drones see empty to what all are sure of.
    #[getter]
    fn default_threshold(&self) -> f64 {
        self.method().default_threshold()
    }

    /// What the method was told, by name, for reports.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        parameters(py, self.method())
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((PyRates, f64), Bound<'py, PyDict>)> {
        let options = without(self.parameters(py)?, &["true_positive_rate", "false_positive_rate", "prior"])?;
        Ok(((PyRates(self.0.pool().rates()), self.0.pool().prior()), options))
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.__repr__().into_pyobject(py)?.hash()
    }

    fn __repr__(&self) -> String {
        let (pool, blend) = (self.0.pool(), self.0.blend());
        format!(
            "LinearPool({}, {}, alpha={}, decay={}, b_threshold={})",
            PyRates(pool.rates()).__repr__(),
            pool.prior(),
            blend.alpha(),
            blend.decay(),
            pool.b_threshold()
        )
    }
}

impl PyLinearPool {
    fn method(&self) -> Method {
        Method::LinearPool(self.0)
    }
}

/// Method `log-pool`, for comparison: the mean of the log likelihood ratios of the drones that see a
/// place, blended over time as in equation 3 and forgotten towards the prior.
///
/// likelihood  how strongly a look speaks for or against crowd
/// prior       P(A = 1) where nobody has looked, strictly between 0 and 1
/// alpha       weight of the newest instant, in (0, 1]
/// decay       lambda per second, >= 0
/// threshold   a voxel at or above this probability is crowd, strictly between 0 and 1
/// focal_px    > 0, of the cameras of the calibration: as of `Evidence`
///
/// CrowdfenceError names the parameter that is out of bounds. It cannot change; it can be compared and
/// pickled.
#[pyclass(frozen, name = "LogPool", module = "crowdfence", eq)]
#[derive(Clone, PartialEq)]
pub struct PyLogPool(pub LogPool);

#[pymethods]
impl PyLogPool {
    #[new]
    #[pyo3(signature = (likelihood, *, prior, alpha, decay, threshold, focal_px))]
    fn new(
        likelihood: &PyLikelihoodRatio,
        prior: f64,
        alpha: f64,
        decay: f64,
        threshold: f64,
        focal_px: f64,
    ) -> PyResult<Self> {
        Calibration::new(likelihood.0.clone(), prior, focal_px)
            .and_then(|calibration| LogPool::new(calibration, TemporalBlend::new(alpha, decay)?, threshold))
            .map(PyLogPool)
            .map_err(refuse)
    }

    /// Name of the method: "log-pool".
    #[getter]
    fn name(&self) -> &'static str {
        self.method().name()
    }

    /// How strongly a look speaks for or against crowd.
    #[getter]
    fn likelihood(&self) -> PyLikelihoodRatio {
        PyLikelihoodRatio(self.0.calibration().likelihood().clone())
    }

    /// Pixels above this show crowd, where crowd that meets no ground is counted; it decides no more.
    #[getter]
    fn b_threshold(&self) -> f64 {
        self.method().b_threshold()
    }

    /// Probability from which a voxel is called crowd unless the caller says otherwise.
    #[getter]
    fn default_threshold(&self) -> f64 {
        self.method().default_threshold()
    }

    /// What the method was told beside the likelihood, by name, for reports.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        parameters(py, self.method())
    }

    fn __getnewargs_ex__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<((PyLikelihoodRatio,), Bound<'py, PyDict>)> {
        Ok(((self.likelihood(),), self.parameters(py)?))
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.__repr__().into_pyobject(py)?.hash()
    }

    fn __repr__(&self) -> String {
        let (calibration, blend) = (self.0.calibration(), self.0.blend());
        format!(
            "LogPool({}, prior={}, alpha={}, decay={}, threshold={}, focal_px={})",
            self.likelihood().__repr__(),
            calibration.prior(),
            blend.alpha(),
            blend.decay(),
            self.default_threshold(),
            calibration.focal_px()
        )
    }
}

impl PyLogPool {
    fn method(&self) -> Method {
        Method::LogPool(self.0.clone())
    }
}

/// Method `log-odds`, for comparison: every look adds to the log odds, between two clamps, as in OctoMap.
/// Nothing is forgotten.
///
/// rates        of the detector: what a look with crowd and one without add
/// prior        P(A = 1), strictly between 0 and 1
/// b_threshold  a view calls a voxel crowd when its mean heatmap value is above this, in [0, 1)
/// clamp_low    lowest log odds, below 0
/// clamp_high   highest log odds, above 0
///
/// The defaults of prior and clamps are OctoMap's. CrowdfenceError names the parameter that is out of
/// bounds. It cannot change; it can be compared and pickled.
#[pyclass(frozen, name = "LogOdds", module = "crowdfence", eq)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyLogOdds(pub LogOdds);

#[pymethods]
impl PyLogOdds {
    #[new]
    // PyO3 tells of a negative default no more than that there is one.
    #[pyo3(
        signature = (rates, prior=0.5, *, b_threshold=0.5, clamp_low=-2.0, clamp_high=3.5),
        text_signature = "(rates, prior=0.5, *, b_threshold=0.5, clamp_low=-2.0, clamp_high=3.5)"
    )]
    fn new(rates: &PyRates, prior: f64, b_threshold: f64, clamp_low: f64, clamp_high: f64) -> PyResult<Self> {
        LogOdds::new(rates.0, prior, b_threshold, [clamp_low, clamp_high]).map(PyLogOdds).map_err(refuse)
    }

    /// Name of the method: "log-odds".
    #[getter]
    fn name(&self) -> &'static str {
        self.method().name()
    }

    /// A view calls a voxel crowd when its mean heatmap value is above this.
    #[getter]
    fn b_threshold(&self) -> f64 {
        self.method().b_threshold()
    }

    /// Probability from which a voxel is called crowd: 0.5, as in OctoMap.
    #[getter]
    fn default_threshold(&self) -> f64 {
        self.method().default_threshold()
    }

    /// What the method was told, by name, for reports.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        parameters(py, self.method())
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((PyRates, f64), Bound<'py, PyDict>)> {
        let options = without(self.parameters(py)?, &["true_positive_rate", "false_positive_rate", "prior"])?;
        Ok(((PyRates(self.0.rates()), self.0.prior()), options))
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.__repr__().into_pyobject(py)?.hash()
    }

    fn __repr__(&self) -> String {
        let [low, high] = self.0.clamp();
        format!(
            "LogOdds({}, {}, b_threshold={}, clamp_low={}, clamp_high={})",
            PyRates(self.0.rates()).__repr__(),
            self.0.prior(),
            self.b_threshold(),
            low,
            high
        )
    }
}

impl PyLogOdds {
    fn method(&self) -> Method {
        Method::LogOdds(self.0)
    }
}

/// Method `moving-average`, for comparison: the mean of the calibrated scores of all looks, which fade
/// with their age. Instants may come in any order.
///
/// likelihood  how strongly a look speaks for or against crowd
/// prior       P(A = 1) where nobody has looked, strictly between 0 and 1
/// memory_s    > 0, after so many seconds a look weighs 1 / e of what it did
/// threshold   a voxel at or above this probability is crowd, strictly between 0 and 1
/// focal_px    > 0, of the cameras of the calibration: as of `Evidence`
///
/// CrowdfenceError names the parameter that is out of bounds. It cannot change; it can be compared and
/// pickled.
#[pyclass(frozen, name = "MovingAverage", module = "crowdfence", eq)]
#[derive(Clone, PartialEq)]
pub struct PyMovingAverage(pub MovingAverage);

#[pymethods]
impl PyMovingAverage {
    #[new]
    #[pyo3(signature = (likelihood, *, prior, memory_s, threshold, focal_px))]
    fn new(
        likelihood: &PyLikelihoodRatio,
        prior: f64,
        memory_s: f64,
        threshold: f64,
        focal_px: f64,
    ) -> PyResult<Self> {
        Calibration::new(likelihood.0.clone(), prior, focal_px)
            .and_then(|calibration| MovingAverage::new(calibration, memory_s, threshold))
            .map(PyMovingAverage)
            .map_err(refuse)
    }

    /// Name of the method: "moving-average".
    #[getter]
    fn name(&self) -> &'static str {
        self.method().name()
    }

    /// How strongly a look speaks for or against crowd.
    #[getter]
    fn likelihood(&self) -> PyLikelihoodRatio {
        PyLikelihoodRatio(self.0.calibration().likelihood().clone())
    }

    /// Pixels above this show crowd, where crowd that meets no ground is counted; it decides no more.
    #[getter]
    fn b_threshold(&self) -> f64 {
        self.method().b_threshold()
    }

    /// Probability from which a voxel is called crowd unless the caller says otherwise.
    #[getter]
    fn default_threshold(&self) -> f64 {
        self.method().default_threshold()
    }

    /// What the method was told beside the likelihood, by name, for reports.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        parameters(py, self.method())
    }

    fn __getnewargs_ex__<'py>(
        &self,
        py: Python<'py>,
    ) -> PyResult<((PyLikelihoodRatio,), Bound<'py, PyDict>)> {
        Ok(((self.likelihood(),), self.parameters(py)?))
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.__repr__().into_pyobject(py)?.hash()
    }

    fn __repr__(&self) -> String {
        let calibration = self.0.calibration();
        format!(
            "MovingAverage({}, prior={}, memory_s={}, threshold={}, focal_px={})",
            self.likelihood().__repr__(),
            calibration.prior(),
            self.0.memory_s(),
            self.default_threshold(),
            calibration.focal_px()
        )
    }
}

impl PyMovingAverage {
    fn method(&self) -> Method {
        Method::MovingAverage(self.0.clone())
    }
}

fn without<'py>(options: Bound<'py, PyDict>, positional: &[&str]) -> PyResult<Bound<'py, PyDict>> {
    positional.iter().try_for_each(|name| options.del_item(name))?;
    Ok(options)
}
