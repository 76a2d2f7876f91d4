//! What is known of the wheels since the last frame (METHOD 23).

use crate::predict::CameraMatrix;

/// Whether the wheels may have slipped between the last two frames, and what the frame may tell of them.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Wheels {
    /// Whether odometry told at least half of the time since.
    pub(super) followed: bool,
    /// Covariance that a slip would add to the camera's block; none where odometry told nothing of it.
    pub(super) slip: Option<CameraMatrix>,
    /// The camera's covariance before that was added, if it was.
    pub(super) trusted: Option<CameraMatrix>,
    /// Whether the way, and the turn, that they told are too little beside their noise to say anything of their scales.
    pub(super) unclear: [bool; 2],
}
