//! What a filter remembers of the views that its map was transferred in (METHOD 20).

use crate::error::EkfError;
use crate::nis_accumulator::NisAccumulator;
use crate::observe::point::CameraPose;
use serde::{Deserialize, Serialize};

/// Where the map was last transferred.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LastTransfer {
    /// Landmarks born before this id were there.
    pub(crate) until: u64,
    pub(crate) pose: CameraPose,
    /// Of the updates until then.
    pub(crate) nis: NisAccumulator,
}

/// What has been transferred so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct MapTransfer {
    /// `None` before the first frame after a start.
    pub(crate) last: Option<LastTransfer>,
    /// Landmarks before this id are a known map's: they are where W is.
    pub(crate) known: u64,
}

impl MapTransfer {
    /// Whether what a snapshot says can be; `now` is the NIS of all updates.
    pub(crate) fn check(&self, now: &NisAccumulator) -> Result<(), EkfError> {
        let Some(last) = &self.last else {
            return Ok(());
        };
        if (last.pose.q.norm() - 1.0).abs() > 1e-6 {
            return Err(EkfError::bad_snapshot("its last view is impossible"));
        }
        last.nis.check(now)
    }
}
