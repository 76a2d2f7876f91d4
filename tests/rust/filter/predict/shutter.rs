//! A shutter that rolls: told or not, the filter is as consistent as its readout is stated, and finds it where the camera turns.

use crate::scene::{DT, Scene, Trajectory, adopt, settings};
use ekf_core::gauge::{GAUGES, directions};
use ekf_core::settings::Value;
use ekf_core::{Bearing, CandidateOutcome, Filter, Measurements, Settings};
use nalgebra::{DMatrix, SMatrix, Vector2, Vector6};
use std::collections::BTreeMap;

const READOUT: f64 = 0.1;

fn stated(readout: f64, sd: f64) -> Settings {
    settings(&[
        ("calibration.readout", Value::Float(readout)),
        ("calibration.readout_sd", Value::Float(sd)),
        ("pixel.sigma_cs", Value::Float(0.5)),
        ("process.map_drift", Value::Float(0.0)),
    ])
}

fn rolling(seed: u64) -> Scene {
    let mut scene = Scene::new(seed, 60);
    scene.sigma_px = 0.5;
    scene.readout = READOUT;
    scene
}

/// Mean NEES of the pose of a rolling camera with Cf now and then, over four runs (expected 6).
fn nees(readout: f64, sd: f64) -> f64 {
    (0..4).map(|seed| run(seed, readout, sd).1).sum::<f64>() / 4.0
}

/// The filter at the end of a run, and its mean NEES.
fn run(seed: u64, readout: f64, sd: f64) -> (Filter, f64) {
    let mut scene = rolling(seed);
    scene.from_rest = true;
    let mut filter = scene.filter(stated(readout, sd));
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
fn a_readout_of_which_little_is_told_is_found() {
    for seed in 0..4 {
        let (filter, _) = run(seed, 0.05, 0.03);
        let (readout, sd) = filter.readout().expect("it may roll");
        assert!(sd < 0.01, "seed {seed}: {readout} +- {sd}");
        assert!(
            (readout - READOUT).abs() < 4.0 * sd,
            "seed {seed}: {readout} +- {sd}"
        );
    }
    assert!(run(0, 0.0, 0.0).0.readout().is_none());
}

#[test]
fn a_readout_of_which_nothing_is_told_stays_within_its_range() {
    let untold = Settings::default().calibration;
    let longest = 2.0 * untold.readout;
    assert!((longest - 1.0 / 30.0).abs() < 1e-15 && longest < READOUT);
    for seed in 0..2 {
        let (filter, _) = run(seed, untold.readout, untold.readout_sd);
        let (readout, sd) = filter.readout().expect("it may roll");
        assert!(
            (0.95 * longest..=longest + 1e-12).contains(&readout),
            "seed {seed}: {readout} +- {sd}"
        );
    }
}

#[test]
fn a_readout_that_is_told_or_uncertain_is_in_the_covariance() {
    let (believed, uncertain, known) = (nees(0.0, 0.0), nees(0.05, 0.03), nees(READOUT, 0.001));
    assert!(
        believed > 20.0,
        "the test's shutter does not roll: {believed}"
    );
    assert!(uncertain < 9.0, "{uncertain} of {believed}");
    assert!(known < 9.0, "{known} of {believed}");
}

/// What becomes of candidates at rest where a camera turns: `seen(before, after, outcomes)` of each frame's; how many there are.
fn watch(
    readout: f64,
    sd: f64,
    min_parallax: f64,
    mut seen: impl FnMut(Filter, &Filter, &[CandidateOutcome]),
) -> usize {
    let mut scene = rolling(0);
    scene.trajectory = Trajectory::Lively;
    let mut settings = stated(readout, sd);
    let waits = settings.set("birth.min_parallax", &Value::Float(min_parallax));
    waits.expect("a setting");
    let mut filter = scene.filter(settings);
    let mut known = BTreeMap::new();
    let new: Vec<usize> = (40..60).collect();
    let hidden = scene.points.split_off(40);
    filter.predict(0.0).expect("first frame");
    let (z, points) = scene.measure(0.0, &known, true);
    adopt(&mut known, &filter.update(&z).expect("a start"), &points);
    scene.points.extend(hidden);
    let (mut waiting, mut count) = (BTreeMap::new(), 0);
    for frame in 1..40 {
        let t = f64::from(frame) * DT;
        filter.predict(t).expect("increasing time");
        let (z, _) = scene.measure(t, &known, false);
        filter.update(&z).expect("good measurements");
        if frame == 6 {
            let first = new
                .iter()
                .filter_map(|&k| Some((k, scene.rolling_pixel(t, k)?)));
            let (of, pixels): (Vec<usize>, Vec<Vector2<f64>>) = first.unzip();
            let ids = filter.add_candidates(&pixels).expect("candidates");
            count = ids.len();
            waiting.extend(ids.into_iter().zip(of));
        }
        let pixels: Vec<_> = waiting
            .iter()
            .filter_map(|(&id, &k)| Some((id, scene.rolling_pixel(t, k)?)))
            .collect();
        let before = filter.clone();
        let outcomes = filter.observe_candidates(&pixels).expect("they wait");
        for ((id, _), outcome) in pixels.iter().zip(&outcomes) {
            if !outcome.waits() {
                waiting.remove(id);
            }
        }
        seen(before, &filter, &outcomes);
    }
    count
}

/// By how many candidates at rest the places of a point at rest are left, and of how many.
fn left(readout: f64, sd: f64) -> (usize, usize) {
    let mut left = 0;
    let count = watch(readout, sd, 60.0, |_, _, outcomes| {
        let strays = |outcome: &&CandidateOutcome| matches!(outcome, CandidateOutcome::OffArc(_));
        left += outcomes.iter().filter(strays).count();
    });
    (left, count)
}

/// Variances of what no camera can see: turns of camera and map, and how large they are, `(N^T P^-1 N)^-1`.
fn unseen(filter: &Filter) -> SMatrix<f64, GAUGES, GAUGES> {
    let (state, mut n) = (filter.state(), Vec::new());
    directions(state.mean(), state.layout(), &mut n);
    let n = DMatrix::from_vec(state.mean().len(), GAUGES, n);
    let p = state.covariance().to_dense();
    let sd = p.diagonal().map(|v| v.max(1e-14).sqrt());
    let scaled = DMatrix::from_fn(p.nrows(), p.ncols(), |i, j| p[(i, j)] / (sd[i] * sd[j]));
    let n = DMatrix::from_fn(n.nrows(), GAUGES, |i, k| n[(i, k)] / sd[i]);
    let eigen = scaled.symmetric_eigen();
    let least = 1e-9 * eigen.eigenvalues.max();
    let along = eigen.eigenvectors.tr_mul(&n);
    let information = SMatrix::<f64, GAUGES, GAUGES>::from_fn(|a, b| {
        let sum = eigen.eigenvalues.iter().enumerate();
        let sum = sum.filter(|(_, value)| **value > least);
        sum.map(|(i, value)| along[(i, a)] * along[(i, b)] / value)
            .sum()
    });
    information.try_inverse().expect("of full rank")
}

#[test]
fn a_birth_under_a_rolling_shutter_says_nothing_of_turns_and_scale() {
    let (mut born, mut worst) = (0, 0.0_f64);
    watch(0.05, 0.03, 0.5, |before, after, outcomes| {
        let births = |outcome: &&CandidateOutcome| matches!(outcome, CandidateOutcome::Born(_));
        let births = outcomes.iter().filter(births).count();
        if births > 0 {
            born += births;
            let (from, to) = (unseen(&before), unseen(after));
            worst = (0..GAUGES).fold(worst, |worst, k| worst.max(1.0 - to[(k, k)] / from[(k, k)]));
        }
    });
    assert!(born >= 10, "{born}");
    assert!(worst < 1e-3, "{worst} of a variance is gone");
}

#[test]
fn what_the_shutter_bends_does_not_leave_the_places_of_a_point_at_rest() {
    let ((believed, count), (uncertain, _)) = (left(0.0, 0.0), left(0.05, 0.03));
    assert!(count >= 10, "{count}");
    assert!(
        believed > uncertain,
        "{believed} of {count}: the test's shutter bends too little"
    );
    assert_eq!(uncertain, 0, "of {count}");
}

#[test]
fn a_predicted_pixel_is_as_uncertain_as_its_measurement() {
    let mut told = stated(0.05, 0.03);
    for (key, sd) in [
        ("calibration.focal_sd", 0.02),
        ("calibration.centre_sd", 5.0),
    ] {
        told.set(key, &Value::Float(sd)).expect("a setting");
    }
    let mut scene = rolling(0);
    scene.trajectory = Trajectory::Lively;
    let mut filter = scene.filter(told);
    let mut known = BTreeMap::new();
    for frame in 0..30 {
        let t = f64::from(frame) * DT;
        filter.predict(t).expect("increasing time");
        let (z, points) = scene.measure(t, &known, frame % 10 == 0);
        let report = filter.update(&z).expect("good measurements");
        adopt(&mut known, &report, &points);
    }
    filter.predict(30.0 * DT).expect("increasing time");
    let predicted = filter.predict_pixels();
    assert!(predicted.len() > 10, "{}", predicted.len());
    let bearings = predicted.iter().map(|f| Bearing { id: f.id, uv: f.uv });
    let z = Measurements {
        bearings: bearings.collect(),
        ..Default::default()
    };
    let batch = filter.innovation(&z).expect("good measurements");
    for (k, f) in predicted.iter().enumerate() {
        let (m, at) = (batch.rows(), batch.offsets()[k]);
        let s = [0, 1].map(|i| batch.s()[at + i + (at + i) * m]);
        for (i, s) in s.into_iter().enumerate() {
            let ratio = f.s[(i, i)] / s;
            assert!((ratio - 1.0).abs() < 0.02, "{ratio} of feature {}", f.id);
        }
    }
}
