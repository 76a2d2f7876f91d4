//! A camera that sees nothing for a moment: its velocity turns with it, and its speed is the usual one (METHOD 28).

use super::imu::Run;
use crate::scene::{Trajectory, warm};
use ekf_core::EkfError;
use nalgebra::Matrix3;

fn speed_sd(run: &Run) -> (f64, f64) {
    let v = run.filter.state().velocity();
    let ahead = v.normalize();
    let p: Matrix3<f64> = run.filter.state().covariance().block(7, 7);
    (v.norm(), (p * ahead).dot(&ahead).sqrt())
}

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

#[test]
fn a_speed_that_is_known_less_well_than_the_usual_one_is_measured() {
    let mut run = in_the_dark(12);
    let (_, before) = speed_sd(&run);
    let pose = (run.filter.pose(), run.filter.pose_covariance());
    run.filter.expect_speed(0.6, 0.05).unwrap();
    let (speed, sd) = speed_sd(&run);
    assert!(before > 0.3, "{before}");
    assert!((speed - 0.6).abs() < 0.05, "{speed}");
    assert!((0.04..0.06).contains(&sd), "{sd}");
    assert_eq!(pose, (run.filter.pose(), run.filter.pose_covariance()));
    run.filter.check().expect("sound");
    let n = run.filter.state().mean().len();
    for i in 7..10 {
        for j in (0..n).filter(|j| !(7..10).contains(j)) {
            assert_eq!(run.filter.state().covariance().get(i, j), 0.0);
        }
    }
    // Known as well as that now: it is not measured twice.
    let again = run.filter.clone();
    run.filter.expect_speed(0.9, 0.06).unwrap();
    assert_eq!(again.state().mean(), run.filter.state().mean());
}

#[test]
fn it_is_not_where_the_camera_has_just_been_seen() {
    for frames in [0, 2] {
        let mut run = in_the_dark(frames);
        let before = run.filter.state().mean().to_vec();
        run.filter.expect_speed(9.0, 0.01).unwrap();
        assert_eq!(before, run.filter.state().mean());
    }
}

#[test]
fn what_is_no_speed_is_refused() {
    let mut run = in_the_dark(4);
    let before = run.filter.state().mean().to_vec();
    for (speed, sd) in [
        (0.0, 1.0),
        (1.0, 0.0),
        (f64::NAN, 1.0),
        (1.0, f64::INFINITY),
    ] {
        let error = run.filter.expect_speed(speed, sd).unwrap_err();
        assert!(matches!(
            error,
            EkfError::InvalidInput { what: "speed", .. }
        ));
    }
    assert_eq!(before, run.filter.state().mean());
    let mut early = Run::new(3, Trajectory::Lively);
    assert!(early.filter.expect_speed(1.0, 0.1).is_err());
}
