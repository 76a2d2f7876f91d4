//! What a checkpoint of the filter holds, see [`Filter::checkpoint`](crate::filter::Filter::checkpoint).

use super::Memory;
use crate::local::{OutsideMark, OutsideSet};

/// The last checkpoint, and what was given up since.
#[derive(Debug, Default)]
pub(crate) struct Undo {
    pub(crate) kept: Option<Box<Kept>>,
    /// The outside set of the checkpoint, if another one has taken its place.
    pub(crate) given_up: Option<OutsideSet>,
}

/// What the filter remembered, and where its outside set stood.
#[derive(Debug, Default)]
pub(crate) struct Kept {
    /// All but what is outside of the working set.
    pub(crate) memory: Memory,
    pub(crate) outside: Option<OutsideMark>,
}

impl Clone for Undo {
    /// A copy of a filter begins without a checkpoint.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Undo {
    /// Whether the outside set that the filter has now is that of a checkpoint, and must outlive it.
    pub(crate) fn needs_outside(&self) -> bool {
        let had_one = |kept: &Kept| kept.outside.is_some();
        self.given_up.is_none() && self.kept.as_deref().is_some_and(had_one)
    }

    /// The filter gives up its outside set, which is put by if it is that of a checkpoint.
    pub(crate) fn put_by(&mut self, outside: OutsideSet) {
        if self.needs_outside() {
            self.given_up = Some(outside);
        }
    }
}
