//! What the filter considers without estimating it: the worn cameras' biases and the error of the calibration.

use super::{BlockKind, State};
use nalgebra::{SMatrix, Vector6};

/// Six numbers of mean zero that are considered, not estimated (Schmidt's filter): the slowly varying part of T_CF's error,
/// and the error of Cs's calibration. Images say hardly anything about the first along the baseline, where it is an error of
/// scale, and about the second only what scene and motion happen to allow; an update would mostly fit errors of linearisation.
#[derive(Clone, Debug)]
pub(crate) struct Considered {
    /// Offset of its block.
    offset: usize,
    /// Its covariance; that of a bias is along C's axes.
    covariance: SMatrix<f64, 6, 6>,
}

impl State {
    /// Offset of the error of Cs's calibration, if it is considered.
    pub(crate) fn calibration(&self) -> Option<usize> {
        let block = self.layout.of_kind(BlockKind::Calibration).next();
        block.map(|b| b.offset)
    }

    /// Lists what is considered, before an update.
    pub(crate) fn consider(&self, out: &mut Vec<Considered>) {
        out.clear();
        let blocks = self.layout.blocks().iter();
        let blocks =
            blocks.filter(|b| matches!(b.kind, BlockKind::WornBias(_) | BlockKind::Calibration));
        out.extend(blocks.map(|block| Considered {
            offset: block.offset,
            covariance: self.p.block::<6, 6>(block.offset, block.offset),
        }));
    }

    /// Restores what is considered to its value before an update. Everything else was corrected with it in mind and stays
    /// correlated with it.
    pub(crate) fn keep_considered(&mut self, considered: &[Considered]) {
        for (k, block) in considered.iter().enumerate() {
            self.set_part(block.offset, &Vector6::zeros());
            self.p
                .set_block(block.offset, block.offset, &block.covariance);
            // They are independent of each other, whatever an update finds.
            for other in &considered[..k] {
                self.p
                    .set_block(other.offset, block.offset, &SMatrix::<f64, 6, 6>::zeros());
            }
        }
    }
}
