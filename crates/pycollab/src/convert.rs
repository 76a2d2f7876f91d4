//! All shape checks and copies between numpy and the core's types.

use crate::errors::bad_shape;
use ekf_core::math::pose::Pose;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector2, Vector3};
use numpy::{
    PyArray1, PyArray2, PyArray3, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2,
    PyReadonlyArray3,
};
use pyo3::prelude::*;

/// `(N, K)` rows as fixed-size vectors.
pub(crate) fn rows<const K: usize>(
    what: &'static str,
    array: &PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<SMatrix<f64, K, 1>>> {
    let view = array.as_array();
    if view.ncols() != K {
        return Err(bad_shape(what, &format!("(N, {K})"), view.shape()));
    }
    Ok(view
        .rows()
        .into_iter()
        .map(|row| SMatrix::from_fn(|i, _| row[i]))
        .collect())
}

/// `(N, 2)` pixels.
pub(crate) fn pixels(
    what: &'static str,
    array: &PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<Vector2<f64>>> {
    rows::<2>(what, array)
}

/// Checks that a companion array has as many rows as its partner.
pub(crate) fn same_length(what: &'static str, expected: usize, got: usize) -> PyResult<()> {
    if expected == got {
        return Ok(());
    }
    Err(bad_shape(what, &format!("{expected} rows"), &[got]))
}

/// `(R, C)` matrix.
pub(crate) fn matrix<const R: usize, const C: usize>(
    what: &'static str,
    array: &PyReadonlyArray2<'_, f64>,
) -> PyResult<SMatrix<f64, R, C>> {
    let view = array.as_array();
    if view.shape() != [R, C] {
        return Err(bad_shape(what, &format!("({R}, {C})"), view.shape()));
    }
    Ok(SMatrix::from_fn(|i, j| view[[i, j]]))
}

/// `(N, R, C)` stack of matrices.
pub(crate) fn stack<const R: usize, const C: usize>(
    what: &'static str,
    array: &PyReadonlyArray3<'_, f64>,
) -> PyResult<Vec<SMatrix<f64, R, C>>> {
    let view = array.as_array();
    if view.shape()[1..] != [R, C] {
        return Err(bad_shape(what, &format!("(N, {R}, {C})"), view.shape()));
    }
    Ok((0..view.shape()[0])
        .map(|n| SMatrix::from_fn(|i, j| view[[n, i, j]]))
        .collect())
}

/// A 4x4 rigid transform.
pub(crate) fn pose(what: &'static str, array: &PyReadonlyArray2<'_, f64>) -> PyResult<Pose> {
    let m = matrix::<4, 4>(what, array)?;
    Ok(Pose {
        rotation: m.fixed_view::<3, 3>(0, 0).into_owned(),
        translation: m.fixed_view::<3, 1>(0, 3).into_owned(),
    })
}

/// Ids from Python: negative means none.
pub(crate) fn optional_ids(array: &PyReadonlyArray1<'_, i64>) -> Vec<Option<u64>> {
    array
        .as_array()
        .iter()
        .map(|&id| u64::try_from(id).ok())
        .collect()
}

/// Ids from Python that must all be there; a negative one is unknown to the filter and reported by it.
pub(crate) fn ids(array: &PyReadonlyArray1<'_, i64>) -> Vec<u64> {
    array.as_array().iter().map(|&id| id as u64).collect()
}

/// Ids for Python, -1 for none.
pub(crate) fn to_ids(
    py: Python<'_>,
    ids: impl Iterator<Item = Option<u64>>,
) -> Bound<'_, PyArray1<i64>> {
    PyArray1::from_iter(py, ids.map(|id| id.map_or(-1, |id| id as i64)))
}

/// A fixed-size matrix as a 2-D array.
pub(crate) fn to_matrix<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    m: &SMatrix<f64, R, C>,
) -> Bound<'py, PyArray2<f64>> {
    stacked(py, std::iter::once(*m), 1)
        .reshape([R, C])
        .expect("R * C entries")
}

/// `(N, R, C)` from fixed-size matrices.
pub(crate) fn stacked<const R: usize, const C: usize>(
    py: Python<'_>,
    matrices: impl Iterator<Item = SMatrix<f64, R, C>>,
    n: usize,
) -> Bound<'_, PyArray3<f64>> {
    let mut flat = Vec::with_capacity(n * R * C);
    for m in matrices {
        for i in 0..R {
            for j in 0..C {
                flat.push(m[(i, j)]);
            }
        }
    }
    PyArray1::from_vec(py, flat)
        .reshape([n, R, C])
        .expect("n * R * C entries")
}

/// `(N, K)` from fixed-size vectors.
pub(crate) fn vectors<const K: usize>(
    py: Python<'_>,
    rows: impl Iterator<Item = SMatrix<f64, K, 1>>,
    n: usize,
) -> Bound<'_, PyArray2<f64>> {
    stacked(py, rows, n).reshape([n, K]).expect("n * K entries")
}

/// `T` as 4x4.
pub(crate) fn to_pose<'py>(
    py: Python<'py>,
    rotation: &Matrix3<f64>,
    translation: &Vector3<f64>,
) -> Bound<'py, PyArray2<f64>> {
    let mut m = SMatrix::<f64, 4, 4>::identity();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(rotation);
    m.fixed_view_mut::<3, 1>(0, 3).copy_from(translation);
    to_matrix(py, &m)
}

/// 6x6 covariance.
pub(crate) fn covariance6(
    what: &'static str,
    array: &PyReadonlyArray2<'_, f64>,
) -> PyResult<Matrix6<f64>> {
    matrix::<6, 6>(what, array)
}
