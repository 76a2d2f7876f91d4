//! What the filter remembers from frame to frame beside mean and covariance, and its last checkpoint.

pub(super) mod candidate;
pub(super) mod handed;
pub(super) mod pose_ring;
pub(super) mod record;
pub(super) mod undo;
pub(super) mod wheels;
