//! The point of a feature seen from the camera (METHOD 4, Eq. 5 and 7), and derivatives.

use crate::math::{inverse_depth, quat};
use nalgebra::{Matrix3, SMatrix, Vector3, Vector6};

/// Range beyond which there are no points, metres: their numbers would leave f64 when they are squared and divided.
pub const FARTHEST: f64 = 1e9;

/// Camera pose as the state holds it.
#[derive(Clone, Copy, Debug)]
pub struct CameraPose {
    /// `r_WC`, metres.
    pub r: Vector3<f64>,
    /// `q_WC`.
    pub q: quat::Quat,
}

/// An inverse-depth feature `[p(3) theta phi rho]`.
#[derive(Clone, Copy, Debug)]
pub struct FeatureState(pub Vector6<f64>);

impl FeatureState {
    /// Inverse distance from the anchor, 1/m.
    pub fn rho(&self) -> f64 {
        self.0[5]
    }

    /// Point in W, metres; `None` for `rho <= 0`, and past [`FARTHEST`].
    pub fn point(&self) -> Option<Vector3<f64>> {
        (self.rho() > 1.0 / FARTHEST).then(|| self.anchor() + self.ray() / self.rho())
    }

    /// Derivative of the point with respect to the six numbers.
    pub fn point_jacobian(&self) -> SMatrix<f64, 3, 6> {
        let rho = self.rho();
        let (dt, dp) = inverse_depth::ray_jacobian(self.0[3], self.0[4]);
        let mut j = SMatrix::<f64, 3, 6>::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        j.set_column(3, &(dt / rho));
        j.set_column(4, &(dp / rho));
        j.set_column(5, &(-self.ray() / (rho * rho)));
        j
    }

    fn anchor(&self) -> Vector3<f64> {
        self.0.fixed_rows::<3>(0).into_owned()
    }

    fn ray(&self) -> Vector3<f64> {
        inverse_depth::ray(self.0[3], self.0[4])
    }
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
        let rho = feature.rho();
        let offset = feature.anchor() - camera.r;
        let (dt, dp) = inverse_depth::ray_jacobian(feature.0[3], feature.0[4]);
        let mut by = SMatrix::<f64, 3, 6>::zeros();
        by.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(Matrix3::identity() * rho));
        by.set_column(3, &dt);
        by.set_column(4, &dp);
        by.set_column(5, &offset);
        Self::rotated(camera, offset * rho + feature.ray(), rho, &by)
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
