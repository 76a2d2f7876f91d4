//! The readout of Cs in the state: how long its shutter takes from the first row to the last one (METHOD 4).

use super::{Block, BlockKind, State};
use nalgebra::SMatrix;

impl State {
    /// Its block, unless the shutter is known not to roll.
    pub(crate) fn readout_block(&self) -> Option<&Block> {
        self.layout.of_kind(BlockKind::Readout).next()
    }

    /// Appends it: mean and standard deviation, seconds.
    pub(crate) fn append_readout(&mut self, (readout, sd): (f64, f64)) {
        let (mean, variance) = (SMatrix::from([[readout]]), SMatrix::from([[sd * sd]]));
        self.append(BlockKind::Readout, &mean, &[], &variance);
    }
}
