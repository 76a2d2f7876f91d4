//! Rigid poses with METHOD 1's tangent: `T = T_hat Exp(xi)`, `xi = (translation, rotation)`, on the right.
//!
//! The two halves act separately: `(R, t) Exp(v, w) = (R Exp(w), t + R v)`.

use super::quat::{self, Quat};
use nalgebra::{Matrix3, SMatrix, Vector3, Vector6};

/// 6x7 map from an increment of `(r, q)` to the right tangent `(v, w)`.
pub type TangentMap = SMatrix<f64, 6, 7>;

/// A rigid transform `p -> rotation p + translation`, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Pose {
    /// Rotation matrix.
    pub rotation: Matrix3<f64>,
    /// Translation, metres.
    pub translation: Vector3<f64>,
}

impl Pose {
    /// The identity.
    pub fn identity() -> Self {
        Self {
            rotation: Matrix3::identity(),
            translation: Vector3::zeros(),
        }
    }

    /// From a translation and a quaternion.
    pub fn from_quat(translation: Vector3<f64>, q: &Quat) -> Self {
        Self {
            rotation: quat::rotation(q),
            translation,
        }
    }

    /// `self Exp(xi)`.
    pub fn retract(&self, xi: &Vector6<f64>) -> Self {
        let (v, w) = (
            xi.fixed_rows::<3>(0).into_owned(),
            xi.fixed_rows::<3>(3).into_owned(),
        );
        Self {
            rotation: self.rotation * quat::rotation(&quat::exp(&w)),
            translation: self.translation + self.rotation * v,
        }
    }

    /// The transform of a point.
    pub fn apply(&self, p: &Vector3<f64>) -> Vector3<f64> {
        self.rotation * p + self.translation
    }

    /// The inverse transform.
    pub fn inverse(&self) -> Self {
        let rt = self.rotation.transpose();
        Self {
            rotation: rt,
            translation: -(rt * self.translation),
        }
    }
}

/// Map from increments of the state's `(r, q)` to the right tangent of the pose: P's 7x7 block becomes
/// the 6x6 that is reported (METHOD 1).
pub fn tangent_map(q: &Quat) -> TangentMap {
    let mut g = TangentMap::zeros();
    g.fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&quat::rotation(q).transpose());
    g.fixed_view_mut::<3, 4>(3, 3).copy_from(&quat::tangent(q));
    g
}
