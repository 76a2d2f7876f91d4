//! The directions `N(x)` that no camera can see, and coordinates `B(x)` along them, see the page of [`gauge`](super).

use crate::math::{inverse_depth, quat};
use crate::observe::POSE_DIM;
use crate::scale::LogRange;
use crate::state::{Block, Covariance, InWorld, Layout};
use nalgebra::Vector3;

/// Turns about the three axes of W, and scale.
pub const GAUGES: usize = 4;
pub(crate) const SCALE: usize = 3;
/// Squared sd(rho) / rho below which depths count as equally well known.
const EXACT: f64 = 1e-6;
/// Squared horizontal part of a ray below which its azimuth is left alone.
const MIN_HORIZONTAL: f64 = 1e-4;

/// `N(x)`, `n x 4` column-major: how each entry of the state moves when camera and map are turned (per radian) or
/// grow (per unit of the logarithm) about the origin of W.
pub fn directions(x: &[f64], layout: &Layout, out: &mut Vec<f64>) {
    let n = x.len();
    out.clear();
    out.resize(n * GAUGES, 0.0);
    position(x, 0, out);
    attitude(x, 3, out);
    position(x, POSE_DIM, out);
    for block in layout.blocks() {
        match block.kind.in_world() {
            InWorld::Landmark => inverse_depth_feature(x, block, out),
            // What a submap transfers is not a place: it stays.
            InWorld::Pose => {
                position(x, block.offset, out);
                attitude(x, block.offset + 3, out);
            }
            InWorld::Nowhere => {}
        }
    }
}

/// A position or velocity in W.
fn position(x: &[f64], at: usize, out: &mut [f64]) {
    let n = x.len();
    let p = Vector3::from_column_slice(&x[at..at + 3]);
    let turn = -quat::skew(&p);
    for k in 0..3 {
        for i in 0..3 {
            out[k * n + at + i] = turn[(i, k)];
        }
        out[SCALE * n + at + k] = p[k];
    }
}

/// An attitude in W: `dq = (0, w / 2) (x) q`.
fn attitude(x: &[f64], at: usize, out: &mut [f64]) {
    let turn = quat::right(&quat::Quat::from_column_slice(&x[at..at + 4])) * 0.5;
    for k in 0..3 {
        for i in 0..4 {
            out[k * x.len() + at + i] = turn[(i, k + 1)];
        }
    }
}

fn inverse_depth_feature(x: &[f64], block: &Block, out: &mut [f64]) {
    let (n, at) = (x.len(), block.offset);
    position(x, at, out);
    let m = inverse_depth::ray(x[at + 3], x[at + 4]);
    if m.x * m.x + m.z * m.z > MIN_HORIZONTAL {
        let turn = inverse_depth::angles(&m).1 * -quat::skew(&m);
        for k in 0..3 {
            out[k * n + at + 3] = turn[(0, k)];
            out[k * n + at + 4] = turn[(1, k)];
        }
    }
    out[SCALE * n + at + 5] = -x[at + 5];
}

/// `B(x)`, `n x 4` column-major, with `B^T N = 1`; the features with ids in `among` (increasing) tell the scale, each by the inverse
/// of its relative variance. Without one whose sd(rho) is below rho the scale's column is zero.
pub fn coordinates(x: &[f64], layout: &Layout, p: &Covariance, among: &[u64], out: &mut Vec<f64>) {
    let n = x.len();
    out.clear();
    out.resize(n * GAUGES, 0.0);
    let q = quat::Quat::from_column_slice(&x[3..POSE_DIM]);
    let turn = quat::right(&quat::Quat::new(q[0], -q[1], -q[2], -q[3])) * (2.0 / q.norm_squared());
    for k in 0..3 {
        for i in 0..4 {
            out[k * n + 3 + i] = turn[(k + 1, i)];
        }
    }
    let camera = Vector3::from_column_slice(&x[..3]);
    let scale = &mut out[SCALE * n..];
    let mut total = 0.0;
    for block in layout.features() {
        if among.binary_search(&block.id).is_err() {
            continue;
        }
        let feature = block.feature(x);
        let rho = feature.scale();
        let variance = p.get(block.offset + 5, block.offset + 5).max(0.0) / (rho * rho);
        // What is hardly known at all has no small steps.
        if rho <= 0.0 || variance.is_nan() || variance >= 1.0 {
            continue;
        }
        let weight = 1.0 / (variance + EXACT);
        let Some(range) = LogRange::of(&camera, &feature) else {
            continue;
        };
        for (b, value) in scale.iter_mut().zip(range.by_camera.iter()) {
            *b += weight * value;
        }
        for (b, value) in scale[block.range()].iter_mut().zip(range.by_feature.iter()) {
            *b += weight * value;
        }
        total += weight;
    }
    if total > 0.0 {
        scale.iter_mut().for_each(|v| *v /= total);
    }
}
