//! What is known of the wheels, and of a gyroscope, since the last frame (METHOD 23, 28).

use crate::math::numbers;
use crate::predict::CameraMatrix;
use nalgebra::Matrix3;
use serde::{Deserialize, Serialize};

/// Whether the wheels may have slipped between the last two frames, and what the frame may tell of them.
#[derive(Clone, Copy, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Wheels {
    /// Whether odometry told at least half of the time since.
    pub(crate) followed: bool,
    /// Where a gyroscope told the turn for at least half of it: the covariance of that turn, tangent on the right, rad^2.
    #[serde(with = "numbers::optional")]
    pub(crate) turned: Option<Matrix3<f64>>,
    /// Whether that turn changes so much with the gyroscope's clock that the frame tells it.
    pub(crate) clear_clock: bool,
    /// Covariance that a slip would add to the camera's block; none where odometry told nothing of it.
    #[serde(with = "numbers::optional")]
    pub(crate) slip: Option<CameraMatrix>,
    /// The camera's covariance before that was added, if it was.
    #[serde(with = "numbers::optional")]
    pub(crate) trusted: Option<CameraMatrix>,
    /// Whether the way, and the turn, that they told are too little beside their noise to say anything of their scales.
    pub(crate) unclear: [bool; 2],
}

impl Wheels {
    /// What a slip would add, where it has not been added.
    pub(crate) fn untaken_slip(&self) -> Option<CameraMatrix> {
        self.slip.filter(|_| self.trusted.is_none())
    }
}
