//! The relative standard deviation of the scale.

use crate::scene::{normal, rng};
use crate::update::with_clone;
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
        .start_from_points(&points, &noise, &shared, &covariance)
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
