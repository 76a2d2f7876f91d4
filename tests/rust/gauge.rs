//! The covariance that moves with the estimate: what no camera can see stays unseen.

use crate::filter::update::{Dense, measure, quaternions, units, with_clone};
use crate::local::Pair;
use crate::scene::{Scene, name};
use ekf_core::gauge::{GAUGES, coordinates, directions};
use ekf_core::math::quat::Quat;
use ekf_core::observe::{PointInCamera, Rows};
use ekf_core::predict::{process_noise, transition};
use ekf_core::settings::Value;
use ekf_core::{Filter, Settings};
use nalgebra::{DMatrix, DVector, Matrix3, Vector2};
use std::collections::BTreeMap;

/// Nothing rejected, so that the dense filter sees the same rows.
fn settings() -> [(&'static str, Value); 2] {
    [
        ("validate.test", name("none")),
        ("estimator.consistency", name("gauge")),
    ]
}

fn gauge_directions(filter: &Filter, x: &[f64]) -> DMatrix<f64> {
    let mut out = Vec::new();
    directions(x, filter.state().layout(), &mut out);
    DMatrix::from_vec(x.len(), GAUGES, out)
}

fn gauge_coordinates(filter: &Filter) -> DMatrix<f64> {
    let (state, mut out) = (filter.state(), Vec::new());
    let among = filter.followed();
    coordinates(
        state.mean(),
        state.layout(),
        state.covariance(),
        among,
        &mut out,
    );
    DMatrix::from_vec(state.mean().len(), GAUGES, out)
}

/// Rows times a vector of the state's length.
fn times(rows: &Rows, feature: usize, v: &DVector<f64>) -> DVector<f64> {
    DVector::from_fn(rows.count, |r, _| {
        let pose: f64 = (0..7).map(|c| rows.by_pose[(r, c)] * v[c]).sum();
        let point: f64 = (0..6)
            .map(|c| rows.by_feature[(r, c)] * v[feature + c])
            .sum();
        pose + point
    })
}

#[test]
fn directions_turn_and_scale_the_map() {
    let warm = with_clone(51, &[]);
    let state = warm.filter.state();
    let n = gauge_directions(&warm.filter, state.mean());
    for block in state.layout().features() {
        let feature = state.feature(block);
        let point = feature.point().expect("in front");
        let moves = feature.point_jacobian() * n.fixed_view::<6, GAUGES>(block.offset, 0);
        for k in 0..3 {
            let axis = Matrix3::identity().column(k).into_owned();
            let off = (moves.column(k) - axis.cross(&point)).norm();
            assert!(off < 1e-9 * point.norm(), "turn {k} is off by {off:e}");
        }
        let off = (moves.column(3) - point).norm();
        assert!(off < 1e-9 * point.norm(), "scale is off by {off:e}");
    }
}

#[test]
fn coordinates_are_dual_to_the_directions() {
    let warm = with_clone(52, &[]);
    let n = gauge_directions(&warm.filter, warm.filter.state().mean());
    let product = gauge_coordinates(&warm.filter).tr_mul(&n);
    let off = (product - DMatrix::identity(GAUGES, GAUGES)).abs().max();
    assert!(off < 1e-12, "B^T N is off by {off:e}");
}

#[test]
fn no_bearing_sees_the_gauge_after_the_update_either() {
    let mut warm = with_clone(53, &settings());
    let z = measure(&mut warm, false);
    let before = warm.filter.clone();
    let dense = Dense::of(&before, None);
    let report = warm.filter.update(&z).expect("good measurements");
    let (old, new) = (
        gauge_directions(&before, before.state().mean()),
        gauge_directions(&before, warm.filter.state().mean()),
    );
    let carried = &old + (&new - &old) * gauge_coordinates(&before).tr_mul(&old);
    let mut stale: f64 = 0.0;
    for (rows, feature, _) in units(&warm, &warm.filter, &dense, &z, &report) {
        for k in 0..GAUGES {
            let sigma = rows.noise[(0, 0)].sqrt();
            let seen = times(&rows, feature, &carried.column(k).into_owned()).norm() / sigma;
            assert!(
                seen < 1e-9 * rows.by_pose.norm(),
                "gauge {k} shows: {seen:e}"
            );
            stale = stale.max(times(&rows, feature, &old.column(k).into_owned()).norm() / sigma);
        }
    }
    assert!(
        stale > 1.0,
        "directions of the old mean should show, {stale}"
    );
}

#[test]
fn a_depth_sees_the_scale() {
    let warm = with_clone(54, &[]);
    let state = warm.filter.state();
    let n = gauge_directions(&warm.filter, state.mean());
    let (pose, block) = (
        state.camera_pose(),
        state.layout().features().next().expect("map"),
    );
    let feature = state.feature(block);
    let point = PointInCamera::metric(&pose, &feature)
        .expect("in front")
        .value;
    let rows = Rows::depth(&pose, &feature, &point, &Matrix3::identity(), None).expect("in front");
    for k in 0..3 {
        let seen = times(&rows, block.offset, &n.column(k).into_owned()).norm();
        assert!(seen < 1e-9, "turn {k} shows: {seen:e}");
    }
    let seen = times(&rows, block.offset, &n.column(3).into_owned());
    assert!((seen - DVector::from_column_slice(point.as_slice())).norm() < 1e-9);
}

/// Inverse depths in view as the lengths of the map move, of what a step holds along the scale.
fn keep_shape(before: &Filter, prior: &DVector<f64>, x: &mut DVector<f64>) {
    let step = &*x - prior;
    let all = gauge_coordinates(before).column(3).dot(&step);
    assert!(all.abs() > 1e-6, "the scale is corrected");
    for id in before.followed() {
        let rho = before.state().layout().find(*id).expect("in view").offset + 5;
        let own = -step[rho] / prior[rho];
        let growth = if own * all <= 0.0 {
            0.0
        } else {
            own.abs().min(all.abs()) * all.signum()
        };
        x[rho] = prior[rho] / (1.0 + growth) + step[rho] + growth * prior[rho];
    }
}

#[test]
fn the_update_agrees_with_a_dense_transport() {
    let mut warm = with_clone(55, &settings());
    let z = measure(&mut warm, false);
    let before = warm.filter.clone();
    let mut dense = Dense::of(&before, None);
    let report = warm.filter.update(&z).expect("good measurements");
    assert!(report.dof >= 16);
    let units = units(&warm, &before, &dense, &z, &report);
    let from = gauge_directions(&before, dense.x.as_slice());
    let prior = dense.x.clone();
    dense.update(&units);
    keep_shape(&before, &prior, &mut dense.x);
    let to = gauge_directions(&before, dense.x.as_slice());
    let n = dense.x.len();
    let plain = dense.p.clone();
    let t = DMatrix::identity(n, n) + (to - from) * gauge_coordinates(&before).transpose();
    dense.p = &t * &dense.p * t.transpose();
    assert!(
        (&dense.p - plain).abs().max() > 1e-6,
        "the transport does something"
    );
    dense.normalise(&quaternions(&before));
    dense.compare(&warm.filter, &before);
}

/// A feature that comes back brings rows of P that are still along the directions of the mean at which it left.
#[test]
fn what_comes_back_into_view_is_carried_to_the_present_mean() {
    let mut pair = Pair::new(57, 60, "gauge", 0.0);
    // The mean of each feature when it was last in view and carried.
    let mut carried: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    let mut tested = 0;
    for frame in 0..170 {
        let before = pair.plain.clone();
        if frame > 0 && tested < 3 {
            let mut after = before.clone();
            after.predict(frame as f64 * 0.1).expect("time goes on");
            let new = |id: &&u64| before.followed().binary_search(id).is_err();
            let back: Vec<u64> = after.followed().iter().filter(new).copied().collect();
            if back.iter().any(|id| carried.contains_key(id)) {
                carried_back(&before, &after, &back, &carried);
                tested += 1;
            }
        }
        pair.step(frame);
        let state = pair.plain.state();
        for id in pair.plain.followed() {
            if let Some(block) = state.layout().find(*id) {
                carried.insert(*id, state.mean()[block.range()].to_vec());
            }
        }
    }
    assert_eq!(tested, 3, "a whole turn brings some back");
}

/// The prediction `after`, against `T P T^T` of the plain prediction of `before`.
fn carried_back(before: &Filter, after: &Filter, back: &[u64], carried: &BTreeMap<u64, Vec<f64>>) {
    let (layout, settings) = (before.state().layout(), before.settings());
    let n = before.state().mean().len();
    let mut x = before.state().mean().to_vec();
    let dt = after.time().expect("predicted") - before.time().expect("started");
    let own = transition(&mut x, dt, settings.process.velocity);
    let q = Quat::from_column_slice(&x[3..7]);
    let mut f = DMatrix::identity(n, n);
    f.view_mut((0, 0), (13, 13)).copy_from(&own);
    let mut dense = Dense::of(before, None);
    dense.p = &f * dense.p * f.transpose();
    let mut camera = dense.p.view_mut((0, 0), (13, 13));
    camera += process_noise(&q, dt, &settings.process);
    dense.x = DVector::from_vec(x);
    dense.normalise(&[3]);
    // Everything is along the present directions but what comes back.
    let mut reference = dense.x.clone();
    let blocks = layout
        .features()
        .filter(|block| carried.contains_key(&block.id));
    for block in blocks {
        let mean = DVector::from_column_slice(&carried[&block.id]);
        reference
            .rows_mut(block.offset, block.range().len())
            .copy_from(&mean);
    }
    let mut b = Vec::new();
    coordinates(
        reference.as_slice(),
        layout,
        before.state().covariance(),
        before.followed(),
        &mut b,
    );
    let b = DMatrix::from_vec(n, GAUGES, b);
    let all = gauge_directions(before, dense.x.as_slice())
        - gauge_directions(before, reference.as_slice());
    let mut d = DMatrix::zeros(n, GAUGES);
    for block in layout.features().filter(|block| back.contains(&block.id)) {
        let rows = all.rows(block.offset, block.range().len());
        d.rows_mut(block.offset, block.range().len())
            .copy_from(&rows);
    }
    let t = DMatrix::identity(n, n) + d * b.transpose();
    let plain = std::mem::replace(&mut dense.p, DMatrix::zeros(0, 0));
    dense.p = &t * &plain * t.transpose();
    dense.compare(after, after);
    let sd = |i: usize| plain[(i, i)].sqrt().max(1e-15);
    let moved = (0..n).flat_map(|i| (0..i).map(move |j| (i, j)));
    let moved = moved.map(|(i, j)| (dense.p[(i, j)] - plain[(i, j)]).abs() / (sd(i) * sd(j)));
    assert!(
        moved.fold(0.0, f64::max) > 1e-4,
        "the transport does something"
    );
}

#[test]
fn without_a_converged_depth_there_is_no_coordinate_of_scale() {
    let mut filter = Scene::new(56, 4).filter(Settings::default());
    filter.predict(0.0).expect("first frame");
    let pixels = [Vector2::new(300.0, 200.0), Vector2::new(420.0, 260.0)];
    let born = filter.add_undelayed(&pixels).expect("finite");
    assert!(born.iter().all(Option::is_some));
    let b = gauge_coordinates(&filter);
    assert_eq!(b.column(3).norm(), 0.0);
    assert!(b.columns(0, 3).norm() > 1.0);
}
