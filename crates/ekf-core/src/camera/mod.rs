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
//! Not handled: rolling shutter, skew, and fields of view of 180 degrees and more.

mod fisheye;
mod radtan;
mod warp;
mod wideangle;

use nalgebra::{Matrix2x3, Matrix3, Matrix3x2, Vector2, Vector3};

use crate::error::EkfError;

/// Least depth in front of the camera that projects, metres.
const MIN_DEPTH: f64 = 1e-6;

/// Lens distortion of a [`Camera`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Distortion {
    /// None: a pinhole.
    None,
    /// OpenCV's radial-tangential model, `[k1, k2, p1, p2, k3]`, dimensionless.
    RadTan([f64; 5]),
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
            // Given back as most calibrations write it: k3 only where there is one.
            Self::RadTan(k) if k[4] == 0.0 => &k[..4],
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

/// Least focal length, and largest focal length and coordinate of the principal point, pixels.
const LEAST_FOCAL: f64 = 1e-3;
const LARGEST_PIXEL: f64 = 1e7;
/// Largest distortion parameter, whose products with pixels stay finite.
const LARGEST_DISTORTION: f64 = 1e6;

impl Camera {
    /// Checks a calibration and builds the camera.
    ///
    /// `model` is `"pinhole"`, `"radtan"`, `"fisheye"` or `"wideangle"`; `intrinsics` is `(fx, fy, cx, cy)` in pixels;
    /// `distortion` holds nothing, `k1 k2 p1 p2 [k3]`, `k1 k2 k3 k4` or `K`.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown model, an empty image or numbers that are no camera's, `NonFinite` for
    /// infinite or missing numbers, `BadShape` for the wrong number of distortion parameters.
    pub fn new(
        model: &str,
        width: u32,
        height: u32,
        intrinsics: [f64; 4],
        distortion: &[f64],
    ) -> Result<Self, EkfError> {
        let distortion = match (model, distortion) {
            ("pinhole", []) => Distortion::None,
            ("radtan", &[k1, k2, p1, p2]) => Distortion::RadTan([k1, k2, p1, p2, 0.0]),
            ("radtan", &[k1, k2, p1, p2, k3]) => Distortion::RadTan([k1, k2, p1, p2, k3]),
            ("fisheye", &[k1, k2, k3, k4]) => Distortion::Fisheye([k1, k2, k3, k4]),
            ("wideangle", &[k]) => Distortion::WideAngle(k),
            ("pinhole" | "radtan" | "fisheye" | "wideangle", given) => {
                return Err(EkfError::BadShape {
                    what: "camera distortion",
                    expected: match model {
                        "pinhole" => "no parameters for pinhole".into(),
                        "radtan" => "4 or 5 parameters for radtan".into(),
                        "fisheye" => "4 parameters for fisheye".into(),
                        _ => "1 parameter for wideangle".into(),
                    },
                    got: given.len().to_string(),
                });
            }
            (other, _) => {
                return Err(EkfError::InvalidInput {
                    what: "camera model",
                    why: format!(
                        "`{other}` is not known; use pinhole, radtan, fisheye or wideangle"
                    ),
                });
            }
        };
        Self::with_distortion(width, height, intrinsics, distortion)
    }

    /// As [`Camera::new`], from a [`Distortion`] value.
    ///
    /// # Errors
    /// As [`Camera::new`].
    pub fn with_distortion(
        width: u32,
        height: u32,
        intrinsics: [f64; 4],
        distortion: Distortion,
    ) -> Result<Self, EkfError> {
        let [fx, fy, cx, cy] = intrinsics;
        if !intrinsics.iter().all(|value| value.is_finite()) {
            return Err(EkfError::NonFinite {
                what: "camera intrinsics",
            });
        }
        let parameters = distortion.parameters();
        if !parameters.iter().all(|value| value.is_finite()) {
            return Err(EkfError::NonFinite {
                what: "camera distortion",
            });
        }
        if parameters.iter().any(|v| v.abs() > LARGEST_DISTORTION) {
            return Err(EkfError::InvalidInput {
                what: "camera distortion",
                why: format!(
                    "{parameters:?} are no lens's; give the parameters of the calibration"
                ),
            });
        }
        if fx <= 0.0 || fy <= 0.0 {
            return Err(EkfError::InvalidInput {
                what: "camera intrinsics",
                why: format!("focal lengths must be positive, got fx = {fx}, fy = {fy}"),
            });
        }
        let sizes = intrinsics.map(f64::abs);
        if fx < LEAST_FOCAL || fy < LEAST_FOCAL || sizes.iter().any(|v| *v > LARGEST_PIXEL) {
            return Err(EkfError::InvalidInput {
                what: "camera intrinsics",
                why: format!("{intrinsics:?} are no camera's; give (fx, fy, cx, cy) in pixels"),
            });
        }
        if width == 0 || height == 0 {
            return Err(EkfError::InvalidInput {
                what: "camera image size",
                why: format!("width and height must be positive, got {width} x {height}"),
            });
        }
        let limit = match &distortion {
            Distortion::RadTan(k) => radtan::radius_squared_limit(k),
            Distortion::Fisheye(k) => fisheye::angle_limit(k),
            Distortion::None | Distortion::WideAngle(_) => f64::INFINITY,
        };
        Ok(Self {
            width,
            height,
            fx,
            fy,
            cx,
            cy,
            distortion,
            limit,
        })
    }

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

/// Smallest positive root of `c[0] + c[1] s + c[2] s^2 + ...` with `c[0] > 0`; infinite if there is none.
///
/// Between two neighbouring critical points a polynomial is monotone, so its sign changes bracket the roots: the
/// critical points come from the same search one degree lower.
fn smallest_positive_root(c: &[f64]) -> f64 {
    positive_roots(c).first().copied().unwrap_or(f64::INFINITY)
}

/// Positive roots with a sign change, in increasing order.
fn positive_roots(c: &[f64]) -> Vec<f64> {
    let degree = match c.iter().rposition(|&value| value != 0.0) {
        Some(degree) if degree > 0 => degree,
        _ => return Vec::new(),
    };
    let c = &c[..=degree];
    let value = |s: f64| c.iter().rev().fold(0.0, |sum, &a| sum * s + a);
    let derivative: Vec<f64> = (1..=degree).map(|i| i as f64 * c[i]).collect();
    // Cauchy's bound on the roots.
    let bound = 1.0
        + c[..degree]
            .iter()
            .fold(0.0_f64, |m, a| m.max((a / c[degree]).abs()));
    let mut ends = positive_roots(&derivative);
    ends.retain(|&s| s < bound);
    ends.push(bound);
    let mut roots = Vec::new();
    let mut low = 0.0;
    for &end in &ends {
        let (mut a, mut b) = (low, end);
        let sign = value(a) >= 0.0;
        if (value(b) >= 0.0) != sign {
            for _ in 0..2000 {
                let mid = 0.5 * (a + b);
                if mid <= a || mid >= b {
                    break;
                }
                if (value(mid) >= 0.0) == sign {
                    a = mid;
                } else {
                    b = mid;
                }
            }
            roots.push(a);
        }
        low = end;
    }
    roots
}

/// Solves `f(r) = target` for `r` in `[0, limit]`, where `f` (returned with its derivative) grows from `f(0) = 0`.
///
/// Newton's iteration kept inside a shrinking bracket. `None` if `target` is out of reach.
fn invert_growing(f: impl Fn(f64) -> (f64, f64), target: f64, limit: f64) -> Option<f64> {
    let (mut low, mut high) = (0.0, limit);
    if !high.is_finite() {
        high = 1.0_f64.max(target);
        while f(high).0 < target {
            high *= 2.0;
            if high > 1e12 {
                return None;
            }
        }
    } else if f(high).0 < target {
        return None;
    }
    let mut r = target.clamp(low, high);
    for _ in 0..200 {
        let (value, slope) = f(r);
        let error = value - target;
        if error.abs() <= 1e-15 * (1.0 + target) {
            return Some(r);
        }
        if error > 0.0 {
            high = r;
        } else {
            low = r;
        }
        let newton = r - error / slope;
        let next = if newton > low && newton < high {
            newton
        } else {
            0.5 * (low + high)
        };
        if next == r {
            return Some(r);
        }
        r = next;
    }
    ((f(r).0 - target).abs() <= 1e-12 * (1.0 + target)).then_some(r)
}
