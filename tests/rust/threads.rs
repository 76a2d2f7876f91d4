//! Filters in several threads at once.

use crate::scene::{DT, Scene, adopt, settings};
use ekf_core::Filter;
use ekf_core::settings::Value;
use std::collections::BTreeMap;

/// A filter after some frames of its own scene.
fn run(seed: u64, local: bool) -> Filter {
    let mut scene = Scene::new(seed, 40);
    let mut filter = scene.filter(settings(&[(
        "map.local_from",
        Value::Int(if local { 0 } else { 1_000_000 }),
    )]));
    let mut known = BTreeMap::new();
    for frame in 0..60 {
        let t = DT * f64::from(frame);
        filter.predict(t).expect("later stamp");
        let (z, points) = scene.measure(t, &known, frame % 10 == 0);
        let report = filter.update(&z).expect("good measurements");
        adopt(&mut known, &report, &points);
        for id in filter.manage_map(&[]) {
            known.remove(&id);
        }
    }
    assert!(filter.started() && known.len() > 10);
    filter
}

#[test]
fn two_threads_run_two_filters_as_one_does() {
    let alone = [run(71, false), run(72, true)];
    let together = std::thread::scope(|threads| {
        let a = threads.spawn(|| run(71, false));
        let b = threads.spawn(|| run(72, true));
        [a, b].map(|thread| thread.join().expect("no panic"))
    });
    for (alone, together) in alone.iter().zip(&together) {
        let (a, b) = (alone.state(), together.state());
        assert_eq!(a.mean(), b.mean());
        assert_eq!(a.covariance().to_dense(), b.covariance().to_dense());
    }
    assert_ne!(alone[0].state().mean(), alone[1].state().mean());
}
