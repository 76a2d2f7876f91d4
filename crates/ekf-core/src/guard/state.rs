//! Mean and covariance: numbers of a state, before and after each change of it.

use super::input::LEAST_DEPTH;
use crate::birth::new_feature::NewFeature;
use crate::error::EkfError;
use crate::predict;
use crate::settings::ProcessSettings;
use crate::state::{Block, BlockKind, CAMERA_DIM, State};
use nalgebra::SMatrix;

/// Largest number in the mean; its square is the largest variance.
const LARGEST: f64 = 1e7;

/// Largest inverse range of a newborn feature, 1/m, and standard deviation of it: the least depth.
const LARGEST_RHO: f64 = 1.0 / LEAST_DEPTH;

/// Largest variance of a newborn feature's direction, rad^2: beyond, no linearisation says where it is.
const LARGEST_ANGLE_VARIANCE: f64 = 1.0;

/// By how much a normalised quaternion may be off unit length.
const UNIT: f64 = 1e-9;

/// Least norm of a quaternion after an update, before it is normalised.
const LEAST_QUATERNION: f64 = 0.1;

/// How far below zero rounding may take a variance, relative to its value before (METHOD 3).
pub(crate) const ROUNDING: f64 = 1e-10;

/// The same, absolutely: the variance along a quaternion, and that of an anchor just born, are zero.
const SLACK: f64 = 1e-15;

/// Whether the numbers of a newborn feature may join the state.
pub(crate) fn newborn_is_sane(new: &NewFeature) -> bool {
    let by_others = new.by_others.iter().flat_map(|part| part.by.iter());
    let jacobians = new.by_pose.iter().chain(by_others);
    let jacobians = jacobians.chain(new.by_calibration.iter());
    within(new.mean.iter().copied(), LARGEST)
        && new.mean[5].abs() <= LARGEST_RHO
        && within(jacobians.copied(), LARGEST)
        && within(new.noise.iter().copied(), LARGEST * LARGEST)
}

/// Whether the direction of a newborn feature is known well enough to linearise, asked once it is in the state. It is not if
/// the camera hardly knows where it looks.
pub(crate) fn newborn_is_located(state: &State, block: &Block) -> bool {
    let variance = |i: usize| state.p.get(block.offset + i, block.offset + i);
    variance(3) <= LARGEST_ANGLE_VARIANCE
        && variance(4) <= LARGEST_ANGLE_VARIANCE
        && variance(5) <= LARGEST_RHO * LARGEST_RHO
}

/// Whether the camera's block stays finite when it is predicted by `dt` seconds.
pub(crate) fn prediction(
    state: &State,
    dt: f64,
    process: &ProcessSettings,
) -> Result<(), EkfError> {
    let mut x = [0.0; CAMERA_DIM];
    x.copy_from_slice(&state.mean()[..CAMERA_DIM]);
    let f = predict::transition(&mut x, dt, process.velocity);
    let p: SMatrix<f64, CAMERA_DIM, CAMERA_DIM> = state.covariance().block(0, 0);
    let q = SMatrix::from_column_slice(&x[3..7]);
    let p = f * p * f.transpose() + predict::process_noise(&q, dt, process);
    moved_is_sane(&x, &p)
}

/// Whether mean and covariance of the camera's block may stand after a prediction.
pub(crate) fn moved_is_sane(
    x: &[f64; CAMERA_DIM],
    p: &SMatrix<f64, CAMERA_DIM, CAMERA_DIM>,
) -> Result<(), EkfError> {
    if within(x.iter().copied(), LARGEST) && within(p.iter().copied(), LARGEST * LARGEST) {
        return Ok(());
    }
    let why =
        "after so long without a measurement nothing is known of the pose; start a new filter";
    Err(EkfError::InvalidInput {
        what: "time",
        why: why.into(),
    })
}

/// Whether `x + moved` and `P - V V^T` are a state, from the diagonal of `V V^T`; both by stored rows.
pub(crate) fn update_is_sane(
    state: &State,
    moved: &[f64],
    squares: &[f64],
) -> Result<(), EkfError> {
    let slots = state.p.stored().slots;
    let value = |i: usize| state.x[i] + moved[slots[i]];
    let variance = |i: usize| {
        let before = state.p.stored_entry(slots[i], slots[i]);
        (before, before - squares[slots[i]])
    };
    rows_are_sane(state, value, variance).map_err(|why| EkfError::Unsound { why })
}

/// The same of the state as it is.
pub(crate) fn state_is_sane(state: &State) -> Result<(), String> {
    let variance = |i: usize| (state.p.get(i, i), state.p.get(i, i));
    rows_are_sane(state, |i| state.x[i], variance)
}

/// Whether the camera's quaternion has unit length, as after every step.
pub(crate) fn attitude_is_sane(state: &State) -> Result<(), String> {
    let norm = state.camera_pose().q.norm();
    if (norm - 1.0).abs() > UNIT {
        return Err(format!("the camera's quaternion has the norm {norm}"));
    }
    Ok(())
}

fn within(mut values: impl Iterator<Item = f64>, bound: f64) -> bool {
    // NaN is not within.
    values.all(|v| v.abs() <= bound)
}

/// Whether means and variances are a state's; a variance comes with what it was before.
fn rows_are_sane(
    state: &State,
    value: impl Fn(usize) -> f64,
    variance: impl Fn(usize) -> (f64, f64),
) -> Result<(), String> {
    let is_good = |i: usize| {
        let (before, now) = variance(i);
        now >= -(ROUNDING * before.abs() + SLACK) && now <= LARGEST * LARGEST
    };
    let norm = |at: usize| (at..at + 4).map(|i| value(i).powi(2)).sum::<f64>().sqrt();
    if !within((0..state.x.len()).map(&value), LARGEST) {
        return Err("a number of the mean is out of all bounds".into());
    }
    if !(0..CAMERA_DIM).all(is_good) {
        return Err("a variance of the camera is negative or out of all bounds".into());
    }
    let mut turned = norm(3) < LEAST_QUATERNION;
    for block in state.layout.blocks() {
        // Rows of the local update have the diagonal of -Psi; the error of a frame's T_CF is gone after it.
        if matches!(
            block.kind,
            BlockKind::Auxiliary(_)
                | BlockKind::ErrorModes(_)
                | BlockKind::WornError(_)
                | BlockKind::WornRoll(_)
        ) {
            continue;
        }
        turned |= matches!(block.kind, BlockKind::Clone | BlockKind::Submap(_))
            && norm(block.offset + 3) < LEAST_QUATERNION;
        if !block.range().all(is_good) {
            let (kind, id) = (block.kind, block.id);
            return Err(format!(
                "a variance of {kind:?} {id} is negative or out of all bounds"
            ));
        }
    }
    if turned {
        return Err("a quaternion is near zero".into());
    }
    Ok(())
}
