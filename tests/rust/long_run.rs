//! Long runs: P stays sound in every mode, runs repeat bit for bit, and the start's scale error is claimed consistently.

use crate::scene::{DT, Scene, adopt, name, rng, settings};
use ekf_core::math::quat;
use ekf_core::settings::Value;
use ekf_core::state::BlockKind;
use ekf_core::{CandidateOutcome, Filter};
use nalgebra::Vector6;
use rand::Rng;
use std::collections::BTreeMap;

/// What a long run went through.
#[derive(Default)]
struct Traffic {
    births: usize,
    deletions: usize,
    with_clones: usize,
}

/// Features come (by births of the mode) and go (one every few frames); every tenth frame has a worn camera.
fn run(mode: &str, consistency: &str, steps: usize, seed: u64) -> (Filter, Traffic) {
    let mut rng = rng(seed + 1000);
    let mut scene = Scene::new(seed, 40);
    let mut filter = scene.filter(settings(&[
        ("estimator.mode", name(mode)),
        ("estimator.consistency", name(consistency)),
        ("map.max_features", Value::Int(20)),
        ("worn.bias_share", Value::Float(0.3)),
    ]));
    let mut known = BTreeMap::new();
    let mut waiting: BTreeMap<u64, usize> = BTreeMap::new();
    let mut traffic = Traffic::default();
    for step in 0..steps {
        let t = 0.5 * DT * step as f64;
        filter.predict(t).expect("increasing time");
        let (mut z, points) = scene.measure(t, &known, step % 10 == 0);
        z.bearings.retain(|_| rng.random_bool(0.9));
        let report = filter.update(&z).expect("good measurements");
        let before = known.len();
        adopt(&mut known, &report, &points);
        traffic.births += known.len() - before;

        let pose = scene.pose(t);
        let mut seen = Vec::new();
        for (&id, &point) in &waiting {
            if let Some(uv) = scene.pixel(&pose, point) {
                seen.push((id, uv));
            }
        }
        let outcomes = filter.observe_candidates(&seen).expect("candidates");
        for ((candidate, _), outcome) in seen.iter().zip(outcomes) {
            if let CandidateOutcome::Born(id) = outcome {
                known.insert(id, waiting[candidate]);
                traffic.births += 1;
            }
        }
        if step % 4 == 3 && known.len() > 10 {
            let k = rng.random_range(0..known.len());
            let id = *known.keys().nth(k).expect("within the map");
            filter.remove_features(&[id]).expect("in the map");
            known.remove(&id);
            traffic.deletions += 1;
        }
        for id in filter.manage_map(&[]) {
            known.remove(&id);
            traffic.deletions += 1;
        }
        let alive: Vec<u64> = filter.candidate_ids().collect();
        waiting.retain(|id, _| alive.contains(id));
        let layout = filter.state().layout();
        traffic.with_clones += usize::from(layout.of_kind(BlockKind::Clone).count() > 0);
        assert_eq!(layout.features().count(), known.len());

        if step % 5 == 0 && known.len() + waiting.len() < 24 {
            let used: Vec<usize> = known.values().chain(waiting.values()).copied().collect();
            let mut fresh: Vec<usize> = (0..scene.points.len())
                .filter(|p| !used.contains(p))
                .collect();
            fresh.retain(|_| rng.random_bool(0.3));
            let found: Vec<_> = fresh
                .into_iter()
                .filter_map(|p| Some((p, scene.pixel(&pose, p)?)))
                .collect();
            let pixels: Vec<_> = found.iter().map(|(_, uv)| *uv).collect();
            if mode == "mono-undelayed" {
                let ids = filter.add_undelayed(&pixels).expect("finite");
                for (id, (point, _)) in ids.into_iter().zip(&found) {
                    if let Some(id) = id {
                        known.insert(id, *point);
                        traffic.births += 1;
                    }
                }
            } else {
                let ids = filter.add_candidates(&pixels).expect("started");
                waiting.extend(ids.into_iter().zip(found.iter().map(|(p, _)| *p)));
            }
        }
        if step % 250 == 249 || step + 1 == steps {
            let least = filter.state().covariance().least_scaled_eigenvalue();
            assert!(
                least > -1e-10,
                "{mode}, {consistency}, step {step}: least eigenvalue {least:e}"
            );
            assert!(filter.state().mean().iter().all(|v| v.is_finite()));
            let p = filter.state().covariance().to_dense();
            assert!(p.iter().all(|v| v.is_finite()));
        }
    }
    (filter, traffic)
}

fn long_run(mode: &str, consistency: &str, steps: usize) {
    let (_, traffic) = run(mode, consistency, steps, 31);
    assert!(traffic.births > steps / 8, "{} births", traffic.births);
    assert!(
        traffic.deletions > steps / 8,
        "{} deletions",
        traffic.deletions
    );
    if mode != "mono-undelayed" {
        assert!(
            traffic.with_clones > steps / 4,
            "{} with clones",
            traffic.with_clones
        );
    }
}

#[test]
fn mono_stays_sound() {
    for consistency in ["none", "gauge"] {
        long_run("mono", consistency, 2000);
    }
}

#[test]
fn mono_undelayed_stays_sound() {
    for consistency in ["none", "gauge"] {
        long_run("mono-undelayed", consistency, 2000);
    }
}

#[test]
fn collab_init_stays_sound() {
    for consistency in ["none", "gauge"] {
        long_run("collab-init", consistency, 1000);
    }
}

#[test]
fn collab_stays_sound() {
    for consistency in ["none", "gauge"] {
        long_run("collab", consistency, 1000);
    }
}

#[test]
fn collab_tight_stays_sound() {
    for consistency in ["none", "gauge"] {
        long_run("collab-tight", consistency, 1000);
    }
}

#[test]
fn two_runs_give_the_same_bits() {
    let bits = || {
        let (filter, _) = run("collab-tight", "gauge", 150, 32);
        let p = filter.state().covariance().to_dense();
        let entries = filter.state().mean().iter().chain(p.iter());
        entries.map(|v| v.to_bits()).collect::<Vec<u64>>()
    };
    assert_eq!(bits(), bits());
}

/// Mean NEES of the pose (6 degrees of freedom) ten frames after a worn start, with noise as it is claimed.
fn mean_nees(errors: &str, runs: u64) -> f64 {
    let mut sum = 0.0;
    for seed in 0..runs {
        let mut scene = Scene::new(500 + seed, 40);
        let mut filter = scene.filter(settings(&[
            ("estimator.mode", name("mono")),
            ("worn.errors", name(errors)),
            ("process.map_drift", Value::Float(0.0)),
        ]));
        let mut known = BTreeMap::new();
        let mut t = 0.0;
        for frame in 0..=10 {
            t = DT * f64::from(frame);
            filter.predict(t).expect("increasing time");
            let (z, points) = scene.measure(t, &known, frame == 0);
            let report = filter.update(&z).expect("good measurements");
            adopt(&mut known, &report, &points);
        }
        let truth = scene.pose(t);
        let (rotation, position) = filter.pose();
        let v = rotation.transpose() * (truth.translation - position);
        let w = quat::log(&quat::from_rotation(
            &(rotation.transpose() * truth.rotation),
        ));
        let error = Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z);
        let chol = filter
            .pose_covariance()
            .cholesky()
            .expect("positive definite");
        sum += error.dot(&chol.solve(&error));
    }
    sum / runs as f64
}

#[test]
fn the_start_claims_its_scale_error() {
    // Over 1000 runs 6.9: the linear update of depths costs 15 % of the 6 that an exact filter would have.
    let shared = mean_nees("shared", 120);
    assert!(
        (5.0..9.0).contains(&shared),
        "NEES {shared}, expected 6 to 7"
    );
    let independent = mean_nees("independent", 40);
    assert!(
        independent > 15.0,
        "NEES {independent} should betray overconfidence"
    );
}
