//! Where a map lies in W (METHOD 19): a map that was started by a camera that had lost its way hangs on a pose that is
//! hardly known. That uncertainty is one motion of W for camera and map together, which no measurement sees; so it is kept
//! beside the state, where it never meets a linearisation, and added to what is said of camera and landmarks.

use crate::math::numbers;
use crate::math::pose::Pose;
use crate::math::quat;
use crate::observe::point::CameraPose;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// Chance that where a camera was found is wrong if prediction excludes it, and that it is not prediction which is wrong.
const EITHER: f64 = 0.5;

/// Covariance of the frame that the map is in, as a small motion `(translation, rotation)` of W, m^2 and rad^2; zero for
/// the first map.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct MapFrame(#[serde(with = "numbers")] pub(crate) Matrix6<f64>);

impl MapFrame {
    /// That of a map that is certain seen from a camera whose pose has this covariance, right tangent.
    pub(crate) fn by_pose(pose: &CameraPose, covariance: &Matrix6<f64>) -> Self {
        // From a motion (dp, dw) of the camera in C: the frame turns by R dw, about the camera, and moves with it.
        let r = quat::rotation(&pose.q);
        let mut j = Matrix6::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
        j.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(quat::skew(&pose.r) * r));
        j.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
        let moved = j * covariance * j.transpose();
        Self((moved + moved.transpose()) * 0.5)
    }

    /// What it becomes where a camera was found, at `pose`, `away` from where prediction had it and excluded it (right tangent).
    pub(crate) fn or_there(self, pose: &Pose, away: &Vector6<f64>) -> Self {
        let pose = CameraPose {
            r: pose.translation,
            q: quat::from_rotation(&pose.rotation),
        };
        Self(self.0 + Self::by_pose(&pose, &(away * away.transpose() * EITHER)).0)
    }

    /// What it becomes where the way that the camera went, in W, is as likely wrong as right, by its square.
    pub(crate) fn or_gone(mut self, square: &Matrix3<f64>) -> Self {
        let mut shift = self.0.fixed_view_mut::<3, 3>(0, 0);
        shift += square * EITHER;
        self
    }

    /// What it adds to the covariance of the camera's pose, right tangent.
    pub(crate) fn of_pose(&self, pose: &CameraPose) -> Matrix6<f64> {
        let r_cw = quat::rotation(&pose.q).transpose();
        let mut j = Matrix6::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).copy_from(&r_cw);
        j.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(-r_cw * quat::skew(&pose.r)));
        j.fixed_view_mut::<3, 3>(3, 3).copy_from(&r_cw);
        j * self.0 * j.transpose()
    }

    /// What it adds to the covariance of a point in W, m^2.
    pub(crate) fn of_point(&self, point: &Vector3<f64>) -> Matrix3<f64> {
        let mut j = SMatrix::<f64, 3, 6>::zeros();
        j.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&Matrix3::identity());
        j.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-quat::skew(point));
        j * self.0 * j.transpose()
    }
}

#[cfg(test)]
mod tests {
    use super::MapFrame;
    use crate::math::quat;
    use crate::observe::point::CameraPose;
    use nalgebra::{Matrix3, Matrix6, Vector3};

    fn pose() -> CameraPose {
        let turn = Vector3::new(0.4, -1.1, 0.3);
        CameraPose {
            r: Vector3::new(3.0, -2.0, 7.0),
            q: quat::from_rotation(&nalgebra::Rotation3::new(turn).into_inner()),
        }
    }

    #[test]
    fn seen_from_the_pose_it_hangs_on_it_is_that_poses_covariance() {
        let a = Matrix6::from_fn(|i, j| ((3 * i + 5 * j) % 7) as f64 - 3.0);
        let covariance = a * a.transpose();
        let map_frame = MapFrame::by_pose(&pose(), &covariance);
        assert!(
            (map_frame.of_pose(&pose()) - covariance).abs().max() < 1e-9 * covariance.abs().max()
        );
    }

    #[test]
    fn a_point_at_the_camera_is_as_uncertain_as_the_camera_and_one_far_off_swings_with_it() {
        let mut covariance = Matrix6::identity() * 0.04;
        covariance[(4, 4)] = 0.01; // about the camera's y axis
        for k in [3, 5] {
            covariance[(k, k)] = 0.0;
        }
        let pose = pose();
        let map_frame = MapFrame::by_pose(&pose, &covariance);
        let near = map_frame.of_point(&pose.r);
        assert!((near - Matrix3::identity() * 0.04).abs().max() < 1e-12);
        let axes = quat::rotation(&pose.q);
        let far = map_frame.of_point(&(pose.r + axes.column(2) * 10.0));
        let along = |k: usize| (axes.column(k).transpose() * far * axes.column(k))[(0, 0)];
        assert!((along(0) - (0.04 + 0.01 * 100.0)).abs() < 1e-9);
        assert!((along(2) - 0.04).abs() < 1e-9);
    }
}
