use std::sync::Arc;

use crowdfence::{Evidence, EvidenceSettings, FromBelow, LikelihoodRatio, Method};
use numpy::{IntoPyArray, PyArray1, PyArray3, PyArrayMethods};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::arrays::{Array, refuse};
use crate::method::{not_one_of, parameters};

/// How strongly a look speaks for crowd: ln P(m | crowd) / P(m | no crowd) by ground sample distance, tilt
/// and mean heatmap value m, as measured on missions whose truth is known.
///
/// gsd_m      [D - 1] metres per pixel at which one bin ends and the next begins, increasing, > 0
/// tilt_deg   [T - 1] the same for degrees below the horizon
/// mean       [M - 1] the same for m
/// log_ratio  [D, T, M] natural logarithm, inside [-20, 20]
/// finer      (times, LikelihoodRatio) or None: what was measured of cameras that are so many times as
///            fine, in (1, 1000], by their own metres per pixel. A camera between the two lies between what
///            both say; a look of a finer one speaks no more against crowd than with theirs
///
/// A value on a border belongs to the bin above, of `mean` to the bin below; what lies beyond the borders
/// belongs to the first or the last bin. CrowdfenceError for borders that do not increase and for a table of
/// another shape. It cannot change; it can be compared and pickled.
#[pyclass(frozen, name = "LikelihoodRatio", module = "crowdfence", eq)]
#[derive(Clone, PartialEq)]
pub struct PyLikelihoodRatio(pub Arc<LikelihoodRatio>);

type Columns<'py> = (
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray1<f32>>,
    Bound<'py, PyArray3<f32>>,
    Option<(f32, PyLikelihoodRatio)>,
);

#[pymethods]
impl PyLikelihoodRatio {
    #[new]
    #[pyo3(signature = (gsd_m, tilt_deg, mean, log_ratio, finer=None))]
    fn new(
        gsd_m: &Bound<'_, PyAny>,
        tilt_deg: &Bound<'_, PyAny>,
        mean: &Bound<'_, PyAny>,
        log_ratio: &Bound<'_, PyAny>,
        finer: Option<(f32, Bound<'_, PyLikelihoodRatio>)>,
    ) -> PyResult<Self> {
        let borders = |value, name| Array::<f32>::new(value, name, &[None])?.to_vec();
        let (gsd_m, tilt_deg, mean) =
            (borders(gsd_m, "gsd_m")?, borders(tilt_deg, "tilt_deg")?, borders(mean, "mean")?);
        let shape = [&gsd_m, &tilt_deg, &mean].map(|borders| Some(borders.len() + 1));
        let table = Array::<f32>::new(log_ratio, "log_ratio", &shape)?.to_vec()?;
        let ratio = LikelihoodRatio::new(gsd_m, tilt_deg, mean, table).map_err(refuse)?;
        let ratio = match finer {
            Some((times, table)) => {
                ratio.with_finer(times, LikelihoodRatio::clone(&table.get().0)).map_err(refuse)?
            }
            None => ratio,
        };
        Ok(PyLikelihoodRatio(Arc::new(ratio)))
    }

    /// Borders of the ground sample distance [D - 1] float32, metres per pixel.
    #[getter]
    fn gsd_m<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.column(py, 0)
    }

    /// Borders of the tilt [T - 1] float32, degrees below the horizon.
    #[getter]
    fn tilt_deg<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.column(py, 1)
    }

    /// Borders of the mean heatmap value [M - 1] float32.
    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        self.column(py, 2)
    }

    /// The table [D, T, M] float32.
    #[getter]
    fn log_ratio<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        let [gsd, tilt, mean, _] = self.0.columns().map(|column| column.len() + 1);
        self.column(py, 3).reshape([gsd, tilt, mean])
    }

    /// How many times as fine the cameras of another table are, and that table; None without one.
    #[getter]
    fn finer(&self) -> Option<(f32, PyLikelihoodRatio)> {
        let finer = self.0.finer()?;
        Some((finer.times(), PyLikelihoodRatio(Arc::new(finer.table().clone()))))
    }

    /// ln P(m | crowd) / P(m | no crowd) of one look of a camera of this table. CrowdfenceError for a
    /// gsd_m that is not finite and > 0, a tilt_deg outside [-90, 90] and a mean outside [0, 1].
    fn of(&self, gsd_m: f32, tilt_deg: f32, mean: f32) -> PyResult<f32> {
        self.0.of(gsd_m, tilt_deg, mean).map_err(refuse)
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<Columns<'py>> {
        Ok((self.gsd_m(py), self.tilt_deg(py), self.mean(py), self.log_ratio(py)?, self.finer()))
    }

    fn __hash__(&self) -> u64 {
        let finer = self.0.finer().map(|finer| finer.table().columns());
        let columns = self.0.columns().into_iter().chain(finer.into_iter().flatten());
        let bits = columns.flatten().map(|number| u64::from(number.to_bits()));
        bits.fold(0u64, |hash, bits| hash.wrapping_mul(31).wrapping_add(bits)) >> 1
    }

    pub fn __repr__(&self) -> String {
        let [gsd, tilt, mean, _] = self.0.columns().map(|column| column.len() + 1);
        let finer =
            self.0.finer().map(|finer| format!(", another for cameras {} times as fine", finer.times()));
        format!(
            "LikelihoodRatio({gsd} distances x {tilt} tilts x {mean} values{})",
            finer.unwrap_or_default()
        )
    }
}

impl PyLikelihoodRatio {
    fn column<'py>(&self, py: Python<'py>, number: usize) -> Bound<'py, PyArray1<f32>> {
        self.0.columns()[number].to_vec().into_pyarray(py)
    }
}

/// Method `evidence`: the log odds of crowd from calibrated looks. Instants may come in any order.
///
/// likelihood   how strongly a look speaks for or against crowd
/// prior        P(A = 1) where nobody has looked, strictly between 0 and 1
/// memory_s     > 0, after so many seconds a look weighs 1 / e of what it did
/// sharp_gsd_m  > 0, metres per pixel up to which a look weighs 1; a coarser one weighs as much less as it
///              has fewer pixels on the same ground
/// doubt        > 0, the sharp looks that the prior stands against
/// agreement    in [0, 1]: 0 = further drones only average, 1 = they add up as if independent
/// threshold    a voxel at or above this probability is crowd, strictly between 0 and 1
/// cleared      > 0 and below prior and threshold: up to this probability a voxel is empty; between the two
///              it was looked at, and that showed neither
/// focal_px     > 0, of the cameras of the calibration: taken for a view that does not say its own; a look
///              of a finer camera weighs as one of theirs, or where it shows crowd as 1.5 times as fine, and
///              says what those say unless `likelihood` knows finer ones
/// from_below   which looks from below the top of a place count: "for", those that show crowd, as that none
///              shows there clears nothing, or "against", those that show none, for what opens ground
///
/// Looks are averaged, because looks at one place agree; only further drones add to them. CrowdfenceError
/// names the parameter that is out of bounds. It cannot change; it can be compared and pickled.
#[pyclass(frozen, name = "Evidence", module = "crowdfence", eq)]
#[derive(Clone, PartialEq)]
pub struct PyEvidence(pub Evidence);

#[pymethods]
impl PyEvidence {
    #[new]
    #[pyo3(signature = (likelihood, *, prior, memory_s, sharp_gsd_m, doubt, agreement, threshold, cleared, focal_px,
                        from_below="for"))]
    #[allow(clippy::too_many_arguments)] // keyword-only in Python
    fn new(
        likelihood: &PyLikelihoodRatio,
        prior: f64,
        memory_s: f64,
        sharp_gsd_m: f64,
        doubt: f64,
        agreement: f64,
        threshold: f64,
        cleared: f64,
        focal_px: f64,
        from_below: &str,
    ) -> PyResult<Self> {
        let from_below = match from_below {
            "for" => FromBelow::For,
            "against" => FromBelow::Against,
            _ => return Err(not_one_of("from_below", from_below, "\"for\" or \"against\"")),
        };
        let settings = EvidenceSettings {
            prior,
            memory_s,
            sharp_gsd_m,
            doubt,
            agreement,
            threshold,
            cleared,
            focal_px,
            from_below,
        };
        Evidence::new(likelihood.0.clone(), settings).map(PyEvidence).map_err(refuse)
    }

    /// Name of the method: "evidence".
    #[getter]
    fn name(&self) -> &'static str {
        self.method().name()
    }

    /// How strongly a look speaks for or against crowd.
    #[getter]
    fn likelihood(&self) -> PyLikelihoodRatio {
        PyLikelihoodRatio(Arc::new(self.0.likelihood().clone()))
    }

    /// Probability from which a voxel is called crowd unless the caller says otherwise.
    #[getter]
    fn default_threshold(&self) -> f64 {
        self.method().default_threshold()
    }

    /// Pixels above this show crowd, where crowd that meets no ground is counted; it decides no more.
    #[getter]
    fn b_threshold(&self) -> f64 {
        self.method().b_threshold()
    }

    /// Probability up to which a voxel is called empty.
    #[getter]
    fn cleared(&self) -> f64 {
        self.0.settings().cleared
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
        let numbers = self.0.settings().numbers().map(|(name, number)| format!("{name}={number}"));
        let from_below = self.0.settings().from_below.name();
        format!(
            "Evidence({}, {}, from_below='{from_below}')",
            self.likelihood().__repr__(),
            numbers.join(", ")
        )
    }
}

impl PyEvidence {
    fn method(&self) -> Method {
        Method::Evidence(self.0.clone())
    }
}
