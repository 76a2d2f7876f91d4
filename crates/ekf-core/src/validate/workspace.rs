//! The buffers of all tests.

use super::batch::Blocks;
use super::distance::Joint;
use super::quantiles::Quantiles;
use super::subsets::scratch::Scratch;
use nalgebra::Matrix3;

/// Buffers of all tests, and the last rejected set.
#[derive(Clone, Debug, Default)]
pub struct Workspace {
    pub(super) rejected: Vec<usize>,
    pub(super) whitened: Vec<f64>,
    pub(super) quantiles: Quantiles,
    pub(super) joint: Joint,
    pub(super) hohct: Scratch,
    pub(super) jcbb: JcbbScratch,
    pub(super) one_point: OnePointScratch,
}

#[derive(Clone, Debug, Default)]
pub(super) struct JcbbScratch {
    pub(super) distance: Vec<f64>,
    /// Blocks that pass by themselves, nearest first.
    pub(super) order: Vec<usize>,
    /// Position in `order` of each match of the branch.
    pub(super) branch: Vec<usize>,
    pub(super) best: Vec<usize>,
}

#[derive(Clone, Debug, Default)]
pub(super) struct OnePointScratch {
    pub(super) precision: Vec<Matrix3<f64>>,
    pub(super) inliers: Vec<usize>,
    pub(super) best: Vec<usize>,
    pub(super) rescued: Vec<usize>,
}

impl Workspace {
    /// Blocks that the last test rejected, in increasing order.
    pub fn rejected(&self) -> &[usize] {
        &self.rejected
    }

    pub(super) fn reject_all(&mut self, blocks: Blocks) {
        self.rejected.clear();
        self.rejected.extend(0..blocks.len());
    }
}
