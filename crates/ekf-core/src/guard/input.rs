//! Measured numbers: finite, of plausible sizes, and valid as a pixel, a depth, a rotation or a covariance.

use crate::error::EkfError;
use crate::guard;
use crate::math::pose::Pose;
use crate::math::quat;
use crate::observe::feature::FARTHEST;
use nalgebra::{DMatrix, Matrix6, SMatrix, Vector2};

/// Largest coordinate of a pixel, pixels.
pub const LARGEST_PIXEL: f64 = 1e6;

/// Largest variance that is given with a measurement, m^2 or rad^2: a standard deviation of a kilometre.
const LARGEST_VARIANCE: f64 = 1e6;

/// Least depth that is measured, metres, and its least standard deviation: nothing nearer is seen, nothing finer known.
pub(super) const LEAST_DEPTH: f64 = 1e-3;

const LEAST_DEPTH_SD: f64 = 1e-6;

/// A finite pixel, within the size of the largest image.
pub(crate) fn pixel(uv: &Vector2<f64>) -> Result<(), EkfError> {
    let largest = uv.abs().max();
    if !(uv.x.is_finite() && uv.y.is_finite()) {
        return Err(EkfError::NonFinite { what: "pixel" });
    }
    if largest > LARGEST_PIXEL {
        let why = format!("{largest} px is far out of any image; give pixels of the image");
        return Err(EkfError::InvalidInput { what: "pixel", why });
    }
    Ok(())
}

pub(crate) fn check_pixels<'a>(
    mut pixels: impl Iterator<Item = &'a Vector2<f64>>,
) -> Result<(), EkfError> {
    pixels.try_for_each(guard::pixel)
}

/// Lengths in metres, finite already, within [`FARTHEST`].
pub(crate) fn lengths<'a>(
    what: &'static str,
    mut values: impl Iterator<Item = &'a f64>,
) -> Result<(), EkfError> {
    match values.find(|v| v.abs() > FARTHEST) {
        Some(v) => {
            let why = format!("{v} m is beyond any map; give metres");
            Err(EkfError::InvalidInput { what, why })
        }
        None => Ok(()),
    }
}

/// Variances of measured poses, points and depths (m^2 or rad^2), within [`LARGEST_VARIANCE`].
pub(crate) fn variances<'a>(
    what: &'static str,
    mut values: impl Iterator<Item = &'a f64>,
) -> Result<(), EkfError> {
    match values.find(|v| v.abs() > LARGEST_VARIANCE) {
        Some(v) => {
            let why = format!("a variance of {v} says nothing; leave such a measurement out");
            Err(EkfError::InvalidInput { what, why })
        }
        None => Ok(()),
    }
}

/// A depth and its standard deviation, metres.
pub(crate) fn depth(depth: f64, sigma: f64) -> Result<(), EkfError> {
    lengths("depth", [depth, sigma].iter())?;
    variances("depth", [sigma * sigma].iter())?;
    if depth >= LEAST_DEPTH && sigma >= LEAST_DEPTH_SD {
        return Ok(());
    }
    Err(EkfError::InvalidInput {
        what: "depth",
        why: format!(
            "{depth} +- {sigma} m; both must be positive metres, the depth at least {LEAST_DEPTH}, the standard \
             deviation at least {LEAST_DEPTH_SD}"
        ),
    })
}

/// Each feature once.
pub(crate) fn check_once(
    what: &'static str,
    ids: impl Iterator<Item = u64>,
    sorted: &mut Vec<u64>,
) -> Result<(), EkfError> {
    sorted.clear();
    sorted.extend(ids);
    sorted.sort_unstable();
    if sorted.windows(2).all(|w| w[0] != w[1]) {
        return Ok(());
    }
    Err(EkfError::InvalidInput {
        what,
        why: "an id stands twice; give each feature or candidate one measurement".into(),
    })
}

/// A rotation matrix, a position and a symmetric positive semi-definite covariance, all finite.
pub(crate) fn check_pose(pose: &Pose, covariance: &Matrix6<f64>) -> Result<(), EkfError> {
    if !covariance.iter().all(|x| x.is_finite()) {
        return Err(EkfError::NonFinite {
            what: "T_CF or its covariance",
        });
    }
    check_rigid("T_CF", pose)?;
    guard::variances("covariance of T_CF", covariance.iter())?;
    if !is_covariance(covariance) {
        return Err(EkfError::InvalidInput {
            what: "covariance of T_CF",
            why: "it is not symmetric positive semi-definite".into(),
        });
    }
    Ok(())
}

/// A covariance that is a part of that of T_CF: what it leaves has no negative variance beyond rounding.
pub(crate) fn check_bias(bias: &Matrix6<f64>, covariance: &Matrix6<f64>) -> Result<(), EkfError> {
    let what = "bias of T_CF";
    if !bias.iter().all(|x| x.is_finite()) {
        return Err(EkfError::NonFinite { what });
    }
    let rest = covariance - bias;
    let rounding = Matrix6::identity() * (1e-12 * covariance.abs().max());
    if is_covariance(bias) && is_covariance(&((rest + rest.transpose()) * 0.5 + rounding)) {
        return Ok(());
    }
    Err(EkfError::InvalidInput {
        what,
        why: "it must be symmetric positive semi-definite and a part of the covariance, here one of both has a \
              negative variance; give a smaller bias or a larger covariance"
            .into(),
    })
}

/// A rotation matrix and a position, all finite.
pub(crate) fn check_rigid(what: &'static str, pose: &Pose) -> Result<(), EkfError> {
    let mut numbers = pose.rotation.iter().chain(pose.translation.iter());
    if !numbers.all(|x| x.is_finite()) {
        return Err(EkfError::NonFinite { what });
    }
    guard::lengths(what, pose.translation.iter())?;
    if !quat::is_rotation(&pose.rotation, 1e-6) {
        return Err(EkfError::InvalidInput {
            what,
            why: "its upper left 3x3 is not a rotation matrix".into(),
        });
    }
    Ok(())
}

/// Whether a finite matrix is symmetric and positive semi-definite, up to rounding.
pub(crate) fn is_covariance<const N: usize>(m: &SMatrix<f64, N, N>) -> bool {
    let scale = m.abs().max();
    let eigenvalues = DMatrix::from_column_slice(N, N, m.as_slice()).symmetric_eigenvalues();
    (m - m.transpose()).abs().max() <= 1e-9 * scale && eigenvalues.min() >= -1e-9 * scale
}
