//! The turn of the camera as a gyroscope tells it, in place of constant angular velocity (METHOD 28).
//!
//! The rates between two times are integrated to one rotation, with what their noise makes of it and its derivatives by the
//! errors of the sensor that are in the state. The velocity goes on as it does without: constant, or as wheels tell it.

use super::motion::{Arc, ByScale, GYRO_DIM, OwnTwist, white};
use super::{CameraMatrix, Motion, Reading, Turned, TwistMatrix};
use crate::imu::{Imu, Sample};
use crate::math::quat::{self, Quat};
use crate::settings::{ImuSettings, MotionModel, ProcessSettings};
use crate::state::CAMERA_DIM;
use nalgebra::{Matrix3, SMatrix, SVector, Vector3};

/// By how much the moment that an image shows strays from its stamp, from frame to frame, seconds: exposures change, and what is
/// blurred is found where it was brightest. Standard deviation.
const STAMP_SD: f64 = 1e-3;

/// Where the clock is among them.
pub(crate) const CLOCK: usize = 7;

type Rows = SMatrix<f64, 3, GYRO_DIM>;

/// Where the errors of a gyroscope are in the state.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GyroAt {
    pub(crate) bias: usize,
    pub(crate) frame: usize,
    pub(crate) clock: usize,
}

/// What the filter holds of a gyroscope's errors.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Sensor<'a> {
    pub(crate) imu: &'a Imu,
    pub(crate) sizes: &'a ImuSettings,
    /// Bias along its axes, rad/s.
    pub(crate) bias: Vector3<f64>,
    /// To be added to its stamps, seconds.
    pub(crate) offset: f64,
}

/// The turn over some time.
#[derive(Clone, Debug)]
pub(crate) struct Turn {
    /// Seconds.
    dt: f64,
    /// Maps the axes of C at the end into those at the beginning.
    rotation: Quat,
    /// `w_C` at the end, rad/s.
    rate: Vector3<f64>,
    /// Derivatives by the sensor's errors: of the rotation's tangent on the right, and of the rate.
    pub(crate) by_gyro: Rows,
    rate_by_gyro: Rows,
    /// Variances of each axis by the rates' noise: of the rotation, of it with the rate, of the rate.
    noise: [f64; 3],
}

impl Sensor<'_> {
    /// Times, by the clock of the frames, between which the rate is known, within `from .. to`; each as long as it goes.
    pub(crate) fn told(&self, from: f64, to: f64) -> Vec<(f64, f64)> {
        let mut told: Vec<(f64, f64)> = Vec::new();
        for (before, after) in self.imu.pairs() {
            let begin = (before.t + self.offset).max(from);
            let end = (after.t + self.offset).min(to);
            if begin >= end {
                continue;
            }
            match told.last_mut() {
                Some((_, last)) if *last == begin => *last = end,
                _ => told.push((begin, end)),
            }
        }
        told
    }

    /// The rate along the axes of C at a time between two samples.
    fn rate(&self, before: &Sample, after: &Sample, t: f64) -> Vector3<f64> {
        let share = (t - self.offset - before.t) / (after.t - before.t);
        let rate = before.rate.lerp(&after.rate, share.clamp(0.0, 1.0));
        self.imu.r_ci * (rate - self.bias)
    }

    /// The turn between two times, within one of [`Self::told`].
    pub(crate) fn turn(&self, from: f64, to: f64) -> Turn {
        let mut rotation = quat::identity();
        let mut by_gyro = Rows::zeros();
        let (mut first, mut last) = (None, Vector3::zeros());
        let (mut spacing, mut count) = (0.0, 0.0);
        for (before, after) in self.imu.pairs() {
            let begin = (before.t + self.offset).max(from);
            let end = (after.t + self.offset).min(to);
            if begin >= end {
                continue;
            }
            let (dt, at_begin) = (end - begin, self.rate(before, after, begin));
            last = self.rate(before, after, end);
            first.get_or_insert(at_begin);
            let mean = (at_begin + last) * 0.5;
            let step = mean * dt;
            rotation = quat::right(&quat::exp(&step)) * rotation;
            by_gyro = quat::rotation_exp(&-step) * by_gyro
                + quat::right_jacobian(&step) * self.by_errors(&mean) * dt;
            spacing += after.t - before.t;
            count += 1.0;
        }
        let dt = to - from;
        let first = first.unwrap_or(last);
        // A clock that is behind by more has the rates of earlier: the turn gains at its beginning and loses at its end.
        let gained = quat::rotation(&rotation).transpose() * first - last;
        by_gyro.set_column(CLOCK, &gained);
        let mut rate_by_gyro = self.by_errors(&last);
        rate_by_gyro.set_column(CLOCK, &((first - last) / dt));
        let density = self.sizes.gyro_noise.powi(2);
        let spacing: f64 = spacing / count;
        Turn {
            dt,
            rotation: rotation / rotation.norm(),
            rate: last,
            by_gyro,
            rate_by_gyro,
            noise: [
                density * dt + (STAMP_SD * last.norm()).powi(2),
                density * 0.5 * (dt / spacing).min(1.0),
                density / spacing,
            ],
        }
    }

    /// Derivative of a rate along the axes of C by bias, scale and mounting.
    fn by_errors(&self, rate: &Vector3<f64>) -> Rows {
        let mut by = Rows::zeros();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&-self.imu.r_ci);
        by.set_column(3, rate);
        by.fixed_view_mut::<3, 3>(0, 4)
            .copy_from(&-quat::skew(rate));
        by
    }
}

impl Turn {
    /// By how much the turn changes with each second of the clock, and how large the noise of that is: both in rad/s.
    pub(crate) fn by_clock(&self) -> (f64, f64) {
        (
            self.by_gyro.column(CLOCK).norm(),
            (6.0 * self.noise[2]).sqrt(),
        )
    }
}

/// How a velocity takes the camera on while it turns: position and velocity after, and what they hang on.
struct Way {
    r: Vector3<f64>,
    v: Vector3<f64>,
    /// The camera's block by itself; attitude and rate are those of the turn.
    by_state: CameraMatrix,
    /// By the turn, tangent on the right at its end.
    by_turn: SMatrix<f64, CAMERA_DIM, 3>,
    by_scale: ByScale,
    noise: CameraMatrix,
}

impl Way {
    /// At the velocity of the state for some seconds.
    fn drifting(x: &[f64; CAMERA_DIM], turn: &Turn, dt: f64, process: &ProcessSettings) -> Self {
        let (r, v) = (part(x, 0), part(x, 7));
        let mut way = Self::nowhere(r + v * dt, v);
        way.noise = super::linear_noise(dt, process);
        way.by_state
            .fixed_view_mut::<3, 3>(0, 7)
            .fill_with_identity();
        way.by_state
            .fixed_view_mut::<3, 3>(7, 7)
            .fill_with_identity();
        let mut half = way.by_state.fixed_view_mut::<3, 3>(0, 7);
        half *= dt;
        if process.velocity == MotionModel::Body {
            let q = Quat::from_column_slice(&x[3..7]);
            let turned = Turned::new(&q, &v, &quat::rotation(&turn.rotation));
            way.r = r + (v + turned.v) * (0.5 * dt);
            way.v = turned.v;
            for (row, share) in [(0, 0.5 * dt), (7, 1.0)] {
                turned.write(&mut way.by_state, row, share);
                way.by_turn
                    .fixed_view_mut::<3, 3>(row, 0)
                    .copy_from(&(turned.by_turn * share));
            }
            let mut half = way.by_state.fixed_view_mut::<3, 3>(0, 7);
            half += Matrix3::identity() * (0.5 * dt);
        }
        way
    }

    fn nowhere(r: Vector3<f64>, v: Vector3<f64>) -> Self {
        let mut by_state = CameraMatrix::zeros();
        by_state.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        Self {
            r,
            v,
            by_state,
            by_turn: SMatrix::zeros(),
            by_scale: ByScale::zeros(),
            noise: CameraMatrix::zeros(),
        }
    }

    /// As a reading of wheels has it over the turn's time, whose own turn is left aside.
    fn following(
        x: &[f64; CAMERA_DIM],
        turn: &Turn,
        reading: &Reading,
        scale: &SVector<f64, 2>,
        covariance: &CameraMatrix,
        process: &ProcessSettings,
    ) -> Self {
        let dt = turn.dt;
        let q = Quat::from_column_slice(&x[3..7]);
        let own = OwnTwist::new(x);
        let by_camera = own.by_camera.fixed_rows::<3>(0).into_owned();
        let own: Vector3<f64> = own.twist.fixed_rows::<3>(0).into_owned();
        let top = |m: &TwistMatrix| m.fixed_view::<3, 3>(0, 0).into_owned();
        let white = white(dt, process);
        let (of_mean, of_both, of_end) = (top(&white.mean), top(&white.cross), top(&white.end));
        let by_scale = reading.by_scale.fixed_rows::<3>(0).into_owned();
        let told = reading.twist.fixed_rows::<3>(0) + by_scale * scale;
        let noise = top(&reading.covariance);
        let before = by_camera * covariance * by_camera.transpose();
        let sum = before + of_mean + noise;
        let one = Matrix3::identity();
        let solved = ((sum + sum.transpose()) * 0.5).cholesky();
        // A reading is positive definite; where rounding ate that, it is as good as the rest is bad.
        let gain = |with: Matrix3<f64>| {
            solved
                .as_ref()
                .map_or(one, |sum| sum.solve(&with.transpose()).transpose())
        };
        let (k, e) = (gain(before + of_mean), gain(before + of_both));
        let (mean, end) = (own + k * (told - own), own + e * (told - own));

        let angle = quat::log(&turn.rotation);
        let arc = Arc::new(&angle, &mean);
        let (start, moved) = (quat::rotation(&q), quat::right(&turn.rotation) * q);
        let after = quat::rotation(&moved);
        let step = arc.point * dt;
        let mut way = Self::nowhere(part(x, 0) + start * step, after * end);
        let by_attitude = quat::right(&turn.rotation);
        way.by_state
            .fixed_view_mut::<3, 4>(0, 3)
            .copy_from(&quat::rotate_jacobian(&q, &step));
        way.by_state
            .fixed_view_mut::<3, 4>(7, 3)
            .copy_from(&(quat::rotate_jacobian(&moved, &end) * by_attitude));
        let mut by_mean = SMatrix::<f64, CAMERA_DIM, 3>::zeros();
        by_mean
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(start * arc.by_velocity * dt));
        let mut by_end = SMatrix::<f64, CAMERA_DIM, 3>::zeros();
        by_end.fixed_view_mut::<3, 3>(7, 0).copy_from(&after);
        way.by_state += (by_mean * (one - k) + by_end * (one - e)) * by_camera;
        way.by_scale = (by_mean * k + by_end * e) * by_scale;
        let into_angle = quat::right_jacobian(&angle).try_inverse().unwrap_or(one);
        way.by_turn
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(start * arc.by_turn * into_angle * dt));
        way.by_turn
            .fixed_view_mut::<3, 3>(7, 0)
            .copy_from(&(-after * quat::skew(&end)));

        let left = one - k;
        let both = by_mean
            * (left * (of_both - of_mean * e.transpose()) + k * noise * e.transpose())
            * by_end.transpose();
        way.noise = by_mean
            * (left * of_mean * left.transpose() + k * noise * k.transpose())
            * by_mean.transpose()
            + both
            + both.transpose()
            + by_end
                * (of_end - e * of_both.transpose() - of_both * e.transpose()
                    + e * (of_mean + noise) * e.transpose())
                * by_end.transpose();
        way
    }
}

impl Motion {
    /// Turns as told, and goes on at constant velocity for `dt` seconds of that time.
    pub(crate) fn turn(&mut self, turn: &Turn, dt: f64, process: &ProcessSettings) {
        let way = Way::drifting(&self.x, turn, dt, process);
        self.turned(turn, &way);
    }

    /// Turns as told, and goes as a reading of wheels over the same time has it; all else as with [`Motion::follow`].
    pub(crate) fn follow_turning(
        &mut self,
        turn: &Turn,
        reading: &Reading,
        scale: &SVector<f64, 2>,
        before: &CameraMatrix,
        process: &ProcessSettings,
    ) {
        let covariance = self.covariance(before);
        let way = Way::following(&self.x, turn, reading, scale, &covariance, process);
        self.turned(turn, &way);
    }

    fn turned(&mut self, turn: &Turn, way: &Way) {
        let q = Quat::from_column_slice(&self.x[3..7]);
        let moved = quat::right(&turn.rotation) * q;
        let moved = moved / moved.norm();
        let mut f = way.by_state;
        f.fixed_view_mut::<4, 4>(3, 3)
            .copy_from(&quat::right(&turn.rotation));
        let mut by_turn = way.by_turn;
        by_turn
            .fixed_view_mut::<4, 3>(3, 0)
            .copy_from(&quat::lift(&moved));
        let mut by_rate = SMatrix::<f64, CAMERA_DIM, 3>::zeros();
        by_rate.fixed_view_mut::<3, 3>(10, 0).fill_with_identity();
        let [own, with, rate] = turn.noise;
        let mixed = by_turn * by_rate.transpose() * with;
        let noise = by_turn * by_turn.transpose() * own
            + mixed
            + mixed.transpose()
            + by_rate * by_rate.transpose() * rate
            + way.noise;
        self.x[..3].copy_from_slice(way.r.as_slice());
        self.x[3..7].copy_from_slice(moved.as_slice());
        self.x[7..10].copy_from_slice(way.v.as_slice());
        self.x[10..].copy_from_slice(turn.rate.as_slice());
        self.then(&f, &way.by_scale, &((noise + noise.transpose()) * 0.5));
        self.by_gyro += by_turn * turn.by_gyro + by_rate * turn.rate_by_gyro;
    }
}

fn part(x: &[f64; CAMERA_DIM], at: usize) -> Vector3<f64> {
    Vector3::from_column_slice(&x[at..at + 3])
}

#[cfg(test)]
mod tests {
    use super::{GYRO_DIM, Sensor};
    use crate::imu::Imu;
    use crate::math::quat;
    use crate::predict::directions::along;
    use crate::predict::{CameraMatrix, Motion, Reading};
    use crate::settings::{ImuSettings, MotionModel, ProcessSettings};
    use crate::state::CAMERA_DIM;
    use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector3, Vector6};
    use rand::SeedableRng;
    use rand_distr::{Distribution, StandardNormal};
    use rand_pcg::Pcg64;

    const RATE: f64 = 200.0;
    const END: f64 = 0.1;

    fn r_ci() -> Matrix3<f64> {
        quat::rotation_exp(&Vector3::new(0.4, -1.1, 0.7))
    }

    fn raw(t: f64) -> Vector3<f64> {
        Vector3::new(0.9 + 3.0 * t, -1.4 * (9.0 * t).cos(), 0.3 - 5.0 * t * t)
    }

    /// A sensor whose rates are off by these errors: bias, scale, mounting, clock.
    fn imu(errors: &SVector<f64, GYRO_DIM>) -> Imu {
        let bias = errors.fixed_rows::<3>(0).into_owned();
        let mount = quat::rotation_exp(&errors.fixed_rows::<3>(4).into_owned());
        let mut imu = Imu::at(&(mount * r_ci()));
        for k in -4..=30 {
            let t = f64::from(k) / RATE + 0.0013;
            let rate = (raw(t - 0.0013) - bias) * (1.0 + errors[3]);
            imu.add(t, &rate).expect("in order");
        }
        imu
    }

    fn camera() -> [f64; CAMERA_DIM] {
        let q = quat::exp(&Vector3::new(0.3, -0.5, 0.2));
        [
            0.4, -0.2, 1.0, q[0], q[1], q[2], q[3], 0.6, -0.1, 0.9, 7.0, 7.0, 7.0,
        ]
    }

    fn process(velocity: MotionModel) -> ProcessSettings {
        ProcessSettings {
            velocity,
            ..ProcessSettings::default()
        }
    }

    fn wheels() -> Reading {
        Reading {
            twist: Vector6::new(0.05, -0.02, 1.1, 3.0, 3.0, 3.0),
            covariance: Matrix6::from_diagonal(&Vector6::new(0.04, 4.0, 0.1, 0.5, 0.02, 9.0)),
            by_scale: SMatrix::from_fn(|i, j| if i / 3 == j { 0.5 + i as f64 } else { 0.0 }),
        }
    }

    /// The camera's motion: alone, or along the wheels.
    fn moved(
        x: &[f64; CAMERA_DIM],
        errors: &SVector<f64, GYRO_DIM>,
        model: Option<MotionModel>,
    ) -> Motion {
        let imu = imu(errors);
        let sensor = Sensor {
            imu: &imu,
            sizes: &ImuSettings::default(),
            bias: Vector3::zeros(),
            offset: -0.0013 + errors[7],
        };
        let turn = sensor.turn(0.0, END);
        let mut motion = Motion::new(*x);
        match model {
            Some(model) => motion.turn(&turn, END, &process(model)),
            // The velocity is known so badly that the gains hardly hang on it.
            None => motion.follow_turning(
                &turn,
                &wheels(),
                &SVector::zeros(),
                &CameraMatrix::from_diagonal_element(1e6),
                &process(MotionModel::World),
            ),
        }
        motion
    }

    #[test]
    fn derivatives_are_those_of_the_motion() {
        for model in [Some(MotionModel::World), Some(MotionModel::Body), None] {
            let (x, none) = (camera(), SVector::<f64, GYRO_DIM>::zeros());
            let motion = moved(&x, &none, model);
            let h = 1e-6;
            for j in 0..CAMERA_DIM {
                let d = along(&x, j);
                let at = |h: f64| {
                    let x: [f64; CAMERA_DIM] = std::array::from_fn(|i| x[i] + h * d[i]);
                    SVector::from(moved(&x, &none, model).x)
                };
                let off = (at(h) - at(-h)) / (2.0 * h) - motion.by_camera * d;
                let bound = if model.is_some() { 1e-7 } else { 1e-5 };
                assert!(off.abs().max() < bound, "{model:?}, {j}: {off}");
            }
            for j in 0..GYRO_DIM {
                let at = |h: f64| {
                    let errors = SVector::from_fn(|i, _| h * f64::from(i == j));
                    SVector::<f64, CAMERA_DIM>::from(moved(&x, &errors, model).x)
                };
                let mut off = (at(h) - at(-h)) / (2.0 * h) - motion.by_gyro.column(j);
                if j == 7 {
                    // Of the rate by the clock the mean over the time is taken: single samples would make it noise.
                    off.fixed_rows_mut::<3>(10).fill(0.0);
                }
                // The trapezoid's own error stands in the clock's derivative.
                let bound = if j == 7 { 5e-3 } else { 1e-6 };
                assert!(off.abs().max() < bound, "{model:?}, error {j}: {off}");
            }
        }
    }

    #[test]
    fn the_turn_is_that_of_the_rates_and_its_noise_theirs() {
        let none = SVector::<f64, GYRO_DIM>::zeros();
        let exact = moved(&camera(), &none, Some(MotionModel::World));
        let mut fine = quat::Quat::from_column_slice(&camera()[3..7]);
        let steps = 20_000;
        for k in 0..steps {
            let dt = END / f64::from(steps);
            let rate = r_ci() * raw((f64::from(k) + 0.5) * dt);
            fine = quat::right(&quat::exp(&(rate * dt))) * fine;
        }
        let turned = quat::Quat::from_column_slice(&exact.x[3..7]);
        let off = quat::tangent(&fine) * turned;
        assert!(off.norm() < 5e-5, "{off}");
        assert!(
            (SVector::<f64, 3>::from_column_slice(&exact.x[10..]) - r_ci() * raw(END)).norm()
                < 1e-9
        );

        let sizes = ImuSettings {
            gyro_noise: 0.02,
            ..ImuSettings::default()
        };
        let mut rng = Pcg64::seed_from_u64(5);
        let (runs, mut own, mut with, mut rate) = (4000, 0.0, 0.0, 0.0);
        let at_rest = |noise: &mut dyn FnMut() -> f64| {
            let mut imu = Imu::default();
            for k in 0..=20 {
                let rates = Vector3::from_fn(|_, _| noise());
                imu.add(f64::from(k) / RATE, &rates).expect("in order");
            }
            let sensor = Sensor {
                imu: &imu,
                sizes: &sizes,
                bias: Vector3::zeros(),
                offset: 0.0,
            };
            sensor.turn(0.0, END)
        };
        let sd = sizes.gyro_noise * RATE.sqrt();
        for _ in 0..runs {
            let turn = at_rest(&mut || {
                let draw: f64 = StandardNormal.sample(&mut rng);
                sd * draw
            });
            let angle = quat::log(&turn.rotation);
            let share = 1.0 / (3.0 * f64::from(runs));
            own += angle.norm_squared() * share;
            with += angle.dot(&turn.rate) * share;
            rate += turn.rate.norm_squared() * share;
        }
        let mut tiny = 0.0;
        let claimed = at_rest(&mut || {
            tiny += 1e-12;
            tiny
        });
        let claimed = claimed.noise;
        // The first and the last sample count by halves, as their other halves are in the frames beside.
        assert!((own / claimed[0] - 0.975).abs() < 0.06, "{own} {claimed:?}");
        assert!((rate / claimed[2] - 1.0).abs() < 0.06, "{rate} {claimed:?}");
        // Four standard deviations of its mean over the runs.
        let band = 4.0 * (own * rate / (3.0 * f64::from(runs))).sqrt();
        assert!(
            (with - claimed[1]).abs() < band && band < 0.5 * claimed[1],
            "{with} {claimed:?}"
        );
    }
}
