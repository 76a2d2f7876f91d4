//! Poses of the last second that are kept in the state, for views of Cf that were taken between two frames or come late
//! (METHOD 21).

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::memory::pose_ring::MOST_KEPT_POSES;
use crate::math::pose::Pose;

/// Poses that are kept at most within `worn.late`, but for the one before it and those that jitter adds.
const AIM: f64 = 10.0;
/// How far back poses are kept, in `worn.late`: a view waits for its frame after it has come.
const REACH: f64 = 1.0 + 1.0 / AIM;
/// Share of their spacing from which on another pose is kept: frames do not come to the microsecond.
const SPACING: f64 = 0.75;

/// What the time of a view of Cf says about its use (METHOD 21).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ViewTiming {
    /// Of the frame's own instant, within `worn.tolerance`.
    Present,
    /// Before it, between poses that are kept.
    Late,
    /// As `Late`, and older than one that was measured before: it was overtaken on its way.
    Reordered,
    /// It was measured before.
    Repeated,
    /// Older than the poses that are kept.
    Stale,
    /// After the frame.
    Future,
}

impl Filter {
    /// Keeps the camera's pose for views of Cf that come late; true if it did. To be called at the end of a frame; it does
    /// nothing before the start, and where the last pose is so recent that a tenth of `worn.late` has not passed yet.
    ///
    /// Poses older than `lateness` go, but for one: how much later than it was taken a view comes to its frame, so far as is
    /// known, seconds; `worn.late` is the most. Each pose that is kept costs like a feature.
    pub fn keep_pose(&mut self, lateness: f64) -> bool {
        let Some(now) = self.memory.time.filter(|_| self.memory.started) else {
            return false;
        };
        let late = self.setup.settings.worn.late;
        let last = self.memory.kept_poses.poses.last();
        if last.is_some_and(|(t, _)| now - t < SPACING * late / AIM) {
            return false;
        }
        self.changes();
        let oldest = now - lateness.max(0.0).min(REACH * late);
        // The one before the first that is needed is needed, too: views are taken between two.
        let poses = &mut self.memory.kept_poses.poses;
        let over = poses.iter().skip(1).take_while(|(t, _)| *t <= oldest);
        let over = over
            .count()
            .max((poses.len() + 1).saturating_sub(MOST_KEPT_POSES));
        let mut gone: Vec<u64> = poses.drain(..over).map(|(_, id)| id).collect();
        let again = gone.pop();
        if !gone.is_empty() {
            self.memory.state.remove(|b| gone.contains(&b.id));
        }
        let block = again.and_then(|id| self.memory.state.layout.find(id).copied());
        let id = match block {
            Some(block) => {
                self.memory.state.clone_again(&block);
                block.id
            }
            None => self.memory.clone_pose(),
        };
        self.memory.kept_poses.poses.push((now, id));
        true
    }

    /// Times of the poses that are kept, seconds, increasing.
    pub fn kept_times(&self) -> impl Iterator<Item = f64> {
        self.memory.kept_poses.poses.iter().map(|(t, _)| *t)
    }

    /// `T_WC` as it is kept of the frame at `t`, or the present pose if that is the frame's time.
    ///
    /// # Errors
    /// `InvalidInput` if no pose of that time is kept.
    pub fn kept_pose(&self, t: f64) -> Result<Pose, EkfError> {
        let offset = self.memory.offset_of_frame(t)?;
        let pose = self.memory.state.pose_at(offset);
        Ok(Pose::from_quat(pose.r, &pose.q))
    }

    /// What can be done with a view of the worn camera `who` that was taken at `t`, seconds, now that the filter is at its frame's time.
    pub fn view_timing(&self, t: f64, who: usize) -> ViewTiming {
        let now = self.memory.time.unwrap_or(t);
        let tolerance = self.setup.settings.worn.tolerance;
        let measured = self.memory.kept_poses.measured.iter();
        let mut measured = measured.filter(|(of, _)| *of == who).map(|(_, t)| *t);
        if measured.clone().any(|last| last == t) {
            return ViewTiming::Repeated;
        }
        // A start may be from the frame before the view.
        let ahead = if self.memory.started {
            0.0
        } else {
            self.setup.settings.worn.late / AIM
        };
        if t > now + tolerance.max(ahead) {
            return ViewTiming::Future;
        }
        if now - t <= tolerance {
            return ViewTiming::Present;
        }
        let late = self.setup.settings.worn.late;
        let oldest = match (self.memory.started, self.kept_times().next()) {
            (true, Some(oldest)) => oldest.max(now - REACH * late),
            (true, None) => now,
            // Nothing is known of its motion, which is added to the noise of T_CF.
            (false, _) => now - late / AIM,
        };
        if t < oldest {
            return ViewTiming::Stale;
        }
        if measured.any(|last| last > t) {
            return ViewTiming::Reordered;
        }
        ViewTiming::Late
    }

    /// Refuses a view that cannot be measured any more, or not yet.
    pub(super) fn check_timing(&self, t: f64, who: usize) -> Result<(), EkfError> {
        let now = self.memory.time.unwrap_or(t);
        match self.view_timing(t, who) {
            ViewTiming::Present | ViewTiming::Late | ViewTiming::Reordered => Ok(()),
            ViewTiming::Repeated => Err(EkfError::RepeatedView { t }),
            ViewTiming::Future => Err(EkfError::FutureView { t, now }),
            ViewTiming::Stale => {
                let oldest = self.kept_times().next().unwrap_or(now);
                let oldest = oldest.max(now - REACH * self.setup.settings.worn.late);
                Err(EkfError::StaleView { t, oldest })
            }
        }
    }
}
