//! A visual gyroscope (METHOD 27): a turn that the map does not show is taken from two images, with what is known of it.

use crate::scene::{DT, Warm, normals, rng, warm};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::{EkfError, Filter, Followed, Measurements};
use nalgebra::{Vector2, Vector3};
use rand::Rng;
use rand_pcg::Pcg64;

/// How much further than predicted the camera turns in a frame, radians: 8 degrees.
const JERK: f64 = 0.14;

/// A filter that was predicted past a frame in which the camera was jerked about, where it is then, and what the images show.
fn jerked(seed: u64) -> (Warm, Pose, Followed) {
    jerked_at(seed, |_| {})
}

/// The same after something was done to the filter.
fn jerked_at(seed: u64, prepare: impl Fn(&mut Warm)) -> (Warm, Pose, Followed) {
    let mut warm = warm(seed, &[]);
    let mut rng = rng(seed + 100);
    warm.update(false);
    prepare(&mut warm);
    warm.filter.checkpoint();
    let before = warm.scene.pose(warm.t);
    warm.next_frame();
    let axis: Vector3<f64> = normals::<3>(&mut rng).normalize();
    let mut now = warm.scene.pose(warm.t);
    now.rotation *= quat::rotation_exp(&(axis * JERK));
    let followed = follow(&warm, &mut rng, &before, &now);
    (warm, now, followed)
}

/// Points all over the view, 3 to 9 m away, as both images show them, to half a pixel.
fn follow(warm: &Warm, rng: &mut Pcg64, before: &Pose, now: &Pose) -> Followed {
    let camera = &warm.scene.camera;
    let mut found = Followed {
        since: warm.t - DT,
        ..Followed::default()
    };
    while found.before.len() < 60 {
        let uv = Vector2::new(rng.random_range(0.0..720.0), rng.random_range(0.0..480.0));
        let depth = rng.random_range(3.0..9.0);
        let Some(ray) = camera.unproject(&uv) else {
            continue;
        };
        let point = now.inverse().apply(&before.apply(&(ray * (depth / ray.z))));
        let Some(seen) = camera.project(&point).filter(|uv| camera.in_image(uv, 0.0)) else {
            continue;
        };
        found.before.push(uv + normals::<2>(rng) * 0.5);
        found.now.push(seen + normals::<2>(rng) * 0.5);
    }
    found
}

/// The attitude's error, radians, and its NEES, three is ideal.
fn attitude(warm: &Warm, truth: &Pose) -> (f64, f64) {
    let (r_wc, _) = warm.filter.pose();
    let error = quat::rotation_log(&(r_wc.transpose() * truth.rotation));
    let covariance = warm.filter.pose_covariance();
    let own = covariance.fixed_view::<3, 3>(3, 3).cholesky();
    let scaled = own.expect("positive definite").solve(&error);
    (error.norm(), error.dot(&scaled))
}

#[test]
fn a_jerk_is_seen_and_claimed_as_well_as_it_is() {
    let (mut sum, runs) = (0.0, 30);
    for seed in 0..runs {
        let (mut warm, truth, seen) = jerked(seed);
        let (predicted, _) = attitude(&warm, &truth);
        let turned = warm.filter.predict_again(&seen);
        assert_eq!(turned, Ok(true), "seed {seed}");
        assert_eq!(warm.filter.time(), Some(warm.t));
        let (error, nees) = attitude(&warm, &truth);
        assert!(
            error < 0.3 * predicted,
            "seed {seed}: {error} of {predicted}"
        );
        sum += nees;
    }
    // chi2 with 90 degrees of freedom: 99.9 % lie below 137. Depths are taken to be known worse than they are here.
    assert!(sum < 137.0, "{}", sum / runs as f64);
}

/// Where the way is hardly known it fits any turn, if it may be as long as it likes: 3 m/s in one axis, which are told apart from
/// 10 degrees only by how depths spread along the way.
#[test]
fn a_turn_is_seen_though_the_velocity_is_hardly_known() {
    let (mut sum, runs) = (0.0, 30);
    for seed in 0..runs {
        let (mut warm, truth, seen) = jerked_at(seed, |warm| {
            let velocity = warm.filter.velocity();
            for axis in 0..3 {
                let off = Vector3::ith(axis, 3.0);
                for way in [velocity + off, velocity] {
                    warm.filter.go_on_at(&way).expect("started");
                }
            }
        });
        let turned = warm.filter.predict_again(&seen);
        assert_eq!(turned, Ok(true), "seed {seed}");
        let (error, nees) = attitude(&warm, &truth);
        assert!(error < 0.25 * JERK, "seed {seed}: {error}");
        sum += nees;
    }
    assert!(sum < 137.0, "{}", sum / runs as f64);
}

#[test]
fn what_moves_by_itself_is_no_turn() {
    let (warm, _, seen) = jerked(3);
    let refused = |what: &str, seen: &Followed| {
        let mut filter = warm.filter.clone();
        let turned = filter.predict_again(seen);
        assert_eq!(turned, Ok(false), "{what}");
        assert_eq!(filter.pose(), warm.filter.pose(), "{what}");
        assert_eq!(filter.time(), Some(warm.t), "{what}");
    };
    let some = |keep: &dyn Fn(usize, &Vector2<f64>) -> bool| {
        let both = seen.before.iter().zip(&seen.now).enumerate();
        let (before, now) = both
            .filter(|(k, (uv, _))| keep(*k, uv))
            .map(|(_, (a, b))| (*a, *b))
            .unzip();
        let since = seen.since;
        Followed { since, before, now }
    };
    refused("a few points", &some(&|k, _| k < 14));
    refused(
        "a person's width",
        &some(&|_, uv| (uv.x - 200.0).abs() < 110.0),
    );
    let mut parted = some(&|_, _| true);
    for uv in &mut parted.now[..20] {
        uv.x += 40.0;
    }
    refused("a third of the view goes another way", &parted);
}

/// A camera that has seen nothing for some frames follows what a part of the image shows, and claims little of it: somebody who
/// walks by would show it as well.
#[test]
fn a_lost_camera_follows_a_part_of_the_image() {
    for unseen in [2, 3] {
        let (mut warm, truth, mut seen) = jerked_at(5, |warm| {
            for _ in 0..unseen {
                warm.next_frame();
            }
        });
        let part = |uv: &Vector2<f64>| (uv.x - 360.0).abs() < 110.0;
        let pairs = seen.before.iter().zip(&seen.now);
        let pairs = pairs.filter(|(before, _)| part(before));
        (seen.before, seen.now) = pairs.map(|(a, b)| (*a, *b)).unzip();
        let (predicted, _) = attitude(&warm, &truth);
        let turned = warm.filter.predict_again(&seen);
        assert_eq!(turned, Ok(unseen == 3));
        let (error, nees) = attitude(&warm, &truth);
        assert_eq!(error < 0.6 * predicted, unseen == 3, "{error} {predicted}");
        if unseen == 3 {
            let sd = warm
                .filter
                .pose_covariance()
                .fixed_view::<3, 3>(3, 3)
                .diagonal()
                .map(f64::sqrt);
            assert!(sd.min() > 0.3 * JERK && nees < 3.0, "{sd} {nees}");
        }
    }
}

#[test]
fn it_asks_for_the_checkpoint_of_the_frame_before() {
    let (mut warm, _, seen) = jerked(4);
    let mut late = seen.clone();
    late.since = 0.123;
    assert_eq!(warm.filter.predict_again(&late), Ok(false));
    let mut fewer = seen.clone();
    fewer.before.pop();
    let lists = warm.filter.predict_again(&fewer);
    assert!(
        matches!(lists, Err(EkfError::InvalidInput { .. })),
        "{lists:?}"
    );
    let mut bad = seen.clone();
    bad.now[0].x = f64::NAN;
    let nan = warm.filter.predict_again(&bad);
    assert!(matches!(nan, Err(EkfError::NonFinite { .. })), "{nan:?}");
    assert_eq!(warm.filter.predict_again(&seen), Ok(true));
}

/// What is found may be on somebody who fills the view, and turns the camera with them; the image as a whole shows another turn.
#[test]
fn a_frame_that_would_turn_the_camera_otherwise_than_the_image_is_not_used() {
    for off in [0.0, 3.0_f64.to_radians()] {
        let mut warm = warm(6, &[]);
        let mut rng = rng(106);
        warm.update(false);
        warm.filter.checkpoint();
        let before = warm.scene.pose(warm.t);
        warm.next_frame();
        let mut now = warm.scene.pose(warm.t);
        now.rotation *= quat::rotation_exp(&Vector3::new(0.0, 0.0, off));
        let mut z = warm.scene.measure(warm.t, &warm.known, false).0;
        z.followed = Some(follow(&warm, &mut rng, &before, &now));
        let predicted = warm.filter.pose();
        let report = warm.filter.update(&z).expect("an update");
        assert_eq!(report.accepted, off == 0.0, "{off}");
        assert_eq!(report.turn_excluded, off > 0.0, "{off}");
        assert_eq!(warm.filter.pose() == predicted, off > 0.0, "{off}");
        // Points that show no turn say nothing.
        z.followed = Some(Followed::default());
        assert!(warm.filter.update(&z).expect("an update").accepted);
    }
}

#[test]
fn points_that_are_no_pairs_are_refused_with_the_frame() {
    let (mut warm, _, seen) = jerked(7);
    let mut z = warm.scene.measure(warm.t, &warm.known, false).0;
    let pose = warm.filter.pose();
    let mut fewer = seen.clone();
    fewer.now.pop();
    z.followed = Some(fewer);
    let error = warm.filter.update(&z).unwrap_err();
    assert!(
        matches!(
            error,
            EkfError::InvalidInput {
                what: "points followed",
                ..
            }
        ),
        "{error}"
    );
    assert_eq!(warm.filter.pose(), pose);
}

/// Nothing is measured then: what the update before moved is not this one's.
#[test]
fn a_frame_in_which_nothing_was_found_is_asked_as_it_was_predicted() {
    let mut warm = warm(8, &[]);
    warm.update(false);
    warm.filter.checkpoint();
    let before = warm.scene.pose(warm.t);
    warm.next_frame();
    let mut rng = rng(108);
    let now = warm.scene.pose(warm.t);
    let z = Measurements {
        max_speed: Some(1.5 * warm.filter.velocity().norm()),
        followed: Some(follow(&warm, &mut rng, &before, &now)),
        ..Measurements::default()
    };
    let predicted = warm.filter.pose();
    let mut fresh = Filter::restore(&warm.filter.snapshot()).expect("a filter");
    for filter in [&mut warm.filter, &mut fresh] {
        let report = filter.update(&z).expect("an update");
        assert!(report.accepted && !report.too_fast && !report.turn_excluded);
        assert_eq!(filter.pose(), predicted);
    }
}
