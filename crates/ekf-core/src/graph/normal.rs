//! The normal equations of a graph, and their sparse factor.

use super::factor::Linear;
use super::{NODE, PoseGraph};
use crate::error::EkfError;
use faer::MatMut;
use faer::linalg::solvers::Solve;
use faer::sparse::linalg::solvers::Llt;
use faer::sparse::{SparseColMat, Triplet};
use nalgebra::{DMatrix, DVector, SMatrix};

/// `J^T J` as blocks below the diagonal, `-J^T r`, and `r^T r`.
pub(super) struct Normal {
    entries: Vec<Triplet<usize, usize, f64>>,
    pub(super) downhill: DVector<f64>,
    pub(super) cost: f64,
    n: usize,
}

impl Normal {
    pub(super) fn of(graph: &PoseGraph) -> Self {
        let n = NODE * graph.nodes().len();
        let mut normal = Self {
            entries: Vec::new(),
            downhill: DVector::zeros(n),
            cost: 0.0,
            n,
        };
        for factor in graph.factors() {
            let Linear {
                residual,
                by_first,
                by_second,
            } = factor.linear(graph.nodes());
            normal.cost += residual.norm_squared();
            let sides = [
                factor.first.map(|i| (i, &by_first)),
                Some((factor.second, &by_second)),
            ];
            for (i, rows) in sides.iter().flatten() {
                let mut down = normal.downhill.rows_mut(NODE * i, NODE);
                down -= rows.tr_mul(&residual);
                for (j, columns) in sides.iter().flatten().filter(|(j, _)| j <= i) {
                    normal.add(*i, *j, &rows.tr_mul(*columns));
                }
            }
        }
        normal
    }

    fn add(&mut self, i: usize, j: usize, block: &SMatrix<f64, NODE, NODE>) {
        for c in 0..NODE {
            for r in if i == j { c } else { 0 }..NODE {
                let (row, column) = (NODE * i + r, NODE * j + c);
                self.entries.push(Triplet::new(row, column, block[(r, c)]));
            }
        }
    }

    /// The factor of `J^T J`, with its diagonal larger by the share `damping`.
    pub(super) fn factored(&self, damping: f64) -> Result<Factored, EkfError> {
        let damped = self.entries.iter().map(|e| {
            let grown = if e.row == e.col { 1.0 + damping } else { 1.0 };
            Triplet::new(e.row, e.col, e.val * grown)
        });
        let entries: Vec<_> = damped.collect();
        let invalid = || EkfError::NotPositiveDefinite {
            stage: "graph of poses, of which some part is tied to nothing",
            pivot: 0,
        };
        let matrix = SparseColMat::<usize, f64>::try_new_from_triplets(self.n, self.n, &entries)
            .map_err(|_| invalid())?;
        let llt = matrix
            .sp_cholesky(faer::Side::Lower)
            .map_err(|_| invalid())?;
        Ok(Factored { llt, n: self.n })
    }

    /// The cost alone.
    pub(super) fn cost(graph: &PoseGraph) -> f64 {
        let residuals = graph.factors().iter().map(|f| f.linear(graph.nodes()));
        residuals.map(|l| l.residual.norm_squared()).sum()
    }
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
