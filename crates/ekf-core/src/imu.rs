//! What a gyroscope measured, kept until a frame is predicted (METHOD 28).
//!
//! A sample is the rate at its time; between two that are close the rate is taken as linear. Of a longer silence they say
//! nothing, and the motion model bridges it.

use crate::error::EkfError;
use crate::math::numbers;
use crate::stamps;
use nalgebra::{Matrix3, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Longest time between two samples that the rate is known in, seconds.
pub const GYRO_GAP: f64 = 0.1;

/// Largest rate, rad/s: 4000 degrees a second, twice what common sensors can measure.
pub const FASTEST_RATE: f64 = 70.0;

/// Largest offset of the clock, seconds.
const LARGEST_OFFSET: f64 = 10.0;

/// Samples that wait for a frame at most: half a minute at 1000 Hz.
const MOST: usize = 30_000;

/// How often an axis may repeat its rate to the bit; the noise of one that lives makes them differ, at a limit it is the same.
const STUCK: u32 = 3;

/// A rate at a time of the sensor's clock.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sample {
    /// Seconds.
    pub(crate) t: f64,
    /// Along the sensor's axes, rad/s.
    #[serde(with = "numbers")]
    pub(crate) rate: Vector3<f64>,
}

/// The samples that wait for a frame, and how the sensor sits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Imu {
    /// Maps the sensor's axes into those of C.
    #[serde(with = "numbers")]
    pub(crate) r_ci: Matrix3<f64>,
    /// Whether it is not followed any more, as the images contradict it.
    pub(crate) is_off: bool,
    /// Stamp and rate of the last sample, seconds and rad/s.
    pub(crate) last: Option<f64>,
    #[serde(with = "numbers")]
    last_rate: Vector3<f64>,
    /// How often each axis, and all of them, repeated their rates.
    repeated: [u32; 4],
    /// Increasing; those of a sensor that is stuck are left out.
    pub(crate) samples: VecDeque<Sample>,
}

impl Default for Imu {
    fn default() -> Self {
        Self {
            r_ci: Matrix3::identity(),
            is_off: false,
            last: None,
            last_rate: Vector3::zeros(),
            repeated: [0; 4],
            samples: VecDeque::new(),
        }
    }
}

impl Imu {
    /// A sensor that sits so, and has said nothing yet.
    pub(crate) fn at(r_ci: &Matrix3<f64>) -> Self {
        Self {
            r_ci: *r_ci,
            ..Self::default()
        }
    }

    /// Takes a rate.
    pub(crate) fn add(&mut self, t: f64, rate: &Vector3<f64>) -> Result<(), EkfError> {
        check(rate)?;
        stamps::check_next("time of the gyroscope", t, self.last)?;
        if self.samples.len() == MOST {
            return Err(EkfError::InvalidInput {
                what: "gyroscope",
                why: format!("{MOST} samples wait for a frame; give frames as they come"),
            });
        }
        if !self.is_stuck(rate) {
            self.samples.push_back(Sample { t, rate: *rate });
        }
        (self.last, self.last_rate) = (Some(t), *rate);
        Ok(())
    }

    /// Whether a rate is that of an axis at its limit, or of a sensor that is stuck. One that turns about a single axis may have
    /// zeros about the others.
    fn is_stuck(&mut self, rate: &Vector3<f64>) -> bool {
        let same = |i: usize| self.last.is_some() && rate[i] == self.last_rate[i];
        let again: [bool; 4] = std::array::from_fn(|i| match i {
            3 => (0..3).all(same),
            i => same(i) && rate[i] != 0.0,
        });
        for (count, again) in self.repeated.iter_mut().zip(again) {
            *count = if again { count.saturating_add(1) } else { 0 };
        }
        self.repeated.iter().any(|&count| count >= STUCK)
    }

    /// Forgets what no frame after `t` asks for.
    pub(crate) fn forget_until(&mut self, t: f64) {
        while self.samples.len() > 1 && self.samples[1].t <= t {
            self.samples.pop_front();
        }
    }

    /// Pairs of successive samples between which the rate is known.
    pub(crate) fn pairs(&self) -> impl Iterator<Item = (&Sample, &Sample)> {
        let next = self.samples.iter().skip(1);
        let pairs = self.samples.iter().zip(next);
        pairs.filter(|(before, after)| after.t - before.t <= GYRO_GAP)
    }

    /// Whether what a snapshot says can be.
    pub(crate) fn check(&self) -> Result<(), EkfError> {
        let mut samples = self.samples.iter();
        let known = samples.all(|sample| stamps::is_sane(sample.t) && check(&sample.rate).is_ok());
        let mut stamps = self.samples.iter().zip(self.samples.iter().skip(1));
        let in_order = stamps.all(|(before, after)| before.t < after.t);
        let last = self
            .samples
            .back()
            .map_or(f64::NEG_INFINITY, |sample| sample.t);
        let in_order = in_order
            && self
                .last
                .map_or(self.samples.is_empty(), |t| last <= t && stamps::is_sane(t));
        if known && in_order && self.samples.len() <= MOST && check_mount(&self.r_ci).is_ok() {
            return Ok(());
        }
        Err(EkfError::bad_snapshot("its gyroscope is impossible"))
    }
}

/// Numbers that a rate can have.
pub(crate) fn check(rate: &Vector3<f64>) -> Result<(), EkfError> {
    let what = "gyroscope";
    if !rate.iter().all(|x| x.is_finite()) {
        return Err(EkfError::NonFinite { what });
    }
    if let Some(x) = rate.iter().find(|x| x.abs() > FASTEST_RATE) {
        let why = format!("{x} rad/s is too fast; give rad/s, not degrees");
        return Err(EkfError::InvalidInput { what, why });
    }
    Ok(())
}

/// A rotation.
pub(crate) fn check_mount(r_ci: &Matrix3<f64>) -> Result<(), EkfError> {
    let what = "r_ci of the IMU";
    if !r_ci.iter().all(|x| x.is_finite()) {
        return Err(EkfError::NonFinite { what });
    }
    if crate::math::quat::is_rotation(r_ci, 1e-6) {
        return Ok(());
    }
    let why =
        "it is not a rotation matrix; its columns are the axes of the IMU as C sees them".into();
    Err(EkfError::InvalidInput { what, why })
}

/// An offset of the clock that can be.
pub(crate) fn check_offset(offset: f64) -> Result<(), EkfError> {
    let what = "time offset of the IMU";
    if !offset.is_finite() {
        return Err(EkfError::NonFinite { what });
    }
    if offset.abs() <= LARGEST_OFFSET {
        return Ok(());
    }
    let why =
        format!("{offset} s is more than {LARGEST_OFFSET}; bring both stamps to one clock first");
    Err(EkfError::InvalidInput { what, why })
}
