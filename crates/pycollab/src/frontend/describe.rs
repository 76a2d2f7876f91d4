//! Descriptors of windows.

use crate::arrays_in::{Argument, PixelsArgument, grey, pixels, same_length, stack};
use crate::arrays_out::Grid;
use crate::gate;
use ::frontend::describe::{LENGTH, describe};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::prelude::*;

/// SIFT's histogram of gradients over windows warped by affine maps.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
/// centres : (N, 2) float64
///     Pixels (u, v).
/// axes : (N, 2, 2) float64
///     Maps offsets in the described view to pixel offsets in the image.
/// step : float
///     Distance of the window's 8 x 8 samples in the described view.
///
/// Returns
/// -------
/// (N, 128) float32
///     Square roots of the L1-normalised histogram (RootSIFT): unit vectors.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn describe_windows(
    py: Python<'_>,
    image: PixelsArgument<'_>,
    centres: Argument<'_>,
    axes: Argument<'_>,
    step: f64,
) -> PyResult<Grid<f32>> {
    let grey = grey("image", &image)?;
    let (centres, axes) = (pixels("centres", &centres)?, stack::<2, 2>("axes", &axes)?);
    same_length("axes", centres.len(), axes.len())?;
    let windows: Vec<_> = centres.into_iter().zip(axes).collect();
    let image = grey.image()?;
    let described = gate::compute(py, || {
        let mut out = Vec::new();
        describe(&image, &windows, step, &mut out);
        out
    });
    let described = PyArray1::from_vec(py, described).reshape([windows.len(), LENGTH]);
    Ok(described.expect("one descriptor a window").unbind())
}
