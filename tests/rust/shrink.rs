//! Features that become points: nothing changes by it but the number of numbers.

use crate::scene::{Warm, warm};
use ekf_core::Filter;
use ekf_core::observe::{FeatureState, Form};
use ekf_core::settings::Value;
use ekf_core::state::{Block, BlockKind, State};
use nalgebra::{DMatrix, DVector, Matrix3, Matrix6, Vector3, Vector6};

const POINT: BlockKind = BlockKind::Feature(Form::Point);

fn shrinking(seed: u64, index: f64) -> Warm {
    warm(seed, &[("map.linearity_index", Value::Float(index))])
}

fn points(filter: &Filter) -> usize {
    filter.state().layout().of_kind(POINT).count()
}

/// The mean with the point of each feature that is one in `after`.
fn mapped(before: &State, after: &State, x: &[f64]) -> DVector<f64> {
    let mut out = x[..13].to_vec();
    for block in before.layout().blocks() {
        let now = after.layout().find(block.id).expect("nothing is deleted");
        if now.kind == block.kind {
            out.extend_from_slice(&x[block.range()]);
        } else {
            let point = block.feature(x).point().expect("in front");
            out.extend_from_slice(point.as_slice());
        }
    }
    DVector::from_vec(out)
}

#[test]
fn mean_and_covariance_are_those_of_the_points() {
    let mut warm = shrinking(61, 0.5);
    warm.filter.add_candidates(&[]).expect("started");
    let before = warm.filter.state().clone();
    let pixels = warm.filter.predict_pixels();
    let landmarks = warm.filter.landmarks();
    assert!(warm.filter.manage_map().is_empty());
    let after = warm.filter.state();
    let shrunk = points(&warm.filter);
    let all = after.layout().features().count();
    assert!(shrunk > 3 && shrunk < all, "{shrunk} of {all}");
    assert_eq!(before.mean().len() - after.mean().len(), 3 * shrunk);
    let x = before.mean();
    let off = DVector::from_column_slice(after.mean()) - mapped(&before, after, x);
    assert_eq!(off.abs().max(), 0.0);
    // To first order, by differences.
    let columns = (0..x.len()).map(|i| {
        let h = 1e-6 * (1.0 + x[i].abs());
        let at = |by: f64| {
            let mut x = x.to_vec();
            x[i] += by;
            mapped(&before, after, &x)
        };
        (at(h) - at(-h)) / (2.0 * h)
    });
    let j = DMatrix::from_columns(&columns.collect::<Vec<_>>());
    let expected = &j * before.covariance().to_dense() * j.transpose();
    let p = after.covariance().to_dense();
    for a in 0..p.nrows() {
        for b in 0..p.nrows() {
            let scale = (p[(a, a)] * p[(b, b)]).sqrt();
            let off = (p[(a, b)] - expected[(a, b)]).abs();
            assert!(off <= 1e-7 * scale + 1e-14, "{a} {b}: {off:e} of {scale:e}");
        }
    }
    // What is predicted of them is what it was.
    for (a, b) in warm.filter.predict_pixels().iter().zip(&pixels) {
        assert!(a.id == b.id && (a.uv - b.uv).norm() < 1e-9);
        assert!((a.s - b.s).norm() < 1e-9 * b.s.norm());
        assert!((a.rho_sd - b.rho_sd).abs() < 1e-9 * b.rho_sd);
    }
    for (a, b) in warm.filter.landmarks().iter().zip(&landmarks) {
        assert!(a.id == b.id && (a.point - b.point).norm() < 1e-12);
        assert!((a.covariance - b.covariance).norm() < 1e-9 * b.covariance.norm());
        assert!(a.rho_ratio > 0.0 && a.rho_ratio < 0.2);
    }
    warm.filter.check().expect("sound");
}

#[test]
fn the_index_is_that_of_its_source() {
    // Seen from the anchor, 2 m before it: L = 4 sigma_d / d.
    let y = FeatureState::InverseDepth(Vector6::new(0.0, 0.0, 0.0, 0.0, 0.0, 0.5));
    let mut covariance = Matrix6::zeros();
    covariance[(5, 5)] = 0.01_f64.powi(2);
    let sigma = 0.01 / 0.25;
    let index = |y: &FeatureState, r: Vector3<f64>| y.linearity_index(&covariance, &r);
    let at_anchor = index(&y, Vector3::zeros()).expect("a point");
    assert!((at_anchor - 4.0 * sigma / 2.0).abs() < 1e-12);
    // From the side the depth is seen as it is.
    let aside = index(&y, Vector3::new(2.0, 0.0, 2.0)).expect("a point");
    assert!(aside < 1e-12);
    let oblique = index(&y, Vector3::new(2.0, 0.0, 0.0)).expect("a point");
    let expected = 4.0 * sigma * std::f64::consts::FRAC_1_SQRT_2 / 8f64.sqrt();
    assert!((oblique - expected).abs() < 1e-12);
    assert_eq!(
        index(&FeatureState::Point(Vector3::z()), Vector3::zeros()),
        None
    );
    assert_eq!(index(&y, Vector3::new(0.0, 0.0, 2.0)), None);
}

/// A run of 60 frames with the worn camera in some; the errors of the position, and the filter.
fn run(index: f64) -> (Vec<Vector3<f64>>, Warm) {
    let mut warm = shrinking(62, index);
    let mut positions = Vec::new();
    for frame in 0..60 {
        warm.update(frame % 10 < 2);
        let gone = warm.filter.manage_map();
        warm.known.retain(|id, _| !gone.contains(id));
        warm.filter.check().expect("sound");
        positions.push(warm.filter.pose().1);
        warm.next_frame();
    }
    (positions, warm)
}

#[test]
fn a_run_with_points_agrees_with_one_without() {
    let (plain, without) = run(0.0);
    let (shrunk, with) = run(0.1);
    assert_eq!(points(&without.filter), 0);
    let (all, few) = (with.filter.map_size(), points(&with.filter));
    assert!(2 * few > all, "{few} points of {all}");
    let rows = |w: &Warm| w.filter.state().mean().len();
    assert!(rows(&with) < rows(&without));
    let sd: Matrix3<f64> = without
        .filter
        .pose_covariance()
        .fixed_view::<3, 3>(0, 0)
        .into();
    let sd = sd.trace().sqrt();
    let apart = plain.iter().zip(&shrunk).map(|(a, b)| (a - b).norm());
    let apart = apart.fold(0.0, f64::max);
    println!("{apart:.2e} m apart at most, {sd:.2e} m standard deviation, {few} points of {all}");
    assert!(apart > 0.0 && apart < 0.2 * sd, "{apart:e} m, {sd:e} m");
}

#[test]
fn points_go_over_into_another_filter() {
    let (_, first) = run(0.1);
    let (ids, map) = first.filter.known_map();
    let changes = [("map.linearity_index", Value::Float(0.1))];
    let mut second = first.scene.filter(crate::scene::settings(&changes));
    let there = second.start_from_map(&map).expect("a map");
    assert_eq!(ids.len(), there.len());
    let (a, b) = (first.filter.landmarks(), second.landmarks());
    for (a, b) in a.iter().zip(&b) {
        assert!((a.point - b.point).norm() < 1e-12);
        assert!((a.covariance - b.covariance).norm() < 1e-12 * a.covariance.norm());
    }
    let joint = |f: &Filter, blocks: [&Block; 2]| {
        let [a, b] = blocks.map(|b| f.state().feature(b).point_jacobian());
        let p = f
            .state()
            .covariance()
            .block::<3, 3>(blocks[0].offset, blocks[1].offset);
        a.fixed_view::<3, 3>(0, 0) * p * b.fixed_view::<3, 3>(0, 0).transpose()
    };
    let pair = |f: &Filter| {
        let found: Vec<Block> = f.state().layout().features().copied().collect();
        let chosen: Vec<usize> = (0..found.len())
            .filter(|&k| first.filter.state().layout().find(ids[k]).unwrap().kind == POINT)
            .collect();
        joint(f, [&found[chosen[0]], &found[chosen[1]]])
    };
    let (a, b) = (pair(&first.filter), pair(&second));
    assert!((a - b).norm() < 1e-12 * a.norm());
}
