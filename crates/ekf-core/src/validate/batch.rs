//! What a test is given, and what it answers: a batch of matches and a verdict.

use crate::chi2;
use nalgebra::Matrix3;

/// Most rows of a block.
pub(super) const MAX_ROWS: usize = 3;

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
    pub(super) fn start(&self, block: usize) -> usize {
        self.offsets[block]
    }

    /// Number of rows of a block.
    pub(super) fn count(&self, block: usize) -> usize {
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
    /// Measurement noise of each block, in the leading rows and columns. Only [`one_point`](super::one_point()) reads it.
    pub noise: &'a [Matrix3<f64>],
    /// The blocks.
    pub blocks: Blocks<'a>,
}

/// Outcome of a test. The rejected blocks are in [`Workspace::rejected`](super::Workspace::rejected).
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

impl Verdict {
    pub(super) fn joint(order: usize, d2: f64, dof: usize, passed: bool) -> Self {
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

pub(super) fn check(matrix: &[f64], ld: usize, g: &[f64], blocks: Blocks) {
    let m = g.len();
    assert_eq!(blocks.rows(), m, "row offsets must cover the innovation");
    assert!(ld >= m, "the leading dimension is below the number of rows");
    assert!(
        m == 0 || matrix.len() >= (m - 1) * ld + m,
        "the matrix is too short"
    );
}
