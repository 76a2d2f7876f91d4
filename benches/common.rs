//! Scenes for the benchmarks: a filter in use, and what its camera sees next.
//!
//! [`Sway`] is a camera that sways before a cloud of points, all of them in view, of which some are measured.
//! [`Loop`] is a camera that walks round a ring corridor, as a person does, and sees a part of a large map.
//! Both start from depths and stay warm: a benchmark times one call after the other on the same filter.

pub mod corridor;
pub mod dense;
pub mod sway;

pub use corridor::Loop;
pub use sway::Sway;

use ekf_core::{Camera, Settings, settings::Value};
use rand::Rng;
use rand_pcg::Pcg64;

/// 720 x 480 pixels, 62 degrees wide, no distortion.
pub fn camera() -> Camera {
    Camera::new("pinhole", 720, 480, [600.0, 600.0, 360.0, 240.0], &[]).expect("valid calibration")
}

/// The defaults with these changes.
pub fn settings(changes: &[(&str, Value)]) -> Settings {
    let mut settings = Settings::default();
    for (key, value) in changes {
        settings.set(key, value).expect("valid setting");
    }
    settings
}

/// A standard normal number.
pub fn normal(rng: &mut Pcg64) -> f64 {
    let (u, v): (f64, f64) = (rng.random_range(1e-300..1.0), rng.random());
    (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
}
