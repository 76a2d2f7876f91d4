//! An answer in the unit that the caller wants, with the joint covariance that it has in that unit.

use super::fit::{Estimate, Fit};
use super::{POSES, Structure};
use nalgebra::{DMatrix, DVector, Vector3};

impl Fit<'_> {
    /// The answer in the unit in which the mean of rho is `rho`, with its joint covariance.
    pub(super) fn structure(
        &self,
        e: Estimate,
        rho: f64,
        max_rho_ratio: f64,
        least: usize,
    ) -> Option<Structure> {
        let views = self.pixels.len();
        let count = self.tracks.len();
        let cov = self
            .normal(&e)?
            .covariance([views - 2, views.saturating_sub(3)], views > 2)?;
        let mean = e.points.iter().map(|y| y.z).sum::<f64>() / count as f64;
        if mean <= 0.0 {
            return None;
        }
        // d of every number by the logarithm of the scale, and that logarithm by every rho.
        let scale = mean / rho;
        let points: Vec<_> = e
            .points
            .iter()
            .map(|y| Vector3::new(y.x, y.y, y.z / scale))
            .collect();
        let mut last = [views - 1, views - 2].map(|k| e.poses[k].clone());
        for pose in &mut last {
            pose.translation *= scale;
        }
        let n = cov.nrows();
        let mut unit = DVector::from_element(n, 1.0);
        let mut grows = DVector::zeros(n);
        let mut tells = DVector::zeros(n);
        for (at, pose) in [0, 6].into_iter().zip(&last) {
            let r = pose.rotation.transpose() * pose.translation;
            for j in 0..3 {
                unit[at + j] = scale;
                grows[at + j] = r[j];
            }
        }
        for (i, y) in points.iter().enumerate() {
            let at = POSES + 3 * i + 2;
            unit[at] = 1.0 / scale;
            grows[at] = -y.z;
            tells[at] = 1.0 / (count as f64 * rho);
        }
        let cov = DMatrix::from_fn(n, n, |i, j| cov[(i, j)] * unit[i] * unit[j]);
        // (1 + grows tells^T) cov (1 + grows tells^T)^T
        let told = &cov * &tells;
        let pull = &told + &grows * (0.5 * tells.dot(&told));
        let covariance = cov + &grows * pull.transpose() + &pull * grows.transpose();
        let known = |i: &usize| {
            let at = POSES + 3 * i + 2;
            let variance = covariance[(at, at)];
            variance.max(0.0).sqrt() <= max_rho_ratio * points[*i].z
        };
        if (0..count).filter(known).count() < least {
            return None;
        }
        Some(Structure {
            last,
            tracks: self.tracks.clone(),
            points,
            covariance,
        })
    }
}
