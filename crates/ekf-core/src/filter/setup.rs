//! What of a filter never changes: its settings and its cameras.

use crate::camera::Camera;
use crate::error::EkfError;
use crate::guard::{check_bias, check_pose};
use crate::math::pose::Pose;
use crate::settings::{Consistency, Settings};
use nalgebra::Matrix6;

/// Settings and cameras.
#[derive(Clone, Debug)]
pub(crate) struct Setup {
    pub(crate) settings: Settings,
    /// Of Cs.
    pub(crate) camera: Camera,
    /// Of the worn cameras, by their numbers.
    pub(crate) worn_cameras: Vec<Camera>,
}

impl Setup {
    /// Whether P moves with the directions that no camera can see.
    pub(crate) fn carries(&self) -> bool {
        self.settings.estimator.consistency == Consistency::Gauge
    }

    /// The model of a worn camera.
    pub(crate) fn worn_model(&self, who: usize) -> Result<&Camera, EkfError> {
        self.worn_cameras.get(who).ok_or_else(|| {
            let why = match self.worn_cameras.len() {
                0 => "the filter was made without a camera model of Cf; give one".into(),
                n => format!("there is no worn camera {who}; the filter has {n}, numbered from 0"),
            };
            let what = "worn camera";
            EkfError::InvalidInput { what, why }
        })
    }

    /// Whether a view with these numbers can be measured, see [`Filter::check_worn`](crate::Filter::check_worn).
    pub(crate) fn check_worn(
        &self,
        t_cf: &Pose,
        covariance: &Matrix6<f64>,
        bias: Option<&Matrix6<f64>>,
        who: usize,
    ) -> Result<(), EkfError> {
        self.worn_model(who)?;
        check_pose(t_cf, covariance)?;
        bias.map_or(Ok(()), |bias| check_bias(bias, covariance))
    }
}
