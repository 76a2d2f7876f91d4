//! Squared Mahalanobis distances: of one block, of all together, and of a set that grows and shrinks.

use super::batch::{Blocks, MAX_ROWS};

/// `g_i^T S_ii^-1 g_i`; infinite if `S_ii` is not positive definite.
pub(super) fn individual_distance(
    s: &[f64],
    ld: usize,
    g: &[f64],
    blocks: Blocks,
    block: usize,
) -> f64 {
    let (start, rows) = (blocks.start(block), blocks.count(block));
    let mut matrix = [[0.0; MAX_ROWS]; MAX_ROWS];
    for (r, row) in matrix.iter_mut().enumerate().take(rows) {
        for (c, value) in row.iter_mut().enumerate().take(r + 1) {
            *value = s[(start + c) * ld + start + r];
        }
    }
    block_distance(&matrix, &g[start..start + rows])
}

/// `v^T M^-1 v` from the lower triangle of the leading rows; infinite if `M` is not positive definite.
pub(super) fn block_distance(matrix: &[[f64; MAX_ROWS]; MAX_ROWS], v: &[f64]) -> f64 {
    let mut l = *matrix;
    let mut y = [0.0; MAX_ROWS];
    let mut d2 = 0.0;
    for (r, &value) in v.iter().enumerate() {
        let (done, rest) = l.split_at_mut(r);
        let row = &mut rest[0];
        let mut value = value;
        for (c, above) in done.iter().enumerate() {
            let shared: f64 = row.iter().zip(above).take(c).map(|(a, b)| a * b).sum();
            row[c] = (row[c] - shared) / above[c];
            value -= row[c] * y[c];
        }
        let pivot = row[r] - row[..r].iter().map(|a| a * a).sum::<f64>();
        if pivot.is_nan() || pivot <= 0.0 {
            return f64::INFINITY;
        }
        row[r] = pivot.sqrt();
        y[r] = value / row[r];
        d2 += y[r] * y[r];
    }
    d2
}

/// `y = L^-1 g`; returns `|y|^2 = g^T S^-1 g`.
pub(super) fn whiten(l: &[f64], ld: usize, g: &[f64], y: &mut Vec<f64>) -> f64 {
    y.clear();
    y.extend_from_slice(g);
    let m = g.len();
    let mut d2 = 0.0;
    for j in 0..m {
        let column = &l[j * ld..j * ld + m];
        let value = y[j] / column[j];
        y[j] = value;
        d2 += value * value;
        for (y, l) in y[j + 1..].iter_mut().zip(&column[j + 1..]) {
            *y -= l * value;
        }
    }
    d2
}

/// Dot product with four running sums, which the compiler can keep in vector registers.
pub(super) fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a4, b4) = (a.chunks_exact(4), b.chunks_exact(4));
    let tail: f64 = a4
        .remainder()
        .iter()
        .zip(b4.remainder())
        .map(|(x, y)| x * y)
        .sum();
    for (x, y) in a4.zip(b4) {
        for k in 0..4 {
            sums[k] += x[k] * y[k];
        }
    }
    sums[0] + sums[1] + (sums[2] + sums[3]) + tail
}

/// Joint distance of a growing and shrinking set of blocks: a Cholesky factor that rows are appended to and taken from.
///
/// Appending block `i` to a set `A` adds exactly the distance of `i` given `A`,
/// `r^T (S_ii - S_iA S_AA^-1 S_Ai)^-1 r` with `r = g_i - S_iA S_AA^-1 g_A`.
#[derive(Clone, Debug, Default)]
pub(super) struct Joint {
    /// Rows of the factor one after the other, row `r` with `r + 1` entries.
    factor: Vec<f64>,
    /// Row of `S` behind each row of the factor.
    rows: Vec<usize>,
    /// `L^-1 g`.
    y: Vec<f64>,
    /// Distance up to each row.
    d2: Vec<f64>,
}

impl Joint {
    pub(super) fn clear(&mut self) {
        self.truncate(0);
    }

    /// Number of rows.
    pub(super) fn len(&self) -> usize {
        self.rows.len()
    }

    /// Goes back to the first `rows` rows.
    pub(super) fn truncate(&mut self, rows: usize) {
        self.factor.truncate(rows * (rows + 1) / 2);
        self.rows.truncate(rows);
        self.y.truncate(rows);
        self.d2.truncate(rows);
    }

    pub(super) fn d2(&self) -> f64 {
        self.d2.last().copied().unwrap_or(0.0)
    }

    /// Covariance (lower triangle, column-major) and innovation of the rows from `from` on, given those before.
    pub(super) fn conditional(
        &self,
        from: usize,
        covariance: &mut Vec<f64>,
        innovation: &mut Vec<f64>,
    ) {
        let size = self.len() - from;
        let row = |r: usize| {
            let head = (from + r) * (from + r + 1) / 2 + from;
            &self.factor[head..head + r + 1]
        };
        covariance.clear();
        covariance.resize(size * size, 0.0);
        innovation.clear();
        for r in 0..size {
            innovation.push(dot(row(r), &self.y[from..from + r + 1]));
            for c in 0..=r {
                covariance[c * size + r] = dot(&row(r)[..c + 1], row(c));
            }
        }
    }

    /// Appends a block; returns the distance it adds (infinite if the set's covariance is not positive definite).
    pub(super) fn push(
        &mut self,
        s: &[f64],
        ld: usize,
        g: &[f64],
        blocks: Blocks,
        block: usize,
    ) -> f64 {
        let before = self.d2();
        let start = blocks.start(block);
        for row in start..start + blocks.count(block) {
            let r = self.rows.len();
            let base = self.factor.len();
            let mut pivot = s[row * ld + row];
            let mut value = g[row];
            for c in 0..r {
                let other = self.rows[c];
                let (low, high) = (row.min(other), row.max(other));
                let head = c * (c + 1) / 2;
                let sum = dot(&self.factor[base..base + c], &self.factor[head..head + c]);
                let entry = (s[low * ld + high] - sum) / self.factor[head + c];
                self.factor.push(entry);
                pivot -= entry * entry;
                value -= entry * self.y[c];
            }
            let root = pivot.max(0.0).sqrt();
            self.factor.push(root);
            self.rows.push(row);
            self.y.push(value / root);
            self.d2.push(self.d2() + value * value / pivot.max(0.0));
        }
        self.d2() - before
    }
}
