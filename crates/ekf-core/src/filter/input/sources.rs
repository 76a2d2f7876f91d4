//! The match behind each measurement block of a frame, and the lists that an update works with.

use super::measurements::{MeasurementOutcome, UpdateReport};
use crate::gyroscope::ImageTurn;
use crate::state::Learned;
use nalgebra::Matrix3;

/// Where in [`Measurements`] a block of the batch comes from, and which form it takes.
#[derive(Clone, Copy, Debug)]
pub(crate) enum Source {
    /// Two rows: a pixel in Cs.
    Bearing(usize),
    /// Three rows: a worn pair as a 3D point.
    Point(usize),
    /// Two rows: a worn pair's pixel in Cf, of the feature with this id.
    WornPixel(usize, u64),
    /// Three rows: a depth from another sensor.
    Depth(usize),
    /// Three rows: the rate that the view's own gyroscope tells.
    Rate,
}

impl Source {
    /// Place in the list of 3D blocks that may be demoted to a bearing, `pairs` pairs coming first.
    pub(crate) fn slot(self, pairs: usize) -> Option<usize> {
        match self {
            Self::Point(i) => Some(i),
            Self::Depth(i) => Some(pairs + i),
            Self::Bearing(_) | Self::WornPixel(..) | Self::Rate => None,
        }
    }

    pub(crate) fn outcome(self, report: &mut UpdateReport) -> &mut MeasurementOutcome {
        match self {
            Self::Bearing(i) => &mut report.bearings[i],
            Self::Point(i) | Self::WornPixel(i, _) => &mut report.views[0][i],
            Self::Depth(i) => &mut report.depths[i],
            Self::Rate => &mut report.rates[0],
        }
    }
}

/// How the worn camera's pairs are measured in this frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum WornForm {
    Unused,
    BirthsOnly,
    Points,
    Tight,
}

/// Lists of an update; they only grow, so that a warm step allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Where each block of the batch comes from.
    pub(crate) sources: Vec<Source>,
    pub(crate) wanted: Vec<Source>,
    pub(crate) with_depth: Vec<u64>,
    /// 3D blocks that were rejected and fall back to their bearing.
    pub(crate) demoted: Vec<bool>,
    /// Blocks that a test rejected.
    pub(crate) gone: Vec<usize>,
    pub(crate) ids: Vec<u64>,
    /// What the update may learn of the view's time-correlated error.
    pub(crate) learned: Learned,
    /// The turn since the checkpoint that the images show, if they were asked, and the attitude there.
    pub(crate) shown: Option<(ImageTurn, Matrix3<f64>)>,
}

impl Clone for Scratch {
    /// Nothing is carried over: a copy starts empty.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Scratch {
    /// Writes the outcome of the rejected blocks into the report; true if a 3D block among them may fall back to its
    /// bearing.
    pub(crate) fn record(
        &mut self,
        outcome: MeasurementOutcome,
        report: &mut UpdateReport,
    ) -> bool {
        let mut any = false;
        for &u in &self.gone {
            *self.sources[u].outcome(report) = outcome;
            if let Some(slot) = self.sources[u].slot(report.pairs().len()) {
                self.demoted[slot] = true;
                any = true;
            }
        }
        any
    }

    /// Drops the sources of the rejected blocks.
    pub(crate) fn leave_out(&mut self) {
        let mut u = 0;
        self.sources.retain(|_| {
            u += 1;
            self.gone.binary_search(&(u - 1)).is_err()
        });
    }
}
