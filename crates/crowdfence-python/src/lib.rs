//! Python face of the core: arrays in, arrays out, no arithmetic. Doc comments on what Python sees become its
//! docstrings and, by `make stub`, those of `_core.pyi`; notes on the Rust are plain comments.
#![forbid(unsafe_code)]

mod arrays;
mod camera;
mod comparison;
mod crowd_columns;
mod crowd_map;
mod crowd_mass;
mod errors;
mod evidence;
mod method;
mod observation;
mod opinion_pool;
mod released;
mod stamps;
mod terrain;
mod vibrance;
mod view;
mod voxel_knowledge;

use pyo3::prelude::*;

/// The compiled core (Rust crate `crowdfence`). Arrays in, arrays out; no files, no clock.
///
/// Conventions everywhere: world = local ENU metres (x east, y north, z up), float64; camera = OpenCV axes
/// (x right, y down, z forward); continuous pixel coordinates, the centre of pixel (column i, row j) is at
/// (i + 0.5, j + 0.5); `stamp_ns` = int64 nanoseconds since the Unix epoch; durations and rates in seconds.
/// Arrays that come out are copies.
///
/// Input that cannot be used raises CrowdfenceError or one of its children (all are ValueErrors); the message
/// names the offending value and its bound. Arguments of a wrong type raise TypeError.
#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add("COARSER", crowdfence::terrain::outstanding::COARSER)?;
    errors::add_exceptions(module)?;
    module.add_class::<camera::PyCamera>()?;
    module.add_class::<view::PyView>()?;
    module.add_class::<terrain::PyTerrain>()?;
    module.add_class::<crowd_mass::PyCrowdMass>()?;
    module.add_class::<observation::PyObservation>()?;
    module.add_class::<opinion_pool::PyRates>()?;
    module.add_class::<evidence::PyLikelihoodRatio>()?;
    module.add_class::<evidence::PyEvidence>()?;
    module.add_class::<method::PyPaper>()?;
    module.add_class::<method::PyOr>()?;
    module.add_class::<comparison::PyLinearPool>()?;
    module.add_class::<comparison::PyLogPool>()?;
    module.add_class::<comparison::PyLogOdds>()?;
    module.add_class::<comparison::PyMovingAverage>()?;
    module.add_class::<crowd_map::PyUpdate>()?;
    module.add_class::<crowd_columns::PyCrowdColumns>()?;
    module.add_class::<voxel_knowledge::PyVoxelKnowledge>()?;
    module.add_class::<crowd_map::PyCrowdMap>()?;
    module.add_function(wrap_pyfunction!(observation::project, module)?)?;
    module.add_function(wrap_pyfunction!(opinion_pool::pool, module)?)?;
    module.add_function(wrap_pyfunction!(opinion_pool::blend, module)?)?;
    module.add_function(wrap_pyfunction!(terrain::write_octomap_binary, module)?)?;
    module.add_function(wrap_pyfunction!(terrain::write_octomap_color, module)?)?;
    module.add_function(wrap_pyfunction!(terrain::raised, module)?)?;
    module.add_function(wrap_pyfunction!(vibrance::vibrant, module)?)?;
    Ok(())
}
