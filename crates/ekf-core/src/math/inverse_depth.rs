//! The inverse-depth point (METHOD 2): `p + m(theta, phi) / rho`.

use nalgebra::{Matrix2x3, Vector2, Vector3};

/// Unit ray of azimuth `theta` and elevation `phi`:
/// `m = (cos phi sin theta, -sin phi, cos phi cos theta)`.
pub fn ray(theta: f64, phi: f64) -> Vector3<f64> {
    let (st, ct) = theta.sin_cos();
    let (sp, cp) = phi.sin_cos();
    Vector3::new(cp * st, -sp, cp * ct)
}

/// `(dm/dtheta, dm/dphi)`.
pub fn ray_jacobian(theta: f64, phi: f64) -> (Vector3<f64>, Vector3<f64>) {
    let (st, ct) = theta.sin_cos();
    let (sp, cp) = phi.sin_cos();
    (
        Vector3::new(cp * ct, 0.0, -cp * st),
        Vector3::new(-sp * st, -cp, -sp * ct),
    )
}

/// `(theta, phi)` of a direction `h` of any length, with the 2x3 derivative.
pub fn angles(h: &Vector3<f64>) -> (Vector2<f64>, Matrix2x3<f64>) {
    let xz2 = (h.x * h.x + h.z * h.z).max(1e-300);
    let xz = xz2.sqrt();
    let n2 = xz2 + h.y * h.y;
    let value = Vector2::new(h.x.atan2(h.z), (-h.y).atan2(xz));
    let jacobian = Matrix2x3::new(
        h.z / xz2,
        0.0,
        -h.x / xz2,
        h.x * h.y / (xz * n2),
        -xz / n2,
        h.z * h.y / (xz * n2),
    );
    (value, jacobian)
}
