//! Where Cs was at another time than the frame's, as a function of the state (METHOD 21): between two poses that are kept, or
//! from the present one with the present velocity.

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::math::between::Between;
use crate::math::pose::{Pose, tangent_map};
use crate::math::quat;
use crate::observe::POSE_DIM;
use crate::observe::point::CameraPose;
use crate::state::LinearPart;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};

/// The pose of Cs at a time. All tangents are its own, on the right.
pub(super) struct InterpolatedPose {
    /// `T_WC`.
    pub(crate) pose: Pose,
    /// Derivatives by the tangents of poses of the state, which are at these offsets.
    pub(crate) by_poses: [Option<(usize, Matrix6<f64>, CameraPose)>; 2],
    /// Derivative by the present velocities `[v w]`, where it goes on with these.
    pub(crate) by_velocity: Option<Matrix6<f64>>,
    /// Covariance of the motion that neither tells.
    pub(crate) noise: Matrix6<f64>,
    /// `(v, w)`, m/s and rad/s.
    pub(crate) twist: Vector6<f64>,
    /// Covariance of the twist at that very time.
    pub(super) twist_spread: Matrix6<f64>,
    /// What of it may be noise of the measured way, and not motion beside it.
    pub(super) twist_noise: Matrix6<f64>,
}

impl Filter {
    /// Where Cs was between two poses that are kept, or before the first by what it did after that.
    ///
    /// # Errors
    /// `StaleView` where none is kept.
    pub(super) fn pose_between(&self, t: f64) -> Result<InterpolatedPose, EkfError> {
        let (first, second, share, dt) = self.neighbours(t)?;
        let poses = [first, second].map(|at| self.memory.state.pose_at(at));
        let [a, b] = poses.map(|pose| Pose::from_quat(pose.r, &pose.q));
        let there = Between::new(&a, &b, share);
        let back = there.pose.rotation.transpose();
        let by_ends = [
            (first, on_both(&(back * a.rotation / -dt)), &poses[0]),
            (second, on_both(&(back * b.rotation / dt)), &poses[1]),
        ]
        .map(|(at, by, pose)| (at, by * tangent_map(&pose.q)));
        let parts = by_ends.each_ref().map(|(at, by)| of_pose(*at, by));
        let twist_noise = self.memory.state.covariance_of(&parts, &Matrix6::zeros());
        let of_mean = (share.powi(3) + (1.0 - share).powi(3)) * dt / 3.0;
        Ok(InterpolatedPose {
            by_poses: [
                Some((first, there.by_first, poses[0])),
                Some((second, there.by_second, poses[1])),
            ],
            by_velocity: None,
            noise: self.of_acceleration((share * (1.0 - share)).powi(2) * dt.powi(3) / 3.0),
            twist: there.way / dt,
            twist_spread: twist_noise + self.of_acceleration(of_mean),
            twist_noise,
            pose: there.pose,
        })
    }

    /// Where Cs is some seconds after the frame, or before it, if its velocities stay.
    pub(super) fn pose_prolonged(&self, seconds: f64) -> InterpolatedPose {
        let now = self.memory.state.camera_pose();
        let (v, w) = (
            self.memory.state.velocity(),
            self.memory.state.angular_velocity(),
        );
        let here = Pose::from_quat(now.r, &now.q);
        let turn = w * seconds;
        let back = quat::rotation_exp(&-turn);
        let pose = Pose {
            rotation: here.rotation * quat::rotation_exp(&turn),
            translation: here.translation + v * seconds,
        };
        let into = pose.rotation.transpose();
        let mut by_velocity = Matrix6::zeros();
        by_velocity
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(into * seconds));
        by_velocity
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&(quat::right_jacobian(&turn) * seconds));
        let mut turned = Matrix6::identity();
        turned.fixed_view_mut::<3, 3>(0, 0).copy_from(&into);
        let known = self.memory.state.p.block::<6, 6>(POSE_DIM, POSE_DIM);
        let known = turned * known * turned.transpose();
        InterpolatedPose {
            by_poses: [Some((0, on_both(&back), now)), None],
            by_velocity: Some(by_velocity),
            noise: self.of_acceleration(seconds.abs().powi(3) / 3.0),
            twist: twist(&(into * v), &w),
            twist_spread: known + self.of_acceleration(seconds.abs()),
            twist_noise: known,
            pose,
        }
    }

    /// Poses of the state on both sides of `t`, the share of the way from the first to the second, and the seconds between
    /// them. The timing has been checked.
    fn neighbours(&self, t: f64) -> Result<(usize, usize, f64, f64), EkfError> {
        let now = (self.memory.time.unwrap_or(t), 0);
        let kept = self.memory.kept_poses.poses.iter();
        let kept =
            kept.filter_map(|(at, id)| Some((*at, self.memory.state.layout.find(*id)?.offset)));
        let poses: Vec<(f64, usize)> = kept.filter(|(at, _)| *at < now.0).chain([now]).collect();
        let pair = poses.windows(2).find(|pair| t <= pair[1].0);
        let Some(&[(from, first), (to, second)]) = pair.or(poses.windows(2).last()) else {
            return Err(EkfError::StaleView { t, oldest: now.0 });
        };
        let dt = to - from;
        Ok((first, second, ((t - from) / dt).min(1.0), dt))
    }

    /// Covariance of what white accelerations of the process noise's densities make, `share` of their squares: with `s` a
    /// density, of where Cs is beside the straight way between two poses that are known, under any velocity,
    /// `s^2 dt^3 u^2 (1 - u)^2 / 3` at the share `u` of `dt`.
    fn of_acceleration(&self, share: f64) -> Matrix6<f64> {
        let process = &self.setup.settings.process;
        let (linear, angular) = (
            process.acceleration_density.powi(2) * share,
            process.angular_acceleration_density.powi(2) * share,
        );
        Matrix6::from_diagonal(&Vector6::new(
            linear, linear, linear, angular, angular, angular,
        ))
    }
}

/// `(v, w)` as one vector.
pub(crate) fn twist(v: &Vector3<f64>, w: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
}

fn on_both(half: &Matrix3<f64>) -> Matrix6<f64> {
    let mut out = Matrix6::zeros();
    for at in [0, 3] {
        out.fixed_view_mut::<3, 3>(at, at).copy_from(half);
    }
    out
}

fn of_pose(offset: usize, by: &SMatrix<f64, 6, POSE_DIM>) -> LinearPart<'_> {
    LinearPart {
        offset,
        width: POSE_DIM,
        matrix: by.as_slice(),
    }
}
