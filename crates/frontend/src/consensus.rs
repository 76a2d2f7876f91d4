//! The pose between two views that most of their matches agree on, under the prior of a measured one.
//!
//! Rays are unit vectors, so that nothing here depends on a camera model. `T_CF` maps points of F into C; its error is
//! over (translation, rotation), tangent on the right.

use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};

const HYPOTHESES: usize = 150; // at 50 % wrong matches one of them is clean with probability 1 - 2e-9
const SAMPLE: usize = 3; // matches a hypothesis: with the prior they fix the directions that matter
const ITERATIONS: usize = 6;
const CONVERGED: f64 = 5e-3; // step in standard deviations of the prior
const PRIOR_WEIGHT: f64 = 0.05; // of a hypothesis' distance from the prior, against one match

/// A pair of matched unit rays, in C and in F.
pub type Pair = (Vector3<f64>, Vector3<f64>);

/// What the matches are measured with.
#[derive(Clone, Copy, Debug)]
pub struct Noise {
    /// Focal lengths of Cs and Cf, pixels per radian.
    pub focal: [f64; 2],
    /// Standard deviation of a right match's residual, pixels.
    pub sigma: f64,
    /// Largest residual of a match that agrees, pixels.
    pub limit: f64,
}

/// Pose that matches agree on.
#[derive(Clone, Debug)]
pub struct Consensus {
    /// `T_CF`.
    pub pose: Pose,
    /// Its covariance over (translation, rotation).
    pub covariance: Matrix6<f64>,
    /// Matches whose residual is within the limit under the pose.
    pub agree: Vec<bool>,
}

/// Sampson residual of a pair, whose standard deviation is that of one pixel coordinate, and its derivative by an
/// error of the pose (on the right), pixels per metre and per radian.
pub fn epipolar_residual(pair: &Pair, pose: &Pose, focal: [f64; 2]) -> (f64, Vector6<f64>) {
    let (rotation, t) = (&pose.rotation, &pose.translation);
    let (ray_s, ray_f) = pair;
    let across_f = t.cross(&(rotation * ray_f));
    let across_s = ray_s.cross(t);
    let value = ray_s.dot(&across_f);
    let square = value * value;
    let variance = (across_f.norm_squared() - square) / (focal[0] * focal[0])
        + (across_s.norm_squared() - square) / (focal[1] * focal[1]);
    let scale = 1.0 / variance.max(1e-18).sqrt();
    // The residual does not depend on the length of t: without the last term a pose without baseline explains all.
    let along = rotation.transpose() * t * (value / t.norm_squared().max(1e-12));
    let by_translation = ray_f.cross(&(rotation.transpose() * ray_s)) - along;
    let by_rotation = ray_f.cross(&(rotation.transpose() * across_s));
    let mut jacobian = Vector6::zeros();
    jacobian.fixed_rows_mut::<3>(0).copy_from(&by_translation);
    jacobian.fixed_rows_mut::<3>(3).copy_from(&by_rotation);
    (value * scale, jacobian * scale)
}

/// Correction of a measured pose that most pairs agree on, under the prior of its covariance.
///
/// Sampled first (three pairs and the prior give a correction, linear in the residuals), unless an earlier pose of
/// nearly the same matches is given to start from; then refined by Gauss-Newton steps with Tukey weights. Fewer than
/// three pairs leave the pose as it is. `None` if the covariance is not positive definite.
pub fn find_consensus(
    pairs: &[Pair],
    prior: &Pose,
    covariance: &Matrix6<f64>,
    noise: &Noise,
    start: Option<&Pose>,
) -> Option<Consensus> {
    if pairs.len() < SAMPLE {
        return Some(Consensus {
            pose: prior.clone(),
            covariance: *covariance,
            agree: vec![true; pairs.len()],
        });
    }
    let root = covariance.cholesky()?.unpack();
    let whitened = |pose: &Pose| -> Vec<(f64, Vector6<f64>)> {
        let residuals = pairs
            .iter()
            .map(|pair| epipolar_residual(pair, pose, noise.focal));
        residuals
            .map(|(value, jacobian)| (value, root.tr_mul(&jacobian)))
            .collect()
    };
    let mut correction = match start {
        Some(start) => root.solve_lower_triangular(&difference(prior, start))?,
        None => sampled_correction(&whitened(prior), noise),
    };
    let mut posterior = Matrix6::identity();
    for _ in 0..ITERATIONS {
        let rows = whitened(&prior.retract(&(root * correction)));
        let mut information = Matrix6::identity();
        let mut gradient = correction;
        for (residual, row) in &rows {
            let inside = (1.0 - (residual / (1.5 * noise.limit)).powi(2)).max(0.0);
            let weight = inside * inside / (noise.sigma * noise.sigma);
            information.ger(weight, row, row, 1.0);
            gradient += row * (weight * residual);
        }
        posterior = information.cholesky()?.inverse();
        let step = posterior * gradient;
        correction -= step;
        if step.amax() < CONVERGED {
            break;
        }
    }
    let pose = prior.retract(&(root * correction));
    let agree = whitened(&pose)
        .iter()
        .map(|(value, _)| value.abs() <= noise.limit)
        .collect();
    let corrected = root * posterior * root.transpose();
    Some(Consensus {
        pose,
        covariance: 0.5 * (corrected + corrected.transpose()),
        agree,
    })
}

/// `xi` with `from Exp(xi) = to`.
fn difference(from: &Pose, to: &Pose) -> Vector6<f64> {
    let back = from.rotation.transpose();
    let mut xi = Vector6::zeros();
    xi.fixed_rows_mut::<3>(0)
        .copy_from(&(back * (to.translation - from.translation)));
    let turn = quat::log(&quat::from_rotation(&(back * to.rotation)));
    xi.fixed_rows_mut::<3>(3).copy_from(&turn);
    xi
}

/// Correction, in standard deviations of the prior, under which most residuals are small.
fn sampled_correction(rows: &[(f64, Vector6<f64>)], noise: &Noise) -> Vector6<f64> {
    let cost = |z: &Vector6<f64>| {
        let costs = rows
            .iter()
            .map(|(value, row)| ((value + row.dot(z)) / noise.limit).powi(2).min(1.0));
        costs.sum::<f64>() + PRIOR_WEIGHT * z.norm_squared()
    };
    let mut random = Random(rows.len() as u64);
    let mut best = Vector6::zeros();
    let mut least = cost(&best);
    for _ in 0..HYPOTHESES {
        let chosen = random.three_of(rows.len()).map(|i| &rows[i]);
        let residuals = Vector3::from(chosen.map(|(value, _)| *value));
        let jacobian = SMatrix::<f64, 3, 6>::from_rows(&chosen.map(|(_, row)| row.transpose()));
        let spread = jacobian * jacobian.transpose() + Matrix3::identity() * noise.sigma.powi(2);
        let Some(factor) = spread.cholesky() else {
            continue;
        };
        let z = -jacobian.tr_mul(&factor.solve(&residuals));
        let value = cost(&z);
        if value < least {
            (best, least) = (z, value);
        }
    }
    best
}

/// SplitMix64: the same draws for the same number of matches.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Three different numbers below `count`, which is at least three.
    fn three_of(&mut self, count: usize) -> [usize; SAMPLE] {
        let mut out = [0; SAMPLE];
        let mut drawn = 0;
        while drawn < SAMPLE {
            let i = (self.next() % count as u64) as usize;
            if !out[..drawn].contains(&i) {
                out[drawn] = i;
                drawn += 1;
            }
        }
        out
    }
}
