//! The worn cameras' clocks: when the views tell one, whatever else, that lasts, is wrong with its T_CF (METHOD 26).

use super::error::into_f;
use super::other_time::TimeCompensated;
use crate::chi2;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{Capture, WornObservation};
use crate::state::{Learned, LinearPart, State};
use nalgebra::{Matrix6, SMatrix, Vector6};

/// A direction is told by information of that much over what was thought possible: its standard deviation shrinks to a third.
pub const TOLD_INFORMATION: f64 = 8.0;
/// How often its noise the twist must be for a view to teach the clock, as with odometry's scales (METHOD 23): by noise alone a
/// clock seems less off than it is, by one over the square of it, which is 2 ms of 50.
const CLEAR: f64 = 5.0;

/// What is known of T_CF's error before a view.
pub(crate) struct ViewPrior {
    /// Its covariance, tangent of F.
    whole: Matrix6<f64>,
    /// That of its part that lasts.
    time_correlated: Matrix6<f64>,
}

impl ViewPrior {
    /// Whether the noise of what T_CF is off by for each second is small beside it, both as the rest of the view's error weighs them.
    fn is_clear(&self, compensated: &TimeCompensated) -> bool {
        let (Some(clock), Some(cholesky)) = (
            compensated.by.clock(),
            (self.whole - self.time_correlated).cholesky(),
        ) else {
            return false;
        };
        let by_second = Vector6::from_column_slice(clock.matrix);
        let noise = cholesky.solve(&compensated.clock_noise).trace();
        by_second.dot(&cholesky.solve(&by_second)) > CLEAR * CLEAR * noise
    }
}

impl Filter {
    /// By how much the images of the worn camera `who` were taken after their stamps, by the clock of Cs, and the standard
    /// deviation of that, seconds; `None` where the clock is exact (`worn.clock_sd`), or there is no such camera.
    pub fn worn_clock(&self, who: usize) -> Option<(f64, f64)> {
        let (mean, variance) = self.memory.state.worn_clock(who)?;
        Some((mean, variance.sqrt()))
    }

    /// Puts another filter's estimates of the clocks in the place of those that there are; for a filter without map.
    pub(crate) fn set_worn_clocks(&mut self, other: &Self) {
        for who in 0..self.memory.state.clocks.len() {
            let block = self.memory.state.worn_clock_block(who).copied();
            if let (Some(block), Some((mean, variance))) =
                (block, other.memory.state.worn_clock(who))
            {
                self.memory
                    .state
                    .set_part(block.offset, &SMatrix::from([[mean]]));
                self.memory.state.reference[block.offset] = mean;
                self.memory
                    .state
                    .p
                    .set(block.offset, block.offset, variance);
            }
        }
    }

    /// Lets a view teach its clock where the views so far tell it, and its twist is clear.
    pub(crate) fn learn_clock(
        &self,
        worn: &WornObservation,
        compensated: Option<&TimeCompensated>,
        before: Option<&ViewPrior>,
        learned: &mut Learned,
    ) {
        let possible = self.setup.settings.worn.clock_sd.powi(2);
        let told = self.memory.state.clocks.get(worn.who);
        let is_told = told.is_some_and(|told| told.information * possible > TOLD_INFORMATION);
        let (Some(before), Some(compensated), true) = (before, compensated, is_told) else {
            return;
        };
        if let Some(clock) = compensated
            .by
            .clock()
            .filter(|_| before.is_clear(compensated))
        {
            learned.number(clock.offset);
        }
    }

    /// What is known before a view, whose error of T_CF is in the state; `None` where the clock is exact or means nothing yet.
    pub(crate) fn view_prior(
        &self,
        worn: &WornObservation,
        compensated: Option<&TimeCompensated>,
    ) -> Option<ViewPrior> {
        let clock = compensated?.by.clock()?;
        let error = self.error_of(worn, compensated);
        let time_correlated: Vec<LinearPart<'_>> =
            error.time_correlated_parts().chain([clock]).collect();
        Some(ViewPrior {
            whole: of_error(&self.memory.state, self.worn_error_offset(worn.who)?),
            time_correlated: self
                .memory
                .state
                .covariance_of(&time_correlated, &Matrix6::zeros()),
        })
    }

    /// Counts a view that has been measured for what it tells of the clock.
    ///
    /// With P the covariance of the frame's error before its pixels and T what they took off it, these are as good as a
    /// measurement of that error with information Q (1 - P Q)^-1, Q = P^-1 T P^-1, and so as one of its time-correlated part, of
    /// covariance L, with Q (1 - L Q)^-1.
    pub(crate) fn count_for_clock(
        &mut self,
        worn: &WornObservation,
        compensated: &TimeCompensated,
        before: &ViewPrior,
    ) -> Option<()> {
        let capture = Capture {
            frame: self.memory.time?,
            ..self.capture_of(worn)?
        };
        let ViewPrior {
            whole,
            time_correlated,
        } = before;
        let taken = whole - of_error(&self.memory.state, self.worn_error_offset(worn.who)?);
        let inverse = whole.cholesky()?.inverse();
        let q = inverse * taken * inverse;
        let told = q * (Matrix6::identity() - time_correlated * q).try_inverse()?;
        let there = self.interpolated_pose(capture, worn.who).ok()?;
        // From F's axes into C's.
        let j = into_f(worn, Some(compensated));
        let told = j.transpose() * told * j;
        let by_twist = j.transpose() * compensated.taken.inverse().adjoint();
        let by_second = by_twist * there.twist;
        let spread = by_twist * there.twist_noise * by_twist.transpose();
        let clock = self.memory.state.clocks.get_mut(worn.who)?;
        let change = by_second - clock.mean;
        // Of the mean, which has more weight, there is less.
        let noise = spread * (1.0 + clock.share_of_one(&told));
        let mut clear = change;
        for at in [0, 3] {
            if !stands_out(&change, &noise, at) {
                clear.fixed_rows_mut::<3>(at).fill(0.0);
            }
        }
        clock.add(&by_second, &clear, &((told + told.transpose()) * 0.5));
        Some(())
    }
}

/// Whether the three numbers of a change at `at` are beyond its noise.
fn stands_out(change: &Vector6<f64>, noise: &Matrix6<f64>, at: usize) -> bool {
    let change = change.fixed_rows::<3>(at).into_owned();
    let noise = noise.fixed_view::<3, 3>(at, at).into_owned();
    let size = noise
        .cholesky()
        .map(|noise| change.dot(&noise.solve(&change)));
    size.is_some_and(|size| size > chi2::quantile(chi2::SURE_LEVEL, 3.0))
}

fn of_error(state: &State, at: usize) -> Matrix6<f64> {
    state.p.block::<6, 6>(at, at)
}
