//! Candidates: points that are tracked until their parallax allows a delayed birth (METHOD 5).

use crate::error::EkfError;
use crate::guard::check_pixels;
use crate::math::numbers;
use crate::observe::point::CameraPose;
use crate::state::{BlockKind, Layout};
use nalgebra::{SMatrix, Vector2};
use serde::{Deserialize, Serialize};

/// A point that is tracked until its parallax allows a birth.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Candidate {
    /// Pixel in the first view.
    #[serde(with = "numbers")]
    pub(crate) uv: Vector2<f64>,
    /// How that moves with the readout, as `Filter::roll` says.
    #[serde(with = "numbers")]
    pub(crate) roll: SMatrix<f64, 2, 2>,
    /// Time of the first view, seconds.
    pub(crate) since: f64,
    pub(crate) first: FirstView,
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) enum FirstView {
    /// The pose is a block of the state.
    Clone(u64),
    /// The pose and its covariance are remembered here, not in the state.
    Remembered(Box<RememberedPose>),
}

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct RememberedPose {
    pub(crate) pose: CameraPose,
    #[serde(with = "numbers")]
    pub(crate) covariance: SMatrix<f64, 7, 7>,
}

impl Candidate {
    /// Its first pixel without the shutter's rolling, by the readout, seconds, and the derivative by that;
    /// `rho` is the inverse range of its point, 1/m.
    pub(crate) fn unrolled(&self, readout: f64, rho: f64) -> (Vector2<f64>, Vector2<f64>) {
        let by_readout = self.roll * Vector2::new(1.0, rho);
        (self.uv + by_readout * readout, by_readout)
    }

    /// Whether what a snapshot says can be.
    pub(crate) fn check(&self, layout: &Layout) -> Result<(), EkfError> {
        if let FirstView::Clone(id) = self.first {
            let block = layout.find(id);
            if block.is_some_and(|block| block.kind != BlockKind::Clone) {
                let why = "a candidate's first pose is something else";
                return Err(EkfError::bad_snapshot(why));
            }
        }
        if !self.since.is_finite() || check_pixels(std::iter::once(&self.uv)).is_err() {
            let why = "a candidate's pixel or time is impossible";
            return Err(EkfError::bad_snapshot(why));
        }
        Ok(())
    }
}

/// What became of an observed candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CandidateOutcome {
    /// Born as this feature.
    Born(u64),
    /// Too little baseline or parallax yet: it waits.
    Waiting,
    /// It waits, where it was first seen: it may be fixed to the camera, or far, or at a distance at which a turn is made up for.
    Held,
    /// No point at rest would be there, at whatever distance: it was dropped. By how many times as much as noise and the poses
    /// allow.
    OffArc(f64),
    /// Its first pose is gone, or it gives no feature: it was dropped.
    Dropped,
    /// It is where it was first seen, and no point at rest would be there: it is fixed to the camera, and was dropped.
    Fixed,
}

impl CandidateOutcome {
    /// Whether it is still a candidate.
    pub fn waits(&self) -> bool {
        matches!(self, Self::Waiting | Self::Held)
    }
}
