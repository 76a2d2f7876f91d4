//! The filter guards itself: what would break it is refused, and leaves no trace.

use crate::scene::{Scene, adopt, name, settings};
use ekf_core::DepthObservation;
use ekf_core::math::pose::Pose;
use ekf_core::settings::Value;
use ekf_core::{Bearing, EkfError, Filter, MeasurementOutcome, Measurements};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector2, Vector3};
use std::collections::BTreeMap;

/// A started filter after a few frames, and what it measures next.
fn warm(changes: &[(&str, Value)]) -> (Filter, Measurements) {
    let mut scene = Scene::new(21, 60);
    let camera = scene.camera.clone();
    let mut filter = Filter::new(settings(changes), camera.clone(), Some(camera));
    let mut known = BTreeMap::new();
    for k in 0..4 {
        let t = 0.1 * f64::from(k);
        filter.predict(t).expect("time goes on");
        let (z, points) = scene.measure(t, &known, true);
        let report = filter.update(&z).expect("good measurements");
        adopt(&mut known, &report, &points);
    }
    filter.predict(0.4).expect("time goes on");
    (filter, scene.measure(0.4, &known, true).0)
}

fn finite(filter: &Filter) -> bool {
    let state = filter.state();
    let p = state.covariance().to_dense();
    let mut numbers = state.mean().iter().chain(p.iter());
    numbers.all(|v| v.is_finite())
}

#[test]
fn steps_of_time_are_defined() {
    let (mut filter, _) = warm(&[]);
    let before = filter.snapshot();
    let now = filter.time().expect("started");
    for (t, is_right) in [
        (now, "BadTime"),
        (now - 1.0, "BadTime"),
        (now + 1e-9, "BadTime"),
        (f64::NAN, "NonFinite"),
        (f64::INFINITY, "NonFinite"),
        (1e300, "InvalidInput"),
        (-1e300, "InvalidInput"),
        (now + 3601.0, "LongGap"),
    ] {
        let error = filter.predict(t).expect_err(is_right);
        assert!(format!("{error:?}").starts_with(is_right), "{t}: {error:?}");
        assert!(filter.snapshot() == before, "{t}");
    }
    // Many seconds are a long way to coast, and no fault.
    filter.predict(now + 3600.0).expect("an hour");
    filter.check().expect("sound");
    assert!(finite(&filter));
}

#[test]
fn a_long_gap_says_no_more_than_one_of_twenty_seconds() {
    let (filter, _) = warm(&[]);
    let now = filter.time().expect("started");
    let after = |gap: f64| {
        let mut filter = filter.clone();
        filter.predict(now + gap).expect("a gap");
        filter.pose_covariance()
    };
    assert_eq!(after(20.0), after(3000.0));
    assert!(after(19.0) != after(20.0));
}

#[test]
fn an_update_that_tells_nearly_all_leaves_p_sound() {
    for consistency in ["gauge", "none"] {
        let wild = Value::Float(1e3);
        let (mut filter, _) = warm(&[
            ("estimator.consistency", name(consistency)),
            ("process.angular_acceleration_density", wild),
        ]);
        filter
            .predict(filter.time().expect("started") + 0.2)
            .expect("goes on");
        let sd = |filter: &Filter| filter.pose_covariance()[(3, 3)].sqrt();
        let before = sd(&filter);
        let (rotation, translation) = filter.pose();
        let seen = filter.predict_pixels().into_iter();
        let depths = seen.map(|f| DepthObservation {
            id: Some(f.id),
            uv: f.uv,
            depth: (rotation.transpose() * (f.point - translation)).z,
            sigma: 0.01,
        });
        let z = Measurements {
            depths: depths.collect(),
            ..Measurements::default()
        };
        filter.update(&z).expect("as predicted");
        assert!(before > 3000.0 * sd(&filter), "{before} {}", sd(&filter));
        filter.check().expect("sound");
    }
}

#[test]
fn what_may_be_anywhere_is_not_used_and_nothing_is_born_of_it() {
    let (mut filter, z) = warm(&[("process.angular_acceleration_density", Value::Float(1e3))]);
    filter
        .predict(filter.time().expect("started") + 2.0)
        .expect("a gap");
    let seen = filter.predict_pixels();
    assert!(seen.iter().any(|f| f.s[(0, 0)] > 720.0 * 720.0));
    let bearings = seen.iter().map(|f| Bearing { id: f.id, uv: f.uv });
    let depth = DepthObservation {
        id: None,
        uv: Vector2::new(300.0, 200.0),
        depth: 3.0,
        sigma: 0.1,
    };
    let z = Measurements {
        bearings: bearings.collect(),
        depths: vec![depth],
        views: z.views,
        ..Measurements::default()
    };
    let size = filter.map_size();
    let report = filter.update(&z).expect("good numbers");
    for (outcome, f) in report.bearings.iter().zip(&seen) {
        let vague = f.s[(0, 0)].max(f.s[(1, 1)]) > 720.0 * 720.0;
        assert!(
            !vague || *outcome != MeasurementOutcome::Pixel,
            "{outcome:?}"
        );
    }
    assert!(report.bearings.contains(&MeasurementOutcome::TooUncertain));
    assert_eq!(report.depths, [MeasurementOutcome::NotVisible]);
    assert_eq!(filter.map_size(), size);
    filter.check().expect("sound");
}

#[test]
fn coasting_for_ever_ends_in_an_error_and_never_in_an_infinity() {
    let (mut filter, _) = warm(&[("process.acceleration_density", Value::Float(1e3))]);
    let mut t = filter.time().expect("started");
    for _ in 0..2_000_000 {
        t += 3599.0;
        let before = filter.pose_covariance();
        if let Err(error) = filter.predict(t) {
            assert!(matches!(error, EkfError::InvalidInput { what: "time", .. }));
            assert_eq!(filter.pose_covariance(), before);
            assert!(finite(&filter));
            return;
        }
    }
    panic!("P has no bound");
}

#[test]
fn measurements_that_would_break_p_are_refused() {
    // Without gates an absurd innovation gets as far as the update.
    let open = [("validate.test", Value::Name("none".into()))];
    let (mut filter, good) = warm(&open);
    let before = filter.snapshot();
    let mut wild = good.clone();
    wild.views[0].covariance *= 1e60;
    let error = filter.update(&wild).expect_err("S would not be one");
    assert!(matches!(error, EkfError::InvalidInput { .. }), "{error:?}");
    assert!(filter.snapshot() == before, "ids and time included");
    let report = ekf_core::UpdateReport::refused(&wild, error);
    assert_eq!(report.bearings.len(), wild.bearings.len());
    assert!(
        report
            .bearings
            .iter()
            .all(|o| *o == MeasurementOutcome::Refused)
    );

    let mut far = good.clone();
    far.views.clear();
    for (i, bearing) in far.bearings.iter_mut().enumerate() {
        bearing.uv = Vector2::new(if i.is_multiple_of(2) { 1e6 } else { -1e6 }, 1e6);
    }
    match filter.update(&far) {
        Err(EkfError::Unsound { .. }) => assert!(filter.snapshot() == before),
        Ok(_) => assert!(finite(&filter)),
        Err(other) => panic!("{other:?}"),
    }
    let (mut filter, _) = warm(&open);
    filter.update(&good).expect("nothing is broken");
    filter.check().expect("sound");
}

#[test]
fn extreme_numbers_do_not_get_in() {
    let huge = [1e300, -1e300, 1e12, f64::MAX, f64::MIN_POSITIVE];
    for x in huge {
        let (mut filter, good) = warm(&[("validate.test", Value::Name("none".into()))]);
        let worn = good.views[0].clone();
        let pixel = Vector2::new(x, 100.0);
        let depth = |depth: f64, sigma: f64| DepthObservation {
            id: None,
            uv: Vector2::new(300.0, 200.0),
            depth,
            sigma,
        };
        let mut tries: Vec<Measurements> = Vec::new();
        for d in [
            depth(x.abs(), 0.1),
            depth(2.0, x.abs()),
            depth(x.abs(), x.abs()),
            depth(2.0, 1e-9),
            depth(1e-5, 0.1),
        ] {
            tries.push(Measurements {
                depths: vec![d],
                ..Measurements::default()
            });
        }
        let mut bearing = good.clone();
        bearing.bearings[0] = Bearing {
            id: bearing.bearings[0].id,
            uv: pixel,
        };
        tries.push(bearing);
        for change in 0..3 {
            let mut z = good.clone();
            let mut w = worn.clone();
            match change {
                0 => w.t_cf.translation.x = x,
                1 => w.covariance *= x.abs(),
                _ => w.pairs.iter_mut().for_each(|p| p.uv_f.x = x),
            }
            z.views = vec![w];
            tries.push(z);
        }
        for z in &tries {
            let _ = filter.update(z);
            assert!(finite(&filter), "{x:e}: {z:?}");
        }
        let _ = filter.add_candidates(&[pixel]);
        let _ = filter.add_undelayed(&[pixel]);
        let _ = filter.overlap(&worn.t_cf, &(worn.covariance * x.abs()), 0);
        assert!(finite(&filter), "{x:e}");
        filter.predict(0.5).expect("goes on");
        assert!(finite(&filter), "{x:e}");
        for seen in filter.predict_pixels() {
            assert!(seen.s.iter().chain(seen.uv.iter()).all(|v| v.is_finite()));
        }

        let scene = Scene::new(1, 1);
        let mut fresh = Filter::new(settings(&[]), scene.camera.clone(), None);
        let before = fresh.snapshot();
        let points = [Vector3::new(0.1, 0.2, x), Vector3::new(0.0, 0.0, 2.0)];
        let noise = [Matrix3::identity() * 1e-4, Matrix3::identity() * x.abs()];
        let shared = [SMatrix::<f64, 3, 6>::repeat(x); 2];
        for (p, n, s) in [(0, 0, 1), (1, 1, 1), (1, 0, 0)] {
            let shared = if s == 0 { shared[0] } else { SMatrix::zeros() };
            let start =
                fresh.add_points(&[points[p]], &[noise[n]], &[shared], &Matrix6::identity());
            assert!(finite(&fresh), "{x:e} {p} {n} {s}");
            match start {
                Ok(_) => fresh = Filter::restore(&before).expect("as it was"),
                Err(_) => assert!(fresh.snapshot() == before, "{x:e} {p} {n} {s}"),
            }
        }
    }
}

#[test]
fn a_rho_that_crosses_zero_is_no_point_and_goes() {
    // A near point whose depth is hardly known is measured far beyond: its rho is driven to zero and below.
    let scene = Scene::new(3, 1);
    let options = settings(&[("validate.test", Value::Name("none".into()))]);
    let mut filter = Filter::new(options, scene.camera.clone(), None);
    filter.predict(0.0).expect("first frame");
    let points: Vec<Vector3<f64>> = (0..12)
        .map(|i| Vector3::new(f64::from(i % 4) - 1.5, f64::from(i / 4) - 1.0, 4.0))
        .collect();
    let noise = vec![Matrix3::identity() * 1e-6; points.len()];
    let shared = vec![SMatrix::<f64, 3, 6>::zeros(); points.len()];
    let ids = filter
        .add_points(&points, &noise, &shared, &(Matrix6::identity() * 1e-12))
        .expect("good points");
    // Born once the camera's motion is known: an update is linearised where that says the camera is.
    const BORN: i32 = 5;
    let mut vague = u64::MAX;
    let mut crossed = false;
    for k in 1..40 {
        let t = 0.1 * f64::from(k);
        filter.predict(t).expect("time goes on");
        let pose = Pose {
            rotation: Matrix3::identity(),
            translation: Vector3::new(0.1 * f64::from(k), 0.0, 0.0),
        };
        let mut z = Measurements::default();
        for (&id, point) in ids.iter().zip(&points) {
            if let Some(uv) = scene.camera.project(&pose.inverse().apply(point)) {
                z.bearings.push(Bearing { id, uv });
            }
        }
        // Moves with the camera, and overtakes it: no point in front of it looks so.
        let uv = Vector2::new(360.0 + 8.0 * f64::from(k - BORN), 240.0);
        if filter.state().layout().find(vague).is_some() {
            z.bearings.push(Bearing { id: vague, uv });
        }
        let _ = filter.update(&z);
        assert!(finite(&filter));
        filter.check().expect("sound");
        if k == BORN {
            let born = filter.add_undelayed(&[uv]).expect("started")[0];
            vague = born.expect("a ray");
        }
        let rho = |f: &Filter| {
            let block = f.state().layout().find(vague).copied();
            block.map(|b| f.state().feature(&b).scale())
        };
        if rho(&filter).is_some_and(|rho| rho <= 0.0) {
            crossed = true;
            assert!(filter.predict_pixels().iter().all(|f| f.id != vague));
            assert!(filter.landmarks().iter().all(|l| l.id != vague));
            assert!(filter.manage_map(&[]).contains(&vague));
            assert_eq!(rho(&filter), None);
            break;
        }
        filter.manage_map(&[]);
    }
    assert!(crossed, "rho never crossed zero: the test shows nothing");
}
