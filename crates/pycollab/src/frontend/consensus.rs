//! The pose that the matches of two views agree on.

use crate::arrays_in::{Argument, covariance6, pose, rows, same_length};
use crate::arrays_out::{Column, Table, column, to_matrix, to_pose, vectors};
use crate::errors::invalid;
use crate::gate;
use ::frontend::consensus::{self, Noise, Pair};
use pyo3::prelude::*;

fn pairs(rays_s: &Argument<'_>, rays_f: &Argument<'_>) -> PyResult<Vec<Pair>> {
    let (rays_s, rays_f) = (rows::<3>("rays_s", rays_s)?, rows::<3>("rays_f", rays_f)?);
    same_length("rays_f", rays_s.len(), rays_f.len())?;
    Ok(rays_s.into_iter().zip(rays_f).collect())
}

/// Sampson residuals of pairs of rays.
///
/// Attributes
/// ----------
/// residual : (M,) float64
///     In units of the pixel noise: its standard deviation is that of one pixel coordinate.
/// jacobian : (M, 6) float64
///     By (translation, rotation) on the right of T_CF, pixels per metre and per radian.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct EpipolarResiduals {
    residual: Column<f64>,
    jacobian: Table,
}

/// Sampson residual of each pair of rays, and its derivative by an error of the pose.
///
/// Parameters
/// ----------
/// rays_s, rays_f : (M, 3) float64
///     Unit rays in C and F.
/// t_cf : (4, 4) float64
///     Maps points of F into C, metres.
/// focal : (float, float)
///     Focal lengths of Cs and Cf, pixels per radian.
///
/// Returns
/// -------
/// EpipolarResiduals
///
/// Raises
/// ------
/// InputError
///     If an argument has another shape.
#[pyfunction]
pub(crate) fn epipolar_residuals(
    py: Python<'_>,
    rays_s: Argument<'_>,
    rays_f: Argument<'_>,
    t_cf: Argument<'_>,
    focal: (f64, f64),
) -> PyResult<EpipolarResiduals> {
    let (pairs, pose) = (pairs(&rays_s, &rays_f)?, pose("t_cf", &t_cf)?);
    let found: Vec<_> = gate::compute(py, || {
        let residuals = pairs.iter();
        residuals
            .map(|pair| consensus::epipolar_residual(pair, &pose, focal.into()))
            .collect()
    });
    Ok(EpipolarResiduals {
        residual: column(py, found.iter().map(|f| f.0)),
        jacobian: vectors(py, found.iter().map(|f| f.1)),
    })
}

/// How accurate matches are.
///
/// Parameters
/// ----------
/// focal : (float, float)
///     Focal lengths of Cs and Cf, pixels per radian.
/// sigma : float
///     Standard deviation of a right match's residual, pixels.
/// limit : float
///     Largest residual of a match that agrees, pixels.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct MatchNoise {
    focal: (f64, f64),
    sigma: f64,
    limit: f64,
}

#[pymethods]
impl MatchNoise {
    #[new]
    fn new(focal: (f64, f64), sigma: f64, limit: f64) -> Self {
        Self {
            focal,
            sigma,
            limit,
        }
    }
}

/// Pose that matches agree on.
///
/// Attributes
/// ----------
/// t_cf : (4, 4) float64
///     Maps points of F into C, metres.
/// covariance : (6, 6) float64
///     Of it, over (translation m, rotation rad), tangent on the right.
/// agree : (M,) bool
///     Matches whose residual is within the limit under the pose.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct Consensus {
    t_cf: Table,
    covariance: Table,
    agree: Column<bool>,
}

/// Correction of a measured pose that most pairs agree on, under the prior of its covariance.
///
/// Sampled first (three pairs and the prior give a correction, linear in the residuals), then refined
/// by Gauss-Newton steps with Tukey weights.
///
/// Parameters
/// ----------
/// rays_s, rays_f : (M, 3) float64
///     Matched unit rays in C and F; fewer than three leave the pose as it is.
/// t_cf : (4, 4) float64
///     Measured pose: maps points of F into C, metres.
/// covariance : (6, 6) float64
///     Over (translation m, rotation rad), tangent on the right.
/// noise : MatchNoise
/// start : Consensus, optional
///     An earlier one of nearly the same matches; it takes the place of the sampling.
///
/// Returns
/// -------
/// Consensus
///
/// Raises
/// ------
/// InputError
///     If an argument has another shape, or the covariance is not positive definite.
#[pyfunction]
#[pyo3(signature = (rays_s, rays_f, t_cf, covariance, noise, start = None))]
pub(crate) fn find_consensus(
    py: Python<'_>,
    rays_s: Argument<'_>,
    rays_f: Argument<'_>,
    t_cf: Argument<'_>,
    covariance: Argument<'_>,
    noise: &MatchNoise,
    start: Option<&Consensus>,
) -> PyResult<Consensus> {
    let (pairs, prior) = (pairs(&rays_s, &rays_f)?, pose("t_cf", &t_cf)?);
    let covariance = covariance6("covariance", &covariance)?;
    let start = start.map(|start| pose("start", start.t_cf.bind(py).as_any()));
    let start = start.transpose()?;
    let noise = Noise {
        focal: noise.focal.into(),
        sigma: noise.sigma,
        limit: noise.limit,
    };
    let found = gate::compute(py, || {
        consensus::find_consensus(&pairs, &prior, &covariance, &noise, start.as_ref())
    });
    let found = found.ok_or_else(|| invalid("covariance", "it is not positive definite"))?;
    Ok(Consensus {
        t_cf: to_pose(py, &found.pose),
        covariance: to_matrix(py, &found.covariance),
        agree: column(py, found.agree),
    })
}
