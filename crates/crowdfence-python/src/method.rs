use crowdfence::method::{DecayUnit, Initial, Parameter};
use crowdfence::{Method, Or, Paper, TemporalBlend};
use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::refuse;
use crate::comparison::{PyLinearPool, PyLogOdds, PyLogPool, PyMovingAverage};
use crate::errors::CrowdfenceError;
use crate::evidence::PyEvidence;
use crate::opinion_pool::{PyRates, opinion_pool};

/// Method `paper`: equations 1-3 with a switch for everything that the paper leaves open.
///
/// rates        of the detector, which decides P(A | B)
/// prior        P(A = 1), strictly between 0 and 1
/// alpha        weight of the newest instant in equation 3, in (0, 1]; 1 is the paper's Policy 1
/// decay        lambda of equation 3, >= 0, per `decay_unit`
/// fleet_size   N of equation 1, in [1, 10000]; no more drones than this may ever give a view
/// b_threshold  a view calls a voxel crowd when its mean heatmap value is above this, in [0, 1)
/// unseen       what a drone that does not see a voxel says: "fleet", m = 0 with full weight as printed, or
///              "visible", nothing
/// normalise    divide the weights of equation 2 by their sum
/// initial      P~ before the first look: "zero", "prior", or "first", which takes the first look whole
/// decay_unit   what lambda counts: "second", or "frame", the instants integrated
///
/// CrowdfenceError names the parameter that is out of bounds. It cannot change; it can be compared and
/// pickled.
#[pyclass(frozen, name = "Paper", module = "crowdfence", eq)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyPaper(pub Paper);

#[pymethods]
impl PyPaper {
    #[new]
    #[pyo3(signature = (rates, prior, *, alpha=0.1, decay=0.0005, fleet_size, b_threshold=0.5, unseen="fleet",
                        normalise=false, initial="zero", decay_unit="second"))]
    #[allow(clippy::too_many_arguments)] // the switches of the paper, keyword-only in Python
    fn new(
        rates: &PyRates,
        prior: f64,
        alpha: f64,
        decay: f64,
        #[pyo3(from_py_with = fleet_size)] fleet_size: usize,
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
        let decay_unit = match decay_unit {
            "second" => DecayUnit::Second,
            "frame" => DecayUnit::Frame,
            _ => return Err(not_one_of("decay_unit", decay_unit, "\"second\" or \"frame\"")),
        };
        let pool = opinion_pool(rates, prior, b_threshold, unseen, normalise)?;
        TemporalBlend::new(alpha, decay)
            .and_then(|blend| Paper::new(pool, blend, fleet_size, initial, decay_unit))
            .map(PyPaper)
            .map_err(refuse)
    }

    /// Name of the method: "paper".
    #[getter]
    fn name(&self) -> &'static str {
        Method::Paper(self.0).name()
    }

    /// Rates of the detector.
    #[getter]
    fn rates(&self) -> PyRates {
        PyRates(self.0.pool().rates())
    }

    /// P(A = 1).
    #[getter]
    fn prior(&self) -> f64 {
        self.0.pool().prior()
    }

    /// Weight of the newest instant in equation 3.
    #[getter]
    fn alpha(&self) -> f64 {
        self.0.blend().alpha()
    }

    /// lambda of equation 3, per `decay_unit`.
    #[getter]
    fn decay(&self) -> f64 {
        self.0.blend().decay()
    }

    /// What lambda counts: "second" or "frame".
    #[getter]
    fn decay_unit(&self) -> &'static str {
        self.0.decay_unit().name()
    }

    /// N of equation 1.
    #[getter]
    fn fleet_size(&self) -> usize {
        self.0.fleet_size()
    }

    /// A view calls a voxel crowd when its mean heatmap value is above this.
    #[getter]
    fn b_threshold(&self) -> f64 {
        self.0.pool().b_threshold()
    }

    /// What a drone that does not see a voxel says: "fleet" or "visible".
    #[getter]
    fn unseen(&self) -> &'static str {
        self.0.pool().unseen().name()
    }

    /// Whether the weights of equation 2 are divided by their sum.
    #[getter]
    fn normalise(&self) -> bool {
        self.0.pool().normalise()
    }

    /// P~ before the first look: "zero", "prior" or "first".
    #[getter]
    fn initial(&self) -> &'static str {
        self.0.initial().name()
    }

    /// P(A = 1 | b = 1), by Bayes' rule from rates and prior.
    #[getter]
    fn post_positive(&self) -> f64 {
        self.0.pool().post_positive()
    }

    /// P(A = 1 | b = 0), by Bayes' rule from rates and prior.
    #[getter]
    fn post_negative(&self) -> f64 {
        self.0.pool().post_negative()
    }

    /// Probability from which a voxel is called crowd unless the caller says otherwise: a quarter of
    /// the way from a place that all drones see empty to one where a single drone of the fleet is sure
    /// of crowd.
    #[getter]
    fn default_threshold(&self) -> f64 {
        Method::Paper(self.0).default_threshold()
    }

    /// What the method was told, by name, for reports.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        parameters(py, Method::Paper(self.0))
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((PyRates, f64), Bound<'py, PyDict>)> {
        let options = self.parameters(py)?;
        for positional in ["true_positive_rate", "false_positive_rate", "prior"] {
            options.del_item(positional)?;
        }
        Ok(((self.rates(), self.prior()), options))
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.__repr__().into_pyobject(py)?.hash()
    }

    fn __repr__(&self) -> String {
        format!(
            "Paper({}, prior={}, alpha={}, decay={}, fleet_size={}, b_threshold={}, unseen='{}', normalise={}, \
             initial='{}', decay_unit='{}')",
            self.rates().__repr__(),
            self.prior(),
            self.alpha(),
            self.decay(),
            self.fleet_size(),
            self.b_threshold(),
            self.unseen(),
            if self.normalise() { "True" } else { "False" },
            self.initial(),
            self.decay_unit()
        )
    }
}

/// A number of drones that fits no machine word is refused as the core refuses one that does.
fn fleet_size(value: &Bound<'_, PyAny>) -> PyResult<usize> {
    value.extract().or_else(|error: PyErr| {
        if !error.is_instance_of::<PyOverflowError>(value.py()) {
            return Err(error);
        }
        let shown = value.str()?.to_string();
        Err(CrowdfenceError::new_err(format!("fleet_size is {shown:.60}; it must be in [1, 10000]")))
    })
}

pub fn not_one_of(name: &str, value: &str, allowed: &str) -> PyErr {
    CrowdfenceError::new_err(format!("{name} is {value:?}; it must be {allowed}"))
}

pub fn parameters(py: Python<'_>, method: Method) -> PyResult<Bound<'_, PyDict>> {
    let dict = PyDict::new(py);
    for (name, parameter) in method.parameters() {
        match parameter {
            Parameter::Number(number) => dict.set_item(name, number)?,
            Parameter::Count(count) => dict.set_item(name, count)?,
            Parameter::Switch(on) => dict.set_item(name, on)?,
            Parameter::Choice(word) => dict.set_item(name, word)?,
        }
    }
    Ok(dict)
}

/// Baseline `or`: a voxel once called crowd by any view stays crowd. Instants may come in any order.
///
/// b_threshold  a view calls a voxel crowd when its mean heatmap value is above this, in [0, 1)
///
/// CrowdfenceError for a threshold out of bounds. It cannot change; it can be compared and pickled.
#[pyclass(frozen, name = "Or", module = "crowdfence", eq)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyOr(pub Or);

#[pymethods]
impl PyOr {
    #[new]
    #[pyo3(signature = (*, b_threshold=0.5))]
    fn new(b_threshold: f64) -> PyResult<Self> {
        Or::new(b_threshold).map(PyOr).map_err(refuse)
    }

    /// Name of the method: "or".
    #[getter]
    fn name(&self) -> &'static str {
        Method::Or(self.0).name()
    }

    /// A view calls a voxel crowd when its mean heatmap value is above this.
    #[getter]
    fn b_threshold(&self) -> f64 {
        Method::Or(self.0).b_threshold()
    }

    /// Probability from which a voxel is called crowd: 0.5, as `or` knows only 0 and 1.
    #[getter]
    fn default_threshold(&self) -> f64 {
        Method::Or(self.0).default_threshold()
    }

    /// What the method was told, by name, for reports.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        parameters(py, Method::Or(self.0))
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((), Bound<'py, PyDict>)> {
        Ok(((), self.parameters(py)?))
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        self.__repr__().into_pyobject(py)?.hash()
    }

    fn __repr__(&self) -> String {
        format!("Or(b_threshold={})", self.b_threshold())
    }
}

#[derive(FromPyObject)]
pub enum MethodArgument<'py> {
    Evidence(PyRef<'py, PyEvidence>),
    Paper(PyRef<'py, PyPaper>),
    Or(PyRef<'py, PyOr>),
    LinearPool(PyRef<'py, PyLinearPool>),
    LogPool(PyRef<'py, PyLogPool>),
    LogOdds(PyRef<'py, PyLogOdds>),
    MovingAverage(PyRef<'py, PyMovingAverage>),
}

impl MethodArgument<'_> {
    pub fn method(&self) -> Method {
        match self {
            MethodArgument::Evidence(evidence) => Method::Evidence(evidence.0.clone()),
            MethodArgument::Paper(paper) => Method::Paper(paper.0),
            MethodArgument::Or(or) => Method::Or(or.0),
            MethodArgument::LinearPool(pool) => Method::LinearPool(pool.0),
            MethodArgument::LogPool(pool) => Method::LogPool(pool.0.clone()),
            MethodArgument::LogOdds(odds) => Method::LogOdds(odds.0),
            MethodArgument::MovingAverage(average) => Method::MovingAverage(average.0.clone()),
        }
    }
}

pub fn method_object(py: Python<'_>, method: Method) -> PyResult<Py<PyAny>> {
    match method {
        Method::Evidence(evidence) => Ok(Py::new(py, PyEvidence(evidence))?.into_any()),
        Method::Paper(paper) => Ok(Py::new(py, PyPaper(paper))?.into_any()),
        Method::Or(or) => Ok(Py::new(py, PyOr(or))?.into_any()),
        Method::LinearPool(pool) => Ok(Py::new(py, PyLinearPool(pool))?.into_any()),
        Method::LogPool(pool) => Ok(Py::new(py, PyLogPool(pool))?.into_any()),
        Method::LogOdds(odds) => Ok(Py::new(py, PyLogOdds(odds))?.into_any()),
        Method::MovingAverage(average) => Ok(Py::new(py, PyMovingAverage(average))?.into_any()),
    }
}
