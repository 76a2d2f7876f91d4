//! What a checkpoint of the filter holds, see [`Filter::checkpoint`](super::Filter::checkpoint).

use super::candidate::Candidate;
use super::handed::Handover;
use super::pose_ring::KeptPoses;
use super::record::FeatureRecord;
use super::wheels::Wheels;
use crate::local::{OutsideMark, OutsideSet};
use crate::misfit::Misfit;
use crate::odometry::Odometry;
use crate::placed::Placed;
use crate::state::State;
use std::collections::BTreeMap;

/// The last checkpoint, and what was given up since.
#[derive(Debug, Default)]
pub(super) struct Undo {
    pub(super) kept: Option<Box<Kept>>,
    /// The outside set of the checkpoint, if another one has taken its place.
    pub(super) given_up: Option<OutsideSet>,
}

impl Clone for Undo {
    /// A copy of a filter begins without a checkpoint.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Undo {
    /// Whether the outside set that the filter has now is that of a checkpoint, and must outlive it.
    pub(super) fn needs_outside(&self) -> bool {
        let had_one = |kept: &Kept| kept.outside.is_some();
        self.given_up.is_none() && self.kept.as_deref().is_some_and(had_one)
    }

    /// The filter gives up its outside set, which is put by if it is that of a checkpoint.
    pub(super) fn put_by(&mut self, outside: OutsideSet) {
        if self.needs_outside() {
            self.given_up = Some(outside);
        }
    }
}

/// All that is the filter's own: what a snapshot holds, but for what never changes.
#[derive(Debug)]
pub(super) struct Kept {
    pub(super) state: State,
    pub(super) time: Option<f64>,
    pub(super) started: bool,
    pub(super) records: BTreeMap<u64, FeatureRecord>,
    pub(super) candidates: BTreeMap<u64, Candidate>,
    pub(super) next_candidate: u64,
    pub(super) kept_poses: KeptPoses,
    pub(super) placed: Placed,
    pub(super) handover: Handover,
    pub(super) misfit: Misfit,
    pub(super) odometry: Odometry,
    pub(super) wheels: Wheels,
    pub(super) moved_by: f64,
    pub(super) followed: Vec<u64>,
    pub(super) outside: Option<OutsideMark>,
}
