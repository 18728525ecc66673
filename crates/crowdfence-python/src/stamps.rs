use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;

use crate::errors::StampError;

/// A stamp from anything that Python takes as an index (int, numpy's integers), as
/// `#[pyo3(from_py_with = stamp_ns)] stamp_ns: i64`. A float is refused even where it is whole: near today's
/// stamps floats are 256 ns apart, and a float is as a rule a stamp in seconds.
pub fn stamp_ns(value: &Bound<'_, PyAny>) -> PyResult<i64> {
    let kind = value.get_type().name()?;
    let bound = match value.extract::<i64>() {
        // Truth values of Python and of numpy, which before 2.3 takes its own for an index too.
        Ok(stamp_ns) if !matches!(kind.to_str()?, "bool" | "bool_") => return Ok(stamp_ns),
        Err(error) if error.is_instance_of::<PyOverflowError>(value.py()) => {
            "; it must fit in 64 bits".to_owned()
        }
        _ => format!(" (a {kind}); it must be an integer"),
    };
    let shown = value.str()?.to_string();
    Err(StampError::new_err(format!("stamp_ns is {shown:.60}{bound}: nanoseconds since the Unix epoch")))
}
