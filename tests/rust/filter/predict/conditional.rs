//! Where features are expected once others have been found.

use crate::filter::update::measure;
use crate::scene::{Scene, adopt, settings, warm};
use ekf_core::settings::Value;
use ekf_core::{Bearing, Measurements};
use nalgebra::{DMatrix, DVector, Matrix2, Vector2};
use std::collections::BTreeMap;

#[test]
fn without_others_nothing_is_new() {
    let mut warm = warm(1, &[]);
    let seen = warm.filter.predict_pixels();
    let ids: Vec<u64> = seen.iter().map(|f| f.id).collect();
    let given = warm.filter.predict_conditional(&[], &ids).unwrap().expected;
    for (f, given) in seen.iter().zip(given) {
        let given = given.unwrap();
        assert!((f.uv - given.uv).norm() < 1e-9);
        assert!((f.s - given.s).norm() < 1e-9 * f.s.norm());
    }
}

/// Against the textbook's conditional distribution, from the joint S.
#[test]
fn others_tell_where_a_feature_is() {
    let mut warm = warm(2, &[]);
    let z = measure(&mut warm, false);
    let last = *z.bearings.last().unwrap();
    let found = &z.bearings[..z.bearings.len() - 1];
    let (s, g) = {
        let batch = warm.filter.innovation(&z).unwrap();
        let m = batch.rows();
        let lower = DMatrix::from_column_slice(m, m, batch.s());
        let full = DMatrix::from_fn(m, m, |i, j| lower[(i.max(j), i.min(j))]);
        (full, DVector::from_column_slice(batch.g()))
    };
    let told = s.nrows() - 2;
    let inverse = s.view((0, 0), (told, told)).clone_owned().try_inverse();
    let gain = s.view((told, 0), (2, told)) * inverse.unwrap();
    let shift = &gain * g.rows(0, told);
    let left = s.view((told, told), (2, 2)) - &gain * s.view((0, told), (told, 2));
    let predicted = last.uv - Vector2::new(g[told], g[told + 1]);
    let before = warm.filter.state().mean().to_vec();
    let given = warm
        .filter
        .predict_conditional(found, &[last.id])
        .unwrap()
        .expected[0]
        .unwrap();
    // What was found moves the mean, which is not linear in the pixels.
    let linear = predicted + Vector2::new(shift[0], shift[1]);
    assert!((given.uv - linear).norm() < 0.2, "{} {linear}", given.uv);
    let expected = Matrix2::new(left[(0, 0)], left[(0, 1)], left[(1, 0)], left[(1, 1)]);
    assert!((given.s - expected).norm() < 0.05 * expected.norm());
    assert!(given.s.trace() < 0.5 * s.view((told, told), (2, 2)).trace());
    assert!((given.uv - last.uv).norm() < 4.0 * given.s.trace().sqrt());
    assert_eq!(before, warm.filter.state().mean(), "the state stays");
}

#[test]
fn wrong_matches_among_the_others_do_no_harm() {
    let mut warm = warm(3, &[]);
    let z = measure(&mut warm, false);
    let (mut found, last) = (z.bearings.clone(), *z.bearings.last().unwrap());
    found.pop();
    let right = warm
        .filter
        .predict_conditional(&found, &[last.id])
        .unwrap()
        .expected[0]
        .unwrap();
    for bearing in found.iter_mut().step_by(4) {
        bearing.uv += Vector2::new(15.0, -9.0);
    }
    let given = warm
        .filter
        .predict_conditional(&found, &[last.id])
        .unwrap()
        .expected[0]
        .unwrap();
    assert!(
        (given.uv - right.uv).norm() < 1.0,
        "{} {}",
        given.uv,
        right.uv
    );
}

/// After the first frame nothing is known of the motion: a match says where another is only to within what the camera may
/// have turned and travelled, so wrong ones agree with any single one. Together with the others they do not.
#[test]
fn nearly_half_may_be_wrong_though_the_motion_is_unknown() {
    for seed in 0..10 {
        let mut scene = Scene::new(seed, 30);
        let mut filter = scene.filter(settings(&[]));
        let mut known = BTreeMap::new();
        filter.predict(0.0).unwrap();
        let (z, points) = scene.measure(0.0, &known, true);
        adopt(&mut known, &filter.update(&z).unwrap(), &points);
        filter.predict(0.1).unwrap();
        // The camera has moved as far as the scene's does in three quarters of a second.
        let (mut z, _) = scene.measure(0.75, &known, false);
        let rest = z.bearings.split_off(11);
        for (k, bearing) in z.bearings.iter_mut().step_by(2).take(5).enumerate() {
            let angle = 2.0 + 1.3 * k as f64;
            bearing.uv += Vector2::new(angle.cos(), angle.sin()) * 40.0;
        }
        let ids: Vec<u64> = rest.iter().map(|bearing| bearing.id).collect();
        let given = filter
            .predict_conditional(&z.bearings, &ids)
            .unwrap()
            .expected;
        for (given, bearing) in given.iter().zip(&rest) {
            let given = given.unwrap();
            let miss = (given.uv - bearing.uv).norm();
            assert!(
                miss < 4.0 * given.s.trace().sqrt(),
                "seed {seed}: {miss} pixels"
            );
            assert!(given.s.trace().sqrt() < 15.0, "seed {seed}: {}", given.s);
        }
    }
}

/// A turn of ten degrees from one frame to the next: as a linear function of it, a pixel far from the image's middle is
/// off by more than it is uncertain.
#[test]
fn a_large_turn_is_not_taken_as_linear() {
    let mut scene = Scene::new(5, 60);
    scene.sigma_px = 0.1;
    let mut filter = scene.filter(settings(&[(
        "process.start_angular_velocity_sd",
        Value::Float(3.0),
    )]));
    let mut known = BTreeMap::new();
    filter.predict(0.0).unwrap();
    let (z, points) = scene.measure(0.0, &known, true);
    adopt(&mut known, &filter.update(&z).unwrap(), &points);
    filter.predict(0.1).unwrap();
    // In the scene this turn takes 3.5 seconds.
    let (mut z, _) = scene.measure(3.5, &known, false);
    let rest = z.bearings.split_off(8);
    assert!(rest.len() > 3);
    let ids: Vec<u64> = rest.iter().map(|bearing| bearing.id).collect();
    let told = filter.predict_conditional(&z.bearings, &ids).unwrap();
    assert_eq!(told.agree, vec![true; 8]);
    for (given, bearing) in told.expected.iter().zip(&rest) {
        let given = given.unwrap();
        let off = given.uv - bearing.uv;
        let distance = off.dot(&(given.s.try_inverse().unwrap() * off));
        assert!(distance < 16.0, "{distance}: {off}");
    }
}

#[test]
fn bad_input_is_named() {
    let mut warm = warm(4, &[]);
    let z: Measurements = measure(&mut warm, false);
    let id = z.bearings[0].id;
    assert!(warm.filter.predict_conditional(&z.bearings, &[id]).is_err());
    assert!(
        warm.filter
            .predict_conditional(&z.bearings, &[9999])
            .is_err()
    );
    let nowhere = Bearing {
        id,
        uv: Vector2::repeat(f64::NAN),
    };
    assert!(warm.filter.predict_conditional(&[nowhere], &[]).is_err());
}
