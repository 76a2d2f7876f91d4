//! A node of HOHCT's search: one set `X` of blocks that are out, worked out, and the terms of its bounds.

use crate::validate::batch::{Blocks, MAX_ROWS};
use crate::validate::distance::{block_distance, dot};

/// Shares of Young's inequality that are tried, see the module's page. The first is for bounds without bringing back.
pub(super) const THETAS: [f64; 4] = [1.0, 0.75, 0.5, 0.25];
/// One number for each of [`THETAS`].
pub(super) type PerTheta<T> = [T; THETAS.len()];

/// One set `X` of blocks that are out, worked out: a node of the search.
#[derive(Clone, Debug, Default)]
pub(super) struct Level {
    pub(super) blocks: Vec<usize>,
    /// Rows of `X`.
    pub(super) rows: Vec<usize>,
    /// First row within `X` of each block.
    pub(super) starts: Vec<usize>,
    /// Cholesky factor of `A_XX`, rows one after the other.
    pub(super) factor: Vec<f64>,
    /// `w` on the rows of `X`.
    pub(super) w: Vec<f64>,
    /// `q = z - A_:X w`, all rows.
    pub(super) q: Vec<f64>,
    /// `f(X)`.
    pub(super) reduction: f64,
    /// Rows beyond the smallest possible number.
    pub(super) extra: usize,
    /// How many blocks of `X` are not of `G`; they come last.
    pub(super) added: usize,
    /// `H = A_XX^-1`: entry `(r, c)`, `c <= r`, at `r * size + c`.
    pub(super) h: Vec<f64>,
    /// `w_i^T H_ii^-1 w_i` of the blocks of `X`.
    pub(super) own_loss: Vec<f64>,
    /// Norms of the blocks of `H`, scaled, of the blocks of `X`.
    pub(super) loss_coupling: Vec<f64>,
    /// Least loss of bringing back 0, 1, 2, ... blocks at positions from `losses_from` on, times `1 - theta`; the
    /// first as it is, for when nothing is added.
    pub(super) losses: PerTheta<Vec<f64>>,
    pub(super) losses_from: Option<usize>,
    /// Blocks that could be added when the level was made, and those of them that still may.
    pub(super) universe: Vec<usize>,
    pub(super) candidates: Vec<usize>,
    /// Columns of `L^-1 A_X:` of the candidates, by row of the batch.
    pub(super) v: Vec<f64>,
    /// What each candidate adds by itself, and how far its `M_ii` is above zero.
    pub(super) gains: PerTheta<Vec<f64>>,
    pub(super) floor: PerTheta<Vec<f64>>,
    pub(super) has_gains: bool,
    /// Scaled norms of the blocks of `M`, `n x n`, among candidates.
    pub(super) gain_coupling: PerTheta<Vec<f64>>,
    pub(super) has_couplings: bool,
}

impl Level {
    /// `w`, `q`, `f(X)`.
    pub(super) fn condition(&mut self, a: &[f64], z: &[f64], blocks: Blocks, least_rows: usize) {
        let m = z.len();
        self.rows.clear();
        self.starts.clear();
        self.extra = 0;
        for &block in &self.blocks {
            self.starts.push(self.rows.len());
            self.rows
                .extend(blocks.start(block)..blocks.start(block) + blocks.count(block));
            self.extra += blocks.count(block) - least_rows;
        }
        self.losses_from = None;
        self.has_gains = false;
        self.has_couplings = false;
        self.factor.clear();
        self.w.clear();
        self.reduction = 0.0;
        let size = self.rows.len();
        for r in 0..size {
            let base = self.factor.len();
            let column = &a[self.rows[r] * m..(self.rows[r] + 1) * m];
            let mut pivot = column[self.rows[r]];
            let mut value = z[self.rows[r]];
            for k in 0..r {
                let head = k * (k + 1) / 2;
                let sum = dot(&self.factor[base..base + k], &self.factor[head..head + k]);
                let entry = (column[self.rows[k]] - sum) / self.factor[head + k];
                self.factor.push(entry);
                pivot -= entry * entry;
                value -= entry * self.w[k];
            }
            let root = pivot.max(f64::MIN_POSITIVE).sqrt();
            self.factor.push(root);
            self.w.push(value / root);
            self.reduction += (value / root) * (value / root);
        }
        for r in (0..size).rev() {
            let head = r * (r + 1) / 2;
            self.w[r] /= self.factor[head + r];
            let value = self.w[r];
            for k in 0..r {
                self.w[k] -= self.factor[head + k] * value;
            }
        }
        self.q.clear();
        self.q.extend_from_slice(z);
        for (&row, &w) in self.rows.iter().zip(&self.w) {
            for (q, a) in self.q.iter_mut().zip(&a[row * m..(row + 1) * m]) {
                *q -= a * w;
            }
        }
    }

    /// `H`, and what bringing back each block of `X` loses. Since `H_ii >= I`, norms of `H_ij` bound the scaled ones.
    pub(super) fn work_out_own_losses(&mut self, blocks: Blocks) {
        let size = self.rows.len();
        self.h.clear();
        self.h.resize(size * size, 0.0);
        // L^-1 into the lower triangle, column by column; then H = L^-T L^-1.
        for c in 0..size {
            for r in c..size {
                let head = r * (r + 1) / 2;
                let sum = dot(
                    &self.factor[head + c..head + r],
                    &self.h[c * size + c..c * size + r],
                );
                let block = if r == c { 1.0 } else { 0.0 };
                self.h[c * size + r] = (block - sum) / self.factor[head + r];
            }
        }
        for c in 0..size {
            for r in 0..=c {
                let value = dot(
                    &self.h[r * size + c..(r + 1) * size],
                    &self.h[c * size + c..(c + 1) * size],
                );
                // Row r of the result is final from column r on; the upper part of column c is free.
                self.h[c * size + r] = value;
            }
        }
        let count = self.blocks.len();
        self.own_loss.clear();
        self.loss_coupling.clear();
        self.loss_coupling.resize(count * count, 0.0);
        for i in 0..count {
            let (si, ni) = (self.starts[i], blocks.count(self.blocks[i]));
            let mut matrix = [[0.0; MAX_ROWS]; MAX_ROWS];
            for (r, row) in matrix.iter_mut().enumerate().take(ni) {
                for (c, value) in row.iter_mut().enumerate().take(r + 1) {
                    *value = self.h[(si + r) * size + si + c];
                }
            }
            self.own_loss
                .push(block_distance(&matrix, &self.w[si..si + ni]));
            for j in 0..i {
                let (sj, nj) = (self.starts[j], blocks.count(self.blocks[j]));
                let square: f64 = (si..si + ni)
                    .flat_map(|r| &self.h[r * size + sj..r * size + sj + nj])
                    .map(|v| v * v)
                    .sum();
                self.loss_coupling[i * count + j] = square.sqrt();
                self.loss_coupling[j * count + i] = square.sqrt();
            }
        }
    }

    /// Least losses of bringing back blocks with these indices in `X`, which are those of `G` from `position` on, with
    /// `penalty` taken off for each.
    pub(super) fn work_out_losses(
        &mut self,
        blocks: Blocks,
        position: usize,
        range: std::ops::Range<usize>,
        penalty: impl Fn(usize) -> f64,
        sums: &mut Sums,
    ) {
        if self.losses_from == Some(position) {
            return;
        }
        if self.losses_from.is_none() && !range.is_empty() {
            self.work_out_own_losses(blocks);
        }
        self.losses_from = Some(position);
        let (count, available) = (self.blocks.len(), range.len());
        // Row by row: couplings within the range, decreasing.
        sums.picked.clear();
        for i in range.clone() {
            let start = sums.picked.len();
            let row = &self.loss_coupling[i * count..(i + 1) * count];
            sums.picked.extend_from_slice(&row[range.clone()]);
            sums.picked[start..].sort_unstable_by(|a, b| b.total_cmp(a));
        }
        for (losses, theta) in self.losses.iter_mut().zip(THETAS) {
            let share = if theta == 1.0 { 1.0 } else { 1.0 - theta };
            losses.clear();
            losses.push(0.0);
            sums.totals.clear();
            sums.totals.resize(available, 1.0);
            for number in 1..=available {
                sums.terms.clear();
                for (i, index) in range.clone().enumerate() {
                    if number > 1 {
                        sums.totals[i] += sums.picked[i * available + number - 2];
                    }
                    let loss = share * self.own_loss[index] / sums.totals[i];
                    sums.terms.push(penalty(self.blocks[index]) - loss);
                }
                losses.push(-sum_of_largest(&mut sums.terms, number));
            }
        }
    }

    /// What adding each candidate brings by itself: `q_i^T M_ii^-1 q_i`.
    pub(super) fn work_out_gains(&mut self, a: &[f64], blocks: Blocks) {
        if self.has_gains {
            return;
        }
        self.has_gains = true;
        let (m, n, size) = (self.q.len(), blocks.len(), self.rows.len());
        self.v.resize(m * size, 0.0);
        for table in self.gains.iter_mut().chain(&mut self.floor) {
            table.resize(n, 0.0);
        }
        for index in 0..self.universe.len() {
            let block = self.universe[index];
            let (start, count) = (blocks.start(block), blocks.count(block));
            for row in start..start + count {
                let column = &a[row * m..(row + 1) * m];
                let v = &mut self.v[row * size..(row + 1) * size];
                for r in 0..size {
                    let head = r * (r + 1) / 2;
                    let sum = dot(&self.factor[head..head + r], &v[..r]);
                    v[r] = (column[self.rows[r]] - sum) / self.factor[head + r];
                }
            }
            let mut p = [[0.0; MAX_ROWS]; MAX_ROWS];
            let mut square = 0.0;
            for (r, row) in p.iter_mut().enumerate().take(count) {
                for (c, value) in row.iter_mut().enumerate().take(r + 1) {
                    *value = dot(self.v_row(start + r), self.v_row(start + c));
                    square += if r == c { 1.0 } else { 2.0 } * *value * *value;
                }
            }
            for (k, theta) in THETAS.into_iter().enumerate() {
                let mut matrix = p;
                for (r, row) in matrix.iter_mut().enumerate() {
                    for value in row.iter_mut() {
                        *value /= -theta;
                    }
                    row[r] += 1.0;
                }
                self.gains[k][block] = block_distance(&matrix, &self.q[start..start + count]);
                self.floor[k][block] = 1.0 - square.sqrt() / theta;
            }
        }
    }

    pub(super) fn v_row(&self, row: usize) -> &[f64] {
        let size = self.rows.len();
        &self.v[row * size..(row + 1) * size]
    }

    /// Scaled norms of the blocks of `M` among the candidates; infinite where `M_ii` may be indefinite.
    pub(super) fn work_out_couplings(&mut self, a: &[f64], blocks: Blocks) {
        if self.has_couplings {
            return;
        }
        self.has_couplings = true;
        let (m, n) = (self.q.len(), blocks.len());
        let mut couplings = std::mem::take(&mut self.gain_coupling);
        for table in &mut couplings {
            table.resize(n * n, 0.0);
        }
        for (index, &i) in self.universe.iter().enumerate() {
            let (si, ni) = (blocks.start(i), blocks.count(i));
            for &j in &self.universe[..index] {
                let (sj, nj) = (blocks.start(j), blocks.count(j));
                // |A_ij|^2, <A_ij, P_ij>, |P_ij|^2 make the norm for every share.
                let (mut own2, mut mixed, mut shared2) = (0.0, 0.0, 0.0);
                for r in si..si + ni {
                    for c in sj..sj + nj {
                        let shared = dot(self.v_row(r), self.v_row(c));
                        let own = a[c * m + r];
                        own2 += own * own;
                        mixed += own * shared;
                        shared2 += shared * shared;
                    }
                }
                for (table, theta) in couplings.iter_mut().zip(THETAS) {
                    let square = own2 - (2.0 * mixed - shared2 / theta) / theta;
                    table[i * n + j] = square.max(0.0);
                }
            }
        }
        for (table, floor) in couplings.iter_mut().zip(&self.floor) {
            for (index, &i) in self.universe.iter().enumerate() {
                table[i * n + i] = 0.0;
                for &j in &self.universe[..index] {
                    let scale = floor[i].max(0.0) * floor[j].max(0.0);
                    let value = if scale > 0.0 {
                        (table[i * n + j] / scale).sqrt()
                    } else {
                        f64::INFINITY
                    };
                    table[i * n + j] = value;
                    table[j * n + i] = value;
                }
            }
        }
        self.gain_coupling = couplings;
    }
}

/// Scratch lists of the bounds.
#[derive(Clone, Debug, Default)]
pub(super) struct Sums {
    pub(super) picked: Vec<f64>,
    pub(super) totals: Vec<f64>,
    pub(super) terms: Vec<f64>,
}

/// Sum of the `count` largest values, or of all if there are fewer. Reorders the values.
pub(super) fn sum_of_largest(values: &mut [f64], count: usize) -> f64 {
    if count == 0 {
        0.0
    } else if count == 1 {
        values.iter().copied().reduce(f64::max).unwrap_or(0.0)
    } else if count < values.len() {
        values.select_nth_unstable_by(count - 1, |a, b| b.total_cmp(a));
        values[..count].iter().sum()
    } else {
        values.iter().sum()
    }
}
