//! What lasts of errors, beside P (METHOD 20): told, and never believed.

use crate::filter::map::map_drift::give_birth;
use crate::filter::update::{Dense, measure, units};
use crate::local::Pair;
use crate::scene::{Warm, name, warm};
use ekf_core::settings::Value;
use ekf_core::state::BlockKind;
use ekf_core::{Filter, UpdateReport};
use nalgebra::DMatrix;

/// Two cameras that see the same; in the map of the first one something lasts, in that of the second all errors are white.
fn pair(seed: u64, frames: usize, changes: &[(&str, Value)]) -> [Warm; 2] {
    let mut pair = [10.0, 0.0].map(|drift| {
        let mut all = vec![("process.map_drift", Value::Float(drift))];
        all.extend_from_slice(changes);
        warm(seed, &all)
    });
    pair.iter_mut().for_each(give_birth);
    for _ in 0..frames {
        pair.iter_mut().for_each(Warm::next_frame);
        pair.iter_mut().for_each(|warm| warm.update(false));
    }
    pair
}

fn covariance(filter: &Filter) -> DMatrix<f64> {
    filter.state().covariance().to_dense()
}

/// Covariance of what lasts.
fn time_correlated([time_correlated, white]: &[Warm; 2]) -> DMatrix<f64> {
    covariance(&time_correlated.filter) - covariance(&white.filter)
}

#[test]
fn the_estimate_does_not_know_of_it() {
    for consistency in ["gauge", "none"] {
        let pair = pair(7, 60, &[("estimator.consistency", name(consistency))]);
        let [lasts, white] = &pair;
        let [a, b] = [lasts, white].map(|warm| warm.filter.state().mean());
        let p = covariance(&white.filter);
        for i in 0..a.len() {
            // The order of some sums is another one, with more rows.
            let off = (a[i] - b[i]).abs();
            assert!(off <= 1e-9 * p[(i, i)].sqrt(), "mean {i} is off by {off:e}");
        }
        assert!(
            lasts.filter.state().layout().blocks() == white.filter.state().layout().blocks(),
            "the state that is shown has no error modes"
        );
        let more = time_correlated(&pair);
        let least = more.clone().symmetric_eigenvalues().min();
        assert!(least > -1e-12 * more.trace(), "{least:e}");
        assert!(more.trace() > 1e-3 * covariance(&white.filter).trace());
        lasts.filter.check().expect("sound");
    }
}

/// `L <- (1 - K H) L (1 - K H)^T`, with the gain of the filter whose errors are white.
#[test]
fn an_update_leaves_what_the_gain_leaves() {
    let changes = [
        ("validate.test", name("none")),
        ("estimator.consistency", name("none")),
    ];
    let mut pair = pair(7, 60, &changes);
    pair.iter_mut().for_each(Warm::next_frame);
    let [before, white] = [&pair[0], &pair[1]].map(|warm| warm.filter.clone());
    let mut expected = Dense::of(&white, None);
    let mut remains = expected.clone();
    remains.p = time_correlated(&pair);
    let measured = pair.each_mut().map(|warm| measure(warm, false));
    let pixels = measured
        .each_ref()
        .map(|z| z.bearings.iter().map(|b| b.uv).collect::<Vec<_>>());
    assert_eq!(pixels[0], pixels[1]);
    let reports: Vec<UpdateReport> = pair
        .iter_mut()
        .zip(&measured)
        .map(|(warm, z)| warm.filter.update(z).expect("good measurements"))
        .collect();
    let rows = units(&pair[1], &white, &expected, &measured[1], &reports[1]);
    assert!(rows.len() > 8, "{}", rows.len());
    let left = expected.update(&rows);
    remains.p = &left * &remains.p * left.transpose();
    remains.x = expected.x.clone();
    let clones = white.state().layout().of_kind(BlockKind::Clone);
    let quaternions: Vec<usize> = clones.map(|b| b.offset + 3).chain([3]).collect();
    remains.normalise(&quaternions);
    let (found, prior) = (time_correlated(&pair), covariance(&before));
    let mut largest: f64 = 0.0;
    for i in 0..found.nrows() {
        for j in 0..found.nrows() {
            let scale = (prior[(i, i)] * prior[(j, j)]).sqrt().max(1e-30);
            let off = (found[(i, j)] - remains.p[(i, j)]).abs() / scale;
            assert!(off < 1e-9, "[{i},{j}] is off by {off:e}");
            largest = largest.max(found[(i, j)].abs() / scale);
        }
    }
    assert!(largest > 1e-3, "something lasts: {largest:e}");
}

/// In a local update, through which features come and go, it is what the whole update makes of it, to rounding: as long as there
/// is room for all error modes. Which of them stay after that hangs on what is inside.
#[test]
fn a_local_update_carries_it_along() {
    const ROOM_UNTIL: usize = 41;
    let mut pair = Pair::new(31, 120, "gauge", 10.0);
    for frame in 0..ROOM_UNTIL {
        pair.step(frame);
    }
    let apart = pair.difference();
    assert!(apart > 0.0, "the local update was at work");
    assert!(apart < 1e-8, "{apart:e}");
    for frame in ROOM_UNTIL..120 {
        pair.step(frame);
        pair.local.check().expect("sound");
    }
}
