//! The shutter of Cf rolls while its wearer turns (METHOD 6): rows that see another T_CF do not spoil the camera's covariance.

use crate::scene::{DT, Scene, Trajectory, adopt, settings, worn_covariance};
use ekf_core::math::quat;
use ekf_core::settings::Value;
use nalgebra::Vector6;
use std::collections::BTreeMap;

/// T_CF is known to 1 cm and a sixth of a degree. NEES of the camera's pose after three seconds with a view in every other frame, six is ideal; the readout is `told`, seconds.
fn nees(seed: u64, told: f64) -> f64 {
    let mut scene = Scene::new(seed, 40);
    scene.trajectory = Trajectory::Lively;
    scene.worn_readout = 0.02;
    scene.worn_covariance = worn_covariance() * 0.1;
    let changes = [
        ("worn.readout", Value::Float(told)),
        // All other errors are those of pixels.
        ("process.map_drift", Value::Float(0.0)),
    ];
    let mut filter = scene.filter(settings(&changes));
    let mut known = BTreeMap::new();
    let mut t = 0.0;
    for frame in 0..30 {
        t = f64::from(frame) * DT;
        filter.predict(t).expect("increasing time");
        let (z, points) = scene.measure(t, &known, frame % 2 == 0);
        let report = filter.update(&z).expect("good measurements");
        adopt(&mut known, &report, &points);
    }
    let (truth, (r_wc, r)) = (scene.pose(t), filter.pose());
    let mut error = Vector6::zeros();
    let apart = r_wc.transpose() * (truth.translation - r);
    error.fixed_rows_mut::<3>(0).copy_from(&apart);
    let turned = quat::rotation_log(&(r_wc.transpose() * truth.rotation));
    error.fixed_rows_mut::<3>(3).copy_from(&turned);
    let covariance = filter.pose_covariance().cholesky();
    error.dot(&covariance.expect("positive definite").solve(&error))
}

#[test]
fn a_wearer_who_turns_leaves_the_covariance_consistent() {
    let runs = 24;
    let mean = |told| (0..runs).map(|seed| nees(seed, told)).sum::<f64>() / runs as f64;
    let (told, ignored) = (mean(0.02), mean(0.0));
    // chi2 with 144 degrees of freedom: 99.9 % lie below 200.
    assert!(told < 200.0 / 24.0, "{told}");
    assert!(
        ignored > 200.0 / 24.0,
        "the test's shutter rolls too little: {ignored}"
    );
}
