//! Where a pixel of a feature whose depth is a guess is linearised (METHOD 5): at the inverse depth that the pixel tells.

use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::kernel::Panels;
use crate::observe::{FeatureState, Rows};
use crate::state::Block;
use nalgebra::{Matrix2, Vector2};

/// Steps towards the inverse depth that a pixel tells, at most.
const STEPS: usize = 5;
/// Standard deviations below which a step is the last.
const LAST_STEP: f64 = 0.01;
/// Least share of the guess at which rows are taken: beyond infinity there is nothing to predict.
const FAR: f64 = 0.01;
/// Which of a feature's numbers it is.
const RHO: usize = 5;

impl Filter {
    /// The rows of a pixel, and where they are linearised if that is not the mean: of a guess at the inverse depth that the pixel
    /// tells. `rows` makes them for a feature.
    ///
    /// A pixel is a quotient of what is linear in the inverse depth. Of a point that is guessed to be near and is far, first seen
    /// from half of the guess away, one step from the guess ends at twice the inverse depth, sure to a tenth. So the
    /// rows are taken where guess and pixel meet, all else at its mean (the iterated filter's step, for this number alone), and
    /// the innovation is what is expected from the mean on the line there.
    pub(super) fn rows_at_told_depth(
        &self,
        landmark: &Block,
        rows: &dyn Fn(&FeatureState) -> Option<Rows>,
    ) -> Option<(Rows, Option<f64>)> {
        let feature = self.memory.state.feature(landmark);
        let mut here = rows(&feature)?;
        if !self.is_guess(landmark) {
            return Some((here, None));
        }
        let (mut with_pose, mut own) = self.memory.state.feature_covariance(landmark);
        let (rho, variance) = (feature.scale(), own[(RHO, RHO)]);
        // What the pixel is off by for another reason than the guess.
        with_pose.column_mut(RHO).fill(0.0);
        own.row_mut(RHO).fill(0.0);
        own.column_mut(RHO).fill(0.0);
        let pose = self.memory.state.p.block::<7, 7>(0, 0);
        let both = here.by_pose * with_pose * here.by_feature.transpose();
        let others = here.noise
            + here.by_pose * pose * here.by_pose.transpose()
            + here.by_feature * own * here.by_feature.transpose()
            + both
            + both.transpose();
        let others: Matrix2<f64> = others.fixed_view::<2, 2>(0, 0).into_owned();
        let mut at = rho;
        for _ in 0..STEPS {
            let by: Vector2<f64> = here.by_feature.fixed_view::<2, 1>(0, RHO).into_owned();
            let innovation = here.innovation.fixed_rows::<2>(0) + by * (at - rho);
            let weight = (others + by * by.transpose() * variance).try_inverse()?;
            let told = (rho + variance * by.dot(&(weight * innovation))).max(FAR * rho);
            let step = told - at;
            let mut moved = feature;
            moved.0[RHO] = told;
            (at, here) = (told, rows(&moved)?);
            if step.powi(2) <= LAST_STEP.powi(2) * variance {
                break;
            }
        }
        here.innovation += here.by_feature.column(RHO) * (at - rho);
        Some((here, Some(at)))
    }

    /// Carries P to where the rows of the batch are taken (METHOD 15), and factors S again. What the state was is kept in the
    /// workspace; false if nothing has changed.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if S is not; the state is what it was then.
    pub(super) fn carry_to_told_depths(&mut self) -> Result<bool, EkfError> {
        let state = &mut self.memory.state;
        let blocks = self.workspace.batch.blocks().iter();
        let told = blocks.filter_map(|block| Some((block.feature + RHO, block.told?)));
        if told.clone().next().is_none() {
            return Ok(false);
        }
        self.workspace.before.copy_from(state);
        let followed = self.memory.followed.ids();
        let gauge = &mut self.workspace.gauge;
        gauge.prepare(state, followed);
        for (i, rho) in told {
            state.x[i] = rho;
        }
        let change = gauge.change(state, followed, None);
        state.p.downdate(&Panels::default(), Some(change));
        gauge.mark_carried(state);
        state.x.clone_from(&self.workspace.before.x);
        self.workspace.batch.build(state);
        let factored = self.workspace.batch.factor();
        if factored.is_err() {
            self.take_back_carried();
        }
        factored.map(|()| true)
    }

    /// Takes back what [`Self::carry_to_told_depths`] has changed.
    pub(super) fn take_back_carried(&mut self) {
        self.memory.state.copy_from(&self.workspace.before);
    }
}
