//! How each feature of the map has done so far.

use super::innovation_window::InnovationWindow;
use serde::{Deserialize, Serialize};

/// How a feature has done so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct FeatureRecord {
    /// Frames in which it was searched.
    pub searched: usize,
    /// Frames in which an accepted match was found.
    pub found: usize,
    /// Time of the last accepted match, seconds.
    pub last_found: f64,
    /// How far it was off what the others say, in the last frames.
    pub window: InnovationWindow,
}
