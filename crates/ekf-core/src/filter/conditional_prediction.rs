//! Conditional prediction: where features are expected once others of the same frame have been found (METHOD 7, between
//! steps 2 and 3).
//!
//! Most of a pixel's predicted uncertainty is that of the camera's motion since the last frame, which all features share.
//! A few features that were found reveal it; conditional on them, the innovation of another feature `i` has the mean
//! `S_iT S_TT^-1 g_T` and the covariance `S_ii - S_iT S_TT^-1 S_Ti`: both stand in the factor of their joint S.

use super::ekf::Filter;
use super::measurements::{Bearing, Measurements};
use super::sources::Scratch;
use crate::error::EkfError;
use crate::validate;
use nalgebra::{Matrix2, Vector2};

/// Where a feature is expected given others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConditionalPrediction {
    /// Pixel in Cs.
    pub uv: Vector2<f64>,
    /// Its innovation covariance, measurement noise included, px^2.
    pub s: Matrix2<f64>,
}

impl Filter {
    /// Where the features `ids` are expected given those that were found; `None` for one that predicts nothing.
    ///
    /// Of those found only the ones that agree with each other tell (HOHCT, METHOD 8): none if most of them do not. A test
    /// of each against one other would not do: right after a start one match leaves turn and way of the camera open, and
    /// half of the wrong ones agree with it. All are `None` if the joint covariance is not positive definite. The state
    /// stays as it is.
    ///
    /// # Errors
    /// `NonFinite`, `UnknownFeature`, `InvalidInput` (an id given twice, also in both lists).
    pub fn predict_conditional(
        &mut self,
        found: &[Bearing],
        ids: &[u64],
    ) -> Result<Vec<Option<ConditionalPrediction>>, EkfError> {
        let wanted = ids.iter().map(|&id| Bearing {
            id,
            uv: Vector2::zeros(),
        });
        let z = Measurements {
            bearings: found.iter().copied().chain(wanted).collect(),
            ..Measurements::default()
        };
        let mut scratch = Scratch::default();
        self.check_measurements(&z, &mut scratch)?;
        self.changes();
        self.fetch(&z, &mut scratch.ids);
        let (found, wanted) = z.bearings.split_at(found.len());
        self.batch.clear();
        let mut push = |bearing: &Bearing| {
            let block = self.bearing(bearing);
            block.map(|block| self.batch.push(block)).is_ok()
        };
        let others = found.iter().filter(|bearing| push(bearing)).count();
        let visible: Vec<bool> = wanted.iter().map(push).collect();
        self.batch.build(&self.state);
        let nothing = || Ok(vec![None; ids.len()]);
        if self.batch.factor().is_err() {
            return nothing();
        }
        let batch = &self.batch;
        let offsets = &batch.offsets()[..=others];
        validate::hohct(
            batch.s(),
            batch.l(),
            batch.rows(),
            &batch.g()[..offsets[others]],
            validate::Blocks::new(offsets),
            &validate::HohctSettings::default(),
            &mut self.test,
        );
        let told = 2 * (others - self.test.rejected().len());
        self.batch.leave_out(self.test.rejected());
        if self.batch.factor().is_err() {
            return nothing();
        }
        let mut row = told;
        let expected = visible.into_iter().map(|visible| {
            visible.then(|| {
                row += 2;
                self.expectation(row - 2, told)
            })
        });
        Ok(expected.collect())
    }

    /// Of the feature whose rows of the factored batch begin at `row`, given the first `told` rows.
    fn expectation(&self, row: usize, told: usize) -> ConditionalPrediction {
        let batch = &self.batch;
        let ld = batch.rows();
        let predicted = -Vector2::new(batch.g()[row], batch.g()[row + 1]);
        let own = |i: usize, j: usize| batch.s()[row + i.max(j) + (row + i.min(j)) * ld];
        let mut expected = ConditionalPrediction {
            uv: predicted,
            s: Matrix2::from_fn(own),
        };
        for (k, whitened) in batch.whitened().iter().take(told).enumerate() {
            let share = Vector2::new(batch.l()[row + k * ld], batch.l()[row + 1 + k * ld]);
            expected.uv += share * *whitened;
            expected.s -= share * share.transpose();
        }
        expected
    }
}
