//! The poses that are kept for late views of Cf, by their blocks, and when the views were taken that were measured (METHOD
//! 21).

use crate::error::EkfError;
use crate::state::{BlockKind, Layout};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Poses that are kept at most: AIM REACH / SPACING, and both ends.
pub const MOST_KEPT_POSES: usize = 18;
/// Times of measured views that are remembered, to know one that is sent again.
const REMEMBERED: usize = 64;

/// The poses that are kept, and the views that were measured.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct KeptPoses {
    /// Time and block of each, the oldest first.
    pub(crate) poses: Vec<(f64, u64)>,
    /// Of which worn camera and when the views were taken that were measured last, in the order in which they were.
    pub(crate) measured: Vec<(usize, f64)>,
}

impl KeptPoses {
    /// Their blocks.
    pub(crate) fn ids(&self) -> impl Iterator<Item = u64> {
        self.poses.iter().map(|(_, id)| *id)
    }

    pub(crate) fn remember(&mut self, who: usize, t: f64) {
        if self.measured.len() == REMEMBERED {
            self.measured.remove(0);
        }
        self.measured.push((who, t));
    }

    /// Whether what a snapshot says can be; `last` is the largest time stamp.
    pub(crate) fn check(
        &self,
        layout: &Layout,
        now: Option<f64>,
        last: f64,
    ) -> Result<(), EkfError> {
        let now = now.unwrap_or(f64::NEG_INFINITY);
        let ids: BTreeSet<u64> = self.ids().collect();
        let is_clone = |id: &u64| layout.find(*id).is_some_and(|b| b.kind == BlockKind::Clone);
        let increasing = self.poses.windows(2).all(|w| w[0].0 < w[1].0);
        let times = self
            .poses
            .iter()
            .map(|(t, _)| t)
            .chain(self.measured.iter().map(|(_, t)| t));
        let sane = times.clone().all(|t| t.is_finite() && t.abs() <= last)
            && self.poses.last().is_none_or(|(t, _)| *t <= now);
        if increasing
            && sane
            && ids.iter().all(is_clone)
            && ids.len() == self.poses.len()
            && self.poses.len() <= MOST_KEPT_POSES
            && self.measured.len() <= REMEMBERED
        {
            return Ok(());
        }
        Err(EkfError::bad_snapshot(
            "the poses that it keeps are impossible",
        ))
    }
}
