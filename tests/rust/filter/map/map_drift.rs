//! What a map transfers (METHOD 20): how new landmarks stand beside old ones is less certain than white noise says.

use crate::scene::{Warm, warm};
use ekf_core::settings::Value;
use ekf_core::{DepthObservation, MeasurementOutcome, Measurements};
use nalgebra::Matrix6;

/// Two cameras that do the same, with and without map drift, until they differ or so many frames are over.
fn until_they_differ(births: bool, moving: bool) -> [Warm; 2] {
    let mut pair = [10.0, 0.0].map(|by| warm(7, &[("process.map_drift", Value::Float(by))]));
    if births {
        pair.iter_mut().for_each(give_birth);
    }
    for _ in 0..if moving { 90 } else { 1 } {
        pair.iter_mut().for_each(Warm::next_frame);
        if differ(&pair) {
            break;
        }
        pair.iter_mut().for_each(|warm| warm.update(false));
    }
    pair
}

fn differ([a, b]: &[Warm; 2]) -> bool {
    a.filter.pose_covariance() != b.filter.pose_covariance()
}

pub(crate) fn give_birth(warm: &mut Warm) {
    let pose = warm.scene.pose(warm.t).inverse();
    let seen = (0..warm.scene.points.len()).filter_map(|point| {
        let depth = pose.apply(&warm.scene.points[point]).z;
        let uv = warm
            .scene
            .camera
            .project(&pose.apply(&warm.scene.points[point]))?;
        let inside = warm.scene.camera.in_image(&uv, 40.0);
        inside.then_some(DepthObservation {
            id: None,
            uv,
            depth,
            sigma: 0.02 * depth,
        })
    });
    let z = Measurements {
        depths: seen.take(8).collect(),
        ..Measurements::default()
    };
    let report = warm.filter.update(&z).expect("good measurements");
    assert!(
        report
            .depths
            .iter()
            .any(|o| matches!(o, MeasurementOutcome::Born(_)))
    );
}

/// Sums of the variances of position and attitude.
fn variances(p: &Matrix6<f64>) -> [f64; 2] {
    [0, 3].map(|at| p.fixed_view::<3, 3>(at, at).trace())
}

#[test]
fn the_camera_drifts_with_what_it_sees() {
    let [with, without] = until_they_differ(true, true);
    let pairs = [
        with.filter.pose_covariance(),
        without.filter.pose_covariance(),
    ];
    let [more, less] = pairs.map(|p| variances(&p));
    assert!(more[0] > 1.05 * less[0], "{more:?} {less:?}");
    assert!(more[1] > 1.005 * less[1], "{more:?} {less:?}");
    // Gates and searches of what is in view are as they were.
    let (a, b) = (
        with.filter.predict_pixels(),
        without.filter.predict_pixels(),
    );
    assert_eq!(a.len(), b.len());
    assert!(a.len() > 10);
    for (a, b) in a.iter().zip(&b) {
        let off = (a.s - b.s).abs().max() / b.s.abs().max();
        assert!(off < 1e-6, "feature {}: {off:e}", a.id);
    }
    with.filter.check().expect("sound");
}

/// Variance of the attitude that the first drift noise adds, where pixels are off by so much long before, and lately.
fn drift(before: f64, lately: f64) -> f64 {
    let mut pair = [10.0, 0.0].map(|by| warm(7, &[("process.map_drift", Value::Float(by))]));
    let step = |warm: &mut Warm| {
        warm.next_frame();
        warm.update(false);
    };
    for warm in &mut pair {
        warm.scene.sigma_px = before;
        (0..40).for_each(|_| step(warm));
        warm.scene.sigma_px = lately;
        (0..20).for_each(|_| step(warm));
        give_birth(warm);
    }
    for _ in 0..90 {
        pair.iter_mut().for_each(step);
        if differ(&pair) {
            break;
        }
    }
    assert!(differ(&pair));
    let [with, without] = pair.map(|warm| variances(&warm.filter.pose_covariance())[1]);
    with - without
}

#[test]
fn it_drifts_by_the_frames_in_which_it_is_transferred_and_not_by_those_of_long_before() {
    let (quiet, calmed, upset) = (drift(0.5, 0.5), drift(1.5, 0.5), drift(0.5, 1.5));
    assert!(upset > 2.0 * quiet, "{upset} {quiet}");
    // The mean over all frames would have it the other way round.
    assert!(upset > 1.3 * calmed, "{upset} {calmed}");
}

#[test]
fn it_takes_new_landmarks_and_a_new_view() {
    assert!(differ(&until_they_differ(true, true)));
    assert!(!differ(&until_they_differ(false, true)));
    assert!(!differ(&until_they_differ(true, false)));
}

#[test]
fn a_known_map_stays_where_it_is() {
    let [warm, _] = until_they_differ(true, true);
    let (_, map) = warm.filter.known_map();
    let mut filter = warm.scene.filter(warm.filter.settings().clone());
    filter.predict(0.0).unwrap();
    filter.start_from_map(&map).unwrap();
    let (_, same) = filter.known_map();
    filter.predict(1.0).unwrap();
    let (_, after) = filter.known_map();
    assert_eq!(same.covariance, after.covariance);
}
