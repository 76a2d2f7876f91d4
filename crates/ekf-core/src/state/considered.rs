//! What the filter considers and hardly estimates: the worn cameras' biases and the error of the calibration.

use super::{BlockKind, State};
use nalgebra::{Matrix6, Vector6};

/// Blocks of six numbers that are considered, not estimated (Schmidt's filter): the slowly varying part of T_CF's error, and the
/// error of Cs's calibration. Images say hardly anything about the first along the baseline, where it is an error of scale, and
/// about the second only what scene and motion happen to allow; an update would mostly fit errors of linearisation. What else a
/// view says of its own bias is learned ([`Learned`]).
#[derive(Clone, Debug, Default)]
pub(crate) struct Considered {
    blocks: Vec<(usize, Vector6<f64>)>,
    /// Covariances of each block with those before it and with itself.
    covariances: Vec<Matrix6<f64>>,
}

/// What an update may learn of considered blocks (METHOD 6).
#[derive(Clone, Debug, Default)]
pub(crate) struct Learned {
    /// Offsets of the blocks, each with what its gain is multiplied by.
    pub(crate) of: Vec<(usize, Matrix6<f64>)>,
}

impl Learned {
    fn by(&self, offset: usize) -> Option<&Matrix6<f64>> {
        let mut of = self.of.iter();
        of.find(|(at, _)| *at == offset).map(|(_, by)| by)
    }
}

impl State {
    /// Offset of the error of Cs's calibration, if it is considered.
    pub(crate) fn calibration(&self) -> Option<usize> {
        let block = self.layout.of_kind(BlockKind::Calibration).next();
        block.map(|b| b.offset)
    }

    /// Lists what is considered, before an update.
    pub(crate) fn consider(&self, out: &mut Considered) {
        out.blocks.clear();
        out.covariances.clear();
        for block in self.layout.blocks() {
            if !matches!(block.kind, BlockKind::WornBias(_) | BlockKind::Calibration) {
                continue;
            }
            out.blocks
                .push((block.offset, self.part::<6>(block.offset)));
            for (other, _) in &out.blocks {
                out.covariances.push(self.p.block(block.offset, *other));
            }
        }
    }

    /// Puts what is considered back to its value before an update, but for what is `learned`. Everything else was corrected with
    /// it in mind and stays correlated with it.
    ///
    /// With A what the optimal gains take off a block of P, gains multiplied by U and V leave `P - U A - A V^T + U A V^T`,
    /// whatever these are (Joseph's form).
    pub(crate) fn keep_considered(&mut self, considered: &Considered, learned: &Learned) {
        let mut covariances = considered.covariances.iter();
        for (k, (offset, mean)) in considered.blocks.iter().enumerate() {
            let by = learned.by(*offset);
            let step = by.map(|by| by * (self.part::<6>(*offset) - mean));
            self.set_part(*offset, &(mean + step.unwrap_or_default()));
            for ((other, _), before) in considered.blocks[..=k].iter().zip(&mut covariances) {
                let taken = before - self.p.block::<6, 6>(*offset, *other);
                let mut kept = *before;
                if let Some(by) = by {
                    kept -= by * taken;
                }
                if let Some(other) = learned.by(*other) {
                    let rest = by.map_or(taken, |by| taken - by * taken);
                    kept -= rest * other.transpose();
                }
                self.p.set_block(*offset, *other, &kept);
            }
        }
    }
}
