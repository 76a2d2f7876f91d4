//! The camera's motion as odometry tells it, with what its own velocity says where odometry does not (METHOD 23).
//!
//! Both are measurements of the same mean twist: the velocity of the state with the process noise of the time, and the
//! reading with its covariance. They are joined with fixed gains, and what each of them leaves unknown goes into P, so that
//! the covariance is right whatever the gains are. An axis that odometry does not know, of large variance, so keeps its
//! constant velocity.

use super::{CameraMatrix, process_noise, transition};
use crate::chi2;
use crate::math::quat;
use crate::settings::{MotionModel, ProcessSettings};
use crate::state::CAMERA_DIM;
use nalgebra::{Matrix3, Matrix6, SMatrix, SVector, Vector3, Vector6};

/// Errors of a gyroscope in the state: bias (3), scale (1), mounting (3), clock (1).
pub(crate) const GYRO_DIM: usize = 8;

/// 13x8: the camera's block by the errors of the gyroscope.
pub(crate) type ByGyro = SMatrix<f64, CAMERA_DIM, GYRO_DIM>;

/// 6x6 over a twist `(v, w)`.
pub(crate) type TwistMatrix = Matrix6<f64>;

/// 13x2: the camera's block by the errors of the odometry's scales, of translation and of turns.
pub(crate) type ByScale = SMatrix<f64, CAMERA_DIM, 2>;

type ByTwist = SMatrix<f64, CAMERA_DIM, 6>;

/// What odometry says of the camera over some time.
#[derive(Clone, Debug)]
pub(crate) struct Reading {
    /// Mean twist of C along its axes, m/s and rad/s.
    pub(crate) twist: Vector6<f64>,
    /// Of it over that time.
    pub(crate) covariance: TwistMatrix,
    /// Derivative of the true twist by the errors of the two scales: `(v, w)` is `(1 + s)` times what was measured.
    pub(crate) by_scale: SMatrix<f64, 6, 2>,
}

/// By how much the twist moves from the state's towards the reading's: of the mean over the time, and of that at its end.
#[derive(Clone, Debug)]
pub(crate) struct Gains {
    /// Of the mean.
    pub(crate) mean: TwistMatrix,
    /// Of the end.
    pub(crate) end: TwistMatrix,
}

/// The camera's block on its way through a prediction: its mean, and how it depends on what it was.
#[derive(Clone, Debug)]
pub(crate) struct Motion {
    /// The mean `[r q v w]`.
    pub(crate) x: [f64; CAMERA_DIM],
    /// Its derivative by the block before.
    pub(crate) by_camera: CameraMatrix,
    /// Its derivative by the scales' errors.
    pub(crate) by_scale: ByScale,
    /// Its derivative by the gyroscope's errors.
    pub(crate) by_gyro: ByGyro,
    /// Noise.
    pub(crate) noise: CameraMatrix,
}

impl Motion {
    /// Before any motion.
    pub(crate) fn new(x: [f64; CAMERA_DIM]) -> Self {
        Self {
            x,
            by_camera: CameraMatrix::identity(),
            by_scale: ByScale::zeros(),
            by_gyro: ByGyro::zeros(),
            noise: CameraMatrix::zeros(),
        }
    }

    /// Covariance of the block if it was `before`, the scales taken as exact.
    pub(crate) fn covariance(&self, before: &CameraMatrix) -> CameraMatrix {
        self.by_camera * before * self.by_camera.transpose() + self.noise
    }

    /// `dt` seconds of constant velocity.
    pub(crate) fn drift(&mut self, dt: f64, model: MotionModel, process: &ProcessSettings) {
        let f = transition(&mut self.x, dt, model);
        let q = SVector::from_column_slice(&self.x[3..7]);
        let noise = process_noise(&q, dt, process);
        self.then(&f, &ByScale::zeros(), &noise);
    }

    /// `dt` seconds as a reading has them; `before` is the covariance of the block before the prediction, `scale` the present
    /// estimate of the scales' errors.
    pub(crate) fn follow(
        &mut self,
        dt: f64,
        reading: &Reading,
        scale: &SVector<f64, 2>,
        before: &CameraMatrix,
        process: &ProcessSettings,
    ) {
        let own = OwnTwist::new(&self.x);
        let covariance = own.by_camera * self.covariance(before) * own.by_camera.transpose();
        let white = white(dt, process);
        let gains = gains(&covariance, reading, &white);
        let told = reading.twist + reading.by_scale * scale;
        let step = Step::new(&self.x, dt, &own, &told, &gains);
        let one = TwistMatrix::identity();
        let (left_mean, left_end) = (one - gains.mean, one - gains.end);
        let f = step.by_state + (step.by_mean * left_mean + step.by_end * left_end) * own.by_camera;
        let g = (step.by_mean * gains.mean + step.by_end * gains.end) * reading.by_scale;
        let noise = step.noise(&gains, &white, &reading.covariance);
        self.x = step.x;
        self.then(&f, &g, &noise);
    }

    /// Whether a reading is one that this motion can have over the next `dt` seconds, at a level of chi2.
    pub(crate) fn may_be(
        &self,
        dt: f64,
        reading: &Reading,
        before: &CameraMatrix,
        process: &ProcessSettings,
        level: f64,
    ) -> bool {
        let own = OwnTwist::new(&self.x);
        let covariance = own.by_camera * self.covariance(before) * own.by_camera.transpose();
        let spread = covariance + white(dt, process).mean + reading.covariance;
        let off = reading.twist - own.twist;
        let distance = ((spread + spread.transpose()) * 0.5)
            .cholesky()
            .map(|s| off.dot(&s.solve(&off)));
        distance.is_some_and(|distance| distance <= chi2::quantile(level, 6.0))
    }

    pub(super) fn then(&mut self, f: &CameraMatrix, g: &ByScale, noise: &CameraMatrix) {
        self.by_camera = f * self.by_camera;
        self.by_scale = f * self.by_scale + g;
        self.by_gyro = f * self.by_gyro;
        self.noise = f * self.noise * f.transpose() + noise;
    }
}

/// Covariances of white acceleration over a time: of the mean of the twist over it, with that at its end, of the latter.
pub(super) struct White {
    pub(super) mean: TwistMatrix,
    pub(super) cross: TwistMatrix,
    pub(super) end: TwistMatrix,
}

pub(super) fn white(dt: f64, process: &ProcessSettings) -> White {
    let linear = process.acceleration_density.powi(2) * dt;
    let angular = process.angular_acceleration_density.powi(2) * dt;
    let density = Vector6::new(linear, linear, linear, angular, angular, angular);
    let end = Matrix6::from_diagonal(&density);
    White {
        mean: end / 3.0,
        cross: end / 2.0,
        end,
    }
}

/// The gains of least variance if the reading's error and the state's were independent.
fn gains(own: &TwistMatrix, reading: &Reading, white: &White) -> Gains {
    let mean = own + white.mean;
    let sum = mean + reading.covariance;
    let Some(sum) = ((sum + sum.transpose()) * 0.5).cholesky() else {
        // A reading is positive definite; where rounding ate that, it is as good as the rest is bad.
        return Gains {
            mean: TwistMatrix::identity(),
            end: TwistMatrix::identity(),
        };
    };
    Gains {
        mean: sum.solve(&mean).transpose(),
        end: sum.solve(&(own + white.cross).transpose()).transpose(),
    }
}

/// The twist of the camera along its own axes, as its state has it.
pub(super) struct OwnTwist {
    pub(super) twist: Vector6<f64>,
    pub(super) by_camera: SMatrix<f64, 6, CAMERA_DIM>,
}

impl OwnTwist {
    pub(super) fn new(x: &[f64; CAMERA_DIM]) -> Self {
        let q = quat::Quat::from_column_slice(&x[3..7]);
        let (v, w) = (
            Vector3::from_column_slice(&x[7..10]),
            Vector3::from_column_slice(&x[10..]),
        );
        let into = quat::rotation(&q).transpose();
        let mut by_camera = SMatrix::<f64, 6, CAMERA_DIM>::zeros();
        by_camera
            .fixed_view_mut::<3, 4>(0, 3)
            .copy_from(&quat::rotate_inverse_jacobian(&q, &v));
        by_camera.fixed_view_mut::<3, 3>(0, 7).copy_from(&into);
        by_camera.fixed_view_mut::<3, 3>(3, 10).fill_with_identity();
        Self {
            twist: stacked(&(into * v), &w),
            by_camera,
        }
    }
}

/// One motion at a constant twist, and its derivatives.
struct Step {
    x: [f64; CAMERA_DIM],
    /// By position and attitude before.
    by_state: CameraMatrix,
    /// By the mean twist, and by that at the end.
    by_mean: ByTwist,
    by_end: ByTwist,
}

impl Step {
    fn new(
        x: &[f64; CAMERA_DIM],
        dt: f64,
        own: &OwnTwist,
        told: &Vector6<f64>,
        gains: &Gains,
    ) -> Self {
        let off = told - own.twist;
        let (mean, end) = (own.twist + gains.mean * off, own.twist + gains.end * off);
        let q = quat::Quat::from_column_slice(&x[3..7]);
        let before = quat::rotation(&q);
        let (v, w) = halves(&mean);
        let turn = w * dt;
        let arc = Arc::new(&turn, &v);
        let way = arc.point * dt;
        let moved = quat::right(&quat::exp(&turn)) * q;
        let after = quat::rotation(&moved);
        let (v_end, w_end) = halves(&end);

        let mut by_state = CameraMatrix::zeros();
        by_state.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        by_state
            .fixed_view_mut::<3, 4>(0, 3)
            .copy_from(&quat::rotate_jacobian(&q, &way));
        let by_attitude = quat::right(&quat::exp(&turn));
        by_state
            .fixed_view_mut::<4, 4>(3, 3)
            .copy_from(&by_attitude);
        let turned = quat::rotate_jacobian(&moved, &v_end);
        by_state
            .fixed_view_mut::<3, 4>(7, 3)
            .copy_from(&(turned * by_attitude));

        let mut by_mean = ByTwist::zeros();
        by_mean
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(before * arc.by_velocity * dt));
        by_mean
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(before * arc.by_turn * (dt * dt)));
        let by_turn = quat::left(&q) * quat::exp_jacobian(&turn) * dt;
        by_mean.fixed_view_mut::<4, 3>(3, 3).copy_from(&by_turn);
        by_mean
            .fixed_view_mut::<3, 3>(7, 3)
            .copy_from(&(turned * by_turn));

        let mut by_end = ByTwist::zeros();
        by_end.fixed_view_mut::<3, 3>(7, 0).copy_from(&after);
        by_end.fixed_view_mut::<3, 3>(10, 3).fill_with_identity();

        let mut out = *x;
        let r = Vector3::from_column_slice(&x[..3]) + before * way;
        out[..3].copy_from_slice(r.as_slice());
        out[3..7].copy_from_slice((moved / moved.norm()).as_slice());
        out[7..10].copy_from_slice((after * v_end).as_slice());
        out[10..].copy_from_slice(w_end.as_slice());
        Self {
            x: out,
            by_state,
            by_mean,
            by_end,
        }
    }

    /// What the state's velocity, joined with a reading of this covariance, leaves unknown.
    fn noise(&self, gains: &Gains, white: &White, reading: &TwistMatrix) -> CameraMatrix {
        let (k, e) = (&gains.mean, &gains.end);
        let left = TwistMatrix::identity() - k;
        let mean = left * white.mean * left.transpose() + k * reading * k.transpose();
        let cross = left * (white.cross - white.mean * e.transpose()) + k * reading * e.transpose();
        let end = white.end - e * white.cross.transpose() - white.cross * e.transpose()
            + e * (white.mean + reading) * e.transpose();
        let mixed = self.by_mean * cross * self.by_end.transpose();
        let noise = self.by_mean * mean * self.by_mean.transpose()
            + mixed
            + mixed.transpose()
            + self.by_end * end * self.by_end.transpose();
        (noise + noise.transpose()) * 0.5
    }
}

/// The way of a point that moves with the velocity `v` along axes that turn by `turn` meanwhile, per unit of time.
pub(super) struct Arc {
    pub(super) point: Vector3<f64>,
    pub(super) by_velocity: Matrix3<f64>,
    pub(super) by_turn: Matrix3<f64>,
}

impl Arc {
    pub(super) fn new(turn: &Vector3<f64>, v: &Vector3<f64>) -> Self {
        let a2 = turn.norm_squared();
        // (1 - cos a) / a^2, (a - sin a) / a^3, and their derivatives by a, over a.
        let (b, c, db, dc) = if a2 < 1e-4 {
            (
                0.5 - a2 / 24.0 + a2 * a2 / 720.0,
                1.0 / 6.0 - a2 / 120.0 + a2 * a2 / 5040.0,
                -1.0 / 12.0 + a2 / 180.0,
                -1.0 / 60.0 + a2 / 1260.0,
            )
        } else {
            let a = a2.sqrt();
            let (sin, cos) = a.sin_cos();
            (
                (1.0 - cos) / a2,
                (a - sin) / (a2 * a),
                (a * sin - 2.0 * (1.0 - cos)) / (a2 * a2),
                (3.0 * sin - 2.0 * a - a * cos) / (a2 * a2 * a),
            )
        };
        let k = quat::skew(turn);
        let (once, twice) = (k * v, k * k * v);
        let by_velocity = Matrix3::identity() + k * b + k * k * c;
        let by_turn = -quat::skew(v) * b + once * turn.transpose() * db
            - (quat::skew(&once) + k * quat::skew(v)) * c
            + twice * turn.transpose() * dc;
        Self {
            point: v + once * b + twice * c,
            by_velocity,
            by_turn,
        }
    }
}

fn halves(twist: &Vector6<f64>) -> (Vector3<f64>, Vector3<f64>) {
    (
        twist.fixed_rows::<3>(0).into_owned(),
        twist.fixed_rows::<3>(3).into_owned(),
    )
}

fn stacked(v: &Vector3<f64>, w: &Vector3<f64>) -> Vector6<f64> {
    Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
}

#[cfg(test)]
mod tests {
    use super::{ByScale, Gains, Motion, OwnTwist, Reading, Step, gains, white};
    use crate::math::quat;
    use crate::predict::CameraMatrix;
    use crate::predict::directions::along;
    use crate::settings::ProcessSettings;
    use crate::state::CAMERA_DIM;
    use nalgebra::{Matrix6, SMatrix, SVector, Vector3, Vector6};

    fn camera(turn: f64) -> [f64; CAMERA_DIM] {
        let q = quat::exp(&Vector3::new(0.3, -0.5, 0.2));
        let mut x = [
            0.4, -0.2, 1.0, q[0], q[1], q[2], q[3], 0.6, -0.1, 0.9, 0.0, 0.0, 0.0,
        ];
        x[10..].copy_from_slice(&[0.2 * turn, -turn, 0.4 * turn]);
        x
    }

    fn reading(turn: f64) -> Reading {
        Reading {
            twist: Vector6::new(0.05, -0.02, 1.1, 0.1 * turn, -1.3 * turn, 0.2 * turn),
            covariance: Matrix6::from_diagonal(&Vector6::new(0.04, 4.0, 0.1, 0.5, 0.02, 9.0)),
            by_scale: SMatrix::from_fn(|i, j| if i / 3 == j { 0.5 + i as f64 } else { 0.1 }),
        }
    }

    fn moved(x: &[f64; CAMERA_DIM], s: &SVector<f64, 2>, turn: f64, k: &Gains) -> SVector<f64, 13> {
        let reading = reading(turn);
        let told = reading.twist + reading.by_scale * s;
        SVector::from(Step::new(x, 0.1, &OwnTwist::new(x), &told, k).x)
    }

    #[test]
    fn derivatives_are_those_of_the_motion() {
        for turn in [0.0, 1e-3, 0.8, 20.0] {
            let (x, reading, process) = (camera(turn), reading(turn), ProcessSettings::default());
            let before = CameraMatrix::identity() * 0.01;
            let own = OwnTwist::new(&x);
            let p = own.by_camera * before * own.by_camera.transpose();
            let k = gains(&p, &reading, &white(0.1, &process));
            let mut motion = Motion::new(x);
            motion.follow(0.1, &reading, &SVector::zeros(), &before, &process);
            let h = 1e-6;
            for j in 0..CAMERA_DIM {
                let d = along(&x, j);
                let at = |h: f64| {
                    let x: [f64; 13] = std::array::from_fn(|i| x[i] + h * d[i]);
                    moved(&x, &SVector::zeros(), turn, &k)
                };
                let off = (at(h) - at(-h)) / (2.0 * h) - motion.by_camera * d;
                assert!(off.abs().max() < 1e-7, "turn {turn}, {j}: {off}");
            }
            for j in 0..2 {
                let at = |h: f64| {
                    moved(
                        &x,
                        &SVector::from_fn(|i, _| h * f64::from(i == j)),
                        turn,
                        &k,
                    )
                };
                let off = (at(h) - at(-h)) / (2.0 * h) - motion.by_scale.column(j);
                assert!(off.abs().max() < 1e-7, "turn {turn}, scale {j}: {off}");
            }
        }
    }

    #[test]
    fn a_reading_that_knows_nothing_leaves_the_velocity_constant() {
        let (x, process) = (camera(0.5), ProcessSettings::default());
        let mut vague = reading(0.5);
        vague.covariance = Matrix6::identity() * 1e9;
        let before = CameraMatrix::identity() * 1e-4;
        let (mut told, mut alone) = (Motion::new(x), Motion::new(x));
        told.follow(0.05, &vague, &SVector::zeros(), &before, &process);
        alone.drift(0.05, crate::settings::MotionModel::Body, &process);
        assert!(told.by_scale.abs().max() < 1e-6, "{}", told.by_scale);
        for i in 0..CAMERA_DIM {
            assert!((told.x[i] - alone.x[i]).abs() < 2e-5, "row {i}");
        }
        let (a, b) = (told.covariance(&before), alone.covariance(&before));
        for i in 0..CAMERA_DIM {
            let (told, alone) = (a[(i, i)], b[(i, i)]);
            assert!(
                (told - alone).abs() < 0.1 * alone,
                "row {i}: {told} {alone}"
            );
        }
        assert!(ByScale::zeros() == alone.by_scale);
    }
}
