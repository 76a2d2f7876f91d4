//! A gyroscope in place of the motion model's turn (METHOD 28).

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::imu::{self, Imu};
use crate::math::quat::{self, Quat};
use crate::observe::POSE_DIM;
use crate::predict::{CLOCK, GYRO_DIM, GyroAt, Motion, Sensor};
use crate::state::{BlockKind, Learned};
use nalgebra::{Matrix1, Matrix3, Matrix4, SMatrix, Vector1, Vector3, Vector4};

impl Filter {
    /// Says that there is a gyroscope: `r_ci` maps its axes into those of C, `time_offset` is to be added to its stamps for those
    /// of the frames, seconds. Its other sizes are those of the settings (`imu`).
    ///
    /// # Errors
    /// `NonFinite`, `InvalidInput` if that is not a rotation or no offset, once the filter has started, or if there is one already.
    pub fn set_imu(&mut self, r_ci: &Matrix3<f64>, time_offset: f64) -> Result<(), EkfError> {
        imu::check_mount(r_ci)?;
        imu::check_offset(time_offset)?;
        if self.memory.started || self.memory.imu.is_some() {
            let why = "say how it sits once, before the filter starts".into();
            let what = "IMU";
            return Err(EkfError::InvalidInput { what, why });
        }
        self.changes();
        self.memory.imu = Some(Imu::at(r_ci));
        let sizes = &self.setup.settings.imu;
        let state = &mut self.memory.state;
        let bias = Matrix3::identity() * sizes.gyro_bias_sd.powi(2);
        state.append(BlockKind::GyroBias, &Vector3::zeros(), &[], &bias);
        let (scale, mount) = (sizes.gyro_scale_sd, sizes.mount_sd);
        let frame = Vector4::new(scale, mount, mount, mount).map(|sd| sd * sd);
        let frame = Matrix4::from_diagonal(&frame);
        state.append(BlockKind::GyroFrame, &Vector4::zeros(), &[], &frame);
        let clock = Matrix1::new(sizes.time_offset_sd.powi(2));
        let offset = Vector1::new(time_offset);
        state.append(BlockKind::GyroClock, &offset, &[], &clock);
        Ok(())
    }

    /// Takes another filter's gyroscope with what is known of it; for a filter without one, or a map.
    pub(crate) fn take_gyro_of(&mut self, other: &Self) {
        self.memory.imu.clone_from(&other.memory.imu);
        let (from, state) = (&other.memory.state, &mut self.memory.state);
        for block in from.layout.blocks() {
            let at = block.offset;
            match block.kind {
                BlockKind::GyroBias => state.append(
                    block.kind,
                    &from.part::<3>(at),
                    &[],
                    &from.p.block::<3, 3>(at, at),
                ),
                BlockKind::GyroFrame => state.append(
                    block.kind,
                    &from.part::<4>(at),
                    &[],
                    &from.p.block::<4, 4>(at, at),
                ),
                BlockKind::GyroClock => state.append(
                    block.kind,
                    &from.part::<1>(at),
                    &[],
                    &from.p.block::<1, 1>(at, at),
                ),
                _ => continue,
            };
        }
    }

    /// Gives the gyroscope's rate at a time of its clock, seconds, along its axes, rad/s. The predictions that follow turn as it
    /// says, as far as its samples reach.
    ///
    /// # Errors
    /// `NonFinite`; `InvalidInput` for an impossible rate, if too many wait for a frame, or if no gyroscope was announced;
    /// `BadTime` if `t` does not follow the last sample, `LongGap` if it is more than an hour after it. Nothing changes then.
    pub fn add_gyro(&mut self, t: f64, rate: &Vector3<f64>) -> Result<(), EkfError> {
        let Some(imu) = &mut self.memory.imu else {
            return Err(EkfError::InvalidInput {
                what: "gyroscope",
                why: "the filter was made without one; say how it sits before the start".into(),
            });
        };
        imu.add(t, rate)
    }

    /// Whether [`Self::add_gyro`] could take a rate, but for its time.
    ///
    /// # Errors
    /// As there.
    pub fn check_gyro(rate: &Vector3<f64>) -> Result<(), EkfError> {
        imu::check(rate)
    }

    /// Stamp of the last sample by the gyroscope's clock, seconds.
    pub fn gyro_time(&self) -> Option<f64> {
        self.memory.imu.as_ref()?.last
    }

    /// Estimate of the gyroscope's bias along its axes, rad/s, and its covariance; `None` without one.
    pub fn gyro_bias(&self) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let at = self.gyro_at(BlockKind::GyroBias)?;
        let told = self.memory.state.told();
        Some((self.memory.state.part::<3>(at), told.block::<3, 3>(at, at)))
    }

    /// What is to be added to the gyroscope's stamps for those of the frames as it is estimated, and the standard deviation of
    /// that, seconds; `None` without one.
    pub fn gyro_clock(&self) -> Option<(f64, f64)> {
        let at = self.gyro_at(BlockKind::GyroClock)?;
        let variance = self.memory.state.told().get(at, at);
        Some((self.memory.state.x[at], variance.max(0.0).sqrt()))
    }

    /// Whether the gyroscope told the last prediction's turn, for half of its time or more; until a frame is measured.
    pub fn followed_gyro(&self) -> bool {
        self.memory.wheels.turned.is_some()
    }

    /// By how much a stamp of the gyroscope may still be before the frame that it counts for, seconds.
    pub(super) fn gyro_clock_margin(&self) -> f64 {
        let margin = |(offset, sd): (f64, f64)| offset + 5.0 * sd;
        self.gyro_clock().map_or(0.0, margin)
    }

    /// Lets the frame teach the gyroscope's clock where its turn changes clearly with it.
    pub(crate) fn learn_gyro_clock(&self, learned: &mut Learned) {
        if self.memory.wheels.clear_clock
            && let Some(at) = self.gyro_at(BlockKind::GyroClock)
        {
            learned.number(at);
        }
    }

    /// The gyroscope as the filter knows it; `None` without one.
    pub(super) fn sensor(&self) -> Option<Sensor<'_>> {
        let imu = self.memory.imu.as_ref().filter(|imu| !imu.is_off)?;
        let at = self.gyro()?;
        Some(Sensor {
            imu,
            sizes: &self.setup.settings.imu,
            bias: self.memory.state.part::<3>(at.bias),
            offset: self.memory.state.x[at.clock],
        })
    }

    /// Covariance of a turn that it told, by its noise and by what is known of its errors, tangent on the right, rad^2.
    pub(super) fn turn_covariance(&self, motion: &Motion) -> Option<Matrix3<f64>> {
        let at = self.gyro()?;
        let rows: [usize; GYRO_DIM] = std::array::from_fn(|k| match k {
            0..3 => at.bias + k,
            3..CLOCK => at.frame + k - 3,
            _ => at.clock,
        });
        let p = &self.memory.state.p;
        let known = SMatrix::<f64, GYRO_DIM, GYRO_DIM>::from_fn(|i, j| p.get(rows[i], rows[j]));
        let into = quat::tangent(&Quat::from_column_slice(&motion.x[3..7]));
        let by = into * motion.by_gyro.fixed_rows::<4>(3);
        let noise = into * motion.noise.fixed_view::<4, 4>(3, 3) * into.transpose();
        Some(by * known * by.transpose() + noise)
    }

    /// Stops following the gyroscope, whose rates are not the camera's; it stays so. What it said of the present rate is
    /// forgotten.
    pub fn drop_gyro(&mut self) {
        self.changes();
        if let Some(imu) = &mut self.memory.imu {
            imu.is_off = true;
            self.forget_rate();
        }
    }

    /// Whether the gyroscope is followed, where it says something; `None` without one.
    pub fn follows_gyro(&self) -> Option<bool> {
        self.memory.imu.as_ref().map(|imu| !imu.is_off)
    }

    /// Makes the present rate as uncertain as at the start.
    pub(super) fn forget_rate(&mut self) {
        let sd = self.setup.settings.process.start_angular_velocity_sd;
        let more = Matrix3::identity() * sd.powi(2);
        self.memory.state.p.add_block(POSE_DIM + 3, &more);
    }

    /// Where its errors are in the state.
    pub(super) fn gyro(&self) -> Option<GyroAt> {
        Some(GyroAt {
            bias: self.gyro_at(BlockKind::GyroBias)?,
            frame: self.gyro_at(BlockKind::GyroFrame)?,
            clock: self.gyro_at(BlockKind::GyroClock)?,
        })
    }

    fn gyro_at(&self, kind: BlockKind) -> Option<usize> {
        let block = self.memory.state.layout.of_kind(kind).next();
        block.map(|b| b.offset)
    }
}
