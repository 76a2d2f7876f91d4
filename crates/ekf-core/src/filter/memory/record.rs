//! The record of a feature: how often it was searched and found.

use serde::{Deserialize, Serialize};

/// How often a feature was searched and found.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct FeatureRecord {
    /// Frames in which it was searched.
    pub searched: usize,
    /// Frames in which an accepted match was found.
    pub found: usize,
    /// Time of the last accepted match, seconds.
    pub last_found: f64,
}
