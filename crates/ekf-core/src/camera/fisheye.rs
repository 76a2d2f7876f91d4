//! OpenCV's fisheye (equidistant) model, dimensionless.
//!
//! ```text
//! r = hypot(x, y),   theta = atan2(r, z)
//! theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)
//! (x_d, y_d) = theta_d / r * (x, y)
//! ```
//!
//! Valid up to the angle where `theta_d` stops growing, and short of 90 degrees.

use std::f64::consts::FRAC_PI_2;

use nalgebra::{Matrix2x3, Vector2, Vector3};

/// Below this `r / z` the series about the axis is used; the terms left out are below 1e-16.
const SMALL: f64 = 1e-4;

/// Largest valid angle from the optical axis, radians.
pub(super) fn angle_limit(k: &[f64; 4]) -> f64 {
    super::roots::smallest_positive_root(&[1.0, 3.0 * k[0], 5.0 * k[1], 7.0 * k[2], 9.0 * k[3]])
        .sqrt()
        .min(FRAC_PI_2)
}

/// Distorted coordinates `(x_d, y_d)` of a point in the camera frame; `None` past the limit.
pub(super) fn distort(k: &[f64; 4], limit: f64, p: &Vector3<f64>) -> Option<Vector2<f64>> {
    let r = p.x.hypot(p.y);
    let theta = r.atan2(p.z);
    if theta > limit {
        return None;
    }
    let scale = if r < SMALL * p.z {
        near_axis(k, p.z, r).0
    } else {
        angle(k, theta).0 / r
    };
    Some(Vector2::new(scale * p.x, scale * p.y))
}

/// Distorted coordinates and `d(x_d, y_d) / d(x, y, z)`; `None` past the limit.
pub(super) fn distort_jac(
    k: &[f64; 4],
    limit: f64,
    p: &Vector3<f64>,
) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
    let r = p.x.hypot(p.y);
    let theta = r.atan2(p.z);
    if theta > limit {
        return None;
    }
    // scale = theta_d / r, across = (d scale / d r) / r, along = d scale / d z
    let (scale, across, along) = if r < SMALL * p.z {
        near_axis(k, p.z, r)
    } else {
        let (theta_d, slope) = angle(k, theta);
        let scale = theta_d / r;
        let range2 = r * r + p.z * p.z;
        (
            scale,
            (slope * p.z / range2 - scale) / (r * r),
            -slope / range2,
        )
    };
    let d = Vector2::new(scale * p.x, scale * p.y);
    let jac = Matrix2x3::new(
        scale + across * p.x * p.x,
        across * p.x * p.y,
        along * p.x,
        across * p.x * p.y,
        scale + across * p.y * p.y,
        along * p.y,
    );
    Some((d, jac))
}

/// Unit ray of distorted coordinates; `None` past the limit.
pub(super) fn undistort(k: &[f64; 4], limit: f64, d: &Vector2<f64>) -> Option<Vector3<f64>> {
    let theta_d = d.norm();
    let theta = super::roots::invert_growing(|theta| angle(k, theta), theta_d, limit)?;
    // sin(theta) / theta_d -> 1 on the axis
    let scale = if theta_d < 1e-9 {
        1.0
    } else {
        theta.sin() / theta_d
    };
    let ray = Vector3::new(scale * d.x, scale * d.y, theta.cos());
    (ray.z > super::MIN_DEPTH).then_some(ray)
}

/// `theta_d` and `d theta_d / d theta`.
fn angle(k: &[f64; 4], theta: f64) -> (f64, f64) {
    let t2 = theta * theta;
    let theta_d = theta * (1.0 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3]))));
    let slope = 1.0 + t2 * (3.0 * k[0] + t2 * (5.0 * k[1] + t2 * (7.0 * k[2] + t2 * 9.0 * k[3])));
    (theta_d, slope)
}

/// `scale`, `across` and `along` (see [`distort_jac`]) for small `t = r / z`: `theta_d = t + (k1 - 1/3) t^3 + O(t^5)`.
fn near_axis(k: &[f64; 4], z: f64, r: f64) -> (f64, f64, f64) {
    let cubic = k[0] - 1.0 / 3.0;
    let t2 = (r / z) * (r / z);
    let inv_z = 1.0 / z;
    (
        inv_z * (1.0 + cubic * t2),
        2.0 * cubic * inv_z * inv_z * inv_z,
        -inv_z * inv_z * (1.0 + 3.0 * cubic * t2),
    )
}
