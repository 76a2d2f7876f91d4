//! From the numbers of a calibration to a camera, all checked.

use super::{Camera, Distortion, fisheye, radtan};
use crate::error::EkfError;

/// Least focal length, and largest focal length and coordinate of the principal point, pixels.
const LEAST_FOCAL: f64 = 1e-3;
const LARGEST_PIXEL: f64 = 1e7;
/// Largest distortion parameter, whose products with pixels stay finite.
const LARGEST_DISTORTION: f64 = 1e6;

impl Camera {
    /// Checks a calibration and builds the camera.
    ///
    /// `model` is `"pinhole"`, `"radtan"`, `"fisheye"` or `"wideangle"`; `intrinsics` is `(fx, fy, cx, cy)` in pixels;
    /// `distortion` holds nothing, `k1 k2 p1 p2 [k3 [k4 k5 k6]]`, `k1 k2 k3 k4` or `K`.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown model, an empty image or numbers that are not a camera's, `NonFinite` for
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
            ("radtan", given @ ([_, _, _, _] | [_, _, _, _, _] | [_, _, _, _, _, _, _, _])) => {
                let mut k = [0.0; 8];
                k[..given.len()].copy_from_slice(given);
                Distortion::RadTan(k)
            }
            ("fisheye", &[k1, k2, k3, k4]) => Distortion::Fisheye([k1, k2, k3, k4]),
            ("wideangle", &[k]) => Distortion::WideAngle(k),
            ("pinhole" | "radtan" | "fisheye" | "wideangle", given) => {
                return Err(EkfError::BadShape {
                    what: "camera distortion",
                    expected: match model {
                        "pinhole" => "no parameters for pinhole".into(),
                        "radtan" => "4, 5 or 8 parameters for radtan".into(),
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
                    "{parameters:?} are not a lens's; give the parameters of the calibration"
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
                why: format!("{intrinsics:?} are not a camera's; give (fx, fy, cx, cy) in pixels"),
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
}
