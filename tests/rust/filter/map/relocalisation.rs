//! A lost camera found again, a frame that is not believed, and a filter that starts in another one's map.

use crate::scene::{Warm, normals, rng, settings, warm};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::observe::FeatureState;
use ekf_core::settings::Value;
use ekf_core::{Bearing, EkfError, Filter, KnownMap, MeasurementOutcome};
use nalgebra::{DMatrix, Matrix6, Vector2, Vector3, Vector6};

/// The noise of these simulations is as the settings say: landmarks share no error.
const WHITE: [(&str, Value); 1] = [("process.map_drift", Value::Float(0.0))];

/// A filter that has tracked for three seconds, and a camera that is elsewhere then.
struct Lost {
    warm: Warm,
    truth: Pose,
    matches: Vec<Bearing>,
    /// Somewhere near the truth, as PnP would give it.
    near: Pose,
}

fn lost(seed: u64, changes: &[(&str, Value)]) -> Lost {
    let mut warm = warm(seed, changes);
    for _ in 0..30 {
        warm.update(false);
        warm.next_frame();
    }
    let mut rng = rng(1000 + seed);
    let away = normals::<6>(&mut rng).component_mul(&Vector6::new(0.4, 0.2, 0.4, 0.1, 0.2, 0.5));
    let truth = warm.scene.pose(warm.t + 2.0).retract(&away);
    let known: Vec<(u64, usize)> = warm.known.iter().map(|(id, p)| (*id, *p)).collect();
    let seen = |(id, point)| warm.scene.pixel(&truth, point).map(|uv| Bearing { id, uv });
    let matches = known.into_iter().filter_map(seen).collect();
    let off =
        normals::<6>(&mut rng).component_mul(&Vector6::new(0.03, 0.03, 0.03, 0.01, 0.01, 0.01));
    let near = truth.retract(&off);
    Lost {
        warm,
        truth,
        matches,
        near,
    }
}

/// Error of a filter's pose in its tangent: truth = estimate Exp(error).
fn error(filter: &Filter, truth: &Pose) -> Vector6<f64> {
    let (rotation, translation) = filter.pose();
    let v = rotation.transpose() * (truth.translation - translation);
    let w = quat::log(&quat::from_rotation(
        &(rotation.transpose() * truth.rotation),
    ));
    Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
}

fn nees(filter: &Filter, truth: &Pose) -> f64 {
    let e = error(filter, truth);
    let inverse = filter.pose_covariance().try_inverse().unwrap();
    (e.transpose() * inverse * e)[(0, 0)]
}

fn state(filter: &Filter) -> (Vec<f64>, DMatrix<f64>) {
    (
        filter.state().mean().to_vec(),
        filter.state().covariance().to_dense(),
    )
}

/// A filter that starts in a map whose errors are drawn from its own covariance, the landmarks' true points, and where
/// the camera is.
fn drawn_map(seed: u64) -> (Filter, Vec<(u64, Vector3<f64>)>, Pose) {
    let mut rng = rng(seed);
    let count = 40;
    let mut true_map = Vec::new();
    for k in 0..count {
        let at = f64::from(k % 4);
        let u = normals::<3>(&mut rng).map(|x| x.clamp(-2.0, 2.0));
        let anchor = Vector3::new(0.15 * at, 0.05 * at, 0.3 * at);
        true_map.push(Vector6::new(
            anchor.x,
            anchor.y,
            anchor.z,
            0.2 * u.x,
            0.15 * u.y,
            0.25 + 0.05 * u.z,
        ));
    }
    // What all have in common: a shift, and the scale; and what each has alone.
    let n = 6 * true_map.len();
    let common = DMatrix::from_fn(n, 4, |i, j| {
        let (y, k) = (&true_map[i / 6], i % 6);
        match (k, j) {
            (0..3, 3) => 0.04 * y[k],
            (5, 3) => -0.04 * y[5],
            (0..3, _) if k == j => 0.03,
            _ => 0.0,
        }
    });
    let own = DMatrix::from_fn(n, 1, |i, _| match i % 6 {
        0..3 => 0.003,
        5 => 0.05 * true_map[i / 6][5],
        _ => 0.002,
    });
    let shared = normals::<4>(&mut rng);
    let landmarks = true_map.iter().enumerate().map(|(l, y)| {
        let alone = normals::<6>(&mut rng);
        Vector6::from_fn(|k, _| {
            let row = 6 * l + k;
            y[k] + (common.row(row) * shared)[(0, 0)] + own[row] * alone[k]
        })
    });
    let map = KnownMap {
        landmarks: landmarks.collect(),
        covariance: &common * common.transpose()
            + DMatrix::from_diagonal(&own.column(0).map(|s| s * s)),
        place: Matrix6::zeros(),
    };
    let mut filter = Filter::new(settings(&WHITE), crate::scene::camera(), None);
    filter.predict(0.0).unwrap();
    let ids = filter.start_from_map(&map).unwrap();
    let points = true_map.iter().map(|y| FeatureState(*y).point().unwrap());
    let away = normals::<6>(&mut rng).component_mul(&Vector6::new(0.3, 0.2, 0.3, 0.1, 0.1, 0.5));
    let pose = Pose::identity().retract(&away);
    (filter, ids.into_iter().zip(points).collect(), pose)
}

fn pixels(filter: &[(u64, Vector3<f64>)], pose: &Pose, rng: &mut rand_pcg::Pcg64) -> Vec<Bearing> {
    let camera = crate::scene::camera();
    let seen = filter.iter().filter_map(|(id, point)| {
        let uv = camera.project(&pose.inverse().apply(point))?;
        let noise = normals::<2>(rng);
        camera.in_image(&uv, 2.0).then_some(Bearing {
            id: *id,
            uv: uv + noise,
        })
    });
    seen.collect()
}

#[test]
fn the_covariance_after_it_is_consistent() {
    let (mut sum, mut runs) = (0.0, 0.0);
    for seed in 0..100 {
        let (mut filter, points, truth) = drawn_map(seed);
        let mut rng = rng(5000 + seed);
        let matches = pixels(&points, &truth, &mut rng);
        if matches.len() < 12 {
            continue;
        }
        let off = normals::<6>(&mut rng) * 0.02;
        let report = filter
            .relocalise(&truth.retract(&off), &matches, None, false)
            .unwrap();
        assert!(report.accepted, "seed {seed}: {report:?}");
        assert!(filter.state().covariance().least_scaled_eigenvalue() > -1e-10);
        sum += nees(&filter, &truth);
        runs += 1.0;
    }
    let mean = sum / runs;
    // Six degrees of freedom: the mean's band at three sigma.
    let band = 3.0 * (12.0_f64 / runs).sqrt();
    println!("NEES {mean:.2} over {runs} runs (6 +- {band:.2})");
    assert!(runs >= 60.0);
    assert!((mean - 6.0).abs() < band, "{mean}");
}

/// The map of a filter that has tracked is not quite as good as it says; what rests on it is no worse.
#[test]
fn in_a_map_of_its_own_it_is_as_consistent_as_the_map() {
    let (mut sum, mut of_map, mut rows, mut runs) = (0.0, 0.0, 0.0, 0.0);
    for seed in 0..80 {
        let mut lost = lost(seed, &WHITE);
        if lost.matches.len() < 10 {
            continue;
        }
        for landmark in lost.warm.filter.landmarks() {
            if let Some(&point) = lost.warm.known.get(&landmark.id) {
                let e = lost.warm.scene.points[point] - landmark.point;
                of_map += (e.transpose() * landmark.covariance.try_inverse().unwrap() * e)[(0, 0)];
                rows += 3.0;
            }
        }
        let report = lost
            .warm
            .filter
            .relocalise(&lost.near, &lost.matches, None, false);
        let report = report.unwrap();
        assert!(report.accepted, "seed {seed}: {report:?}");
        sum += nees(&lost.warm.filter, &lost.truth);
        runs += 1.0;
    }
    let (mean, of_map) = (sum / runs / 6.0, of_map / rows);
    println!("NEES per degree of freedom: {mean:.2}, the map's {of_map:.2}, over {runs} runs");
    assert!(mean < 1.5 * of_map.max(1.0), "{mean}, {of_map}");
}

#[test]
fn what_was_believed_of_the_camera_counts_for_nothing_but_its_speed() {
    // The gauge transport moves the map as well when the camera is predicted to look elsewhere.
    let plain = [("estimator.consistency", Value::Name("none".into()))];
    let mut lost = lost(3, &plain);
    let mut other = lost.warm.filter.clone();
    other.predict(lost.warm.t + 30.0).unwrap();
    for filter in [&mut lost.warm.filter, &mut other] {
        assert!(
            filter
                .relocalise(&lost.near, &lost.matches, None, false)
                .unwrap()
                .accepted
        );
    }
    let [mut near, mut far] = [state(&lost.warm.filter), state(&other)];
    // No more than before is known of the speed, and no more than at a start is said to be.
    let start = lost
        .warm
        .filter
        .settings()
        .process
        .start_velocity_sd
        .powi(2);
    for i in 7..10 {
        assert!(near.1[(i, i)] < 0.1 * start && near.1[(i, i)] < far.1[(i, i)]);
        assert!(far.1[(i, i)] <= start);
        (near.1[(i, i)], far.1[(i, i)]) = (0.0, 0.0);
    }
    assert!(near == far, "the pose, the map, or both");
}

#[test]
fn where_prediction_excludes_it_either_is_half_believed() {
    let mut looked = 0;
    for seed in 0..12 {
        let lost = lost(seed, &WHITE);
        let (rotation, translation) = lost.warm.filter.pose();
        let before = Pose {
            rotation,
            translation,
        };
        // It is known to 4 cm and 3 degrees along each axis.
        let far = (lost.truth.translation - before.translation).norm() > 0.5;
        if !far || lost.matches.len() < 10 {
            continue;
        }
        let [(with, half), (without, whole)] = [true, false].map(|predicted| {
            let mut filter = lost.warm.filter.clone();
            let report = filter.relocalise(&lost.near, &lost.matches, None, predicted);
            (report.unwrap(), filter)
        });
        assert!(with.accepted && with.jumped, "seed {seed}");
        assert!(without.accepted && without.jumped, "seed {seed}");
        // Had prediction been right, the error would be within what is claimed, and far outside without that.
        let [little, much] = [&half, &whole].map(|filter| nees(filter, &before));
        // 99.9 % of six numbers.
        assert!(
            little < 22.5 && much > 50.0,
            "seed {seed}: {little}, {much}"
        );
        assert!(state(&half) == state(&whole), "seed {seed}");
        looked += 1;
    }
    assert!(looked >= 5, "{looked}");
}

/// Matches that are near their prediction, of a camera that was not lost after all.
#[test]
fn where_prediction_allows_it_what_was_known_stays() {
    let mut looked = 0;
    for seed in 0..12 {
        let mut warm = lost(seed, &WHITE).warm;
        let truth = warm.scene.pose(warm.t);
        let known: Vec<(u64, usize)> = warm.known.iter().map(|(id, p)| (*id, *p)).collect();
        let seen = |(id, point)| warm.scene.pixel(&truth, point).map(|uv| Bearing { id, uv });
        let matches: Vec<Bearing> = known.into_iter().filter_map(seen).collect();
        let [with, without] = [true, false].map(|predicted| {
            let mut filter = warm.filter.clone();
            let report = filter.relocalise(&truth, &matches, None, predicted);
            (report.unwrap(), filter)
        });
        if with.0.accepted {
            looked += 1;
            assert!(!with.0.jumped, "seed {seed}");
            let [more, less] = [&with.1, &without.1].map(|f| f.pose_and_twist_covariance());
            assert!(more.trace() < 0.9 * less.trace(), "seed {seed}");
            assert!(nees(&with.1, &truth) < 22.5, "seed {seed}");
        }
    }
    assert!(looked >= 8, "{looked}");
}

#[test]
fn points_that_say_which_they_are_tell_more_of_the_velocities() {
    for seed in 0..6 {
        let mut warm = lost(seed, &WHITE).warm;
        let truth = warm.scene.pose(warm.t);
        let known: Vec<(u64, usize)> = warm.known.iter().map(|(id, p)| (*id, *p)).collect();
        let seen = |(id, point)| warm.scene.pixel(&truth, point).map(|uv| Bearing { id, uv });
        let matches: Vec<Bearing> = known.into_iter().filter_map(seen).collect();
        let [said, unsaid] = [Some(12), None].map(|least| {
            let mut filter = warm.filter.clone();
            let report = filter.relocalise(&truth, &matches, least, false).unwrap();
            assert!(report.accepted && !report.jumped, "seed {seed}");
            assert!(filter.state().covariance().least_scaled_eigenvalue() > -1e-10);
            filter.state().covariance().block::<6, 6>(7, 7).trace()
        });
        assert!(said < 0.7 * unsaid, "seed {seed}: {said}, {unsaid}");
    }
}

/// Twice found, a tenth of a second apart, by a camera of whose speed nothing is known: the way between tells it.
#[test]
fn where_prediction_allows_it_the_way_tells_the_velocities() {
    let (mut sum, mut runs, mut turning, mut widest) = (0.0, 0.0, 0.0, 0.0_f64);
    for seed in 0..100 {
        let (mut filter, points, first) = drawn_map(seed);
        let mut rng = rng(7000 + seed);
        let twist =
            normals::<6>(&mut rng).component_mul(&Vector6::from([1.5, 1.5, 1.5, 0.5, 0.5, 0.5]));
        let second = first.retract(&(twist * 0.1));
        let mut found = true;
        for (k, truth) in [&first, &second].into_iter().enumerate() {
            filter.predict(0.1 * (k + 1) as f64).unwrap();
            let matches = pixels(&points, truth, &mut rng);
            let near = truth.retract(&(normals::<6>(&mut rng) * 0.01));
            // Points that say themselves which they are.
            let report = filter.relocalise(&near, &matches, Some(12), false);
            found &= report.unwrap().accepted;
        }
        if !found {
            continue;
        }
        assert!(filter.state().covariance().least_scaled_eigenvalue() > -1e-10);
        let along = second.rotation * twist.fixed_rows::<3>(0);
        let error = along - filter.state().velocity();
        let p = filter.state().covariance().block::<3, 3>(7, 7);
        sum += error.dot(&p.cholesky().unwrap().solve(&error));
        widest = widest.max(p.trace().sqrt());
        let spin = twist.fixed_rows::<3>(3) - filter.state().angular_velocity();
        let p = filter.state().covariance().block::<3, 3>(10, 10);
        turning += spin.dot(&p.cholesky().unwrap().solve(&spin));
        runs += 1.0;
    }
    let (mean, turning) = (sum / runs, turning / runs);
    // The settings' random accelerations are in P; here there are none.
    println!("NEES {mean:.2} and {turning:.2} over {runs} runs (at most 3), sd to {widest:.2} m/s");
    assert!(runs >= 50.0 && widest < 2.0);
    let band = 3.0 * (6.0_f64 / runs).sqrt();
    assert!(mean < 3.0 + band && turning < 3.0 + band);
}

#[test]
fn the_start_of_the_linearisation_hardly_matters() {
    let lost = lost(4, &WHITE);
    let from = |pose: &Pose| {
        let mut filter = lost.warm.filter.clone();
        assert!(
            filter
                .relocalise(pose, &lost.matches, None, false)
                .unwrap()
                .accepted
        );
        (filter.pose(), filter.pose_covariance())
    };
    let ((_, near), covariance) = from(&lost.near);
    let ((_, exact), _) = from(&lost.truth);
    let sd = covariance.fixed_view::<3, 3>(0, 0).trace().sqrt();
    assert!(
        (near - exact).norm() < 0.1 * sd,
        "{} of {sd}",
        (near - exact).norm()
    );
}

#[test]
fn wrong_matches_leave_the_filter_as_it_was() {
    let mut lost = lost(5, &WHITE);
    let before = state(&lost.warm.filter);
    let mut rng = rng(1);
    for m in &mut lost.matches {
        m.uv += normals::<2>(&mut rng) * 60.0;
    }
    let report = lost
        .warm
        .filter
        .relocalise(&lost.near, &lost.matches, None, false)
        .unwrap();
    assert!(!report.accepted);
    assert!(
        report
            .bearings
            .iter()
            .all(|o| *o == MeasurementOutcome::RejectedBatch)
    );
    assert_eq!(state(&lost.warm.filter), before);
    let few = &lost.matches[..5];
    assert!(
        !lost
            .warm
            .filter
            .relocalise(&lost.near, few, None, false)
            .unwrap()
            .accepted
    );
    assert_eq!(state(&lost.warm.filter), before);
}

#[test]
fn four_are_enough_where_that_is_said() {
    let mut lost = lost(5, &WHITE);
    let four = &lost.matches[..4];
    let mut relocalise = |least| lost.warm.filter.relocalise(&lost.near, four, least, false);
    assert!(!relocalise(None).unwrap().accepted);
    assert!(matches!(
        relocalise(Some(3)),
        Err(EkfError::InvalidInput { .. })
    ));
    assert!(relocalise(Some(4)).unwrap().accepted);
    let error = error(&lost.warm.filter, &lost.truth);
    let p = lost.warm.filter.pose_covariance();
    let distance = error.dot(&p.cholesky().unwrap().solve(&error));
    assert!(distance < 22.5, "{distance}"); // 99.9 % of six numbers
}

#[test]
fn some_wrong_ones_are_left_out() {
    let many = |seed| Some(lost(seed, &WHITE)).filter(|lost| lost.matches.len() >= 15);
    let mut lost = (6..).find_map(many).unwrap();
    for m in lost.matches.iter_mut().take(3) {
        m.uv += Vector2::new(25.0, -30.0);
    }
    let report = lost
        .warm
        .filter
        .relocalise(&lost.near, &lost.matches, None, false)
        .unwrap();
    assert!(report.accepted);
    let wrong = &report.bearings[..3];
    assert!(
        wrong.iter().all(|o| *o != MeasurementOutcome::Pixel),
        "{wrong:?}"
    );
    assert!(error(&lost.warm.filter, &lost.truth).norm() < 0.3);
}

#[test]
fn bad_input_is_refused() {
    let mut lost = lost(7, &WHITE);
    let before = state(&lost.warm.filter);
    let good = lost.matches.clone();
    let filter = &mut lost.warm.filter;
    let mut twice = good.clone();
    twice.push(good[0]);
    assert!(matches!(
        filter.relocalise(&lost.near, &twice, None, false),
        Err(EkfError::InvalidInput { .. })
    ));
    let mut unknown = good.clone();
    unknown[0].id = 123_456;
    assert!(matches!(
        filter.relocalise(&lost.near, &unknown, None, false),
        Err(EkfError::UnknownFeature { .. })
    ));
    let mut nan = good.clone();
    nan[0].uv.x = f64::NAN;
    assert!(matches!(
        filter.relocalise(&lost.near, &nan, None, false),
        Err(EkfError::NonFinite { .. })
    ));
    let mut pose = lost.near.clone();
    pose.rotation *= 2.0;
    assert!(matches!(
        filter.relocalise(&pose, &good, None, false),
        Err(EkfError::InvalidInput { .. })
    ));
    assert_eq!(state(filter), before);
    let mut new = Filter::new(settings(&[]), lost.warm.scene.camera.clone(), None);
    assert!(matches!(
        new.relocalise(&lost.near, &[], None, false),
        Err(EkfError::InvalidInput { .. })
    ));
}

#[test]
fn a_frame_with_too_few_matches_changes_nothing() {
    let mut warm = warm(8, &[]);
    let before = state(&warm.filter);
    let (mut z, _) = warm.scene.measure(warm.t, &warm.known, true);
    let worn = &mut z.views[0];
    // New to the filter: as if it had been born in this very frame.
    worn.pairs[0].id = None;
    z.bearings.truncate(5);
    z.min_inliers = 6;
    let searched = warm.filter.map_size();
    let report = warm.filter.update(&z).unwrap();
    assert!(!report.accepted);
    assert_eq!(state(&warm.filter), before);
    assert_eq!(warm.filter.map_size(), searched);
    for _ in 0..50 {
        assert!(!warm.filter.update(&z).unwrap().accepted);
    }
    // Searched in vain fifty times, and yet not failing.
    assert!(warm.filter.manage_map(&[]).is_empty());
    z.min_inliers = 5;
    assert!(warm.filter.update(&z).unwrap().accepted);
}

#[test]
fn a_working_set_makes_no_difference() {
    let plain = [
        ("estimator.consistency", Value::Name("none".into())),
        ("map.local_from", Value::Int(1_000_000)),
    ];
    let local = [plain[0].clone(), ("map.local_from", Value::Int(0))];
    let [a, b] = [&plain[..], &local[..]].map(|changes| {
        let mut lost = lost(9, changes);
        let report = lost
            .warm
            .filter
            .relocalise(&lost.near, &lost.matches, None, false);
        assert!(report.unwrap().accepted);
        state(&lost.warm.filter)
    });
    assert!((a.1 - b.1).abs().max() < 1e-9);
    let off = a.0.iter().zip(&b.0).map(|(a, b)| (a - b).abs());
    assert!(off.fold(0.0, f64::max) < 1e-9);
}

mod known_map {
    use super::*;

    #[test]
    fn a_filter_started_in_it_is_the_same_after_relocalisation() {
        let mut lost = lost(11, &[]);
        let (ids, map) = lost.warm.filter.known_map();
        let mut other = Filter::new(settings(&[]), lost.warm.scene.camera.clone(), None);
        let new_ids = other.start_from_map(&map).unwrap();
        assert_eq!(ids.len(), new_ids.len());
        assert!(other.state().covariance().least_scaled_eigenvalue() > -1e-10);
        let renamed: Vec<Bearing> = lost
            .matches
            .iter()
            .map(|m| Bearing {
                id: new_ids[ids.binary_search(&m.id).unwrap()],
                uv: m.uv,
            })
            .collect();
        assert!(
            lost.warm
                .filter
                .relocalise(&lost.near, &lost.matches, None, false)
                .unwrap()
                .accepted
        );
        assert!(
            other
                .relocalise(&lost.near, &renamed, None, false)
                .unwrap()
                .accepted
        );
        let (a, b) = (lost.warm.filter.known_map().1, other.known_map().1);
        assert!((&a.covariance - &b.covariance).abs().max() < 1e-10);
        let apart = a
            .landmarks
            .iter()
            .zip(&b.landmarks)
            .map(|(a, b)| (a - b).norm());
        assert!(apart.fold(0.0, f64::max) < 1e-9);
        assert!(
            (lost.warm.filter.pose_covariance() - other.pose_covariance())
                .abs()
                .max()
                < 1e-9
        );
        assert!((lost.warm.filter.pose().1 - other.pose().1).norm() < 1e-9);
    }

    #[test]
    fn bad_maps_are_refused() {
        let lost = lost(12, &[]);
        let (_, good) = lost.warm.filter.known_map();
        let mut filter = Filter::new(settings(&[]), lost.warm.scene.camera.clone(), None);
        let before = state(&filter);
        let mut refused = |change: &dyn Fn(&mut KnownMap)| {
            let mut map = good.clone();
            change(&mut map);
            let error = filter.start_from_map(&map).unwrap_err();
            assert_eq!(state(&filter), before);
            assert!(!filter.started());
            error
        };
        assert!(matches!(
            refused(&|m| m.landmarks[0][5] = 0.0),
            EkfError::InvalidInput { .. }
        ));
        assert!(matches!(
            refused(&|m| m.landmarks[0][1] = f64::NAN),
            EkfError::NonFinite { .. }
        ));
        assert!(matches!(
            refused(&|m| {
                m.landmarks.pop();
            }),
            EkfError::BadShape { .. }
        ));
        assert!(matches!(
            refused(&|m| m.covariance[(0, 1)] += 1.0),
            EkfError::InvalidInput { .. }
        ));
        assert!(matches!(
            refused(&|m| m.covariance[(9, 9)] *= -1.0),
            EkfError::InvalidInput { .. }
        ));
        assert!(matches!(
            refused(&|m| {
                for (i, j) in [(3, 4), (4, 3)] {
                    m.covariance[(i, j)] =
                        2.0 * (m.covariance[(3, 3)] * m.covariance[(4, 4)]).sqrt();
                }
            }),
            EkfError::InvalidInput { .. }
        ));
        assert!(matches!(
            refused(&|m| m.place = -Matrix6::identity()),
            EkfError::InvalidInput { .. }
        ));
        let empty = KnownMap {
            landmarks: Vec::new(),
            covariance: DMatrix::zeros(0, 0),
            place: Matrix6::zeros(),
        };
        assert!(matches!(
            filter.start_from_map(&empty),
            Err(EkfError::InvalidInput { .. })
        ));
        assert!(filter.start_from_map(&good).is_ok());
        assert!(matches!(
            filter.start_from_map(&good),
            Err(EkfError::InvalidInput { .. })
        ));
    }

    #[test]
    fn its_landmarks_are_where_they_were() {
        let lost = lost(13, &[]);
        let (_, map) = lost.warm.filter.known_map();
        let mut other = Filter::new(settings(&[]), lost.warm.scene.camera.clone(), None);
        other.start_from_map(&map).unwrap();
        let pairs = lost
            .warm
            .filter
            .landmarks()
            .into_iter()
            .zip(other.landmarks());
        for (a, b) in pairs {
            let apart: Vector3<f64> = a.point - b.point;
            assert_eq!(apart.norm(), 0.0);
            assert!((a.covariance - b.covariance).abs().max() < 1e-12);
        }
    }
}
