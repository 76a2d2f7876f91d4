//! Prediction (METHOD 3): constant velocity, white acceleration densities, O(13^2 n).
//!
//! A robot's velocity turns with it. With `process.velocity = body` it is constant along the camera's axes:
//! `v' = R(q) Exp(w dt) R(q)^T v` and `r' = r + (v + v') dt / 2`. In W, the acceleration towards the inside of every bend is an
//! error of the model with the same sign in each frame, which a view without known depths turns into rotation.

mod motion;
mod turn;

pub(crate) use motion::{GYRO_DIM, Motion, Reading, TwistMatrix};
pub(crate) use turn::{CLOCK, GyroAt, Sensor};

use crate::math::quat;
use crate::settings::{MotionModel, ProcessSettings, Settings};
use crate::state::{BlockKind, CAMERA_DIM, State, TimeCorrelatedBias};
use nalgebra::{Matrix3, Matrix3x4, SMatrix, Vector3};

/// 13x13 matrix of the camera's block.
pub type CameraMatrix = SMatrix<f64, CAMERA_DIM, CAMERA_DIM>;

/// Moves the camera's mean by `dt` seconds and returns the 13x13 transition matrix.
pub fn transition(state: &mut [f64], dt: f64, model: MotionModel) -> CameraMatrix {
    let v = Vector3::from_column_slice(&state[7..10]);
    let w = Vector3::from_column_slice(&state[10..13]);
    let q = quat::Quat::from_column_slice(&state[3..7]);
    let turn = quat::exp(&(w * dt));
    let moved = quat::right(&turn) * q;
    let mut f = CameraMatrix::identity();
    f.fixed_view_mut::<3, 3>(0, 7)
        .copy_from(&(Matrix3::identity() * dt));
    f.fixed_view_mut::<4, 4>(3, 3)
        .copy_from(&quat::right(&turn));
    f.fixed_view_mut::<4, 3>(3, 10)
        .copy_from(&(quat::left(&q) * quat::exp_jacobian(&(w * dt)) * dt));
    let mut way = v * dt;
    if model == MotionModel::Body {
        let turned = Turned::new(&q, &v, &quat::rotation(&turn));
        let by_w = turned.by_turn * quat::right_jacobian(&(w * dt)) * dt;
        way = (v + turned.v) * (0.5 * dt);
        for (row, share) in [(0, 0.5 * dt), (7, 1.0)] {
            turned.write(&mut f, row, share);
            f.fixed_view_mut::<3, 3>(row, 10).copy_from(&(by_w * share));
        }
        let mut half = f.fixed_view_mut::<3, 3>(0, 7);
        half += Matrix3::identity() * (0.5 * dt);
        state[7..10].copy_from_slice(turned.v.as_slice());
    }
    for i in 0..3 {
        state[i] += way[i];
    }
    state[3..7].copy_from_slice(moved.as_slice());
    f
}

/// A velocity that turns with the camera, and its derivatives by attitude, velocity and the turn, tangent on the right.
struct Turned {
    v: Vector3<f64>,
    by_q: Matrix3x4<f64>,
    by_v: Matrix3<f64>,
    by_turn: Matrix3<f64>,
}

impl Turned {
    fn new(q: &quat::Quat, v: &Vector3<f64>, turn: &Matrix3<f64>) -> Self {
        let r = quat::rotation(q);
        let own = r.transpose() * v;
        let by_attitude = turn * quat::skew(&own) - quat::skew(&(turn * own));
        Self {
            v: r * turn * own,
            by_q: r * by_attitude * quat::tangent(q),
            by_v: r * turn * r.transpose(),
            by_turn: -r * turn * quat::skew(&own),
        }
    }

    /// Writes the derivatives, times `scale`, into three rows of the transition.
    fn write(&self, f: &mut CameraMatrix, row: usize, scale: f64) {
        f.fixed_view_mut::<3, 4>(row, 3)
            .copy_from(&(self.by_q * scale));
        f.fixed_view_mut::<3, 3>(row, 7)
            .copy_from(&(self.by_v * scale));
    }
}

/// Process noise over `dt`: `sigma^2 [dt^3/3, dt^2/2; dt^2/2, dt]` for (position, velocity) and for
/// (attitude tangent, angular velocity), the attitude lifted to the quaternion `q` after the motion.
pub fn process_noise(q: &quat::Quat, dt: f64, settings: &ProcessSettings) -> CameraMatrix {
    let (a, b, c) = (dt.powi(3) / 3.0, dt * dt / 2.0, dt);
    let angular = settings.angular_acceleration_density.powi(2);
    let lift = quat::lift(q);
    let mut noise = linear_noise(dt, settings);
    for i in 0..3 {
        noise[(10 + i, 10 + i)] = angular * c;
    }
    noise
        .fixed_view_mut::<4, 4>(3, 3)
        .copy_from(&(lift * lift.transpose() * (angular * a)));
    noise
        .fixed_view_mut::<4, 3>(3, 10)
        .copy_from(&(lift * (angular * b)));
    noise
        .fixed_view_mut::<3, 4>(10, 3)
        .copy_from(&(lift.transpose() * (angular * b)));
    noise
}

/// That of position and velocity alone.
fn linear_noise(dt: f64, settings: &ProcessSettings) -> CameraMatrix {
    let (a, b, c) = (dt.powi(3) / 3.0, dt * dt / 2.0, dt);
    let linear = settings.acceleration_density.powi(2);
    let mut noise = CameraMatrix::zeros();
    for i in 0..3 {
        noise[(i, i)] = linear * a;
        noise[(7 + i, i)] = linear * b;
        noise[(i, 7 + i)] = linear * b;
        noise[(7 + i, 7 + i)] = linear * c;
    }
    noise
}

/// Predicts the whole state over `dt` seconds. Only the camera's block and its cross-covariances change.
pub(crate) fn predict(state: &mut State, dt: f64, process: &ProcessSettings) {
    let f = transition(&mut state.x, dt, process.velocity);
    state.camera_moved();
    state.p.transform(0, &f);
    let q = state.part::<4>(3);
    state.p.add_block(0, &process_noise(&q, dt, process));
    state.normalise_quaternions();
}

/// Predicts the whole state along a motion that odometry tells (METHOD 23), with the errors of its scales at `scale`, or a
/// gyroscope (METHOD 28), with its errors at `gyro`.
pub(crate) fn predict_along(
    state: &mut State,
    motion: &Motion,
    scale: Option<usize>,
    gyro: Option<&GyroAt>,
) {
    state.x[..CAMERA_DIM].copy_from_slice(&motion.x);
    state.camera_moved();
    state.p.transform(0, &motion.by_camera);
    if let Some(at) = scale {
        state.p.add_to_camera(at, &motion.by_scale);
    }
    if let Some(at) = gyro {
        let by = &motion.by_gyro;
        state
            .p
            .add_to_camera(at.bias, &by.fixed_columns::<3>(0).into_owned());
        state
            .p
            .add_to_camera(at.frame, &by.fixed_columns::<4>(3).into_owned());
        state
            .p
            .add_to_camera(at.clock, &by.fixed_columns::<1>(7).into_owned());
    }
    state.p.add_block(0, &motion.noise);
    state.normalise_quaternions();
}

/// `dt` seconds in which errors that last are partly replaced by fresh ones (Gauss-Markov), the worn cameras' biases and the
/// odometry's scales, and a gyroscope's bias walks.
pub(crate) fn forget(state: &mut State, dt: f64, settings: &Settings) {
    let (worn, odometry) = (&settings.worn, &settings.odometry);
    let offset = |kind| state.layout.of_kind(kind).next().map(|b| b.offset);
    let scale = offset(BlockKind::OdometryScale).zip(odometry.covariance());
    if let Some(at) = offset(BlockKind::GyroBias) {
        let walk = settings.imu.gyro_bias_walk.powi(2) * dt;
        state.p.add_block(at, &(Matrix3::identity() * walk));
    }
    for k in 0..state.time_correlated.len() {
        let TimeCorrelatedBias {
            owner, stationary, ..
        } = state.time_correlated[k];
        let block = state.layout.of_kind(BlockKind::WornBias(owner)).next();
        if let Some(offset) = block.map(|b| b.offset) {
            decay(state, offset, (-dt / worn.bias_time).exp(), &stationary);
        }
    }
    for told in &mut state.clocks {
        told.forget((-dt / worn.bias_time).exp());
    }
    if let Some((offset, stationary)) = scale {
        let share = (-dt / odometry.scale_time).exp();
        decay(state, offset, share, &stationary);
    }
}

/// `b <- b share`: what decays of its covariance is replaced by fresh noise of the stationary one.
fn decay<const N: usize>(
    state: &mut State,
    offset: usize,
    share: f64,
    stationary: &SMatrix<f64, N, N>,
) {
    let mean = state.part::<N>(offset) * share;
    state.set_part(offset, &mean);
    state
        .p
        .transform(offset, &(SMatrix::<f64, N, N>::identity() * share));
    state
        .p
        .add_block(offset, &(stationary * (1.0 - share * share)));
}

/// For the tests of both motions: what they are differentiated along.
#[cfg(test)]
mod directions {
    use crate::state::CAMERA_DIM;
    use nalgebra::SVector;

    /// The `j`-th number of a camera's state, along the unit sphere of quaternions, where the state is.
    pub(super) fn along(x: &[f64; CAMERA_DIM], j: usize) -> SVector<f64, CAMERA_DIM> {
        let mut d = SVector::<f64, CAMERA_DIM>::zeros();
        d[j] = 1.0;
        let q = SVector::<f64, 4>::from_column_slice(&x[3..7]);
        let along = q * q.dot(&d.fixed_rows::<4>(3));
        let mut part = d.fixed_rows_mut::<4>(3);
        part -= along;
        d
    }
}
