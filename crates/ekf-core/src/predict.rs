//! Prediction (METHOD 3): constant velocity, white acceleration densities, O(13^2 n).

use crate::math::quat;
use crate::settings::{ProcessSettings, WornSettings};
use crate::state::{BlockKind, CAMERA_DIM, State};
use nalgebra::{Matrix3, SMatrix, Vector3};

/// 13x13 matrix of the camera's block.
pub type CameraMatrix = SMatrix<f64, CAMERA_DIM, CAMERA_DIM>;

/// Moves the camera's mean by `dt` seconds and returns the 13x13 transition matrix.
pub fn transition(state: &mut [f64], dt: f64) -> CameraMatrix {
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
    for i in 0..3 {
        state[i] += v[i] * dt;
    }
    state[3..7].copy_from_slice(moved.as_slice());
    f
}

/// Process noise over `dt`: `sigma^2 [dt^3/3, dt^2/2; dt^2/2, dt]` for (position, velocity) and for
/// (attitude tangent, angular velocity), the attitude lifted to the quaternion `q` after the motion.
pub fn process_noise(q: &quat::Quat, dt: f64, settings: &ProcessSettings) -> CameraMatrix {
    let (a, b, c) = (dt.powi(3) / 3.0, dt * dt / 2.0, dt);
    let linear = settings.acceleration_density.powi(2);
    let angular = settings.angular_acceleration_density.powi(2);
    let lift = quat::lift(q);
    let mut noise = CameraMatrix::zeros();
    for i in 0..3 {
        noise[(i, i)] = linear * a;
        noise[(7 + i, i)] = linear * b;
        noise[(i, 7 + i)] = linear * b;
        noise[(7 + i, 7 + i)] = linear * c;
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

/// Predicts the whole state over `dt` seconds. Only the camera's block and its cross-covariances change, and the
/// worn camera's bias decays (Gauss-Markov, METHOD 6).
pub(crate) fn predict(state: &mut State, dt: f64, process: &ProcessSettings, worn: &WornSettings) {
    let f = transition(&mut state.x, dt);
    state.camera_moved();
    state.p.transform(0, &f);
    let q = state.part::<4>(3);
    state.p.add_block(0, &process_noise(&q, dt, process));
    state.normalise_quaternions();
    let bias = state.layout.of_kind(BlockKind::WornBias).next().copied();
    if let Some(block) = bias {
        decay_bias(state, block.offset, dt, worn);
    }
}

/// `b <- b exp(-dt/tau)`, its mean being zero and its covariance the stationary one: what decays is replaced by fresh noise.
fn decay_bias(state: &mut State, offset: usize, dt: f64, worn: &WornSettings) {
    let decay = (-dt / worn.bias_time).exp();
    let stationary = state.bias_stationary;
    state
        .p
        .transform(offset, &(SMatrix::<f64, 6, 6>::identity() * decay));
    state
        .p
        .add_block(offset, &(stationary * (1.0 - decay * decay)));
}
