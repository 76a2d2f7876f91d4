//! Range by the law of sines from two views (METHOD 5 and 6): the one function behind delayed births, instant
//! births and stochastic triangulation.
//!
//! With the ray `a` from Cs, the ray `b` from the other view (rotated into C: `b'`), and the other view's pose
//! `(R, t)` relative to Cs, the law of sines `s = |t| sin(gamma) / sin(alpha)` reads
//! `rho = |a x b'| / |t x b'|`: the point on Cs's ray, whatever the vertical disparity.

use crate::camera::Camera;
use crate::math::{pose::Pose, quat};
use nalgebra::{Matrix3, RowVector2, RowVector3, SMatrix, Vector2, Vector3};

/// Inverse range and its derivatives.
#[derive(Clone, Debug)]
pub struct TwoView {
    /// Unit ray in Cs.
    pub ray: Vector3<f64>,
    /// Its derivative by `(u1, v1)`.
    pub ray_by_pixel: SMatrix<f64, 3, 2>,
    /// Inverse range from Cs, 1/m; positive.
    pub rho: f64,
    /// Parallax `alpha`, rad.
    pub parallax: f64,
    /// d rho / d(u1, v1), pixel in Cs.
    pub rho_by_pixel: RowVector2<f64>,
    /// d rho / d(u2, v2), pixel in the other view.
    pub rho_by_other_pixel: RowVector2<f64>,
    /// d rho / d t, the other view's position in C.
    pub rho_by_t: RowVector3<f64>,
    /// d rho / d b', the other view's ray in C.
    pub rho_by_ray: RowVector3<f64>,
    /// The other view's ray in its own frame.
    pub other_ray: Vector3<f64>,
    /// Rotation of the other view in C.
    pub rotation: Matrix3<f64>,
}

impl TwoView {
    /// Intersects the pixels of two views. `other_in_c` maps points of the other view into C.
    ///
    /// `None` if a pixel has no ray, the views coincide, or the rays meet behind a camera.
    pub fn new(
        camera: &Camera,
        uv: &Vector2<f64>,
        other: &Camera,
        other_uv: &Vector2<f64>,
        other_in_c: &Pose,
    ) -> Option<Self> {
        let (a, a_uv) = camera.unproject_jac(uv)?;
        let (b, b_uv) = other.unproject_jac(other_uv)?;
        let rotation = other_in_c.rotation;
        let t = other_in_c.translation;
        let b_c = rotation * b;
        let n = a.cross(&b_c);
        let k = t.cross(&b_c);
        let (n2, k2) = (n.norm_squared(), k.norm_squared());
        // s a = t + r b' gives s n = k, and r n = t x a: both ranges must be positive.
        if n2 < 1e-24 || k2 < 1e-24 || k.dot(&n) <= 0.0 || t.cross(&a).dot(&n) <= 0.0 {
            return None;
        }
        let rho = (n2 / k2).sqrt();
        let (n_hat, k_hat) = (n / n2, k / k2);
        let rho_by_a = (b_c.cross(&n_hat) * rho).transpose();
        let rho_by_ray = ((n_hat.cross(&a) - k_hat.cross(&t)) * rho).transpose();
        let rho_by_t = (-b_c.cross(&k_hat) * rho).transpose();
        Some(Self {
            ray: a,
            ray_by_pixel: a_uv,
            rho,
            parallax: n2.sqrt().atan2(a.dot(&b_c)),
            rho_by_pixel: rho_by_a * a_uv,
            rho_by_other_pixel: rho_by_ray * rotation * b_uv,
            rho_by_t,
            rho_by_ray,
            other_ray: b,
            rotation,
        })
    }

    /// d rho / d(t, q) of the other view's pose, q its quaternion in C: the last 7 of METHOD 5's 11 parameters.
    pub fn rho_by_pose(&self, q: &quat::Quat) -> SMatrix<f64, 1, 7> {
        let mut j = SMatrix::<f64, 1, 7>::zeros();
        j.fixed_view_mut::<1, 3>(0, 0).copy_from(&self.rho_by_t);
        j.fixed_view_mut::<1, 4>(0, 3)
            .copy_from(&(self.rho_by_ray * quat::rotate_jacobian(q, &self.other_ray)));
        j
    }

    /// d rho / d xi, xi the right tangent of the other view's pose.
    pub fn rho_by_tangent(&self) -> SMatrix<f64, 1, 6> {
        let mut j = SMatrix::<f64, 1, 6>::zeros();
        j.fixed_view_mut::<1, 3>(0, 0)
            .copy_from(&(self.rho_by_t * self.rotation));
        j.fixed_view_mut::<1, 3>(0, 3).copy_from(
            &(self.rho_by_ray * -(self.rotation * quat::skew(&self.other_ray))),
        );
        j
    }

    /// Variance of rho from the pixels alone.
    pub fn rho_variance_from_pixels(&self, sigma_px: f64, other_sigma_px: f64) -> f64 {
        self.rho_by_pixel.norm_squared() * sigma_px * sigma_px
            + self.rho_by_other_pixel.norm_squared() * other_sigma_px * other_sigma_px
    }

    /// The point on Cs's ray, metres in C.
    pub fn point(&self) -> Vector3<f64> {
        self.ray / self.rho
    }

    /// Its covariance from the pixels alone (METHOD 6: T_CF's part is kept apart).
    pub fn point_noise(&self, sigma_px: f64, other_sigma_px: f64) -> Matrix3<f64> {
        let by_rho = -self.ray / (self.rho * self.rho);
        let by_pixel = self.ray_by_pixel / self.rho + by_rho * self.rho_by_pixel;
        let by_other = by_rho * self.rho_by_other_pixel;
        by_pixel * by_pixel.transpose() * (sigma_px * sigma_px)
            + by_other * by_other.transpose() * (other_sigma_px * other_sigma_px)
    }

    /// Its derivative by the right tangent of the other view's pose (METHOD 6: `J_T`), 3x6.
    pub fn point_by_tangent(&self) -> SMatrix<f64, 3, 6> {
        -self.ray / (self.rho * self.rho) * self.rho_by_tangent()
    }
}
