//! The view that starts a map: its births are linearised where it puts its own error of T_CF (METHOD 6).
//!
//! The inverse range of a point near the line through both cameras is far from linear in the direction of that line, and what the
//! images say of it moves it by as much as T_CF is unsure of it. Taken at the measured T_CF, births so have a scale that is off by
//! what they claim to know of it twice and more. Later births have an estimate of the error from the views before; the first ones
//! find it here: the view is measured on a copy, several times, each time from where the last one put its error.

use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{Measurements, UpdateReport};
use crate::filter::input::sources::{Scratch, WornForm};
use crate::filter::input::told_error::ToldError;
use crate::filter::worn::other_time::TimeCompensated;
use nalgebra::Vector6;

/// How often the view is measured to find it. With Cf a third of a metre ahead, known to 3 cm, the fifth step is a hundredth of a
/// standard deviation.
const ROUNDS: usize = 5;

impl Filter {
    /// The error of T_CF that the first view of a filter that has not started puts there; `None` where it tells none, or
    /// cannot be measured at one of those on the way: it is then taken at the measured T_CF.
    pub(super) fn told_by_first_view(
        &self,
        z: &Measurements,
        compensated: Option<&TimeCompensated>,
        form: WornForm,
    ) -> Option<Vector6<f64>> {
        let worn = z.first_view()?;
        if self.memory.started || form != WornForm::Tight {
            return None;
        }
        let mut told = None;
        for _ in 0..ROUNDS {
            let (mut trial, mut report) = (self.clone(), UpdateReport::default());
            let (used, scratch) = (&mut Vec::new(), &mut Scratch::default());
            let done = trial.measure_view_at(z, compensated, told, used, &mut report, scratch);
            if !matches!(done, Ok(true)) {
                return None;
            }
            told = Some(trial.memory.state.worn_error(worn.who));
        }
        told
    }

    /// Takes the view's error of T_CF to where it is told; its births follow.
    pub(super) fn linearise_at(&mut self, told: &Vector6<f64>, who: usize) {
        if let Some(at) = self.worn_error_offset(who) {
            let step = told - self.memory.state.part::<6>(at);
            self.memory.state.set_part(at, told);
            self.workspace.told = Some(ToldError::new(at, step));
        }
    }

    /// Takes both back by the same steps, once the update is done.
    pub(super) fn take_back_told(&mut self) {
        if let Some(told) = self.workspace.told.take() {
            let mean = self.memory.state.part::<6>(told.at) - told.step;
            self.memory.state.set_part(told.at, &mean);
            for (offset, step) in told.births {
                self.memory.state.x[offset] -= step;
            }
        }
    }
}
