//! Features that the others contradict a little, frame after frame: the gate of one frame never sees them.
//!
//! A feature with a wrong depth that is believed fits each frame within its sigmas and pulls the camera along. But the
//! distance of a match given all the others is chi-square, and independent from frame to frame: its sum over the
//! last frames is chi-square as well, and tells.

use crate::validate::Quantiles;
use serde::{Deserialize, Serialize};

/// Frames of half a memory: what is remembered are 8 to 16 frames in which a feature was measured.
const HALF: usize = 8;

/// Squared distances given the others, and their degrees of freedom.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
struct Sum {
    d2: f64,
    dof: usize,
    frames: usize,
}

/// How far a feature was off what the others say, in the last frames in which it was measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(super) struct InnovationWindow {
    before: Sum,
    now: Sum,
}

impl InnovationWindow {
    pub(super) fn add(&mut self, d2: f64, rows: usize) {
        if self.now.frames == HALF {
            self.before = std::mem::take(&mut self.now);
        }
        self.now.d2 += d2;
        self.now.dof += rows;
        self.now.frames += 1;
    }

    /// Whether half a memory or more is contradicted at this level.
    pub(super) fn exceeds(&self, level: f64, quantiles: &mut Quantiles) -> bool {
        let frames = self.before.frames + self.now.frames;
        let dof = self.before.dof + self.now.dof;
        frames >= HALF && self.before.d2 + self.now.d2 > quantiles.get(level, dof)
    }

    /// Whether its numbers can be those of a filter.
    pub(super) fn is_sane(&self) -> bool {
        let sums = [self.before, self.now];
        sums.iter()
            .all(|s| s.d2.is_finite() && s.d2 >= 0.0 && s.frames <= HALF)
    }
}

/// What this frame makes of them, by feature, until the update is made; and quantiles.
#[derive(Clone, Debug, Default)]
pub(crate) struct PendingWindows {
    pub(super) news: Vec<(u64, InnovationWindow)>,
    pub(super) quantiles: Quantiles,
}
