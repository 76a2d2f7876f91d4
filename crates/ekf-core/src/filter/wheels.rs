//! Whether the wheels may have slipped since the last frame (METHOD 23).

use crate::predict::CameraMatrix;

/// What is known of a slip of the wheels between the last two frames.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wheels {
    /// Whether odometry told at least half of the time since.
    pub(super) followed: bool,
    /// Covariance that a slip would add to the camera's block; none where odometry told nothing of it.
    pub(super) slip: Option<CameraMatrix>,
    /// The camera's covariance before that was added, if it was.
    pub(super) trusted: Option<CameraMatrix>,
}
