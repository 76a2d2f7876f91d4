//! HOHCT, the highest-order hypothesis compatibility test (METHOD section 8; Guerra, Munguia, Bolea, Grau 2013).
//!
//! Order 0 is the most optimistic hypothesis: all matches are right. If `D^2 = g^T S^-1 g` exceeds the chi-square quantile,
//! hypotheses with one unit left out are looked at, then two, and so on; at the first order at which one passes, the
//! one with the largest tail probability is taken.
//!
//! # What leaving out costs
//! With `A = S^-1` and `z = A g`, leaving out the units `E` takes
//! `f(E) = z_E^T (A_EE)^-1 z_E = max { 2 z^T x - x^T A x : x zero outside E }` off `D^2`. So the test looks for the
//! `k` units with the largest `f`. A change of basis within each unit makes its own block of `A` the identity and
//! leaves `f` as it is; below, `A` and `z` are in that basis, and `c_ij` is a bound on the norm of block `A_ij`.
//!
//! # Exact search
//! A greedy set `G` (the best single unit given those already out, until the rest passes) is the first incumbent.
//! Every set of `k` units is `E = (G \ Y) u F` with `t = |F|` units from outside of `G` and `|Y| = |G| - k + t`: for each
//! `t` the search first grows `Y` unit by unit, then `F`. In nearly all sets that are worth a look both are small.
//!
//! *Bound.* Let `X = G \ Y` for a partial `Y`, `w` the maximiser of `f(X)`, `q = z - A w` (zero on `X`), and let
//! `B = diag(b_i I)` be a block-diagonal matrix with `A - B` positive semidefinite on the rows of `X u F`. A concave function
//! lies below its tangent at `w`, so for every `x` supported there
//!
//! ```text
//! 2 z^T x - x^T A x  =  2 z^T x - x^T B x - x^T (A - B) x
//!                   <=  w^T (A - B) w + 2 (z - (A - B) w)^T x - x^T B x
//! ```
//!
//! and the right side falls apart into units: with `z - (A - B) w = q + B w` its maximum over supports within `X u F`
//! is `f(X) - sum_X b_i |w_i|^2` plus, for each unit that is out, `b_i |w_i|^2` if it lies in `X` or `|q_i|^2 / b_i`
//! if it lies in `F`. Hence
//!
//! ```text
//! f(E) <= f(X) - (the |Y| still to come smallest b_i |w_i|^2 in X) + (the t largest |q_i|^2 / b_i outside)
//! ```
//!
//! *Which `B`.* By Gershgorin's theorem for blocks, `b_i = 1 - sum c_ij` over the other units of `X u F` will do:
//! `x^T (A - B) x >= sum_i s_i |x_i|^2 - sum_{i != j} c_ij |x_i| |x_j| >= 0` with `s_i = sum_j c_ij`. The members of `F` are not
//! known yet, so their share is bounded by the largest `c_ij` outside of `G`. Where `b_i <= 0` the bound is infinite and
//! the search goes one level deeper. Once `Y` is complete the same bound with `X = G \ Y` plus the part of `F` already
//! chosen bounds the rest of `F`, since the maximum over the rows of `X` is attained at `q = 0` there.
//!
//! Gross outliers make `b_i |w_i|^2` large against the slack, so that all smaller orders are usually refuted at their
//! root by `G` alone.
//!
//! *Units of different size.* A set with `e` rows more than the smallest possible must reach
//! `f(E) >= D^2 - quantile(dof)`, a threshold `T_e`. With `tau = min (T_e - T_0) / e`, `T_e >= T_0 + tau e`, so
//! `f(E) - tau e(E) >= T_0` is necessary; it is a sum over units again and the bound above holds with `tau e_i`
//! taken off each unit's gain. An incumbent's tail probability gives new thresholds in the same way; `tau` stays, and the
//! least `T_e - tau e` takes the place of `T_0`.
//!
//! *Budget.* Past `max_nodes` conditionings the best hypothesis of the order under search stands, or else the greedy
//! set, and the verdict says that it is not exact.

use faer::linalg::matmul::triangular::{BlockStructure, matmul};
use faer::linalg::triangular_inverse::invert_lower_triangular;
use faer::{Accum, MatMut, MatRef, Par};

use super::{MAX_ROWS, Quantiles, Units, Verdict, Workspace, block_distance, check, dot, whiten};
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
            max_nodes: 20_000,
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
    /// `c_ij`, `n x n`, zero on the diagonal.
    c: Vec<f64>,
    /// `n x (|G| + 1)` running sums of the largest `c_ij` over `j` outside of `G`.
    outside: Vec<f64>,
    greedy: Greedy,
    in_greedy: Vec<bool>,
    levels: Vec<Level>,
    picked: Vec<f64>,
    thresholds: Vec<f64>,
    best: Vec<usize>,
}

/// Leaves out the fewest units so that the rest is jointly compatible at `settings.level`.
///
/// `l` is the lower Cholesky factor of `S` (column-major, leading dimension `ld`), `g` the innovation. If all units
/// pass together this costs one triangular solve; `S^-1` is only formed if they do not.
pub fn hohct(
    l: &[f64],
    ld: usize,
    g: &[f64],
    units: Units,
    settings: &HohctSettings,
    ws: &mut Workspace,
) -> Verdict {
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
    scratch.prepare_bounds(units, max_order);

    let mut search = Search::new(scratch, units, d2, settings, &mut ws.quantiles);
    search.start();
    let mut found = None;
    let last = if greedy_passes {
        search.greedy.len()
    } else {
        max_order
    };
    for order in 1..=last {
        search.run(order);
        if let Some(reduction) = search.found {
            found = Some(reduction);
            break;
        }
        if search.struck {
            break;
        }
    }
    let (nodes, exact) = (search.nodes, !search.struck);
    let scratch = &mut ws.hohct;
    let reduction = found.or(greedy_passes.then(|| {
        scratch.best.clone_from(&scratch.greedy.units);
        scratch.greedy.reduction
    }));
    let mut verdict = match reduction {
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
    /// Whitened `A` and `z`, and the coupling norms.
    ///
    /// With `A = L^-T L^-1`, scaling the columns of `L^-1` by `K_i^-1`, `A_ii = K_i^T K_i` with `K_i` lower
    /// triangular, keeps them lower triangular: the whitened `A` is `B^T B`, the whitened `z` is `B^T (L^-1 g)`.
    fn prepare(&mut self, l: &[f64], ld: usize, y: &[f64], units: Units) {
        let (m, n) = (y.len(), units.len());
        self.inverse.resize(m * m, 0.0);
        self.a.resize(m * m, 0.0);
        self.c.resize(n * n, 0.0);
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
        for i in 0..n {
            self.c[i * n + i] = 0.0;
            for j in 0..i {
                let norm = block_norm(&self.a, m, units, i, j);
                self.c[i * n + j] = norm;
                self.c[j * n + i] = norm;
            }
        }
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

    /// Sums of the largest couplings to units outside of `G`.
    fn prepare_bounds(&mut self, units: Units, max_order: usize) {
        let n = units.len();
        let stride = max_order + 1;
        self.in_greedy.clear();
        self.in_greedy.resize(n, false);
        for &unit in &self.greedy.units {
            self.in_greedy[unit] = true;
        }
        let depth = self.greedy.units.len().min(n - self.greedy.units.len());
        self.outside.clear();
        self.outside.resize(n * stride, 0.0);
        for i in 0..n {
            let row = &self.c[i * n..(i + 1) * n];
            self.picked.clear();
            self.picked
                .extend((0..n).filter(|&j| !self.in_greedy[j]).map(|j| row[j]));
            if depth == 0 {
                continue;
            }
            if depth < self.picked.len() {
                self.picked
                    .select_nth_unstable_by(depth - 1, |a, b| b.total_cmp(a));
                self.picked.truncate(depth);
            }
            self.picked.sort_unstable_by(|a, b| b.total_cmp(a));
            let mut sum = 0.0;
            for t in 1..stride {
                sum += self.picked.get(t - 1).copied().unwrap_or(0.0);
                self.outside[i * stride + t] = sum;
            }
        }
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

/// Bound on the spectral norm of block `(i, j)`, `i > j`: exact for blocks with at most two rows or columns, else Frobenius.
fn block_norm(a: &[f64], m: usize, units: Units, i: usize, j: usize) -> f64 {
    let (row, rows) = (units.start(i), units.count(i));
    let (column, columns) = (units.start(j), units.count(j));
    let at = |r: usize, c: usize| a[(column + c) * m + row + r];
    if rows == 2 && columns == 2 {
        let (p, q, r, s) = (at(0, 0), at(0, 1), at(1, 0), at(1, 1));
        let (sum, difference) = ((p + s).hypot(r - q), (p - s).hypot(r + q));
        return 0.5 * (sum + difference);
    }
    let mut square = 0.0;
    for c in 0..columns {
        for r in 0..rows {
            square += at(r, c) * at(r, c);
        }
    }
    square.sqrt()
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

/// One set `X` of units that are out, worked out.
#[derive(Clone, Debug, Default)]
struct Level {
    units: Vec<usize>,
    /// Rows of `X`.
    rows: Vec<usize>,
    /// Cholesky factor of `A_XX`, rows one after the other.
    factor: Vec<f64>,
    /// `w` on the rows of `X`.
    w: Vec<f64>,
    /// `z - A w`, all rows.
    q: Vec<f64>,
    /// Sum of `c_ij` over `j` in `X`.
    coupling: Vec<f64>,
    /// Bound on what each unit adds (outside) or what bringing it back loses (in `G`), corrected by `tau`.
    score: Vec<f64>,
    /// Units that may still be added, most promising first.
    candidates: Vec<usize>,
    /// `f(X)`.
    reduction: f64,
    /// Rows beyond the smallest possible number.
    extra: usize,
}

impl Level {
    fn condition(&mut self, a: &[f64], z: &[f64], c: &[f64], units: Units, least_rows: usize) {
        let (m, n) = (z.len(), units.len());
        self.rows.clear();
        self.extra = 0;
        for &unit in &self.units {
            self.rows
                .extend(units.start(unit)..units.start(unit) + units.count(unit));
            self.extra += units.count(unit) - least_rows;
        }
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
        self.coupling.clear();
        self.coupling.resize(n, 0.0);
        for &unit in &self.units {
            for (sum, c) in self.coupling.iter_mut().zip(&c[unit * n..(unit + 1) * n]) {
                *sum += c;
            }
        }
    }

    /// What leaving out `unit` as well takes off, exactly.
    fn exact_gain(&self, a: &[f64], units: Units, unit: usize, buffer: &mut Vec<f64>) -> f64 {
        let m = self.q.len();
        let (start, rows) = (units.start(unit), units.count(unit));
        let size = self.rows.len();
        // Columns of L^-1 A_Xi, one after the other.
        buffer.clear();
        for row in start..start + rows {
            let column = &a[row * m..(row + 1) * m];
            let base = buffer.len();
            for r in 0..size {
                let head = r * (r + 1) / 2;
                let sum = dot(&self.factor[head..head + r], &buffer[base..base + r]);
                buffer.push((column[self.rows[r]] - sum) / self.factor[head + r]);
            }
        }
        let mut block = [[0.0; MAX_ROWS]; MAX_ROWS];
        for r in 0..rows {
            for c in 0..=r {
                let shared = dot(
                    &buffer[r * size..(r + 1) * size],
                    &buffer[c * size..(c + 1) * size],
                );
                block[r][c] = a[(start + c) * m + start + r] - shared;
            }
        }
        block_distance(&block, &self.q[start..start + rows])
    }
}

/// Depth-first search of one order after the other.
struct Search<'a> {
    units: Units<'a>,
    a: &'a [f64],
    z: &'a [f64],
    c: &'a [f64],
    outside: &'a [f64],
    stride: usize,
    in_greedy: &'a [bool],
    greedy: &'a [usize],
    levels: &'a mut Vec<Level>,
    picked: &'a mut Vec<f64>,
    /// `T_e` of the best tail probability so far, by extra rows.
    thresholds: &'a mut Vec<f64>,
    best: &'a mut Vec<usize>,
    quantiles: &'a mut Quantiles,
    d2: f64,
    level: f64,
    /// Threshold of bounds corrected by `tau`: the least `T_e - tau e`.
    target: f64,
    tau: f64,
    least_rows: usize,
    most_rows: usize,
    order: usize,
    nodes: usize,
    max_nodes: usize,
    struck: bool,
    found: Option<f64>,
}

impl<'a> Search<'a> {
    fn new(
        scratch: &'a mut Scratch,
        units: Units<'a>,
        d2: f64,
        settings: &HohctSettings,
        quantiles: &'a mut Quantiles,
    ) -> Self {
        let n = units.len();
        let counts = (0..n).map(|unit| units.count(unit));
        Self {
            units,
            a: &scratch.a[..scratch.z.len().pow(2)],
            z: &scratch.z,
            c: &scratch.c[..n * n],
            outside: &scratch.outside,
            stride: scratch.outside.len() / n,
            in_greedy: &scratch.in_greedy,
            greedy: &scratch.greedy.units,
            levels: &mut scratch.levels,
            picked: &mut scratch.picked,
            thresholds: &mut scratch.thresholds,
            best: &mut scratch.best,
            quantiles,
            d2,
            level: settings.level,
            target: 0.0,
            tau: 0.0,
            least_rows: counts.clone().min().unwrap_or(0),
            most_rows: counts.max().unwrap_or(0),
            order: 0,
            nodes: 0,
            max_nodes: settings.max_nodes,
            struck: false,
            found: None,
        }
    }

    /// Works out `G` itself, the root of every order.
    fn start(&mut self) {
        self.grow_level(0);
        self.levels[0].units.clear();
        self.levels[0].units.extend_from_slice(self.greedy);
        self.condition(0);
    }

    /// All sets of `order` units; `found` tells whether one passes.
    fn run(&mut self, order: usize) {
        self.order = order;
        self.set_thresholds(None);
        let size = self.greedy.len();
        for added in 0..=order.min(self.units.len() - size) {
            if size + added < order || self.struck {
                continue;
            }
            let left = size + added - order;
            if left <= size {
                self.bring_back(0, 0, left, added);
            }
        }
    }

    /// Thresholds of the level, or of an incumbent with tail probability `exp(ln_tail)`.
    fn set_thresholds(&mut self, ln_tail: Option<f64>) {
        let widest = self.order * (self.most_rows - self.least_rows);
        self.thresholds.clear();
        for extra in 0..=widest {
            let gone = self.order * self.least_rows + extra;
            let Some(dof) = self.z.len().checked_sub(gone) else {
                break;
            };
            let largest = match ln_tail {
                None => self.quantiles.get(self.level, dof),
                Some(value) => chi2::inverse_ln_survival(value, dof as f64),
            };
            self.thresholds.push(self.d2 - largest);
        }
        let first = self.thresholds[0];
        let by_extra = || (0..).map(f64::from).zip(self.thresholds.iter());
        if ln_tail.is_none() {
            self.tau = by_extra()
                .skip(1)
                .map(|(extra, t)| (t - first) / extra)
                .reduce(f64::min)
                .unwrap_or(0.0);
        }
        self.target = by_extra()
            .map(|(extra, t)| t - self.tau * extra)
            .fold(f64::INFINITY, f64::min);
    }

    fn grow_level(&mut self, depth: usize) {
        if self.levels.len() <= depth {
            self.levels.resize_with(depth + 1, Level::default);
        }
    }

    /// Conditions the level on its units; false if the budget has struck.
    fn condition(&mut self, depth: usize) -> bool {
        if !self.count_node() {
            return false;
        }
        self.levels[depth].condition(self.a, self.z, self.c, self.units, self.least_rows);
        true
    }

    fn count_node(&mut self) -> bool {
        self.struck |= self.nodes >= self.max_nodes;
        self.nodes += usize::from(!self.struck);
        !self.struck
    }

    /// What leaving out a unit with more than the least number of rows costs in the threshold.
    fn penalty(&self, unit: usize) -> f64 {
        self.tau * (self.units.count(unit) - self.least_rows) as f64
    }

    /// Whether sets bounded by `bound` (corrected by `tau`) can still win, with a margin for rounding.
    fn can_win(&self, bound: f64) -> bool {
        bound + 1e-10 * bound.abs() >= self.target
    }

    /// Grows `Y` (the level's units are `G \ Y`): brings back `left` more units of `G`, at positions from `position` on; then adds `added` others.
    fn bring_back(&mut self, depth: usize, position: usize, left: usize, added: usize) {
        if depth > 0 && !self.condition(depth) {
            return;
        }
        if left == 0 {
            self.add(depth, added);
            return;
        }
        let base = self.levels[depth].reduction - self.tau * self.levels[depth].extra as f64;
        let gain = self.score_outside(depth, added);
        let bounded = self.score_inside(depth, added);
        for at in position..=self.greedy.len() - left {
            if self.struck {
                return;
            }
            let unit = self.greedy[at];
            let bound = if bounded {
                let loss = self.levels[depth].score[unit];
                base + gain - loss - self.smallest_scores(depth, at + 1, left - 1)
            } else {
                f64::INFINITY
            };
            if self.can_win(bound) {
                self.grow_level(depth + 1);
                let (upper, lower) = self.levels.split_at_mut(depth + 1);
                lower[0].units.clear();
                lower[0]
                    .units
                    .extend(upper[depth].units.iter().filter(|&&other| other != unit));
                self.bring_back(depth + 1, at + 1, left - 1, added);
            }
        }
    }

    /// Scores the units outside of `G`, of which `added` come; returns the sum of that many largest.
    fn score_outside(&mut self, depth: usize, added: usize) -> f64 {
        if added == 0 {
            return 0.0;
        }
        self.picked.clear();
        for unit in 0..self.units.len() {
            if !self.in_greedy[unit] {
                let gain = self.gain_bound(depth, unit, added);
                self.picked.push(gain);
            }
        }
        sum_of_largest(self.picked, added)
    }

    /// `|q_i|^2 / b_i - tau e_i` of a unit outside of `X`, one of `added` to come.
    fn gain_bound(&self, depth: usize, unit: usize, added: usize) -> f64 {
        let level = &self.levels[depth];
        let b = 1.0 - level.coupling[unit] - self.outside[unit * self.stride + added - 1];
        if b <= 0.0 {
            return f64::INFINITY;
        }
        let q = &level.q[self.units.start(unit)..][..self.units.count(unit)];
        q.iter().map(|v| v * v).sum::<f64>() / b - self.penalty(unit)
    }

    /// Scores the units of `X` with `b_i |w_i|^2 - tau e_i`; false if a `b_i` is not positive.
    fn score_inside(&mut self, depth: usize, added: usize) -> bool {
        let n = self.units.len();
        self.levels[depth].score.resize(n, 0.0);
        let mut row = 0;
        for index in 0..self.levels[depth].units.len() {
            let unit = self.levels[depth].units[index];
            let penalty = self.penalty(unit);
            let level = &mut self.levels[depth];
            let b = 1.0 - level.coupling[unit] - self.outside[unit * self.stride + added];
            if b <= 0.0 {
                return false;
            }
            let w = &level.w[row..row + self.units.count(unit)];
            row += w.len();
            level.score[unit] = b * w.iter().map(|v| v * v).sum::<f64>() - penalty;
        }
        true
    }

    /// Sum of the `count` smallest scores among the units of `G` from `position` on.
    fn smallest_scores(&mut self, depth: usize, position: usize, count: usize) -> f64 {
        if count == 0 {
            return 0.0;
        }
        self.picked.clear();
        let score = &self.levels[depth].score;
        self.picked
            .extend(self.greedy[position..].iter().map(|&unit| -score[unit]));
        -sum_of_largest(self.picked, count)
    }

    /// `Y` is complete: adds `left` units from outside of `G`.
    fn add(&mut self, depth: usize, left: usize) {
        if left == 0 {
            let reduction = self.levels[depth].reduction;
            self.offer(depth, reduction, None);
            return;
        }
        let mut candidates = std::mem::take(&mut self.levels[depth].candidates);
        candidates.clear();
        candidates.extend((0..self.units.len()).filter(|&unit| !self.in_greedy[unit]));
        self.add_from(depth, &mut candidates, left);
        self.levels[depth].candidates = candidates;
    }

    /// Adds `left` of the candidates to the conditioned level.
    fn add_from(&mut self, depth: usize, candidates: &mut [usize], left: usize) {
        let base = self.levels[depth].reduction - self.tau * self.levels[depth].extra as f64;
        let mut score = std::mem::take(&mut self.levels[depth].score);
        score.resize(self.units.len(), 0.0);
        for &unit in candidates.iter() {
            score[unit] = self.gain_bound(depth, unit, left);
        }
        candidates.sort_unstable_by(|&a, &b| score[b].total_cmp(&score[a]).then(a.cmp(&b)));
        for at in 0..(candidates.len() + 1).saturating_sub(left) {
            // Sorted: the best that can come is this unit with its followers.
            let bound: f64 = candidates[at..at + left].iter().map(|&u| score[u]).sum();
            if self.struck || !self.can_win(base + bound) {
                break;
            }
            let unit = candidates[at];
            if left == 1 {
                if self.count_node() {
                    let level = &self.levels[depth];
                    let gain = level.exact_gain(self.a, self.units, unit, self.picked);
                    let reduction = level.reduction + gain;
                    self.offer(depth, reduction, Some(unit));
                }
                continue;
            }
            self.grow_level(depth + 1);
            let (upper, lower) = self.levels.split_at_mut(depth + 1);
            let next = &mut lower[0];
            next.units.clear();
            next.units.extend_from_slice(&upper[depth].units);
            next.units.push(unit);
            if self.condition(depth + 1) {
                let mut rest = std::mem::take(&mut self.levels[depth + 1].candidates);
                rest.clear();
                rest.extend_from_slice(&candidates[at + 1..]);
                self.add_from(depth + 1, &mut rest, left - 1);
                self.levels[depth + 1].candidates = rest;
            }
        }
        self.levels[depth].score = score;
    }

    /// A complete set (the level's, plus one more unit): keeps it if it beats the best.
    fn offer(&mut self, depth: usize, reduction: f64, more: Option<usize>) {
        let level = &self.levels[depth];
        let extra = level.extra + more.map_or(0, |unit| self.units.count(unit) - self.least_rows);
        let threshold = self.thresholds[extra];
        // The first must pass the level, a later one must be better.
        let wins = match self.found {
            None => reduction >= threshold,
            Some(_) => reduction > threshold,
        };
        if !wins {
            return;
        }
        self.best.clear();
        self.best.extend_from_slice(&level.units);
        self.best.extend(more);
        self.found = Some(reduction);
        if self.most_rows == self.least_rows {
            self.thresholds[0] = reduction;
            self.target = reduction;
        } else {
            let dof = self.z.len() - self.order * self.least_rows - extra;
            let rest = (self.d2 - reduction).max(0.0);
            self.set_thresholds(Some(chi2::ln_survival(rest, dof as f64)));
            self.thresholds[extra] = reduction;
        }
    }
}

/// Sum of the `count` largest values, or of all if there are fewer. Reorders the values.
fn sum_of_largest(values: &mut [f64], count: usize) -> f64 {
    if count == 0 {
        0.0
    } else if count == 1 {
        values.iter().copied().fold(f64::NEG_INFINITY, f64::max)
    } else if count < values.len() {
        values.select_nth_unstable_by(count - 1, |a, b| b.total_cmp(a));
        values[..count].iter().sum()
    } else {
        values.iter().sum()
    }
}
