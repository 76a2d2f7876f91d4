//! Conditional prediction: where features are expected once others of the same frame have been found (METHOD 7, between
//! steps 2 and 3).
//!
//! Most of a pixel's predicted uncertainty is that of the camera's motion since the last frame, which all features share.
//! A few features that were found reveal it: given them the mean is `x + P H_T^T S_TT^-1 g_T`, from which another feature
//! `i` is projected, and its innovation has the covariance `S_ii - S_iT S_TT^-1 S_Ti`.

use super::visibility::appearance;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{Bearing, Measurements};
use crate::filter::input::sources::Scratch;
use crate::validate;
use nalgebra::{Matrix2, Vector2};

/// What features that were found say of others.
#[derive(Clone, Debug, PartialEq)]
pub struct ConditioningSet {
    /// Of each that was found: whether it agrees with the rest.
    pub agree: Vec<bool>,
    /// Of each that was asked for; `None` for one that predicts nothing.
    pub expected: Vec<Option<ConditionalPrediction>>,
}

/// Where a feature is expected given others.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ConditionalPrediction {
    /// Pixel in Cs.
    pub uv: Vector2<f64>,
    /// Its innovation covariance, measurement noise included, px^2.
    pub s: Matrix2<f64>,
}

/// Times that the mean given those found is worked out, each at the mean of the time before: they reveal motions that are
/// far from linear in the image, as a way of a metre past a point at seven, or a turn of ten degrees.
const ROUNDS: usize = 2;

impl Filter {
    /// Where the features `ids` are expected given those that were found, and which of these agree.
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
    ) -> Result<ConditioningSet, EkfError> {
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
        let mut z = z;
        for bearing in &mut z.bearings[found.len()..] {
            self.expect_row(bearing);
        }
        let (found, wanted) = z.bearings.split_at(found.len());
        let prior = self.memory.state.x.clone();
        let told = self.told_by(found, wanted, &prior);
        self.memory.state.x = prior;
        Ok(told)
    }

    /// Puts a bearing that is still to be found where it is predicted: its row counts.
    fn expect_row(&self, bearing: &mut Bearing) {
        if let (Some(_), Ok(block)) = (self.shutter(), self.memory.feature_block(bearing.id)) {
            let (pose, feature) = (
                self.memory.state.camera_pose(),
                self.memory.state.feature(&block),
            );
            if let Some(seen) = appearance(&self.setup.camera, &pose, &feature, f64::NEG_INFINITY) {
                bearing.uv = seen.uv;
            }
        }
    }

    /// As [`Self::predict_conditional`]; leaves the mean where those found put it.
    fn told_by(&mut self, found: &[Bearing], wanted: &[Bearing], prior: &[f64]) -> ConditioningSet {
        let mut told = ConditioningSet {
            agree: vec![false; found.len()],
            expected: vec![None; wanted.len()],
        };
        for round in 0..ROUNDS {
            let asked = if round + 1 < ROUNDS { &[] } else { wanted };
            let Some((rows, visible)) = self.agreement(found, asked, prior, &mut told.agree) else {
                return told;
            };
            self.move_by_first(rows, prior);
            let mut row = rows;
            for ((expected, bearing), visible) in told.expected.iter_mut().zip(asked).zip(visible) {
                if visible {
                    *expected = self.expectation(bearing, row, rows);
                    row += 2;
                }
            }
        }
        told
    }

    /// Fills and factors the batch at the present mean: first those found that `agree`, which is filled in, then the
    /// wanted. Returns the rows of the former and which of the latter have any; `None` where P says nothing.
    pub(super) fn agreement(
        &mut self,
        found: &[Bearing],
        wanted: &[Bearing],
        prior: &[f64],
        agree: &mut [bool],
    ) -> Option<(usize, Vec<bool>)> {
        self.workspace.batch.clear();
        let mut push = |bearing: &Bearing| {
            let block = self.bearing(bearing);
            let block = block.map(|block| block.expected_from(&self.memory.state.x, prior));
            block.map(|block| self.workspace.batch.push(block)).is_ok()
        };
        for (agrees, bearing) in agree.iter_mut().zip(found) {
            *agrees = push(bearing);
        }
        let visible = wanted.iter().map(push).collect();
        let others = agree.iter().filter(|&&pushed| pushed).count();
        self.workspace.batch.build(&self.memory.state);
        self.workspace.batch.factor().ok()?;
        let batch = &self.workspace.batch;
        let offsets = &batch.offsets()[..=others];
        validate::hohct(
            batch.s(),
            batch.l(),
            batch.rows(),
            &batch.g()[..offsets[others]],
            validate::Blocks::new(offsets),
            &validate::HohctSettings::default(),
            &mut self.workspace.test,
        );
        let rejected = self.workspace.test.rejected();
        let pushed = agree.iter_mut().filter(|pushed| **pushed);
        for (unit, agrees) in pushed.enumerate() {
            *agrees = rejected.binary_search(&unit).is_err();
        }
        self.workspace.batch.leave_out(rejected);
        self.workspace.batch.factor().ok()?;
        Some((2 * (others - rejected.len()), visible))
    }

    /// Moves the mean to where the first `rows` rows of the factored batch put it.
    fn move_by_first(&mut self, rows: usize, prior: &[f64]) {
        let moved = self.workspace.batch.moved_by_first(rows);
        let slots = self.memory.state.p.stored().slots;
        for ((x, prior), &slot) in self.memory.state.x.iter_mut().zip(prior).zip(slots) {
            *x = prior + moved[slot];
        }
        for block in self.memory.state.layout.blocks() {
            if block.kind.is_considered() {
                self.memory.state.x[block.range()].copy_from_slice(&prior[block.range()]);
            }
        }
        let q = self.memory.state.part::<4>(3);
        self.memory.state.set_part(3, &(q / q.norm()));
    }

    /// Of the feature whose rows of the factored batch begin at `row`, given the first `told` rows and at the mean that they
    /// give.
    fn expectation(
        &self,
        bearing: &Bearing,
        row: usize,
        told: usize,
    ) -> Option<ConditionalPrediction> {
        let seen = self.bearing(bearing).ok()?.rows.innovation;
        let batch = &self.workspace.batch;
        let ld = batch.rows();
        let own = |i: usize, j: usize| batch.s()[row + i.max(j) + (row + i.min(j)) * ld];
        let mut s = Matrix2::from_fn(own);
        for k in 0..told {
            let share = Vector2::new(batch.l()[row + k * ld], batch.l()[row + 1 + k * ld]);
            s -= share * share.transpose();
        }
        let uv = bearing.uv - seen.xy();
        Some(ConditionalPrediction { uv, s })
    }
}
