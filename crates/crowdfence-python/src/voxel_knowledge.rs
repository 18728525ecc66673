use crowdfence::VoxelKnowledge;
use numpy::{Element, IntoPyArray, PyArray1};
use pyo3::prelude::*;

/// What is known about voxels, one value each; `CrowdMap.knowledge` makes it.
#[pyclass(frozen, name = "VoxelKnowledge", module = "crowdfence")]
pub struct PyVoxelKnowledge(pub Vec<VoxelKnowledge>);

impl PyVoxelKnowledge {
    fn each<'py, T: Element>(
        &self,
        py: Python<'py>,
        value: impl Fn(&VoxelKnowledge) -> T,
    ) -> Bound<'py, PyArray1<T>> {
        self.0.iter().map(value).collect::<Vec<_>>().into_pyarray(py)
    }
}

#[pymethods]
impl PyVoxelKnowledge {
    /// `VoxelState` [N] uint8.
    #[getter]
    fn state<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u8>> {
        self.each(py, |known| known.state as u8)
    }

    /// Probability of crowd [N] float64; where nobody has seen a voxel it says nothing about the place.
    #[getter]
    fn probability<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.each(py, |known| known.probability)
    }

    /// Seconds since the last look [N] float64, NaN = nobody has seen it.
    #[getter]
    fn age_s<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.each(py, |known| known.age_s.unwrap_or(f64::NAN))
    }

    /// Looks that the method still remembers [N] float64, in those that weigh 1; NaN = there were none, or
    /// it does not count them.
    #[getter]
    fn looks<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.each(py, |known| known.looks.unwrap_or(f64::NAN))
    }

    /// How many drones have ever seen it [N] int64.
    #[getter]
    fn drones<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.each(py, |known| known.drones.into())
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }

    fn __repr__(&self) -> String {
        format!("VoxelKnowledge({} voxels)", self.0.len())
    }
}
