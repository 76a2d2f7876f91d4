//! Odometry in a snapshot.

use crate::error::EkfError;
use crate::filter::memory::wheels::Wheels;
use crate::math::pose::Pose;
use crate::odometry::{Odometry, Sample};
use crate::predict::CameraMatrix;
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use serde::{Deserialize, Serialize};

#[derive(Serialize, Deserialize)]
pub(super) struct OdometryImage {
    /// Rotation, column after column, and translation of `T_BC`.
    t_bc: ([f64; 9], [f64; 3]),
    last: Option<f64>,
    /// Begin, end, twist and covariance of each sample.
    samples: Vec<(f64, f64, [f64; 6], Vec<f64>)>,
    followed: bool,
    slip: Option<Vec<f64>>,
    trusted: Option<Vec<f64>>,
    unclear: [bool; 2],
}

impl OdometryImage {
    pub(crate) fn of(odometry: &Odometry, wheels: &Wheels) -> Self {
        let Odometry {
            t_bc,
            last,
            samples,
        } = odometry;
        let Wheels {
            followed,
            slip,
            trusted,
            unclear,
        } = wheels;
        let entries = |m: &Option<CameraMatrix>| m.as_ref().map(|m| m.as_slice().to_vec());
        Self {
            t_bc: (
                std::array::from_fn(|i| t_bc.rotation[i]),
                t_bc.translation.into(),
            ),
            last: *last,
            samples: samples
                .iter()
                .map(|s| {
                    let covariance = s.covariance.as_slice().to_vec();
                    (s.from, s.t, s.twist.into(), covariance)
                })
                .collect(),
            followed: *followed,
            slip: entries(slip),
            trusted: entries(trusted),
            unclear: *unclear,
        }
    }

    pub(super) fn restored(self) -> Result<(Odometry, Wheels), EkfError> {
        let samples = self.samples.into_iter();
        let samples = samples.map(|(from, t, twist, covariance)| {
            let covariance = numbers::<36>(covariance)?;
            Ok(Sample {
                from,
                t,
                twist: Vector6::from(twist),
                covariance: Matrix6::from_column_slice(&covariance),
            })
        });
        let odometry = Odometry {
            t_bc: Pose {
                rotation: Matrix3::from_column_slice(&self.t_bc.0),
                translation: Vector3::from(self.t_bc.1),
            },
            last: self.last,
            samples: samples.collect::<Result<_, EkfError>>()?,
        };
        odometry.check()?;
        let matrix = |entries: Option<Vec<f64>>| {
            let entries = entries.map(numbers::<169>).transpose()?;
            Ok(entries.map(|entries| CameraMatrix::from_column_slice(&entries)))
        };
        let wheels = Wheels {
            followed: self.followed,
            slip: matrix(self.slip)?,
            trusted: matrix(self.trusted)?,
            unclear: self.unclear,
        };
        Ok((odometry, wheels))
    }
}

fn numbers<const N: usize>(entries: Vec<f64>) -> Result<[f64; N], EkfError> {
    match <[f64; N]>::try_from(entries) {
        Ok(entries) if entries.iter().all(|v| v.is_finite()) => Ok(entries),
        _ => Err(EkfError::bad_snapshot("its odometry is impossible")),
    }
}
