//! Views of Cf that were not taken at the frame's own instant (METHOD 21): the pose of Cs when one was taken, from the poses
//! that are kept, as a linear function of the state.

use super::interpolated_pose::{InterpolatedPose, twist};
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{Capture, WornObservation};
use crate::guard::check_pose;
use crate::math::pose::{Pose, tangent_map};
use crate::observe::POSE_DIM;
use crate::observe::point::CameraPose;
use crate::state::LinearPart;
use nalgebra::{Matrix6, SMatrix, Vector6};

/// Standard deviation of each component of Cs's velocity before the start, when nothing is known of it: m/s.
pub const UNKNOWN_SPEED: f64 = 1.0;
/// The same of its angular velocity: rad/s.
pub const UNKNOWN_TURN: f64 = 0.5;

/// T_CF as it is between a view of Cf and a frame of another time, with how its error comes about. All tangents are those of
/// F, on the right.
#[derive(Clone, Debug)]
pub(crate) struct TimeCompensated {
    /// Maps points of F, at the time of the view, into C at that of the frame.
    pub(crate) t_cf: Pose,
    /// The measured T_CF: from F into C when the view was taken.
    pub(crate) taken: Pose,
    /// What it depends on.
    pub(crate) by: ByMotion,
    /// Covariance of the motion that the state does not tell.
    pub(crate) noise: Matrix6<f64>,
    /// Noise of the derivative by the clock.
    pub(super) clock_noise: Matrix6<f64>,
}

/// Derivatives of a T_CF by how Cs moved.
#[derive(Clone, Debug, Default)]
pub(crate) struct ByMotion {
    /// By poses of the state, `[r q]` at these offsets.
    poses: Vec<(usize, SMatrix<f64, 6, 7>)>,
    /// By the present velocities.
    velocity: Option<Matrix6<f64>>,
    /// By the clock of the worn camera, at this offset.
    clock: Option<(usize, Vector6<f64>)>,
}

impl ByMotion {
    fn add(&mut self, offset: usize, by_tangent: &Matrix6<f64>, pose: &CameraPose) {
        self.poses.push((offset, by_tangent * tangent_map(&pose.q)));
    }

    /// The part of the clock.
    pub(crate) fn clock(&self) -> Option<LinearPart<'_>> {
        self.clock.as_ref().map(|(offset, by)| LinearPart {
            offset: *offset,
            width: 1,
            matrix: by.as_slice(),
        })
    }

    /// All of it.
    pub(crate) fn parts(&self) -> impl Iterator<Item = LinearPart<'_>> {
        let poses = self.poses.iter().map(|(offset, by)| LinearPart {
            offset: *offset,
            width: POSE_DIM,
            matrix: by.as_slice(),
        });
        let velocity = self.velocity.iter().map(|by| LinearPart {
            offset: POSE_DIM,
            width: 6,
            matrix: by.as_slice(),
        });
        poses.chain(velocity).chain(self.clock())
    }
}

impl Filter {
    /// T_CF of a view of the worn camera `who` taken at `capture.t`, carried to the frame at `capture.frame`: what a match between the images of both
    /// starts from, and its covariance, m^2 and rad^2, that of Cs's motion between included.
    ///
    /// # Errors
    /// `StaleView`, `FutureView` or `RepeatedView`; `InvalidInput` or `NonFinite` for an impossible pose or covariance, or a
    /// frame whose pose is not kept.
    pub fn carry_worn(
        &self,
        t_cf: &Pose,
        covariance: &Matrix6<f64>,
        capture: Capture,
        who: usize,
    ) -> Result<(Pose, Matrix6<f64>), EkfError> {
        check_pose(t_cf, covariance)?;
        let compensated = self.compensated_t_cf(t_cf, capture, who)?;
        let parts: Vec<LinearPart<'_>> = compensated.by.parts().collect();
        let noise = covariance + compensated.noise;
        let sum = self.memory.state.covariance_of(&parts, &noise);
        Ok((compensated.t_cf, (sum + sum.transpose()) * 0.5))
    }

    /// As [`Self::carry_worn`], by its causes.
    pub(crate) fn compensated_t_cf(
        &self,
        t_cf: &Pose,
        capture: Capture,
        who: usize,
    ) -> Result<TimeCompensated, EkfError> {
        let Capture { t, frame } = capture;
        for (what, value) in [("time of the worn view", t), ("time of its frame", frame)] {
            if !value.is_finite() {
                return Err(EkfError::NonFinite { what });
            }
        }
        self.check_timing(t, who)?;
        let to = self.memory.offset_of_frame(frame)?;
        let gap = self.gap(capture);
        let into_f = t_cf.inverse().adjoint();
        let clock = self.memory.state.worn_clock(who);
        if !self.memory.started || (gap.is_some() && clock.is_none()) {
            let gap = gap.unwrap_or_else(|| (t - frame).abs());
            let off = clock.map_or(0.0, |(mean, variance)| mean * mean + variance);
            let noise = self.of_unknown_motion(gap * gap + off);
            return Ok(TimeCompensated {
                t_cf: t_cf.clone(),
                taken: t_cf.clone(),
                by: ByMotion::default(),
                noise: into_f * noise * into_f.transpose(),
                clock_noise: Matrix6::zeros(),
            });
        }
        let there = self.interpolated_pose(capture, who)?;
        let frame_pose = self.memory.state.pose_at(to);
        let here = Pose::from_quat(frame_pose.r, &frame_pose.q);
        let motion = here.inverse().compose(&there.pose);
        let mut noise = there.noise;
        if let Some((_, variance)) = clock {
            // Of the product of both errors, and of the time by which the view counts as of the frame's instant.
            noise += there.twist_spread * variance;
            let twist = there.twist * gap.unwrap_or(0.0);
            noise += twist * twist.transpose();
        }
        let mut by = ByMotion::default();
        for (at, by_tangent, pose) in there.by_poses.iter().flatten() {
            by.add(*at, &(into_f * by_tangent), pose);
        }
        by.add(to, &(into_f * -motion.inverse().adjoint()), &frame_pose);
        by.velocity = there.by_velocity.map(|by| into_f * by);
        let block = self.memory.state.worn_clock_block(who);
        by.clock = block.map(|block| (block.offset, into_f * there.twist));
        Ok(TimeCompensated {
            t_cf: motion.compose(t_cf),
            taken: t_cf.clone(),
            by,
            noise: into_f * noise * into_f.transpose(),
            clock_noise: into_f * there.twist_noise * into_f.transpose(),
        })
    }

    /// Seconds between a view and its frame, where it counts as of that one's instant.
    fn gap(&self, Capture { t, frame }: Capture) -> Option<f64> {
        let gap = (t - frame).abs();
        (gap <= self.setup.settings.worn.tolerance).then_some(gap)
    }

    /// Where Cs was when a view of the worn camera `who` was taken, as its clock is estimated.
    ///
    /// # Errors
    /// `StaleView` where no pose of about then is kept.
    pub(super) fn interpolated_pose(
        &self,
        capture: Capture,
        who: usize,
    ) -> Result<InterpolatedPose, EkfError> {
        let Some((clock, _)) = self.memory.state.worn_clock(who) else {
            return self.pose_between(capture.t);
        };
        let stamp = self.gap(capture).map_or(capture.t, |_| capture.frame);
        let t = stamp + clock;
        let now = self.memory.time.unwrap_or(t);
        if t >= now || self.kept_times().next().is_none() {
            return Ok(self.pose_prolonged(t - now));
        }
        self.pose_between(t)
    }

    /// Covariance of Cs's motion in a time that is short, or before its velocity is known; `time` is its square.
    fn of_unknown_motion(&self, time: f64) -> Matrix6<f64> {
        if !self.memory.started {
            let (v, w) = (UNKNOWN_SPEED.powi(2) * time, UNKNOWN_TURN.powi(2) * time);
            return Matrix6::from_diagonal(&Vector6::new(v, v, v, w, w, w));
        }
        let pose = self.pose().0;
        let twist = twist(&pose.tr_mul(&self.velocity()), &self.angular_velocity());
        let mut turn = Matrix6::identity();
        turn.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&pose.transpose());
        let uncertain = turn * self.memory.state.p.block::<6, 6>(7, 7) * turn.transpose();
        (twist * twist.transpose() + uncertain) * time
    }

    /// A view of another time as one of the present frame: its T_CF carried here, and what its error comes from. So is one of
    /// the frame's own instant where the clock is not exact.
    pub(crate) fn time_compensated(
        &self,
        worn: &WornObservation,
    ) -> Result<Option<(WornObservation, TimeCompensated)>, EkfError> {
        let (Some(capture), Some(now)) = (self.capture_of(worn), self.memory.time) else {
            return Ok(None);
        };
        self.memory.offset_of_frame(capture.frame)?;
        let compensated = self.compensated_t_cf(
            &worn.t_cf,
            Capture {
                frame: now,
                ..capture
            },
            worn.who,
        )?;
        let here = WornObservation {
            t_cf: compensated.t_cf.clone(),
            ..worn.clone()
        };
        Ok(Some((here, compensated)))
    }

    /// When a view was taken, where that makes a difference.
    pub(super) fn capture_of(&self, worn: &WornObservation) -> Option<Capture> {
        let clock = self.memory.state.worn_clock_block(worn.who);
        let now = clock.and(self.memory.time).map(|t| Capture { t, frame: t });
        worn.capture.or(now)
    }
}

#[cfg(test)]
mod tests {
    use crate::camera::Camera;
    use crate::filter::{Capture, Filter, ViewTiming};
    use crate::math::pose::{Pose, tangent_map};
    use crate::math::quat;
    use crate::observe::POSE_DIM;
    use crate::settings::Settings;
    use crate::state::CAMERA_DIM;
    use nalgebra::{Matrix6xX, SMatrix, Vector2, Vector6};

    /// A filter that moves and turns, with kept poses at 0, 0.1, .. and the present frame at 0.45 s.
    fn moving() -> Filter {
        moving_with(Settings::default())
    }

    fn moving_with(settings: Settings) -> Filter {
        let numbers = [500.0, 500.0, 320.0, 240.0];
        let camera = Camera::new("radtan", 640, 480, numbers, &[0.0; 4]).expect("a calibration");
        let mut filter = Filter::new(settings, camera.clone(), Some(camera));
        filter.predict(0.0).expect("first frame");
        let pixels: Vec<Vector2<f64>> = (0..12)
            .map(|k| Vector2::new(60.0 + 45.0 * k as f64, 240.0))
            .collect();
        filter.add_undelayed(&pixels).expect("features");
        filter.memory.state.x[7..13].copy_from_slice(&[0.6, -0.2, 1.1, 0.3, -0.8, 0.2]);
        for k in 1..=5 {
            assert!(filter.keep_pose(1.0));
            filter
                .predict((0.1 * f64::from(k)).min(0.45))
                .expect("time goes on");
        }
        filter
    }

    fn t_cf() -> Pose {
        Pose::exp(&Vector6::new(0.8, -0.3, 0.2, 0.2, -0.4, 0.1))
    }

    #[test]
    fn its_derivatives_are_those_of_finite_differences() {
        let filter = moving();
        let e = 1e-6;
        for (t, frame) in [(0.13, 0.45), (0.42, 0.45), (0.2, 0.45), (0.27, 0.2)] {
            let capture = Capture { t, frame };
            let at = filter
                .compensated_t_cf(&t_cf(), capture, 0)
                .expect("between kept poses");
            let mut offsets: Vec<usize> = at.by.poses.iter().map(|(offset, _)| *offset).collect();
            offsets.sort_unstable();
            offsets.dedup();
            for offset in offsets {
                let q = filter.memory.state.pose_at(offset).q;
                // Steps along the tangent of the pose, as `[r q]`.
                let by = at.by.poses.iter().filter(|(at, _)| *at == offset);
                let by: SMatrix<f64, 6, 7> = by.map(|(_, by)| *by).sum();
                let mut lift = SMatrix::<f64, 7, 6>::zeros();
                lift.fixed_view_mut::<3, 3>(0, 0)
                    .copy_from(&quat::rotation(&q));
                lift.fixed_view_mut::<4, 3>(3, 3).copy_from(&quat::lift(&q));
                assert!((tangent_map(&q) * lift - SMatrix::identity()).abs().max() < 1e-12);
                for k in 0..6 {
                    let [to, from] = [e, -e].map(|e| {
                        let mut moved = filter.clone();
                        let step = lift.column(k) * e;
                        for i in 0..POSE_DIM {
                            moved.memory.state.x[offset + i] += step[i];
                        }
                        let there = moved
                            .compensated_t_cf(&t_cf(), capture, 0)
                            .expect("as before");
                        at.t_cf.inverse().compose(&there.t_cf).log()
                    });
                    let numeric = (to - from) / (2.0 * e);
                    let off = (by * lift.column(k) - numeric).abs().max();
                    assert!(off < 1e-7, "{t}, {frame}, {offset}, {k}: {off:e}");
                }
            }
        }
    }

    #[test]
    fn a_view_of_a_frame_whose_pose_is_kept_is_exact_there() {
        let filter = moving();
        let frame = filter.kept_times().nth(3).expect("five are kept");
        let capture = Capture { t: frame, frame };
        let covariance = SMatrix::identity() * 1e-4;
        let (t, p) = filter
            .carry_worn(&t_cf(), &covariance, capture, 0)
            .expect("kept");
        assert!(t_cf().inverse().compose(&t).log().norm() < 1e-12);
        assert!((p - covariance).abs().max() < 1e-12);
    }

    #[test]
    fn what_cannot_be_measured_is_named() {
        let mut filter = moving();
        let timing = |filter: &Filter, t: f64| filter.view_timing(t, 0);
        assert_eq!(timing(&filter, 0.45), ViewTiming::Present);
        assert_eq!(timing(&filter, 0.4495), ViewTiming::Present);
        assert_eq!(timing(&filter, 0.43), ViewTiming::Late);
        assert_eq!(timing(&filter, -0.01), ViewTiming::Stale);
        assert_eq!(timing(&filter, 0.46), ViewTiming::Future);
        filter.memory.kept_poses.remember(0, 0.35);
        assert_eq!(timing(&filter, 0.35), ViewTiming::Repeated);
        assert_eq!(timing(&filter, 0.3), ViewTiming::Reordered);
        let refused = |t: f64| {
            let capture = Capture { t, frame: 0.45 };
            filter
                .compensated_t_cf(&t_cf(), capture, 0)
                .expect_err("no")
                .to_string()
        };
        assert!(refused(-0.01).contains("stale"), "{}", refused(-0.01));
        assert!(refused(0.46).contains("future"));
        assert!(refused(0.35).contains("before"));
    }

    #[test]
    fn poses_are_kept_for_the_time_that_is_set_and_no_more() {
        let mut filter = moving();
        for k in 1..=60 {
            filter.keep_pose(2.0);
            let t = 0.45 + 0.05 * f64::from(k);
            filter.predict(t).expect("time goes on");
        }
        let now = filter.time().expect("it has started");
        let times: Vec<f64> = filter.kept_times().collect();
        let (oldest, second) = (times[0], times[1]);
        assert!(
            oldest <= now - 1.05 && second > now - 1.25,
            "{times:?} at {now}"
        );
        assert!(times.len() <= 14, "{times:?}");
        filter.manage_map(&[]);
        assert_eq!(filter.kept_times().count(), times.len());
        for &t in &times {
            filter.kept_pose(t).expect("it is kept");
        }
        filter.check().expect("sound");

        // Views that come less late need fewer of them.
        filter.predict(now + 0.1).expect("time goes on");
        assert!(filter.keep_pose(0.25));
        let few: Vec<f64> = filter.kept_times().collect();
        assert!(
            few[0] <= now - 0.15 && few[1] > now - 0.15,
            "{few:?} at {now}"
        );
        filter.check().expect("sound");
    }

    fn with_clock(clock: f64) -> Filter {
        let mut settings = Settings::default();
        settings.worn.clock_sd = 0.05;
        let mut filter = moving_with(settings);
        let at = filter
            .memory
            .state
            .worn_clock_block(0)
            .expect("a clock")
            .offset;
        filter.memory.state.x[at] = clock;
        filter
    }

    /// Derivative of T_CF of a view, by all numbers of the state that it says it depends on.
    fn derivative(filter: &Filter, capture: Capture) -> Matrix6xX<f64> {
        let at = filter
            .compensated_t_cf(&t_cf(), capture, 0)
            .expect("it is kept");
        let mut by = Matrix6xX::zeros(filter.memory.state.x.len());
        for part in at.by.parts() {
            let mut columns = by.columns_mut(part.offset, part.width);
            columns += Matrix6xX::from_column_slice(part.matrix);
        }
        by
    }

    #[test]
    fn derivatives_by_the_clock_and_all_else_are_those_of_finite_differences() {
        let e = 1e-6;
        // Between kept poses, before the first of them, and after the present one.
        for (t, frame, clock) in [
            (0.27, 0.45, 0.05),
            (0.02, 0.45, -0.06),
            (0.43, 0.45, 0.06),
            (0.45, 0.45, 0.05),
            (0.45, 0.45, -0.05),
            (0.27, 0.2, 0.02),
        ] {
            let filter = with_clock(clock);
            let capture = Capture { t, frame };
            let by = derivative(&filter, capture);
            let there =
                |filter: &Filter| filter.compensated_t_cf(&t_cf(), capture, 0).expect("kept");
            let at = there(&filter).t_cf;
            let kept = filter.memory.kept_poses.ids();
            let kept = kept.filter_map(|id| Some(filter.memory.state.layout.find(id)?.offset));
            let mut steps: Vec<Vec<(usize, f64)>> =
                (7..CAMERA_DIM).map(|i| vec![(i, 1.0)]).collect();
            let clock_at = filter
                .memory
                .state
                .worn_clock_block(0)
                .expect("a clock")
                .offset;
            steps.push(vec![(clock_at, 1.0)]);
            for pose in kept.chain([0]) {
                steps.extend((0..3).map(|i| vec![(pose + i, 1.0)]));
                let lift = quat::lift(&filter.memory.state.pose_at(pose).q);
                let turns = (0..3).map(|k| (0..4).map(|i| (pose + 3 + i, lift[(i, k)])).collect());
                steps.extend(turns);
            }
            for step in steps {
                let analytic: Vector6<f64> = step.iter().map(|(i, v)| by.column(*i) * *v).sum();
                let [to, from] = [e, -e].map(|e| {
                    let mut moved = filter.clone();
                    step.iter()
                        .for_each(|(i, v)| moved.memory.state.x[*i] += v * e);
                    at.inverse().compose(&there(&moved).t_cf).log()
                });
                let off = (analytic - (to - from) / (2.0 * e)).abs().max();
                assert!(off < 1e-6, "{t}, {frame}, {clock}, {step:?}: {off:e}");
            }
        }
    }

    #[test]
    fn a_clock_that_is_known_to_be_off_is_as_another_stamp() {
        let filter = with_clock(0.05);
        let (late, frame) = (
            Capture {
                t: 0.22,
                frame: 0.45,
            },
            0.45,
        );
        let exact = moving_with(Settings::default());
        let with = filter.compensated_t_cf(&t_cf(), late, 0).expect("kept");
        let as_stamped = exact.compensated_t_cf(&t_cf(), Capture { t: 0.27, frame }, 0);
        let off = with
            .t_cf
            .inverse()
            .compose(&as_stamped.expect("kept").t_cf)
            .log();
        assert!(off.norm() < 1e-12, "{off}");
    }
}
