use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;
use pyo3::types::PyBool;

use crate::errors::StampError;

/// A stamp from anything that Python takes as an index (int, numpy's integers), as
/// `#[pyo3(from_py_with = stamp_ns)] stamp_ns: i64`. A float is refused even where it is whole: near today's
/// stamps floats are 256 ns apart, and a float is as a rule a stamp in seconds.
pub fn stamp_ns(value: &Bound<'_, PyAny>) -> PyResult<i64> {
    let bound = match value.extract::<i64>() {
        Ok(stamp_ns) if !value.is_instance_of::<PyBool>() => return Ok(stamp_ns),
        Err(error) if error.is_instance_of::<PyOverflowError>(value.py()) => {
            "; it must fit in 64 bits".to_owned()
        }
        _ => format!(" (a {}); it must be an integer", value.get_type().name()?),
    };
    let shown = value.str()?.to_string();
    Err(StampError::new_err(format!("stamp_ns is {shown:.60}{bound}: nanoseconds since the Unix epoch")))
}
