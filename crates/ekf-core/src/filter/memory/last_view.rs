//! When each worn camera was last seen from, by which overlaps begin (METHOD 6).

use crate::error::EkfError;
use serde::{Deserialize, Serialize};

/// Time without a view after which another overlap begins, seconds.
const GAP: f64 = 1.0;

/// When a worn camera's last view was used.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LastView {
    pub(crate) who: usize,
    /// Seconds.
    pub(crate) t: f64,
}

impl LastView {
    /// Whether a view of that worn camera at `t` belongs to the same overlap.
    pub(crate) fn goes_on(&self, t: f64) -> bool {
        t - self.t <= GAP
    }

    /// Whether what a snapshot says can be.
    pub(crate) fn check(&self) -> Result<(), EkfError> {
        if self.t.is_finite() {
            return Ok(());
        }
        Err(EkfError::bad_snapshot("its last view of Cf has no time"))
    }
}
