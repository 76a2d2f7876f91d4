//! Undoing: a checkpoint of the filter in memory, and the way back to it.
//!
//! A frame takes several calls, and the caller may be interrupted between any two. The copy costs one pass over the stored
//! triangle of P, into memory that is already there. What is outside of the working set is not copied: a frame only adds
//! rows to it, which an earlier state does not read; if another set replaces it, the old one is kept until the next
//! checkpoint.

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::memory::undo::Kept;
use crate::local::OutsideSet;
use crate::state::State;

impl Filter {
    /// Remembers the filter as it is, for [`Self::rollback`]; an earlier checkpoint is forgotten. O(n^2), one pass.
    pub fn checkpoint(&mut self) {
        let Self {
            state,
            time,
            started,
            records,
            candidates,
            next_candidate,
            kept_poses,
            batch,
            placed,
            handover,
            misfit,
            odometry,
            wheels,
            gauge,
            outside,
            buffers,
            undo,
            // What never changes, buffers, and what is worked out again when it is asked for.
            settings: _,
            camera: _,
            worn_cameras: _,
            test: _,
            in_view: _,
            scratch: _,
            shown: _,
        } = self;
        let mut copy = match undo.kept.take() {
            Some(kept) => kept.state,
            None => State::at_origin(0),
        };
        copy.copy_from(state);
        if let Some(given_up) = undo.given_up.take() {
            given_up.give_up(buffers);
        }
        if let Some(outside) = outside {
            outside.settle(buffers);
        }
        undo.kept = Some(Box::new(Kept {
            state: copy,
            time: *time,
            started: *started,
            records: records.clone(),
            candidates: candidates.clone(),
            next_candidate: *next_candidate,
            kept_poses: kept_poses.clone(),
            placed: *placed,
            handover: *handover,
            misfit: *misfit,
            odometry: odometry.clone(),
            wheels: *wheels,
            moved_by: batch.moved_by(),
            followed: gauge.followed().to_vec(),
            outside: outside.as_ref().map(OutsideSet::mark),
        }));
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
        let Kept {
            state,
            time,
            started,
            records,
            candidates,
            next_candidate,
            kept_poses,
            placed,
            handover,
            misfit,
            odometry,
            wheels,
            moved_by,
            followed,
            outside: mark,
        } = kept;
        self.state.copy_from(state);
        self.time = *time;
        self.started = *started;
        self.records.clone_from(records);
        self.candidates.clone_from(candidates);
        self.next_candidate = *next_candidate;
        self.handover = *handover;
        self.kept_poses.clone_from(kept_poses);
        self.placed = *placed;
        self.misfit = *misfit;
        self.odometry.clone_from(odometry);
        self.wheels = *wheels;
        self.batch.remember_move(*moved_by);
        self.gauge.follow_all(followed);
        let outside = self.undo.given_up.take().or(self.outside.take());
        self.outside = mark.as_ref().zip(outside).map(|(mark, mut outside)| {
            outside.go_back(mark);
            outside
        });
        Ok(())
    }

    /// Becomes another filter that was made from this one; what this one was at its checkpoint stays within reach.
    pub(crate) fn become_other(&mut self, mut other: Self) {
        if let Some(outside) = self.outside.take() {
            self.undo.put_by(outside);
        }
        other.undo = std::mem::take(&mut self.undo);
        *self = other;
    }
}
