//! A landmark as the state holds it (METHOD 2): in inverse depth, since a bearing says next to nothing about its depth and is
//! nearly linear in the inverse.

use crate::math::inverse_depth;
use nalgebra::{Matrix3, SMatrix, Vector3, Vector6};

/// Range beyond which a feature has no point, metres: there a millimetre is the last digit of f64 beside its square.
pub const FARTHEST: f64 = 1e6;

/// Numbers of a feature.
pub const FEATURE_DIM: usize = 6;

/// The numbers of a feature, `[p(3) theta phi rho]`, metres, radians, 1/m: the anchor first.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeatureState(pub Vector6<f64>);

impl FeatureState {
    fn anchor(&self) -> Vector3<f64> {
        self.0.fixed_rows::<3>(0).into_owned()
    }

    fn ray(&self) -> Vector3<f64> {
        inverse_depth::ray(self.0[3], self.0[4])
    }

    /// Inverse distance from the anchor, 1/m: what a metric vector to it is multiplied by.
    pub fn scale(&self) -> f64 {
        self.0[5]
    }

    /// Point in W, metres; `None` for `rho <= 0`, and past [`FARTHEST`].
    pub fn point(&self) -> Option<Vector3<f64>> {
        (self.scale() > 1.0 / FARTHEST).then(|| self.anchor() + self.ray() / self.scale())
    }

    /// Derivative of the point with respect to the numbers.
    pub fn point_jacobian(&self) -> SMatrix<f64, 3, 6> {
        let rho = self.scale();
        let (dt, dp) = inverse_depth::ray_jacobian(self.0[3], self.0[4]);
        let mut j = SMatrix::<f64, 3, 6>::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        j.set_column(3, &(dt / rho));
        j.set_column(4, &(dp / rho));
        j.set_column(5, &(-self.ray() / (rho * rho)));
        j
    }

    /// The vector from `r` to the point times [`Self::scale`], in W (Eq. 7 without its rotation), and its derivative by
    /// the numbers: finite for points at infinity.
    pub fn scaled_from(&self, r: &Vector3<f64>) -> (Vector3<f64>, SMatrix<f64, 3, 6>) {
        let (rho, offset) = (self.scale(), self.anchor() - r);
        let (dt, dp) = inverse_depth::ray_jacobian(self.0[3], self.0[4]);
        let mut by = SMatrix::<f64, 3, 6>::zeros();
        by.fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(Matrix3::identity() * rho));
        by.set_column(3, &dt);
        by.set_column(4, &dp);
        by.set_column(5, &offset);
        (offset * rho + self.ray(), by)
    }
}
