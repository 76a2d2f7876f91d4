//! The worn camera in one frame: the error of its pose in the state, and what both views see (METHOD 5, 6, 9).

use super::length::taken;
use super::other_time::{ByMotion, TimeCompensated};
use crate::birth::two_view::TwoView;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{WornObservation, WornPair};
use crate::guard::check_pose;
use crate::math::pose::Pose;
use crate::observe::shutter::Unrolled;
use crate::observe::shutter::down_the_image;
use crate::overlap::{Overlap, predict_overlap};
use crate::settings::WornErrors;
use crate::state::{BlockKind, ErrorOwner, Learned, LinearPart, State, TimeCorrelatedBias, root};
use nalgebra::{Matrix6, Vector2, Vector6};

/// How fast a worn camera moves and turns on each axis, m/s and rad/s, standard deviations: of somebody who walks and looks about.
const WORN_SPEED: [f64; 2] = [1.0, 1.0];

/// By how much a worn camera moves on each axis while an image of it is read, which takes `readout` seconds: standard deviations,
/// metres and radians.
pub(super) fn roll_sds(readout: f64) -> Vector6<f64> {
    let [way, turn] = WORN_SPEED.map(|sd| sd * readout);
    Vector6::new(way, way, way, turn, turn, turn)
}

fn roll_covariance(readout: f64) -> Matrix6<f64> {
    Matrix6::from_diagonal(&roll_sds(readout).map(|sd| sd * sd))
}

/// What the error of a view's T_CF comes from, all in the tangent of F.
pub(crate) struct WornErrorParts {
    /// Derivatives by what lasts of it, six numbers of the state at these offsets.
    time_correlated: Vec<(usize, Matrix6<f64>)>,
    /// Derivative by the logarithm of its lengths, one number of the state at this offset.
    length: Option<(usize, Vector6<f64>)>,
    /// Derivatives by how Cs moved.
    motion: ByMotion,
    /// Derivative by what all views of the frame have in common, in standard deviations.
    pub(super) common: Matrix6<f64>,
    /// Covariance of the rest.
    pub(crate) white: Matrix6<f64>,
}

impl WornErrorParts {
    /// Its mean: what has been learned of the part that lasts.
    pub(crate) fn mean(&self, state: &State) -> Vector6<f64> {
        let time_correlated = self.time_correlated.iter();
        let sum = time_correlated.map(|(offset, by)| by * state.part::<6>(*offset));
        sum.fold(Vector6::zeros(), |a, b| a + b)
    }

    /// What lasts of it, but for the clock.
    pub(super) fn time_correlated_parts(&self) -> impl Iterator<Item = LinearPart<'_>> {
        self.time_correlated.iter().map(|(offset, by)| LinearPart {
            offset: *offset,
            width: 6,
            matrix: by.as_slice(),
        })
    }

    /// What its lengths have to do with it.
    fn length_part(&self) -> Option<LinearPart<'_>> {
        self.length.as_ref().map(|(offset, by)| LinearPart {
            offset: *offset,
            width: 1,
            matrix: by.as_slice(),
        })
    }

    /// What is in the state, but for the common part.
    pub(super) fn linear_parts(&self) -> impl Iterator<Item = LinearPart<'_>> {
        let parts = self.time_correlated_parts();
        parts.chain(self.length_part()).chain(self.motion.parts())
    }
}

/// Turns what is along C's axes into F's.
pub(super) fn into_f(
    worn: &WornObservation,
    compensated: Option<&TimeCompensated>,
) -> Matrix6<f64> {
    let rotation = taken(worn, compensated).rotation;
    let mut j = Matrix6::zeros();
    for at in [0, 3] {
        j.fixed_view_mut::<3, 3>(at, at)
            .copy_from(&rotation.transpose());
    }
    j
}

impl Filter {
    /// Appends the frame's error of T_CF, `xi = J (b + B c) + white`, and what the motion of Cs adds where that was `compensated`
    /// here from another time. The bias `b` is along C's axes: its causes lie along the way that both cameras travel, so it
    /// must not turn with F's axes when the wearer's head does. `c` is what all worn cameras have in common of theirs.
    pub(crate) fn open_worn_error(
        &mut self,
        worn: &WornObservation,
        compensated: Option<&TimeCompensated>,
    ) {
        let share = self.setup.settings.worn.common_share;
        let bias_covariance = self.bias_covariance(&worn.covariance, worn.bias.as_ref());
        let j = into_f(worn, compensated);
        let is_known = self
            .memory
            .state
            .time_correlated_error(worn.who)
            .next()
            .is_some();
        if bias_covariance.diagonal().max() > 0.0 && !is_known {
            let stationary = j.transpose() * bias_covariance * j;
            let stationary = (stationary + stationary.transpose()) * 0.5;
            if share > 0.0 {
                self.memory
                    .state
                    .begin_time_correlated(TimeCorrelatedBias::common());
            }
            let own = TimeCorrelatedBias::of(worn.who, &stationary, share);
            self.memory.state.begin_time_correlated(own);
        }
        self.open_length(worn, compensated);
        let error = self.error_of(worn, compensated);
        let mut parts: Vec<LinearPart<'_>> = error.linear_parts().collect();
        if share > 0.0 {
            let kind = BlockKind::WornError(ErrorOwner::Common);
            let there = self
                .memory
                .state
                .worn_error_block(ErrorOwner::Common)
                .copied();
            let block = there.unwrap_or_else(|| {
                let one = Matrix6::identity();
                self.memory.state.append(kind, &Vector6::zeros(), &[], &one)
            });
            parts.push(LinearPart {
                offset: block.offset,
                width: 6,
                matrix: error.common.as_slice(),
            });
        }
        let kind = BlockKind::WornError(ErrorOwner::Of(worn.who));
        let mean = error.mean(&self.memory.state);
        self.memory.state.append(kind, &mean, &parts, &error.white);
        if self.setup.settings.worn.readout > 0.0 {
            let kind = BlockKind::WornRoll(worn.who);
            let roll = roll_covariance(self.setup.settings.worn.readout);
            self.memory
                .state
                .append(kind, &Vector6::zeros(), &[], &roll);
        }
    }

    /// How far down the image of a worn camera a pixel's row is, where the state has how that camera moved meanwhile.
    pub(crate) fn worn_roll(&self, who: usize, uv_f: &Vector2<f64>) -> Option<f64> {
        let camera = self.setup.worn_cameras.get(who)?;
        let rolls = self.memory.state.has_worn_roll(who);
        rolls.then(|| down_the_image(uv_f, f64::from(camera.height)))
    }

    /// Lists what a view's update may learn of what lasts of the error of its T_CF: all but the length of the baseline, of its own
    /// part and of the common one together.
    pub(crate) fn learn(
        &self,
        worn: &WornObservation,
        compensated: Option<&TimeCompensated>,
        learned: &mut Learned,
    ) {
        let t_cf = taken(worn, compensated).retract(&self.memory.state.worn_error(worn.who));
        let Some(along) = t_cf.translation.try_normalize(0.0) else {
            return;
        };
        if self.worn_error_offset(worn.who).is_none() {
            return;
        }
        let mut across = Matrix6::identity();
        let mut shift = across.fixed_view_mut::<3, 3>(0, 0);
        shift -= along * along.transpose();
        for (offset, by) in self.memory.state.time_correlated_error(worn.who) {
            if let Some(back) = by.try_inverse() {
                learned.of.push((offset, back * across * by));
            }
        }
    }

    /// What lasts of the error of a T_CF where that is said: by the view, or of all views by a `worn.bias_share` of 0.
    pub(super) fn stated_bias(&self, bias: Option<&Matrix6<f64>>) -> Option<Matrix6<f64>> {
        let nothing_lasts = self.setup.settings.worn.bias_share <= 0.0;
        bias.copied().or_else(|| nothing_lasts.then(Matrix6::zeros))
    }

    /// The same, `worn.bias_share` of the covariance where nobody says.
    pub(super) fn bias_covariance(
        &self,
        covariance: &Matrix6<f64>,
        bias: Option<&Matrix6<f64>>,
    ) -> Matrix6<f64> {
        self.stated_bias(bias)
            .unwrap_or_else(|| covariance * self.setup.settings.worn.bias_share)
    }

    /// What the error of a view's T_CF comes from.
    pub(crate) fn error_of(
        &self,
        worn: &WornObservation,
        compensated: Option<&TimeCompensated>,
    ) -> WornErrorParts {
        let share = self.setup.settings.worn.common_share;
        let j = into_f(worn, compensated);
        let time_correlated = self.memory.state.time_correlated_error(worn.who);
        let time_correlated: Vec<_> = time_correlated
            .map(|(offset, by)| (offset, j * by))
            .collect();
        let mut white = if time_correlated.is_empty() {
            worn.covariance
        } else {
            worn.covariance - self.bias_covariance(&worn.covariance, worn.bias.as_ref())
        };
        let mut common = Matrix6::zeros();
        if share > 0.0 {
            common = root(&white) * j * share.sqrt();
            white *= 1.0 - share;
        }
        let mut motion = ByMotion::default();
        if let Some(compensated) = compensated {
            motion.clone_from(&compensated.by);
            white += compensated.noise;
        }
        WornErrorParts {
            time_correlated,
            length: self.length_of(worn, compensated),
            motion,
            common,
            white,
        }
    }

    pub(crate) fn worn_error_offset(&self, who: usize) -> Option<usize> {
        let block = self.memory.state.worn_error_block(ErrorOwner::Of(who));
        block.map(|b| b.offset)
    }

    pub(crate) fn worn_covariance(&self, worn: &WornObservation) -> Matrix6<f64> {
        match (
            self.worn_error_offset(worn.who),
            self.setup.settings.worn.errors,
        ) {
            (Some(offset), _) => self.memory.state.p.block::<6, 6>(offset, offset),
            (None, WornErrors::Pixels) => Matrix6::zeros(),
            (None, _) => worn.covariance,
        }
    }

    /// Covariance of what the error modes of the map and of the lengths of T_CF have put into the error of T_CF that the frame
    /// found: before, they had but the lengths' part in it.
    pub(crate) fn worn_error_of_map(
        &self,
        worn: &WornObservation,
        compensated: Option<&TimeCompensated>,
    ) -> Matrix6<f64> {
        let offset = self.worn_error_offset(worn.who);
        let before = self.length_of(worn, compensated);
        offset.map_or_else(Matrix6::zeros, |at| {
            self.memory.state.put_by_modes(at, before)
        })
    }

    pub(crate) fn intersect(
        &self,
        worn: &WornObservation,
        uv: &Vector2<f64>,
        uv_f: &Vector2<f64>,
    ) -> Option<TwoView> {
        let worn_camera = self.setup.worn_cameras.get(worn.who)?;
        let mut error = self.memory.state.worn_error(worn.who);
        if let Some((roll, share)) = self.told_roll(worn).zip(self.worn_roll(worn.who, uv_f)) {
            error += self.memory.state.part::<6>(roll) * share;
        }
        let t_cf = worn.t_cf.retract(&error);
        TwoView::new(&self.setup.camera, uv, worn_camera, uv_f, &t_cf)
    }

    /// As [`Self::intersect`], of the pixel in Cs without the shutter's rolling.
    pub(crate) fn intersect_unrolled(
        &self,
        worn: &WornObservation,
        pair: &WornPair,
    ) -> Option<(TwoView, Unrolled)> {
        let uv = pair.uv?;
        let raw = self.intersect(worn, &uv, &pair.uv_f)?;
        let unrolled = self.unrolled(&uv, raw.rho);
        if unrolled.by_motion.is_none() {
            return Some((raw, unrolled));
        }
        // Once more with the range that the pixels have without the rolling.
        let view = self.intersect(worn, &unrolled.uv, &pair.uv_f)?;
        let unrolled = self.unrolled(&uv, view.rho);
        let view = self.intersect(worn, &unrolled.uv, &pair.uv_f)?;
        Some((view, unrolled))
    }

    /// Variance of the inverse range of a point that both cameras see, Cf at `uv_f`.
    pub(crate) fn rho_variance(
        &self,
        worn: &WornObservation,
        view: &TwoView,
        uv_f: &Vector2<f64>,
    ) -> f64 {
        let j = view.rho_by_tangent();
        let rolled = self.worn_roll(worn.who, uv_f).map_or(0.0, |share| {
            let roll = self.told_roll(worn).map_or_else(
                || roll_covariance(self.setup.settings.worn.readout),
                |offset| self.memory.state.p.block::<6, 6>(offset, offset),
            );
            (j * roll * j.transpose())[(0, 0)] * share * share
        });
        let pixels = view.rho_variance_from_pixels(
            self.setup.settings.pixel.sigma_cs,
            self.setup.settings.pixel.sigma_cf,
        );
        pixels + rolled + (j * self.worn_covariance(worn) * j.transpose())[(0, 0)].max(0.0)
    }

    /// Whether Cs and the worn camera `who` look at the same place, and where in both images (METHOD 9).
    ///
    /// # Errors
    /// `InvalidInput` without a camera model of Cf or for an impossible pose or covariance, `NonFinite`.
    pub fn overlap(
        &self,
        t_cf: &Pose,
        covariance: &Matrix6<f64>,
        who: usize,
    ) -> Result<Option<Overlap>, EkfError> {
        let worn = self.setup.worn_model(who)?;
        check_pose(t_cf, covariance)?;
        let sigma_px = self.setup.settings.pixel.sigma_cf;
        let settings = &self.setup.settings.overlap;
        Ok(predict_overlap(
            &self.setup.camera,
            worn,
            t_cf,
            covariance,
            sigma_px,
            settings,
        ))
    }
}
