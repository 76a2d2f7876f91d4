//! A camera that sees nothing for a moment: its velocity turns with it, and it goes as it usually does (METHOD 28).

use super::imu::Run;
use crate::scene::{Trajectory, warm};
use ekf_core::EkfError;
use ekf_core::math::quat;
use nalgebra::{Matrix3, SMatrix, Vector3, Vector4};

/// A camera that was seen to move, and has been in the dark for as many frames.
fn in_the_dark(frames: u32) -> Run {
    let mut run = Run::new(3, Trajectory::Lively);
    for frame in 0..20 {
        run.step(frame < 5);
    }
    for _ in 0..frames {
        run.predict();
    }
    run
}

#[test]
fn after_a_frame_that_was_not_used_the_velocity_turns_with_the_camera() {
    let mut run = in_the_dark(1);
    let (before, was) = (run.filter.pose().0, run.filter.state().velocity());
    for _ in 0..10 {
        run.predict();
    }
    let turn = run.filter.pose().0 * before.transpose();
    let now = run.filter.state().velocity();
    assert!((turn - Matrix3::identity()).norm() > 0.1, "it turns");
    assert!((now - turn * was).norm() < 1e-6 * was.norm());
    assert!((now - was).norm() > 0.05 * was.norm());
}

#[test]
fn without_a_gyroscope_it_stays_as_it_was() {
    let mut dark = warm(3, &[]);
    dark.update(false);
    let was = dark.filter.state().velocity();
    for _ in 0..10 {
        dark.t += 0.1;
        dark.filter.predict(dark.t).unwrap();
    }
    assert!((dark.filter.state().velocity() - was).norm() < 1e-12);
}

/// How the velocity along the camera's axes hangs on attitude and velocity.
fn along_its_axes(run: &Run) -> SMatrix<f64, 3, 7> {
    let state = run.filter.state();
    let q = Vector4::from_fn(|i, _| state.mean()[3 + i]);
    let mut by = SMatrix::<f64, 3, 7>::zeros();
    let turned = quat::rotate_inverse_jacobian(&q, &state.velocity());
    by.fixed_columns_mut::<4>(0).copy_from(&turned);
    by.fixed_columns_mut::<3>(4)
        .copy_from(&run.filter.pose().0.transpose());
    by
}

fn sds(run: &Run, by: &SMatrix<f64, 3, 7>) -> Vector3<f64> {
    let p: SMatrix<f64, 7, 7> = run.filter.state().covariance().block(3, 3);
    (by * p * by.transpose()).diagonal().map(f64::sqrt)
}

fn velocity(run: &Run) -> Vector3<f64> {
    run.filter.pose().0.transpose() * run.filter.state().velocity()
}

#[test]
fn a_velocity_that_is_known_less_well_than_the_usual_one_is_measured() {
    let mut run = in_the_dark(12);
    let by = along_its_axes(&run);
    assert!(sds(&run, &by).min() > 0.3);
    let usual = velocity(&run) + Vector3::new(0.1, -0.1, 0.1);
    let pose_sd = run.filter.pose_covariance().trace();
    run.filter
        .expect_velocity(&usual, &Vector3::repeat(0.05))
        .unwrap();
    assert!((velocity(&run) - usual).norm() < 0.02, "{}", velocity(&run));
    let sd = sds(&run, &by);
    assert!(sd.min() > 0.04 && sd.max() < 0.051, "{sd}");
    // Where it went meanwhile is known better with it.
    assert!(run.filter.pose_covariance().trace() < 0.9 * pose_sd);
    run.filter.check().expect("sound");
    // Known as well as that now: it is not measured twice.
    let again = run.filter.clone();
    let off = velocity(&run) + Vector3::repeat(0.1);
    run.filter
        .expect_velocity(&off, &Vector3::repeat(0.06))
        .unwrap();
    assert_eq!(again.state().mean(), run.filter.state().mean());
}

#[test]
fn what_is_known_better_along_one_axis_stays() {
    let mut run = in_the_dark(12);
    let by = along_its_axes(&run);
    let before = sds(&run, &by);
    let sd = Vector3::new(100.0, 0.05, 100.0);
    run.filter.expect_velocity(&velocity(&run), &sd).unwrap();
    let after = sds(&run, &by);
    assert!(after[1] < 0.051, "{after}");
    assert!(after[0] > 0.5 * before[0] && after[2] > 0.5 * before[2]);
}

#[test]
fn it_is_not_where_the_camera_has_just_been_seen() {
    for frames in [0, 2] {
        let mut run = in_the_dark(frames);
        let before = run.filter.state().mean().to_vec();
        let (far, sd) = (Vector3::repeat(9.0), Vector3::repeat(0.01));
        run.filter.expect_velocity(&far, &sd).unwrap();
        assert_eq!(before, run.filter.state().mean());
    }
}

#[test]
fn it_is_where_no_landmark_of_known_depth_was_found() {
    for gone in [false, true] {
        let mut run = in_the_dark(0);
        if gone {
            let all: Vec<u64> = run.filter.feature_ids().collect();
            run.filter.remove_features(&all).unwrap();
        }
        run.predict();
        let before = run.filter.state().velocity();
        let (far, sd) = (Vector3::repeat(9.0), Vector3::repeat(0.01));
        run.filter.expect_velocity(&far, &sd).unwrap();
        assert_eq!(run.filter.state().velocity() != before, gone);
    }
}

#[test]
fn what_is_no_velocity_is_refused() {
    let mut run = in_the_dark(4);
    let before = run.filter.state().mean().to_vec();
    for (velocity, sd) in [(1.0, 0.0), (f64::NAN, 1.0), (1.0, f64::INFINITY)] {
        let (velocity, sd) = (Vector3::repeat(velocity), Vector3::new(1.0, 1.0, sd));
        let error = run.filter.expect_velocity(&velocity, &sd).unwrap_err();
        let EkfError::InvalidInput { what, .. } = error else {
            panic!("{error}");
        };
        assert_eq!(what, "velocity");
    }
    assert_eq!(before, run.filter.state().mean());
    let mut early = Run::new(3, Trajectory::Lively);
    let (velocity, sd) = (Vector3::z(), Vector3::repeat(0.1));
    assert!(early.filter.expect_velocity(&velocity, &sd).is_err());
}
