//! Upkeep of the map: which features go.

use crate::scene::{Warm, warm};
use ekf_core::settings::Value;
use ekf_core::{Bearing, DepthObservation, MeasurementOutcome, Measurements};

/// A feature must be found in 40 % of its searches, once there were eight (METHOD 7).
const MIN_SEARCHES: usize = 8;

/// Whether upkeep deletes a feature that was searched so often after its birth, and found the first times.
fn is_deleted(searched: usize, found: usize) -> bool {
    let mut warm = warm(71, &[]);
    let seen = |warm: &mut Warm, point: usize| {
        let pose = warm.scene.pose(warm.t);
        let uv = warm.scene.pixel(&pose, point);
        (
            uv.expect("in view"),
            pose.inverse().apply(&warm.scene.points[point]).z,
        )
    };
    let taken: Vec<usize> = warm.known.values().copied().collect();
    let pose = warm.scene.pose(warm.t);
    let new = (0..warm.scene.points.len())
        .find(|point| !taken.contains(point) && warm.scene.pixel(&pose, *point).is_some());
    let point = new.unwrap_or(taken[0]);
    let (uv, depth) = seen(&mut warm, point);
    let birth = DepthObservation {
        id: None,
        uv,
        depth,
        sigma: 0.1,
    };
    let z = Measurements {
        depths: vec![birth],
        ..Measurements::default()
    };
    let report = warm.filter.update(&z).expect("good measurements");
    let MeasurementOutcome::Born(id) = report.depths[0] else {
        panic!("not born: {report:?}");
    };
    for round in 0..searched {
        warm.next_frame();
        let (uv, _) = seen(&mut warm, point);
        let z = Measurements {
            searched: vec![id],
            bearings: (round < found)
                .then_some(Bearing { id, uv })
                .into_iter()
                .collect(),
            ..Measurements::default()
        };
        let report = warm.filter.update(&z).expect("good measurements");
        assert_eq!(
            report.inliers().filter(|inlier| *inlier).count(),
            usize::from(round < found)
        );
    }
    let gone = warm.filter.manage_map(&[]);
    let deleted = warm.filter.state().layout().find(id).is_none();
    assert_eq!(gone, if deleted { vec![id] } else { vec![] });
    deleted
}

#[test]
fn a_feature_that_is_searched_in_vain_is_deleted() {
    assert!(is_deleted(MIN_SEARCHES, 3));
    assert!(!is_deleted(MIN_SEARCHES, 4));
    assert!(!is_deleted(MIN_SEARCHES - 1, 0));
    assert!(is_deleted(MIN_SEARCHES, 0));
}

#[test]
fn of_too_many_features_the_longest_unseen_go_but_those_to_keep() {
    let few = ("map.max_features", Value::Int(8));
    let mut warm = warm(72, &[few]);
    let all: Vec<u64> = warm.known.keys().copied().collect();
    assert!(all.len() > 9, "{} features", all.len());
    let mut plain = warm.filter.clone();
    let gone = plain.manage_map(&[]);
    assert_eq!(gone.len(), all.len() - 8);
    let kept = warm.filter.manage_map(&gone[..1]);
    assert_eq!(kept, gone[1..], "what is kept does not count");
    warm.filter.check().expect("sound");
}
