//! Matches that the others contradict a little in each frame.

use crate::scene::{Warm, warm};
use crate::update::measure;
use ekf_core::Outcome;
use ekf_core::settings::Value;

const FRAMES: usize = 60;

/// How often each feature was left out by the others, while the one at `astray` moves by itself, 2.5 px to and fro.
fn left_out(level: f64, astray: Option<usize>, sigma_px: f64) -> Vec<usize> {
    let mut warm = warm(8, &[("validate.lasting_level", Value::Float(level))]);
    warm.scene.sigma_px = sigma_px;
    let mut times = vec![0; 30];
    for _ in 0..FRAMES {
        frame(&mut warm, astray, &mut times);
    }
    times
}

fn frame(warm: &mut Warm, astray: Option<usize>, times: &mut [usize]) {
    let mut z = measure(warm, false);
    let shift = 2.5 * (1.2 * warm.t).sin();
    for bearing in &mut z.bearings {
        if Some(warm.known[&bearing.id]) == astray {
            bearing.uv.x += shift;
        }
    }
    let report = warm.filter.update(&z).expect("good measurements");
    for (bearing, outcome) in z.bearings.iter().zip(&report.bearings) {
        if *outcome == Outcome::RejectedConditional {
            times[warm.known[&bearing.id]] += 1;
        }
    }
    warm.next_frame();
}

/// A point that is in view throughout.
fn some_point() -> usize {
    let warm = warm(8, &[]);
    *warm.known.values().next().expect("features")
}

#[test]
fn what_moves_by_itself_is_left_out_in_the_end() {
    let astray = some_point();
    let never = left_out(1.0, Some(astray), 0.3);
    assert_eq!(
        never.iter().sum::<usize>(),
        0,
        "each frame's gate lets it pass"
    );
    let times = left_out(0.999, Some(astray), 0.3);
    assert!(times[astray] > FRAMES / 4, "{times:?}");
    let others: usize = times.iter().sum::<usize>() - times[astray];
    assert_eq!(others, 0, "{times:?}");
}

#[test]
fn honest_noise_is_hardly_ever_left_out() {
    let times = left_out(0.999, None, 1.0);
    let all = FRAMES * warm(8, &[]).known.len();
    assert!(
        times.iter().sum::<usize>() * 100 < all,
        "{times:?} of {all}"
    );
}
