//! Small fixed-size mathematics: quaternions, poses, inverse depth.

pub mod between;
pub mod inverse_depth;
pub(crate) mod numbers;
pub mod pose;
pub mod quat;

use nalgebra::Matrix3;

/// `a + a^T`.
pub(crate) fn plus_transpose(a: Matrix3<f64>) -> Matrix3<f64> {
    a + a.transpose()
}
