//! Covariance that moves with the estimate (METHOD 14): what no camera can see stays unseen.
//!
//! Turning or scaling camera and map about the origin changes no bearing, so a bearing must not reduce the
//! uncertainty along those directions `N(x)`. grad H respects that at the point where it is taken; but the update
//! moves the estimate, `N` moves with it, and the next update would gain information that no measurement holds.
//! So P is carried along. With coordinates `B` of the gauge, `B^T N = 1`,
//!
//! ```text
//! T = 1 + (N(x+) - N(x)) B(x)^T,    P <- T P T^T    (rank 4)
//! ```
//!
//! takes `N(x)` to `N(x+)`. The coordinates are the attitude of the camera, and the mean logarithm of the range of
//! the map's points from it. Translations need none of this: their direction is the same everywhere.

use crate::math::{inverse_depth, quat};
use crate::observe::point::FeatureState;
use crate::state::{Block, BlockKind, Covariance, Layout, POSE_DIM, State};
use nalgebra::{SMatrix, Vector3};

/// Turns about the three axes of W, and scale.
pub const GAUGES: usize = 4;
const SCALE: usize = 3;
/// Largest sd(rho) / rho of a feature that tells the scale: of one whose depth has converged (METHOD 12).
const MAX_RHO_RATIO: f64 = 0.1;
/// Squared horizontal part of a ray below which its azimuth is left alone.
const MIN_HORIZONTAL: f64 = 1e-4;

/// Buffers of the transport; they only grow.
#[derive(Clone, Debug, Default)]
pub(crate) struct Gauge {
    from: Vec<f64>,
    to: Vec<f64>,
    coordinates: Vec<f64>,
    stored: Vec<f64>,
    column: Vec<f64>,
    left: Vec<f64>,
    right: Vec<f64>,
}

impl Gauge {
    /// Notes directions and coordinates before an update.
    pub(crate) fn note(&mut self, state: &State) {
        directions(&state.x, &state.layout, &mut self.from);
        coordinates(&state.x, &state.layout, &state.p, &mut self.coordinates);
    }

    /// Carries P from the noted mean to the present one, before quaternions are normalised. O(n^2).
    pub(crate) fn transport(&mut self, state: &mut State) {
        directions(&state.x, &state.layout, &mut self.to);
        self.gather(state);
        self.project(state);
        let n = state.p.stored().n;
        let own: SMatrix<f64, GAUGES, GAUGES> = SMatrix::from_fn(|a, b| {
            let (c, p) = (column(&self.stored, n, a), column(&self.right, n, b));
            c.iter().zip(p).map(|(c, p)| c * p).sum()
        });
        // With D = N(x+) - N(x) and A = P B + D (B^T P B) / 2 it is P + D A^T + A D^T = [D A] [A D]^T.
        for a in 0..GAUGES {
            for b in 0..GAUGES {
                let half = 0.5 * own[(b, a)];
                let d = column(&self.left, n, b);
                for (out, d) in self.right[a * n..(a + 1) * n].iter_mut().zip(d) {
                    *out += half * d;
                }
            }
        }
        self.left.extend_from_slice(&self.right);
        self.right.extend_from_slice(&self.left[..n * GAUGES]);
        state.p.add_product(&self.left, &self.right, 2 * GAUGES);
    }

    /// `left = D` and `stored = B` by stored rows of P: a row that several features share is moved once and tells the
    /// sum of what they tell.
    fn gather(&mut self, state: &State) {
        let (stored, rows) = (state.p.stored(), state.x.len());
        for buffer in [&mut self.left, &mut self.stored] {
            buffer.clear();
            buffer.resize(stored.n * GAUGES, 0.0);
        }
        for k in 0..GAUGES {
            for (i, &slot) in stored.slots.iter().enumerate() {
                let (at, row) = (k * stored.n + slot, k * rows + i);
                self.left[at] = self.to[row] - self.from[row];
                self.stored[at] += self.coordinates[row];
            }
        }
    }

    /// `right = P B`. The coordinates of the turns touch the quaternion only.
    fn project(&mut self, state: &State) {
        let n = state.p.stored().n;
        self.column.resize(n, 0.0);
        self.right.clear();
        self.right.resize(n * GAUGES, 0.0);
        let (turns, scale) = self.right.split_at_mut(n * SCALE);
        for i in 3..POSE_DIM {
            let slot = state.p.stored().slots[i];
            state.p.stored_column(slot, &mut self.column);
            for (k, out) in turns.chunks_exact_mut(n).enumerate() {
                let weight = self.stored[k * n + slot];
                for (out, p) in out.iter_mut().zip(&self.column) {
                    *out += weight * p;
                }
            }
        }
        state.p.times(column(&self.stored, n, SCALE), scale);
    }
}

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
        match block.kind {
            BlockKind::Feature => feature(x, block, out),
            BlockKind::Clone => {
                position(x, block.offset, out);
                attitude(x, block.offset + 3, out);
            }
            // T_CF is metric and seen from C; dual rows come with map.local only.
            BlockKind::WornBias | BlockKind::WornError | BlockKind::Dual(_) => {}
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

fn feature(x: &[f64], block: &Block, out: &mut [f64]) {
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

/// `B(x)`, `n x 4` column-major, with `B^T N = 1`. Without a feature of known depth the scale's column is zero.
pub fn coordinates(x: &[f64], layout: &Layout, p: &Covariance, out: &mut Vec<f64>) {
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
    let mut count = 0.0;
    for block in layout.of_kind(BlockKind::Feature) {
        let at = block.offset;
        let feature = FeatureState(SMatrix::from_column_slice(&x[at..at + 6]));
        let sd = p.get(at + 5, at + 5).max(0.0).sqrt();
        if sd >= MAX_RHO_RATIO * feature.rho() {
            continue;
        }
        let Some(point) = feature.point() else {
            continue;
        };
        let ray = point - camera;
        let by_point = ray / ray.norm_squared();
        for i in 0..3 {
            scale[i] -= by_point[i];
        }
        let by_feature = feature.point_jacobian().tr_mul(&by_point);
        scale[at..at + 6].copy_from_slice(by_feature.as_slice());
        count += 1.0;
    }
    if count > 0.0 {
        scale.iter_mut().for_each(|v| *v /= count);
    }
}

fn column(matrix: &[f64], n: usize, j: usize) -> &[f64] {
    &matrix[j * n..(j + 1) * n]
}
