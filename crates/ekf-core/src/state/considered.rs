//! What the filter considers and hardly estimates: the worn cameras' biases and clocks, how a gyroscope sits, and the error of the
//! calibration.

use super::{Block, BlockKind, State};
use nalgebra::{Matrix6, SMatrix, Vector6};

/// Numbers of the largest block that is considered; a smaller one has zeros in the place of the rest.
const WIDEST: usize = 6;

/// Blocks that are considered, not estimated (Schmidt's filter): the slowly varying part of T_CF's error, the worn cameras' clocks,
/// and the error of Cs's calibration. Images say hardly anything about the first along the baseline, where it is an error of scale,
/// about the second only where Cs changes its motion, and about the third only what scene and motion happen to allow; an update would
/// mostly fit errors of linearisation. What a view says of them after all is learned ([`Learned`]).
#[derive(Clone, Debug, Default)]
pub(crate) struct Considered {
    blocks: Vec<(Block, Vector6<f64>)>,
    /// Covariances of each block with those before it and with itself.
    covariances: Vec<Matrix6<f64>>,
    /// Error modes of each block, row by row.
    modes: Vec<f64>,
}

/// What an update may learn of considered blocks (METHOD 6).
#[derive(Clone, Debug, Default)]
pub(crate) struct Learned {
    /// Offsets of the blocks, each with what its gain is multiplied by.
    pub(crate) of: Vec<(usize, Matrix6<f64>)>,
}

impl Learned {
    /// All that the update says of one number.
    pub(crate) fn number(&mut self, offset: usize) {
        self.share(offset, 1.0);
    }

    /// A share of what the update says of one number.
    pub(crate) fn share(&mut self, offset: usize, share: f64) {
        let mut part = Matrix6::zeros();
        part[(0, 0)] = share;
        self.of.push((offset, part));
    }

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

    /// Lists what is considered, before an update, and what else it may not tell wholly.
    pub(crate) fn consider(&self, learned: &Learned, out: &mut Considered) {
        out.blocks.clear();
        out.covariances.clear();
        out.modes.clear();
        let modes = self.error_modes();
        for block in self.layout.blocks() {
            if !block.kind.is_considered() && learned.by(block.offset).is_none() {
                continue;
            }
            out.blocks.push((*block, self.numbers(block)));
            for (other, _) in &out.blocks {
                out.covariances.push(self.between(block, other));
            }
            if let Some(modes) = &modes {
                for i in block.range() {
                    out.modes.extend(modes.range().map(|k| self.p.get(i, k)));
                }
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
        let modes = self.error_modes();
        let mut at = 0;
        for (k, (block, mean)) in considered.blocks.iter().enumerate() {
            let by = learned.by(block.offset);
            let step = by.map(|by| by * (self.numbers(block) - mean));
            let kept = mean + step.unwrap_or_default();
            self.x[block.range()].copy_from_slice(&kept.as_slice()[..block.kind.dim()]);
            if let Some(modes) = &modes {
                for k in modes.range() {
                    let dim = block.kind.dim();
                    let before = Vector6::from_fn(|i, _| {
                        if i < dim {
                            considered.modes[at + i * modes.kind.dim() + k - modes.offset]
                        } else {
                            0.0
                        }
                    });
                    let now = Vector6::from_fn(|i, _| {
                        if i < dim {
                            self.p.get(block.offset + i, k)
                        } else {
                            0.0
                        }
                    });
                    let kept = before + by.map(|by| by * (now - before)).unwrap_or_default();
                    for i in 0..dim {
                        self.p.set(block.offset + i, k, kept[i]);
                    }
                }
                at += block.kind.dim() * modes.kind.dim();
            }
            for ((other, _), before) in considered.blocks[..=k].iter().zip(&mut covariances) {
                let taken = before - self.between(block, other);
                let mut kept = *before;
                if let Some(by) = by {
                    kept -= by * taken;
                }
                if let Some(other) = learned.by(other.offset) {
                    let rest = by.map_or(taken, |by| taken - by * taken);
                    kept -= rest * other.transpose();
                }
                self.set_between(block, other, &kept);
            }
        }
    }

    fn numbers(&self, block: &Block) -> Vector6<f64> {
        let own = &self.x[block.range()];
        Vector6::from_fn(|i, _| own.get(i).copied().unwrap_or(0.0))
    }

    fn between(&self, block: &Block, other: &Block) -> Matrix6<f64> {
        let (rows, columns) = (block.kind.dim(), other.kind.dim());
        SMatrix::<f64, WIDEST, WIDEST>::from_fn(|i, j| {
            if i < rows && j < columns {
                self.p.get(block.offset + i, other.offset + j)
            } else {
                0.0
            }
        })
    }

    fn set_between(&mut self, block: &Block, other: &Block, value: &Matrix6<f64>) {
        for j in 0..other.kind.dim() {
            for i in 0..block.kind.dim() {
                self.p
                    .set(block.offset + i, other.offset + j, value[(i, j)]);
            }
        }
    }
}
