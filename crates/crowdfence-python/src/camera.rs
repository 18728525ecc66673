use std::sync::Arc;

use crowdfence::camera::MAX_IMAGE_SIDE;
use crowdfence::{Camera, Distortion};
use glam::DVec2;
use numpy::PyArray2;
use pyo3::exceptions::PyOverflowError;
use pyo3::prelude::*;
use pyo3::types::PyTuple;

use crate::arrays::{Array, points, refuse, rows};
use crate::errors::ViewError;
use crate::released::released;

/// Intrinsics of one camera. `Camera.pinhole` and `Camera.fisheye` make one.
///
/// Camera axes are those of OpenCV: x right, y down, z forward. Pixel coordinates are continuous: the image
/// covers [0, width) x [0, height) and the centre of pixel (column i, row j) is at (i + 0.5, j + 0.5).
///
/// A lens model is trusted only where it is one-to-one: directions from outside of that field of view have no
/// pixel and pixels from outside have no ray. A camera cannot change; it can be compared, hashed and pickled.
#[pyclass(frozen, name = "Camera", module = "crowdfence", eq)]
#[derive(Clone, PartialEq)]
pub struct PyCamera(pub Arc<Camera>);

impl PyCamera {
    fn new(size: [u32; 2], focal: [f64; 2], center: [f64; 2], distortion: Distortion) -> PyResult<Self> {
        Camera::new(size[0], size[1], focal[0], focal[1], center[0], center[1], distortion)
            .map(|camera| PyCamera(Arc::new(camera)))
            .map_err(refuse)
    }
}

/// A side of an image. The core knows the bounds, and sees only what fits in 32 bits.
fn side(value: &Bound<'_, PyAny>) -> PyResult<u32> {
    value.extract::<u32>().or_else(|error| {
        if !error.is_instance_of::<PyOverflowError>(value.py()) {
            return Err(error);
        }
        let shown = value.str()?.to_string();
        Err(ViewError::new_err(format!(
            "image has a side of {shown:.60} pixels: it must be at least 1 and at most {MAX_IMAGE_SIDE}"
        )))
    })
}

/// In a row or a column, as OpenCV's calibrations give them, or a plain sequence.
fn coefficients(value: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let squeezed = value.py().import("numpy")?.call_method1("squeeze", (value,))?;
    Array::new(&squeezed, "distortion", &[None])?.to_vec()
}

fn coefficients_or_none(value: &Bound<'_, PyAny>) -> PyResult<Option<Vec<f64>>> {
    (!value.is_none()).then(|| coefficients(value)).transpose()
}

#[pymethods]
impl PyCamera {
    /// Pinhole camera, plain or with Brown-Conrady distortion.
    ///
    /// width, height  size of the image, in pixels
    /// fx, fy         focal length along a row and along a column, in pixels
    /// cx, cy         principal point (column, row) in continuous pixels. Calibrations that put the centre of
    ///                the first pixel at (0, 0), as those of OpenCV and ROS do, need 0.5 added to both
    /// distortion     (k1, k2, p1, p2) or (k1, k2, p1, p2, k3), OpenCV's order; None = plain pinhole. Also
    ///                in a row or a column, as OpenCV's calibrations give them
    ///
    /// ViewError names the parameter that is not finite or out of bounds, or the number of coefficients.
    #[staticmethod]
    #[pyo3(signature = (width, height, fx, fy, cx, cy, distortion=None))]
    fn pinhole(
        #[pyo3(from_py_with = side)] width: u32,
        #[pyo3(from_py_with = side)] height: u32,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        #[pyo3(from_py_with = coefficients_or_none)] distortion: Option<Vec<f64>>,
    ) -> PyResult<Self> {
        let distortion = match distortion {
            None => Distortion::None,
            Some(coefficients) => Distortion::brown_conrady(&coefficients).map_err(refuse)?,
        };
        PyCamera::new([width, height], [fx, fy], [cx, cy], distortion)
    }

    /// Fisheye camera by Kannala and Brandt: a polynomial in the angle off the axis.
    ///
    /// width, height  size of the image, in pixels
    /// fx, fy         focal length along a row and along a column, in pixels
    /// cx, cy         principal point (column, row) in continuous pixels. Calibrations that put the centre of
    ///                the first pixel at (0, 0), as those of OpenCV and ROS do, need 0.5 added to both
    /// distortion     (k1, k2, k3, k4) as in OpenCV's fisheye module; zeros = image radius f * angle
    ///
    /// ViewError names the parameter that is not finite or out of bounds, or the number of coefficients.
    #[staticmethod]
    #[pyo3(signature = (width, height, fx, fy, cx, cy, distortion=vec![0.0; 4]), text_signature = "(width, height, fx, fy, cx, cy, distortion=(0.0, 0.0, 0.0, 0.0))")]
    fn fisheye(
        #[pyo3(from_py_with = side)] width: u32,
        #[pyo3(from_py_with = side)] height: u32,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        #[pyo3(from_py_with = coefficients)] distortion: Vec<f64>,
    ) -> PyResult<Self> {
        let distortion = Distortion::kannala_brandt(&distortion).map_err(refuse)?;
        PyCamera::new([width, height], [fx, fy], [cx, cy], distortion)
    }

    /// Width of the image in pixels.
    #[getter]
    fn width(&self) -> u32 {
        self.0.width()
    }

    /// Height of the image in pixels.
    #[getter]
    fn height(&self) -> u32 {
        self.0.height()
    }

    /// Focal length along a row, in pixels.
    #[getter]
    fn fx(&self) -> f64 {
        self.0.fx()
    }

    /// Focal length along a column, in pixels.
    #[getter]
    fn fy(&self) -> f64 {
        self.0.fy()
    }

    /// Column of the principal point, in continuous pixels.
    #[getter]
    fn cx(&self) -> f64 {
        self.0.cx()
    }

    /// Row of the principal point, in continuous pixels.
    #[getter]
    fn cy(&self) -> f64 {
        self.0.cy()
    }

    /// Lens model: "pinhole", "brown_conrady" or "kannala_brandt".
    #[getter]
    fn model(&self) -> &'static str {
        self.0.distortion().model()
    }

    /// Distortion coefficients: [] for a plain pinhole, [k1, k2, p1, p2, k3] or [k1, k2, k3, k4].
    #[getter]
    fn distortion(&self) -> Vec<f64> {
        self.0.distortion().coefficients()
    }

    /// Points [N, 3] in camera axes -> pixels [N, 2] float64, which may lie outside the image.
    ///
    /// NaN where the camera cannot see the direction (behind a pinhole, outside the field of view of the lens
    /// model) and for points that are not finite. CrowdfenceError for another shape.
    fn project<'py>(
        &self,
        py: Python<'py>,
        points_camera: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = points(points_camera, "points_camera")?;
        let pixels = released(py, || {
            points.iter().flat_map(|&point| self.0.project(point).unwrap_or(DVec2::NAN).to_array()).collect()
        });
        rows(py, pixels, 2)
    }

    /// Pixels [N, 2] -> unit rays [N, 3] float64 in camera axes; the inverse of `project`.
    ///
    /// ViewError names the first pixel that is not finite or at which the distortion cannot be inverted;
    /// CrowdfenceError for another shape.
    fn unproject<'py>(
        &self,
        py: Python<'py>,
        pixels: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let pixels = Array::<f64>::new(pixels, "pixels", &[None, Some(2)])?.to_vec()?;
        let mut rays = Vec::with_capacity(pixels.len() / 2 * 3);
        for pixel in pixels.chunks_exact(2) {
            let ray = self.0.unproject(DVec2::from_slice(pixel)).map_err(refuse)?;
            rays.extend(ray.to_array());
        }
        rows(py, rays, 3)
    }

    /// How many pixel centres have no ray because the distortion cannot be inverted there.
    fn blind_pixel_count(&self, py: Python<'_>) -> usize {
        released(py, || self.0.blind_pixel_count())
    }

    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyAny>, Bound<'py, PyTuple>)> {
        let camera = &slf.get().0;
        let coefficients = camera.distortion().coefficients();
        let (constructor, coefficients) = match camera.distortion() {
            Distortion::None => ("pinhole", None),
            Distortion::BrownConrady { .. } => ("pinhole", Some(coefficients)),
            Distortion::KannalaBrandt { .. } => ("fisheye", Some(coefficients)),
        };
        let arguments = (
            camera.width(),
            camera.height(),
            camera.fx(),
            camera.fy(),
            camera.cx(),
            camera.cy(),
            coefficients.map(|c| PyTuple::new(slf.py(), c)).transpose()?,
        );
        Ok((slf.get_type().getattr(constructor)?, arguments.into_pyobject(slf.py())?))
    }

    // Python's hash of the numbers, in which 0.0 and -0.0 are one as they are in `==`.
    fn __hash__(slf: &Bound<'_, Self>) -> PyResult<isize> {
        let (_, arguments) = PyCamera::__reduce__(slf)?;
        arguments.hash()
    }

    fn __repr__(&self) -> String {
        let camera = &self.0;
        format!(
            "Camera({} {}x{}, fx={:.2}, fy={:.2}, cx={:.2}, cy={:.2})",
            self.model(),
            camera.width(),
            camera.height(),
            camera.fx(),
            camera.fy(),
            camera.cx(),
            camera.cy()
        )
    }
}
