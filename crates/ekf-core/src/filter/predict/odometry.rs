//! Odometry in place of the motion model, and what is done where wheels slip (METHOD 23).

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{Bearing, Measurements};
use crate::filter::input::sources::Scratch;
use crate::filter::memory::wheels::Wheels;
use crate::guard::{self, check_rigid};
use crate::math::pose::Pose;
use crate::math::quat::{self, Quat};
use crate::predict::{CameraMatrix, Motion, Reading, Sensor};
use crate::settings::ProcessSettings;
use crate::state::{BlockKind, CAMERA_DIM, State};
use crate::{chi2, odometry, predict};
use nalgebra::{Matrix2, Matrix6, SMatrix, SVector, Vector2, Vector6};

/// Longest time between two frames over which a slip is looked for, seconds: beyond, the camera's own velocity says nothing.
const LONGEST_SLIP: f64 = 1.0;

/// Degrees of freedom of a motion.
const MOTION: f64 = 6.0;

/// How often its noise a way or a turn between two frames must be to say something of a scale: what the noise itself takes off
/// the scale is one over the square of it.
const CLEAR: f64 = 10.0;

/// The same of a turn's change with a gyroscope's clock, as with the worn cameras' clocks (METHOD 26).
const CLEAR_CLOCK: f64 = 5.0;

/// What odometry and a gyroscope tell of the time between two frames.
pub(super) struct Told {
    pub(crate) motion: Motion,
    /// For how long odometry does, and the gyroscope, seconds.
    seconds: f64,
    turned: f64,
    /// See [`Wheels::unclear`].
    unclear: [bool; 2],
    /// See [`Wheels::clear_clock`].
    clear_clock: bool,
}

impl Filter {
    /// Says where Cs sits: `t_bc` maps points of C into the odometry's frame, metres. The identity to begin with.
    ///
    /// # Errors
    /// `NonFinite`, `InvalidInput` for an impossible pose, or once there was odometry.
    pub fn set_odometry_frame(&mut self, t_bc: &Pose) -> Result<(), EkfError> {
        let what = "odometry frame";
        check_rigid(what, t_bc)?;
        if self.memory.odometry.last.is_some() {
            let why = "odometry has been given in another one; say it before the first".into();
            return Err(EkfError::InvalidInput { what, why });
        }
        self.memory.odometry.t_bc = t_bc.clone();
        Ok(())
    }

    /// Gives the mean twist of the odometry's frame since the sample before, `(v, w)` along its own axes, m/s and rad/s, with
    /// its covariance. The next predictions follow it, as far as it goes; of a silence of more than a second a sample says
    /// nothing.
    ///
    /// # Errors
    /// `NonFinite`; `InvalidInput` for an impossible twist, a covariance that is not positive definite, or if too many wait
    /// for a frame; `BadTime` if `t` does not follow the last sample, `LongGap` if it is more than an hour after it. Nothing
    /// changes then.
    pub fn add_odometry(
        &mut self,
        t: f64,
        twist: &Vector6<f64>,
        covariance: &Matrix6<f64>,
    ) -> Result<(), EkfError> {
        self.memory.odometry.add(t, twist, covariance)
    }

    /// Whether [`Self::add_odometry`] could take a sample, but for its time.
    ///
    /// # Errors
    /// As there.
    pub fn check_odometry(twist: &Vector6<f64>, covariance: &Matrix6<f64>) -> Result<(), EkfError> {
        odometry::check(twist, covariance)
    }

    /// Stamp of the last sample of odometry, seconds.
    pub fn odometry_time(&self) -> Option<f64> {
        self.memory.odometry.last
    }

    /// Estimates of the errors of the odometry's scales, of translation and of turns, and their covariance; `None` before the
    /// first motion that it told, and where the scales are exact.
    pub fn odometry_scale(&self) -> Option<(Vector2<f64>, Matrix2<f64>)> {
        let at = self.odometry_scale_at()?;
        Some((
            self.memory.state.part::<2>(at),
            self.memory.state.p.block::<2, 2>(at, at),
        ))
    }

    /// Whether the last prediction followed odometry, for half of its time or more; until a frame is measured.
    pub fn followed_odometry(&self) -> bool {
        self.memory.wheels.followed
    }

    fn odometry_scale_at(&self) -> Option<usize> {
        let block = self
            .memory
            .state
            .layout
            .of_kind(BlockKind::OdometryScale)
            .next();
        block.map(|b| b.offset)
    }

    /// The motion between two times as far as odometry tells it, and a gyroscope the turn, the rest at constant velocity; `None`
    /// where neither tells anything.
    pub(super) fn told_motion(&self, last: f64, t: f64, longest: f64) -> Option<Told> {
        let before: CameraMatrix = self.memory.state.p.block(0, 0);
        let process = self.motion_model();
        let mut told = Telling {
            process: &process,
            scale: self.odometry_scale().map_or(Vector2::zeros(), |(s, _)| s),
            before: &before,
            gyro: self.sensor(),
            motion: Motion::new(camera_of(&self.memory.state)),
            left: longest,
            turned: 0.0,
            by_clock: [0.0; 2],
        };
        let (mut now, mut seconds) = (last, 0.0);
        let (mut way, mut noise) = (Vector6::zeros(), Matrix6::zeros());
        for sample in &self.memory.odometry.samples {
            let (from, until) = (sample.from.max(now), sample.t.min(t));
            if until <= from {
                continue;
            }
            told.go(now, from, None);
            let reading = |dt| self.memory.odometry.reading(sample, dt);
            told.go(from, until, Some(&reading));
            way += sample.twist * (until - from);
            noise += sample.covariance * ((sample.t - sample.from) * (until - from));
            (now, seconds) = (until, seconds + until - from);
        }
        told.go(now, t, None);
        let mut unclear = [0, 3].map(|at| !stands_out(&way, &noise, at));
        unclear[1] |= told.turned > 0.0;
        let [by_clock, noise] = told.by_clock;
        (seconds + told.turned > 0.0).then_some(Told {
            motion: told.motion,
            seconds,
            turned: told.turned,
            unclear,
            clear_clock: by_clock > CLEAR_CLOCK * noise,
        })
    }

    /// Moves camera and P along a motion of `dt` seconds.
    pub(super) fn follow_odometry(&mut self, told: &Told, dt: f64) {
        let motion = &told.motion;
        self.memory.wheels = Wheels {
            followed: told.seconds >= 0.5 * dt,
            turned: self
                .turn_covariance(motion)
                .filter(|_| told.turned >= 0.5 * dt),
            clear_clock: told.clear_clock,
            slip: (dt <= LONGEST_SLIP).then(|| self.slip_of(motion, dt)),
            trusted: None,
            unclear: told.unclear,
        };
        let prior = self.setup.settings.odometry.covariance();
        let is_new = told.seconds > 0.0 && self.odometry_scale_at().is_none();
        if let Some(prior) = prior.filter(|_| is_new) {
            let kind = BlockKind::OdometryScale;
            self.memory
                .state
                .append(kind, &Vector2::zeros(), &[], &prior);
        }
        let at = self.odometry_scale_at();
        let settings = &self.setup.settings;
        let gyro = self.gyro();
        predict::predict_along(&mut self.memory.state, motion, at, gyro.as_ref());
        predict::forget(&mut self.memory.state, dt, settings);
    }

    /// What a slip would add: the camera may as well have moved on with its own velocity. The covariance reaches from one
    /// motion to the other.
    fn slip_of(&self, told: &Motion, dt: f64) -> CameraMatrix {
        let process = &self.setup.settings.process;
        let mut own = Motion::new(camera_of(&self.memory.state));
        own.drift(dt, process.velocity, process);
        let mut off = SVector::<f64, CAMERA_DIM>::from(own.x) - SVector::from(told.x);
        let q = Quat::from_column_slice(&told.x[3..7]);
        let turn = quat::tangent(&q) * off.fixed_rows::<4>(3);
        off.fixed_rows_mut::<4>(3)
            .copy_from(&(quat::lift(&q) * turn));
        let by_velocity = own.by_camera.fixed_view::<CAMERA_DIM, 6>(0, 7).into_owned();
        let velocity: SMatrix<f64, 6, 6> = self.memory.state.p.block(7, 7);
        let spread = by_velocity * velocity * by_velocity.transpose() + own.noise;
        let project = quat::normalise_jacobian(&q);
        let mut along = CameraMatrix::identity();
        along.fixed_view_mut::<4, 4>(3, 3).copy_from(&project);
        let slip = along * (off * off.transpose() + spread) * along.transpose();
        (slip + slip.transpose()) * 0.5
    }

    /// Whether what Cs shows contradicts odometry: fewer than `least` features were found, or those that agree with each
    /// other under any motion do not under this one (`validate.conditional_level`). False where the last prediction did not
    /// follow odometry, or it is distrusted already.
    ///
    /// # Errors
    /// `NonFinite`, `UnknownFeature`, `InvalidInput` (an id given twice); the filter stays as it was.
    pub fn contradicts_odometry(
        &mut self,
        found: &[Bearing],
        least: usize,
    ) -> Result<bool, EkfError> {
        let z = Measurements {
            bearings: found.to_vec(),
            ..Measurements::default()
        };
        let mut scratch = Scratch::default();
        self.check_measurements(&z, &mut scratch)?;
        let Some(slip) = self.memory.wheels.untaken_slip() else {
            return Ok(false);
        };
        if found.len() < least {
            return Ok(true);
        }
        let level = self.setup.settings.validate.conditional_level;
        if found.is_empty() || level >= 1.0 {
            return Ok(false);
        }
        self.changes();
        self.fetch(&z, &mut scratch.ids);
        let (prior, own) = (self.memory.state.x.clone(), self.memory.state.p.block(0, 0));
        self.memory.state.p.add_block::<CAMERA_DIM>(0, &slip);
        let mut agree = vec![false; found.len()];
        let any = self.agreement(found, &[], &prior, &mut agree).is_some();
        let loose = self.workspace.batch.nis();
        self.memory
            .state
            .p
            .set_block::<CAMERA_DIM, CAMERA_DIM>(0, 0, &own);
        self.workspace.batch.build(&self.memory.state);
        if !any || self.workspace.batch.factor().is_err() {
            return Ok(false);
        }
        Ok(self.workspace.batch.nis() - loose > chi2::quantile(level, MOTION))
    }

    /// Takes the last motion as if the wheels may have slipped: what is in sight is then looked for in a wider place.
    pub fn distrust_odometry(&mut self) {
        let Some(slip) = self.memory.wheels.untaken_slip() else {
            return;
        };
        self.changes();
        self.memory.wheels.trusted = Some(self.memory.state.p.block(0, 0));
        self.memory.state.p.add_block(0, &slip);
    }

    /// Takes [`Self::distrust_odometry`] back; nothing may have been measured since.
    pub fn trust_odometry(&mut self) {
        if let Some(own) = self.memory.wheels.trusted.take() {
            self.changes();
            self.memory.state.p.set_block(0, 0, &own);
        }
    }

    /// Forgets what was known of a slip: the motion has been measured.
    pub(crate) fn settle_odometry(&mut self) {
        self.memory.wheels = Wheels {
            unclear: self.memory.wheels.unclear,
            clear_clock: self.memory.wheels.clear_clock,
            ..Wheels::default()
        };
    }

    /// The scales that this frame is not to estimate, each by its row, mean and variance: they are considered.
    pub(crate) fn considered_scales(&self) -> [Option<(usize, f64, f64)>; 2] {
        let at = self.odometry_scale_at();
        std::array::from_fn(|k| {
            let row = at.filter(|_| self.memory.wheels.unclear[k])? + k;
            Some((
                row,
                self.memory.state.x[row],
                self.memory.state.p.get(row, row),
            ))
        })
    }

    /// Restores these scales after an update: all else was corrected with them in mind, and stays correlated with them.
    pub(crate) fn keep_scales(&mut self, scales: [Option<(usize, f64, f64)>; 2]) {
        for (row, mean, variance) in scales.into_iter().flatten() {
            self.memory.state.x[row] = mean;
            let variance = SMatrix::<f64, 1, 1>::new(variance);
            self.memory.state.p.set_block(row, row, &variance);
        }
    }

    /// Whether mean and covariance stay within all bounds along a motion.
    pub(super) fn check_motion(&self, motion: &Motion) -> Result<(), EkfError> {
        let covariance = motion.covariance(&self.memory.state.p.block(0, 0));
        guard::moved_is_sane(&motion.x, &covariance)
    }
}

/// A motion on its way from one time to another.
struct Telling<'a> {
    process: &'a ProcessSettings,
    scale: Vector2<f64>,
    before: &'a CameraMatrix,
    gyro: Option<Sensor<'a>>,
    motion: Motion,
    /// For how long the velocity may still be taken as constant, seconds.
    left: f64,
    /// For how long the gyroscope told the turn, seconds.
    turned: f64,
    /// By how much the turn changes with the gyroscope's clock, and the noise of that, rad/s.
    by_clock: [f64; 2],
}

impl Telling<'_> {
    /// From one time to another, as a reading over some seconds of it says, or at constant velocity; turning as the gyroscope
    /// says, as far as it does.
    fn go(&mut self, from: f64, until: f64, reading: Option<&dyn Fn(f64) -> Reading>) {
        let Some(gyro) = self.gyro else {
            return self.go_untold(until - from, reading);
        };
        let mut now = from;
        for (begin, end) in gyro.told(from, until) {
            self.go_untold(begin - now, reading);
            let turn = gyro.turn(begin, end);
            let dt = end - begin;
            if let Some(reading) = reading {
                let reading = reading(dt);
                self.motion
                    .follow_turning(&turn, &reading, &self.scale, self.before, self.process);
            } else {
                let drifted = dt.min(self.left);
                self.left -= drifted;
                self.motion.turn(&turn, drifted, self.process);
            }
            let (by, noise) = turn.by_clock();
            self.by_clock = [self.by_clock[0].max(by), noise];
            self.turned += dt;
            now = end;
        }
        self.go_untold(until - now, reading);
    }

    /// The same where no gyroscope says how it turns.
    fn go_untold(&mut self, dt: f64, reading: Option<&dyn Fn(f64) -> Reading>) {
        let (motion, process) = (&mut self.motion, self.process);
        let Some(reading) = reading else {
            let dt = dt.min(self.left);
            if dt > 0.0 {
                self.left -= dt;
                motion.drift(dt, process.velocity, process);
            }
            return;
        };
        if dt > 0.0 {
            motion.follow(dt, &reading(dt), &self.scale, self.before, process);
        }
    }
}

/// Whether the three numbers of a motion at `at` are [`CLEAR`] times their noise.
fn stands_out(way: &Vector6<f64>, noise: &Matrix6<f64>, at: usize) -> bool {
    let way = way.fixed_rows::<3>(at).into_owned();
    let noise = noise.fixed_view::<3, 3>(at, at).into_owned();
    let size = noise.cholesky().map(|noise| way.dot(&noise.solve(&way)));
    size.is_some_and(|size| size > CLEAR * CLEAR)
}

pub(super) fn camera_of(state: &State) -> [f64; CAMERA_DIM] {
    std::array::from_fn(|i| state.x[i])
}
