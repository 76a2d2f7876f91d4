//! Odometry in place of constant velocity (METHOD 23): where it takes the camera, how sure that is, what is refused.

use crate::scene::{Scene, adopt, normal, normals, rng, settings};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::settings::Value;
use ekf_core::{EkfError, Filter, Measurements, UpdateReport};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use std::collections::BTreeMap;

const STEP: f64 = 0.02;

/// A filter that has just started, at the origin of W at 0 s.
fn started(changes: &[(&str, Value)]) -> Filter {
    let mut scene = Scene::new(3, 80);
    let camera = scene.camera.clone();
    let mut filter = Filter::new(settings(changes), camera.clone(), Some(camera));
    filter.predict(0.0).expect("a time");
    let (z, _) = scene.measure(0.0, &BTreeMap::new(), true);
    filter.update(&z).expect("good measurements");
    assert!(filter.started());
    filter
}

/// Updates it with what a scene gave it, and manages its map; keeps which feature is which point.
fn measure(
    filter: &mut Filter,
    known: &mut BTreeMap<u64, usize>,
    z: &Measurements,
    points: &[usize],
) -> UpdateReport {
    let report = filter.update(z).expect("good measurements");
    adopt(known, &report, points);
    for id in filter.manage_map(&[]) {
        known.remove(&id);
    }
    report
}

/// Forward is x, left is y, up is z, as on a robot; the camera sits ahead of the axle.
fn mounted() -> Pose {
    Pose {
        rotation: Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0),
        translation: Vector3::new(0.3, 0.05, 0.9),
    }
}

fn covariance() -> Matrix6<f64> {
    Matrix6::from_diagonal(&Vector6::new(4e-4, 1e-4, 1e-4, 1e-4, 1e-4, 4e-4))
}

fn bend() -> Vector6<f64> {
    Vector6::new(1.0, 0.0, 0.0, 0.0, 0.0, 0.6)
}

/// `T_WC` after so long along an arc, of a camera that was at the origin of W.
fn along(twist: &Vector6<f64>, t: f64) -> Pose {
    let mut base = Pose::identity();
    let steps = 4000;
    for _ in 0..steps {
        base = base.retract(&(twist * (t / f64::from(steps))));
    }
    mounted().inverse().compose(&base).compose(&mounted())
}

fn give(filter: &mut Filter, until: f64, mut twist: impl FnMut() -> Vector6<f64>) {
    let mut k = 0;
    while f64::from(k) * STEP <= until + 1e-9 {
        let t = f64::from(k) * STEP;
        filter
            .add_odometry(t, &twist(), &covariance())
            .expect("in order");
        k += 1;
    }
}

fn off(filter: &Filter, truth: &Pose) -> Vector6<f64> {
    let (rotation, translation) = filter.pose();
    let estimate = Pose {
        rotation,
        translation,
    };
    estimate.inverse().compose(truth).log()
}

#[test]
fn the_camera_goes_where_the_wheels_take_it() {
    let mut filter = started(&[]);
    filter.set_odometry_frame(&mounted()).expect("a pose");
    give(&mut filter, 2.0, bend);
    for k in 1..=20 {
        // Frames between the samples, at a rate of their own.
        filter
            .predict(0.1 * f64::from(k) - 0.007)
            .expect("in order");
        assert!(filter.followed_odometry());
    }
    let error = off(&filter, &along(&bend(), 1.993));
    assert!(error.norm() < 2e-3, "{error}");
    // The camera is 0.3 m ahead and 0.05 m left of what turns.
    let speed = (1.0f64 - 0.6 * 0.05).hypot(0.6 * 0.3);
    assert!((filter.velocity().norm() - speed).abs() < 0.05);
    // Past the last sample the motion goes on as it was, and nobody claims to know it.
    let before = filter.pose_covariance().trace();
    filter.predict(2.1).expect("in order");
    filter.predict(2.2).expect("in order");
    assert!(!filter.followed_odometry());
    assert!(off(&filter, &along(&bend(), 2.2)).norm() < 0.05);
    assert!(filter.pose_covariance().trace() > 1.5 * before);
}

#[test]
fn the_covariance_is_that_of_the_errors() {
    let filter = {
        let mut filter = started(&[]);
        filter.set_odometry_frame(&mounted()).expect("a pose");
        filter
    };
    let mut rng = rng(17);
    let (runs, mut nees, mut claimed) = (300, 0.0, 0.0);
    for _ in 0..runs {
        let mut filter = filter.clone();
        let scale = [0.05 * normal(&mut rng), 0.05 * normal(&mut rng)];
        let sd = covariance().diagonal().map(f64::sqrt);
        give(&mut filter, 3.0, || {
            let mut twist = bend();
            twist[0] /= 1.0 + scale[0];
            twist[5] /= 1.0 + scale[1];
            twist + sd.component_mul(&normals::<6>(&mut rng))
        });
        for k in 1..=30 {
            filter.predict(0.1 * f64::from(k)).expect("in order");
        }
        let error = off(&filter, &along(&bend(), 3.0));
        let p = filter.pose_covariance();
        nees +=
            (error.transpose() * p.try_inverse().expect("definite") * error)[0] / f64::from(runs);
        claimed += p[(2, 2)].sqrt() / f64::from(runs);
    }
    // Half a metre and more of noise and scale in three; 6 +- 3 sd of a mean over the runs.
    let band = 3.0 * (12.0 / f64::from(runs)).sqrt();
    assert!((nees - 6.0).abs() < band, "{nees} is not 6 +- {band}");
    assert!((0.05..0.3).contains(&claimed), "{claimed}");
}

#[test]
fn what_is_refused_leaves_the_filter_as_it_was() {
    let mut filter = started(&[]);
    filter
        .add_odometry(0.0, &bend(), &covariance())
        .expect("good");
    let before = filter.snapshot();
    let mut nan = bend();
    nan[2] = f64::NAN;
    let mut flat = covariance();
    flat[(1, 1)] = 0.0;
    let mut lopsided = covariance();
    lopsided[(0, 1)] = 1e-5;
    let non_finite = |e: &EkfError| matches!(e, EkfError::NonFinite { .. });
    let invalid = |e: &EkfError| matches!(e, EkfError::InvalidInput { .. });
    let mut refused =
        |t: f64, twist: &Vector6<f64>, p: &Matrix6<f64>, is: &dyn Fn(&EkfError) -> bool| {
            let error = filter.add_odometry(t, twist, p).expect_err("refused");
            assert!(is(&error), "{error}");
            assert!(filter.snapshot() == before);
        };
    refused(0.1, &nan, &covariance(), &non_finite);
    refused(f64::NAN, &bend(), &covariance(), &non_finite);
    refused(0.1, &(bend() * 1e4), &covariance(), &invalid);
    refused(0.1, &bend(), &flat, &invalid);
    refused(0.1, &bend(), &(-covariance()), &invalid);
    refused(0.1, &bend(), &lopsided, &invalid);
    refused(0.0, &bend(), &covariance(), &|e| {
        matches!(e, EkfError::BadTime { .. })
    });
    refused(1e18, &bend(), &covariance(), &invalid);
    refused(1e4, &bend(), &covariance(), &|e| {
        matches!(e, EkfError::LongGap { .. })
    });
    assert!(invalid(
        &filter.set_odometry_frame(&mounted()).expect_err("too late")
    ));
}

#[test]
fn of_a_silence_a_sample_says_nothing() {
    let (mut silent, mut without) = (started(&[]), started(&[]));
    for filter in [&mut silent, &mut without] {
        filter
            .add_odometry(0.0, &bend(), &covariance())
            .expect("good");
        filter
            .add_odometry(0.1, &bend(), &covariance())
            .expect("good");
        filter.predict(0.1).expect("in order");
    }
    silent
        .add_odometry(1.2, &(bend() * 5.0), &covariance())
        .expect("good");
    for filter in [&mut silent, &mut without] {
        filter.predict(1.1).expect("in order");
    }
    assert_eq!(silent.state().mean(), without.state().mean());
}

#[test]
fn a_snapshot_and_a_checkpoint_hold_it() {
    let mut filter = started(&[]);
    filter.set_odometry_frame(&mounted()).expect("a pose");
    give(&mut filter, 1.0, bend);
    filter.predict(0.35).expect("in order");
    filter.checkpoint();
    let mut again = Filter::restore(&filter.snapshot()).expect("its own");
    for t in [0.5, 0.8] {
        filter.predict(t).expect("in order");
        again.predict(t).expect("in order");
    }
    assert!(filter.snapshot() == again.snapshot());
    filter.rollback().expect("a checkpoint");
    for t in [0.5, 0.8] {
        filter.predict(t).expect("in order");
    }
    assert!(filter.snapshot() == again.snapshot());
}

#[test]
fn scales_are_estimated_from_what_is_seen() {
    let mut scene = Scene::new(8, 120);
    let camera = scene.camera.clone();
    let mut filter = Filter::new(settings(&[]), camera.clone(), Some(camera));
    let mut known = BTreeMap::new();
    let dt = 0.05;
    for k in 0..120 {
        let t = dt * f64::from(k);
        if k > 0 {
            // C is the odometry's frame; it tells a tenth too little of the way.
            let step = scene.pose(t - dt).inverse().compose(&scene.pose(t));
            let mut twist = step.log() / dt;
            twist.fixed_rows_mut::<3>(0).scale_mut(0.9);
            filter
                .add_odometry(t, &twist, &(covariance() * 0.1))
                .expect("good");
        } else {
            filter
                .add_odometry(t, &Vector6::zeros(), &covariance())
                .expect("good");
        }
        filter.predict(t).expect("in order");
        let (z, points) = scene.measure(t, &known, k % 10 < 5);
        measure(&mut filter, &mut known, &z, &points);
    }
    let (scale, p) = filter.odometry_scale().expect("a scale");
    let sd = p[(0, 0)].sqrt();
    assert!(sd < 0.04, "{sd}");
    assert!(
        (scale[0] - 0.111).abs() < 3.0 * sd + 0.01,
        "{scale} +- {sd}"
    );
    assert!(scale[1].abs() < 0.03, "{scale}");
}

#[test]
fn the_noise_of_wheels_that_stand_says_nothing_of_their_scales() {
    let mut scene = Scene::new(8, 120);
    let camera = scene.camera.clone();
    let mut filter = Filter::new(settings(&[]), camera.clone(), Some(camera));
    let (mut known, mut rng) = (BTreeMap::new(), rng(4));
    let sd = covariance().diagonal().map(f64::sqrt);
    for k in 0..100 {
        let t = 0.05 * f64::from(k);
        let twist = sd.component_mul(&normals::<6>(&mut rng));
        filter.add_odometry(t, &twist, &covariance()).expect("good");
        filter.predict(t).expect("in order");
        let (z, points) = scene.measure(0.0, &known, k % 10 < 5);
        measure(&mut filter, &mut known, &z, &points);
    }
    // Where nothing moves, a scale of zero would explain all that the wheels tell.
    let (scale, p) = filter.odometry_scale().expect("a scale");
    assert!(scale.abs().max() < 1e-12, "{scale}");
    for k in 0..2 {
        assert!((p[(k, k)].sqrt() - 0.05).abs() < 1e-3, "{p}");
    }
    filter.check().expect("sound");
}

#[test]
fn wheels_that_slip_are_distrusted_for_that_frame() {
    let mut scene = Scene::new(5, 100);
    let camera = scene.camera.clone();
    let mut filter = Filter::new(settings(&[]), camera.clone(), Some(camera));
    let mut known = BTreeMap::new();
    let dt = 0.05;
    let mut contradicted = Vec::new();
    for k in 0..30 {
        let t = dt * f64::from(k);
        let mut twist = Vector6::zeros();
        if k > 0 {
            twist = scene.pose(t - dt).inverse().compose(&scene.pose(t)).log() / dt;
        }
        if k == 20 {
            twist[2] += 3.0;
        }
        filter.add_odometry(t, &twist, &covariance()).expect("good");
        filter.predict(t).expect("in order");
        let (z, points) = scene.measure(t, &known, k < 3);
        if filter.contradicts_odometry(&z.bearings, 0).expect("good") {
            contradicted.push(k);
            let before = filter.pose_covariance();
            filter.distrust_odometry();
            assert!(filter.pose_covariance().trace() > before.trace());
            filter.trust_odometry();
            assert_eq!(filter.pose_covariance(), before);
            filter.distrust_odometry();
        }
        let report = measure(&mut filter, &mut known, &z, &points);
        assert!(report.accepted || !filter.started());
    }
    assert_eq!(contradicted, [20]);
    let (rotation, translation) = filter.pose();
    let truth = scene.pose(29.0 * dt);
    assert!((translation - truth.translation).norm() < 0.1);
    assert!((quat::rotation_log(&(rotation.transpose() * truth.rotation))).norm() < 0.03);
}
