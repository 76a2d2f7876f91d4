//! What the filter considers without estimating it: the worn camera's bias and the error of the calibration.

use super::{BlockKind, State};
use nalgebra::{SMatrix, Vector6};

/// Six numbers of mean zero that are considered, not estimated (Schmidt's filter): the slowly varying part of T_CF's error,
/// and the error of Cs's calibration. Images say hardly anything about the first along the baseline, where it is an error of
/// scale, and about the second only what scene and motion happen to allow; an update would mostly fit errors of linearisation.
#[derive(Clone, Debug)]
pub(crate) struct Considered {
    /// Offset of its block.
    pub(crate) offset: usize,
    /// Its covariance; that of the bias is along C's axes.
    pub(crate) covariance: SMatrix<f64, 6, 6>,
}

impl State {
    /// The worn camera's bias, if there is one.
    pub(crate) fn worn_bias(&self) -> Option<Considered> {
        self.considered_of(BlockKind::WornBias)
    }

    /// Offset of the error of Cs's calibration, if it is considered.
    pub(crate) fn calibration(&self) -> Option<usize> {
        let block = self.layout.of_kind(BlockKind::Calibration).next();
        block.map(|b| b.offset)
    }

    /// What is considered, before an update.
    pub(crate) fn considered(&self) -> [Option<Considered>; 2] {
        [BlockKind::Calibration, BlockKind::WornBias].map(|kind| self.considered_of(kind))
    }

    fn considered_of(&self, kind: BlockKind) -> Option<Considered> {
        let block = self.layout.of_kind(kind).next()?;
        Some(Considered {
            offset: block.offset,
            covariance: self.p.block::<6, 6>(block.offset, block.offset),
        })
    }

    /// Restores what is considered to its value before an update. Everything else was corrected with it in mind and stays
    /// correlated with it.
    pub(crate) fn keep_considered(&mut self, considered: &[Option<Considered>; 2]) {
        for block in considered.iter().flatten() {
            self.set_part(block.offset, &Vector6::zeros());
            self.p
                .set_block(block.offset, block.offset, &block.covariance);
        }
        if let [Some(a), Some(b)] = considered {
            // The two are independent, whatever an update finds.
            self.p
                .set_block(a.offset, b.offset, &SMatrix::<f64, 6, 6>::zeros());
        }
    }
}
