//! Windows cut out of images, and templates made of them.

use super::warp::WarpLimits;
use crate::arrays_in::{
    Argument, PixelsArgument, grey, numbers, odd_side, pixels, pose, rows, same_length, stack,
};
use crate::arrays_out::{Column, Grid, Stack, Table, column, stacked, to_templates, vectors};
use crate::camera::PyCamera;
use crate::errors::invalid;
use crate::gate;
use ::frontend::warp::{self, Patch, View};
use nalgebra::{Matrix2, Vector2, Vector4};
use numpy::{PyArray1, PyArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;

/// A patch, which has its parts as attributes.
///
/// Python: Patch
type PatchArgument<'py> = Argument<'py>;

/// Windows cut out of an image.
///
/// Attributes
/// ----------
/// windows : list of N (2 half + 1, 2 half + 1) uint8
/// inside : (N, 4) float64
///     First and last column and row of each that hold image (u0, v0, u1, v1); the rest repeats its
///     edge.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct Windows {
    windows: Vec<Grid<u8>>,
    inside: Table,
}

/// Cuts windows around points rounded to whole pixels out of an image.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
///     Beyond its edge the edge repeats.
/// uv : (N, 2) float64
///     Pixels.
/// half : int
///     Pixels of a window on each side of its middle.
///
/// Returns
/// -------
/// Windows
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape, or a point is not finite.
#[pyfunction]
pub(crate) fn capture_windows(
    py: Python<'_>,
    image: PixelsArgument<'_>,
    uv: Argument<'_>,
    half: usize,
) -> PyResult<Windows> {
    let (grey, uv) = (grey("image", &image)?, pixels("uv", &uv)?);
    if !uv.iter().all(|uv| uv.amax() < 1e9) {
        return Err(invalid("uv", "a point is not finite"));
    }
    let (image, side) = (grey.image()?, 2 * half + 1);
    let cut: Vec<_> = gate::compute(py, || {
        let cut = |uv: &Vector2<f64>| {
            let mut window = Vec::with_capacity(side * side);
            let [first, last] = warp::capture(&image, *uv, half, &mut window);
            (window, Vector4::new(first.x, first.y, last.x, last.y))
        };
        uv.iter().map(cut).collect()
    });
    let inside = vectors(py, cut.iter().map(|(_, inside)| *inside));
    let windows = cut.into_iter().map(|(window, _)| {
        let window = PyArray1::from_vec(py, window).reshape([side, side]);
        window.expect("side^2 pixels").unbind()
    });
    Ok(Windows {
        windows: windows.collect(),
        inside,
    })
}

/// Templates sampled from an image.
///
/// Attributes
/// ----------
/// templates : (N, size, size) uint8
///     Bilinear samples; where the map shrinks, each pixel is the mean of 2 x 2 of them.
/// reach : (N, 2) float64
///     Largest distance in u and v between a sample and its centre, image pixels.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct SampledTemplates {
    templates: Stack<u8>,
    reach: Table,
}

/// Templates sampled around points of an image under affine maps.
///
/// Parameters
/// ----------
/// image : (H, W) uint8
///     Beyond its edge the edge repeats.
/// centres : (N, 2) float64
///     Centre of each template in the image (u, v).
/// affine : (N, 2, 2) float64
///     Map from image offsets to template offsets.
/// size : int
///     Side of a template, pixels (odd).
///
/// Returns
/// -------
/// SampledTemplates
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape, or a map has no inverse.
#[pyfunction]
pub(crate) fn sample_templates(
    py: Python<'_>,
    image: PixelsArgument<'_>,
    centres: Argument<'_>,
    affine: Argument<'_>,
    size: usize,
) -> PyResult<SampledTemplates> {
    let grey = grey("image", &image)?;
    let centres = pixels("centres", &centres)?;
    let affine = stack::<2, 2>("affine", &affine)?;
    same_length("affine", centres.len(), affine.len())?;
    odd_side("size", size)?;
    let (image, count) = (grey.image()?, centres.len());
    let mut templates = Vec::with_capacity(count * size * size);
    let reach: Option<Vec<_>> = gate::compute(py, || {
        let windows = centres.iter().zip(&affine);
        windows
            .map(|(centre, affine)| warp::sample(&image, *centre, affine, size, &mut templates))
            .collect()
    });
    let reach = reach.ok_or_else(|| invalid("affine", "a map has no inverse"))?;
    Ok(SampledTemplates {
        templates: to_templates(py, templates, count, size),
        reach: vectors(py, reach.into_iter()),
    })
}

/// Templates of patches seen from another pose.
///
/// Attributes
/// ----------
/// templates : (N, size, size) uint8
///     Zeros where there is none.
/// ok : (N,) bool
///     False where the change of area or the stretch is out of bounds, or the warp leaves the stored
///     window.
/// affine : (N, 2, 2) float64
///     Maps pixel offsets at capture to pixel offsets now; the identity where there is none.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct WarpedPatches {
    templates: Stack<u8>,
    ok: Column<bool>,
    affine: Stack<f64>,
}

/// Templates as patches are expected to look from another pose.
///
/// Parameters
/// ----------
/// camera : Camera
///     The camera that captured the patches and that looks now.
/// patches : sequence of N Patch
///     See `collabslam.frontend.patch.Patch`.
/// t_wc : (4, 4) float64
///     Pose of the camera now: maps its points into W, metres.
/// points : (N, 3) float64
///     Landmarks in W, metres; a row of NaN: only the rotation between the poses counts.
/// size : int
///     Side of a template, pixels (odd).
/// limits : WarpLimits
///
/// Returns
/// -------
/// WarpedPatches
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn warp_patches(
    py: Python<'_>,
    camera: &PyCamera,
    patches: Vec<PatchArgument<'_>>,
    t_wc: Argument<'_>,
    points: Argument<'_>,
    size: usize,
    limits: &WarpLimits,
) -> PyResult<WarpedPatches> {
    odd_side("size", size)?;
    let (now, points) = (pose("t_wc", &t_wc)?, rows::<3>("points", &points)?);
    let (count, limits) = (patches.len(), limits.limits());
    same_length("points", count, points.len())?;
    let view = View {
        camera: &camera.0,
        pose: &now,
    };
    let windows: Vec<_> = patches
        .iter()
        .map(|patch| grey("pixels", &patch.getattr(intern!(py, "pixels"))?))
        .collect::<PyResult<_>>()?;
    let patches: Vec<_> = patches
        .iter()
        .zip(&windows)
        .map(|(patch, window)| {
            Ok(Patch {
                window: window.image()?,
                uv_ref: point("uv_ref", &patch.getattr(intern!(py, "uv_ref"))?)?,
                pose: pose("t_wc", &patch.getattr(intern!(py, "t_wc"))?)?,
                inside: corners("inside", &patch.getattr(intern!(py, "inside"))?)?,
            })
        })
        .collect::<PyResult<_>>()?;
    let mut templates = Vec::with_capacity(count * size * size);
    let affine: Vec<_> = gate::compute(py, || {
        let seen = patches.iter().zip(&points);
        seen.map(|(patch, point)| patch.template(&view, point, size, &limits, &mut templates))
            .collect()
    });
    Ok(WarpedPatches {
        templates: to_templates(py, templates, count, size),
        ok: column(py, affine.iter().map(Option::is_some)),
        affine: stacked(
            py,
            affine
                .into_iter()
                .map(|a| a.unwrap_or_else(Matrix2::identity)),
        ),
    })
}

fn point(what: &'static str, value: &Argument<'_>) -> PyResult<Vector2<f64>> {
    let both = numbers(what, value)?;
    same_length(what, 2, both.len())?;
    Ok(Vector2::new(both[0], both[1]))
}

fn corners(what: &'static str, value: &Argument<'_>) -> PyResult<[Vector2<f64>; 2]> {
    let all = numbers(what, value)?;
    same_length(what, 4, all.len())?;
    Ok([Vector2::new(all[0], all[1]), Vector2::new(all[2], all[3])])
}
