//! What a checkpoint of the filter holds, see [`Filter::checkpoint`](crate::filter::Filter::checkpoint).

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
pub(crate) struct Undo {
    pub(crate) kept: Option<Box<Kept>>,
    /// The outside set of the checkpoint, if another one has taken its place.
    pub(crate) given_up: Option<OutsideSet>,
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

/// All that is the filter's own: what a snapshot holds, but for what never changes.
#[derive(Debug)]
pub(crate) struct Kept {
    pub(crate) state: State,
    pub(crate) time: Option<f64>,
    pub(crate) started: bool,
    pub(crate) records: BTreeMap<u64, FeatureRecord>,
    pub(crate) candidates: BTreeMap<u64, Candidate>,
    pub(crate) next_candidate: u64,
    pub(crate) kept_poses: KeptPoses,
    pub(crate) placed: Placed,
    pub(crate) handover: Handover,
    pub(crate) misfit: Misfit,
    pub(crate) odometry: Odometry,
    pub(crate) wheels: Wheels,
    pub(crate) moved_by: f64,
    pub(crate) followed: Vec<u64>,
    pub(crate) outside: Option<OutsideMark>,
}
