//! A prediction that takes the camera's turn from two images, where the map does not tell it (METHOD 27), and what they say of a
//! gyroscope (METHOD 28).

use super::odometry::camera_of;
use super::unseen::UNSEEN;
use crate::chi2::{self, SURE_LEVEL};
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::Followed;
use crate::filter::memory::Memory;
use crate::filter::memory::wheels::Wheels;
use crate::guard;
use crate::gyroscope::{self, ImageTurn, Surroundings};
use crate::math::quat;
use crate::observe::POSE_DIM;
use crate::predict::{CameraMatrix, Motion, Reading};
use crate::state::State;
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector2, Vector3, Vector6};

/// Noise of a followed point, pixels of Cs: images are blurred where this is needed.
const SIGMA: f64 = 1.5;

/// Longest time between the two images, seconds.
const LONGEST: f64 = 1.0;

/// Variance of a velocity of which the images say nothing, (m/s)^2.
const UNTOLD: f64 = 1e6;

/// Least standard deviation of the points that agree along each side of the image, as a share of that side: where they are all
/// over it, it is 0.29.
const SPREAD: f64 = 0.12;

/// By how much a turn that is seen may be off where depths lie as on no plane, as a share of it: standard deviation. The claimed
/// one takes what a plane leaves of them as independent.
const SLANTED: f64 = 0.1;

/// The same where it is held against what the map tells of the same image, which costs no more than to measure it once more.
const SLANTED_MAP: f64 = 0.05;

/// The same of a lost camera's turn that a part of the image shows: it may be somebody's who walks by.
const OF_A_PART: f64 = 0.5;

/// What points of two images show.
struct Shown<'a> {
    seen: ImageTurn,
    /// What the filter was at the first of them.
    kept: &'a Memory,
    /// Seconds between them.
    dt: f64,
    /// Whether those that agree are all over the image: somebody who walks by is on a part of it.
    is_spread: bool,
}

impl Filter {
    /// Predicts the present frame again, from the checkpoint of the frame before, with the turn that the images of both show.
    /// To be asked where the frame has measured nothing; what was done since the checkpoint is undone. False, with nothing
    /// changed, where the images do not tell the turn, the last checkpoint is not of that frame, odometry told the motion, or a
    /// gyroscope a turn that the images do not contradict.
    ///
    /// # Errors
    /// `NonFinite`; `InvalidInput` if the lists differ in length; nothing changes then.
    pub fn predict_again(&mut self, followed: &Followed) -> Result<bool, EkfError> {
        followed.check()?;
        let Some((motion, is_told)) = self.turned_motion(followed) else {
            return Ok(false);
        };
        let time = self.memory.time;
        self.rollback()?;
        if is_told {
            self.forget_rate();
        }
        if let (Some(t), Some(last)) = (time, self.memory.time) {
            self.predict_along(&motion, t - last);
            self.arrive(t);
        }
        Ok(true)
    }

    /// Whether the turn that the last two images show is what the gyroscope told of it; to be asked before the frame is
    /// measured, as for [`Self::predict_again`]. `None` where the images do not tell the turn, and where no
    /// gyroscope did.
    ///
    /// # Errors
    /// As there.
    pub fn gyro_agrees(&self, followed: &Followed) -> Result<Option<bool>, EkfError> {
        followed.check()?;
        if self.memory.wheels.turned.is_none() {
            return Ok(None);
        }
        let shown = self.shown_turn(followed).filter(|shown| shown.is_spread);
        Ok(shown.map(|shown| !self.excludes_told(&shown.seen, &shown.kept.state)))
    }

    /// The turn that the images show, and the attitude at the checkpoint, from where it is; of a checkpoint whose frame was used:
    /// after one that was not the map corrects what was wrong before, too.
    pub(in crate::filter) fn turn_from_checkpoint(
        &self,
        followed: &Followed,
    ) -> Option<(ImageTurn, Matrix3<f64>)> {
        if self.undo.kept.as_deref()?.memory.unused > 0 {
            return None;
        }
        let shown = self.shown_turn(followed).filter(|shown| shown.is_spread)?;
        Some((shown.seen, attitude(&shown.kept.state)))
    }

    /// Whether a turn that was seen excludes that from one attitude to another, which the map tells. A rate that changes bends both
    /// alike: they are of the same rows.
    pub(in crate::filter) fn excludes_turn(
        (seen, from): &(ImageTurn, Matrix3<f64>),
        to: &Matrix3<f64>,
    ) -> bool {
        is_excluded(
            seen,
            &(from.transpose() * to),
            &Matrix3::zeros(),
            0.0,
            SLANTED_MAP,
        )
    }

    /// The motion with the turn that the images show, and whether a gyroscope told another one.
    fn turned_motion(&self, followed: &Followed) -> Option<(Motion, bool)> {
        if self.memory.wheels.followed {
            return None;
        }
        let is_told = self.memory.wheels.turned.is_some();
        let shown = self.shown_turn(followed)?;
        let (mut seen, kept, dt) = (shown.seen, shown.kept, shown.dt);
        if is_told && !self.excludes_told(&seen, &kept.state) {
            return None;
        }
        if !shown.is_spread {
            if is_told || kept.unused < UNSEEN {
                return None;
            }
            seen.covariance += Matrix3::identity() * (OF_A_PART * seen.turn.norm()).powi(2);
        }
        let process = &self.setup.settings.process;
        let mut block: CameraMatrix = kept.state.p.block(0, 0);
        if is_told {
            // The rate of before is the gyroscope's, too.
            let mut rate = block.fixed_view_mut::<3, 3>(POSE_DIM + 3, POSE_DIM + 3);
            rate += Matrix3::identity() * process.start_angular_velocity_sd.powi(2);
        }
        let reading = self.reading(&seen, &kept.state, dt);
        let mut motion = Motion::new(camera_of(&kept.state));
        if !is_told && !motion.may_be(dt, &reading, &block, process, SURE_LEVEL) {
            return None;
        }
        motion.follow(dt, &reading, &SVector::zeros(), &block, process);
        guard::moved_is_sane(&motion.x, &motion.covariance(&block)).ok()?;
        Some((motion, is_told))
    }

    /// What the images show of the turn.
    fn shown_turn(&self, followed: &Followed) -> Option<Shown<'_>> {
        let kept = &self.undo.kept.as_deref()?.memory;
        let dt = self.memory.time? - followed.since;
        let is_next =
            kept.started && kept.time == Some(followed.since) && 0.0 < dt && dt <= LONGEST;
        if !is_next {
            return None;
        }
        let ray = |uv| self.setup.camera.unproject(uv)?.try_normalize(0.0);
        let (mut pairs, mut pixels) = (Vec::new(), Vec::new());
        for (first, second) in followed.before.iter().zip(&followed.now) {
            if let (Some(a), Some(b)) = (ray(first), ray(second)) {
                pairs.push((a, b));
                pixels.push(first);
            }
        }
        let seen = gyroscope::seen_turn(&pairs, &self.surroundings(&kept.state, dt))?;
        let is_spread = self.is_spread(seen.agreeing.iter().map(|&i| pixels[i]));
        Some(Shown {
            seen,
            kept,
            dt,
            is_spread,
        })
    }

    /// Whether a turn that was seen excludes the one that a gyroscope told, of the present prediction.
    fn excludes_told(&self, seen: &ImageTurn, then: &State) -> bool {
        let Some(told) = self.memory.wheels.turned else {
            return false;
        };
        let turn = attitude(then).transpose() * attitude(&self.memory.state);
        let change = self.memory.state.angular_velocity() - then.angular_velocity();
        is_excluded(seen, &turn, &told, self.shutter_variance(&change), SLANTED)
    }

    /// Whether points are spread over the image.
    fn is_spread<'a>(&self, uv: impl Iterator<Item = &'a Vector2<f64>> + Clone) -> bool {
        let count = uv.clone().count() as f64;
        let mean = uv.clone().sum::<Vector2<f64>>() / count;
        let square = uv
            .map(|uv| (uv - mean).component_mul(&(uv - mean)))
            .sum::<Vector2<f64>>();
        let sd = (square / count).map(f64::sqrt);
        let size = Vector2::new(
            f64::from(self.setup.camera.width),
            f64::from(self.setup.camera.height),
        );
        sd.x >= SPREAD * size.x && sd.y >= SPREAD * size.y
    }

    /// The mean twist of the camera along its axes, of which the images tell the turn.
    fn reading(&self, seen: &ImageTurn, state: &State, dt: f64) -> Reading {
        let r_cw = quat::rotation(&state.part::<4>(3)).transpose();
        let mut twist = Vector6::zeros();
        twist
            .fixed_rows_mut::<3>(0)
            .copy_from(&(r_cw * state.velocity()));
        twist.fixed_rows_mut::<3>(3).copy_from(&(seen.turn / dt));
        let change = seen.turn / dt - state.angular_velocity();
        let slanted = (SLANTED * seen.turn.norm()).powi(2);
        let more = Matrix3::identity() * (self.shutter_variance(&change) + slanted);
        let of_turn = seen.covariance + more;
        let mut covariance = Matrix6::identity() * UNTOLD;
        covariance
            .fixed_view_mut::<3, 3>(3, 3)
            .copy_from(&(of_turn / (dt * dt)));
        Reading {
            twist,
            covariance,
            by_scale: SMatrix::zeros(),
        }
    }

    /// What is known of the way and of the depths before the frame.
    fn surroundings(&self, state: &State, dt: f64) -> Surroundings {
        let r_cw = quat::rotation(&state.part::<4>(3)).transpose();
        let white = self.setup.settings.process.acceleration_density.powi(2) * dt.powi(3) / 3.0;
        let velocity: Matrix3<f64> = state.p.block(POSE_DIM, POSE_DIM);
        let vague = self.vague_depth();
        Surroundings {
            way: r_cw * state.velocity() * dt,
            way_covariance: r_cw * velocity * r_cw.transpose() * (dt * dt)
                + Matrix3::identity() * white,
            rho: vague.rho,
            rho_sd: vague.sd,
            sigma: SIGMA / (self.setup.camera.fx * self.setup.camera.fy).sqrt(),
        }
    }

    /// Rows of an image are read one after the other. A turn that goes on as it was bends both images alike; one whose rate
    /// changes by `change` meanwhile shows each row another turn, by up to that times the readout. Variance of that, rad^2.
    fn shutter_variance(&self, change: &Vector3<f64>) -> f64 {
        let readout = self
            .readout()
            .map_or(0.0, |(readout, sd)| readout * readout + sd * sd);
        readout * change.norm_squared()
    }

    /// Moves camera and P along a motion of `dt` seconds.
    fn predict_along(&mut self, motion: &Motion, dt: f64) {
        self.changes();
        self.memory.wheels = Wheels::default();
        let settings = &self.setup.settings;
        crate::predict::predict_along(&mut self.memory.state, motion, None, None);
        crate::predict::forget(&mut self.memory.state, dt, settings);
        self.look_about();
    }
}

fn attitude(state: &State) -> Matrix3<f64> {
    quat::rotation(&state.part::<4>(3))
}

/// Whether a turn that was seen excludes another one, which is known up to a covariance; `bent` is what the shutter may make of
/// it, a variance of each axis, and `slanted` what walls may, a share of the turn.
fn is_excluded(
    seen: &ImageTurn,
    turn: &Matrix3<f64>,
    known: &Matrix3<f64>,
    bent: f64,
    slanted: f64,
) -> bool {
    let off = quat::rotation_log(&(turn.transpose() * quat::rotation_exp(&seen.turn)));
    let largest = quat::rotation_log(turn).norm().max(seen.turn.norm());
    let more = Matrix3::identity() * (bent + (slanted * largest).powi(2));
    let spread = known + seen.covariance + more;
    let distance = ((spread + spread.transpose()) * 0.5)
        .cholesky()
        .map(|spread| off.dot(&spread.solve(&off)));
    distance.is_some_and(|distance| distance > chi2::quantile(SURE_LEVEL, 3.0))
}

impl Followed {
    /// Refuses what is no pairs of finite pixels.
    pub(in crate::filter) fn check(&self) -> Result<(), EkfError> {
        let what = "points followed";
        let [before, now] = [&self.before, &self.now];
        if before.len() != now.len() {
            let why = format!(
                "{} were and {} are in view; give pairs",
                before.len(),
                now.len()
            );
            return Err(EkfError::InvalidInput { what, why });
        }
        let mut numbers = before.iter().chain(now).flat_map(|uv| uv.iter());
        if !self.since.is_finite() || numbers.any(|x| !x.is_finite()) {
            return Err(EkfError::NonFinite { what });
        }
        Ok(())
    }
}
