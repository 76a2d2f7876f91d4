//! Rigid poses with METHOD 1's tangent: `T = T_hat Exp(xi)`, `xi = (translation, rotation)`, on the right.
//!
//! The two halves act separately: `(R, t) Exp(v, w) = (R Exp(w), t + R v)`.

use super::numbers;
use super::quat::{self, Quat};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3, Vector6};
use serde::{Deserialize, Serialize};

/// 6x7 map from an increment of `(r, q)` to the right tangent `(v, w)`.
pub type TangentMap = SMatrix<f64, 6, 7>;

/// A rigid transform `p -> rotation p + translation`, metres.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Pose {
    /// Rotation matrix.
    #[serde(with = "numbers")]
    pub rotation: Matrix3<f64>,
    /// Translation, metres.
    #[serde(with = "numbers")]
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

    /// `Exp((v, w)) = [R(w), v; 0, 1]`, metres and radians: the pose that [`Self::retract`] appends to another.
    pub fn exp(xi: &Vector6<f64>) -> Self {
        Self {
            rotation: quat::rotation_exp(&xi.fixed_rows::<3>(3).into_owned()),
            translation: xi.fixed_rows::<3>(0).into_owned(),
        }
    }

    /// The `xi` with `Exp(xi)` this pose, its rotation vector no longer than pi.
    pub fn log(&self) -> Vector6<f64> {
        let (v, w) = (&self.translation, quat::rotation_log(&self.rotation));
        Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
    }

    /// `self other`: of `T_AB` and `T_BC` it makes `T_AC`.
    pub fn compose(&self, other: &Self) -> Self {
        Self {
            rotation: self.rotation * other.rotation,
            translation: self.apply(&other.translation),
        }
    }

    /// The matrix that carries a small tangent vector through the pose: `T Exp(xi) T^-1 = Exp(adjoint(T) xi)` to first
    /// order, so it makes a left perturbation of a right one.
    pub fn adjoint(&self) -> Matrix6<f64> {
        let mut out = self.turn();
        out.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(quat::skew(&self.translation) * self.rotation));
        out
    }

    /// A covariance of this pose `T_AB` over the right tangent (m^2, rad^2), along the fixed axes of A instead:
    /// `diag(R, R) P diag(R, R)^T`, as in ROS's `PoseWithCovariance`.
    pub fn covariance_along_fixed_axes(&self, tangent: &Matrix6<f64>) -> Matrix6<f64> {
        let turn = self.turn();
        turn * tangent * turn.transpose()
    }

    /// The inverse of [`Self::covariance_along_fixed_axes`].
    pub fn covariance_along_tangent(&self, fixed: &Matrix6<f64>) -> Matrix6<f64> {
        let turn = self.turn();
        turn.transpose() * fixed * turn
    }

    /// The pose at `share` of the way to another, 0 for this and 1 for the other: straight in translation, at a constant
    /// rate in rotation.
    pub fn interpolate(&self, other: &Self, share: f64) -> Self {
        let step = quat::rotation_log(&(self.rotation.transpose() * other.rotation));
        Self {
            rotation: self.rotation * quat::rotation_exp(&(step * share)),
            translation: self.translation * (1.0 - share) + other.translation * share,
        }
    }

    /// `diag(R, R)`.
    fn turn(&self) -> Matrix6<f64> {
        let mut turn = Matrix6::zeros();
        for at in [0, 3] {
            turn.fixed_view_mut::<3, 3>(at, at)
                .copy_from(&self.rotation);
        }
        turn
    }

    /// `self Exp(xi)`.
    pub fn retract(&self, xi: &Vector6<f64>) -> Self {
        let (v, w) = (
            xi.fixed_rows::<3>(0).into_owned(),
            xi.fixed_rows::<3>(3).into_owned(),
        );
        Self {
            rotation: self.rotation * quat::rotation_exp(&w),
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
