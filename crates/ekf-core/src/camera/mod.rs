//! Camera models: pinhole, radial-tangential, fisheye and Davison's wide angle (METHOD section 4).
//!
//! A [`Camera`] maps a point `p_c = (x, y, z)` in its own optical frame (metres; x right, y down, z forward) to a
//! pixel `(u, v)` (pixel centres at integers, as OpenCV) and back to a unit ray, both with analytic Jacobians:
//!
//! ```text
//! (u, v) = (cx, cy) + diag(fx, fy) * distort(x / z, y / z)          None, RadTan
//! (u, v) = (cx, cy) + diag(fx, fy) * theta_d / r * (x, y)           Fisheye, theta = atan2(r, z)
//! (u, v) = (cx, cy) + distort(fx * x / z, fy * y / z)               WideAngle, works on centred pixels
//! ```
//!
//! A polynomial model is only one-to-one out to the radius where the distorted radius stops growing. Points beyond
//! that radius, and points that are not in front of the camera (`z <= 1e-6`), have no image: every method returns
//! `None` for them instead of the ghost pixel on the far side of the fold. Clipping to the image is a
//! separate question, asked with [`Camera::in_image`].
//!
//! Rows that are taken one after the other are [`Shutter`](crate::observe::Shutter)'s. Not handled: skew, and fields of view of 180 degrees and more.

mod calibration;
mod fisheye;
mod radtan;
mod roots;
mod warp;
mod wideangle;

use nalgebra::{Matrix2x3, Matrix3, Matrix3x2, Vector2, Vector3};

/// Least depth in front of the camera that projects, metres.
const MIN_DEPTH: f64 = 1e-6;

/// Lens distortion of a [`Camera`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// None: a pinhole.
    None,
    /// OpenCV's radial-tangential model, rational if any of the last three is not zero:
    /// `[k1, k2, p1, p2, k3, k4, k5, k6]`, dimensionless.
    RadTan([f64; 8]),
    /// OpenCV's fisheye (equidistant) model, `[k1, k2, k3, k4]`, dimensionless.
    Fisheye([f64; 4]),
    /// Davison's one-parameter wide-angle model: `r_u^2 (1 - 2 K r_d^2) = r_d^2` on pixels from the principal point,
    /// `K` in 1/px^2. Meant for `fx` close to `fy`.
    WideAngle(f64),
}

impl Distortion {
    fn parameters(&self) -> &[f64] {
        match self {
            Self::None => &[],
            // Given back as most calibrations write it: k3, and k4 to k6, only where there are some.
            Self::RadTan(k) if k[4..] == [0.0; 4] => &k[..4],
            Self::RadTan(k) if k[5..] == [0.0; 3] => &k[..5],
            Self::RadTan(k) => k,
            Self::Fisheye(k) => k,
            Self::WideAngle(k) => std::slice::from_ref(k),
        }
    }
}

/// Intrinsic calibration of one camera.
///
/// Made by [`Camera::new`], which checks it and finds how far the distortion model is valid.
#[derive(Clone, Debug, PartialEq)]
pub struct Camera {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Focal length along u, pixels.
    pub fx: f64,
    /// Focal length along v, pixels.
    pub fy: f64,
    /// Principal point, u, pixels.
    pub cx: f64,
    /// Principal point, v, pixels.
    pub cy: f64,
    /// Lens distortion.
    pub distortion: Distortion,
    /// Where the model folds over: `(x^2 + y^2) / z^2` for `RadTan`, the angle from the axis for `Fisheye`.
    limit: f64,
}

impl Camera {
    /// Name of the model, as [`Camera::new`] takes it.
    pub fn model(&self) -> &'static str {
        match self.distortion {
            Distortion::None => "pinhole",
            Distortion::RadTan(_) => "radtan",
            Distortion::Fisheye(_) => "fisheye",
            Distortion::WideAngle(_) => "wideangle",
        }
    }

    /// Distortion parameters, in the order [`Camera::new`] takes them.
    pub fn distortion_parameters(&self) -> &[f64] {
        self.distortion.parameters()
    }

    /// Camera matrix `[fx 0 cx; 0 fy cy; 0 0 1]`, pixels.
    pub fn matrix(&self) -> Matrix3<f64> {
        Matrix3::new(self.fx, 0.0, self.cx, 0.0, self.fy, self.cy, 0.0, 0.0, 1.0)
    }

    /// Pixel `(u, v)` of a point `p_c` in the camera frame (metres), METHOD section 4, Eq. 6.
    ///
    /// `None` when `z <= 1e-6` or the distortion model is not valid there; not clipped to the image.
    pub fn project(&self, p_c: &Vector3<f64>) -> Option<Vector2<f64>> {
        if !in_front(p_c) {
            return None;
        }
        let plane = Vector2::new(p_c.x / p_c.z, p_c.y / p_c.z);
        match &self.distortion {
            Distortion::None => Some(self.to_pixel(&plane)),
            Distortion::RadTan(k) => {
                radtan::distort(k, self.limit, &plane).map(|d| self.to_pixel(&d))
            }
            Distortion::Fisheye(k) => {
                fisheye::distort(k, self.limit, p_c).map(|d| self.to_pixel(&d))
            }
            Distortion::WideAngle(k) => {
                let centred = Vector2::new(self.fx * plane.x, self.fy * plane.y);
                wideangle::distort(*k, &centred).map(|d| Vector2::new(self.cx + d.x, self.cy + d.y))
            }
        }
    }

    /// [`Camera::project`] with its Jacobian `d(u, v) / d p_c` (2 x 3, pixels per metre).
    pub fn project_jac(&self, p_c: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2x3<f64>)> {
        if !in_front(p_c) {
            return None;
        }
        let inv_z = 1.0 / p_c.z;
        let plane = Vector2::new(p_c.x * inv_z, p_c.y * inv_z);
        // d(x/z, y/z) / d p_c
        let perspective =
            Matrix2x3::new(inv_z, 0.0, -plane.x * inv_z, 0.0, inv_z, -plane.y * inv_z);
        match &self.distortion {
            Distortion::None => Some((self.to_pixel(&plane), self.scale_rows(perspective))),
            Distortion::RadTan(k) => {
                let (d, jac) = radtan::distort_jac(k, self.limit, &plane)?;
                Some((self.to_pixel(&d), self.scale_rows(jac * perspective)))
            }
            Distortion::Fisheye(k) => {
                let (d, jac) = fisheye::distort_jac(k, self.limit, p_c)?;
                Some((self.to_pixel(&d), self.scale_rows(jac)))
            }
            Distortion::WideAngle(k) => {
                let centred = Vector2::new(self.fx * plane.x, self.fy * plane.y);
                let (d, jac) = wideangle::distort_jac(*k, &centred)?;
                let pixel = Vector2::new(self.cx + d.x, self.cy + d.y);
                Some((pixel, jac * self.scale_rows(perspective)))
            }
        }
    }

    /// Unit ray in the camera frame of a pixel `(u, v)`: the inverse of [`Camera::project`] up to range.
    ///
    /// Newton's iteration, to 1e-12 in the normalised image. `None` when the pixel lies outside what the model can reach.
    pub fn unproject(&self, uv: &Vector2<f64>) -> Option<Vector3<f64>> {
        if !(uv.x.is_finite() && uv.y.is_finite()) {
            return None;
        }
        let centred = Vector2::new(uv.x - self.cx, uv.y - self.cy);
        let distorted = Vector2::new(centred.x / self.fx, centred.y / self.fy);
        let plane = match &self.distortion {
            Distortion::None => distorted,
            Distortion::RadTan(k) => radtan::undistort(k, self.limit, &distorted)?,
            Distortion::Fisheye(k) => return fisheye::undistort(k, self.limit, &distorted),
            Distortion::WideAngle(k) => {
                let undistorted = wideangle::undistort(*k, &centred)?;
                Vector2::new(undistorted.x / self.fx, undistorted.y / self.fy)
            }
        };
        Some(Vector3::new(plane.x, plane.y, 1.0).normalize())
    }

    /// [`Camera::unproject`] with its Jacobian `d ray / d(u, v)` (3 x 2, per pixel).
    ///
    /// By the inverse function theorem: with `J` the forward Jacobian at the unit ray `h`, `J dh = d(u, v)` and, the
    /// ray staying unit, `h^T dh = 0`; so `dh` is the first two columns of the inverse of `[J; h^T]`.
    pub fn unproject_jac(&self, uv: &Vector2<f64>) -> Option<(Vector3<f64>, Matrix3x2<f64>)> {
        let ray = self.unproject(uv)?;
        let (_, jac) = self.project_jac(&ray)?;
        let square = Matrix3::from_rows(&[
            jac.row(0).into_owned(),
            jac.row(1).into_owned(),
            ray.transpose(),
        ]);
        let inverse = square.try_inverse()?;
        Some((ray, inverse.fixed_columns::<2>(0).into_owned()))
    }

    /// Whether a pixel is inside the image and at least `margin` pixels from its border pixels.
    pub fn in_image(&self, uv: &Vector2<f64>, margin: f64) -> bool {
        uv.x >= margin
            && uv.y >= margin
            && uv.x <= f64::from(self.width) - 1.0 - margin
            && uv.y <= f64::from(self.height) - 1.0 - margin
    }

    fn to_pixel(&self, plane: &Vector2<f64>) -> Vector2<f64> {
        Vector2::new(self.fx * plane.x + self.cx, self.fy * plane.y + self.cy)
    }

    fn scale_rows(&self, mut jac: Matrix2x3<f64>) -> Matrix2x3<f64> {
        for column in 0..3 {
            jac[(0, column)] *= self.fx;
            jac[(1, column)] *= self.fy;
        }
        jac
    }
}

/// False for points behind the camera, and for NaN.
fn in_front(p_c: &Vector3<f64>) -> bool {
    p_c.z > MIN_DEPTH && p_c.x.is_finite() && p_c.y.is_finite() && p_c.z.is_finite()
}
