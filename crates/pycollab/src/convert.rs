//! All checks of type and shape, and copies between numpy and the core's types.

use crate::errors::{bad_shape, to_python};
use ekf_core::EkfError;
use ekf_core::math::pose::Pose;
use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix, Vector2, Vector3};
use numpy::ndarray::{Array2, Array3, Dimension, Ix1, Ix2, Ix3};
use numpy::{Element, PyArray1, PyArray2, PyArray3, PyReadonlyArray};
use pyo3::prelude::*;

/// An argument before its type and shape are checked.
pub(crate) type Argument<'py> = Bound<'py, PyAny>;

pub(crate) fn invalid(what: &'static str, why: String) -> PyErr {
    to_python(EkfError::InvalidInput { what, why })
}

/// A number type of the core, and numpy's kinds that turn into it without loss of meaning.
trait Number: Element {
    const NAME: &'static str;
    const KINDS: &'static str;
    const NEEDED: &'static str;
}

impl Number for f64 {
    const NAME: &'static str = "float64";
    const KINDS: &'static str = "fiu";
    const NEEDED: &'static str = "numbers";
}

impl Number for i64 {
    const NAME: &'static str = "int64";
    const KINDS: &'static str = "iu";
    const NEEDED: &'static str = "whole numbers";
}

/// Anything that numpy takes for an array of numbers, converted if it has another type.
fn array<'py, T: Number, D: Dimension>(
    what: &'static str,
    expected: &str,
    value: &Argument<'py>,
) -> PyResult<PyReadonlyArray<'py, T, D>> {
    if let Ok(array) = value.extract() {
        return Ok(array);
    }
    let needed = || invalid(what, format!("an array of {} is needed", T::NEEDED));
    let numpy = value.py().import("numpy")?;
    let array = numpy
        .call_method1("asarray", (value,))
        .map_err(|_| needed())?;
    let shape: Vec<usize> = array.getattr("shape")?.extract()?;
    let kind: String = array.getattr("dtype")?.getattr("kind")?.extract()?;
    if !T::KINDS.contains(&kind) && shape.iter().all(|&n| n > 0) {
        return Err(needed());
    }
    if D::NDIM.is_some_and(|n| n != shape.len()) {
        return Err(bad_shape(what, expected, &shape));
    }
    let array = array
        .call_method1("astype", (T::NAME,))
        .map_err(|_| needed())?;
    array.extract().map_err(|_| needed())
}

/// `(N,)` numbers.
pub(crate) fn numbers(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<f64>> {
    let array = array::<f64, Ix1>(what, "(N,)", value)?;
    Ok(array.as_array().to_vec())
}

/// `(N, K)` rows as fixed-size vectors.
pub(crate) fn rows<const K: usize>(
    what: &'static str,
    value: &Argument<'_>,
) -> PyResult<Vec<SMatrix<f64, K, 1>>> {
    let expected = format!("(N, {K})");
    let array = array::<f64, Ix2>(what, &expected, value)?;
    let view = array.as_array();
    if view.ncols() != K {
        return Err(bad_shape(what, &expected, view.shape()));
    }
    if let Some(numbers) = view.as_slice() {
        let (rows, _) = numbers.as_chunks::<K>();
        return Ok(rows.iter().map(|row| SMatrix::from(*row)).collect());
    }
    Ok(view
        .rows()
        .into_iter()
        .map(|row| SMatrix::from_fn(|i, _| row[i]))
        .collect())
}

/// `(N, 2)` pixels.
pub(crate) fn pixels(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<Vector2<f64>>> {
    rows::<2>(what, value)
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
    value: &Argument<'_>,
) -> PyResult<SMatrix<f64, R, C>> {
    let expected = format!("({R}, {C})");
    let array = array::<f64, Ix2>(what, &expected, value)?;
    let view = array.as_array();
    if view.shape() != [R, C] {
        return Err(bad_shape(what, &expected, view.shape()));
    }
    Ok(SMatrix::from_fn(|i, j| view[[i, j]]))
}

/// `(N, N)` matrix.
pub(crate) fn square(what: &'static str, value: &Argument<'_>) -> PyResult<DMatrix<f64>> {
    let array = array::<f64, Ix2>(what, "(N, N)", value)?;
    let view = array.as_array();
    if view.nrows() != view.ncols() {
        return Err(bad_shape(what, "(N, N)", view.shape()));
    }
    Ok(DMatrix::from_fn(view.nrows(), view.ncols(), |i, j| {
        view[[i, j]]
    }))
}

/// `(N, R, C)` stack of matrices.
pub(crate) fn stack<const R: usize, const C: usize>(
    what: &'static str,
    value: &Argument<'_>,
) -> PyResult<Vec<SMatrix<f64, R, C>>> {
    let expected = format!("(N, {R}, {C})");
    let array = array::<f64, Ix3>(what, &expected, value)?;
    let view = array.as_array();
    if view.shape()[1..] != [R, C] {
        return Err(bad_shape(what, &expected, view.shape()));
    }
    Ok((0..view.shape()[0])
        .map(|n| SMatrix::from_fn(|i, j| view[[n, i, j]]))
        .collect())
}

/// A 4x4 rigid transform; that its 3x3 is a rotation is the core's to check.
pub(crate) fn pose(what: &'static str, value: &Argument<'_>) -> PyResult<Pose> {
    let m = matrix::<4, 4>(what, value)?;
    if !m.iter().all(|x| x.is_finite()) {
        return Err(to_python(EkfError::NonFinite { what: "T_CF" }));
    }
    let bottom = [m[(3, 0)], m[(3, 1)], m[(3, 2)], m[(3, 3)]];
    if bottom != [0.0, 0.0, 0.0, 1.0] {
        let why = format!("its last row is {bottom:?}, not 0 0 0 1; give a 4x4 rigid transform");
        return Err(invalid(what, why));
    }
    Ok(Pose {
        rotation: m.fixed_view::<3, 3>(0, 0).into_owned(),
        translation: m.fixed_view::<3, 1>(0, 3).into_owned(),
    })
}

/// `(N,)` ids, -1 for none.
pub(crate) fn optional_ids(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<Option<u64>>> {
    let array = array::<i64, Ix1>(what, "(N,)", value)?;
    let id = |&id: &i64| match id {
        -1 => Ok(None),
        id if id < 0 => Err(invalid(
            what,
            format!("{id} is no id; give -1 for a new point"),
        )),
        id => Ok(Some(id.unsigned_abs())),
    };
    array.as_array().iter().map(id).collect()
}

/// `(N,)` ids.
pub(crate) fn ids(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<u64>> {
    let array = array::<i64, Ix1>(what, "(N,)", value)?;
    let id = |&id: &i64| {
        u64::try_from(id).map_err(|_| invalid(what, format!("{id} is no id; ids are not negative")))
    };
    array.as_array().iter().map(id).collect()
}

/// Ids for Python, -1 for none.
pub(crate) fn to_ids(
    py: Python<'_>,
    ids: impl Iterator<Item = Option<u64>>,
) -> Bound<'_, PyArray1<i64>> {
    let ids = ids.map(|id| id.map_or(-1, |id| id as i64));
    PyArray1::from_vec(py, ids.collect())
}

/// A fixed-size matrix as a 2-D array.
pub(crate) fn to_matrix<'py, const R: usize, const C: usize>(
    py: Python<'py>,
    m: &SMatrix<f64, R, C>,
) -> Bound<'py, PyArray2<f64>> {
    let flat = by_row(std::iter::once(*m), 1);
    PyArray2::from_owned_array(py, Array2::from_shape_vec([R, C], flat).expect("R * C"))
}

/// `(N, R, C)` from fixed-size matrices.
pub(crate) fn stacked<const R: usize, const C: usize>(
    py: Python<'_>,
    matrices: impl Iterator<Item = SMatrix<f64, R, C>>,
    n: usize,
) -> Bound<'_, PyArray3<f64>> {
    let flat = by_row(matrices, n);
    let array = Array3::from_shape_vec([n, R, C], flat).expect("n * R * C entries");
    PyArray3::from_owned_array(py, array)
}

/// The entries of matrices, row by row as numpy has them.
fn by_row<const R: usize, const C: usize>(
    matrices: impl Iterator<Item = SMatrix<f64, R, C>>,
    n: usize,
) -> Vec<f64> {
    let mut flat = Vec::with_capacity(n * R * C);
    for m in matrices {
        flat.extend_from_slice(m.transpose().as_slice());
    }
    flat
}

/// `(N, K)` from fixed-size vectors.
pub(crate) fn vectors<const K: usize>(
    py: Python<'_>,
    rows: impl Iterator<Item = SMatrix<f64, K, 1>>,
    n: usize,
) -> Bound<'_, PyArray2<f64>> {
    let array = Array2::from_shape_vec([n, K], by_row(rows, n)).expect("n * K entries");
    PyArray2::from_owned_array(py, array)
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
pub(crate) fn covariance6(what: &'static str, value: &Argument<'_>) -> PyResult<Matrix6<f64>> {
    matrix::<6, 6>(what, value)
}
