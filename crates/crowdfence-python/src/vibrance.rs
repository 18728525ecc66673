use numpy::{IntoPyArray, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

use crate::arrays::{Array, refuse};

/// Pixels with their weak colours made stronger: uint8 [H, W, 3] RGB, a copy.
///
/// With y the brightness of a pixel (BT.601), d the differences of its channels from y and c the largest of
/// them, each channel becomes y + d * gain / (1 + (gain - 1) * c / 128). Grey stays grey.
///
/// gain  1 to 8; 1 changes nothing
///
/// CrowdfenceError for another shape or gain.
#[pyfunction]
pub fn vibrant<'py>(pixels: &Bound<'py, PyAny>, gain: f32) -> PyResult<Bound<'py, PyArray3<u8>>> {
    let given = Array::<u8>::new(pixels, "pixels", &[None, None, Some(3)])?;
    let shape = [given.shape()[0], given.shape()[1], 3];
    let mut shown = given.to_vec()?;
    crowdfence::vibrant(&mut shown, gain).map_err(refuse)?;
    shown.into_pyarray(pixels.py()).reshape(shape)
}
