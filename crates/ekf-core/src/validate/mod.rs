//! Validation of a batch of matches before the update (METHOD sections 7 and 8).
//!
//! A batch has `n` *blocks*, each a match that is accepted or rejected as a whole, with 1 to 3 rows (2 for a bearing,
//! 3 with depth). Its innovation `g` (`m` rows) has the covariance `S = H P H^T + R = L L^T`. Every test answers
//! with a [`Verdict`] and leaves the rejected blocks in the [`Workspace`]:
//!
//! - [`hohct`]: highest-order hypothesis compatibility, the fewest matches left out so that the rest is jointly compatible;
//! - [`jcbb`]: joint compatibility branch and bound, the most matches that are jointly compatible;
//! - [`one_point`]: 1-point RANSAC, made exhaustive;
//! - [`individual_gate`]: each match by itself;
//! - [`conditional_gate`]: each match given all the others.
//!
//! Matrices are column-major slices with leading dimension `ld`, of which only the lower triangle is read.
//! Buffers live in the workspace and only grow: a warm call allocates nothing. Every search is bounded by a number of
//! nodes and never by a clock, so equal input gives equal output on every machine.
//!
//! Slices that do not fit each other are a fault of the caller and panic; numbers are the caller's to check.

mod conditional;
mod hohct;
mod jcbb;
mod one_point;

use nalgebra::Matrix3;

use crate::chi2;
use crate::settings::{BatchTestKind, ValidateSettings};

pub use conditional::conditional_gate;
pub use hohct::{HohctSettings, hohct};
pub use jcbb::{JcbbSettings, jcbb};
pub use one_point::{OnePointSettings, one_point};

/// Most rows of a block.
const MAX_ROWS: usize = 3;

/// How the rows of a batch group into blocks.
#[derive(Clone, Copy, Debug)]
pub struct Blocks<'a> {
    offsets: &'a [usize],
}

impl<'a> Blocks<'a> {
    /// `offsets[i]` is the first row of block `i`; one more entry at the end holds the number of rows.
    ///
    /// # Panics
    /// If `offsets` is empty, does not start at 0, or a block does not have 1 to 3 rows.
    pub fn new(offsets: &'a [usize]) -> Self {
        assert!(offsets.first() == Some(&0), "row offsets must start at 0");
        assert!(
            offsets
                .windows(2)
                .all(|w| w[1] > w[0] && w[1] - w[0] <= MAX_ROWS),
            "a block has 1 to 3 rows"
        );
        Self { offsets }
    }

    /// Number of blocks.
    pub fn len(&self) -> usize {
        self.offsets.len() - 1
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Number of rows of all blocks together.
    pub fn rows(&self) -> usize {
        self.offsets[self.len()]
    }

    /// First row of a block.
    fn start(&self, block: usize) -> usize {
        self.offsets[block]
    }

    /// Number of rows of a block.
    fn count(&self, block: usize) -> usize {
        self.offsets[block + 1] - self.offsets[block]
    }
}

/// Everything a test may look at.
#[derive(Clone, Copy, Debug)]
pub struct Batch<'a> {
    /// Innovation covariance `S`, lower triangle, column-major.
    pub s: &'a [f64],
    /// Its Cholesky factor `L`, lower triangle, column-major.
    pub l: &'a [f64],
    /// Leading dimension of `s` and `l`.
    pub ld: usize,
    /// Innovation, one value per row.
    pub g: &'a [f64],
    /// Measurement noise of each block, in the leading rows and columns. Only [`one_point`] reads it.
    pub noise: &'a [Matrix3<f64>],
    /// The blocks.
    pub blocks: Blocks<'a>,
}

/// Outcome of a test. The rejected blocks are in [`Workspace::rejected`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Number of blocks rejected.
    pub order: usize,
    /// Joint squared Mahalanobis distance of the accepted blocks.
    pub d2: f64,
    /// Their degrees of freedom.
    pub dof: usize,
    /// Chi-square tail probability of `d2`; 1 if nothing is accepted.
    pub p_value: f64,
    /// Whether the answer is the one an exhaustive search gives; false if the node budget struck.
    pub exact: bool,
    /// Whether the accepted blocks may be used. False if no hypothesis could be accepted: then all are rejected.
    pub passed: bool,
    /// Number of hypotheses looked at, as the budget counts them.
    pub nodes: usize,
}

/// Choice of a test, with its settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum BatchTest {
    /// [`hohct`].
    Hohct(HohctSettings),
    /// [`jcbb`].
    Jcbb(JcbbSettings),
    /// [`one_point`].
    OnePoint(OnePointSettings),
    /// [`individual_gate`] at a level.
    Individual(f64),
    /// Accepts everything.
    None,
}

impl BatchTest {
    /// The test that the settings name.
    pub fn chosen(options: &ValidateSettings) -> Self {
        let &ValidateSettings {
            level, max_nodes, ..
        } = options;
        match options.test {
            BatchTestKind::Hohct => Self::Hohct(HohctSettings {
                level,
                max_nodes,
                max_share: options.max_share,
            }),
            BatchTestKind::Jcbb => Self::Jcbb(JcbbSettings { level, max_nodes }),
            BatchTestKind::OnePoint => Self::OnePoint(OnePointSettings {
                low_sigmas: options.low_sigmas,
                level,
            }),
            BatchTestKind::Individual => Self::Individual(level),
            BatchTestKind::None => Self::None,
        }
    }

    /// Runs the test on a batch.
    pub fn run(&self, batch: &Batch, ws: &mut Workspace) -> Verdict {
        let Batch {
            s,
            l,
            ld,
            g,
            noise,
            blocks,
        } = *batch;
        match self {
            Self::Hohct(settings) => hohct(s, l, ld, g, blocks, settings, ws),
            Self::Jcbb(settings) => jcbb(s, ld, g, blocks, settings, ws),
            Self::OnePoint(settings) => one_point(s, ld, g, noise, blocks, settings, ws),
            Self::Individual(level) => individual_gate(s, ld, g, blocks, *level, ws),
            Self::None => {
                ws.rejected.clear();
                let d2 = whiten(l, ld, g, &mut ws.whitened);
                Verdict::joint(0, d2, g.len(), true)
            }
        }
    }
}

impl Verdict {
    fn joint(order: usize, d2: f64, dof: usize, passed: bool) -> Self {
        Self {
            order,
            d2,
            dof,
            p_value: if dof == 0 {
                1.0
            } else {
                chi2::survival(d2, dof as f64)
            },
            exact: true,
            passed,
            nodes: 0,
        }
    }
}

/// Buffers of all tests, and the last rejected set.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    rejected: Vec<usize>,
    conditional_d2: Vec<f64>,
    whitened: Vec<f64>,
    quantiles: Quantiles,
    joint: Joint,
    hohct: hohct::Scratch,
    jcbb: jcbb::Scratch,
    one_point: one_point::Scratch,
}

impl Workspace {
    /// An empty workspace; its buffers grow with the batches it sees.
    pub fn new() -> Self {
        Self::default()
    }

    /// Blocks that the last test rejected, in increasing order.
    pub fn rejected(&self) -> &[usize] {
        &self.rejected
    }

    /// After [`conditional_gate`]: the squared distance of each block given all the others, infinite for those left out.
    pub fn conditional_d2(&self) -> &[f64] {
        &self.conditional_d2
    }

    fn reject_all(&mut self, blocks: Blocks) {
        self.rejected.clear();
        self.rejected.extend(0..blocks.len());
    }
}

/// Accepts each block whose own squared Mahalanobis distance `g_i^T S_ii^-1 g_i` is within the chi-square quantile at `level`.
///
/// `s` is `S` (lower triangle). The verdict's distance is the joint one of the accepted blocks.
pub fn individual_gate(
    s: &[f64],
    ld: usize,
    g: &[f64],
    blocks: Blocks,
    level: f64,
    ws: &mut Workspace,
) -> Verdict {
    reject_each(s, ld, g, blocks, level, ws);
    ws.joint.clear();
    let mut rejected = ws.rejected.iter().peekable();
    for block in 0..blocks.len() {
        if rejected.next_if_eq(&&block).is_none() {
            ws.joint.push(s, ld, g, blocks, block);
        }
    }
    let accepted = ws.rejected.len() < blocks.len() || blocks.is_empty();
    Verdict::joint(ws.rejected.len(), ws.joint.d2(), ws.joint.len(), accepted)
}

/// Rejects the blocks that [`individual_gate`] rejects, and asks no more of the others: O(m) in place of O(m^3).
pub(crate) fn reject_each(
    s: &[f64],
    ld: usize,
    g: &[f64],
    blocks: Blocks,
    level: f64,
    ws: &mut Workspace,
) {
    check(s, ld, g, blocks);
    ws.rejected.clear();
    for block in 0..blocks.len() {
        let limit = ws.quantiles.get(level, blocks.count(block));
        let distance = individual_distance(s, ld, g, blocks, block);
        if distance.is_nan() || distance > limit {
            ws.rejected.push(block);
        }
    }
}

/// `g_i^T S_ii^-1 g_i`; infinite if `S_ii` is not positive definite.
fn individual_distance(s: &[f64], ld: usize, g: &[f64], blocks: Blocks, block: usize) -> f64 {
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
fn block_distance(matrix: &[[f64; MAX_ROWS]; MAX_ROWS], v: &[f64]) -> f64 {
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
fn whiten(l: &[f64], ld: usize, g: &[f64], y: &mut Vec<f64>) -> f64 {
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

fn check(matrix: &[f64], ld: usize, g: &[f64], blocks: Blocks) {
    let m = g.len();
    assert_eq!(blocks.rows(), m, "row offsets must cover the innovation");
    assert!(ld >= m, "the leading dimension is below the number of rows");
    assert!(
        m == 0 || matrix.len() >= (m - 1) * ld + m,
        "the matrix is too short"
    );
}

/// Chi-square quantiles, worked out once per level and degree of freedom.
#[derive(Clone, Debug, Default)]
pub(crate) struct Quantiles {
    /// By level, and then by degrees of freedom; NaN where none was asked for.
    tables: Vec<(f64, Vec<f64>)>,
}

/// Levels that are remembered: more than a filter has.
const LEVELS: usize = 8;

impl Quantiles {
    pub(crate) fn get(&mut self, level: f64, dof: usize) -> f64 {
        let known = self.tables.iter().position(|table| table.0 == level);
        let at = known.unwrap_or_else(|| {
            if self.tables.len() == LEVELS {
                self.tables.clear();
            }
            self.tables.push((level, Vec::new()));
            self.tables.len() - 1
        });
        let values = &mut self.tables[at].1;
        if values.len() <= dof {
            values.resize(dof + 1, f64::NAN);
        }
        if values[dof].is_nan() {
            values[dof] = chi2::quantile(level, dof as f64);
        }
        values[dof]
    }
}

/// Joint distance of a growing and shrinking set of blocks: a Cholesky factor that rows are appended to and taken from.
///
/// Appending block `i` to a set `A` adds exactly the distance of `i` given `A`,
/// `r^T (S_ii - S_iA S_AA^-1 S_Ai)^-1 r` with `r = g_i - S_iA S_AA^-1 g_A`.
#[derive(Clone, Debug, Default)]
struct Joint {
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
    fn clear(&mut self) {
        self.truncate(0);
    }

    /// Number of rows.
    fn len(&self) -> usize {
        self.rows.len()
    }

    /// Goes back to the first `rows` rows.
    fn truncate(&mut self, rows: usize) {
        self.factor.truncate(rows * (rows + 1) / 2);
        self.rows.truncate(rows);
        self.y.truncate(rows);
        self.d2.truncate(rows);
    }

    fn d2(&self) -> f64 {
        self.d2.last().copied().unwrap_or(0.0)
    }

    /// Covariance (lower triangle, column-major) and innovation of the rows from `from` on, given those before.
    fn conditional(&self, from: usize, covariance: &mut Vec<f64>, innovation: &mut Vec<f64>) {
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
    fn push(&mut self, s: &[f64], ld: usize, g: &[f64], blocks: Blocks, block: usize) -> f64 {
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

/// Dot product with four running sums, which the compiler can keep in vector registers.
fn dot(a: &[f64], b: &[f64]) -> f64 {
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
