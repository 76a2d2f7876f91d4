//! The innovation window test: it finds features that disagree with the others a little in every frame, too little for
//! the gate of any single frame.
//!
//! A feature whose depth is wrong but small in variance fits each frame within its sigmas and drags the camera along.
//! The squared distance of its match, conditional on all the others, is chi-square and independent from frame to frame;
//! so the sum over a window of frames is chi-square too, with as many degrees of freedom as the window has rows.

use crate::validate::Quantiles;
use serde::{Deserialize, Serialize};

/// Frames of half a window: a window holds the last 8 to 16 frames in which the feature was measured.
const HALF: usize = 8;

/// Sum of conditional squared distances, and its degrees of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Sum {
    d2: f64,
    dof: usize,
    frames: usize,
}

/// The conditional squared distances of one feature over the last frames in which it was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct InnovationWindow {
    older: Sum,
    newer: Sum,
}

impl InnovationWindow {
    pub(super) fn add(&mut self, d2: f64, rows: usize) {
        if self.newer.frames == HALF {
            self.older = std::mem::take(&mut self.newer);
        }
        self.newer.d2 += d2;
        self.newer.dof += rows;
        self.newer.frames += 1;
    }

    /// Whether the sum of at least half a window exceeds the chi-square quantile at this level.
    pub(super) fn exceeds(&self, level: f64, quantiles: &mut Quantiles) -> bool {
        let frames = self.older.frames + self.newer.frames;
        let dof = self.older.dof + self.newer.dof;
        frames >= HALF && self.older.d2 + self.newer.d2 > quantiles.get(level, dof)
    }

    /// Whether its numbers can come from a filter; asked of a snapshot.
    pub(super) fn is_sane(&self) -> bool {
        let sums = [self.older, self.newer];
        sums.iter()
            .all(|s| s.d2.is_finite() && s.d2 >= 0.0 && s.frames <= HALF)
    }
}

/// The windows as this frame leaves them, by feature, kept apart until its update is made; and cached quantiles.
#[derive(Clone, Debug, Default)]
pub(crate) struct PendingWindows {
    pub(super) updated: Vec<(u64, InnovationWindow)>,
    pub(super) quantiles: Quantiles,
}
