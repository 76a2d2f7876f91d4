//! A filter that goes back to a checkpoint is what it was, bit for bit, and goes on as if nothing had been undone.

use crate::local::Pair;
use crate::scene::{Warm, warm};
use ekf_core::{EkfError, Filter};
use nalgebra::{Matrix3, Vector2};
use std::collections::BTreeMap;

/// A frame with all that a frame may do.
fn frame(warm: &mut Warm, k: usize) {
    warm.next_frame();
    warm.update(k.is_multiple_of(3));
    let pixels: Vec<_> = (0..4)
        .map(|i| Vector2::new(100.0 + 90.0 * i as f64, 50.0 + 40.0 * k as f64))
        .collect();
    let ids = warm.filter.add_candidates(&pixels).unwrap();
    if k % 4 == 2 {
        warm.filter.promote_candidates(&ids[..1], false).unwrap();
        warm.filter.drop_candidates(&ids[1..2]);
        let gone = *warm.known.keys().next().unwrap();
        warm.filter.remove_features(&[gone]).unwrap();
        warm.known.remove(&gone);
    }
    if k % 3 == 1 {
        let seen: Vec<u64> = warm.known.keys().copied().collect();
        warm.filter.end_submap(&seen).unwrap();
    }
    for id in warm.filter.manage_map(&[]) {
        warm.known.remove(&id);
    }
}

#[test]
fn every_call_of_a_frame_is_undone() {
    let (mut undone, mut straight) = (warm(71, &[]), warm(71, &[]));
    for k in 0..12 {
        let before = undone.filter.snapshot();
        undone.filter.checkpoint();
        let mut ahead = warm(71, &[]);
        for j in 0..k {
            frame(&mut ahead, j);
        }
        // The same frame on the filter that will go back; scene and ids are another's.
        std::mem::swap(&mut ahead.filter, &mut undone.filter);
        frame(&mut ahead, k);
        std::mem::swap(&mut ahead.filter, &mut undone.filter);
        assert_ne!(undone.filter.snapshot(), before);
        for _ in 0..2 {
            undone.filter.rollback().unwrap();
            assert_eq!(undone.filter.snapshot(), before, "frame {k}");
        }
        frame(&mut undone, k);
        frame(&mut straight, k);
        assert_eq!(undone.filter.snapshot(), straight.filter.snapshot());
    }
}

#[test]
fn a_restart_and_a_relocalisation_are_undone() {
    let mut warm = warm(72, &[]);
    warm.update(false);
    let (_, old) = warm.filter.known_map();
    warm.t += 1.0;
    warm.filter.predict(warm.t).unwrap();
    let before = warm.filter.snapshot();
    warm.filter.checkpoint();
    let (z, _) = warm.scene.measure(warm.t, &BTreeMap::new(), true);
    assert!(
        warm.filter
            .restart(&z.views[0], &Matrix3::zeros())
            .unwrap()
            .accepted
    );
    warm.filter.rollback().unwrap();
    assert_eq!(warm.filter.snapshot(), before);
    let (z, _) = warm.scene.measure(warm.t, &warm.known, false);
    let truth = warm.scene.pose(warm.t);
    assert!(
        warm.filter
            .relocalise(&truth, &z.bearings, None, false)
            .unwrap()
            .accepted
    );
    assert_ne!(warm.filter.snapshot(), before);
    warm.filter.rollback().unwrap();
    assert_eq!(warm.filter.snapshot(), before);
    assert!(!old.landmarks.is_empty());
}

#[test]
fn without_a_checkpoint_there_is_no_way_back() {
    let mut warm = warm(73, &[]);
    let refused = |filter: &mut Filter| {
        let error = filter.rollback().unwrap_err();
        assert!(matches!(
            error,
            EkfError::InvalidInput {
                what: "rollback",
                ..
            }
        ));
    };
    refused(&mut warm.filter);
    warm.filter.checkpoint();
    refused(&mut warm.filter.clone());
    warm.filter.rollback().unwrap();
}

/// The working set changes in frames that are undone; what is outside of it is the checkpoint's again.
#[test]
fn the_working_set_of_before_is_there_again() {
    let (mut undone, mut straight) = (
        Pair::new(74, 150, "gauge", 10.0),
        Pair::new(74, 150, "gauge", 10.0),
    );
    for k in 0..90 {
        let before = undone.local.snapshot();
        let plain = undone.plain.clone();
        let (known, rng, t) = (undone.known.clone(), undone.rng.clone(), undone.t);
        undone.local.checkpoint();
        undone.step(k);
        assert_ne!(undone.local.snapshot(), before);
        undone.local.rollback().unwrap();
        assert_eq!(undone.local.snapshot(), before, "frame {k}");
        (undone.known, undone.rng, undone.t, undone.plain) = (known, rng, t, plain);
        undone.step(k);
        straight.step(k);
    }
    assert_eq!(undone.local.snapshot(), straight.local.snapshot());
}
