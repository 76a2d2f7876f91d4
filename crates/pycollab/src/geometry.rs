//! Rigid-body geometry with the conventions of METHOD 1, and the chi-square distribution.

use crate::arrays_in::{Argument, finite, matrix, pose, rows, vector};
use crate::arrays_out::{Column, Stack, Table, column, stacked, to_matrix, to_pose, vectors};
use crate::errors::invalid;
use ekf_core::chi2;
use ekf_core::math::inverse_depth;
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use nalgebra::{Matrix3, Matrix6, Vector4};
use pyo3::prelude::*;

fn rotation(value: &Argument<'_>) -> PyResult<Matrix3<f64>> {
    finite("rotation", matrix::<3, 3>("rotation", value)?)
}

fn covariance(value: &Argument<'_>) -> PyResult<Matrix6<f64>> {
    finite("covariance", matrix::<6, 6>("covariance", value)?)
}

/// Matrix of the cross product: ``skew(v) @ p == cross(v, p)``.
///
/// Parameters
/// ----------
/// v : (3,) float64
///
/// Returns
/// -------
/// (3, 3) float64
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, or a number that is not finite.
#[pyfunction]
pub(crate) fn skew(py: Python<'_>, v: Argument<'_>) -> PyResult<Table> {
    Ok(to_matrix(py, &quat::skew(&vector::<3>("v", &v)?)))
}

/// Rotation matrix of a rotation vector.
///
/// Parameters
/// ----------
/// w : (3,) float64
///     Axis times angle, radians.
///
/// Returns
/// -------
/// (3, 3) float64
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, or a number that is not finite.
#[pyfunction]
pub(crate) fn rotation_exp(py: Python<'_>, w: Argument<'_>) -> PyResult<Table> {
    let w = vector::<3>("w", &w)?;
    Ok(to_matrix(py, &quat::rotation_exp(&w)))
}

/// Rotation vector of a rotation matrix.
///
/// Parameters
/// ----------
/// rotation : (3, 3) float64
///
/// Returns
/// -------
/// (3,) float64
///     Axis times angle, radians; no longer than pi.
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, or a number that is not finite.
#[pyfunction]
pub(crate) fn rotation_log(py: Python<'_>, rotation: Argument<'_>) -> PyResult<Column<f64>> {
    let w = quat::rotation_log(&self::rotation(&rotation)?);
    Ok(column(py, w.iter().copied()))
}

/// Left Jacobian of SO(3): the mean of ``Exp(s w)`` over s from 0 to 1.
///
/// Under a constant twist ``(v, w)`` over a unit of time a pose is moved by ``left_jacobian(w) v``.
///
/// Parameters
/// ----------
/// w : (3,) float64
///     Axis times angle, radians.
///
/// Returns
/// -------
/// (3, 3) float64
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, or a number that is not finite.
#[pyfunction]
pub(crate) fn left_jacobian(py: Python<'_>, w: Argument<'_>) -> PyResult<Table> {
    let w = vector::<3>("w", &w)?;
    Ok(to_matrix(py, &quat::right_jacobian(&-w)))
}

/// Rotation matrix of a Hamilton quaternion.
///
/// Parameters
/// ----------
/// q_wxyz : (4,) float64
///     Scalar first; it is normalised.
///
/// Returns
/// -------
/// (3, 3) float64
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, a number that is not finite, or a quaternion of length zero.
#[pyfunction]
pub(crate) fn rotation_from_quaternion(py: Python<'_>, q_wxyz: Argument<'_>) -> PyResult<Table> {
    let q: Vector4<f64> = vector::<4>("q_wxyz", &q_wxyz)?;
    if q.norm() < 1e-12 {
        let why = "the quaternion is zero; give a unit quaternion (w, x, y, z)";
        return Err(invalid("q_wxyz", why));
    }
    Ok(to_matrix(py, &quat::rotation(&q)))
}

/// Hamilton quaternion of a rotation matrix.
///
/// Parameters
/// ----------
/// rotation : (3, 3) float64
///
/// Returns
/// -------
/// (4,) float64
///     ``(w, x, y, z)``, of length one, w not below zero.
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, or a number that is not finite.
#[pyfunction]
pub(crate) fn quaternion_wxyz(py: Python<'_>, rotation: Argument<'_>) -> PyResult<Column<f64>> {
    let q = quat::from_rotation(&self::rotation(&rotation)?);
    Ok(column(py, q.iter().copied()))
}

/// Whether a matrix is a rotation.
///
/// Parameters
/// ----------
/// matrix : array
///     Of any shape.
/// tolerance : float
///     Largest error of an entry of ``matrix @ matrix.T``.
///
/// Returns
/// -------
/// bool
///     It is (3, 3), finite, orthonormal and no reflection.
#[pyfunction]
#[pyo3(signature = (matrix, tolerance = 1e-3))]
pub(crate) fn is_rotation(matrix: Argument<'_>, tolerance: f64) -> bool {
    let rotation = self::matrix::<3, 3>("matrix", &matrix);
    rotation.is_ok_and(|rotation| quat::is_rotation(&rotation, tolerance))
}

/// Inverse of a rigid pose: ``t_ba`` of ``t_ab``.
///
/// Parameters
/// ----------
/// t_ab : (4, 4) float64
///     Maps points of frame B into frame A, metres.
///
/// Returns
/// -------
/// (4, 4) float64
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
#[pyfunction]
pub(crate) fn pose_inverse(py: Python<'_>, t_ab: Argument<'_>) -> PyResult<Table> {
    Ok(to_pose(py, &pose("t_ab", &t_ab)?.inverse()))
}

/// Exp of METHOD 1: ``Exp((v, w)) = [R(w), v; 0, 1]``.
///
/// Translation and rotation act separately: ``T_hat Exp(xi) = (R_hat R(w), t_hat + R_hat v)``.
///
/// Parameters
/// ----------
/// xi : (6,) float64
///     Translation in metres, then rotation vector in radians.
///
/// Returns
/// -------
/// (4, 4) float64
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, or a number that is not finite.
#[pyfunction]
pub(crate) fn se3_exp(py: Python<'_>, xi: Argument<'_>) -> PyResult<Table> {
    Ok(to_pose(py, &Pose::exp(&vector::<6>("xi", &xi)?)))
}

/// Inverse of :func:`se3_exp`.
///
/// Parameters
/// ----------
/// t : (4, 4) float64
///
/// Returns
/// -------
/// (6,) float64
///     Translation in metres, then rotation vector in radians.
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
#[pyfunction]
pub(crate) fn se3_log(py: Python<'_>, t: Argument<'_>) -> PyResult<Column<f64>> {
    let xi = pose("t", &t)?.log();
    Ok(column(py, xi.iter().copied()))
}

/// Matrix that carries a small tangent vector through a pose, in (translation, rotation) order.
///
/// To first order ``T Exp(xi) T^-1 = Exp(adjoint(T) xi)``; it makes a left perturbation of a right one.
///
/// Parameters
/// ----------
/// t_ab : (4, 4) float64
///
/// Returns
/// -------
/// (6, 6) float64
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
#[pyfunction]
pub(crate) fn adjoint(py: Python<'_>, t_ab: Argument<'_>) -> PyResult<Table> {
    Ok(to_matrix(py, &pose("t_ab", &t_ab)?.adjoint()))
}

/// Azimuth and elevation of rays (METHOD 2), with their derivatives.
///
/// Parameters
/// ----------
/// rays : (N, 3) float64
///     Of any length but zero, along the axes in which the angles are.
///
/// Returns
/// -------
/// angles : (N, 2) float64
///     Radians.
/// derivatives : (N, 2, 3) float64
///     Of the angles by the ray.
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, or a number that is not finite.
#[pyfunction]
pub(crate) fn ray_angles(py: Python<'_>, rays: Argument<'_>) -> PyResult<(Table, Stack<f64>)> {
    let found: Vec<_> = rows::<3>("rays", &rays)?
        .iter()
        .map(inverse_depth::angles)
        .collect();
    Ok((
        vectors(py, found.iter().map(|of_ray| of_ray.0)),
        stacked(py, found.iter().map(|of_ray| of_ray.1)),
    ))
}

/// A pose's covariance along the fixed axes of A: diag(R, R) P diag(R, R)^T.
///
/// Parameters
/// ----------
/// t_ab : (4, 4) float64
/// covariance : (6, 6) float64
///     Over (translation m, rotation rad), tangent on the right.
///
/// Returns
/// -------
/// (6, 6) float64
///     Over (x, y, z, rotation about X, Y, Z) of A, as in ROS's PoseWithCovariance.
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
#[pyfunction]
pub(crate) fn tangent_to_fixed(
    py: Python<'_>,
    t_ab: Argument<'_>,
    covariance: Argument<'_>,
) -> PyResult<Table> {
    let (pose, covariance) = (pose("t_ab", &t_ab)?, self::covariance(&covariance)?);
    Ok(to_matrix(
        py,
        &pose.covariance_along_fixed_axes(&covariance),
    ))
}

/// The inverse of :func:`tangent_to_fixed`.
///
/// Parameters
/// ----------
/// t_ab : (4, 4) float64
/// covariance : (6, 6) float64
///     Over (x, y, z, rotation about X, Y, Z) of A, m^2 and rad^2.
///
/// Returns
/// -------
/// (6, 6) float64
///     Over (translation m, rotation rad), tangent on the right.
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
#[pyfunction]
pub(crate) fn fixed_to_tangent(
    py: Python<'_>,
    t_ab: Argument<'_>,
    covariance: Argument<'_>,
) -> PyResult<Table> {
    let (pose, covariance) = (pose("t_ab", &t_ab)?, self::covariance(&covariance)?);
    Ok(to_matrix(py, &pose.covariance_along_tangent(&covariance)))
}

/// Pose between two poses: straight in translation, constant rate in rotation.
///
/// Parameters
/// ----------
/// t0, t1 : (4, 4) float64
/// share : float
///     0 gives ``t0``, 1 gives ``t1``.
///
/// Returns
/// -------
/// (4, 4) float64
///
/// Raises
/// ------
/// InputError
///     For a wrong shape, a number that is not finite, or another last row than 0 0 0 1.
#[pyfunction]
pub(crate) fn interpolate_pose(
    py: Python<'_>,
    t0: Argument<'_>,
    t1: Argument<'_>,
    share: f64,
) -> PyResult<Table> {
    let (first, second) = (pose("t0", &t0)?, pose("t1", &t1)?);
    Ok(to_pose(py, &first.interpolate(&second, share)))
}

/// Chi-square quantile: the x with P(X <= x) = probability.
///
/// Parameters
/// ----------
/// probability : float
///     Between 0 and 1, exclusively.
/// dof : float
///     Degrees of freedom, above zero.
///
/// Returns
/// -------
/// float
///
/// Raises
/// ------
/// InputError
///     For a probability or degrees of freedom out of range.
#[pyfunction]
pub(crate) fn chi2_quantile(probability: f64, dof: f64) -> PyResult<f64> {
    if !(probability > 0.0 && probability < 1.0) {
        let why = format!("it is {probability}; give a number between 0 and 1");
        return Err(invalid("probability", why));
    }
    if !(dof > 0.0 && dof.is_finite()) {
        let why = format!("it is {dof}; give a positive number of degrees of freedom");
        return Err(invalid("dof", why));
    }
    Ok(chi2::quantile(probability, dof))
}
