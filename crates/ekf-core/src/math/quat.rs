//! Hamilton quaternions, scalar first `(w, x, y, z)`, as plain 4-vectors (METHOD 1).
//!
//! Every rotation `R(q)` normalises `q`, so its derivative vanishes along `q` itself.

use nalgebra::{Matrix3, Matrix3x4, Matrix4, Matrix4x3, Vector3, Vector4};

/// Quaternion `(w, x, y, z)`.
pub type Quat = Vector4<f64>;

/// The identity rotation.
pub fn identity() -> Quat {
    Quat::new(1.0, 0.0, 0.0, 0.0)
}

/// Cross-product matrix: `skew(a) b = a x b`.
pub fn skew(a: &Vector3<f64>) -> Matrix3<f64> {
    Matrix3::new(0.0, -a.z, a.y, a.z, 0.0, -a.x, -a.y, a.x, 0.0)
}

/// Rotation matrix of `q / |q|`.
pub fn rotation(q: &Quat) -> Matrix3<f64> {
    let q = q / q.norm();
    let (w, x, y, z) = (q[0], q[1], q[2], q[3]);
    Matrix3::new(
        1.0 - 2.0 * (y * y + z * z),
        2.0 * (x * y - w * z),
        2.0 * (x * z + w * y),
        2.0 * (x * y + w * z),
        1.0 - 2.0 * (x * x + z * z),
        2.0 * (y * z - w * x),
        2.0 * (x * z - w * y),
        2.0 * (y * z + w * x),
        1.0 - 2.0 * (x * x + y * y),
    )
}

/// Quaternion of a rotation matrix, with `w >= 0`.
pub fn from_rotation(r: &Matrix3<f64>) -> Quat {
    let trace = r.trace();
    let q = if trace > 0.0 {
        let s = (trace + 1.0).sqrt() * 2.0;
        Quat::new(
            0.25 * s,
            (r[(2, 1)] - r[(1, 2)]) / s,
            (r[(0, 2)] - r[(2, 0)]) / s,
            (r[(1, 0)] - r[(0, 1)]) / s,
        )
    } else {
        // The largest diagonal entry keeps the square root away from zero.
        let i = (0..3)
            .max_by(|&a, &b| r[(a, a)].total_cmp(&r[(b, b)]))
            .unwrap_or(0);
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let s = (1.0 + r[(i, i)] - r[(j, j)] - r[(k, k)]).sqrt() * 2.0;
        let mut q = Quat::zeros();
        q[0] = (r[(k, j)] - r[(j, k)]) / s;
        q[1 + i] = 0.25 * s;
        q[1 + j] = (r[(j, i)] + r[(i, j)]) / s;
        q[1 + k] = (r[(k, i)] + r[(i, k)]) / s;
        q
    };
    let q = q.normalize();
    if q[0] < 0.0 { -q } else { q }
}

/// Rotation matrix of a rotation vector, rad.
pub fn rotation_exp(w: &Vector3<f64>) -> Matrix3<f64> {
    rotation(&exp(w))
}

/// Rotation vector of a rotation matrix, rad; no longer than pi.
pub fn rotation_log(r: &Matrix3<f64>) -> Vector3<f64> {
    log(&from_rotation(r))
}

/// Whether a matrix is a rotation: orthonormal to within `tolerance` an entry, finite, and no reflection.
pub fn is_rotation(m: &Matrix3<f64>, tolerance: f64) -> bool {
    let off = (m * m.transpose() - Matrix3::identity()).abs();
    // NaN is not within.
    off.iter().all(|off| *off <= tolerance) && m.determinant() > 0.0
}

/// Matrix of left multiplication: `left(a) b = a (x) b`.
pub fn left(a: &Quat) -> Matrix4<f64> {
    Matrix4::new(
        a[0], -a[1], -a[2], -a[3], a[1], a[0], -a[3], a[2], a[2], a[3], a[0], -a[1], a[3], -a[2],
        a[1], a[0],
    )
}

/// Matrix of right multiplication: `right(b) a = a (x) b`.
pub fn right(b: &Quat) -> Matrix4<f64> {
    Matrix4::new(
        b[0], -b[1], -b[2], -b[3], b[1], b[0], b[3], -b[2], b[2], -b[3], b[0], b[1], b[3], b[2],
        -b[1], b[0],
    )
}

/// Quaternion of a rotation vector (rad).
pub fn exp(w: &Vector3<f64>) -> Quat {
    let (half, sinc_half) = half_angle(w);
    Quat::new(
        half.cos(),
        w.x * sinc_half,
        w.y * sinc_half,
        w.z * sinc_half,
    )
}

/// Derivative of [`exp`] with respect to the rotation vector, 4x3.
pub fn exp_jacobian(w: &Vector3<f64>) -> Matrix4x3<f64> {
    let (half, s) = half_angle(w);
    let angle2 = w.norm_squared();
    // d(sin(a/2)/a)/da / a, by its series near zero.
    let ds = if angle2 < 1e-8 {
        -1.0 / 24.0 + angle2 / 960.0
    } else {
        (0.5 * half.cos() - s) / angle2
    };
    let mut j = Matrix4x3::zeros();
    j.fixed_view_mut::<1, 3>(0, 0)
        .copy_from(&(-0.5 * s * w.transpose()));
    j.fixed_view_mut::<3, 3>(1, 0)
        .copy_from(&(Matrix3::identity() * s + w * w.transpose() * ds));
    j
}

/// `(a/2, sin(a/2)/a)` for `a = |w|`.
fn half_angle(w: &Vector3<f64>) -> (f64, f64) {
    let angle = w.norm();
    let half = 0.5 * angle;
    let s = if angle < 1e-4 {
        0.5 - angle * angle / 48.0
    } else {
        half.sin() / angle
    };
    (half, s)
}

/// Rotation vector of `q`, angle in `[0, pi]`.
pub fn log(q: &Quat) -> Vector3<f64> {
    let q = q / q.norm();
    let q = if q[0] < 0.0 { -q } else { q };
    let v = Vector3::new(q[1], q[2], q[3]);
    let n = v.norm();
    if n < 1e-10 {
        v * 2.0
    } else {
        v * (2.0 * n.atan2(q[0]) / n)
    }
}

/// Right tangent from a quaternion increment: `R(q + dq) = R(q) Exp(tangent(q) dq)`, 3x4.
pub fn tangent(q: &Quat) -> Matrix3x4<f64> {
    let s = 2.0 / q.norm_squared();
    Matrix3x4::new(
        -q[1], q[0], q[3], -q[2], -q[2], -q[3], q[0], q[1], -q[3], q[2], -q[1], q[0],
    ) * s
}

/// Quaternion increment from a right tangent: `q (x) exp(w) = q + lift(q) w + O(w^2)`, 4x3.
pub fn lift(q: &Quat) -> Matrix4x3<f64> {
    left(q).fixed_view::<4, 3>(0, 1) * 0.5
}

/// Derivative of `R(q) v` with respect to `q`, 3x4.
pub fn rotate_jacobian(q: &Quat, v: &Vector3<f64>) -> Matrix3x4<f64> {
    -rotation(q) * skew(v) * tangent(q)
}

/// Derivative of `R(q)^T v` with respect to `q`, 3x4.
pub fn rotate_inverse_jacobian(q: &Quat, v: &Vector3<f64>) -> Matrix3x4<f64> {
    skew(&(rotation(q).transpose() * v)) * tangent(q)
}

/// Derivative of `q / |q|`, 4x4 (METHOD 3: P is mapped through it after every step).
pub fn normalise_jacobian(q: &Quat) -> Matrix4<f64> {
    let n = q.norm();
    (Matrix4::identity() - q * q.transpose() / (n * n)) / n
}

/// Right Jacobian of SO(3): `Exp(w + dw) = Exp(w) Exp(J dw)`.
pub fn right_jacobian(w: &Vector3<f64>) -> Matrix3<f64> {
    let a2 = w.norm_squared();
    let (b, c) = if a2 < 1e-8 {
        (0.5 - a2 / 24.0, 1.0 / 6.0 - a2 / 120.0)
    } else {
        let a = a2.sqrt();
        ((1.0 - a.cos()) / a2, (a - a.sin()) / (a2 * a))
    };
    let k = skew(w);
    Matrix3::identity() - k * b + k * k * c
}
