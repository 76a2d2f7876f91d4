//! What may enter the filter: finite numbers of plausible sizes, and updates after which P is still a covariance.
//!
//! All checks come before any change. The bounds are far beyond any use, and far within f64: products of
//! three such numbers are finite, so what passes here cannot turn into an infinity later.

mod input;
mod state;

pub use input::LARGEST_PIXEL;
pub(crate) use input::{
    check_bias, check_once, check_pixels, check_pose, check_rigid, depth, is_covariance, lengths,
    pixel, variances,
};
pub(crate) use state::{
    ROUNDING, attitude_is_sane, moved_is_sane, newborn_is_located, newborn_is_sane, prediction,
    state_is_sane, update_is_sane,
};
