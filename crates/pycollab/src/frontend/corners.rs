//! Corners of an image.

use crate::arrays_in::{Argument, InRows, SinglesArgument, pixels};
use crate::arrays_out::{Column, Table, to_rows, vectors};
use crate::errors::{bad_shape, invalid};
use crate::gate;
use ::frontend::corners::{self, Grid, PeakOptions, Response};
use numpy::ndarray::Ix2;
use pyo3::prelude::*;

/// Local maxima of a corner response, the strongest first.
///
/// Parameters
/// ----------
/// response : (H, W) float32
///     Not below zero.
/// reach : int
///     A peak is the largest response within so many pixels (square neighbourhood).
/// border : int
///     Pixels along the edge without peaks.
/// quality, least : float
///     Least response as a share of the best, and as a number.
///
/// Returns
/// -------
/// (M, 2) float64
///     Sub-pixel places (u, v), by a parabola through each peak.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn corner_peaks(
    py: Python<'_>,
    response: SinglesArgument<'_>,
    reach: usize,
    border: usize,
    quality: f32,
    least: f32,
) -> PyResult<Table> {
    let array: InRows<'_, f32, Ix2> =
        InRows::new("response", "an (H, W) array of float32", &response)?;
    let (height, width) = (array.shape()[0], array.shape()[1]);
    let response = Response::new(array.entries(), width, height)
        .ok_or_else(|| bad_shape("response", "(H, W)", array.shape()))?;
    let options = PeakOptions {
        reach,
        border,
        quality,
        least,
    };
    let peaks = gate::compute(py, || response.peaks(&options));
    Ok(vectors(py, peaks.into_iter()))
}

/// At most ``count`` peaks, those first whose part of the image needs them most.
///
/// Parameters
/// ----------
/// peaks : (M, 2) float64
///     Pixels, the most wanted first.
/// existing : (N, 2) float64
///     Points that there are already; those that are not finite do not count.
/// count : int
/// shape : (int, int)
///     Rows and columns of the image.
/// cells : int
///     Of the grid, along the image's longer side.
/// distance : float
///     Least distance between a peak and an existing point, pixels.
///
/// Returns
/// -------
/// (K,) int64
///     Rows of ``peaks``.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn spread_corners(
    py: Python<'_>,
    peaks: Argument<'_>,
    existing: Argument<'_>,
    count: usize,
    shape: (usize, usize),
    cells: usize,
    distance: f64,
) -> PyResult<Column<i64>> {
    let (peaks, existing) = (pixels("peaks", &peaks)?, pixels("existing", &existing)?);
    if shape.0.min(shape.1).min(cells) == 0 {
        return Err(invalid("shape", "an image and a cell are not empty"));
    }
    let grid = Grid {
        size: (shape.1, shape.0),
        cells,
        distance,
    };
    let chosen = gate::compute(py, || corners::spread(&peaks, &existing, count, &grid));
    Ok(to_rows(py, chosen))
}
