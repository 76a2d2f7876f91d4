//! Davison's one-parameter wide-angle distortion, on pixels measured from the principal point.
//!
//! `r_u^2 (1 - 2 K r_d^2) = r_d^2`, `K` in 1/px^2, hence
//!
//! ```text
//! distorted = undistorted / sqrt(1 + 2 K r_u^2),   undistorted = distorted / sqrt(1 - 2 K r_d^2)
//! ```
//!
//! The distorted radius grows with the undistorted one wherever the root is real. With `K > 0` no pixel beyond
//! `r_d = 1 / sqrt(2 K)` is reached; with `K < 0` no point beyond `r_u = 1 / sqrt(-2 K)` has an image.

use nalgebra::{Matrix2, Vector2};

/// Distorted centred pixel; `None` outside the model.
pub(super) fn distort(k: f64, u: &Vector2<f64>) -> Option<Vector2<f64>> {
    let root2 = 1.0 + 2.0 * k * u.norm_squared();
    (root2 > 0.0).then(|| u / root2.sqrt())
}

/// Distorted centred pixel and `d distorted / d undistorted`; `None` outside the model.
pub(super) fn distort_jac(k: f64, u: &Vector2<f64>) -> Option<(Vector2<f64>, Matrix2<f64>)> {
    let root2 = 1.0 + 2.0 * k * u.norm_squared();
    if root2 <= 0.0 {
        return None;
    }
    let scale = 1.0 / root2.sqrt();
    // d scale / d u = -2 K scale^3 u^T
    let jac = Matrix2::identity() * scale - u * u.transpose() * (2.0 * k * scale * scale * scale);
    Some((u * scale, jac))
}

/// Undistorted centred pixel; `None` outside the model.
pub(super) fn undistort(k: f64, d: &Vector2<f64>) -> Option<Vector2<f64>> {
    let root2 = 1.0 - 2.0 * k * d.norm_squared();
    (root2 > 0.0).then(|| d / root2.sqrt())
}
