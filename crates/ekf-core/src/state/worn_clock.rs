//! The worn cameras' clocks in the state, and what the views so far tell of each (METHOD 21, 26).

use super::{Block, BlockKind, State};
use crate::math::numbers;
use nalgebra::{Matrix6, SMatrix, Vector6};
use serde::{Deserialize, Serialize};

/// Information with which the mean begins, 1/m^2 and 1/rad^2: none to speak of, so that it can be solved for.
const NO_WEIGHT: f64 = 1e-6;

/// What the views of a worn camera tell of its clock whatever else, that lasts, is wrong with its T_CF (METHOD 26): only that by
/// which T_CF is off for each second changes from view to view.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ToldOfClock {
    /// Mean over the views of what T_CF is off by for each second of the clock, along C's axes, m/s and rad/s.
    #[serde(with = "numbers")]
    pub(crate) mean: Vector6<f64>,
    /// Information of all views about a time-correlated error of T_CF.
    #[serde(with = "numbers")]
    weight: Matrix6<f64>,
    /// Information about the clock, 1/s^2.
    pub(crate) information: f64,
}

impl ToldOfClock {
    fn nothing() -> Self {
        Self {
            mean: Vector6::zeros(),
            weight: Matrix6::identity() * NO_WEIGHT,
            information: 0.0,
        }
    }

    /// Weight of a view with that information over that of the mean, 1 at most.
    pub(crate) fn share_of_one(&self, told: &Matrix6<f64>) -> f64 {
        (told.trace() / self.weight.trace()).clamp(0.0, 1.0)
    }

    /// Counts a view: what T_CF is off by there for each second, how much of that is clearly another than the mean, and the
    /// view's information about an error of T_CF; all along C's axes.
    pub(crate) fn add(
        &mut self,
        by_second: &Vector6<f64>,
        clear: &Vector6<f64>,
        told: &Matrix6<f64>,
    ) {
        let all = self.weight + told;
        let Some(cholesky) = all.cholesky() else {
            return;
        };
        // What is left of both informations where the mean and the view are uncertain.
        let left = cholesky.solve(&(told * clear)).dot(&(self.weight * clear));
        self.information += left.max(0.0);
        self.mean += cholesky.solve(&(told * (by_second - self.mean)));
        self.weight = all;
    }

    /// The time-correlated error of T_CF is another one from now on: views of before are not a measure of it.
    pub(crate) fn begin_anew(&mut self) {
        let information = self.information;
        *self = Self {
            information,
            ..Self::nothing()
        };
    }

    /// What lasts of T_CF's error keeps this share of itself.
    pub(crate) fn forget(&mut self, share: f64) {
        let share = share * share;
        self.weight = self.weight * share + Matrix6::identity() * (NO_WEIGHT * (1.0 - share));
        self.information *= share;
    }
}

impl State {
    /// Appends the clock of the next worn camera: estimate and standard deviation, seconds.
    pub(crate) fn append_worn_clock(&mut self, (clock, sd): (f64, f64)) {
        let (mean, variance) = (SMatrix::from([[clock]]), SMatrix::from([[sd * sd]]));
        let kind = BlockKind::WornClock(self.clocks.len());
        self.append(kind, &mean, &[], &variance);
        self.clocks.push(ToldOfClock::nothing());
    }

    /// The block of a worn camera's clock, unless that is exact.
    pub(crate) fn worn_clock_block(&self, who: usize) -> Option<&Block> {
        self.layout.of_kind(BlockKind::WornClock(who)).next()
    }

    /// Estimate of a worn camera's clock and its variance, s and s^2.
    pub(crate) fn worn_clock(&self, who: usize) -> Option<(f64, f64)> {
        let at = self.worn_clock_block(who)?.offset;
        Some((self.x[at], self.p.get(at, at).max(0.0)))
    }
}
