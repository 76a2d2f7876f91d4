//! How a camera moves while it sees nothing, and how fast it goes then, where a gyroscope tells its turn (METHOD 28).

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::math::quat;
use crate::observe::block::MeasurementBlock;
use crate::observe::{ATTITUDE, POSE_DIM, Rows, VelocityRows};
use crate::settings::{MotionModel, ProcessSettings};
use crate::state::Learned;
use nalgebra::{SMatrix, Vector3};

/// Frames predicted since the last one that was used, from which on the map in view is taken to tell nothing of the motion.
pub(super) const UNSEEN: u32 = 3;
/// Times the variance of what is known that a measurement has which says nothing.
const NOTHING: f64 = 1e12;

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

    /// Says how the camera usually goes: its velocity along its own axes, m/s, with the standard deviation of each. What is
    /// known less well than that is measured, to be known as well, where the map in view does not tell it: after two frames that
    /// were not used, or where the last one found fewer landmarks of known depth than a frame needs.
    ///
    /// # Errors
    /// `InvalidInput` before the start, or for numbers that are no velocity; `NotPositiveDefinite` and `Unsound` as an update.
    /// Nothing changes then.
    pub fn expect_velocity(
        &mut self,
        velocity: &Vector3<f64>,
        sd: &Vector3<f64>,
    ) -> Result<(), EkfError> {
        self.memory.check_started()?;
        let is_velocity = velocity.iter().all(|v| v.is_finite());
        if !is_velocity || !sd.iter().all(|sd| sd.is_finite() && *sd > 0.0) {
            let (v, sd) = (velocity.as_slice(), sd.as_slice());
            return Err(EkfError::InvalidInput {
                what: "velocity",
                why: format!(
                    "{v:?} +- {sd:?} m/s; give finite ones, and what they may be off by above zero"
                ),
            });
        }
        if self.memory.unused < UNSEEN && self.is_speed_told() {
            return Ok(());
        }
        let (state, q) = (&self.memory.state, self.memory.state.camera_pose().q);
        let mut along_axes = VelocityRows::zeros();
        let turned = quat::rotate_inverse_jacobian(&q, &state.velocity());
        along_axes.fixed_columns_mut::<4>(0).copy_from(&turned);
        let axes = quat::rotation(&q).transpose();
        along_axes.fixed_columns_mut::<3>(4).copy_from(&axes);
        let p: SMatrix<f64, 7, 7> = state.p.block(ATTITUDE, ATTITUDE);
        let known = (along_axes * p * along_axes.transpose()).diagonal();
        if (0..3).all(|k| known[k] <= sd[k] * sd[k]) {
            return Ok(());
        }
        // With it the variance becomes what is said; where it is less already, nothing is measured.
        let noise = known.zip_map(sd, |variance, sd| {
            let left = sd * sd / variance;
            let share = if left < 1.0 {
                left / (1.0 - left)
            } else {
                NOTHING
            };
            variance * share
        });
        let innovation = velocity - axes * state.velocity();
        let readout = state.readout_block().map_or(POSE_DIM, |b| b.offset);
        let rows = Rows::velocity(innovation, &along_axes, &noise, readout);
        self.changes();
        self.measure_velocity(MeasurementBlock::of_camera(rows))
    }

    /// Whether the last frame that was used found as many landmarks of known depth as a frame needs.
    fn is_speed_told(&self) -> bool {
        let records = &self.memory.records;
        let last = records
            .values()
            .map(|r| r.last_found)
            .fold(f64::NEG_INFINITY, f64::max);
        let found = self.memory.state.layout.features().filter(|block| {
            let record = records.get(&block.id);
            record.is_some_and(|r| r.last_found == last) && !self.is_guess(block)
        });
        found.count() >= self.setup.settings.lost.min_matches
    }

    fn measure_velocity(&mut self, block: MeasurementBlock) -> Result<(), EkfError> {
        let (carries, scales) = (self.setup.carries(), self.considered_scales());
        let (memory, workspace) = (&mut self.memory, &mut self.workspace);
        let (batch, gauge) = (&mut workspace.batch, &mut workspace.gauge);
        batch.clear();
        batch.push(block);
        batch.build(&memory.state);
        batch.factor()?;
        if carries {
            gauge.prepare(&memory.state, memory.followed.ids());
        }
        batch.solve(&memory.state, carries.then_some(&*gauge))?;
        let carried = carries.then_some((&mut *gauge, memory.followed.ids()));
        batch.apply(&mut memory.state, carried, &Learned::default());
        memory.state.normalise_quaternions();
        if carries {
            gauge.mark_carried(&mut memory.state);
        }
        self.keep_scales(scales);
        Ok(())
    }
}
