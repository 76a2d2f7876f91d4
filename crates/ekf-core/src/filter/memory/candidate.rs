//! Candidates: points that are tracked until their parallax allows a delayed birth (METHOD 5).

use crate::error::EkfError;
use crate::guard::check_pixels;
use crate::observe::POSE_DIM;
use crate::observe::point::CameraPose;
use crate::state::{BlockKind, Layout};
use nalgebra::{SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

/// A point that is tracked until its parallax allows a birth.
#[derive(Clone, Debug)]
pub(crate) struct Candidate {
    /// Pixel in the first view.
    pub uv: Vector2<f64>,
    /// How that moves with the readout, as `Filter::roll` says.
    pub(crate) roll: SMatrix<f64, 2, 2>,
    /// Time of the first view, seconds.
    pub since: f64,
    pub(crate) first: FirstView,
}

#[derive(Clone, Debug)]
pub(crate) enum FirstView {
    /// The pose is a block of the state.
    Clone(u64),
    /// The pose and its covariance are remembered here, not in the state.
    Remembered(CameraPose, Box<SMatrix<f64, 7, 7>>),
}

/// A candidate in a snapshot.
#[derive(Serialize, Deserialize)]
pub(crate) struct CandidateImage {
    uv: [f64; 2],
    roll: [[f64; 2]; 2],
    since: f64,
    /// The block of the first pose, or the pose and its covariance.
    first: Result<u64, Vec<f64>>,
}

impl Candidate {
    /// Its first pixel without the shutter's rolling, by the readout, seconds, and the derivative by that;
    /// `rho` is the inverse range of its point, 1/m.
    pub(crate) fn unrolled(&self, readout: f64, rho: f64) -> (Vector2<f64>, Vector2<f64>) {
        let by_readout = self.roll * Vector2::new(1.0, rho);
        (self.uv + by_readout * readout, by_readout)
    }

    pub(crate) fn image(&self) -> CandidateImage {
        let Self {
            uv,
            roll,
            since,
            first,
        } = self;
        CandidateImage {
            uv: [uv.x, uv.y],
            roll: (*roll).into(),
            since: *since,
            first: match first {
                FirstView::Clone(block) => Ok(*block),
                FirstView::Remembered(CameraPose { r, q }, covariance) => {
                    let numbers = r.iter().chain(q.iter()).chain(covariance.iter());
                    Err(numbers.copied().collect())
                }
            },
        }
    }

    pub(crate) fn from_image(image: CandidateImage, layout: &Layout) -> Result<Self, EkfError> {
        let CandidateImage {
            uv,
            roll,
            since,
            first,
        } = image;
        let first = match first {
            Ok(id) => {
                let block = layout.find(id);
                if block.is_some_and(|block| block.kind != BlockKind::Clone) {
                    return Err(EkfError::bad_snapshot(
                        "a candidate's first pose is something else",
                    ));
                }
                FirstView::Clone(id)
            }
            Err(numbers) if numbers.len() == POSE_DIM + POSE_DIM * POSE_DIM => {
                if !numbers.iter().all(|v| v.is_finite()) {
                    return Err(EkfError::bad_snapshot(
                        "a candidate's first pose is not finite",
                    ));
                }
                let (pose, covariance) = numbers.split_at(POSE_DIM);
                let pose = CameraPose {
                    r: SVector::from_column_slice(&pose[..3]),
                    q: SVector::from_column_slice(&pose[3..]),
                };
                FirstView::Remembered(pose, Box::new(SMatrix::from_column_slice(covariance)))
            }
            Err(_) => {
                return Err(EkfError::bad_snapshot(
                    "a candidate's first pose has not 56 numbers",
                ));
            }
        };
        let uv = Vector2::from(uv);
        let roll = SMatrix::<f64, 2, 2>::from(roll);
        if !since.is_finite()
            || !roll.iter().all(|v| v.is_finite())
            || check_pixels(std::iter::once(&uv)).is_err()
        {
            return Err(EkfError::bad_snapshot(
                "a candidate's pixel or time is impossible",
            ));
        }
        Ok(Self {
            uv,
            roll,
            since,
            first,
        })
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
    Strayed(f64),
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
