//! The worn camera in one frame: the error of its pose in the state, and what both views see (METHOD 5, 6, 9).

use super::ekf::Filter;
use super::measurements::WornObservation;
use super::other_time::Carried;
use crate::birth::two_view::TwoView;
use crate::error::EkfError;
use crate::guard::check_pose;
use crate::math::pose::Pose;
use crate::overlap::{Overlap, predict_overlap};
use crate::settings::WornErrors;
use crate::state::{BlockKind, LinearPart};
use nalgebra::{Matrix6, Vector2, Vector6};

impl Filter {
    /// Appends the frame's error of T_CF, `xi = J b + white`, and what the motion of Cs adds where that was `carried` here from
    /// another time. The bias `b` is along C's axes: its causes lie along the way that both cameras travel, so it must not
    /// turn with F's axes when the wearer's head does.
    pub(super) fn open_worn_error(&mut self, worn: &WornObservation, carried: Option<&Carried>) {
        let share = self.settings.worn.bias_share;
        let bias_covariance = worn.bias.unwrap_or(worn.covariance * share);
        let rotation = carried.map_or(worn.t_cf.rotation, |carried| carried.taken);
        let mut j = Matrix6::zeros();
        for at in [0, 3] {
            j.fixed_view_mut::<3, 3>(at, at)
                .copy_from(&rotation.transpose());
        }
        if bias_covariance.diagonal().max() > 0.0 && self.state.worn_bias().is_none() {
            let stationary = j.transpose() * bias_covariance * j;
            self.state.bias_stationary = (stationary + stationary.transpose()) * 0.5;
            let stationary = self.state.bias_stationary;
            self.state
                .append::<6>(BlockKind::WornBias, &Vector6::zeros(), &[], &stationary);
        }
        let bias = self.state.worn_bias();
        let mut parts: Vec<LinearPart<'_>> = bias
            .iter()
            .map(|b| LinearPart {
                offset: b.offset,
                width: 6,
                matrix: j.as_slice(),
            })
            .collect();
        let mut white = match bias {
            Some(_) => worn.covariance - bias_covariance,
            None => worn.covariance,
        };
        if let Some(carried) = carried {
            parts.extend(carried.linear_parts());
            white += carried.noise;
        }
        self.state
            .append::<6>(BlockKind::WornError, &Vector6::zeros(), &parts, &white);
    }

    pub(super) fn worn_error_offset(&self) -> Option<usize> {
        self.state
            .layout
            .of_kind(BlockKind::WornError)
            .next()
            .map(|b| b.offset)
    }

    pub(super) fn worn_covariance(&self, worn: &WornObservation) -> Matrix6<f64> {
        match (self.worn_error_offset(), self.settings.worn.errors) {
            (Some(offset), _) => self.state.p.block::<6, 6>(offset, offset),
            (None, WornErrors::Pixels) => Matrix6::zeros(),
            (None, _) => worn.covariance,
        }
    }

    pub(super) fn intersect(
        &self,
        worn: &WornObservation,
        uv: &Vector2<f64>,
        uv_f: &Vector2<f64>,
    ) -> Option<TwoView> {
        let worn_camera = self.worn_camera.as_ref()?;
        let t_cf = worn.t_cf.retract(&self.state.worn_error());
        TwoView::new(&self.camera, uv, worn_camera, uv_f, &t_cf)
    }

    pub(super) fn rho_variance(&self, worn: &WornObservation, view: &TwoView) -> f64 {
        let j = view.rho_by_tangent();
        let pixels = view
            .rho_variance_from_pixels(self.settings.pixel.sigma_cs, self.settings.pixel.sigma_cf);
        pixels + (j * self.worn_covariance(worn) * j.transpose())[(0, 0)].max(0.0)
    }

    /// Whether Cs and Cf look at the same place, and where in both images (METHOD 9).
    ///
    /// # Errors
    /// `InvalidInput` without a camera model of Cf or for an impossible pose or covariance, `NonFinite`.
    pub fn overlap(
        &self,
        t_cf: &Pose,
        covariance: &Matrix6<f64>,
    ) -> Result<Option<Overlap>, EkfError> {
        let worn = self.worn_model()?;
        check_pose(t_cf, covariance)?;
        let sigma_px = self.settings.pixel.sigma_cf;
        let settings = &self.settings.overlap;
        Ok(predict_overlap(
            &self.camera,
            worn,
            t_cf,
            covariance,
            sigma_px,
            settings,
        ))
    }
}
