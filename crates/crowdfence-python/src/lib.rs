//! Python face of the core: arrays in, arrays out, no arithmetic. `_core.pyi` documents it.
#![forbid(unsafe_code)]

mod arrays;
mod back_projection;
mod camera;
mod crowd_map;
mod opinion_pool;
mod terrain;
mod view;

use pyo3::prelude::*;

#[pymodule]
fn _core(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<camera::PyCamera>()?;
    module.add_class::<view::PyView>()?;
    module.add_class::<terrain::PyTerrain>()?;
    module.add_class::<back_projection::PyObservation>()?;
    module.add_class::<opinion_pool::PyRates>()?;
    module.add_class::<crowd_map::PyPaper>()?;
    module.add_class::<crowd_map::PyOr>()?;
    module.add_class::<crowd_map::PyUpdate>()?;
    module.add_class::<crowd_map::PyCrowdMap>()?;
    module.add_function(wrap_pyfunction!(back_projection::project, module)?)?;
    module.add_function(wrap_pyfunction!(opinion_pool::pool, module)?)?;
    module.add_function(wrap_pyfunction!(opinion_pool::blend, module)?)?;
    module.add_function(wrap_pyfunction!(terrain::write_octomap_binary, module)?)?;
    module.add_function(wrap_pyfunction!(terrain::write_octomap_color, module)?)?;
    Ok(())
}
