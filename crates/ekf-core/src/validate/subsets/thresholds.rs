//! What a set must take off `D^2` to pass, by its size and its rows: the thresholds of [`hohct`](crate::validate::hohct).

/// `T_k,e` and what follows from them.
#[derive(Clone, Debug, Default)]
pub(super) struct Thresholds {
    /// Rows beyond the smallest number that a block can have.
    pub(super) spread: usize,
    /// `T_k,e` for `k = 0, 1, ...`, `k * spread + 1` values each.
    pub(super) values: Vec<f64>,
    /// `target_k`.
    pub(super) target: Vec<f64>,
    pub(super) tau: f64,
}

impl Thresholds {
    pub(super) fn start(&self, order: usize) -> usize {
        // Sum of j * spread + 1 over j < order.
        order + self.spread * order * order.saturating_sub(1) / 2
    }

    pub(super) fn at(&self, order: usize, extra: usize) -> f64 {
        self.values[self.start(order) + extra]
    }

    /// Least of `T_k,e` for a `k`.
    pub(super) fn least(&self, order: usize) -> f64 {
        let start = self.start(order);
        let end = start + order * self.spread;
        self.values[start..=end]
            .iter()
            .copied()
            .fold(f64::INFINITY, f64::min)
    }

    /// `target_k` from `T_k,e`.
    pub(super) fn update_target(&mut self, order: usize) {
        let start = self.start(order);
        self.target[order] = (0..=order * self.spread)
            .map(|extra| self.values[start + extra] - self.tau * extra as f64)
            .fold(f64::INFINITY, f64::min);
    }
}
