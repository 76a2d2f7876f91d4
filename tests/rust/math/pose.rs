//! Poses and rotations: exponential and logarithm, what carries a tangent vector, and the way between two poses.

use ekf_core::math::{pose::Pose, quat};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::PI;

fn poses(count: usize) -> impl Iterator<Item = Pose> {
    let mut rng = Pcg64::seed_from_u64(3);
    (0..count).map(move |_| Pose::exp(&Vector6::from_fn(|_, _| rng.random_range(-1.5..1.5))))
}

fn off(a: &Pose, b: &Pose) -> f64 {
    let rotation = (a.rotation - b.rotation).abs().max();
    rotation.max((a.translation - b.translation).abs().max())
}

#[test]
fn the_logarithm_undoes_the_exponential() {
    let axis = Vector3::new(0.48, -0.6, 0.64);
    for angle in [0.0, 1e-12, 1e-9, 1e-5, 0.3, 2.0, 3.1, PI - 1e-9] {
        let w = axis * angle;
        let back = quat::rotation_log(&quat::rotation_exp(&w));
        assert!((back - w).norm() < 1e-14 + 1e-15 * angle, "{angle}: {back}");
    }
    // Beyond half a turn the shorter way round is the answer.
    let back = quat::rotation_log(&quat::rotation_exp(&(axis * 4.0)));
    assert!((back - axis * (4.0 - 2.0 * PI)).norm() < 1e-14);
    for pose in poses(50) {
        assert!(off(&Pose::exp(&pose.log()), &pose) < 1e-14);
    }
}

#[test]
fn the_exponential_turns_as_its_series_says() {
    let w = Vector3::new(0.2, -0.1, 0.3);
    let k = quat::skew(&w);
    let (mut term, mut series) = (Matrix3::identity(), Matrix3::identity());
    for n in 1..20 {
        term = term * k / f64::from(n);
        series += term;
    }
    assert!((quat::rotation_exp(&w) - series).abs().max() < 1e-15);
}

#[test]
fn the_adjoint_makes_a_left_perturbation_of_a_right_one() {
    let xi = Vector6::new(3.0, -1.0, 2.0, -2.0, 1.0, 0.5) * 1e-6;
    for pose in poses(20) {
        let right = pose.compose(&Pose::exp(&xi));
        let left = Pose::exp(&(pose.adjoint() * xi)).compose(&pose);
        assert!(off(&right, &left) < 1e-10);
        assert!(off(&right, &pose) > 1e-7, "it does something");
        assert!(off(&right, &pose.retract(&xi)) < 1e-15);
    }
}

#[test]
fn a_pose_and_its_inverse_make_the_identity() {
    for pose in poses(20) {
        assert!(off(&pose.compose(&pose.inverse()), &Pose::identity()) < 1e-14);
    }
}

#[test]
fn covariances_turn_with_the_pose_and_back() {
    let p = Matrix6::from_diagonal(&Vector6::new(1.0, 4.0, 9.0, 0.1, 0.2, 0.3));
    // A quarter turn about z exchanges x and y.
    let quarter = Pose::exp(&Vector6::new(5.0, 6.0, 7.0, 0.0, 0.0, PI / 2.0));
    let fixed = quarter.covariance_along_fixed_axes(&p);
    let expected = Matrix6::from_diagonal(&Vector6::new(4.0, 1.0, 9.0, 0.2, 0.1, 0.3));
    assert!((fixed - expected).abs().max() < 1e-14);
    assert!((quarter.covariance_along_tangent(&fixed) - p).abs().max() < 1e-14);
}

#[test]
fn the_way_between_poses_is_straight_and_even() {
    for (a, b) in poses(20).zip(poses(21).skip(1)) {
        assert!(off(&a.interpolate(&b, 0.0), &a) < 1e-14);
        assert!(off(&a.interpolate(&b, 1.0), &b) < 1e-13);
        let third = a.interpolate(&b, 1.0 / 3.0);
        assert!(off(&third.interpolate(&b, 0.5), &a.interpolate(&b, 2.0 / 3.0)) < 1e-13);
        let step = quat::rotation_log(&(a.rotation.transpose() * third.rotation));
        let whole = quat::rotation_log(&(a.rotation.transpose() * b.rotation));
        assert!((step * 3.0 - whole).norm() < 1e-13);
    }
}

#[test]
fn only_rotations_are_rotations() {
    let r = quat::rotation_exp(&Vector3::new(0.3, 1.0, -2.0));
    assert!(quat::is_rotation(&r, 1e-12));
    assert!(!quat::is_rotation(&(r * 1.01), 1e-3));
    assert!(quat::is_rotation(&(r * 1.0001), 1e-3));
    assert!(!quat::is_rotation(&-r, 1e-3), "a reflection");
    assert!(!quat::is_rotation(&Matrix3::repeat(f64::NAN), 1e-3));
    let q = quat::from_rotation(&r);
    assert!(q[0] >= 0.0 && (q.norm() - 1.0).abs() < 1e-15);
    assert!((quat::rotation(&(q * -3.0)) - r).abs().max() < 1e-14);
}
