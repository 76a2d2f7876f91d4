//! Range by the law of sines from two views (METHOD 5 and 6): the one function behind delayed births, instant
//! births and stochastic triangulation.
//!
//! With the ray `a` from Cs, the ray `b` from the other view (rotated into C: `b'`), and the other view's position
//! `t` relative to Cs: `beta` is the angle at Cs between `a` and `t`, `gamma` the one at the other view between
//! `b'` and `-t`, the parallax `alpha = pi - beta - gamma`, and `rho = sin(alpha) / (|t| sin(gamma))`.
//! Only angles to the baseline enter, so a vertical disparity (rays that pass each other) does not bias the range,
//! and rays that diverge give `rho <= 0`: then there is no intersection.

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
    /// Position of the other view in C, metres.
    pub translation: Vector3<f64>,
    linearised_at: Option<Vector3<f64>>,
}

impl TwoView {
    /// Intersects the pixels of two views. `other_in_c` maps points of the other view into C.
    ///
    /// `None` if a pixel has no ray, the views coincide, or the rays diverge.
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
        let distance = t.norm();
        if distance < 1e-9 {
            return None;
        }
        let u = t / distance;
        let (cos_beta, cos_gamma) = (a.dot(&u), -b_c.dot(&u));
        let (sin_beta, sin_gamma) = (a.cross(&u).norm(), b_c.cross(&u).norm());
        if sin_beta < 1e-9 || sin_gamma < 1e-9 {
            return None; // along the baseline there is no parallax at all
        }
        // sin(alpha) / sin(gamma), since alpha = pi - beta - gamma
        let cot_gamma = cos_gamma / sin_gamma;
        let ratio = cos_beta + sin_beta * cot_gamma;
        let rho = ratio / distance;
        if rho <= 0.0 {
            return None;
        }
        let sin_beta_by_a = (a - u * cos_beta) / sin_beta;
        let cot_by_b = (-u - (b_c + u * cos_gamma) * (cot_gamma / sin_gamma)) / sin_gamma;
        let rho_by_a = ((u + sin_beta_by_a * cot_gamma) / distance).transpose();
        let rho_by_ray = (cot_by_b * (sin_beta / distance)).transpose();
        let sin_beta_by_u = (u - a * cos_beta) / sin_beta;
        let sin_gamma_by_u = (u + b_c * cos_gamma) / sin_gamma;
        let cot_by_u = (-b_c - sin_gamma_by_u * cot_gamma) / sin_gamma;
        let ratio_by_u = a + sin_beta_by_u * cot_gamma + cot_by_u * sin_beta;
        let rho_by_t =
            ((ratio_by_u - u * ratio_by_u.dot(&u)) / distance - u * rho).transpose() / distance;
        Some(Self {
            ray: a,
            ray_by_pixel: a_uv,
            rho,
            parallax: std::f64::consts::PI - sin_beta.atan2(cos_beta) - sin_gamma.atan2(cos_gamma),
            rho_by_pixel: rho_by_a * a_uv,
            rho_by_other_pixel: rho_by_ray * rotation * b_uv,
            rho_by_t,
            rho_by_ray,
            other_ray: b,
            rotation,
            translation: t,
            linearised_at: None,
        })
    }

    /// d rho / d xi, xi the right tangent of the other view's pose.
    pub fn rho_by_tangent(&self) -> SMatrix<f64, 1, 6> {
        let mut j = SMatrix::<f64, 1, 6>::zeros();
        j.fixed_view_mut::<1, 3>(0, 0)
            .copy_from(&(self.rho_by_t * self.rotation));
        j.fixed_view_mut::<1, 3>(0, 3)
            .copy_from(&(self.rho_by_ray * -(self.rotation * quat::skew(&self.other_ray))));
        j
    }

    /// The same measurement with its point linearised at a predicted one (metres in C), which gives the range at which the
    /// pixel counts and the direction in which an error of rho moves the point. Linearised at the measured point, near errors
    /// would weigh more than far ones, and a range error times the angle to the predicted ray would look like a lateral one.
    ///
    /// Along the baseline the derivative is the secant to the predicted rho. That is exact, as rho goes as 1 / |t|; the
    /// tangent at the measured rho is steeper for short baselines and gives them too little weight.
    pub fn at_point(mut self, predicted: &Vector3<f64>) -> Self {
        let excess = self.rho - 1.0 / predicted.norm();
        self.rho_by_t += self.translation.transpose() * (excess / self.translation.norm_squared());
        self.linearised_at = Some(*predicted);
        self
    }

    /// Variance of rho from the pixels alone.
    pub fn rho_variance_from_pixels(&self, sigma_px: f64, other_sigma_px: f64) -> f64 {
        self.rho_by_pixel.norm_squared() * sigma_px * sigma_px
            + self.rho_by_other_pixel.norm_squared() * other_sigma_px * other_sigma_px
    }

    /// The point on Cs's ray, metres in C.
    pub fn point(&self) -> Vector3<f64> {
        let (range, by_rho) = self.linear_point();
        self.ray * range + by_rho * (self.rho - 1.0 / range)
    }

    /// Range at which the point is taken, and its derivative by rho there.
    fn linear_point(&self) -> (f64, Vector3<f64>) {
        match &self.linearised_at {
            Some(point) => (point.norm(), -point * point.norm()),
            None => (1.0 / self.rho, -self.ray / (self.rho * self.rho)),
        }
    }

    /// Its covariance from the pixels alone (METHOD 6: T_CF's part is kept apart).
    pub fn point_noise(&self, sigma_px: f64, other_sigma_px: f64) -> Matrix3<f64> {
        let by_pixel = self.point_by_pixel();
        let by_other = self.linear_point().1 * self.rho_by_other_pixel;
        by_pixel * by_pixel.transpose() * (sigma_px * sigma_px)
            + by_other * by_other.transpose() * (other_sigma_px * other_sigma_px)
    }

    /// Its derivative by the pixel in Cs.
    pub fn point_by_pixel(&self) -> SMatrix<f64, 3, 2> {
        let (range, by_rho) = self.linear_point();
        self.ray_by_pixel * range + by_rho * self.rho_by_pixel
    }

    /// Its derivative by the right tangent of the other view's pose (METHOD 6: `J_T`), 3x6.
    pub fn point_by_tangent(&self) -> SMatrix<f64, 3, 6> {
        self.linear_point().1 * self.rho_by_tangent()
    }
}
