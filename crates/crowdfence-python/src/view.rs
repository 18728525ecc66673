use crowdfence::view::Pose;
use crowdfence::{Heatmap, View};
use numpy::{
    IntoPyArray, PyArray2, PyArrayDescrMethods, PyArrayMethods, PyUntypedArray, PyUntypedArrayMethods, dtype,
};
use pyo3::prelude::*;

use crate::arrays::{Array, refuse, rows};
use crate::camera::PyCamera;
use crate::stamps::stamp_ns;

/// What one drone saw at one instant.
///
/// drone              its name, the same in all of its views
/// stamp_ns           when the image was exposed: int, nanoseconds since the Unix epoch
/// camera             intrinsics of the image
/// world_from_camera  [4, 4] rigid transform, camera axes -> local ENU metres
/// heatmap            [h, w] float in [0, 1] or uint8 (value / 255), at any stride of the image; a mask of
///                    0 and 1 is given as bool: as uint8 its ones are next to nothing. Of a masked array
///                    (`numpy.ma`) the masked cells were not looked at: they say neither crowd nor empty
///
/// ViewError for a drone without a name, a pose that is not rigid to 1e-4, a heatmap that is empty, holds a
/// value outside [0, 1] or is no reduction of the image; StampError for a stamp that is no int64;
/// CrowdfenceError for an array of another shape or element type. A view cannot change; it can be pickled.
#[pyclass(frozen, name = "View", module = "crowdfence")]
#[derive(Clone)]
pub struct PyView(pub View);

/// What makes the same view again.
type ViewArguments<'py> = (String, i64, PyCamera, Bound<'py, PyArray2<f64>>, Bound<'py, PyAny>);

#[pymethods]
impl PyView {
    #[new]
    fn new(
        drone: String,
        #[pyo3(from_py_with = stamp_ns)] stamp_ns: i64,
        camera: PyRef<'_, PyCamera>,
        world_from_camera: &Bound<'_, PyAny>,
        heatmap: &Bound<'_, PyAny>,
    ) -> PyResult<Self> {
        let pose = pose(world_from_camera)?;
        let heatmap = self::heatmap(heatmap)?;
        View::new(drone, stamp_ns, camera.0.clone(), pose, heatmap).map(PyView).map_err(refuse)
    }

    /// Name of the drone.
    #[getter]
    fn drone(&self) -> &str {
        self.0.drone()
    }

    /// When the image was exposed, nanoseconds since the Unix epoch.
    #[getter]
    fn stamp_ns(&self) -> i64 {
        self.0.stamp_ns()
    }

    /// Intrinsics of the image.
    #[getter]
    fn camera(&self) -> PyCamera {
        PyCamera(self.0.camera().clone())
    }

    /// Rigid transform [4, 4] float64, camera axes -> local ENU metres.
    #[getter]
    fn world_from_camera<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        rows(py, self.0.world_from_camera().to_matrix().concat(), 4)
    }

    /// Heatmap [h, w] float32 in [0, 1]; 0 in cells that were not looked at.
    #[getter]
    fn heatmap<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let values = self.0.heatmap().values().to_vec();
        values.into_pyarray(py).reshape(self.0.heatmap().shape())
    }

    /// Cells [h, w] of the heatmap that were looked at; None: all of them.
    #[getter]
    fn looked_at<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<bool>>>> {
        let looked_at = self.0.heatmap().looked_at();
        looked_at.map(|cells| cells.to_vec().into_pyarray(py).reshape(self.0.heatmap().shape())).transpose()
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<ViewArguments<'py>> {
        let name = self.drone().to_owned();
        let mut heatmap = self.heatmap(py)?.into_any();
        if let Some(looked_at) = self.looked_at(py)? {
            let others = py.import("numpy")?.call_method1("logical_not", (looked_at,))?;
            heatmap = py.import("numpy.ma")?.call_method1("MaskedArray", (heatmap, others))?;
        }
        Ok((name, self.stamp_ns(), self.camera(), self.world_from_camera(py)?, heatmap))
    }

    fn __repr__(&self) -> String {
        let [height, width] = self.0.heatmap().shape();
        format!("View({:?}, stamp_ns={}, heatmap {height}x{width})", self.0.drone(), self.0.stamp_ns())
    }
}

fn pose(matrix: &Bound<'_, PyAny>) -> PyResult<Pose> {
    let flat = Array::<f64>::new(matrix, "world_from_camera", &[Some(4), Some(4)])?.to_vec()?;
    let row = |i: usize| std::array::from_fn(|k| flat[4 * i + k]);
    Pose::from_matrix(&[row(0), row(1), row(2), row(3)]).map_err(refuse)
}

fn heatmap(values: &Bound<'_, PyAny>) -> PyResult<Heatmap> {
    let numpy_ma = values.py().import("numpy.ma")?;
    if !numpy_ma.call_method1("is_masked", (values,))?.extract::<bool>()? {
        return heatmap_of(values);
    }
    let mask = numpy_ma.call_method1("getmaskarray", (values,))?;
    let mask = Array::<bool>::new(&mask, "heatmap", &[None, None])?.to_vec()?; // in C order, whatever numpy keeps it in
    let looked_at = mask.into_iter().map(|masked| !masked).collect();
    let filled = numpy_ma.call_method1("filled", (values, 0))?; // what lies under a mask may be no value
    heatmap_of(&filled)?.of_part(looked_at).map_err(refuse)
}

fn heatmap_of(values: &Bound<'_, PyAny>) -> PyResult<Heatmap> {
    let is_u8 = values
        .cast::<PyUntypedArray>()
        .is_ok_and(|array| array.dtype().is_equiv_to(&dtype::<u8>(values.py())));
    let shape = [None, None];
    let heatmap = if is_u8 {
        let values = Array::<u8>::new(values, "heatmap", &shape)?;
        Heatmap::from_u8(&values.to_vec()?, values.shape()[0], values.shape()[1])
    } else {
        let values = Array::<f32>::new(values, "heatmap", &shape)?;
        Heatmap::new(values.to_vec()?, values.shape()[0], values.shape()[1])
    };
    heatmap.map_err(refuse)
}
