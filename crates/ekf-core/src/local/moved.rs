//! Columns of `R`, and how far rows outside have moved, whether they are written or not.

use super::outside_set::{Auxiliary, OutsideSet};
use super::renewal::Renewal;
use crate::kernel::dot;
use crate::state::State;

/// How far rows of `then` have moved: `R^T theta`.
pub(super) struct Moved<'a> {
    set: &'a OutsideSet,
    theta: Vec<f64>,
    /// The same by the columns of a renewal's `R`: `Phi^T theta` over the rows that are still inside.
    through: Vec<f64>,
}

impl Moved<'_> {
    pub(super) fn of(&self, row: usize) -> f64 {
        let (set, first) = (self.set, self.set.reference.len());
        let column = set.column(row, self.theta.len());
        match set.lacking(row) {
            Some(renewal) => {
                let later = dot(&self.theta[first..], &column[first..]);
                dot(&self.through, renewal.column(row)) + later
            }
            None => dot(&self.theta, column),
        }
    }
}

impl OutsideSet {
    pub(super) fn moved(&self, working: &State) -> Moved<'_> {
        let theta = Auxiliary::of(working).theta(working);
        let mut through = Vec::new();
        if let Some(renewal) = self.renewal.as_ref().filter(|renewal| !renewal.is_done()) {
            through.resize(renewal.depth, 0.0);
            for (&row, by) in self.reference.iter().zip(&theta) {
                for (sum, phi) in through.iter_mut().zip(renewal.row_of_phi(row)) {
                    *sum += by * phi;
                }
            }
        }
        Moved {
            set: self,
            theta,
            through,
        }
    }

    /// Columns of `R` of these rows, one after the other.
    pub(super) fn columns_of(&self, rows: &[usize], auxiliary: usize) -> Vec<f64> {
        let mut columns = Vec::with_capacity(auxiliary * rows.len());
        for &row in rows {
            let at = columns.len();
            columns.extend_from_slice(self.column(row, auxiliary));
            if let Some(renewal) = self.lacking(row) {
                let column = renewal.column(row);
                for (value, &a) in columns[at..].iter_mut().zip(&self.reference) {
                    *value = dot(renewal.row_of_phi(a), column);
                }
            }
        }
        columns
    }

    /// The renewal, if it has not written this row yet.
    fn lacking(&self, row: usize) -> Option<&Renewal> {
        self.renewal.as_ref().filter(|renewal| renewal.lacks(row))
    }
}
