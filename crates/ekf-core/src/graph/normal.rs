//! The normal equations of a graph, and their sparse factor.

use super::factor::{Factor, Linear};
use super::node::{Node, starts};
use crate::error::EkfError;
use faer::MatMut;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::{Llt, SymbolicLlt};
use faer::sparse::{Argsort, Pair, SparseColMat, SymbolicSparseColMat};
use nalgebra::{DMatrix, DVector};

/// `J^T J` as blocks below the diagonal, `-J^T r`, and `r^T r`.
pub(super) struct Normal {
    places: Vec<Pair<usize, usize>>,
    entries: Vec<f64>,
    pub(super) downhill: DVector<f64>,
    pub(super) cost: f64,
    n: usize,
}

impl Normal {
    pub(super) fn of(nodes: &[Node], factors: &[Factor]) -> Self {
        let (starts, n) = (starts(nodes), nodes.iter().map(Node::dim).sum());
        let mut normal = Self {
            places: Vec::new(),
            entries: Vec::new(),
            downhill: DVector::zeros(n),
            cost: 0.0,
            n,
        };
        for factor in factors {
            let Linear {
                residual,
                by_first,
                by_second,
            } = factor.linear(nodes);
            normal.cost += residual.norm_squared();
            let sides = [
                factor.first.map(|i| (starts[i], &by_first)),
                Some((starts[factor.second], &by_second)),
            ];
            for (i, rows) in sides.iter().flatten() {
                let mut down = normal.downhill.rows_mut(*i, rows.ncols());
                down -= rows.tr_mul(&residual);
                for (j, columns) in sides.iter().flatten().filter(|(j, _)| j <= i) {
                    normal.add(*i, *j, &rows.tr_mul(*columns));
                }
            }
        }
        normal
    }

    /// The block whose first entry is at this row and column.
    fn add(&mut self, row: usize, column: usize, block: &DMatrix<f64>) {
        for c in 0..block.ncols() {
            for r in if row == column { c } else { 0 }..block.nrows() {
                self.places.push(Pair::new(row + r, column + c));
                self.entries.push(block[(r, c)]);
            }
        }
    }

    /// Where the numbers of `J^T J` and of its factor are: the same wherever the nodes of a graph stand.
    pub(super) fn pattern(&self) -> Result<Pattern, EkfError> {
        let (matrix, order) =
            SymbolicSparseColMat::try_new_from_indices(self.n, self.n, &self.places)
                .map_err(|_| TIED_TO_NOTHING)?;
        let factor = SymbolicLlt::try_new(matrix.as_ref(), faer::Side::Lower)
            .map_err(|_| TIED_TO_NOTHING)?;
        Ok(Pattern {
            matrix,
            order,
            factor,
        })
    }

    /// The factor of `J^T J`, with its diagonal larger by the share `damping`.
    pub(super) fn factored(&self, pattern: &Pattern, damping: f64) -> Result<Factored, EkfError> {
        let damped = self.places.iter().zip(&self.entries).map(|(at, entry)| {
            let grown = if at.row == at.col { 1.0 + damping } else { 1.0 };
            entry * grown
        });
        let entries: Vec<f64> = damped.collect();
        let symbolic = pattern.matrix.clone();
        let matrix = SparseColMat::new_from_argsort(symbolic, &pattern.order, &entries)
            .map_err(|_| TIED_TO_NOTHING)?;
        let symbolic = pattern.factor.clone();
        let llt = Llt::try_new_with_symbolic(symbolic, matrix.as_ref(), faer::Side::Lower)
            .map_err(|_| TIED_TO_NOTHING)?;
        Ok(Factored { llt, n: self.n })
    }
}

const TIED_TO_NOTHING: EkfError = EkfError::NotPositiveDefinite {
    stage: "graph of poses, of which some part is tied to nothing",
    pivot: 0,
};

/// Which numbers of the normal equations and of their factor are not zero.
pub(super) struct Pattern {
    matrix: SymbolicSparseColMat<usize>,
    order: Argsort<usize>,
    factor: SymbolicLlt<usize>,
}

/// A sparse Cholesky factor.
#[derive(Debug)]
pub(super) struct Factored {
    llt: Llt<usize, f64>,
    n: usize,
}

impl Factored {
    /// Solves for some right-hand sides in place.
    pub(super) fn solve(&self, rhs: &mut DMatrix<f64>) {
        let columns = rhs.ncols();
        let rhs = MatMut::from_column_major_slice_mut(rhs.as_mut_slice(), self.n, columns);
        self.llt.solve_in_place(rhs);
    }
}
