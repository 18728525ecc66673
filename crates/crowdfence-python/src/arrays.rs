//! Between Python objects and the core's values: shapes are checked here, meanings in the core.

use crowdfence::Error;
use glam::DVec3;
use numpy::{Element, IntoPyArray, PyArray1, PyArray2, PyArrayDyn, PyArrayMethods, PyUntypedArrayMethods};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{IntoPyDict, PyDict};

/// An error of the core as the Python exception for bad values.
pub fn refuse(error: impl Into<Error>) -> PyErr {
    PyValueError::new_err(error.into().to_string())
}

/// An array converted by numpy to C order and the element type; `shape` gives the expected sides, None = any.
pub struct Array<'py, T: Element> {
    array: Bound<'py, PyArrayDyn<T>>,
}

impl<'py, T: Element + Copy> Array<'py, T> {
    pub fn new(value: &Bound<'py, PyAny>, name: &str, shape: &[Option<usize>]) -> PyResult<Self> {
        let py = value.py();
        let options: Bound<'py, PyDict> =
            [("dtype", T::get_dtype(py).into_any()), ("order", "C".into_pyobject(py)?.into_any())]
                .into_py_dict(py)?;
        let array = py
            .import("numpy")?
            .call_method("asarray", (value,), Some(&options))
            .map_err(|error| PyValueError::new_err(format!("{name}: {}", error.value(py))))?
            .cast_into::<PyArrayDyn<T>>()?;
        let sides = array.shape();
        let fits = sides.len() == shape.len()
            && sides.iter().zip(shape).all(|(&side, expected)| expected.is_none_or(|e| e == side));
        if !fits {
            let expected: Vec<String> =
                shape.iter().map(|side| side.map_or("N".to_owned(), |side| side.to_string())).collect();
            return Err(PyValueError::new_err(format!(
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
