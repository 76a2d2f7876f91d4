//! 1-point RANSAC (Civera, Grasa, Davison, Montiel, J. Field Robotics 2010), to compare HOHCT with.
//!
//! The filter's prior turns one match `i` into a full hypothesis: given it, the innovation expected of match `j` is
//! `S_ji S_ii^-1 g_i`. Low-innovation inliers of the hypothesis are the matches whose remainder
//! `r = g_j - S_ji S_ii^-1 g_i` is within a few standard deviations of the measurement noise, `r^T R_j^-1 r <= sigmas^2`.
//! Since one match makes a hypothesis, all `n` of them are tried instead of a random sample: the result does not
//! depend on a seed. The hypothesis with the most inliers wins (the first among equals; then the inliers' joint
//! distance is not looked at, as in the paper).
//!
//! High-innovation inliers are rescued afterwards: a match that is compatible at the level *given all low-innovation
//! inliers* is accepted too, e.g. a near feature whose own depth is uncertain.

use nalgebra::{Matrix3, Vector3};

use super::batch::{Blocks, MAX_ROWS, Verdict, check};
use super::workspace::{OnePointScratch, Workspace};

/// Settings of [`one_point`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OnePointSettings {
    /// Radius of a low-innovation inlier, in standard deviations of its measurement noise.
    pub low_sigmas: f64,
    /// Confidence level at which high-innovation inliers are rescued, in (0, 1).
    pub level: f64,
}

impl Default for OnePointSettings {
    fn default() -> Self {
        Self {
            low_sigmas: 3.0,
            level: 0.99,
        }
    }
}

/// Blocks consistent with the best 1-point hypothesis, and the rescued ones.
///
/// `s` is `S` (lower triangle, column-major), `noise` the measurement noise of each block.
///
/// # Panics
/// If `noise` does not have one block per block.
pub fn one_point(
    s: &[f64],
    ld: usize,
    g: &[f64],
    noise: &[Matrix3<f64>],
    blocks: Blocks,
    settings: &OnePointSettings,
    ws: &mut Workspace,
) -> Verdict {
    check(s, ld, g, blocks);
    assert_eq!(noise.len(), blocks.len(), "one noise block per block");
    let Workspace {
        rejected,
        quantiles,
        joint,
        one_point: scratch,
        ..
    } = ws;
    let OnePointScratch {
        precision,
        inliers,
        best,
        rescued,
    } = scratch;
    let n = blocks.len();
    precision.clear();
    precision.extend((0..n).map(|block| invert_block(&noise[block], blocks.count(block))));
    best.clear();
    for i in 0..n {
        let (start, rows) = (blocks.start(i), blocks.count(i));
        let own = Matrix3::from_fn(|r, c| {
            if r < rows && c < rows {
                entry(s, ld, start + r, start + c)
            } else {
                0.0
            }
        });
        let innovation = Vector3::from_fn(|r, _| if r < rows { g[start + r] } else { 0.0 });
        let weight = invert_block(&own, rows) * innovation;
        inliers.clear();
        for (j, precision) in precision.iter().enumerate() {
            let base = blocks.start(j);
            let mut rest = Vector3::zeros();
            for r in 0..blocks.count(j) {
                rest[r] = g[base + r];
                for c in 0..rows {
                    rest[r] -= entry(s, ld, base + r, start + c) * weight[c];
                }
            }
            if j == i || rest.dot(&(precision * rest)) <= settings.low_sigmas.powi(2) {
                inliers.push(j);
            }
        }
        if inliers.len() > best.len() {
            best.clone_from(inliers);
        }
    }

    joint.clear();
    for &block in best.iter() {
        joint.push(s, ld, g, blocks, block);
    }
    let low_rows = joint.len();
    rescued.clear();
    for block in 0..n {
        if best.binary_search(&block).is_err() {
            let distance = joint.push(s, ld, g, blocks, block);
            joint.truncate(low_rows);
            if distance <= quantiles.get(settings.level, blocks.count(block)) {
                rescued.push(block);
            }
        }
    }
    for &block in rescued.iter() {
        joint.push(s, ld, g, blocks, block);
    }
    rejected.clear();
    rejected.extend((0..n).filter(|block| {
        best.binary_search(block).is_err() && rescued.binary_search(block).is_err()
    }));
    let mut verdict = Verdict::joint(rejected.len(), joint.d2(), joint.len(), true);
    verdict.nodes = n;
    verdict
}

fn entry(s: &[f64], ld: usize, row: usize, column: usize) -> f64 {
    s[row.min(column) * ld + row.max(column)]
}

/// Inverse of the leading `rows` x `rows` block, zeros elsewhere; zero if it is singular.
fn invert_block(block: &Matrix3<f64>, rows: usize) -> Matrix3<f64> {
    let mut padded = Matrix3::identity();
    for r in 0..rows {
        for c in 0..rows {
            padded[(r, c)] = block[(r, c)];
        }
    }
    let mut inverse = padded.try_inverse().unwrap_or_else(Matrix3::zeros);
    for k in rows..MAX_ROWS {
        inverse[(k, k)] = 0.0;
    }
    inverse
}
