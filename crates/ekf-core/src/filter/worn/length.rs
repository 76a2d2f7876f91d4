//! How well the lengths of T_CF are known for good (METHOD 6).

use super::other_time::TimeCompensated;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::WornObservation;
use crate::gauge::{DriftNoise, SCALE};
use crate::math::pose::Pose;
use crate::state::BlockKind;
use nalgebra::{DMatrix, DVector, Vector6};

/// Share of the variance of a length that may lack before it is filled up: what the error modes lose where they are put together.
const LACKING: f64 = 0.1;

/// T_CF at the time that its view was taken.
pub(super) fn taken<'a>(
    worn: &'a WornObservation,
    compensated: Option<&'a TimeCompensated>,
) -> &'a Pose {
    compensated.map_or(&worn.t_cf, |compensated| &compensated.taken)
}

/// Derivative of T_CF, in the tangent of F, by the logarithm of its lengths.
fn by_length(t_cf: &Pose) -> Vector6<f64> {
    let along = t_cf.rotation.transpose() * t_cf.translation;
    Vector6::new(along.x, along.y, along.z, 0.0, 0.0, 0.0)
}

impl Filter {
    /// Takes it that all lengths of T_CF of the worn camera `who` may be off by the standard deviation `sd` of their logarithm, for
    /// good: views have shown that they have changed, or that the map's have. So may what is in view, which follows them.
    ///
    /// # Errors
    /// `InvalidInput` for an unknown worn camera and for an `sd` that is no number from 0 to 1; nothing is changed then.
    pub fn doubt_length(&mut self, who: usize, sd: f64) -> Result<(), EkfError> {
        self.setup.worn_model(who)?;
        if !(0.0..=1.0).contains(&sd) {
            return Err(EkfError::InvalidInput {
                what: "sd of the lengths of T_CF",
                why: format!("{sd} is not a number from 0 to 1"),
            });
        }
        let doubted = self.memory.length_sds.entry(who).or_default();
        if sd <= *doubted {
            return Ok(());
        }
        *doubted = sd;
        let Some((slot, lacks)) = self.length_lacks(who, sd * sd) else {
            return Ok(());
        };
        let noise = DriftNoise {
            turn: 0.0,
            translation: 0.0,
            scale: lacks,
        };
        let (state, followed) = (&self.memory.state, self.memory.followed.ids());
        let known = self.memory.map_transfer.known;
        let modes = self
            .workspace
            .gauge
            .drift_noise(state, &noise, followed, known);
        let n = state.p.stored().n;
        let mut column = modes[SCALE * n..][..n].to_vec();
        column[slot] = lacks;
        self.memory.add_error_modes(&column);
        Ok(())
    }

    /// Puts the error of a worn camera's lengths into the state where it has been doubted, and where it is said what lasts of the error
    /// of T_CF (`stated_bias`) and less of its length than any device can know of it, `worn.length_sd`. P holds it as known; it stands in
    /// an error mode of its own, so that it is told, and the estimate stays what it is.
    pub(super) fn open_length(
        &mut self,
        worn: &WornObservation,
        compensated: Option<&TimeCompensated>,
    ) {
        let by = by_length(taken(worn, compensated));
        let squared = by.norm_squared();
        if squared <= 0.0 {
            return;
        }
        let least = self.setup.settings.worn.length_sd.powi(2);
        let stated = self
            .stated_bias(worn.bias.as_ref())
            .map_or(least, |bias| by.dot(&(bias * by)) / squared.powi(2));
        let doubted = self.memory.length_sds.get(&worn.who).copied();
        let lasting = (least - stated).max(doubted.unwrap_or_default().powi(2));
        if let Some((slot, lacks)) = self.length_lacks(worn.who, lasting) {
            let mut column = vec![0.0; self.memory.state.p.stored().n];
            column[slot] = lacks;
            self.memory.add_error_modes(&column);
        }
    }

    /// Where in the state the logarithm of the lengths is, where they may be off, and the derivative of a view's T_CF by it.
    pub(super) fn length_of(
        &self,
        worn: &WornObservation,
        compensated: Option<&TimeCompensated>,
    ) -> Option<(usize, Vector6<f64>)> {
        let kind = BlockKind::WornLength(worn.who);
        let block = self.memory.state.layout.of_kind(kind).next()?;
        Some((block.offset, by_length(taken(worn, compensated))))
    }

    /// Where in P the error of a worn camera's lengths is stored, and the standard deviation that lacks to a variance that it should
    /// have; `None` where nothing does.
    fn length_lacks(&mut self, who: usize, lasting: f64) -> Option<(usize, f64)> {
        if lasting <= 0.0 {
            return None;
        }
        let state = &mut self.memory.state;
        let kind = BlockKind::WornLength(who);
        let there = state.layout.of_kind(kind).next().copied();
        let none = DMatrix::zeros(1, 1);
        let block = there.unwrap_or_else(|| state.append(kind, &DVector::zeros(1), &[], &none));
        let lacks = lasting - state.told().get(block.offset, block.offset);
        let slot = state.p.stored().slots[block.offset];
        (lacks > LACKING * lasting).then(|| (slot, lacks.sqrt()))
    }
}
