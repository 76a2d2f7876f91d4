//! The point of a feature seen from the camera (METHOD 4, Eq. 5 and 7), and derivatives.

use super::feature::FeatureState;
use crate::math::{numbers, quat};
use nalgebra::{SMatrix, Vector3};
use serde::{Deserialize, Serialize};

/// Numbers of a pose `[r(3) q(4)]` in the state.
pub const POSE_DIM: usize = 7;
/// Where its attitude begins.
pub(crate) const ATTITUDE: usize = 3;

/// Camera pose as the state holds it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct CameraPose {
    /// `r_WC`, metres.
    #[serde(with = "numbers")]
    pub r: Vector3<f64>,
    /// `q_WC`.
    #[serde(with = "numbers")]
    pub q: quat::Quat,
}

/// A 3-vector in C with its derivatives with respect to `[r q]` and the feature.
#[derive(Clone, Debug)]
pub struct PointInCamera {
    /// The vector.
    pub value: Vector3<f64>,
    /// 3x7.
    pub by_pose: SMatrix<f64, 3, 7>,
    /// 3x6.
    pub by_feature: SMatrix<f64, 3, 6>,
}

impl PointInCamera {
    /// The scaled form of Eq. 7: `R_CW (rho (p - r) + m)`: a direction, finite for points at infinity.
    pub fn scaled(camera: &CameraPose, feature: &FeatureState) -> Self {
        let (in_world, by_feature) = feature.scaled_from(&camera.r);
        Self::rotated(camera, in_world, feature.scale(), &by_feature)
    }

    /// The metric form of Eq. 5: `R_CW (p + m / rho - r)`, metres. Needs `rho > 0`.
    pub fn metric(camera: &CameraPose, feature: &FeatureState) -> Option<Self> {
        let point = feature.point()?;
        Some(Self::rotated(
            camera,
            point - camera.r,
            1.0,
            &feature.point_jacobian(),
        ))
    }

    fn rotated(
        camera: &CameraPose,
        in_world: Vector3<f64>,
        by_r: f64,
        by_feature: &SMatrix<f64, 3, 6>,
    ) -> Self {
        let r_cw = quat::rotation(&camera.q).transpose();
        let mut by_pose = SMatrix::<f64, 3, 7>::zeros();
        by_pose
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(r_cw * -by_r));
        by_pose
            .fixed_view_mut::<3, 4>(0, 3)
            .copy_from(&quat::rotate_inverse_jacobian(&camera.q, &in_world));
        Self {
            value: r_cw * in_world,
            by_pose,
            by_feature: r_cw * by_feature,
        }
    }
}
