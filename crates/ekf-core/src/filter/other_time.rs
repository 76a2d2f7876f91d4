//! Views of Cf that were not taken at the frame's own instant (METHOD 21): the pose of Cs when one was taken, from the poses
//! that are kept, as a linear function of the state.

use super::ekf::Filter;
use super::measurements::{Capture, WornObservation};
use crate::error::EkfError;
use crate::guard::check_pose;
use crate::math::between::Between;
use crate::math::pose::{Pose, tangent_map};
use crate::observe::point::CameraPose;
use nalgebra::{Matrix6, SMatrix, Vector6};

/// Standard deviation of each component of Cs's velocity before the start, when nothing is known of it: m/s.
const UNKNOWN_SPEED: f64 = 1.0;
/// The same of its angular velocity: rad/s.
const UNKNOWN_TURN: f64 = 0.5;

/// T_CF as it is between a view of Cf and a frame of another time, with how its error comes about. All tangents are those of
/// F, on the right.
#[derive(Clone, Debug)]
pub(super) struct Carried {
    /// Maps points of F, at the time of the view, into C at that of the frame.
    pub(super) t_cf: Pose,
    /// The measured T_CF: from F into C when the view was taken.
    pub(super) taken: Pose,
    /// Derivatives by poses of the state, `[r q]` at these offsets.
    pub(super) parts: Vec<(usize, SMatrix<f64, 6, 7>)>,
    /// Covariance of the motion that no pose of the state tells.
    pub(super) noise: Matrix6<f64>,
}

impl Carried {
    fn add(&mut self, offset: usize, by_tangent: &Matrix6<f64>, pose: &CameraPose) {
        self.parts.push((offset, by_tangent * tangent_map(&pose.q)));
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
        let carried = self.carried(t_cf, capture, who)?;
        let mut sum = covariance + carried.noise;
        for (a, by_a) in &carried.parts {
            for (b, by_b) in &carried.parts {
                let p: SMatrix<f64, 7, 7> = self.state.p.block(*a, *b);
                sum += by_a * p * by_b.transpose();
            }
        }
        Ok((carried.t_cf, (sum + sum.transpose()) * 0.5))
    }

    /// As [`Self::carry_worn`], by its causes.
    pub(super) fn carried(
        &self,
        t_cf: &Pose,
        capture: Capture,
        who: usize,
    ) -> Result<Carried, EkfError> {
        let Capture { t, frame } = capture;
        for (what, value) in [("time of the worn view", t), ("time of its frame", frame)] {
            if !value.is_finite() {
                return Err(EkfError::NonFinite { what });
            }
        }
        self.check_timing(t, who)?;
        let to = self.offset_of_frame(frame)?;
        let gap = (t - frame).abs();
        let into_f = t_cf.inverse().adjoint();
        if gap <= self.settings.worn.tolerance || !self.started {
            let noise = self.of_unknown_motion(gap);
            return Ok(Carried {
                t_cf: t_cf.clone(),
                taken: t_cf.clone(),
                parts: Vec::new(),
                noise: into_f * noise * into_f.transpose(),
            });
        }
        let (first, second, share, dt) = self.neighbours(t)?;
        let poses = [first, second].map(|at| self.state.pose_at(at));
        let [a, b] = poses.map(|pose| Pose::from_quat(pose.r, &pose.q));
        let there = Between::new(&a, &b, share);
        let frame_pose = self.state.pose_at(to);
        let here = Pose::from_quat(frame_pose.r, &frame_pose.q);
        let motion = here.inverse().compose(&there.pose);
        let twist = there.way / dt;
        let noise = self.of_interpolation(share, dt)
            + twist * twist.transpose() * self.settings.worn.clock_sd.powi(2);
        let mut carried = Carried {
            t_cf: motion.compose(t_cf),
            taken: t_cf.clone(),
            parts: Vec::with_capacity(3),
            noise: into_f * noise * into_f.transpose(),
        };
        carried.add(first, &(into_f * there.by_first), &poses[0]);
        carried.add(second, &(into_f * there.by_second), &poses[1]);
        carried.add(to, &(into_f * -motion.inverse().adjoint()), &frame_pose);
        Ok(carried)
    }

    /// Poses of the state on both sides of `t`, the share of the way from the first to the second, and the seconds between
    /// them. The timing has been checked.
    fn neighbours(&self, t: f64) -> Result<(usize, usize, f64, f64), EkfError> {
        let now = (self.time.unwrap_or(t), 0);
        let kept = self.kept_poses.poses.iter();
        let kept = kept.filter_map(|(at, id)| Some((*at, self.state.layout.find(*id)?.offset)));
        let poses: Vec<(f64, usize)> = kept.filter(|(at, _)| *at < now.0).chain([now]).collect();
        let pair = poses.windows(2).find(|pair| t <= pair[1].0);
        let Some(&[(from, first), (to, second)]) = pair.or(poses.windows(2).last()) else {
            return Err(EkfError::StaleView { t, oldest: now.0 });
        };
        let dt = to - from;
        Ok((first, second, ((t - from) / dt).clamp(0.0, 1.0), dt))
    }

    /// Covariance of where Cs is beside the straight way between two poses that are known: under white acceleration of the
    /// process noise's density `s` and any velocity, `s^2 dt^3 u^2 (1 - u)^2 / 3` at the share `u` of `dt`.
    fn of_interpolation(&self, share: f64, dt: f64) -> Matrix6<f64> {
        let process = &self.settings.process;
        let part = (share * (1.0 - share)).powi(2) * dt.powi(3) / 3.0;
        let (linear, angular) = (
            process.acceleration_density.powi(2) * part,
            process.angular_acceleration_density.powi(2) * part,
        );
        Matrix6::from_diagonal(&Vector6::new(
            linear, linear, linear, angular, angular, angular,
        ))
    }

    /// Covariance of Cs's motion in a short time, or before its velocity is known.
    fn of_unknown_motion(&self, gap: f64) -> Matrix6<f64> {
        let time = gap * gap + self.settings.worn.clock_sd.powi(2);
        if !self.started {
            let (v, w) = (UNKNOWN_SPEED.powi(2) * time, UNKNOWN_TURN.powi(2) * time);
            return Matrix6::from_diagonal(&Vector6::new(v, v, v, w, w, w));
        }
        let pose = self.pose().0;
        let (v, w) = (pose.tr_mul(&self.velocity()), self.angular_velocity());
        let twist = Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z);
        let mut turn = Matrix6::identity();
        turn.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&pose.transpose());
        let uncertain = turn * self.state.p.block::<6, 6>(7, 7) * turn.transpose();
        (twist * twist.transpose() + uncertain) * time
    }

    /// A view of another time as one of the present frame: its T_CF carried here, and what its error comes from.
    pub(super) fn brought_here(
        &self,
        worn: &WornObservation,
    ) -> Result<Option<(WornObservation, Carried)>, EkfError> {
        let (Some(capture), Some(now)) = (worn.capture, self.time) else {
            return Ok(None);
        };
        self.offset_of_frame(capture.frame)?;
        let carried = self.carried(
            &worn.t_cf,
            Capture {
                frame: now,
                ..capture
            },
            worn.who,
        )?;
        let here = WornObservation {
            t_cf: carried.t_cf.clone(),
            ..worn.clone()
        };
        Ok(Some((here, carried)))
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
    use nalgebra::{SMatrix, Vector2, Vector6};

    /// A filter that moves and turns, with kept poses at 0, 0.1, .. and the present frame at 0.45 s.
    fn moving() -> Filter {
        let numbers = [500.0, 500.0, 320.0, 240.0];
        let camera = Camera::new("radtan", 640, 480, numbers, &[0.0; 4]).expect("a calibration");
        let mut filter = Filter::new(Settings::default(), camera.clone(), Some(camera));
        filter.predict(0.0).expect("first frame");
        let pixels: Vec<Vector2<f64>> = (0..12)
            .map(|k| Vector2::new(60.0 + 45.0 * k as f64, 240.0))
            .collect();
        filter.add_undelayed(&pixels).expect("features");
        filter.state.x[7..13].copy_from_slice(&[0.6, -0.2, 1.1, 0.3, -0.8, 0.2]);
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
                .carried(&t_cf(), capture, 0)
                .expect("between kept poses");
            let mut offsets: Vec<usize> = at.parts.iter().map(|(offset, _)| *offset).collect();
            offsets.sort_unstable();
            offsets.dedup();
            for offset in offsets {
                let q = filter.state.pose_at(offset).q;
                // Steps along the tangent of the pose, as `[r q]`.
                let by = at.parts.iter().filter(|(at, _)| *at == offset);
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
                            moved.state.x[offset + i] += step[i];
                        }
                        let there = moved.carried(&t_cf(), capture, 0).expect("as before");
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
        filter.kept_poses.remember(0, 0.35);
        assert_eq!(timing(&filter, 0.35), ViewTiming::Repeated);
        assert_eq!(timing(&filter, 0.3), ViewTiming::Reordered);
        let refused = |t: f64| {
            let capture = Capture { t, frame: 0.45 };
            filter
                .carried(&t_cf(), capture, 0)
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
        filter.manage_map();
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
}
