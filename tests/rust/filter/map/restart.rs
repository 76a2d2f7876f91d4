//! A lost camera that goes on in a new map from Cf, and one that is back in a map of before.

use crate::scene::{Warm, adopt, normals, rng, warm};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::settings::Value;
use ekf_core::{EkfError, Filter, MeasurementOutcome, UpdateReport, WornObservation};
use nalgebra::{Matrix3, Matrix6, Vector2, Vector3, Vector6};
use std::collections::BTreeMap;

/// A second of frames in which nothing is seen.
const BLIND: f64 = 1.0;
/// The noise of these simulations is as the settings say, landmarks share no error; the motion is that of a slow walk.
const CHANGES: [(&str, Value); 3] = [
    ("process.map_drift", Value::Float(0.0)),
    ("process.acceleration_density", Value::Float(0.3)),
    ("process.angular_acceleration_density", Value::Float(0.3)),
];

/// What Cf shows of points that have no feature.
fn overlap(warm: &mut Warm) -> (WornObservation, Vec<usize>) {
    let (mut z, points) = warm.scene.measure(warm.t, &BTreeMap::new(), true);
    (z.views.remove(0), points)
}

/// A filter that was lost for a while.
fn lost(seed: u64) -> Warm {
    let mut warm = warm(seed, &CHANGES);
    for _ in 0..10 {
        warm.update(false);
        warm.next_frame();
    }
    warm.t += BLIND;
    warm.filter.predict(warm.t).unwrap();
    warm
}

fn restart(warm: &mut Warm) -> UpdateReport {
    let (worn, points) = overlap(warm);
    let report = warm.filter.restart(&worn, &Matrix3::zeros()).unwrap();
    warm.known.clear();
    adopt(&mut warm.known, &report, &points);
    report
}

fn pose(filter: &Filter) -> Pose {
    let (rotation, translation) = filter.pose();
    Pose {
        rotation,
        translation,
    }
}

fn tangent(from: &Pose, to: &Pose) -> Vector6<f64> {
    let v = from.rotation.transpose() * (to.translation - from.translation);
    let w = quat::log(&quat::from_rotation(
        &(from.rotation.transpose() * to.rotation),
    ));
    Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
}

fn squared(e: &Vector6<f64>, covariance: &Matrix6<f64>) -> f64 {
    (e.transpose() * covariance.try_inverse().unwrap() * e)[(0, 0)]
}

#[test]
fn the_new_map_hangs_on_what_prediction_knows() {
    let mut warm = lost(1);
    let (before, uncertain) = (pose(&warm.filter), warm.filter.pose_covariance());
    let old: Vec<u64> = warm.known.keys().copied().collect();
    let report = restart(&mut warm);
    assert!(report.accepted);
    assert!(warm.known.len() >= 8, "{}", warm.known.len());
    assert!(
        warm.known
            .keys()
            .all(|id| old.iter().all(|other| id > other))
    );
    assert!(warm.filter.map_size() == warm.known.len());
    warm.filter.check().unwrap();
    // The pose is what it was: where it is in W, no view of new points tells.
    let moved = tangent(&before, &pose(&warm.filter));
    assert!(moved.norm() < 1e-9, "{moved}");
    let off = (warm.filter.pose_covariance() - uncertain).abs().max();
    assert!(off < 1e-9 * uncertain.max(), "{off}");
    // And so are the landmarks uncertain, all together.
    let least = 0.9 * uncertain.fixed_view::<3, 3>(0, 0).diagonal().min();
    for landmark in warm.filter.landmarks() {
        assert!(landmark.covariance.diagonal().min() > least);
    }
}

#[test]
fn a_way_that_may_be_wrong_makes_the_new_maps_place_as_uncertain() {
    let mut pair = [lost(1), lost(1)];
    let way = Vector3::new(2.0, -0.5, 1.0);
    for (warm, gone) in pair
        .iter_mut()
        .zip([Matrix3::zeros(), way * way.transpose()])
    {
        let (worn, _) = overlap(warm);
        assert!(warm.filter.restart(&worn, &gone).unwrap().accepted);
    }
    let [sure, unsure] = pair.map(|warm| {
        let r = pose(&warm.filter).rotation;
        let p = warm.filter.pose_covariance();
        r * p.fixed_view::<3, 3>(0, 0) * r.transpose()
    });
    let off = (unsure - sure - way * way.transpose() * 0.5).abs().max();
    assert!(off < 1e-9, "{off}");
    let mut warm = lost(1);
    let (worn, _) = overlap(&mut warm);
    for (square, what) in [(f64::NAN, "NonFinite"), (-1.0, "InvalidInput")] {
        let error = warm
            .filter
            .restart(&worn, &Matrix3::from_diagonal_element(square));
        assert!(format!("{:?}", error.unwrap_err()).starts_with(what));
    }
}

#[test]
fn in_the_new_map_it_moves_in_metres_and_consistently() {
    let mut in_w = 0.0;
    let mut relative = 0.0;
    let runs = 40;
    for seed in 0..runs {
        let mut warm = lost(100 + seed);
        assert!(restart(&mut warm).accepted);
        let first = (pose(&warm.filter), warm.scene.pose(warm.t));
        for _ in 0..15 {
            warm.next_frame();
            warm.update(false);
        }
        let (estimate, truth) = (pose(&warm.filter), warm.scene.pose(warm.t));
        let e = tangent(&estimate, &truth);
        in_w += squared(&e, &warm.filter.pose_covariance()) / runs as f64;
        // As seen from the first pose of the map, nothing of the long way in the dark is left.
        let since = |from: &Pose, to: &Pose| {
            from.rotation.transpose() * (to.translation - from.translation)
        };
        let step = since(&first.0, &estimate) - since(&first.1, &truth);
        relative += step.norm() / since(&first.1, &truth).norm() / runs as f64;
    }
    println!(
        "NEES in W {in_w:.2}, error of the way since {:.1} %",
        100.0 * relative
    );
    // The sway is smoother than the model allows: 6 would be its own draw.
    assert!(in_w < 9.0, "{in_w}");
    assert!(relative < 0.25, "{relative}");
}

#[test]
fn too_few_births_leave_the_filter_as_it_was() {
    let mut warm = lost(3);
    let (mut worn, _) = overlap(&mut warm);
    worn.pairs.truncate(7);
    let before = warm.filter.snapshot();
    let report = warm.filter.restart(&worn, &Matrix3::zeros()).unwrap();
    assert!(!report.accepted);
    assert!(
        report.views[0]
            .iter()
            .all(|o| *o == MeasurementOutcome::Unused)
    );
    assert!(warm.filter.snapshot() == before);
}

#[test]
fn a_restart_takes_new_points_only_and_not_before_a_start() {
    let mut warm = lost(4);
    let (mut worn, _) = overlap(&mut warm);
    let mut fresh = warm.scene.filter(warm.filter.settings().clone());
    let invalid = |error: EkfError| matches!(error, EkfError::InvalidInput { .. });
    assert!(invalid(
        fresh.restart(&worn, &Matrix3::zeros()).unwrap_err()
    ));
    worn.pairs[0].id = warm.known.keys().next().copied();
    let before = warm.filter.snapshot();
    assert!(invalid(
        warm.filter.restart(&worn, &Matrix3::zeros()).unwrap_err()
    ));
    assert!(warm.filter.snapshot() == before);
}

/// Pixels of a map's landmarks, by their place in it.
fn seen(warm: &mut Warm, ids: &[u64], known: &BTreeMap<u64, usize>) -> Vec<(usize, Vector2<f64>)> {
    let truth = warm.scene.pose(warm.t);
    let places = ids.iter().enumerate();
    let pixel = |(k, id)| Some((k, warm.scene.pixel(&truth, known[id])?));
    places.filter_map(pixel).collect()
}

#[test]
fn back_in_the_old_map_nothing_of_the_new_ones_uncertainty_is_left() {
    let mut warm = lost(5);
    let known = warm.known.clone();
    let (old_ids, old) = warm.filter.known_map();
    assert!(restart(&mut warm).accepted);
    let new_ids: Vec<u64> = warm.known.keys().copied().collect();
    for _ in 0..5 {
        warm.next_frame();
        warm.update(false);
    }
    warm.next_frame();
    let lost_sd = warm.filter.pose_covariance().diagonal().map(f64::sqrt);
    let matches = seen(&mut warm, &old_ids, &known);
    let truth = warm.scene.pose(warm.t);
    let away = normals::<6>(&mut rng(9)) * 0.01;
    let near = truth.retract(&away);
    // Matches with wrong landmarks change nothing.
    let wrong: Vec<_> = matches
        .iter()
        .map(|(k, uv)| ((k + 3) % old_ids.len(), *uv))
        .collect();
    let before = warm.filter.snapshot();
    let (report, none) = warm
        .filter
        .relocalise_in(&old, &near, &wrong, None, false)
        .unwrap();
    assert!(!report.accepted && none.is_empty());
    assert!(warm.filter.snapshot() == before);
    let four = &matches[..4];
    let (few, _) = warm
        .filter
        .relocalise_in(&old, &near, four, None, false)
        .unwrap();
    assert!(!few.accepted);
    let mut by_four = warm.filter.clone();
    let (enough, _) = by_four
        .relocalise_in(&old, &near, four, Some(4), false)
        .unwrap();
    assert!(enough.accepted);
    let (report, ids) = warm
        .filter
        .relocalise_in(&old, &near, &matches, None, false)
        .unwrap();
    assert!(report.accepted);
    assert!(ids.len() == old_ids.len());
    assert!(ids.iter().all(|id| new_ids.iter().all(|new| id > new)));
    let covariance = warm.filter.pose_covariance();
    let sd = covariance.diagonal().map(f64::sqrt);
    assert!((0..6).all(|k| sd[k] < 0.3 * lost_sd[k]), "{sd} {lost_sd}");
    let e = tangent(&pose(&warm.filter), &truth);
    assert!(squared(&e, &covariance) < 22.5, "{e}"); // 99.9 % of six numbers
    warm.filter.check().unwrap();
    let outside = vec![(old_ids.len(), Vector2::new(10.0, 10.0))];
    assert!(
        warm.filter
            .relocalise_in(&old, &near, &outside, None, false)
            .is_err()
    );
}

#[test]
fn the_old_map_is_half_believed_where_prediction_excludes_it() {
    let mut warm = lost(5);
    let known = warm.known.clone();
    let (old_ids, old) = warm.filter.known_map();
    assert!(restart(&mut warm).accepted);
    warm.next_frame();
    let matches = seen(&mut warm, &old_ids, &known);
    let there = warm.scene.pose(warm.t);
    let before = pose(&warm.filter);
    // The same map as it is, and one that stands ten metres further on.
    for far in [0.0, 10.0] {
        let mut map = old.clone();
        for landmark in &mut map.landmarks {
            landmark.x += far;
        }
        let mut near = there.clone();
        near.translation.x += far;
        let [(sure, without), (half, with)] = [false, true].map(|predicted| {
            let mut filter = warm.filter.clone();
            let found = filter.relocalise_in(&map, &near, &matches, None, predicted);
            (found.unwrap().0, filter)
        });
        assert!(sure.accepted && half.accepted);
        assert!(sure.jumped == (far > 0.0) && half.jumped == (far > 0.0));
        let wider = with.pose_covariance() - without.pose_covariance();
        assert!((wider.trace() > 0.0) == (far > 0.0), "{wider}");
        if far > 0.0 {
            let e = tangent(&pose(&with), &before);
            assert!(squared(&e, &with.pose_covariance()) < 22.5, "{e}");
            assert!(squared(&e, &without.pose_covariance()) > 1000.0, "{e}");
        }
    }
}

#[test]
fn a_snapshot_keeps_the_place_of_the_map() {
    let mut warm = lost(6);
    assert!(restart(&mut warm).accepted);
    let again = Filter::restore(&warm.filter.snapshot()).unwrap();
    assert!(again.pose_covariance() == warm.filter.pose_covariance());
    assert!(again.snapshot() == warm.filter.snapshot());
}
