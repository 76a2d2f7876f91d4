//! OpenCV's radial-tangential distortion on the normalised image plane, dimensionless.
//!
//! ```text
//! r2 = x^2 + y^2,   L = (1 + k1 r2 + k2 r2^2 + k3 r2^3) / (1 + k4 r2 + k5 r2^2 + k6 r2^3)
//! x_d = x L + 2 p1 x y + p2 (r2 + 2 x^2)
//! y_d = y L + p1 (r2 + 2 y^2) + 2 p2 x y
//! ```
//!
//! `k = [k1, k2, p1, p2, k3, k4, k5, k6]`; the last three are the rational model's. With `L = N / D` the radial part
//! `r L(r^2)` stops growing at the first root of `(N + 2 r2 N') D - 2 r2 N D'`; points beyond it or beyond the first
//! root of `D`, or where the tangential part folds the plane over (Jacobian determinant not positive), are not valid.

use nalgebra::{Matrix2, Vector2};

/// `k1, k2, p1, p2, k3, k4, k5, k6`.
pub(super) type Coefficients = [f64; 8];

/// `r2` at which the radial part folds over; infinite if it never does.
pub(super) fn radius_squared_limit(k: &Coefficients) -> f64 {
    let above = [1.0, k[0], k[1], k[4]];
    let below = [1.0, k[5], k[6], k[7]];
    // Of s^(i + j): the terms of (N + 2 s N') D - 2 s N D'.
    let mut grows = [0.0; 7];
    for (i, n) in above.iter().enumerate() {
        for (j, d) in below.iter().enumerate() {
            grows[i + j] += (1.0 + 2.0 * i as f64 - 2.0 * j as f64) * n * d;
        }
    }
    super::roots::smallest_positive_root(&grows).min(super::roots::smallest_positive_root(&below))
}

/// At `r2`: `L`, its derivative, and that of `r L` by `r`.
fn radial(k: &Coefficients, r2: f64) -> (f64, f64, f64) {
    let [k1, k2, _, _, k3, k4, k5, k6] = *k;
    let above = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
    let below = 1.0 + r2 * (k4 + r2 * (k5 + r2 * k6));
    let above_slope = k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3);
    let below_slope = k4 + r2 * (2.0 * k5 + r2 * 3.0 * k6);
    let above_growth = 1.0 + r2 * (3.0 * k1 + r2 * (5.0 * k2 + r2 * 7.0 * k3));
    let value = above / below;
    (
        value,
        (above_slope - value * below_slope) / below,
        (above_growth - 2.0 * r2 * value * below_slope) / below,
    )
}

/// Distorted coordinates `(x_d, y_d)`; `None` past the fold.
pub(super) fn distort(k: &Coefficients, limit: f64, p: &Vector2<f64>) -> Option<Vector2<f64>> {
    distort_jac(k, limit, p).map(|(d, _)| d)
}

/// Distorted coordinates and `d(x_d, y_d) / d(x, y)`; `None` past the fold.
pub(super) fn distort_jac(
    k: &Coefficients,
    limit: f64,
    p: &Vector2<f64>,
) -> Option<(Vector2<f64>, Matrix2<f64>)> {
    if p.norm_squared() > limit {
        return None;
    }
    let (d, jac) = formula(k, p);
    (jac.determinant() > 0.0).then_some((d, jac))
}

/// Undistorted coordinates of `(x_d, y_d)`.
pub(super) fn undistort(k: &Coefficients, limit: f64, d: &Vector2<f64>) -> Option<Vector2<f64>> {
    let target = d.norm();
    if target == 0.0 && k[2] == 0.0 && k[3] == 0.0 {
        return Some(Vector2::zeros());
    }
    // The radial part alone gives the start; with no tangential part it is the answer.
    let along = |r: f64| {
        let (value, _, growth) = radial(k, r * r);
        (r * value, growth)
    };
    let edge = limit.sqrt();
    let mut p = match super::roots::invert_growing(along, target, edge) {
        Some(r) if target > 0.0 => d * (r / target),
        Some(_) => Vector2::zeros(),
        // Only the tangential part can bring such a point back into reach.
        None if edge.is_finite() => d * (0.99 * edge / target),
        None => return None,
    };
    let tolerance = 1e-14 * (1.0 + target);
    let mut residual = formula(k, &p).0 - d;
    for _ in 0..50 {
        if residual.norm() <= tolerance {
            break;
        }
        let step = formula(k, &p).1.try_inverse()? * residual;
        // Halve the step while it does not help.
        let mut factor = 1.0;
        loop {
            let candidate = p - step * factor;
            let next = formula(k, &candidate).0 - d;
            if next.norm() < residual.norm() {
                p = candidate;
                residual = next;
                break;
            }
            factor *= 0.5;
            if factor < 1e-6 {
                return accept(k, limit, &p, residual.norm(), target);
            }
        }
    }
    accept(k, limit, &p, residual.norm(), target)
}

/// The solution, if the iteration converged to a valid point.
fn accept(
    k: &Coefficients,
    limit: f64,
    p: &Vector2<f64>,
    residual: f64,
    target: f64,
) -> Option<Vector2<f64>> {
    (residual <= 1e-12 * (1.0 + target) && distort_jac(k, limit, p).is_some()).then_some(*p)
}

fn formula(k: &Coefficients, p: &Vector2<f64>) -> (Vector2<f64>, Matrix2<f64>) {
    let (p1, p2) = (k[2], k[3]);
    let (x, y) = (p.x, p.y);
    let r2 = x * x + y * y;
    let (radial, slope, _) = radial(k, r2);
    let d = Vector2::new(
        x * radial + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
        y * radial + p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y,
    );
    let cross = 2.0 * x * y * slope + 2.0 * p1 * x + 2.0 * p2 * y;
    let jac = Matrix2::new(
        radial + 2.0 * x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x,
        cross,
        cross,
        radial + 2.0 * y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x,
    );
    (d, jac)
}
