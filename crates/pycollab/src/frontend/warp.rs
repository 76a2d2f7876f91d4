//! How pixel offsets map between two views.

use crate::arrays_in::{Argument, numbers, pixels, pose, same_length, stack};
use crate::arrays_out::{Column, Stack, Table, column, stacked, vectors};
use crate::camera::PyCamera;
use crate::gate;
use ::frontend::warp::{self, Limits};
use nalgebra::{Matrix2, Vector2};
use pyo3::prelude::*;

/// Which warps of a patch are allowed.
///
/// Parameters
/// ----------
/// min_area, max_area : float
///     Least and largest change of area.
/// max_stretch : float
///     Largest ratio of the two scales.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct WarpLimits {
    min_area: f64,
    max_area: f64,
    max_stretch: f64,
}

#[pymethods]
impl WarpLimits {
    #[new]
    #[pyo3(signature = (*, min_area, max_area, max_stretch))]
    fn new(min_area: f64, max_area: f64, max_stretch: f64) -> Self {
        Self {
            min_area,
            max_area,
            max_stretch,
        }
    }
}

impl WarpLimits {
    /// As the front end takes them.
    pub(super) fn limits(&self) -> Limits {
        Limits {
            area: [self.min_area, self.max_area],
            stretch: self.max_stretch,
        }
    }
}

/// Predicted pixels in another view, and the maps of pixel offsets into it.
///
/// Attributes
/// ----------
/// uv : (N, 2) float64
///     Predicted pixel; NaN where the landmark is not in front of the camera.
/// affine : (N, 2, 2) float64
///     ``offset_now = affine @ offset_ref``; the identity where there is none.
/// ok : (N,) bool
///     Whether there is one that keeps its orientation.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct AffineMaps {
    uv: Table,
    affine: Stack<f64>,
    ok: Column<bool>,
}

/// Predicted pixel of patches in another view, and the affine map of pixel offsets into it.
///
/// Parameters
/// ----------
/// camera_ref, camera_now : Camera
/// uv_ref : (N, 2) float64
///     Points in the reference image.
/// t_now_ref : (N, 4, 4) float64
///     Each maps points of its reference camera into the camera now, metres.
/// inverse_range : (N,) float64
///     Inverse distance of each landmark from its reference camera, 1/m; NaN or 0: infinitely far.
///
/// Returns
/// -------
/// AffineMaps
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn affine_maps(
    py: Python<'_>,
    camera_ref: &PyCamera,
    uv_ref: Argument<'_>,
    camera_now: &PyCamera,
    t_now_ref: Argument<'_>,
    inverse_range: Argument<'_>,
) -> PyResult<AffineMaps> {
    let uv_ref = pixels("uv_ref", &uv_ref)?;
    let motions = stack::<4, 4>("t_now_ref", &t_now_ref)?;
    let inverse_range = numbers("inverse_range", &inverse_range)?;
    same_length("t_now_ref", uv_ref.len(), motions.len())?;
    same_length("inverse_range", uv_ref.len(), inverse_range.len())?;
    let (camera_ref, camera_now) = (&camera_ref.0, &camera_now.0);
    let warps: Vec<warp::Warp> = gate::compute(py, || {
        let points = uv_ref.iter().zip(&motions).zip(&inverse_range);
        let maps = points.map(|((uv, motion), &rho)| {
            let rotation = motion.fixed_view::<3, 3>(0, 0).into_owned();
            let translation = motion.fixed_view::<3, 1>(0, 3).into_owned();
            warp::affine_map(camera_ref, *uv, camera_now, (&rotation, &translation), rho)
        });
        maps.collect()
    });
    let nowhere = Vector2::repeat(f64::NAN);
    let affine = |w: &warp::Warp| w.affine.unwrap_or_else(Matrix2::identity);
    Ok(AffineMaps {
        uv: vectors(py, warps.iter().map(|w| w.uv.unwrap_or(nowhere))),
        affine: stacked(py, warps.iter().map(affine)),
        ok: column(py, warps.iter().map(|w| w.affine.is_some())),
    })
}

/// Affine maps of pixel offsets from one camera's image into another's, at given depths.
///
/// Parameters
/// ----------
/// camera_ref, camera_now : Camera
/// uv_ref : (N, 2) float64
///     Points in the reference image.
/// t_now_ref : (4, 4) float64
///     Maps points of the reference camera into the camera now, metres.
/// inverse_range : (N,) float64
///     Inverse distance of each point from its reference camera, 1/m; NaN or 0: infinitely far.
/// limits : WarpLimits
///
/// Returns
/// -------
/// (N, 2, 2) float64
///     ``offset_now = affine @ offset_ref``; where that is not allowed at the depth, the map of the
///     rotation alone; where this is not either, the identity.
///
/// Raises
/// ------
/// InputError
///     If an argument has another type or shape.
#[pyfunction]
pub(crate) fn affine_at(
    py: Python<'_>,
    camera_ref: &PyCamera,
    uv_ref: Argument<'_>,
    camera_now: &PyCamera,
    t_now_ref: Argument<'_>,
    inverse_range: Argument<'_>,
    limits: &WarpLimits,
) -> PyResult<Stack<f64>> {
    let (uv_ref, motion) = (pixels("uv_ref", &uv_ref)?, pose("t_now_ref", &t_now_ref)?);
    let inverse_range = numbers("inverse_range", &inverse_range)?;
    same_length("inverse_range", uv_ref.len(), inverse_range.len())?;
    let limits = limits.limits();
    let (camera_ref, camera_now) = (&camera_ref.0, &camera_now.0);
    let motion = (&motion.rotation, &motion.translation);
    let affine: Vec<_> = gate::compute(py, || {
        let points = uv_ref.iter().zip(&inverse_range);
        points
            .map(|(uv, &rho)| warp::affine_at(camera_ref, *uv, camera_now, motion, rho, &limits))
            .collect()
    });
    Ok(stacked(py, affine.into_iter()))
}
