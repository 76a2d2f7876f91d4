//! The features that P is carried along with (METHOD 14): those in view, and those that were and are still close to it.

use serde::{Deserialize, Serialize};

/// Their ids, increasing.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Followed(Vec<u64>);

impl Followed {
    /// All of them, increasing.
    pub(crate) fn ids(&self) -> &[u64] {
        &self.0
    }

    pub(crate) fn has(&self, id: u64) -> bool {
        self.0.binary_search(&id).is_ok()
    }

    /// A feature is born.
    pub(crate) fn add(&mut self, id: u64) {
        self.0.push(id);
    }

    /// These are not followed any more.
    pub(crate) fn remove(&mut self, ids: &[u64]) {
        self.0.retain(|id| !ids.contains(id));
    }

    /// Features that were born with this id or a later one were taken back.
    pub(crate) fn forget_from(&mut self, id: u64) {
        let kept = self.0.partition_point(|&other| other < id);
        self.0.truncate(kept);
    }

    /// Exchanges the list, increasing.
    pub(crate) fn swap(&mut self, list: &mut Vec<u64>) {
        std::mem::swap(&mut self.0, list);
    }

    /// Whether what a snapshot says can be, where ids end before `next`.
    pub(crate) fn is_sane(&self, next: u64) -> bool {
        self.0.windows(2).all(|w| w[0] < w[1]) && self.0.last().is_none_or(|&id| id < next)
    }
}
