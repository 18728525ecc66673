use crowdfence::CrowdMass;
use pyo3::prelude::*;
use pyo3::types::{PyDict, PyTuple};

use crate::arrays::refuse;

/// Where the crowd in a picture went: heatmap value summed over the pixels that show crowd (those above
/// the crowd threshold), by what their rays met. Every such pixel counts in exactly one of the six; only
/// what met ground is on the map.
///
/// ground        a voxel in range
/// out_of_range  a voxel, but beyond `max_range_m`
/// hole          no voxel, on a way down through the map: below ground that lies above it, or where the map
///               has no voxel but goes on to the east, west, north and south
/// off_map       no voxel, on a way down past the map: beside it, or over it and its edge
/// sky           no voxel, on a way that is level or leads up
/// unusable      no ray: the lens model has none for the pixel, or the camera is under ground
///
/// Masses of several views add up with +. CrowdfenceError names one that is negative or not finite. It
/// cannot change; it can be compared and pickled.
#[pyclass(frozen, name = "CrowdMass", module = "crowdfence", eq)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyCrowdMass(pub CrowdMass);

#[pymethods]
impl PyCrowdMass {
    #[new]
    #[pyo3(signature = (*, ground=0.0, out_of_range=0.0, hole=0.0, off_map=0.0, sky=0.0, unusable=0.0))]
    fn new(
        ground: f64,
        out_of_range: f64,
        hole: f64,
        off_map: f64,
        sky: f64,
        unusable: f64,
    ) -> PyResult<Self> {
        let mass = CrowdMass { ground, out_of_range, hole, off_map, sky, unusable };
        mass.check().map_err(refuse)?;
        Ok(PyCrowdMass(mass))
    }

    /// What met a voxel in range: it is on the map.
    #[getter]
    fn ground(&self) -> f64 {
        self.0.ground
    }

    /// What met a voxel beyond the range.
    #[getter]
    fn out_of_range(&self) -> f64 {
        self.0.out_of_range
    }

    /// What went down through the map and met no voxel.
    #[getter]
    fn hole(&self) -> f64 {
        self.0.hole
    }

    /// What went down past the map.
    #[getter]
    fn off_map(&self) -> f64 {
        self.0.off_map
    }

    /// What did not go down and met no voxel.
    #[getter]
    fn sky(&self) -> f64 {
        self.0.sky
    }

    /// What pixels without a ray show.
    #[getter]
    fn unusable(&self) -> f64 {
        self.0.unusable
    }

    /// All six together.
    #[getter]
    fn total(&self) -> f64 {
        self.0.total()
    }

    /// All that met no ground in range.
    #[getter]
    fn lost(&self) -> f64 {
        self.0.lost()
    }

    /// The six by name, ground first.
    fn by_fate<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = PyDict::new(py);
        for (name, mass) in self.0.by_fate() {
            dict.set_item(name, mass)?;
        }
        Ok(dict)
    }

    fn __add__(&self, other: &PyCrowdMass) -> PyCrowdMass {
        PyCrowdMass(self.0 + other.0)
    }

    fn __getnewargs_ex__<'py>(&self, py: Python<'py>) -> PyResult<((), Bound<'py, PyDict>)> {
        Ok(((), self.by_fate(py)?))
    }

    fn __hash__(&self, py: Python<'_>) -> PyResult<isize> {
        PyTuple::new(py, self.0.by_fate().map(|(_, mass)| mass))?.hash()
    }

    pub fn __repr__(&self) -> String {
        let parts = self.0.by_fate().map(|(name, mass)| format!("{name}={mass}"));
        format!("CrowdMass({})", parts.join(", "))
    }
}
