use std::sync::Arc;

use crowdfence::{Camera, Distortion};
use glam::DVec2;
use numpy::PyArray2;
use pyo3::prelude::*;

use crate::arrays::{Array, points, refuse, rows};

#[pyclass(frozen, name = "Camera", module = "crowdfence", eq)]
#[derive(Clone, PartialEq)]
pub struct PyCamera(pub Arc<Camera>);

impl PyCamera {
    fn new(size: [i64; 2], focal: [f64; 2], center: [f64; 2], distortion: Distortion) -> PyResult<Self> {
        // A side that is no u32 becomes 0, which the core refuses.
        let [width, height] = size.map(|side| u32::try_from(side).unwrap_or(0));
        Camera::new(width, height, focal[0], focal[1], center[0], center[1], distortion)
            .map(|camera| PyCamera(Arc::new(camera)))
            .map_err(refuse)
    }
}

#[pymethods]
impl PyCamera {
    #[staticmethod]
    #[pyo3(signature = (width, height, fx, fy, cx, cy, distortion=None))]
    fn pinhole(
        width: i64,
        height: i64,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        distortion: Option<Vec<f64>>,
    ) -> PyResult<Self> {
        let distortion = match distortion {
            None => Distortion::None,
            Some(coefficients) => Distortion::brown_conrady(&coefficients).map_err(refuse)?,
        };
        PyCamera::new([width, height], [fx, fy], [cx, cy], distortion)
    }

    #[staticmethod]
    #[pyo3(signature = (width, height, fx, fy, cx, cy, distortion=vec![0.0; 4]), text_signature = "(width, height, fx, fy, cx, cy, distortion=(0.0, 0.0, 0.0, 0.0))")]
    fn fisheye(
        width: i64,
        height: i64,
        fx: f64,
        fy: f64,
        cx: f64,
        cy: f64,
        distortion: Vec<f64>,
    ) -> PyResult<Self> {
        let distortion = Distortion::kannala_brandt(&distortion).map_err(refuse)?;
        PyCamera::new([width, height], [fx, fy], [cx, cy], distortion)
    }

    #[getter]
    fn width(&self) -> u32 {
        self.0.width()
    }

    #[getter]
    fn height(&self) -> u32 {
        self.0.height()
    }

    #[getter]
    fn fx(&self) -> f64 {
        self.0.fx()
    }

    #[getter]
    fn fy(&self) -> f64 {
        self.0.fy()
    }

    #[getter]
    fn cx(&self) -> f64 {
        self.0.cx()
    }

    #[getter]
    fn cy(&self) -> f64 {
        self.0.cy()
    }

    #[getter]
    fn model(&self) -> &'static str {
        self.0.distortion().model()
    }

    #[getter]
    fn distortion(&self) -> Vec<f64> {
        self.0.distortion().coefficients()
    }

    fn project<'py>(
        &self,
        py: Python<'py>,
        points_camera: &Bound<'py, PyAny>,
    ) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let points = points(points_camera, "points_camera")?;
        let pixels = py.detach(|| {
            points.iter().flat_map(|&point| self.0.project(point).unwrap_or(DVec2::NAN).to_array()).collect()
        });
        rows(py, pixels, 2)
    }

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

    fn blind_pixel_count(&self, py: Python<'_>) -> usize {
        py.detach(|| self.0.blind_pixel_count())
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
