//! Undoing: a checkpoint of the filter in memory, and the way back to it.
//!
//! A frame takes several calls, and the caller may be interrupted between any two. The copy costs one pass over the stored
//! triangle of P, into memory that is already there. What is outside of the working set is not copied: a frame only adds
//! rows to it, which an earlier state does not read; if another set replaces it, the old one is kept until the next
//! checkpoint.

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::local::OutsideSet;

impl Filter {
    /// Remembers the filter as it is, for [`Self::rollback`]; an earlier checkpoint is forgotten. O(n^2), one pass.
    pub fn checkpoint(&mut self) {
        let (memory, undo) = (&mut self.memory, &mut self.undo);
        let buffers = &mut self.workspace.buffers;
        let mut kept = undo.kept.take().unwrap_or_default();
        kept.memory.copy_from(memory);
        if let Some(given_up) = undo.given_up.take() {
            given_up.give_up(buffers);
        }
        if let Some(outside) = &mut memory.outside {
            outside.settle(buffers);
        }
        kept.outside = memory.outside.as_ref().map(OutsideSet::mark);
        undo.kept = Some(kept);
    }

    /// Makes the filter what it was at the last checkpoint, bit for bit. The checkpoint stays: this may be repeated.
    ///
    /// # Errors
    /// `InvalidInput` if there has been no checkpoint.
    pub fn rollback(&mut self) -> Result<(), EkfError> {
        self.changes();
        let Some(kept) = self.undo.kept.as_deref() else {
            return Err(EkfError::InvalidInput {
                what: "rollback",
                why: "there is no checkpoint to go back to; make one first".into(),
            });
        };
        let outside = self.undo.given_up.take().or(self.memory.outside.take());
        self.memory.copy_from(&kept.memory);
        self.memory.outside = kept
            .outside
            .as_ref()
            .zip(outside)
            .map(|(mark, mut outside)| {
                outside.go_back(mark);
                outside
            });
        Ok(())
    }

    /// Remembers what another filter of the same setup does; what this one did at its checkpoint stays within reach.
    pub(crate) fn become_other(&mut self, other: Self) {
        self.changes();
        if let Some(outside) = self.memory.outside.take() {
            self.undo.put_by(outside);
        }
        self.memory = other.memory;
    }
}
