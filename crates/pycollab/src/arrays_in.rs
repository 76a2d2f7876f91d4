//! Arrays that Python gives: every check of type and shape, and the one place that knows numpy's memory layouts.
//!
//! Numbers are converted from any type that loses no meaning. Images, templates and descriptors are large, so they
//! must have their type already; they are borrowed where they lie in row order and copied where they do not
//! (column-major arrays, slices with a step, mirrored views, unaligned buffers).

use crate::errors::{bad_shape, invalid, to_python};
use ::frontend::Image;
use ekf_core::EkfError;
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use nalgebra::{DMatrix, DVector, Matrix6, SMatrix, Vector2};
use numpy::ndarray::{Dimension, Ix1, Ix2, Ix3};
use numpy::{Element, PyReadonlyArray, PyUntypedArrayMethods};
use pyo3::prelude::*;

/// An argument before its type and shape are checked.
///
/// Python: ArrayLike
pub(crate) type Argument<'py> = Bound<'py, PyAny>;

/// Such an argument that must have its type already: an image, or templates.
///
/// Python: NDArray[np.uint8]
pub(crate) type PixelsArgument<'py> = Argument<'py>;

/// The same for descriptors, and for the response of a detector.
///
/// Python: NDArray[np.float32]
pub(crate) type SinglesArgument<'py> = Argument<'py>;

/// Several arrays of different lengths.
///
/// Python: Sequence[ArrayLike]
pub(crate) type Arguments<'py> = Argument<'py>;

/// Which rows of an array are wanted, as numpy takes it.
///
/// Python: NDArray[np.bool_] | NDArray[np.int64] | slice
pub(crate) type RowsArgument<'py> = Argument<'py>;

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

impl Number for bool {
    const NAME: &'static str = "bool";
    const KINDS: &'static str = "b";
    const NEEDED: &'static str = "True and False";
}

/// Anything that numpy takes for an array of numbers, converted if it has another type.
fn array<'py, T: Number, D: Dimension>(
    what: &'static str,
    expected: &str,
    value: &Argument<'py>,
) -> PyResult<PyReadonlyArray<'py, T, D>> {
    if let Ok(array) = value.extract::<PyReadonlyArray<'py, T, D>>()
        && array.is_aligned()
    {
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

/// An array of one type whose entries are at hand row by row, whatever their order in memory.
pub(crate) struct InRows<'py, T: Element, D: Dimension> {
    array: PyReadonlyArray<'py, T, D>,
    copied: Vec<T>,
}

impl<'py, T: Element + Copy, D: Dimension> InRows<'py, T, D> {
    /// Takes arrays of this very type alone; `expected` says which.
    pub(crate) fn new(what: &'static str, expected: &str, value: &Argument<'py>) -> PyResult<Self> {
        let mut array: PyReadonlyArray<'py, T, D> = value
            .extract()
            .map_err(|_| invalid(what, format!("{expected} is needed{}", found(value))))?;
        if !array.is_aligned() {
            array = value.call_method0("copy")?.extract()?;
        }
        let view = array.as_array();
        let copied = match view.is_standard_layout() {
            true => Vec::new(),
            false => view.iter().copied().collect(),
        };
        Ok(Self { array, copied })
    }

    /// Its shape.
    pub(crate) fn shape(&self) -> &[usize] {
        self.array.shape()
    }

    /// Its entries, row by row.
    pub(crate) fn entries(&self) -> &[T] {
        self.array.as_array().to_slice().unwrap_or(&self.copied)
    }
}

/// ", not ..." with type and shape, as far as a value has them.
fn found(value: &Argument<'_>) -> String {
    let (shape, dtype) = (value.getattr("shape"), value.getattr("dtype"));
    match (shape, dtype) {
        (Ok(shape), Ok(dtype)) => format!(", not {shape} {dtype}"),
        _ => String::new(),
    }
}

/// A grey image.
pub(crate) type Grey<'py> = InRows<'py, u8, Ix2>;

/// `(H, W)` uint8.
pub(crate) fn grey<'py>(what: &'static str, value: &Argument<'py>) -> PyResult<Grey<'py>> {
    InRows::new(what, "a (H, W) array of uint8", value)
}

impl Grey<'_> {
    /// As the front end takes it.
    pub(crate) fn image(&self) -> PyResult<Image<'_>> {
        let shape = self.shape();
        Image::new(self.entries(), shape[1], shape[0])
            .ok_or_else(|| bad_shape("image", "(H, W), not empty", shape))
    }
}

/// Square templates of one odd side.
pub(crate) struct Templates<'py> {
    pixels: InRows<'py, u8, Ix3>,
    /// How many.
    pub(crate) count: usize,
    /// Their side, pixels.
    pub(crate) side: usize,
}

impl Templates<'_> {
    /// One after the other.
    pub(crate) fn pixels(&self) -> &[u8] {
        self.pixels.entries()
    }
}

/// `(N, h, h)` uint8, h odd.
pub(crate) fn templates<'py>(value: &Argument<'py>) -> PyResult<Templates<'py>> {
    let pixels: InRows<'_, u8, Ix3> =
        InRows::new("templates", "an (N, h, h) array of uint8", value)?;
    let (count, side) = (pixels.shape()[0], pixels.shape()[1]);
    if pixels.shape()[2] != side {
        return Err(bad_shape("templates", "(N, h, h)", pixels.shape()));
    }
    odd_side("templates", side)?;
    Ok(Templates {
        pixels,
        count,
        side,
    })
}

/// Checks the side of a template.
pub(crate) fn odd_side(what: &'static str, side: usize) -> PyResult<()> {
    if side % 2 == 1 && side >= 3 {
        return Ok(());
    }
    let why = format!("a template's side must be odd and at least 3, it is {side}");
    Err(invalid(what, why))
}

/// Checks that every number is one.
pub(crate) fn finite<const R: usize, const C: usize>(
    what: &'static str,
    value: SMatrix<f64, R, C>,
) -> PyResult<SMatrix<f64, R, C>> {
    if value.iter().all(|x| x.is_finite()) {
        return Ok(value);
    }
    Err(to_python(EkfError::NonFinite { what }))
}

/// `(N, N)` matrix of finite numbers.
pub(crate) fn finite_square(what: &'static str, value: &Argument<'_>) -> PyResult<DMatrix<f64>> {
    let matrix = square(what, value)?;
    if matrix.iter().all(|x| x.is_finite()) {
        return Ok(matrix);
    }
    Err(to_python(EkfError::NonFinite { what }))
}

/// `(K,)` finite numbers.
pub(crate) fn vector<const K: usize>(
    what: &'static str,
    value: &Argument<'_>,
) -> PyResult<SMatrix<f64, K, 1>> {
    let expected = format!("({K},)");
    let array = array::<f64, Ix1>(what, &expected, value)?;
    let view = array.as_array();
    if view.shape() != [K] {
        return Err(bad_shape(what, &expected, view.shape()));
    }
    finite(what, SMatrix::from_fn(|i, _| view[i]))
}

/// `(N,)` numbers.
pub(crate) fn numbers(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<f64>> {
    let array = array::<f64, Ix1>(what, "(N,)", value)?;
    Ok(array.as_array().to_vec())
}

/// `(N,)` finite numbers.
pub(crate) fn finite_numbers(what: &'static str, value: &Argument<'_>) -> PyResult<DVector<f64>> {
    let numbers = numbers(what, value)?;
    if numbers.iter().all(|x| x.is_finite()) {
        return Ok(DVector::from_vec(numbers));
    }
    Err(to_python(EkfError::NonFinite { what }))
}

/// `(N,)` whole numbers.
pub(crate) fn whole_numbers(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<i64>> {
    let array = array::<i64, Ix1>(what, "(N,)", value)?;
    Ok(array.as_array().to_vec())
}

/// `(N,)` truths.
pub(crate) fn mask(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<bool>> {
    let array = array::<bool, Ix1>(what, "(N,)", value)?;
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

/// `(K, N, 2)` pixels, view by view.
pub(crate) fn views(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<Vec<Vector2<f64>>>> {
    let array = array::<f64, Ix3>(what, "(K, N, 2)", value)?;
    let all = array.as_array();
    if all.shape()[2] != 2 {
        return Err(bad_shape(what, "(K, N, 2)", all.shape()));
    }
    let views = all.outer_iter();
    Ok(views
        .map(|view| {
            view.outer_iter()
                .map(|uv| Vector2::new(uv[0], uv[1]))
                .collect()
        })
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

/// `(R, C)` matrix of any size.
pub(crate) fn table(what: &'static str, value: &Argument<'_>) -> PyResult<DMatrix<f64>> {
    let array = array::<f64, Ix2>(what, "(R, C)", value)?;
    let view = array.as_array();
    Ok(DMatrix::from_fn(view.nrows(), view.ncols(), |i, j| {
        view[[i, j]]
    }))
}

/// `(N, N)` matrix.
pub(crate) fn square(what: &'static str, value: &Argument<'_>) -> PyResult<DMatrix<f64>> {
    let matrix = table(what, value)?;
    if !matrix.is_square() {
        return Err(bad_shape(what, "(N, N)", &[matrix.nrows(), matrix.ncols()]));
    }
    Ok(matrix)
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
    let m = finite(what, matrix::<4, 4>(what, value)?)?;
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

/// How far a matrix may be from a rotation.
pub(crate) const ROUNDING: f64 = 1e-6;

/// As [`pose`], its 3x3 a rotation matrix up to [`ROUNDING`].
pub(crate) fn rigid(what: &'static str, value: &Argument<'_>) -> PyResult<Pose> {
    let pose = pose(what, value)?;
    if quat::is_rotation(&pose.rotation, ROUNDING) {
        return Ok(pose);
    }
    let why = "its 3x3 is not a rotation matrix; give a 4x4 rigid transform";
    Err(invalid(what, why))
}

/// 6x6 covariance.
pub(crate) fn covariance6(what: &'static str, value: &Argument<'_>) -> PyResult<Matrix6<f64>> {
    matrix::<6, 6>(what, value)
}

/// `(N,)` ids, -1 for none.
pub(crate) fn optional_ids(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<Option<u64>>> {
    let array = array::<i64, Ix1>(what, "(N,)", value)?;
    let id = |&id: &i64| match id {
        -1 => Ok(None),
        id if id < 0 => {
            let why = format!("{id} is not an id; give -1 for a new point");
            Err(invalid(what, why))
        }
        id => Ok(Some(id.unsigned_abs())),
    };
    array.as_array().iter().map(id).collect()
}

/// `(N,)` ids.
pub(crate) fn ids(what: &'static str, value: &Argument<'_>) -> PyResult<Vec<u64>> {
    let array = array::<i64, Ix1>(what, "(N,)", value)?;
    let id = |&id: &i64| {
        u64::try_from(id)
            .map_err(|_| invalid(what, format!("{id} is not an id; ids are not negative")))
    };
    array.as_array().iter().map(id).collect()
}
