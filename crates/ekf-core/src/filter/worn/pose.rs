//! Where the worn cameras are in W (METHOD 6).

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{WornObservation, WornPose};
use crate::math::pose::{Pose, tangent_map};
use crate::math::quat;
use crate::observe::POSE_DIM;
use crate::observe::point::CameraPose;
use nalgebra::{DMatrix, Matrix6, Vector3};

/// Blocks of the state and the derivatives of a pose by them.
type Parts = Vec<(usize, DMatrix<f64>)>;

impl Filter {
    /// Where a worn camera was, as its stated T_CF and the camera's pose have it: of a view that was not measured. Its pairs
    /// are not looked at.
    ///
    /// # Errors
    /// As [`Self::check_worn`] and [`Self::carry_worn`], and `InvalidInput` before the start.
    pub fn worn_pose(&self, worn: &WornObservation) -> Result<WornPose, EkfError> {
        self.memory.check_started()?;
        self.check_worn(&worn.t_cf, &worn.covariance, worn.bias.as_ref(), worn.who)?;
        let compensated = self.time_compensated(worn)?;
        let (t_cf, compensated) = match &compensated {
            Some((here, compensated)) => (&here.t_cf, Some(compensated)),
            None => (&worn.t_cf, None),
        };
        let error = self.error_of(worn, compensated);
        let mut parts: Parts = Vec::new();
        for part in error.linear_parts() {
            let by = DMatrix::from_column_slice(6, part.width, part.matrix);
            parts.push((part.offset, by));
        }
        let noise = error.white + error.common * error.common.transpose();
        let t_cf = t_cf.retract(&error.mean(&self.memory.state));
        Ok(self.worn_pose_by(worn.who, &t_cf, parts, &noise))
    }

    /// Where a worn camera whose view was measured is, with its error of T_CF still in the state; `t_cf` is for the present
    /// pose.
    pub(crate) fn measured_worn_pose(&self, who: usize, t_cf: &Pose) -> WornPose {
        let error = self.memory.state.worn_error(who);
        let turn = error.fixed_rows::<3>(3).into_owned();
        // A small step beside the estimated error, as one beside the pose that it gives.
        let mut by = DMatrix::zeros(6, 6);
        let back = quat::rotation_exp(&-turn);
        by.view_mut((0, 0), (3, 3)).copy_from(&back);
        let half = quat::skew(&(turn * 0.5));
        let along = nalgebra::Matrix3::identity() - half;
        by.view_mut((3, 3), (3, 3)).copy_from(&along);
        let at = self.worn_error_offset(who);
        let parts = at.map(|at| (at, by)).into_iter().collect();
        self.worn_pose_by(who, &t_cf.retract(&error), parts, &Matrix6::zeros())
    }

    /// `T_WC T_CF`, the error of T_CF being made of `parts` and `noise`.
    fn worn_pose_by(
        &self,
        who: usize,
        t_cf: &Pose,
        mut parts: Parts,
        noise: &Matrix6<f64>,
    ) -> WornPose {
        let camera = self.memory.state.camera_pose();
        let by_camera = t_cf.inverse().adjoint() * tangent_map(&camera.q);
        let by_camera = DMatrix::from_column_slice(6, POSE_DIM, by_camera.as_slice());
        parts.push((0, by_camera));
        let told = self.memory.state.told();
        let mut covariance = *noise;
        for (a, by_a) in &parts {
            for (b, by_b) in &parts {
                let (rows, columns) = (by_a.ncols(), by_b.ncols());
                let block = DMatrix::from_fn(rows, columns, |i, j| told.get(a + i, b + j));
                covariance += by_a * block * by_b.transpose();
            }
        }
        let pose = Pose::from_quat(camera.r, &camera.q).compose(t_cf);
        let frame = CameraPose {
            r: Vector3::from(pose.translation),
            q: quat::from_rotation(&pose.rotation),
        };
        covariance += self.memory.map_frame.of_pose(&frame);
        WornPose {
            who,
            pose,
            covariance: (covariance + covariance.transpose()) * 0.5,
        }
    }
}
