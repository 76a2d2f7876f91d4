//! What no set below a node of the search can exceed: the bounds of the page of [`hohct`](crate::validate::hohct).

use super::{Outlook, Search};
use crate::validate::subsets::level::{Level, PerTheta, THETAS, sum_of_largest};

impl Search<'_> {
    /// Bounds the sets below a node, see [`Search::explore`], and chooses how to go on.
    pub(super) fn outlook(&mut self, depth: usize, position: usize, left: usize) -> Outlook {
        self.work_out_losses(depth, position);
        if left == 0 {
            return if self.can_win(depth, position, left, 1, [0.0; THETAS.len()], 0.0) {
                Outlook::BringBack
            } else {
                Outlook::Refuted
            };
        }
        self.levels[depth].work_out_gains(self.a, self.blocks);
        // Without any couplings. That is not a bound, but it says which branch to follow first.
        let level = &self.levels[depth];
        let mut best = (f64::NEG_INFINITY, level.candidates[0]);
        self.sums.terms.clear();
        for &block in &level.candidates {
            let gain = level.gains[0][block] - self.penalty(block);
            self.sums.terms.push(gain);
            if gain > best.0 {
                best = (gain, block);
            }
        }
        let hope = sum_of_largest(&mut self.sums.terms, left);
        let must = level_order(&self.levels[depth], left) > self.best.order;
        if self.can_win(depth, position, left, 0, [hope; THETAS.len()], 0.0) {
            return if must {
                Outlook::BringBack
            } else {
                Outlook::Decide(best.1)
            };
        }
        if left > 1 {
            self.levels[depth].work_out_couplings(self.a, self.blocks);
        }
        // Each share gives a bound of its own, and usually the first one is enough.
        let mut gains = [f64::INFINITY; THETAS.len()];
        let mut worst = 0;
        for k in if must { 1 } else { 0 }..THETAS.len() {
            (gains[k], worst) = self.bounded_gain(depth, left, k);
            if !self.can_win(depth, position, left, 0, gains, 0.0) {
                return Outlook::Refuted;
            }
        }
        if must {
            gains[0] = self.bounded_gain(depth, left, 0).0;
        }
        // Is it Young's inequality that is too loose, or the couplings?
        let exact = [gains[0]; THETAS.len()];
        if must && !self.can_win(depth, position, left, 0, exact, 0.0) {
            Outlook::BringBack
        } else {
            Outlook::Decide(worst)
        }
    }

    /// Bound on what `left` candidates add, for the share `k` (the first if nothing is brought back), and the candidate whose
    /// couplings make it loosest.
    pub(super) fn bounded_gain(&mut self, depth: usize, left: usize, k: usize) -> (f64, usize) {
        let n = self.blocks.len();
        let level = &self.levels[depth];
        let mut worst = (f64::NEG_INFINITY, f64::NEG_INFINITY, usize::MAX);
        self.sums.terms.clear();
        for &block in &level.candidates {
            let mut coupling = 0.0;
            if left > 1 {
                let row = &level.gain_coupling[k][block * n..(block + 1) * n];
                // A block is not coupled to itself: its own entry is zero.
                self.sums.picked.clear();
                self.sums
                    .picked
                    .extend(level.candidates.iter().map(|&other| row[other]));
                coupling = sum_of_largest(&mut self.sums.picked, left - 1);
            }
            let bounded = if coupling < 1.0 {
                level.gains[k][block] / (1.0 - coupling)
            } else {
                f64::INFINITY
            };
            let excess = bounded - level.gains[0][block];
            if excess > worst.0 || (excess == worst.0 && coupling > worst.1) {
                worst = (excess, coupling, block);
            }
            self.sums.terms.push(bounded - self.penalty(block));
        }
        (sum_of_largest(&mut self.sums.terms, left), worst.2)
    }

    /// Whether a set below a node could still be the best, if it brings back at least `fewest` blocks. `gains` bounds what
    /// it adds: the first entry if nothing is brought back, the others if something is. `own` is the loss of a block that
    /// is certainly brought back.
    pub(super) fn can_win(
        &self,
        depth: usize,
        position: usize,
        left: usize,
        fewest: usize,
        gains: PerTheta<f64>,
        own: f64,
    ) -> bool {
        let level = &self.levels[depth];
        let base = level.reduction - self.best.thresholds.tau * level.extra as f64;
        let largest = level_order(level, left);
        let available = self.greedy.blocks.len() - position;
        let rows = self.best.thresholds.tau * self.best.thresholds.spread as f64;
        (fewest.max(largest.saturating_sub(self.best.order))
            ..=available.min(largest.saturating_sub(1)))
            .any(|number| {
                let loss = |k: usize, share: f64| {
                    level.losses[k][number].max(share * own - rows * number as f64)
                };
                let bound = if number == 0 {
                    base + gains[0]
                } else if left == 0 {
                    base - loss(0, 1.0)
                } else {
                    let best = (1..THETAS.len()).map(|k| gains[k] - loss(k, 1.0 - THETAS[k]));
                    base + best.fold(f64::INFINITY, f64::min)
                };
                // A margin for rounding.
                bound + 1e-10 * bound.abs() >= self.best.thresholds.target[largest - number]
            })
    }

    fn work_out_losses(&mut self, depth: usize, position: usize) {
        let first = self.first_index(depth, position);
        let available = self.greedy.blocks.len() - position;
        let (tau, blocks, least) = (self.best.thresholds.tau, self.blocks, self.least_rows);
        let penalty = |block| tau * (blocks.count(block) - least) as f64;
        let range = first..first + available;
        self.levels[depth].work_out_losses(blocks, position, range, penalty, self.sums);
    }
}

/// Order of the sets below a level if nothing is brought back.
fn level_order(level: &Level, left: usize) -> usize {
    level.blocks.len() + left
}
