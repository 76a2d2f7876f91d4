//! A whole state that is written some rows in each frame, from an outside set and the working state it had.

use super::buffers::{Buffers, product};
use crate::kernel::dot;
use crate::state::{Covariance, State};
use faer::linalg::matmul::matmul;
use faer::linalg::matmul::triangular::{self, BlockStructure};
use faer::{Accum, MatMut, MatRef, Par};
use std::ops::Range;
use std::sync::Arc;

/// What the rows of a new `then` that are not written yet are worked out from. Its first rows, those of the working state
/// before, are there from the start. Of two rows that follow, with `R`, `Phi` and `Psi` as they were when the set was chosen:
///
/// ```text
/// then_ij = (Phi R)_ij, i inside        then_ij = before_ij - R_i^T Psi R_j, both outside
/// ```
#[derive(Clone, Debug)]
pub(super) struct Renewal {
    /// The `then` of before.
    pub(super) before: Arc<State>,
    /// Rows of `then` that the working state of before had.
    pub(super) inside: usize,
    /// Row of `before` of each row of `then` that follows these, increasing.
    pub(super) rows: Vec<usize>,
    /// How many of them are written.
    pub(super) done: usize,
    /// Auxiliary rows of before.
    pub(super) depth: usize,
    /// `R`, column-major: `depth` numbers for each of `rows`.
    pub(super) r: Vec<f64>,
    /// `Phi^T`, column-major: `depth` numbers for each row inside.
    pub(super) phi: Vec<f64>,
    /// `-Psi`, `depth x depth`.
    pub(super) psi: Vec<f64>,
}

/// Frames in which a whole state is written. A working set lasts longer, as a rule; one that is full earlier waits.
const FRAMES: usize = 32;

/// Rows that are multiplied at a time: their share of the columns of P stays in the cache.
const PIECE: usize = 96;

impl Renewal {
    /// Whether a row of `then` is not written yet.
    pub(super) fn lacks(&self, row: usize) -> bool {
        row >= self.inside + self.done
    }

    /// Whether all rows are written.
    pub(super) fn is_done(&self) -> bool {
        self.done == self.rows.len()
    }

    /// Column of `R` of a row of `then` that is outside.
    pub(super) fn column(&self, row: usize) -> &[f64] {
        &self.r[(row - self.inside) * self.depth..][..self.depth]
    }

    /// Row of `Phi` of a row of `then` that was inside.
    pub(super) fn row_of_phi(&self, row: usize) -> &[f64] {
        &self.phi[row * self.depth..][..self.depth]
    }

    /// Cost of the first `rows` rows, multiplications and additions over `depth`: of `Psi R_i`, of `Phi R_i`, and of the
    /// products with the rows before.
    fn cost(&self, rows: usize) -> usize {
        rows * (self.depth + self.inside) + rows * rows.saturating_sub(1) / 2
    }

    /// Up to which row a frame writes: one part in [`FRAMES`] of the whole cost.
    pub(super) fn share(&self) -> usize {
        let wanted = self.cost(self.done) + self.cost(self.rows.len()).div_ceil(FRAMES);
        let rest = self.done..self.rows.len();
        let more = rest.take_while(|&row| self.cost(row) < wanted).count();
        self.done + more
    }

    /// Writes the rows up to `end`.
    pub(super) fn write(&mut self, then: &mut Covariance, end: usize, buffers: &mut Buffers) {
        while self.done < end {
            let rows = self.done..end.min(self.done + PIECE);
            self.done = rows.end;
            self.write_piece(then, rows, &mut buffers.psi_r);
        }
    }

    fn write_piece(&self, then: &mut Covariance, rows: Range<usize>, psi_r: &mut Vec<f64>) {
        let (depth, inside, width) = (self.depth, self.inside, rows.len());
        then.copy_rows(inside, &self.before.p, &self.rows, rows.clone());
        let columns = |range: Range<usize>| {
            let entries = &self.r[range.start * depth..range.end * depth];
            MatRef::from_column_major_slice(entries, depth, range.len())
        };
        psi_r.resize(depth * width, 0.0);
        product(
            MatMut::from_column_major_slice_mut(psi_r, depth, width),
            MatRef::from_column_major_slice(&self.psi, depth, depth),
            columns(rows.clone()),
        );
        let psi_r = MatRef::from_column_major_slice(psi_r, depth, width).transpose();
        let (n, (entries, ld)) = (inside + rows.end, then.entries());
        let all = MatMut::from_column_major_slice_with_stride_mut(entries, n, n, ld);
        let (_, written) = all.split_at_row_mut(inside + rows.start);
        let (cross, written) = written.split_at_col_mut(inside);
        let (earlier, own) = written.split_at_col_mut(rows.start);
        let phi = MatRef::from_column_major_slice(&self.phi, depth, inside);
        product(cross, columns(rows.clone()).transpose(), phi);
        let before = columns(0..rows.start);
        matmul(earlier, Accum::Add, psi_r, before, 1.0, Par::Seq);
        triangular::matmul(
            own,
            BlockStructure::TriangularLower,
            Accum::Add,
            psi_r,
            BlockStructure::Rectangular,
            columns(rows),
            BlockStructure::Rectangular,
            1.0,
            Par::Seq,
        );
    }

    /// For each of these rows of `then` the vector whose products with columns of `R` are what it has to do with rows outside,
    /// beyond what `before` says.
    fn factors(&self, rows: &[usize]) -> Vec<f64> {
        let mut factors = Vec::with_capacity(rows.len() * self.depth);
        for &row in rows {
            if row < self.inside {
                factors.extend_from_slice(self.row_of_phi(row));
            } else {
                let r = self.column(row);
                factors.extend(self.psi.chunks_exact(self.depth).map(|psi| dot(psi, r)));
            }
        }
        factors
    }
}

/// Some rows of `then`, whether they are written or not.
pub(super) struct SnapshotRows<'a> {
    then: &'a Covariance,
    rows: &'a [usize],
    renewal: Option<&'a Renewal>,
    factors: Vec<f64>,
    /// Products of the factors with all columns of `R`, if there are enough to read for that.
    products: Vec<f64>,
}

impl<'a> SnapshotRows<'a> {
    /// `all` if they are going to be read from end to end.
    pub(super) fn new(
        then: &'a Covariance,
        renewal: Option<&'a Renewal>,
        rows: &'a [usize],
        all: bool,
    ) -> Self {
        let renewal = renewal.filter(|renewal| !renewal.is_done());
        let factors = renewal.map_or_else(Vec::new, |renewal| renewal.factors(rows));
        let mut products = Vec::new();
        if let Some(Renewal {
            r, depth, rows: b, ..
        }) = renewal
            && all
        {
            products.resize(rows.len() * b.len(), 0.0);
            product(
                MatMut::from_column_major_slice_mut(&mut products, rows.len(), b.len()),
                MatRef::from_column_major_slice(&factors, *depth, rows.len()).transpose(),
                MatRef::from_column_major_slice(r, *depth, b.len()),
            );
        }
        Self {
            then,
            rows,
            renewal,
            factors,
            products,
        }
    }

    /// Entry of the `i`-th of the rows with any other.
    pub(super) fn entry(&self, i: usize, other: usize) -> f64 {
        let row = self.rows[i];
        let Some(renewal) = self.renewal.filter(|r| r.lacks(row.max(other))) else {
            return self.then.stored_entry(row, other);
        };
        if other < renewal.inside {
            return dot(renewal.row_of_phi(other), renewal.column(row));
        }
        let at = other - renewal.inside;
        let along = match self.products.get(at * self.rows.len() + i) {
            Some(&along) => along,
            None => {
                let factor = &self.factors[i * renewal.depth..][..renewal.depth];
                dot(factor, renewal.column(other))
            }
        };
        let base = row.checked_sub(renewal.inside).map_or(0.0, |row| {
            let before = &renewal.before.p;
            before.stored_entry(renewal.rows[row], renewal.rows[at])
        });
        base + along
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn renewal(inside: usize, outside: usize, depth: usize) -> Renewal {
        Renewal {
            before: Arc::new(State::at_origin(0)),
            inside,
            rows: (0..outside).collect(),
            done: 0,
            depth,
            r: Vec::new(),
            phi: Vec::new(),
            psi: Vec::new(),
        }
    }

    #[test]
    fn no_frame_writes_more_than_its_share_and_all_are_written_in_time() {
        for (inside, outside, depth) in [(400, 3300, 600), (60, 300, 90), (20, 7, 20), (20, 0, 20)]
        {
            let mut renewal = renewal(inside, outside, depth);
            let all = renewal.cost(outside);
            let mut frames = 0;
            while !renewal.is_done() {
                let end = renewal.share();
                assert!(
                    end > renewal.done,
                    "{outside} rows: one frame writes nothing"
                );
                // A row more, at most, than one part of all.
                let last = renewal.cost(end) - renewal.cost(end - 1);
                let cost = renewal.cost(end) - renewal.cost(renewal.done);
                assert!(cost < all.div_ceil(FRAMES) + last);
                renewal.done = end;
                frames += 1;
            }
            assert!(frames <= FRAMES, "{outside} rows: {frames} frames");
        }
    }
}
