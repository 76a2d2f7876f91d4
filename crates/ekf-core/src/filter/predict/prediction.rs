//! Prediction (METHOD 3), the features that it brings into view, and what the map transfers.

use super::visibility::{MAYBE, SOON, appearance, visibility};
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::memory::wheels::Wheels;
use crate::kernel::Panels;
use crate::observe::point::CameraPose;
use crate::observe::{FeatureState, POSE_DIM};
use crate::stamps::{self, LONGEST_GAP};
use crate::state::{CAMERA_DIM, State};
use crate::{guard, predict};
use nalgebra::{Vector3, Vector6};

/// Shortest time between two frames, seconds: the steps of f64 time stamps since 1970 are a quarter of it.
const SHORTEST_STEP: f64 = 1e-6;

/// Longest motion that is predicted, seconds. By then the attitude is unknown (its standard deviation is several turns with
/// the default process noise), and a longer prediction would only cost P the digits of the map.
const LONGEST_MOTION: f64 = 20.0;

/// Step of the camera in one update, metres or quaternion entries, beyond which the remembered points of features outside
/// of the working set are worked out anew: the map may have moved as well.
const JUMP: f64 = 0.02;

impl Filter {
    /// Predicts to time `t`, seconds. Before the start this only sets the time. A gap of more than 20 s is predicted as
    /// one of 20 s, after which the pose is as good as unknown: find it again in the map.
    ///
    /// # Errors
    /// `NonFinite`; `InvalidInput` if `t` cannot be in seconds; `BadTime` if it is not a microsecond after the last frame;
    /// `LongGap` if it is more than an hour after it, `InvalidInput` if P would leave all bounds (after years of gaps
    /// without a measurement). Nothing changes then.
    pub fn predict(&mut self, t: f64) -> Result<(), EkfError> {
        stamps::check("time", t)?;
        if let Some(last) = self.memory.time {
            if t - last < SHORTEST_STEP {
                return Err(EkfError::BadTime { t, last });
            }
            if self.memory.started {
                if t - last > LONGEST_GAP {
                    return Err(EkfError::LongGap { t, last });
                }
                if let Some(told) = self.told_motion(last, t, LONGEST_MOTION) {
                    self.check_motion(&told.motion)?;
                    self.changes();
                    self.follow_odometry(&told, t - last);
                } else {
                    let dt = (t - last).min(LONGEST_MOTION);
                    guard::prediction(&self.memory.state, dt, &self.setup.settings.process)?;
                    self.changes();
                    self.predict_by(dt);
                }
                self.look_about();
            }
        }
        self.arrive(t);
        Ok(())
    }

    /// The prediction to `t` is done.
    pub(super) fn arrive(&mut self, t: f64) {
        // Before the start a late view may still take the filter back.
        let late = if self.memory.started {
            0.0
        } else {
            self.setup.settings.worn.late
        };
        self.memory.unused = self.memory.unused.saturating_add(1);
        self.memory.odometry.forget_until(t - 2.0 * late);
        let stamp = t - 2.0 * late - self.gyro_clock_margin();
        if let Some(imu) = &mut self.memory.imu {
            imu.forget_until(stamp);
        }
        self.memory.time = Some(t);
    }

    /// Forgets the time before the start, when nothing depends on it yet: a filter may start from a frame of before.
    ///
    /// # Errors
    /// `InvalidInput` after the start.
    pub fn forget_time(&mut self) -> Result<(), EkfError> {
        if self.memory.started {
            return Err(EkfError::InvalidInput {
                what: "time",
                why: "the filter has started and cannot go back; restore a snapshot instead".into(),
            });
        }
        self.memory.time = None;
        Ok(())
    }

    /// Lets a camera that is lost go on at `velocity`, m/s in W, without turning (METHOD 3): what it was last taken to do, often by
    /// the very frame that lost it, would carry it off for as long as it is lost. Either may be right, so the square of what
    /// lies between them joins the covariance.
    ///
    /// # Errors
    /// `NonFinite`; `InvalidInput` before the start. Nothing changes then.
    pub fn go_on_at(&mut self, velocity: &Vector3<f64>) -> Result<(), EkfError> {
        self.memory.check_started()?;
        if velocity.iter().any(|v| !v.is_finite()) {
            return Err(EkfError::NonFinite { what: "velocity" });
        }
        self.changes();
        let mut twist = Vector6::zeros();
        twist.fixed_rows_mut::<3>(0).copy_from(velocity);
        let state = &mut self.memory.state;
        let off = state.part::<6>(POSE_DIM) - twist;
        let spread = state.p.block::<6, 6>(POSE_DIM, POSE_DIM) + off * off.transpose();
        state.p.set_block(POSE_DIM, POSE_DIM, &spread);
        state.set_part(POSE_DIM, &twist);
        Ok(())
    }

    fn predict_by(&mut self, dt: f64) {
        self.memory.wheels = Wheels::default();
        let settings = &self.setup.settings;
        predict::predict(&mut self.memory.state, dt, &settings.process);
        predict::forget(&mut self.memory.state, dt, settings);
    }

    /// What the camera's motion brings into view, and what the map transfers.
    pub(super) fn look_about(&mut self) {
        let pose = self.memory.state.camera_pose();
        if let Some(outside) = &mut self.memory.outside {
            // A feature that comes into view joins the working set, and those about to come into view join with it:
            // joining costs a pass over R, however many join.
            outside.refresh_points(&self.memory.state, self.memory.moved_by > JUMP);
            let look = |y: &FeatureState, margin| appearance(&self.setup.camera, &pose, y, margin);
            let seen = visibility(&self.setup.camera, &pose);
            let close = outside.maybe_in_view(&self.memory.state, |point| seen(point, -MAYBE));
            let mut any = false;
            let close = close.filter(|(_, y)| {
                any |= look(y, 0.0).is_some();
                look(y, -SOON).is_some()
            });
            let close: Vec<u64> = close.map(|(block, _)| block.id).collect();
            if any {
                outside.enter(&mut self.memory.state, |id| {
                    close.binary_search(&id).is_ok()
                });
            }
            outside.mark_clear(&pose);
        }
        self.follow_view(&pose);
        self.add_map_drift(&pose);
    }

    /// Chooses which features are followed; with the gauge transport those that come back are carried to the present mean.
    pub(crate) fn follow_view(&mut self, pose: &CameraPose) {
        let State { reference, x, .. } = &mut self.memory.state;
        reference[..CAMERA_DIM].copy_from_slice(&x[..CAMERA_DIM]);
        let seen = visibility(&self.setup.camera, pose);
        let (mut stay, mut back) = (std::mem::take(&mut self.workspace.in_view), false);
        stay.clear();
        for block in self.memory.state.layout.features() {
            let followed = self.memory.followed.has(block.id);
            let margin = if followed { -SOON } else { 0.0 };
            let point = self.memory.state.feature(block).point();
            if point.is_some_and(|point| seen(&point, margin)) {
                stay.push(block.id);
                back |= !followed;
            }
        }
        drop(seen);
        stay.sort_unstable();
        self.follow(stay, back);
    }

    /// What Cf alone sees is measured out of Cs's view: it is followed, too, as what came back into view, until it has been
    /// measured. Returns what was not followed before.
    pub(crate) fn follow_too(&mut self, ids: impl Iterator<Item = u64>) -> Vec<u64> {
        let mut more: Vec<u64> = ids.filter(|&id| !self.memory.followed.has(id)).collect();
        if !more.is_empty() {
            more.sort_unstable();
            more.dedup(); // several Cf may see one of them
            let mut all = std::mem::take(&mut self.workspace.in_view);
            all.clear();
            all.extend_from_slice(self.memory.followed.ids());
            all.extend_from_slice(&more);
            all.sort_unstable();
            self.follow(all, true);
        }
        more
    }

    /// Follows these features, increasing, and no others; with some that were not followed, P is carried to the present mean.
    fn follow(&mut self, mut ids: Vec<u64>, back: bool) {
        let back = back && self.setup.carries();
        if back {
            let followed = self.memory.followed.ids();
            self.workspace.gauge.prepare(&self.memory.state, followed);
        }
        self.memory.followed.swap(&mut ids);
        self.workspace.in_view = ids;
        if back {
            let followed = self.memory.followed.ids();
            let gauge = &mut self.workspace.gauge;
            let change = gauge.change(&self.memory.state, followed, None);
            self.memory
                .state
                .p
                .downdate(&Panels::default(), Some(change));
            self.workspace.gauge.mark_carried(&mut self.memory.state);
        }
    }
}
