//! Guesses of depth that a pixel then contradicts: how sure the filter is of what it makes of them.

use crate::scene::{Scene, Trajectory, Warm, warm_in};
use nalgebra::{DMatrix, Vector3};

/// Ten times as far as the median of the map, and to the side.
const FAR: [f64; 3] = [-24.0, 2.0, 60.0];

/// A camera that goes straight ahead, and a landmark whose depth is a guess since a metre and a half ago: the landmark, and its
/// inverse depth. It is measured next.
fn guessed(seed: u64) -> (Warm, u64, f64) {
    let mut scene = Scene::new(seed, 30);
    scene.trajectory = Trajectory::Ahead;
    let mut warm = warm_in(scene, &[]);
    let far = Vector3::from(FAR);
    warm.scene.points.push(far);
    let point = warm.scene.points.len() - 1;
    warm.update(false);
    let first = warm.scene.pose(warm.t);
    let uv = warm.scene.pixel(&first, point).expect("in view");
    let waiting = warm.filter.add_candidates(&[uv]).expect("started");
    for _ in 0..10 {
        warm.next_frame();
        warm.update(false);
    }
    let born = warm.filter.promote_candidates(&waiting, false);
    let id = born.expect("a candidate")[0].expect("born");
    warm.next_frame();
    warm.known.insert(id, point);
    (warm, id, (far - first.translation).norm().recip())
}

/// Its inverse depth and the variance of that.
fn inverse_depth(warm: &Warm, id: u64) -> (f64, f64) {
    let state = warm.filter.state();
    let at = state.layout().find(id).expect("in the state").offset + 5;
    (state.mean()[at], state.covariance().get(at, at))
}

#[test]
fn a_guess_that_was_far_off_is_no_surer_than_it_is_right() {
    let draws = 60;
    let nees: f64 = (0..draws)
        .map(|seed| {
            let (mut warm, id, truth) = guessed(seed);
            let (guess, variance) = inverse_depth(&warm, id);
            assert!(guess > 3.0 * truth && guess - truth < 1.5 * variance.sqrt());
            warm.update(false);
            let (rho, variance) = inverse_depth(&warm, id);
            assert!(variance.sqrt() < 0.2 * guess, "the pixel tells it");
            (rho - truth).powi(2) / variance
        })
        .sum();
    let mean = nees / f64::from(draws as u32);
    assert!((0.5..1.6).contains(&mean), "{mean}");
}

/// P was carried to where its rows are taken by then.
#[test]
fn a_frame_that_is_too_fast_changes_nothing_beside_a_guess() {
    let (mut warm, ..) = guessed(3);
    let (z, _) = warm.scene.measure(warm.t, &warm.known, false);
    let before = |warm: &Warm| -> (Vec<f64>, DMatrix<f64>) {
        let state = warm.filter.state();
        (state.mean().to_vec(), state.covariance().to_dense())
    };
    let was = before(&warm);
    let mut refused = z.clone();
    refused.max_speed = Some(0.01);
    let report = warm.filter.update(&refused).expect("good measurements");
    assert!(report.too_fast);
    assert_eq!(before(&warm), was);
    let mut never = warm.filter.clone();
    warm.filter.update(&z).expect("good measurements");
    never.update(&z).expect("good measurements");
    assert_eq!(warm.filter.snapshot(), never.snapshot());
}
