//! Keeping P sound under rounding (METHOD 3): variances that lost their digits are raised, and a monitor says how sound P is.

use super::{Covariance, OF_SUMS};
use nalgebra::{DMatrix, SMatrix};

/// A downdate that leaves less than this share of a variance loses digits of it.
const LEAST_SHARE: f64 = 1e-2;
/// Largest loss, as a share of the variance before; the variance is raised by it.
const LOST_DIGITS: f64 = 1e-11;

impl Covariance {
    /// Raises the variances that a downdate has all but taken away by the rounding error it left in their rows, so that P
    /// stays sound (METHOD 3) however much one measurement tells. `removed` is the diagonal of `V V^T`.
    pub(crate) fn round_up(&mut self, removed: &[f64]) {
        for (i, &removed) in removed.iter().enumerate() {
            self.raise(i, self.stored_entry(i, i) + removed);
        }
    }

    /// As [`Self::transform`], by a map that takes a direction out of the state: each variance is raised by the rounding
    /// error that the largest of them leaves in it.
    pub(crate) fn project<const K: usize>(&mut self, start: usize, f: &SMatrix<f64, K, K>) {
        let variance = |p: &Self, i: usize| p.get(start + i, start + i);
        let largest = (0..K).map(|i| variance(self, i)).fold(0.0, f64::max);
        self.transform(start, f);
        for i in 0..K {
            let left = variance(self, i).max(0.0);
            self.set(start + i, start + i, left + OF_SUMS * largest);
        }
    }

    fn raise(&mut self, slot: usize, before: f64) {
        let left = self.stored_entry(slot, slot);
        // Auxiliary rows of the local update, less than zero by nature, had nothing before.
        if left.abs() < LEAST_SHARE * before {
            self.set_stored(slot, slot, left.max(0.0) + LOST_DIGITS * before);
        }
    }

    /// Least eigenvalue of the diagonal-scaled matrix `D^-1/2 P D^-1/2` (rows of zero variance left out):
    /// P is sound when it is above -1e-10 (METHOD 3). Costs O(n^3): a monitor, not part of a step.
    pub fn least_scaled_eigenvalue(&self) -> f64 {
        let n = self.dim();
        let kept: Vec<usize> = (0..n).filter(|&i| self.get(i, i) > 0.0).collect();
        if (0..n).any(|i| {
            let d = self.get(i, i);
            d < 0.0 || !d.is_finite()
        }) {
            return f64::NEG_INFINITY;
        }
        if kept.is_empty() {
            return 0.0;
        }
        let scaled = DMatrix::from_fn(kept.len(), kept.len(), |i, j| {
            let (i, j) = (kept[i], kept[j]);
            self.get(i, j) / (self.get(i, i) * self.get(j, j)).sqrt()
        });
        if scaled.iter().any(|v| !v.is_finite()) {
            return f64::NEG_INFINITY;
        }
        scaled.symmetric_eigenvalues().min()
    }
}

#[cfg(test)]
mod tests {
    use super::super::Covariance;
    use super::LOST_DIGITS;

    #[test]
    fn only_what_has_lost_its_digits_is_raised() {
        let mut p = Covariance::zeros(4, 4);
        for (i, left) in [1e-9, -1e-16, 5.0, -3.0].into_iter().enumerate() {
            p.set(i, i, left);
        }
        // The last row is an auxiliary one: it was -2.
        p.round_up(&[4.0, 2.0, 1.0, 1.0]);
        let raised = [1e-9 + LOST_DIGITS * (4.0 + 1e-9), LOST_DIGITS * 2.0];
        assert!((p.get(0, 0) - raised[0]).abs() < 1e-24);
        assert!((p.get(1, 1) - raised[1]).abs() < 1e-24);
        assert!(p.get(1, 1) > 0.0);
        assert!(p.get(2, 2) == 5.0 && p.get(3, 3) == -3.0);
    }
}
