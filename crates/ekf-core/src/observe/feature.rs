//! A landmark as the state holds it (METHOD 2): in inverse depth, six numbers, or as a point, three.
//!
//! A feature is born in inverse depth, since a bearing says next to nothing about its depth and is nearly linear in the
//! inverse. Once the depth is known, the three numbers of the point say the same. All differences between the two forms are
//! in this file; derivatives have six columns, of which a point leaves the last three zero.

use crate::math::inverse_depth;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// Range beyond which a feature has no point, metres: there a millimetre is the last digit of f64 beside its square.
pub const FARTHEST: f64 = 1e6;

/// How a feature is parametrised.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Form {
    /// `[p(3) theta phi rho]`: the anchor first.
    InverseDepth,
    /// `[x y z]` in W.
    Point,
}

impl Form {
    /// Numbers in the state.
    pub const fn dim(self) -> usize {
        match self {
            Self::InverseDepth => 6,
            Self::Point => 3,
        }
    }
}

/// The numbers of a feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FeatureState {
    /// `[p(3) theta phi rho]`, metres, radians, 1/m.
    InverseDepth(Vector6<f64>),
    /// `[x y z]` in W, metres.
    Point(Vector3<f64>),
}

impl FeatureState {
    /// A feature of that form from its numbers.
    pub fn from_slice(form: Form, numbers: &[f64]) -> Self {
        match form {
            Form::InverseDepth => Self::InverseDepth(Vector6::from_column_slice(numbers)),
            Form::Point => Self::Point(Vector3::from_column_slice(numbers)),
        }
    }

    /// How it is parametrised.
    pub fn form(&self) -> Form {
        match self {
            Self::InverseDepth(_) => Form::InverseDepth,
            Self::Point(_) => Form::Point,
        }
    }

    /// Its numbers, [`Form::dim`] of them.
    pub fn numbers(&self) -> &[f64] {
        match self {
            Self::InverseDepth(y) => y.as_slice(),
            Self::Point(p) => p.as_slice(),
        }
    }

    /// The same, to be changed.
    pub(crate) fn numbers_mut(&mut self) -> &mut [f64] {
        match self {
            Self::InverseDepth(y) => y.as_mut_slice(),
            Self::Point(p) => p.as_mut_slice(),
        }
    }

    /// The same in inverse depth: of a point from an anchor one metre before it along W's z.
    pub fn in_inverse_depth(&self) -> Vector6<f64> {
        match self {
            Self::InverseDepth(y) => *y,
            Self::Point(p) => Vector6::new(p.x, p.y, p.z - 1.0, 0.0, 0.0, 1.0),
        }
    }

    /// Inverse distance from the anchor, 1/m; 1 for a point: what a metric vector to it is multiplied by.
    pub fn scale(&self) -> f64 {
        match self {
            Self::InverseDepth(y) => y[5],
            Self::Point(_) => 1.0,
        }
    }

    /// Derivative of [`Self::scale`].
    pub fn scale_jacobian(&self) -> SMatrix<f64, 1, 6> {
        let by_rho = match self {
            Self::InverseDepth(_) => 1.0,
            Self::Point(_) => 0.0,
        };
        SMatrix::from_row_slice(&[0.0, 0.0, 0.0, 0.0, 0.0, by_rho])
    }

    /// Point in W, metres; `None` for `rho <= 0`, and past [`FARTHEST`].
    pub fn point(&self) -> Option<Vector3<f64>> {
        match self {
            Self::InverseDepth(y) => {
                (y[5] > 1.0 / FARTHEST).then(|| anchor(y) + inverse_depth::ray(y[3], y[4]) / y[5])
            }
            Self::Point(p) => Some(*p),
        }
    }

    /// Derivative of the point with respect to the numbers.
    pub fn point_jacobian(&self) -> SMatrix<f64, 3, 6> {
        let mut j = SMatrix::<f64, 3, 6>::zeros();
        j.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        if let Self::InverseDepth(y) = self {
            let rho = y[5];
            let (dt, dp) = inverse_depth::ray_jacobian(y[3], y[4]);
            j.set_column(3, &(dt / rho));
            j.set_column(4, &(dp / rho));
            j.set_column(5, &(-inverse_depth::ray(y[3], y[4]) / (rho * rho)));
        }
        j
    }

    /// The vector from `r` to the point times [`Self::scale`], in W (Eq. 7 without its rotation), and its derivative by
    /// the numbers: finite for points at infinity.
    pub fn scaled_from(&self, r: &Vector3<f64>) -> (Vector3<f64>, SMatrix<f64, 3, 6>) {
        let mut by = SMatrix::<f64, 3, 6>::zeros();
        match self {
            Self::InverseDepth(y) => {
                let (rho, offset) = (y[5], anchor(y) - r);
                let (dt, dp) = inverse_depth::ray_jacobian(y[3], y[4]);
                by.fixed_view_mut::<3, 3>(0, 0)
                    .copy_from(&(Matrix3::identity() * rho));
                by.set_column(3, &dt);
                by.set_column(4, &dp);
                by.set_column(5, &offset);
                (offset * rho + inverse_depth::ray(y[3], y[4]), by)
            }
            Self::Point(p) => {
                by.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
                (p - r, by)
            }
        }
    }

    /// How far the point's depth is from linear in the pixels of a camera at `r`, with this covariance of the numbers:
    /// `L_d = 4 sigma_d |cos alpha| / d`, `sigma_d` being the depth's standard deviation from the anchor, `alpha` the
    /// parallax between anchor and camera, `d` the range from the camera (Civera, Davison, Montiel, T-RO 2008).
    /// `None` for what has no such index: a point, and a feature with no point or at the camera.
    pub fn linearity_index(&self, covariance: &Matrix6<f64>, r: &Vector3<f64>) -> Option<f64> {
        let (Self::InverseDepth(y), Some(point)) = (self, self.point()) else {
            return None;
        };
        let sigma = covariance[(5, 5)].max(0.0).sqrt() / (y[5] * y[5]);
        let (from_camera, ray) = (point - r, inverse_depth::ray(y[3], y[4]));
        let range = from_camera.norm();
        let index = 4.0 * sigma * (from_camera.dot(&ray) / range).abs() / range;
        index.is_finite().then_some(index)
    }
}

fn anchor(y: &Vector6<f64>) -> Vector3<f64> {
    y.fixed_rows::<3>(0).into_owned()
}
