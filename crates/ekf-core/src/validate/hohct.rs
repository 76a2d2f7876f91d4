//! HOHCT, the highest-order hypothesis compatibility test (METHOD section 8; Guerra, Munguia, Bolea, Grau 2013).
//!
//! Order 0 is the most optimistic hypothesis: all matches are right. If `D^2 = g^T S^-1 g` exceeds the chi-square quantile,
//! hypotheses with one unit left out are looked at, then two, and so on; at the first order at which one passes, the
//! one with the largest tail probability is taken.
//!
//! # What leaving out costs
//! With `A = S^-1` and `z = A g`, leaving out the units `E` takes
//! `f(E) = z_E^T (A_EE)^-1 z_E = max { 2 z^T x - x^T A x : x zero outside E }` off `D^2`. A change of basis within each
//! unit makes its own block of `A` the identity and leaves `f` as it is; below, `A` and `z` are in that basis.
//!
//! # Exact search
//! A greedy set `G` (the best single unit given those already out, until the rest passes) is the first answer. Any
//! set is `E = (G \ Y) u F` with `F` outside of `G`; it can only be better if `|Y| >= |F|`. For `|F| = 0, 1, 2, ...` a
//! depth-first search brings units of `G` back and adds others, in [`Search::explore`]. A node is a set `X` worked out
//! exactly: `w = A_XX^-1 z_X`, `f(X) = z_X^T w`, `q = z - A_:X w` (zero on `X`), `H = A_XX^-1`.
//!
//! *Bound.* Let `Y` in `X` be what is still brought back and `F` what is still added. Write `x = (w - d, x_F)`, so that
//! `d_Y = w_Y` and the rest of `d` is free:
//!
//! ```text
//! 2 z^T x - x^T A x = f(X) - d^T A_XX d + 2 d^T A_XF x_F + 2 q_F^T x_F - x_F^T A_FF x_F
//! 2 d^T A_XF x_F   <= theta d^T A_XX d + x_F^T P_FF x_F / theta,     P = A_:X H A_X:,  0 < theta <= 1
//! ```
//!
//! (Young's inequality; exact with `theta = 1` if `Y` is empty.) The least `d^T A_XX d` is `w_Y^T (H_YY)^-1 w_Y`, hence
//!
//! ```text
//! f(E) <= f(X) - (1 - theta) w_Y^T (H_YY)^-1 w_Y + q_F^T (M_FF)^-1 q_F,     M = A - P / theta
//! ```
//!
//! *Sums over units.* By Gershgorin's theorem for blocks, a symmetric matrix with diagonal blocks `D_i` is at least
//! `blkdiag(b_i D_i)`, and at most `blkdiag(B_i D_i)`, with `b_i = 1 - sum_j c_ij`, `B_i = 1 + sum_j c_ij`, where `c_ij` bounds the
//! norm of block `(i, j)` once the diagonal blocks are scaled to the identity. With the sums taken over the largest
//! `|Y| - 1` (`|F| - 1`) couplings to units that may still come,
//!
//! ```text
//! w_Y^T (H_YY)^-1 w_Y >= sum_Y  w_i^T H_ii^-1 w_i / B_i,         q_F^T (M_FF)^-1 q_F <= sum_F  q_i^T M_ii^-1 q_i / b_i
//! ```
//!
//! so that the worst `Y` and `F` are the smallest and the largest terms. A unit with `b_i <= 0` has no bound: it is either added
//! or ruled out at once, and the couplings of the others no longer include it.
//!
//! *Units of different size.* A set of `k` units with `e` rows more than the smallest possible must reach
//! `f(E) >= D^2 - quantile(dof)`, a threshold `T_k,e`. With any `tau`, `f(E) - tau e(E) >= target_k = min_e (T_k,e - tau e)` is
//! necessary, and `tau e(E)` is a sum over units again. Once a set of `k` units is found, its tail probability gives
//! new thresholds for `k`, and larger sets are out of the question.
//!
//! *Budget.* Past `max_nodes` nodes the best set so far stands, at first the greedy one, and the verdict says that it
//! is not exact.

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_inverse::invert_lower_triangular;
use faer::{Accum, MatMut, MatRef, Par};

use super::{
    Joint, MAX_ROWS, Quantiles, Units, Verdict, Workspace, block_distance, check, dot, whiten,
};
use crate::chi2;

/// Settings of [`hohct`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HohctSettings {
    /// Confidence level of the joint test, in (0, 1).
    pub level: f64,
    /// Largest number of hypotheses that are worked out; past it the answer is the greedy one.
    pub max_nodes: usize,
    /// Largest share of the units that may be left out, in [0, 1]. One unit always stays.
    pub max_share: f64,
}

impl Default for HohctSettings {
    fn default() -> Self {
        Self {
            level: 0.95,
            max_nodes: 2_000,
            max_share: 0.5,
        }
    }
}

/// Buffers of [`hohct`].
#[derive(Clone, Debug, Default)]
pub(super) struct Scratch {
    inverse: Vec<f64>,
    /// Whitened `A`, both triangles, `m x m`.
    a: Vec<f64>,
    /// Whitened `z`.
    z: Vec<f64>,
    greedy: Greedy,
    levels: Vec<Level>,
    pigeonhole: Pigeonhole,
    sums: Sums,
    thresholds: Thresholds,
    best: Vec<usize>,
}

/// Leaves out the fewest units so that the rest is jointly compatible at `settings.level`.
///
/// `s` is `S`, `l` its Cholesky factor (both lower triangle, column-major, leading dimension `ld`), `g` the innovation. If all units
/// pass together this costs one triangular solve; `S^-1` is only formed if they do not.
pub fn hohct(
    s: &[f64],
    l: &[f64],
    ld: usize,
    g: &[f64],
    units: Units,
    settings: &HohctSettings,
    ws: &mut Workspace,
) -> Verdict {
    check(s, ld, g, units);
    check(l, ld, g, units);
    let (m, n) = (g.len(), units.len());
    ws.rejected.clear();
    let d2 = whiten(l, ld, g, &mut ws.whitened);
    if d2 <= ws.quantiles.get(settings.level, m) {
        return Verdict::joint(0, d2, m, true);
    }
    if !d2.is_finite() {
        ws.reject_all(units);
        return Verdict::joint(n, d2, m, false);
    }
    let max_order = ((settings.max_share * n as f64) as usize).min(n - 1);
    let scratch = &mut ws.hohct;
    scratch.prepare(l, ld, &ws.whitened, units);
    let greedy_passes =
        scratch.leave_out_greedily(units, d2, max_order, settings.level, &mut ws.quantiles);
    let mut search = Search::new(
        scratch,
        Rows { s, ld, g, units },
        d2,
        settings,
        &mut ws.quantiles,
    );
    search.run(max_order, greedy_passes);
    let (nodes, exact, found) = (search.nodes, !search.struck, search.found);
    let scratch = &mut ws.hohct;
    let mut verdict = match found {
        Some(reduction) => {
            ws.rejected.extend_from_slice(&scratch.best);
            ws.rejected.sort_unstable();
            let gone: usize = scratch.best.iter().map(|&unit| units.count(unit)).sum();
            Verdict::joint(
                scratch.best.len(),
                (d2 - reduction).max(0.0),
                m - gone,
                true,
            )
        }
        None => {
            ws.reject_all(units);
            Verdict::joint(n, d2, m, false)
        }
    };
    verdict.exact = exact;
    verdict.nodes = nodes;
    verdict
}

impl Scratch {
    /// Whitened `A` and `z`.
    ///
    /// With `A = L^-T L^-1`, scaling the columns of `L^-1` by `K_i^-1`, `A_ii = K_i^T K_i` with `K_i` lower
    /// triangular, keeps them lower triangular: the whitened `A` is `B^T B`, the whitened `z` is `B^T (L^-1 g)`.
    fn prepare(&mut self, l: &[f64], ld: usize, y: &[f64], units: Units) {
        let (m, n) = (y.len(), units.len());
        self.inverse.resize(m * m, 0.0);
        self.a.resize(m * m, 0.0);
        invert_lower_triangular(
            MatMut::from_column_major_slice_mut(&mut self.inverse[..m * m], m, m),
            MatRef::from_column_major_slice_with_stride(l, m, m, ld),
            Par::Seq,
        );
        self.z.clear();
        for unit in 0..n {
            whiten_columns(&mut self.inverse, m, units.start(unit), units.count(unit));
            for row in units.start(unit)..units.start(unit) + units.count(unit) {
                let column = &self.inverse[row * m + row..(row + 1) * m];
                self.z.push(dot(column, &y[row..]));
            }
        }
        let b = MatRef::from_column_major_slice(&self.inverse[..m * m], m, m);
        matmul(
            MatMut::from_column_major_slice_mut(&mut self.a[..m * m], m, m),
            BlockStructure::TriangularLower,
            Accum::Replace,
            b.transpose(),
            BlockStructure::TriangularUpper,
            b,
            BlockStructure::TriangularLower,
            1.0,
            Par::Seq,
        );
        for column in 0..m {
            for row in column + 1..m {
                self.a[row * m + column] = self.a[column * m + row];
            }
        }
    }

    /// Grows `G` until the rest passes (then true) or `max_order` units are out.
    fn leave_out_greedily(
        &mut self,
        units: Units,
        d2: f64,
        max_order: usize,
        level: f64,
        quantiles: &mut Quantiles,
    ) -> bool {
        let Self { a, z, greedy, .. } = self;
        greedy.start(z, units);
        let mut dof = z.len();
        while greedy.units.len() < max_order {
            let unit = greedy.choose(units, d2 - greedy.reduction, dof);
            greedy.remove(a, units, unit);
            dof -= units.count(unit);
            if d2 - greedy.reduction <= quantiles.get(level, dof) {
                return true;
            }
        }
        false
    }
}

/// Replaces columns `start .. start + rows` of the lower triangular `b` by `b K^-1`, where `K^T K` is their Gram matrix.
fn whiten_columns(b: &mut [f64], m: usize, start: usize, rows: usize) {
    for j in (start..start + rows).rev() {
        let (left, right) = b.split_at_mut((j + 1) * m);
        let column = &mut left[j * m..];
        for later in j + 1..start + rows {
            let done = &right[(later - j - 1) * m..][later..m];
            let shared = dot(&column[later..], done);
            for (value, d) in column[later..].iter_mut().zip(done) {
                *value -= shared * d;
            }
        }
        let scale = 1.0 / dot(&column[j..], &column[j..]).sqrt();
        for value in &mut column[j..] {
            *value *= scale;
        }
    }
}

/// The greedy set, by pivoted Cholesky of the whitened `A`: `O(m)` per row taken and row taken before.
#[derive(Clone, Debug, Default)]
struct Greedy {
    units: Vec<usize>,
    reduction: f64,
    taken: Vec<bool>,
    /// `z` given that the units so far are out.
    z: Vec<f64>,
    /// Diagonal blocks of `A` likewise, `3 x 3` each.
    blocks: Vec<[[f64; MAX_ROWS]; MAX_ROWS]>,
    /// Columns of the factor, `m` each.
    columns: Vec<f64>,
}

impl Greedy {
    fn start(&mut self, z: &[f64], units: Units) {
        let mut identity = [[0.0; MAX_ROWS]; MAX_ROWS];
        for (k, row) in identity.iter_mut().enumerate() {
            row[k] = 1.0;
        }
        self.units.clear();
        self.reduction = 0.0;
        self.taken.clear();
        self.taken.resize(units.len(), false);
        self.z.clear();
        self.z.extend_from_slice(z);
        self.blocks.clear();
        self.blocks.resize(units.len(), identity);
        self.columns.clear();
    }

    /// The unit whose removal leaves the largest tail probability.
    fn choose(&self, units: Units, d2: f64, dof: usize) -> usize {
        let mut best = [(f64::NEG_INFINITY, usize::MAX); MAX_ROWS];
        for unit in 0..units.len() {
            if !self.taken[unit] {
                let rows = units.count(unit);
                let z = &self.z[units.start(unit)..][..rows];
                let gain = block_distance(&self.blocks[unit], z);
                if gain > best[rows - 1].0 {
                    best[rows - 1] = (gain, unit);
                }
            }
        }
        let mut kinds = best.iter().filter(|kind| kind.1 != usize::MAX);
        if let (Some(only), None) = (kinds.next(), kinds.next()) {
            return only.1;
        }
        let mut choice = (f64::NEG_INFINITY, usize::MAX);
        for (rows, &(gain, unit)) in (1..=MAX_ROWS).zip(&best) {
            if unit != usize::MAX {
                let left = chi2::ln_survival((d2 - gain).max(0.0), (dof - rows) as f64);
                if choice.1 == usize::MAX || left > choice.0 {
                    choice = (left, unit);
                }
            }
        }
        choice.1
    }

    fn remove(&mut self, a: &[f64], units: Units, unit: usize) {
        let m = self.z.len();
        self.taken[unit] = true;
        self.units.push(unit);
        for row in units.start(unit)..units.start(unit) + units.count(unit) {
            let base = self.columns.len();
            self.columns.extend_from_slice(&a[row * m..(row + 1) * m]);
            let (before, column) = self.columns.split_at_mut(base);
            for earlier in before.chunks_exact(m) {
                let factor = earlier[row];
                for (value, e) in column.iter_mut().zip(earlier) {
                    *value -= factor * e;
                }
            }
            let scale = 1.0 / column[row].max(f64::MIN_POSITIVE).sqrt();
            for value in column.iter_mut() {
                *value *= scale;
            }
            let weight = self.z[row] * scale;
            self.reduction += weight * weight;
            for (z, v) in self.z.iter_mut().zip(column.iter()) {
                *z -= weight * v;
            }
            for (other, block) in self.blocks.iter_mut().enumerate() {
                let part = &column[units.start(other)..units.start(other) + units.count(other)];
                for (r, p) in part.iter().enumerate() {
                    for (c, q) in part.iter().enumerate() {
                        block[r][c] -= p * q;
                    }
                }
            }
        }
    }
}

/// Shares of Young's inequality that are tried, see the module's page. The first is for bounds without bringing back.
const THETAS: [f64; 4] = [1.0, 0.75, 0.5, 0.25];
/// One number for each of [`THETAS`].
type PerTheta<T> = [T; THETAS.len()];

/// One set `X` of units that are out, worked out: a node of the search.
#[derive(Clone, Debug, Default)]
struct Level {
    units: Vec<usize>,
    /// Rows of `X`.
    rows: Vec<usize>,
    /// First row within `X` of each unit.
    starts: Vec<usize>,
    /// Cholesky factor of `A_XX`, rows one after the other.
    factor: Vec<f64>,
    /// `w` on the rows of `X`.
    w: Vec<f64>,
    /// `q = z - A_:X w`, all rows.
    q: Vec<f64>,
    /// `f(X)`.
    reduction: f64,
    /// Rows beyond the smallest possible number.
    extra: usize,
    /// How many units of `X` are not of `G`; they come last.
    added: usize,
    /// `H = A_XX^-1`: entry `(r, c)`, `c <= r`, at `r * size + c`.
    h: Vec<f64>,
    /// `w_i^T H_ii^-1 w_i` of the units of `X`.
    own_loss: Vec<f64>,
    /// Norms of the blocks of `H`, scaled, of the units of `X`.
    loss_coupling: Vec<f64>,
    /// Least loss of bringing back 0, 1, 2, ... units at positions from `losses_from` on, times `1 - theta`; the
    /// first as it is, for when nothing is added.
    losses: PerTheta<Vec<f64>>,
    losses_from: Option<usize>,
    /// Units that could be added when the level was made, and those of them that still may.
    universe: Vec<usize>,
    candidates: Vec<usize>,
    /// Columns of `L^-1 A_X:` of the candidates, by row of the batch.
    v: Vec<f64>,
    /// What each candidate adds by itself, and how far its `M_ii` is above zero.
    gains: PerTheta<Vec<f64>>,
    floor: PerTheta<Vec<f64>>,
    has_gains: bool,
    /// Scaled norms of the blocks of `M`, `n x n`, among candidates.
    gain_coupling: PerTheta<Vec<f64>>,
    has_couplings: bool,
}

impl Level {
    /// `w`, `q`, `f(X)`.
    fn condition(&mut self, a: &[f64], z: &[f64], units: Units, least_rows: usize) {
        let m = z.len();
        self.rows.clear();
        self.starts.clear();
        self.extra = 0;
        for &unit in &self.units {
            self.starts.push(self.rows.len());
            self.rows
                .extend(units.start(unit)..units.start(unit) + units.count(unit));
            self.extra += units.count(unit) - least_rows;
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

    /// `H`, and what bringing back each unit of `X` loses. Since `H_ii >= I`, norms of `H_ij` bound the scaled ones.
    fn work_out_own_losses(&mut self, units: Units) {
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
                let unit = if r == c { 1.0 } else { 0.0 };
                self.h[c * size + r] = (unit - sum) / self.factor[head + r];
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
        let count = self.units.len();
        self.own_loss.clear();
        self.loss_coupling.clear();
        self.loss_coupling.resize(count * count, 0.0);
        for i in 0..count {
            let (si, ni) = (self.starts[i], units.count(self.units[i]));
            let mut block = [[0.0; MAX_ROWS]; MAX_ROWS];
            for (r, row) in block.iter_mut().enumerate().take(ni) {
                for (c, value) in row.iter_mut().enumerate().take(r + 1) {
                    *value = self.h[(si + r) * size + si + c];
                }
            }
            self.own_loss
                .push(block_distance(&block, &self.w[si..si + ni]));
            for j in 0..i {
                let (sj, nj) = (self.starts[j], units.count(self.units[j]));
                let square: f64 = (si..si + ni)
                    .flat_map(|r| &self.h[r * size + sj..r * size + sj + nj])
                    .map(|v| v * v)
                    .sum();
                self.loss_coupling[i * count + j] = square.sqrt();
                self.loss_coupling[j * count + i] = square.sqrt();
            }
        }
    }

    /// Least losses of bringing back units with these indices in `X`, those of `G` from `position` on, less
    /// `penalty` for each.
    fn work_out_losses(
        &mut self,
        units: Units,
        position: usize,
        range: std::ops::Range<usize>,
        penalty: impl Fn(usize) -> f64,
        sums: &mut Sums,
    ) {
        if self.losses_from == Some(position) {
            return;
        }
        if self.losses_from.is_none() && !range.is_empty() {
            self.work_out_own_losses(units);
        }
        self.losses_from = Some(position);
        let (count, available) = (self.units.len(), range.len());
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
                    sums.terms.push(penalty(self.units[index]) - loss);
                }
                losses.push(-sum_of_largest(&mut sums.terms, number));
            }
        }
    }

    /// What adding each candidate brings by itself: `q_i^T M_ii^-1 q_i`.
    fn work_out_gains(&mut self, a: &[f64], units: Units) {
        if self.has_gains {
            return;
        }
        self.has_gains = true;
        let (m, n, size) = (self.q.len(), units.len(), self.rows.len());
        self.v.resize(m * size, 0.0);
        for table in self.gains.iter_mut().chain(&mut self.floor) {
            table.resize(n, 0.0);
        }
        for index in 0..self.universe.len() {
            let unit = self.universe[index];
            let (start, count) = (units.start(unit), units.count(unit));
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
                let mut block = p;
                for (r, row) in block.iter_mut().enumerate() {
                    for value in row.iter_mut() {
                        *value /= -theta;
                    }
                    row[r] += 1.0;
                }
                self.gains[k][unit] = block_distance(&block, &self.q[start..start + count]);
                self.floor[k][unit] = 1.0 - square.sqrt() / theta;
            }
        }
    }

    fn v_row(&self, row: usize) -> &[f64] {
        let size = self.rows.len();
        &self.v[row * size..(row + 1) * size]
    }

    /// Scaled norms of the blocks of `M` among the candidates; infinite where `M_ii` may be indefinite.
    fn work_out_couplings(&mut self, a: &[f64], units: Units) {
        if self.has_couplings {
            return;
        }
        self.has_couplings = true;
        let (m, n) = (self.q.len(), units.len());
        let mut couplings = std::mem::take(&mut self.gain_coupling);
        for table in &mut couplings {
            table.resize(n * n, 0.0);
        }
        for (index, &i) in self.universe.iter().enumerate() {
            let (si, ni) = (units.start(i), units.count(i));
            for &j in &self.universe[..index] {
                let (sj, nj) = (units.start(j), units.count(j));
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
struct Sums {
    picked: Vec<f64>,
    totals: Vec<f64>,
    terms: Vec<f64>,
}

/// `T_k,e` and what follows from them.
#[derive(Clone, Debug, Default)]
struct Thresholds {
    /// Rows beyond the smallest number that a unit can have.
    spread: usize,
    /// `T_k,e` for `k = 0, 1, ...`, `k * spread + 1` values each.
    values: Vec<f64>,
    /// `target_k`.
    target: Vec<f64>,
    tau: f64,
}

impl Thresholds {
    fn start(&self, order: usize) -> usize {
        // Sum of j * spread + 1 over j < order.
        order + self.spread * order * order.saturating_sub(1) / 2
    }

    fn at(&self, order: usize, extra: usize) -> f64 {
        self.values[self.start(order) + extra]
    }

    /// Least of `T_k,e` for a `k`.
    fn least(&self, order: usize) -> f64 {
        let start = self.start(order);
        let end = start + order * self.spread;
        self.values[start..=end]
            .iter()
            .copied()
            .fold(f64::INFINITY, f64::min)
    }

    /// `target_k` from `T_k,e`.
    fn update_target(&mut self, order: usize) {
        let start = self.start(order);
        self.target[order] = (0..=order * self.spread)
            .map(|extra| self.values[start + extra] - self.tau * extra as f64)
            .fold(f64::INFINITY, f64::min);
    }
}

/// Most groups that are looked at together.
const MOST_INTACT: usize = 4;
/// Most choices of groups that are looked at for one size.
const MOST_CHOICES: usize = 40;

/// `S`, `g` and the units.
#[derive(Clone, Copy)]
struct Rows<'a> {
    s: &'a [f64],
    ld: usize,
    g: &'a [f64],
    units: Units<'a>,
}

/// Refutes sets with many units from outside of `G`, see the module's page.
#[derive(Clone, Debug, Default)]
struct Pigeonhole {
    /// Units outside of `G`, the loosest predictions first.
    outside: Vec<usize>,
    /// A group, then `G`.
    joint: Joint,
    /// Covariance and innovation of `G` given the group, and the row offsets of its units.
    covariance: Vec<f64>,
    innovation: Vec<f64>,
    offsets: Vec<usize>,
    /// Largest distance that a set may keep which brings back so many units; negative if it cannot.
    allowed: Vec<f64>,
    /// Groups taken, then units of `G` chosen.
    groups: Vec<usize>,
    /// Rows before each group taken.
    marks: Vec<usize>,
    chosen: Joint,
    positions: Vec<usize>,
}

impl Pigeonhole {
    /// Takes the units outside of `G`; dealing them out in this order makes the groups alike.
    fn sort(&mut self, rows: Rows, outside: &[usize]) {
        let spread = |unit: usize| {
            let start = rows.units.start(unit);
            (start..start + rows.units.count(unit))
                .map(|row| rows.s[row * rows.ld + row])
                .sum::<f64>()
        };
        self.outside.clear();
        self.outside.extend_from_slice(outside);
        self.outside
            .sort_unstable_by(|&a, &b| spread(b).total_cmp(&spread(a)).then(a.cmp(&b)));
    }

    /// Whether every set with at most `most` units from outside of `G` keeps a larger distance than allowed.
    ///
    /// Of `most + intact` disjoint groups `F` hits at most `most`, so that `intact` of them are kept, and with them `Y`.
    fn refutes(&mut self, rows: Rows, greedy: &[usize], most: usize, intact: usize) -> bool {
        self.offsets.clear();
        self.offsets.push(0);
        let mut size = 0;
        for &unit in greedy {
            size += rows.units.count(unit);
            self.offsets.push(size);
        }
        let number = most + intact;
        self.groups.clear();
        self.groups.extend(0..intact);
        self.marks.clear();
        self.marks.resize(intact, 0);
        self.joint.clear();
        let mut changed = 0;
        loop {
            self.joint.truncate(self.marks[changed]);
            for k in changed..intact {
                self.marks[k] = self.joint.len();
                for &unit in self.outside.iter().skip(self.groups[k]).step_by(number) {
                    self.joint.push(rows.s, rows.ld, rows.g, rows.units, unit);
                }
            }
            let before = self.joint.len();
            let kept = self.joint.d2();
            for &unit in greedy {
                self.joint.push(rows.s, rows.ld, rows.g, rows.units, unit);
            }
            self.joint
                .conditional(before, &mut self.covariance, &mut self.innovation);
            if !self.all_exceed(kept) {
                return false;
            }
            // The next choice of groups, in lexicographic order.
            let Some(last) = (0..intact).rev().find(|&k| self.groups[k] < most + k) else {
                return true;
            };
            self.groups[last] += 1;
            for k in last + 1..intact {
                self.groups[k] = self.groups[k - 1] + 1;
            }
            changed = last;
        }
    }

    /// Whether every choice of units of `G` has a joint distance, given the groups, above what is allowed less `kept`.
    fn all_exceed(&mut self, kept: f64) -> bool {
        let units = Units::new(&self.offsets);
        let size = units.rows();
        let largest = self
            .allowed
            .iter()
            .copied()
            .fold(f64::NEG_INFINITY, f64::max);
        if kept > largest {
            return true;
        }
        let fewest = self
            .allowed
            .iter()
            .take_while(|&&a| a == f64::NEG_INFINITY)
            .count();
        self.chosen.clear();
        self.positions.clear();
        let mut next = 0;
        let mut steps = 0;
        loop {
            // Distances only grow: a choice beyond the largest that is ever allowed needs no more units.
            while next < units.len() && self.positions.len() + (units.len() - next) >= fewest {
                let rows = self.chosen.len();
                steps += 1;
                self.chosen
                    .push(&self.covariance, size, &self.innovation, units, next);
                let distance = kept + self.chosen.d2();
                if distance > largest {
                    self.chosen.truncate(rows);
                } else {
                    self.positions.push(next);
                    if distance <= self.allowed[self.positions.len()] || steps > MAX_STEPS {
                        return false;
                    }
                }
                next += 1;
            }
            let Some(last) = self.positions.pop() else {
                return true;
            };
            self.chosen.truncate(self.chosen.len() - units.count(last));
            next = last + 1;
        }
    }
}

/// Most choices from `G` that are looked at for one group.
const MAX_STEPS: usize = 500;

/// Depth-first search over all sets.
struct Search<'a> {
    batch: Rows<'a>,
    units: Units<'a>,
    a: &'a [f64],
    z: &'a [f64],
    greedy: &'a Greedy,
    levels: &'a mut Vec<Level>,
    pigeonhole: &'a mut Pigeonhole,
    sums: &'a mut Sums,
    thresholds: &'a mut Thresholds,
    best: &'a mut Vec<usize>,
    quantiles: &'a mut Quantiles,
    d2: f64,
    level: f64,
    least_rows: usize,
    /// Largest order of interest: that of the best set so far.
    order: usize,
    nodes: usize,
    max_nodes: usize,
    struck: bool,
    /// `f` of the best set so far.
    found: Option<f64>,
}

/// What the bounds say about a node.
enum Outlook {
    /// No set below it can win.
    Refuted,
    /// Decide next whether this candidate is added.
    Decide(usize),
    /// Decide next which unit of `G` is brought back first.
    BringBack,
}

impl<'a> Search<'a> {
    fn new(
        scratch: &'a mut Scratch,
        batch: Rows<'a>,
        d2: f64,
        settings: &HohctSettings,
        quantiles: &'a mut Quantiles,
    ) -> Self {
        let units = batch.units;
        let counts = (0..units.len()).map(|unit| units.count(unit));
        let least_rows = counts.clone().min().unwrap_or(0);
        scratch.thresholds.spread = counts.max().unwrap_or(0) - least_rows;
        Self {
            batch,
            units,
            a: &scratch.a[..scratch.z.len().pow(2)],
            z: &scratch.z,
            greedy: &scratch.greedy,
            levels: &mut scratch.levels,
            pigeonhole: &mut scratch.pigeonhole,
            sums: &mut scratch.sums,
            thresholds: &mut scratch.thresholds,
            best: &mut scratch.best,
            quantiles,
            d2,
            level: settings.level,
            least_rows,
            order: 0,
            nodes: 0,
            max_nodes: settings.max_nodes,
            struck: false,
            found: None,
        }
    }

    /// Searches all sets of at most `max_order` units.
    fn run(&mut self, max_order: usize, greedy_passes: bool) {
        let greedy = self.greedy;
        let size = greedy.units.len();
        self.order = max_order.min(size);
        self.set_level_thresholds();
        if greedy_passes {
            let extra = greedy.units.iter().map(|&u| self.extra_rows(u)).sum();
            self.best.clone_from(&greedy.units);
            self.accept(size, greedy.reduction, extra);
        }
        if size == 0 {
            return;
        }
        self.grow_level(0);
        let root = &mut self.levels[0];
        root.units.clone_from(&greedy.units);
        root.added = 0;
        root.universe.clear();
        root.universe
            .extend((0..self.units.len()).filter(|&unit| !greedy.taken[unit]));
        if !self.condition(0) {
            return;
        }
        let most = size.min(self.units.len() - size);
        self.pigeonhole.sort(self.batch, &self.levels[0].universe);
        for left in 0..=most {
            // The order may fall on the way.
            if left > self.order || self.struck {
                break;
            }
            let root = &mut self.levels[0];
            root.candidates.clone_from(&root.universe);
            if matches!(self.outlook(0, 0, left), Outlook::Refuted) {
                continue;
            }
            if left > 0 {
                if self.refute_by_groups(left, most, 1) {
                    break;
                }
                let refuted = (1..=MOST_INTACT)
                    .filter(|&intact| choices(left + intact, intact) <= MOST_CHOICES)
                    .any(|intact| self.refute_by_groups(left, left, intact));
                if refuted {
                    continue;
                }
            }
            self.explore(0, 0, left);
        }
    }

    /// Tries to refute all sets with `low <= |F| <= high` by disjoint groups of which `intact` are sure to be kept.
    fn refute_by_groups(&mut self, low: usize, high: usize, intact: usize) -> bool {
        let size = self.greedy.units.len();
        self.pigeonhole.allowed.clear();
        for back in 0..=size {
            // By bringing back `back` units and adding at least `low` the order becomes, at least,
            let order = (size + low).saturating_sub(back);
            let allowed = if order == 0 || order > self.order {
                f64::NEG_INFINITY
            } else {
                self.d2 - self.thresholds.least(order)
            };
            // A margin for rounding.
            self.pigeonhole.allowed.push(allowed + 1e-9 * allowed.abs());
        }
        self.nodes += 1;
        self.pigeonhole
            .refutes(self.batch, &self.greedy.units, high, intact)
    }

    /// All sets that follow from the level's `X` by adding exactly `left` of its candidates and bringing back units of
    /// `G` at positions from `position` on.
    fn explore(&mut self, depth: usize, position: usize, left: usize) {
        while !self.struck && self.levels[depth].candidates.len() >= left {
            match self.outlook(depth, position, left) {
                Outlook::Refuted => return,
                Outlook::Decide(unit) => {
                    self.levels[depth].candidates.retain(|&u| u != unit);
                    self.add(depth, position, left, unit);
                }
                Outlook::BringBack => return self.bring_back(depth, position, left),
            }
        }
    }

    /// Sets with `unit`, which was a candidate until now.
    fn add(&mut self, depth: usize, position: usize, left: usize, unit: usize) {
        let level = &self.levels[depth];
        if left == 1 {
            // Its gain is known exactly. The set needs to be worked out only for what may be brought back as well.
            let order = level.units.len() + 1;
            let reduction = level.reduction + level.gains[0][unit];
            let extra = level.extra + self.extra_rows(unit);
            if self.improves(order, reduction, extra) {
                self.best.clone_from(&level.units);
                self.best.push(unit);
                self.accept(order, reduction, extra);
            }
            let penalty = self.penalty(unit);
            let gains = self.levels[depth]
                .gains
                .each_ref()
                .map(|gain| gain[unit] - penalty);
            if !self.can_win(depth, position, left, 1, gains, 0.0) {
                return;
            }
        }
        if self.descend(depth, |units| units.push(unit), 1) {
            self.explore(depth + 1, position, left - 1);
        }
    }

    /// Sets without some of the units of `G` at positions from `position` on, by the first of them.
    fn bring_back(&mut self, depth: usize, position: usize, left: usize) {
        let mut gains = [0.0; THETAS.len()];
        if left > 0 {
            if left > 1 {
                self.levels[depth].work_out_couplings(self.a, self.units);
            }
            for (k, gain) in gains.iter_mut().enumerate().skip(1) {
                *gain = self.bounded_gain(depth, left, k).0;
            }
        }
        let first = self.first_index(depth, position);
        for at in position..self.greedy.units.len() {
            let unit = self.greedy.units[at];
            let level = &self.levels[depth];
            let own = level.own_loss[first + at - position];
            let mut fewest = 1;
            if left == 0 {
                // As in `add`.
                let order = level.units.len() - 1;
                let reduction = level.reduction - own;
                let extra = level.extra - self.extra_rows(unit);
                if self.improves(order, reduction, extra) {
                    self.best.clear();
                    let rest = level.units.iter().filter(|&&other| other != unit);
                    self.best.extend(rest);
                    self.accept(order, reduction, extra);
                }
                fewest = 2;
            }
            if self.can_win(depth, position, left, fewest, gains, own)
                && self.descend(depth, |units| units.retain(|&u| u != unit), 0)
            {
                self.explore(depth + 1, at + 1, left);
            }
        }
    }

    /// Bounds the sets below a node, see [`Search::explore`], and chooses how to go on.
    fn outlook(&mut self, depth: usize, position: usize, left: usize) -> Outlook {
        self.work_out_losses(depth, position);
        if left == 0 {
            return if self.can_win(depth, position, left, 1, [0.0; THETAS.len()], 0.0) {
                Outlook::BringBack
            } else {
                Outlook::Refuted
            };
        }
        self.levels[depth].work_out_gains(self.a, self.units);
        // As if candidates were not coupled, and X and F neither: no bound, but the branch to follow.
        let level = &self.levels[depth];
        let mut best = (f64::NEG_INFINITY, level.candidates[0]);
        self.sums.terms.clear();
        for &unit in &level.candidates {
            let gain = level.gains[0][unit] - self.penalty(unit);
            self.sums.terms.push(gain);
            if gain > best.0 {
                best = (gain, unit);
            }
        }
        let hope = sum_of_largest(&mut self.sums.terms, left);
        let must = level_order(&self.levels[depth], left) > self.order;
        if self.can_win(depth, position, left, 0, [hope; THETAS.len()], 0.0) {
            return if must {
                Outlook::BringBack
            } else {
                Outlook::Decide(best.1)
            };
        }
        if left > 1 {
            self.levels[depth].work_out_couplings(self.a, self.units);
        }
        // Each share bounds by itself; as a rule the first one is enough.
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

    /// Bound on what `left` candidates add for the share `k` (the first if nothing is brought back), and the candidate
    /// whose couplings loosen it most.
    fn bounded_gain(&mut self, depth: usize, left: usize, k: usize) -> (f64, usize) {
        let n = self.units.len();
        let level = &self.levels[depth];
        let mut worst = (f64::NEG_INFINITY, f64::NEG_INFINITY, usize::MAX);
        self.sums.terms.clear();
        for &unit in &level.candidates {
            let mut coupling = 0.0;
            if left > 1 {
                let row = &level.gain_coupling[k][unit * n..(unit + 1) * n];
                // A unit is not coupled to itself: its own entry is zero.
                self.sums.picked.clear();
                self.sums
                    .picked
                    .extend(level.candidates.iter().map(|&other| row[other]));
                coupling = sum_of_largest(&mut self.sums.picked, left - 1);
            }
            let bounded = if coupling < 1.0 {
                level.gains[k][unit] / (1.0 - coupling)
            } else {
                f64::INFINITY
            };
            let excess = bounded - level.gains[0][unit];
            if excess > worst.0 || (excess == worst.0 && coupling > worst.1) {
                worst = (excess, coupling, unit);
            }
            self.sums.terms.push(bounded - self.penalty(unit));
        }
        (sum_of_largest(&mut self.sums.terms, left), worst.2)
    }

    /// Whether a set below a node may win that brings back at least `fewest` units and gains at most `gains` (if
    /// nothing, if something is brought back), `own` being the loss of a unit that is brought back for certain.
    fn can_win(
        &self,
        depth: usize,
        position: usize,
        left: usize,
        fewest: usize,
        gains: PerTheta<f64>,
        own: f64,
    ) -> bool {
        let level = &self.levels[depth];
        let base = level.reduction - self.thresholds.tau * level.extra as f64;
        let largest = level_order(level, left);
        let available = self.greedy.units.len() - position;
        let rows = self.thresholds.tau * self.thresholds.spread as f64;
        (fewest.max(largest.saturating_sub(self.order))..=available.min(largest.saturating_sub(1)))
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
                bound + 1e-10 * bound.abs() >= self.thresholds.target[largest - number]
            })
    }

    /// Makes the next level from this one; false if the budget has struck.
    fn descend(&mut self, depth: usize, edit: impl FnOnce(&mut Vec<usize>), added: usize) -> bool {
        self.grow_level(depth + 1);
        let (upper, lower) = self.levels.split_at_mut(depth + 1);
        let (from, to) = (&upper[depth], &mut lower[0]);
        to.units.clone_from(&from.units);
        edit(&mut to.units);
        to.added = from.added + added;
        to.universe.clone_from(&from.candidates);
        to.candidates.clone_from(&from.candidates);
        self.condition(depth + 1)
    }

    fn grow_level(&mut self, depth: usize) {
        if self.levels.len() <= depth {
            self.levels.resize_with(depth + 1, Level::default);
        }
    }

    fn condition(&mut self, depth: usize) -> bool {
        self.struck |= self.nodes >= self.max_nodes;
        if !self.struck {
            self.nodes += 1;
            self.levels[depth].condition(self.a, self.z, self.units, self.least_rows);
        }
        !self.struck
    }

    fn work_out_losses(&mut self, depth: usize, position: usize) {
        let first = self.first_index(depth, position);
        let available = self.greedy.units.len() - position;
        let (tau, units, least) = (self.thresholds.tau, self.units, self.least_rows);
        let penalty = |unit| tau * (units.count(unit) - least) as f64;
        let range = first..first + available;
        self.levels[depth].work_out_losses(units, position, range, penalty, self.sums);
    }

    /// Index in the level's `X` of the unit of `G` at `position`; all from there on are in `X`.
    fn first_index(&self, depth: usize, position: usize) -> usize {
        let level = &self.levels[depth];
        level.units.len() - level.added - (self.greedy.units.len() - position)
    }

    fn extra_rows(&self, unit: usize) -> usize {
        self.units.count(unit) - self.least_rows
    }

    fn penalty(&self, unit: usize) -> f64 {
        self.thresholds.tau * self.extra_rows(unit) as f64
    }

    /// Thresholds that the level sets, for all orders up to `self.order`.
    fn set_level_thresholds(&mut self) {
        let table = &mut *self.thresholds;
        table.values.clear();
        table.target.clear();
        table.target.resize(self.order + 1, f64::INFINITY);
        table.tau = f64::INFINITY;
        for order in 0..=self.order {
            let start = table.values.len();
            for extra in 0..=order * table.spread {
                let gone = order * self.least_rows + extra;
                let value = match self.z.len().checked_sub(gone) {
                    Some(dof) => self.d2 - self.quantiles.get(self.level, dof),
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
        for order in 0..=self.order {
            table.update_target(order);
        }
    }

    /// Whether a set beats the best so far: a smaller one must pass the level, one of the same order must be better.
    fn improves(&self, order: usize, reduction: f64, extra: usize) -> bool {
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

    /// Takes a set as the best so far; from now on sets of its order must have a larger tail probability.
    fn accept(&mut self, order: usize, reduction: f64, extra: usize) {
        self.found = Some(reduction);
        self.order = order;
        let table = &mut *self.thresholds;
        let start = table.start(order);
        if table.spread > 0 {
            let dof = |extra: usize| self.z.len().checked_sub(order * self.least_rows + extra);
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

/// `n` choose `k`.
fn choices(n: usize, k: usize) -> usize {
    (0..k).fold(1, |product, i| product * (n - i) / (i + 1))
}

/// Order of the sets below a level if nothing is brought back.
fn level_order(level: &Level, left: usize) -> usize {
    level.units.len() + left
}

/// Sum of the `count` largest values, or of all if there are fewer. Reorders the values.
fn sum_of_largest(values: &mut [f64], count: usize) -> f64 {
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
