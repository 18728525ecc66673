//! Between Python objects and the core's values: shapes are checked here, meanings in the core.

use crowdfence::Error;
use glam::DVec3;
use numpy::{
    Element, IntoPyArray, PyArray1, PyArray2, PyArrayDescr, PyArrayDescrMethods, PyArrayDyn, PyArrayMethods,
    PyUntypedArray, PyUntypedArrayMethods,
};
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

use crate::errors::{CrowdfenceError, exception};

/// An error of the core as the Python exception of its kind.
pub fn refuse(error: impl Into<Error>) -> PyErr {
    exception(error.into())
}

/// An array converted by numpy to C order and the element type; `shape` gives the expected sides, None = any.
pub struct Array<'py, T: Element> {
    array: Bound<'py, PyArrayDyn<T>>,
}

impl<'py, T: Element + Copy> Array<'py, T> {
    pub fn new(value: &Bound<'py, PyAny>, name: &str, shape: &[Option<usize>]) -> PyResult<Self> {
        let py = value.py();
        let numpy = py.import("numpy")?;
        let named = |error: PyErr| CrowdfenceError::new_err(format!("{name}: {}", error.value(py)));
        refuse_masked(value, name)?;
        let given = numpy.call_method1("asarray", (value,)).map_err(named)?;
        check_element_type(&given, &T::get_dtype(py), name)?;
        let options: Bound<'py, PyDict> =
            [("dtype", T::get_dtype(py).into_any()), ("order", "C".into_pyobject(py)?.into_any())]
                .into_py_dict(py)?;
        let array = numpy
            .call_method("asarray", (given,), Some(&options))
            .map_err(named)?
            .cast_into::<PyArrayDyn<T>>()?;
        let sides = array.shape();
        let fits = sides.len() == shape.len()
            && sides.iter().zip(shape).all(|(&side, expected)| expected.is_none_or(|e| e == side));
        if !fits {
            let expected: Vec<String> =
                shape.iter().map(|side| side.map_or("N".to_owned(), |side| side.to_string())).collect();
            return Err(CrowdfenceError::new_err(format!(
                "{name} has shape {sides:?}; it must be [{}]",
                expected.join(", ")
            )));
        }
        Ok(Array { array })
    }

    pub fn shape(&self) -> &[usize] {
        self.array.shape()
    }

    pub fn to_vec(&self) -> PyResult<Vec<T>> {
        Ok(self.array.try_readonly()?.as_slice()?.to_vec())
    }
}

/// numpy would take what lies under a mask for a value without a word.
fn refuse_masked(value: &Bound<'_, PyAny>, name: &str) -> PyResult<()> {
    if value.is_exact_instance_of::<PyUntypedArray>() {
        return Ok(());
    }
    if value.py().import("numpy.ma")?.call_method1("is_masked", (value,))?.extract()? {
        let fill = "it must have no masked elements: fill them, heights that nobody knows with .filled(nan)";
        return Err(CrowdfenceError::new_err(format!("{name} is masked; {fill}")));
    }
    Ok(())
}

/// numpy would turn id 0.7 into 0, a mask into ids 0 and 1, and an occupancy of NaN into true without a word.
fn check_element_type<'py>(
    given: &Bound<'py, PyAny>,
    wanted: &Bound<'py, PyArrayDescr>,
    name: &str,
) -> PyResult<()> {
    let dtype = given.getattr("dtype")?;
    let kind: char = dtype.getattr("kind")?.extract()?;
    let is_empty = given.getattr("size")?.extract::<usize>()? == 0; // [] has an element type by accident
    let numpy = given.py().import("numpy")?;
    let fits = || numpy.call_method1("can_cast", (&dtype, wanted, "same_kind"))?.extract::<bool>();
    let is_mask = kind == 'b' && matches!(wanted.kind(), b'i' | b'u');
    if is_empty || (!is_mask && (matches!(kind, 'b' | 'i' | 'u') || fits()?)) {
        return Ok(());
    }
    let hint = if is_mask { ": np.flatnonzero gives the places of a mask" } else { "" };
    Err(CrowdfenceError::new_err(format!("{name} has elements of type {dtype}; they must be {wanted}{hint}")))
}

/// The place of grid index (0, 0, 0), as `#[pyo3(from_py_with = origin)] origin: [f64; 3]`.
pub fn origin(value: &Bound<'_, PyAny>) -> PyResult<[f64; 3]> {
    let origin = Array::<f64>::new(value, "origin", &[Some(3)])?.to_vec()?;
    Ok([origin[0], origin[1], origin[2]])
}

/// Points or directions [N, 3].
pub fn points(value: &Bound<'_, PyAny>, name: &str) -> PyResult<Vec<DVec3>> {
    let flat = Array::<f64>::new(value, name, &[None, Some(3)])?.to_vec()?;
    Ok(flat.chunks_exact(3).map(DVec3::from_slice).collect())
}

/// Flat row-major values -> array [N, columns].
pub fn rows<'py, T: Element>(
    py: Python<'py>,
    flat: Vec<T>,
    columns: usize,
) -> PyResult<Bound<'py, PyArray2<T>>> {
    let count = flat.len() / columns;
    flat.into_pyarray(py).reshape([count, columns])
}

/// Voxel ids as numpy indexes them.
pub fn id_array<'py>(py: Python<'py>, ids: &[u32]) -> Bound<'py, PyArray1<i64>> {
    ids.iter().map(|&id| i64::from(id)).collect::<Vec<_>>().into_pyarray(py)
}
