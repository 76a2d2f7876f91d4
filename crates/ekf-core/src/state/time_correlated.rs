//! What lasts of the errors of the worn cameras' poses (METHOD 6), and the errors of one frame.

use super::{Block, BlockKind, ErrorOwner, State};
use crate::math::numbers;
use nalgebra::{Matrix6, SMatrix, Vector6};
use serde::{Deserialize, Serialize};

/// How the time-correlated error of one worn camera, or what all have in common of theirs, comes about. Both are along C's axes:
/// that of a worn camera is `b + by_common c`, b its own block and c the common one.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct TimeCorrelatedBias {
    pub(crate) owner: ErrorOwner,
    /// Covariance of the block that has been replaced altogether by fresh noise.
    #[serde(with = "numbers")]
    pub(crate) stationary: Matrix6<f64>,
    #[serde(with = "numbers")]
    pub(crate) by_common: Matrix6<f64>,
}

impl TimeCorrelatedBias {
    /// What all worn cameras have in common, in standard deviations.
    pub(crate) fn common() -> Self {
        Self {
            owner: ErrorOwner::Common,
            stationary: Matrix6::identity(),
            by_common: Matrix6::zeros(),
        }
    }

    /// Of a worn camera, whose time-correlated error along C's axes has this covariance; `share` of it is common to all.
    pub(crate) fn of(who: usize, covariance: &Matrix6<f64>, share: f64) -> Self {
        let common = if share > 0.0 {
            root(covariance) * share.sqrt()
        } else {
            Matrix6::zeros()
        };
        Self {
            owner: ErrorOwner::Of(who),
            stationary: covariance * (1.0 - share),
            by_common: common,
        }
    }
}

/// The symmetric root of a covariance.
pub(crate) fn root(covariance: &Matrix6<f64>) -> Matrix6<f64> {
    let eigen = covariance.symmetric_eigen();
    let sds = eigen.eigenvalues.map(|v| v.max(0.0).sqrt());
    eigen.eigenvectors * Matrix6::from_diagonal(&sds) * eigen.eigenvectors.transpose()
}

impl State {
    /// Puts a time-correlated error into the state, if it is not there yet.
    pub(crate) fn begin_time_correlated(&mut self, time_correlated: TimeCorrelatedBias) {
        let kind = BlockKind::WornBias(time_correlated.owner);
        if self.layout.of_kind(kind).next().is_none() {
            self.append(kind, &Vector6::zeros(), &[], &time_correlated.stationary);
            self.time_correlated.push(time_correlated);
        }
    }

    /// Takes a time-correlated error out of the state: from now on it is another one.
    pub(crate) fn end_time_correlated(&mut self, owner: ErrorOwner) {
        self.time_correlated.retain(|l| l.owner != owner);
        if let ErrorOwner::Of(who) = owner
            && let Some(clock) = self.clocks.get_mut(who)
        {
            clock.begin_anew();
        }
        self.remove(|b| b.kind == BlockKind::WornBias(owner));
    }

    /// What the time-correlated error of a worn camera, along C's axes, is made of: blocks of the state and its derivatives by them.
    /// Nothing where it is not in the state.
    pub(crate) fn time_correlated_error(
        &self,
        who: usize,
    ) -> impl Iterator<Item = (usize, Matrix6<f64>)> {
        let own = self
            .time_correlated
            .iter()
            .find(|l| l.owner == ErrorOwner::Of(who));
        let parts = own.into_iter().flat_map(move |own| {
            let of_own = (ErrorOwner::Of(who), Matrix6::identity());
            [of_own, (ErrorOwner::Common, own.by_common)]
        });
        parts.filter_map(|(owner, by)| {
            let block = self.layout.of_kind(BlockKind::WornBias(owner)).next()?;
            Some((block.offset, by))
        })
    }

    /// Covariance of a worn camera's time-correlated error along C's axes, as it is known now.
    pub(crate) fn time_correlated_covariance(&self, who: usize) -> Matrix6<f64> {
        let mut sum = Matrix6::zeros();
        for (at, by) in self.time_correlated_error(who) {
            let p: SMatrix<f64, 6, 6> = self.p.block(at, at);
            sum += by * p * by.transpose();
        }
        sum
    }

    /// The block of a frame's error of T_CF.
    pub(crate) fn worn_error_block(&self, owner: ErrorOwner) -> Option<&Block> {
        self.layout.of_kind(BlockKind::WornError(owner)).next()
    }

    /// A worn camera's error in this frame as estimated in the state; zero if it is not part of it.
    pub(crate) fn worn_error(&self, who: usize) -> Vector6<f64> {
        self.worn_error_block(ErrorOwner::Of(who))
            .map_or(Vector6::zeros(), |b| self.part::<6>(b.offset))
    }

    /// Where the state has how a worn camera moves while this frame's image of it is read.
    pub(crate) fn worn_roll_offset(&self, who: usize) -> Option<usize> {
        let block = self.layout.of_kind(BlockKind::WornRoll(who)).next();
        block.map(|b| b.offset)
    }

    /// Whether it does.
    pub(crate) fn has_worn_roll(&self, who: usize) -> bool {
        self.worn_roll_offset(who).is_some()
    }

    /// Removes the errors of the frame's T_CF.
    pub(crate) fn end_worn_errors(&mut self) {
        self.remove(|b| matches!(b.kind, BlockKind::WornError(_) | BlockKind::WornRoll(_)));
    }
}
