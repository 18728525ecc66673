use crowdfence::{CrowdColumn, CrowdColumns};
use numpy::{IntoPyArray, PyArray1, PyArray2};
use pyo3::prelude::*;

use crate::arrays::{id_array, rows};

/// The columns of the terrain that hold some voxels, sorted by i, then j: `CrowdMap.crowd_columns` makes
/// it of those that hold crowd, `CrowdMap.columns_of` of any.
#[pyclass(frozen, name = "CrowdColumns", module = "crowdfence")]
pub struct PyCrowdColumns(pub CrowdColumns);

impl PyCrowdColumns {
    fn each<'py, T: numpy::Element>(
        &self,
        py: Python<'py>,
        value: impl Fn(&CrowdColumn) -> T,
    ) -> Bound<'py, PyArray1<T>> {
        self.0.columns.iter().map(value).collect::<Vec<_>>().into_pyarray(py)
    }
}

#[pymethods]
impl PyCrowdColumns {
    /// Grid indices (i, j) [C, 2] int64.
    #[getter]
    fn indices<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i64>>> {
        let indices = self.0.columns.iter().flat_map(|column| [column.i.into(), column.j.into()]);
        rows(py, indices.collect(), 2)
    }

    /// Grid index k of the lowest voxel of the terrain in each column [C] int64.
    #[getter]
    fn bottom_index<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.each(py, |column| column.bottom.into())
    }

    /// Grid index k of the highest voxel of the terrain in each column [C] int64.
    #[getter]
    fn top_index<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.each(py, |column| column.top.into())
    }

    /// Largest probability of these voxels in each column [C] float64.
    #[getter]
    fn probability<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        self.each(py, |column| column.probability)
    }

    /// Stamp of the newest look at any of these voxels in each column [C] int64.
    #[getter]
    fn last_seen_ns<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.each(py, |column| column.last_seen_ns)
    }

    /// How many of these voxels are in each column [C] int64, at least 1.
    #[getter]
    fn crowd_count<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        self.each(py, |column| column.crowd_count.into())
    }

    /// The voxels [sum of `crowd_count`] int64, column by column.
    #[getter]
    fn voxel_ids<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        id_array(py, &self.0.voxel_ids)
    }

    fn __len__(&self) -> usize {
        self.0.columns.len()
    }

    fn __repr__(&self) -> String {
        format!("CrowdColumns({} columns, {} crowd voxels)", self.0.columns.len(), self.0.voxel_ids.len())
    }
}
