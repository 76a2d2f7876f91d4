//! The velocities of a camera that is found again: what lies between where it was predicted and where it was found tells them,
//! as it does in any update. The found pose is far from where P was linearised, so the update is this one, of the
//! velocities alone.

use crate::chi2;
use crate::math::pose::{Pose, tangent_map};
use crate::observe::POSE_DIM;
use crate::state::{CAMERA_DIM, State};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};

/// Corrects the velocities by where the camera was found, against a clone at `before` of its predicted pose; nothing else of the
/// state moves. False, and nothing has changed, where that pose is excluded (99.99 % of six numbers): then nothing
/// is known of how the camera came there.
pub(super) fn correct_by_pose(state: &mut State, before: usize) -> bool {
    let pose = |at: usize| Pose::from_quat(state.part::<3>(at), &state.part::<4>(at + 3));
    let (found, predicted) = (pose(0), pose(before));
    let (away, [by_found, by_predicted]) = difference(&found, &predicted);
    let map = |at: usize| tangent_map(&state.part::<4>(at + 3));
    let (by_found, by_predicted) = (by_found * map(0), by_predicted * map(before));
    let rows = |j: usize| -> Vector6<f64> {
        by_predicted * state.p.block::<POSE_DIM, 1>(before, j)
            + by_found * state.p.block::<POSE_DIM, 1>(0, j)
    };
    let h: Vec<Vector6<f64>> = (0..state.p.dim()).map(rows).collect();
    let columns = |at: usize| SMatrix::<f64, 6, POSE_DIM>::from_fn(|r, c| h[at + c][r]);
    let s = columns(before) * by_predicted.transpose() + columns(0) * by_found.transpose();
    let Some(factor) = ((s + s.transpose()) * 0.5).cholesky() else {
        return false;
    };
    let whitened = factor.solve(&away);
    if away.dot(&whitened) > chi2::quantile(chi2::SURE_LEVEL, 6.0) {
        return false;
    }
    let of_velocity = Matrix6::from_fn(|r, c| h[POSE_DIM + c][r]);
    let gain = factor.solve(&of_velocity).transpose();
    let moved = state.part::<6>(POSE_DIM) - gain * away;
    state.set_part(POSE_DIM, &moved);
    let own = state.p.block::<6, 6>(POSE_DIM, POSE_DIM) - gain * of_velocity;
    let others = (0..POSE_DIM).chain(CAMERA_DIM..state.p.dim());
    // All before any is written: features of one anchor share their rows.
    let corrected: Vec<(usize, Vector6<f64>)> = others
        .map(|j| (j, state.p.block::<6, 1>(POSE_DIM, j) - gain * h[j]))
        .collect();
    for (j, rows) in &corrected {
        state.p.set_block(POSE_DIM, *j, rows);
    }
    state
        .p
        .set_block(POSE_DIM, POSE_DIM, &((own + own.transpose()) * 0.5));
    true
}

/// What lies between two poses, of which the second is seen from the first, and to first order its derivatives by both of
/// their right tangents.
pub(super) fn difference(found: &Pose, predicted: &Pose) -> (Vector6<f64>, [Matrix6<f64>; 2]) {
    let away = found.inverse().compose(predicted);
    let along = |rotation, translation| {
        let pose = Pose {
            rotation,
            translation,
        };
        pose.adjoint()
    };
    // dv = R dv_predicted - dv_found + [v] dw_found, dw = R dw_predicted - dw_found.
    let by_predicted = along(away.rotation, Vector3::zeros());
    let by_found = -along(Matrix3::identity(), -away.translation);
    (away.log(), [by_found, by_predicted])
}
