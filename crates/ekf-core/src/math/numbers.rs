//! Matrices in a snapshot: their numbers, column after column, none of which may be anything but finite.

use nalgebra::SMatrix;
use serde::de::Error;
use serde::{Deserialize, Deserializer, Serializer};

type Matrix<const R: usize, const C: usize> = SMatrix<f64, R, C>;

pub(crate) fn serialize<S: Serializer, const R: usize, const C: usize>(
    matrix: &Matrix<R, C>,
    to: S,
) -> Result<S::Ok, S::Error> {
    to.collect_seq(matrix.iter())
}

pub(crate) fn deserialize<'de, D: Deserializer<'de>, const R: usize, const C: usize>(
    from: D,
) -> Result<Matrix<R, C>, D::Error> {
    matrix(&Vec::deserialize(from)?)
}

fn matrix<E: Error, const R: usize, const C: usize>(numbers: &[f64]) -> Result<Matrix<R, C>, E> {
    if numbers.len() == R * C && numbers.iter().all(|v| v.is_finite()) {
        return Ok(Matrix::from_column_slice(numbers));
    }
    Err(E::custom("a matrix has other numbers, or some not finite"))
}

/// The same of a matrix that may be missing.
pub(crate) mod optional {
    use super::Matrix;
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    pub(crate) fn serialize<S: Serializer, const R: usize, const C: usize>(
        matrix: &Option<Matrix<R, C>>,
        to: S,
    ) -> Result<S::Ok, S::Error> {
        matrix.as_ref().map(|m| m.as_slice()).serialize(to)
    }

    pub(crate) fn deserialize<'de, D: Deserializer<'de>, const R: usize, const C: usize>(
        from: D,
    ) -> Result<Option<Matrix<R, C>>, D::Error> {
        let numbers = Option::<Vec<f64>>::deserialize(from)?;
        numbers.map(|numbers| super::matrix(&numbers)).transpose()
    }
}
