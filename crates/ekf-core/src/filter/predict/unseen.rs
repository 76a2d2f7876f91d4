//! How a camera moves while it sees nothing, and how fast it goes then, where a gyroscope tells its turn (METHOD 28).

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::observe::POSE_DIM;
use crate::predict::CameraMatrix;
use crate::settings::{MotionModel, ProcessSettings};
use nalgebra::{Matrix3, Vector3};

/// Frames predicted since the last one that was used, from which on the speed is what the camera usually does.
const UNSEEN: u32 = 3;

impl Filter {
    /// Process noise and motion model of a prediction. After a frame that was not used, where a gyroscope says how the camera
    /// turns, its velocity turns with it.
    pub(super) fn motion_model(&self) -> ProcessSettings {
        let mut process = self.setup.settings.process.clone();
        if self.memory.unused > 0 && self.follows_gyro() == Some(true) {
            process.velocity = MotionModel::Body;
        }
        process
    }

    /// Says how fast the camera usually goes, m/s, with its standard deviation. Where two frames at least were not used before the
    /// present one and its speed is known less well than that, it is measured so; the velocity that results hangs on nothing
    /// else.
    ///
    /// # Errors
    /// `InvalidInput` before the start, or for numbers that are no speed; nothing changes then.
    pub fn expect_speed(&mut self, speed: f64, sd: f64) -> Result<(), EkfError> {
        self.memory.check_started()?;
        let is_speed = |x: f64| x.is_finite() && x > 0.0;
        if !is_speed(speed) || !is_speed(sd) {
            return Err(EkfError::InvalidInput {
                what: "speed",
                why: format!("{speed} +- {sd} m/s; both must be finite and above zero"),
            });
        }
        let velocity = self.memory.state.velocity();
        let covariance: Matrix3<f64> = self.memory.state.p.block(POSE_DIM, POSE_DIM);
        let Some(ahead) = velocity.try_normalize(f64::EPSILON) else {
            return Ok(());
        };
        let along: Vector3<f64> = covariance * ahead;
        let variance = along.dot(&ahead);
        if self.memory.unused < UNSEEN || variance <= sd * sd {
            return Ok(());
        }
        self.changes();
        let innovation_variance = variance + sd * sd;
        let left = covariance - along * along.transpose() / innovation_variance;
        let mut apart = CameraMatrix::identity();
        apart.fixed_view_mut::<3, 3>(POSE_DIM, POSE_DIM).fill(0.0);
        let state = &mut self.memory.state;
        state.p.transform(0, &apart);
        state
            .p
            .add_block(POSE_DIM, &((left + left.transpose()) * 0.5));
        let by = (speed - velocity.norm()) / innovation_variance;
        state.set_part(POSE_DIM, &(velocity + along * by));
        Ok(())
    }
}
