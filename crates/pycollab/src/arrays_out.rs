//! Arrays that Python gets: float64, int64, bool or uint8, row by row in memory, owned by Python.

use crate::errors::invalid;
use ekf_core::math::pose::Pose;
use nalgebra::{DMatrix, SMatrix};
use numpy::ndarray::{Array2, Array3};
use numpy::{Element, PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::prelude::*;

/// `(N,)`
///
/// Python: NDArray[T]
pub(crate) type Column<T> = Py<PyArray1<T>>;
/// `(N, K)` of any number
///
/// Python: NDArray[T]
pub(crate) type Grid<T> = Py<PyArray2<T>>;
/// `(N, K)`
///
/// Python: NDArray[np.float64]
pub(crate) type Table = Grid<f64>;
/// `(N, R, C)`
///
/// Python: NDArray[T]
pub(crate) type Stack<T> = Py<PyArray3<T>>;

/// One number a row.
pub(crate) fn column<T: Element>(
    py: Python<'_>,
    entries: impl IntoIterator<Item = T>,
) -> Column<T> {
    PyArray1::from_iter(py, entries).unbind()
}

/// Ids, -1 for none.
pub(crate) fn to_ids(py: Python<'_>, ids: impl IntoIterator<Item = Option<u64>>) -> Column<i64> {
    let ids = ids.into_iter();
    column(py, ids.map(|id| id.map_or(-1, |id| id as i64)))
}

/// Row numbers.
pub(crate) fn to_rows(py: Python<'_>, rows: impl IntoIterator<Item = usize>) -> Column<i64> {
    column(py, rows.into_iter().map(|row| row as i64))
}

/// A fixed-size matrix as a 2-D array.
pub(crate) fn to_matrix<const R: usize, const C: usize>(
    py: Python<'_>,
    m: &SMatrix<f64, R, C>,
) -> Table {
    let flat = by_row(std::iter::once(*m), 1);
    let array = Array2::from_shape_vec([R, C], flat).expect("R * C entries");
    PyArray2::from_owned_array(py, array).unbind()
}

/// A matrix as a 2-D array.
pub(crate) fn to_table(py: Python<'_>, m: &DMatrix<f64>) -> Table {
    let flat = m.transpose().data.into();
    let array = Array2::from_shape_vec([m.nrows(), m.ncols()], flat).expect("all entries");
    PyArray2::from_owned_array(py, array).unbind()
}

/// `T` as 4x4.
pub(crate) fn to_pose(py: Python<'_>, pose: &Pose) -> Table {
    to_matrix(py, &homogeneous(pose))
}

/// `T` as a matrix.
pub(crate) fn homogeneous(pose: &Pose) -> SMatrix<f64, 4, 4> {
    let mut m = SMatrix::<f64, 4, 4>::identity();
    m.fixed_view_mut::<3, 3>(0, 0).copy_from(&pose.rotation);
    m.fixed_view_mut::<3, 1>(0, 3).copy_from(&pose.translation);
    m
}

/// `(N, R, C)` from fixed-size matrices.
pub(crate) fn stacked<const R: usize, const C: usize>(
    py: Python<'_>,
    matrices: impl ExactSizeIterator<Item = SMatrix<f64, R, C>>,
) -> Stack<f64> {
    let n = matrices.len();
    let array = Array3::from_shape_vec([n, R, C], by_row(matrices, n)).expect("n * R * C entries");
    PyArray3::from_owned_array(py, array).unbind()
}

/// `(N, K)` from fixed-size vectors.
pub(crate) fn vectors<const K: usize>(
    py: Python<'_>,
    rows: impl ExactSizeIterator<Item = SMatrix<f64, K, 1>>,
) -> Table {
    let n = rows.len();
    let array = Array2::from_shape_vec([n, K], by_row(rows, n)).expect("n * K entries");
    PyArray2::from_owned_array(py, array).unbind()
}

/// A symmetric matrix's `n * n` entries: by column or by row is the same.
pub(crate) fn symmetric(py: Python<'_>, entries: Vec<f64>, n: usize) -> Table {
    let flat = PyArray1::from_vec(py, entries);
    flat.reshape([n, n]).expect("n * n entries").unbind()
}

/// Square templates, one after the other.
pub(crate) fn to_templates(py: Python<'_>, pixels: Vec<u8>, n: usize, side: usize) -> Stack<u8> {
    let flat = PyArray1::from_vec(py, pixels);
    let templates = flat.reshape([n, side, side]).expect("n * side^2 pixels");
    templates.unbind()
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

/// Some rows of an array, as numpy chooses them by a mask, a slice or row numbers.
pub(crate) fn chosen<T, D>(
    array: &Py<numpy::PyArray<T, D>>,
    which: &Bound<'_, PyAny>,
) -> PyResult<Py<numpy::PyArray<T, D>>>
where
    T: Element,
    D: numpy::ndarray::Dimension,
{
    let wrong = |why: String| invalid("which", format!("a mask or rows are needed ({why})"));
    let rows = array.bind(which.py()).as_any().get_item(which);
    let rows = rows.map_err(|error| wrong(error.value(which.py()).to_string()))?;
    let rows = rows.cast_into::<numpy::PyArray<T, D>>();
    Ok(rows.map_err(|error| wrong(error.to_string()))?.unbind())
}
