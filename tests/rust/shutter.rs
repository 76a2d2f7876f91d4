//! A shutter that rolls: the filter finds its readout, and is as honest as with one that does not.

use crate::scene::{DT, Scene, adopt, settings};
use ekf_core::Filter;
use ekf_core::settings::Value;
use nalgebra::Vector6;
use std::collections::BTreeMap;

const READOUT: f64 = 0.1;

/// A run of a rolling camera with Cf now and then: the filter after it, and its mean NEES of the pose (6 is honest).
fn run(seed: u64, readout: f64, sd: f64) -> (Filter, f64) {
    let mut scene = Scene::new(seed, 60);
    scene.sigma_px = 0.5;
    scene.readout = READOUT;
    scene.from_rest = true;
    let changes = [
        ("calibration.readout", Value::Float(readout)),
        ("calibration.readout_sd", Value::Float(sd)),
        ("pixel.sigma_cs", Value::Float(0.5)),
        ("process.handover", Value::Float(0.0)),
    ];
    let mut filter = scene.filter(settings(&changes));
    let mut known = BTreeMap::new();
    let (mut nees, mut count) = (0.0, 0.0);
    for frame in 0..120 {
        let t = f64::from(frame) * DT;
        filter.predict(t).expect("increasing time");
        let (z, points) = scene.measure(t, &known, frame % 20 == 0);
        let report = filter.update(&z).expect("good measurements");
        adopt(&mut known, &report, &points);
        if frame >= 60 {
            let (rotation, r) = filter.pose();
            let truth = scene.pose(t);
            let error = (
                rotation.transpose() * truth.rotation,
                rotation.transpose() * (truth.translation - r),
            );
            let turn = ekf_core::math::quat::rotation_log(&error.0);
            let xi = Vector6::new(error.1.x, error.1.y, error.1.z, turn.x, turn.y, turn.z);
            let inverse = filter
                .pose_covariance()
                .try_inverse()
                .expect("a covariance");
            nees += (xi.transpose() * inverse * xi)[(0, 0)];
            count += 1.0;
        }
    }
    (filter, nees / count)
}

#[test]
fn an_unknown_readout_is_found() {
    for seed in 0..4 {
        let (filter, nees) = run(seed, 0.0, 0.05);
        let (readout, sd) = filter.readout().expect("it may roll");
        assert!(sd < 0.02, "seed {seed}: {readout} +- {sd}");
        assert!(
            (readout - READOUT).abs() < 4.0 * sd,
            "seed {seed}: {readout} +- {sd}"
        );
        assert!(nees < 20.0, "seed {seed}: NEES {nees}");
    }
}

#[test]
fn a_shutter_that_is_told_not_to_roll_is_believed() {
    let told: Vec<f64> = (0..4).map(|seed| run(seed, 0.0, 0.0).1).collect();
    let known: Vec<f64> = (0..4).map(|seed| run(seed, READOUT, 0.001).1).collect();
    let mean = |nees: &[f64]| nees.iter().sum::<f64>() / 4.0;
    assert!(run(0, 0.0, 0.0).0.readout().is_none());
    assert!(mean(&known) < 0.5 * mean(&told), "{known:?} {told:?}");
}
