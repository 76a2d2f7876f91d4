//! The relative standard deviation of the scale.

use crate::filter::update::with_clone;
use crate::scene::{normal, rng};
use ekf_core::{Filter, Settings};
use nalgebra::{DVector, Matrix3, Matrix6, SMatrix, SymmetricEigen, Vector3};

/// A filter that starts from points whose distances are all too long by one unknown factor, besides errors of their own.
fn start(common: f64, own: &[f64]) -> Filter {
    let camera = crate::scene::camera();
    let mut filter = Filter::new(Settings::default(), camera, None);
    filter.predict(0.0).unwrap();
    let points: Vec<_> = (0..own.len())
        .map(|i| Vector3::new(0.3 * i as f64 - 0.6, 0.1 * i as f64, 2.0 + i as f64))
        .collect();
    let noise: Vec<_> = points
        .iter()
        .zip(own)
        .map(|(p, sd)| Matrix3::identity() * (sd * p.norm()).powi(2))
        .collect();
    // The first number of the shared error is the logarithm of the scale.
    let mut shared = vec![SMatrix::<f64, 3, 6>::zeros(); own.len()];
    for (by_error, p) in shared.iter_mut().zip(&points) {
        by_error.set_column(0, p);
    }
    let covariance = Matrix6::identity() * common.powi(2);
    filter
        .add_points(&points, &noise, &shared, &covariance)
        .unwrap();
    filter
}

#[test]
fn nothing_is_known_without_a_map() {
    let filter = Filter::new(Settings::default(), crate::scene::camera(), None);
    assert_eq!(filter.scale_sd(), None);
}

#[test]
fn what_all_depths_share_stays_and_what_they_do_not_averages_out() {
    let (common, own) = (0.05, [0.01, 0.02, 0.1, 0.02, 0.3]);
    let sd = start(common, &own).scale_sd().expect("a map");
    let weights = own.map(|sd| 1.0 / (common * common + sd * sd));
    let total: f64 = weights.iter().sum();
    let alone: f64 = weights
        .iter()
        .zip(own)
        .map(|(w, s)| (w * s / total).powi(2))
        .sum();
    let expected = (common * common + alone).sqrt();
    assert!((sd - expected).abs() < 1e-9, "{sd} in place of {expected}");
    let many = start(common, &[0.02; 40]).scale_sd().expect("a map");
    assert!((many - common).abs() < 0.01 * common, "{many}");
    let exact = start(1e-9, &[0.02; 16]).scale_sd().expect("a map");
    assert!((exact - 0.005).abs() < 1e-9, "{exact}");
}

/// States are drawn from P; the ranges in them, weighted with their own scatter, scatter as `scale_sd` says.
#[test]
fn it_is_what_states_drawn_from_p_show() {
    let warm = with_clone(61, &[]);
    let state = warm.filter.state();
    let eigen = SymmetricEigen::new(state.covariance().to_dense());
    let roots = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    let features: Vec<_> = state.layout().features().collect();
    let mut random = rng(62);
    // Small errors, so that first order is all there is.
    let (draws, size) = (4000, 0.05);
    let mut logs = vec![Vec::with_capacity(draws); features.len()];
    for _ in 0..draws {
        let z = DVector::from_fn(roots.len(), |i, _| roots[i] * normal(&mut random));
        let error = &eigen.eigenvectors * z;
        let x: Vec<f64> = state
            .mean()
            .iter()
            .zip(error.iter())
            .map(|(x, e)| x + size * e)
            .collect();
        let camera = Vector3::from_column_slice(&x[..3]);
        for (block, logs) in features.iter().zip(&mut logs) {
            let point = block.feature(&x).point().expect("errors are small");
            logs.push((point - camera).norm().ln() / size);
        }
    }
    let variance = |values: &[f64]| {
        let mean = values.iter().sum::<f64>() / values.len() as f64;
        values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64
    };
    let weights: Vec<f64> = logs.iter().map(|logs| 1.0 / variance(logs)).collect();
    let total: f64 = weights.iter().sum();
    let scales: Vec<f64> = (0..draws)
        .map(|k| {
            logs.iter()
                .zip(&weights)
                .map(|(l, w)| w * l[k])
                .sum::<f64>()
                / total
        })
        .collect();
    let (shown, said) = (
        variance(&scales).sqrt(),
        warm.filter.scale_sd().expect("a map"),
    );
    assert!(
        (said / shown - 1.0).abs() < 0.06,
        "{said} where {shown} shows"
    );
    assert!(said > 1e-4);
}

/// A target of known size comes into view of a filter whose scale is known to 5 %: bearings of it tell the scale, as
/// its points are where they are relative to each other whatever the pose that they were added with.
#[test]
fn a_target_that_comes_into_view_tells_the_scale() {
    let camera = crate::scene::camera();
    let mut filter = start(0.05, &[1e-4; 8]);
    let before = filter.scale_sd().expect("a map");
    let corners: Vec<_> = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)]
        .map(|(x, y)| Vector3::new(0.1 + 0.1 * x, 0.1 * y, 1.0 + 0.03 * x))
        .to_vec();
    let noise = vec![Matrix3::identity() * 1e-8; 4];
    let mut shared = vec![SMatrix::<f64, 3, 6>::zeros(); 4];
    for (by_error, p) in shared.iter_mut().zip(&corners) {
        by_error
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&-Matrix3::identity());
        by_error
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&p.cross_matrix());
    }
    let pose = Matrix6::from_diagonal(&nalgebra::Vector6::new(2e-3, 2e-3, 1e-2, 2e-2, 2e-2, 5e-3))
        .map(|sd| sd * sd);
    let add = |filter: &mut Filter, points: &[Vector3<f64>]| {
        filter.add_points(points, &noise, &shared, &pose)
    };
    let snapshot = filter.snapshot();
    assert!(
        add(&mut filter, &corners[..3]).is_err(),
        "lists of two lengths"
    );
    assert!(filter.snapshot() == snapshot);
    let mut fresh = Filter::new(Settings::default(), camera.clone(), None);
    add(&mut fresh, &corners).expect("a target");
    assert!(fresh.started());
    let ids = add(&mut filter, &corners).expect("a target");
    assert_eq!(ids.len(), 4);
    // The camera moves sideways, and all points are seen where they are.
    let landmarks = filter.landmarks();
    for k in 1..=30 {
        let t = 0.1 * f64::from(k);
        filter.predict(t).unwrap();
        let centre = Vector3::new(0.02 * f64::from(k), 0.0, 0.0);
        let bearings = landmarks.iter().filter_map(|l| {
            let uv = camera.project(&(l.point - centre))?;
            Some(ekf_core::Bearing { id: l.id, uv })
        });
        let z = ekf_core::Measurements {
            bearings: bearings.collect(),
            ..Default::default()
        };
        filter.update(&z).unwrap();
    }
    let after = filter.scale_sd().expect("a map");
    assert!(after < 0.3 * before, "{before} {after}");
}
