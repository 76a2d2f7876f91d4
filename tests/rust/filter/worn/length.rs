//! The lengths of T_CF (METHOD 6): no device knows its scale better than to some per cent, and a length that has changed is in doubt;
//! both are told, and leave the estimate alone.

use crate::scene::{DT, Scene, adopt, settings, worn_covariance};
use ekf_core::Filter;
use ekf_core::settings::Value;
use ekf_core::state::{Block, BlockKind};
use nalgebra::Matrix6;
use std::collections::BTreeMap;

/// What a way of ten seconds ends with, a view in each frame, nothing of whose error is said to last.
struct End {
    filter: Filter,
    /// Logarithm of the way's length over the true one.
    scale: f64,
    /// Squared Mahalanobis distance of the position, of three degrees of freedom.
    distance: f64,
}

/// T_CF is `factor` times as long from a frame on, as is doubted by `doubt` two frames later; each view says that nothing lasts.
fn way(seed: u64, length_sd: f64, change: (u32, f64), doubt: f64) -> End {
    way_said(seed, length_sd, change, doubt, Some(Matrix6::zeros()))
}

/// The same with what each view says that lasts; the setting says that nothing does.
fn way_said(
    seed: u64,
    length_sd: f64,
    (from, factor): (u32, f64),
    doubt: f64,
    bias: Option<Matrix6<f64>>,
) -> End {
    let mut scene = Scene::new(seed, 40);
    scene.worn_covariance = worn_covariance() * 0.01;
    let changes = [("worn.length_sd", length_sd), ("process.map_drift", 0.0)];
    let mut filter = scene.filter(settings(
        &changes.map(|(name, sd)| (name, Value::Float(sd))),
    ));
    let mut known = BTreeMap::new();
    let mut t = 0.0;
    for k in 0..100 {
        t = DT * f64::from(k);
        filter.predict(t).expect("increasing time");
        if k == from + 2 && doubt > 0.0 {
            filter.doubt_length(0, doubt).expect("a worn camera");
        }
        let (mut z, points) = scene.measure(t, &known, true);
        let worn = &mut z.views[0];
        worn.bias = bias;
        if k >= from {
            worn.t_cf.translation *= factor;
        }
        let report = filter.update(&z).expect("good measurements");
        adopt(&mut known, &report, &points);
        for id in filter.manage_map(&[]) {
            known.remove(&id);
        }
    }
    filter.check().expect("sound");
    let truth = scene.pose(t).translation;
    let (rotation, r) = filter.pose();
    let off = rotation.transpose() * (truth - r);
    let p = filter
        .pose_covariance()
        .fixed_view::<3, 3>(0, 0)
        .into_owned();
    End {
        scale: (r.norm() / truth.norm()).ln(),
        distance: off.dot(&(p.try_inverse().expect("regular") * off)),
        filter,
    }
}

#[test]
fn what_no_device_knows_is_told_and_leaves_the_estimate_alone() {
    let [without, with] = [0.0, 0.02].map(|sd| way(3, sd, (0, 1.0), 0.0));
    let (exact, told) = (without.filter.pose(), with.filter.pose());
    assert!((exact.1 - told.1).norm() < 1e-9, "another way");
    let sd = |end: &End| end.filter.scale_sd().expect("metric");
    let more = (sd(&with).powi(2) - sd(&without).powi(2)).sqrt();
    assert!((0.018..0.021).contains(&more), "the scale has {more} more");
}

#[test]
fn the_setting_says_that_nothing_lasts_as_the_views_do() {
    let said = [Some(Matrix6::zeros()), None].map(|bias| way_said(3, 0.02, (0, 1.0), 0.0, bias));
    let [by_views, by_setting] = said.map(|end| (end.filter.pose(), end.filter.pose_covariance()));
    assert_eq!(by_views, by_setting);
}

/// Root mean square of the scale's error of eight ways, and mean of the distance.
fn ways(length_sd: f64, change: (u32, f64), doubt: f64) -> (f64, f64) {
    let ends: Vec<End> = (0..8).map(|k| way(k, length_sd, change, doubt)).collect();
    let mean = |of: fn(&End) -> f64| ends.iter().map(of).sum::<f64>() / ends.len() as f64;
    (
        mean(|end| end.scale.powi(2)).sqrt(),
        mean(|end| end.distance),
    )
}

#[test]
fn a_device_with_an_error_of_scale_is_within_what_is_told() {
    let (scale, off) = ways(0.0, (0, 1.04), 0.0);
    assert!((0.03..0.05).contains(&scale), "ways are wrong by {scale}");
    assert!(off > 12.0, "nobody would have told: {off}");
    let (same, within) = ways(0.02, (0, 1.04), 0.0);
    assert!((same - scale).abs() < 1e-6);
    assert!(within < 6.0, "{within}");
}

#[test]
fn lengths_that_change_are_within_what_is_told_once_they_are_doubted() {
    let change = (50, 1.15);
    let (scale, off) = ways(0.0, change, 0.0);
    assert!(scale > 0.02, "ways are wrong by {scale}");
    assert!(off > 60.0, "{off}");
    let (same, within) = ways(0.0, change, 0.14);
    assert!((same - scale).abs() < 1e-6, "{same}");
    assert!(within < 12.0, "{within}");
}

#[test]
fn a_doubt_lasts_and_is_no_less_for_another_one() {
    let mut end = way(5, 0.0, (100, 1.0), 0.0);
    let before = end.filter.scale_sd().expect("metric");
    end.filter.doubt_length(0, 0.2).expect("a worn camera");
    let doubted = end.filter.scale_sd().expect("metric");
    // What is out of view stays as it was.
    assert!((0.18..0.2).contains(&doubted), "{before} {doubted}");
    end.filter.doubt_length(0, 0.1).expect("a worn camera");
    assert_eq!(end.filter.scale_sd(), Some(doubted));
    for (who, sd) in [(3, 0.1), (0, f64::NAN), (0, -0.1), (0, 1.1)] {
        let refused = end.filter.doubt_length(who, sd);
        assert!(refused.is_err(), "{who} {sd}");
    }
    assert_eq!(end.filter.scale_sd(), Some(doubted));
    let bytes = end.filter.snapshot();
    let mut again = Filter::restore(&bytes).expect("a filter");
    again.doubt_length(0, 0.2).expect("a worn camera");
    assert_eq!(
        again.scale_sd(),
        Some(doubted),
        "the snapshot has the doubt"
    );
}

#[test]
fn what_is_shown_after_a_start_is_the_state_after_its_update() {
    let mut scene = Scene::new(3, 40);
    let mut filter = scene.filter(settings(&[("worn.length_sd", Value::Float(0.01))]));
    filter.predict(0.0).expect("a first time");
    let (mut z, _) = scene.measure(0.0, &BTreeMap::new(), true);
    z.views[0].bias = Some(Matrix6::zeros());
    filter.update(&z).expect("good measurements");
    assert!(filter.started() && filter.map_size() > 5);
    let of_one_frame =
        |b: &&Block| matches!(b.kind, BlockKind::WornError(_) | BlockKind::WornRoll(_));
    let shown = filter.state();
    assert_eq!(
        shown.layout().blocks().iter().filter(of_one_frame).count(),
        0
    );
    assert_eq!(shown.layout().features().count(), filter.map_size());
}
