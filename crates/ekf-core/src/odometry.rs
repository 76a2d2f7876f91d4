//! Odometry as motion input (METHOD 23): what wheels or another sensor of motion say, kept until a frame is predicted.
//!
//! A sample is the mean twist since the one before. It says nothing of a longer silence, which the motion model bridges.

use crate::error::EkfError;
use crate::guard;
use crate::math::numbers;
use crate::math::pose::Pose;
use crate::math::quat;
use crate::predict::{Reading, TwistMatrix};
use crate::stamps;
use nalgebra::{Matrix6, SMatrix, Vector6};
use serde::{Deserialize, Serialize};
use std::collections::VecDeque;

/// Longest time that one sample of odometry tells of, seconds.
pub const ODOMETRY_GAP: f64 = 1.0;

/// Largest number of a twist, m/s or rad/s.
const FASTEST: f64 = 1e3;

/// Least variance of a twist's number, (m/s)^2 or (rad/s)^2: nothing is known better than to a micrometre in a second.
const LEAST_VARIANCE: f64 = 1e-12;

/// Least eigenvalue of a covariance that is scaled by its diagonal.
const LEAST_EIGENVALUE: f64 = 1e-9;

/// Samples that wait for a frame at most: three minutes at 100 Hz.
const MOST: usize = 20_000;

/// The mean twist over a time.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Sample {
    /// When that time begins and ends, seconds.
    pub(crate) from: f64,
    pub(crate) t: f64,
    /// `(v, w)` of the odometry's frame along its own axes, m/s and rad/s.
    #[serde(with = "numbers")]
    pub(crate) twist: Vector6<f64>,
    /// Of it over that time.
    #[serde(with = "numbers")]
    pub(crate) covariance: Matrix6<f64>,
}

/// The samples that wait for a frame, and where the camera sits.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Odometry {
    /// `T_BC`: maps points of C into the odometry's frame.
    pub(crate) t_bc: Pose,
    /// Stamp of the last sample, seconds.
    pub(crate) last: Option<f64>,
    pub(crate) samples: VecDeque<Sample>,
}

impl Default for Odometry {
    fn default() -> Self {
        Self {
            t_bc: Pose::identity(),
            last: None,
            samples: VecDeque::new(),
        }
    }
}

impl Odometry {
    /// Takes the twist that was measured since the last sample.
    pub(crate) fn add(
        &mut self,
        t: f64,
        twist: &Vector6<f64>,
        covariance: &Matrix6<f64>,
    ) -> Result<(), EkfError> {
        check(twist, covariance)?;
        stamps::check_next("time of the odometry", t, self.last)?;
        if self.samples.len() == MOST {
            return Err(EkfError::InvalidInput {
                what: "odometry",
                why: format!("{MOST} samples wait for a frame; give frames as they come"),
            });
        }
        if let Some(from) = self.last.filter(|last| t - last <= ODOMETRY_GAP) {
            self.samples.push_back(Sample {
                from,
                t,
                twist: *twist,
                covariance: (covariance + covariance.transpose()) * 0.5,
            });
        }
        self.last = Some(t);
        Ok(())
    }

    /// Forgets what is over at `t`.
    pub(crate) fn forget_until(&mut self, t: f64) {
        while self.samples.front().is_some_and(|sample| sample.t <= t) {
            self.samples.pop_front();
        }
    }

    /// A sample as it is for the camera over `dt` seconds of its time: what is white over the whole is as white over a part.
    pub(crate) fn reading(&self, sample: &Sample, dt: f64) -> Reading {
        let carry = twist_of_camera(&self.t_bc);
        let (v, w) = (sample.twist.fixed_rows::<3>(0), sample.twist.fixed_rows(3));
        let mut parts = SMatrix::<f64, 6, 2>::zeros();
        parts.fixed_view_mut::<3, 1>(0, 0).copy_from(&v);
        parts.fixed_view_mut::<3, 1>(3, 1).copy_from(&w);
        let covariance = carry * sample.covariance * carry.transpose();
        Reading {
            twist: carry * sample.twist,
            covariance: covariance * ((sample.t - sample.from) / dt),
            by_scale: carry * parts,
        }
    }

    /// Whether what a snapshot says can be.
    pub(crate) fn check(&self) -> Result<(), EkfError> {
        let bad = EkfError::bad_snapshot("its odometry is impossible");
        let mut before = f64::NEG_INFINITY;
        for sample in &self.samples {
            let Sample {
                from,
                t,
                twist,
                covariance,
            } = sample;
            let in_order = before <= *from && from < t && t - from <= ODOMETRY_GAP;
            if !in_order || check(twist, covariance).is_err() {
                return Err(bad);
            }
            before = *t;
        }
        let last = self.last.unwrap_or(f64::NEG_INFINITY);
        let known = self.last.is_none_or(stamps::is_sane);
        if !known || before > last || self.samples.len() > MOST {
            return Err(bad);
        }
        guard::check_rigid("odometry frame", &self.t_bc).map_err(|_| bad)
    }
}

/// Numbers that a twist and its covariance can have.
pub(crate) fn check(twist: &Vector6<f64>, covariance: &Matrix6<f64>) -> Result<(), EkfError> {
    if !twist.iter().chain(covariance.iter()).all(|x| x.is_finite()) {
        return Err(EkfError::NonFinite {
            what: "odometry or its covariance",
        });
    }
    if let Some(x) = twist.iter().find(|x| x.abs() > FASTEST) {
        let why = format!("{x} is too fast; give m/s and rad/s");
        let what = "odometry";
        return Err(EkfError::InvalidInput { what, why });
    }
    let what = "covariance of the odometry";
    guard::variances(what, covariance.iter())?;
    if is_definite(covariance) {
        return Ok(());
    }
    Err(EkfError::InvalidInput {
        what,
        why: "it is not symmetric positive definite; give every axis the variance of its error, also those along which \
              the wheels cannot move"
            .into(),
    })
}

/// Symmetric and positive definite, whatever the units of its axes.
fn is_definite(m: &Matrix6<f64>) -> bool {
    if m.diagonal().min() < LEAST_VARIANCE {
        return false;
    }
    let scale = Matrix6::from_diagonal(&m.diagonal().map(|d| 1.0 / d.sqrt()));
    let scaled = scale * m * scale;
    (scaled - scaled.transpose()).abs().max() <= 1e-9
        && ((scaled + scaled.transpose()) * 0.5)
            .symmetric_eigenvalues()
            .min()
            >= LEAST_EIGENVALUE
}

/// The matrix that makes the twist of C, along its axes, of that of a frame B that it is fixed to.
fn twist_of_camera(t_bc: &Pose) -> TwistMatrix {
    let into = t_bc.rotation.transpose();
    let mut out = TwistMatrix::zeros();
    for at in [0, 3] {
        out.fixed_view_mut::<3, 3>(at, at).copy_from(&into);
    }
    // The camera's point moves with v + w x p.
    out.fixed_view_mut::<3, 3>(0, 3)
        .copy_from(&(-into * quat::skew(&t_bc.translation)));
    out
}
