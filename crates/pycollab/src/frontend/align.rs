//! Templates fitted to an image.

use crate::arrays_in::{Argument, grey, pixels, same_length, templates};
use crate::arrays_out::{Column, Table, column, vectors};
use crate::gate;
use ::frontend::affine::align_affine;
use nalgebra::Vector2;
use pyo3::prelude::*;

/// Where templates fit an image.
///
/// Attributes
/// ----------
/// uv : (N, 2) float64
///     Where their middles are exactly; NaN where the template fits nowhere near.
/// score : (N,) float64
///     Correlation of template and image under the map; -1 where there is none.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct Alignment {
    uv: Table,
    score: Column<f64>,
}

/// Fits each template to the image around a position by an affine map, gain and offset.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
/// templates : (N, h, h) uint8
///     Side h odd.
/// uv : (N, 2) float64
///     Where their middles are, to some pixels.
///
/// Returns
/// -------
/// Alignment
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn align_templates(
    py: Python<'_>,
    image: Argument<'_>,
    templates: Argument<'_>,
    uv: Argument<'_>,
) -> PyResult<Alignment> {
    let (grey, templates) = (grey("image", &image)?, self::templates(&templates)?);
    let uv = pixels("uv", &uv)?;
    same_length("uv", templates.count, uv.len())?;
    let (image, pixels, side) = (grey.image()?, templates.pixels(), templates.side);
    let nowhere = (Vector2::repeat(f64::NAN), -1.0);
    let found: Vec<_> = gate::compute(py, || {
        let pairs = pixels.chunks_exact(side * side).zip(uv);
        pairs
            .map(|(template, uv)| align_affine(&image, template, side, uv).unwrap_or(nowhere))
            .collect()
    });
    Ok(Alignment {
        uv: vectors(py, found.iter().map(|f| f.0)),
        score: column(py, found.iter().map(|f| f.1)),
    })
}
