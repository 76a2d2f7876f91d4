//! Several worn cameras in one frame (METHOD 6): each measured given those before it, each with its own error, and what all
//! have in common of theirs.

use crate::filter::update::measure;
use crate::scene::{Warm, name, settings, warm};
use ekf_core::settings::Value;
use ekf_core::state::{BlockKind, ErrorOwner};
use ekf_core::{Filter, MeasurementOutcome, Measurements, WornObservation};

const TIME_CORRELATED: [(&str, Value); 1] = [("worn.bias_share", Value::Float(0.5))];

fn tight(share: f64) -> Vec<(&'static str, Value)> {
    let mut all = vec![
        ("estimator.mode", name("collab-tight")),
        ("worn.common_share", Value::Float(share)),
    ];
    all.extend(TIME_CORRELATED);
    all
}

/// The frame's measurements with views of worn cameras 0 to `count - 1`. They are at the same place; each has its own noise, and
/// its own error of T_CF unless that is `common` to all.
fn frame(warm: &mut Warm, count: usize, common: bool) -> Measurements {
    let mut z = measure(warm, true);
    for who in 1..count {
        let mut other = measure(warm, true).views.remove(0);
        other.who = who;
        if common {
            other.t_cf = z.views[0].t_cf.clone();
        }
        let found = |id: &u64| z.bearings.iter().any(|b| b.id == *id);
        other.pairs.retain(|p| p.id.as_ref().is_some_and(found));
        z.views.push(other);
    }
    z
}

#[test]
fn each_person_tells_more_and_less_where_their_errors_are_one() {
    let sd_after = |share: f64, count: usize| {
        let mut warm = warm(4, &tight(share));
        let z = frame(&mut warm, count, share > 0.0);
        let report = warm.filter.update(&z).expect("good measurements");
        assert_eq!(report.worn_poses.len(), count);
        assert_eq!(report.views.len(), count);
        for outcomes in &report.views[1..] {
            let accepted = outcomes.iter().filter(|o| o.is_accepted()).count();
            assert!(accepted * 10 > outcomes.len() * 8, "{outcomes:?}");
        }
        warm.filter.check().expect("sound");
        warm.filter.scale_sd().expect("a map")
    };
    let alone = [1, 2, 3].map(|count| sd_after(0.0, count));
    let common = [1, 2, 3].map(|count| sd_after(0.9, count));
    assert!(alone[0] > alone[1] && alone[1] > alone[2], "{alone:?}");
    assert!(common[0] > common[1] && common[1] > common[2], "{common:?}");
    let gained = |sd: [f64; 3]| sd[0] / sd[2];
    assert!(gained(alone) > gained(common), "{alone:?} {common:?}");
    let off = (alone[0] / common[0] - 1.0).abs();
    assert!(off < 1e-6, "of one alone the share means nothing: {off:e}");
}

#[test]
fn each_has_its_own_time_correlated_error_and_the_frames_errors_go_with_it() {
    for share in [0.0, 0.4] {
        let mut warm = warm(4, &tight(share));
        let z = frame(&mut warm, 3, false);
        warm.filter.update(&z).expect("good measurements");
        let layout = warm.filter.state().layout();
        let has = |kind| layout.of_kind(kind).count() == 1;
        for who in 0..3 {
            assert!(has(BlockKind::WornBias(ErrorOwner::Of(who))), "{who}");
            assert!(!has(BlockKind::WornError(ErrorOwner::Of(who))), "{who}");
        }
        assert_eq!(has(BlockKind::WornBias(ErrorOwner::Common)), share > 0.0);
        assert!(!has(BlockKind::WornError(ErrorOwner::Common)));
        let again = Filter::restore(&warm.filter.snapshot()).expect("its own");
        assert_eq!(again.snapshot(), warm.filter.snapshot());
    }
}

#[test]
fn a_new_point_of_two_views_is_one() {
    let mut warm = warm(4, &tight(0.0));
    let (mut z, _) = warm.scene.measure(warm.t, &warm.known, true);
    let mut first = z.views.remove(0);
    let lost: Vec<u64> = first.pairs.iter().filter_map(|p| p.id).take(5).collect();
    warm.filter.remove_features(&lost).expect("known");
    z.searched.retain(|id| !lost.contains(id));
    z.bearings.retain(|b| !lost.contains(&b.id));
    for pair in &mut first.pairs {
        pair.id = pair.id.filter(|id| !lost.contains(id));
    }
    let new = first.pairs.iter().filter(|p| p.id.is_none()).count();
    assert!(new >= 5);
    let second = WornObservation {
        who: 1,
        ..first.clone()
    };
    let before = warm.filter.map_size();
    z.views = vec![first, second];
    let report = warm.filter.update(&z).expect("good measurements");
    let born: Vec<usize> = (0..report.views[0].len())
        .filter(|&i| matches!(report.views[0][i], MeasurementOutcome::Born(_)))
        .collect();
    assert!(born.len() >= 5, "{:?}", report.views[0]);
    assert!(
        born.iter()
            .all(|&i| report.views[1][i] == MeasurementOutcome::Pixel)
    );
    let again = report.views[1].iter();
    let again = again
        .filter(|o| matches!(o, MeasurementOutcome::Born(_)))
        .count();
    assert_eq!(warm.filter.map_size(), before + born.len() + again);
}

#[test]
fn a_view_that_would_break_the_filter_is_refused_by_itself() {
    let mut warm = warm(4, &tight(0.0));
    let mut z = frame(&mut warm, 3, false);
    for pair in &mut z.views[1].pairs {
        pair.uv_f.x += 1e5;
    }
    z.views[1].covariance *= 1e60;
    let refused = warm.filter.clone().update(&z);
    z.views[1].covariance /= 1e60;
    let report = warm.filter.update(&z).expect("the others are good");
    assert!(report.accepted);
    assert!(report.views[1].iter().all(|o| !o.is_accepted()));
    assert!(report.views[2].iter().any(MeasurementOutcome::is_accepted));
    warm.filter.check().expect("sound");
    // Numbers that no covariance has are a mistake of the caller's, and change nothing.
    assert!(refused.is_err());
    let mut twice = frame(&mut warm, 3, false);
    twice.views[2].who = 1;
    assert!(warm.filter.update(&twice).is_err(), "one view of each");
    twice.views[2].who = 3;
    assert!(warm.filter.update(&twice).is_err(), "there are three");
}

#[test]
fn where_a_worn_camera_is_is_known_better_once_it_is_measured() {
    let mut warm = warm(4, &tight(0.3));
    let z = frame(&mut warm, 3, false);
    let stated: Vec<_> = z
        .views
        .iter()
        .map(|view| warm.filter.worn_pose(view).expect("started"))
        .collect();
    let report = warm.filter.update(&z).expect("good measurements");
    for (k, (before, after)) in stated.iter().zip(&report.worn_poses).enumerate() {
        assert_eq!((before.who, after.who), (k, k));
        let volume = |c: &nalgebra::Matrix6<f64>| c.determinant().max(0.0).ln();
        let gained = volume(&before.covariance) - volume(&after.covariance);
        assert!(gained > 1.0, "camera {k}: {gained}");
        let moved = before.pose.inverse().compose(&after.pose).log();
        let chi2 = before
            .covariance
            .cholesky()
            .expect("definite")
            .solve(&moved)
            .dot(&moved);
        assert!(chi2 < 30.0, "camera {k} moved by {moved:?}");
    }
    let fresh = Filter::new(settings(&tight(0.3)), warm.scene.camera.clone(), None);
    assert!(fresh.worn_pose(&z.views[0]).is_err(), "before the start");
}
