//! Checks of input, all made before anything changes.

use super::ekf::Filter;
use super::input::measurements::{Capture, Followed, Measurements};
use super::input::sources::Scratch;
use crate::error::EkfError;
use crate::guard;
use crate::guard::{check_once, check_pixels};
use crate::math::pose::Pose;
use nalgebra::Matrix6;

impl Filter {
    /// Whether a view of Cf can be measured; what is refused here is refused by [`Filter::update`].
    ///
    /// `covariance` is that of `t_cf`, 6x6, (translation, rotation), m^2 and rad^2, right tangent; `bias` the part of it
    /// that lasts from frame to frame, `who` the worn camera's number.
    ///
    /// # Errors
    /// [`EkfError`] if the filter has no camera model of that Cf, or if a number cannot be what it stands for.
    pub fn check_worn(
        &self,
        t_cf: &Pose,
        covariance: &Matrix6<f64>,
        bias: Option<&Matrix6<f64>>,
        who: usize,
    ) -> Result<(), EkfError> {
        self.setup.check_worn(t_cf, covariance, bias, who)
    }

    /// Whether a depth with this standard deviation, metres, can be measured; what is refused here is refused by
    /// [`Filter::update`].
    ///
    /// # Errors
    /// `InvalidInput` or `NonFinite` if a number cannot be what it stands for.
    pub fn check_depth(depth: f64, sigma: f64) -> Result<(), EkfError> {
        guard::depth(depth, sigma)
    }

    pub(super) fn check_measurements(
        &self,
        z: &Measurements,
        scratch: &mut Scratch,
    ) -> Result<(), EkfError> {
        let pairs = || z.views.iter().flat_map(|worn| &worn.pairs);
        let pixels = z.bearings.iter().map(|b| &b.uv);
        let pixels = pixels.chain(pairs().flat_map(|p| p.uv.iter().chain([&p.uv_f])));
        check_pixels(pixels.chain(z.depths.iter().map(|d| &d.uv)))?;
        if pairs().any(|p| p.id.is_none() && p.uv.is_none()) {
            return Err(EkfError::InvalidInput {
                what: "worn pair",
                why: "a new point has no pixel in Cs; give both pixels, or the feature that it is"
                    .into(),
            });
        }
        if z.max_speed.is_some_and(|most| most.is_nan() || most < 0.0) {
            return Err(EkfError::InvalidInput {
                what: "max_speed",
                why: "it is negative or not a number; give metres a second, or none".into(),
            });
        }
        z.followed.as_ref().map_or(Ok(()), Followed::check)?;
        let bearings = || z.bearings.iter().map(|b| b.id);
        let depths = || z.depths.iter().filter_map(|d| d.id);
        let searched = z.searched.iter().copied();
        let of_pairs = pairs().filter_map(|p| p.id);
        for id in bearings().chain(of_pairs).chain(depths()).chain(searched) {
            self.memory.known(id)?;
        }
        check_once("bearings", bearings(), &mut scratch.ids)?;
        let of_first = z.pairs().iter().filter_map(|p| p.id);
        check_once(
            "worn pairs and depths",
            of_first.chain(depths()),
            &mut scratch.ids,
        )?;
        for depth in &z.depths {
            guard::depth(depth.depth, depth.sigma)?;
        }
        for worn in z.views.iter().skip(1) {
            let ids = worn.pairs.iter().filter_map(|p| p.id);
            check_once("worn pairs", ids, &mut scratch.ids)?;
            if let (Some(capture), Some(frame)) = (worn.capture, self.memory.time) {
                self.compensated_t_cf(&worn.t_cf, Capture { frame, ..capture }, worn.who)?;
            }
        }
        let views = z.views.iter().map(|worn| worn.who as u64);
        check_once("worn views", views, &mut scratch.ids)?;
        for worn in &z.views {
            self.check_worn(&worn.t_cf, &worn.covariance, worn.bias.as_ref(), worn.who)?;
            worn.rate.as_ref().map_or(Ok(()), Self::check_gyro)?;
        }
        Ok(())
    }
}
