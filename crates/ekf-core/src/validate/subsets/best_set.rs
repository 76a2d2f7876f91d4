//! The best set that HOHCT has found so far, and what another one must reach to beat it.

use super::thresholds::Thresholds;
use crate::chi2;
use crate::validate::quantiles::Quantiles;

/// The best set so far; before the first one, what a set must reach to pass the level.
pub(in crate::validate) struct BestSet<'a> {
    pub(super) blocks: &'a mut Vec<usize>,
    pub(super) thresholds: &'a mut Thresholds,
    /// Rows of the batch.
    pub(super) rows: usize,
    /// `D^2` of the batch.
    pub(super) d2: f64,
    pub(super) least_rows: usize,
    /// Largest order of interest: that of the best set.
    pub(super) order: usize,
    /// `f` of the best set.
    pub(in crate::validate) found: Option<f64>,
}

impl BestSet<'_> {
    /// Starts with the thresholds that the level sets, for all orders up to `order`.
    pub(super) fn start(&mut self, order: usize, level: f64, quantiles: &mut Quantiles) {
        self.order = order;
        let table = &mut *self.thresholds;
        table.values.clear();
        table.target.clear();
        table.target.resize(order + 1, f64::INFINITY);
        table.tau = f64::INFINITY;
        for order in 0..=order {
            let start = table.values.len();
            for extra in 0..=order * table.spread {
                let gone = order * self.least_rows + extra;
                let value = match self.rows.checked_sub(gone) {
                    Some(dof) => self.d2 - quantiles.get(level, dof),
                    None => f64::INFINITY,
                };
                table.values.push(value);
                if extra > 0 {
                    let slope = (value - table.values[start]) / extra as f64;
                    table.tau = table.tau.min(slope);
                }
            }
        }
        if table.tau == f64::INFINITY {
            table.tau = 0.0;
        }
        for order in 0..=order {
            table.update_target(order);
        }
    }

    /// Whether a set beats the best so far: a smaller one must pass the level, one of the same order must be better.
    pub(super) fn is_beaten_by(&self, order: usize, reduction: f64, extra: usize) -> bool {
        if order == 0 || order > self.order {
            return false;
        }
        let threshold = self.thresholds.at(order, extra);
        if order == self.order && self.found.is_some() {
            reduction > threshold
        } else {
            reduction >= threshold
        }
    }

    /// Notes that the set now in `blocks` is the best; from now on sets of its order must have a larger tail probability.
    pub(super) fn accept(&mut self, order: usize, reduction: f64, extra: usize) {
        self.found = Some(reduction);
        self.order = order;
        let table = &mut *self.thresholds;
        let start = table.start(order);
        if table.spread > 0 {
            let dof = |extra: usize| self.rows.checked_sub(order * self.least_rows + extra);
            let rest = (self.d2 - reduction).max(0.0);
            let ln_tail = chi2::ln_survival(rest, dof(extra).unwrap_or(0) as f64);
            for other in 0..=order * table.spread {
                table.values[start + other] = match dof(other) {
                    Some(dof) => self.d2 - chi2::inverse_ln_survival(ln_tail, dof as f64),
                    None => f64::INFINITY,
                };
            }
        }
        table.values[start + extra] = reduction;
        table.update_target(order);
    }
}
