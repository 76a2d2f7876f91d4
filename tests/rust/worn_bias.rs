//! The lasting part of T_CF's error between two overlaps (METHOD 6): it forgets, and is as large as before.

use crate::scene::name;
use crate::update::{measure, with_clone};
use ekf_core::Filter;
use ekf_core::settings::Value;
use ekf_core::state::{BlockKind, Whose};
use nalgebra::{DMatrix, SMatrix};

/// Covariance of the bias, and its cross-covariance with the map.
fn of_bias(filter: &Filter) -> (SMatrix<f64, 6, 6>, DMatrix<f64>) {
    let state = filter.state();
    let block = state
        .layout()
        .of_kind(BlockKind::WornBias(Whose::Of(0)))
        .next()
        .copied();
    let at = block.expect("a bias").offset;
    let p = state.covariance();
    let map: Vec<usize> = state.layout().features().flat_map(|b| b.range()).collect();
    let cross = DMatrix::from_fn(6, map.len(), |i, j| p.get(at + i, map[j]));
    (p.block::<6, 6>(at, at), cross)
}

#[test]
fn what_decays_of_the_bias_is_replaced_by_fresh_noise() {
    let time = 20.0;
    let changes = [
        ("estimator.mode", name("collab-tight")),
        ("worn.bias_share", Value::Float(0.6)),
        ("worn.bias_time", Value::Float(time)),
    ];
    let mut warm = with_clone(5, &changes);
    let z = measure(&mut warm, true);
    warm.filter.update(&z).expect("good measurements");
    let (before, shared) = of_bias(&warm.filter);
    let dt = 5.0;
    warm.filter.predict(warm.t + dt).expect("time goes on");
    let (after, kept) = of_bias(&warm.filter);
    let off = (after - before).abs().max();
    assert!(
        off < 1e-12 * before.max(),
        "its covariance is off by {off:e}"
    );
    // What the map has of the old error has less and less to do with the new one.
    let forgotten = (-dt / time).exp();
    assert!(shared.abs().max() > 0.0, "the map holds some of it");
    let off = (kept - &shared * forgotten).abs().max();
    assert!(
        off < 1e-12 * shared.abs().max(),
        "its share is off by {off:e}"
    );
}
