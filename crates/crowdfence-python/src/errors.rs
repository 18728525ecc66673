//! The exceptions of the core; `python/crowdfence/errors.py` adds those of the readers and the detector.

use crowdfence::Error;
use crowdfence::error::ErrorKind;
use pyo3::create_exception;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

create_exception!(
    crowdfence,
    CrowdfenceError,
    PyValueError,
    "Something that crowdfence cannot use; the message names the value and its bound.

Its children say what kind of thing it was. This class itself is raised for parameters, for arrays of a
wrong shape, element type or content, and for terrains."
);
create_exception!(
    crowdfence,
    ViewError,
    CrowdfenceError,
    "A camera, heatmap or pose that cannot be, or a drone without a name or beside the fleet."
);
create_exception!(
    crowdfence,
    StampError,
    CrowdfenceError,
    "A stamp that is no int64, or an instant out of order, in the past or too far from the others."
);
create_exception!(
    crowdfence,
    MapFileError,
    CrowdfenceError,
    "An OctoMap, crowd map or other map file that cannot be used, or a crowd map of another terrain."
);

pub fn add_exceptions(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    module.add("CrowdfenceError", py.get_type::<CrowdfenceError>())?;
    module.add("ViewError", py.get_type::<ViewError>())?;
    module.add("StampError", py.get_type::<StampError>())?;
    module.add("MapFileError", py.get_type::<MapFileError>())
}

/// An error of the core as the exception of its kind.
pub fn exception(error: Error) -> PyErr {
    let message = error.to_string();
    match error.kind() {
        ErrorKind::View => ViewError::new_err(message),
        ErrorKind::Stamp => StampError::new_err(message),
        ErrorKind::MapFile => MapFileError::new_err(message),
        ErrorKind::Other => CrowdfenceError::new_err(message),
    }
}
