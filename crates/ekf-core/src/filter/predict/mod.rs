//! From one frame to the next (METHOD 3, 23, 27), and where features are expected in the image (METHOD 4, 7).

pub(super) mod conditional;
pub(super) mod features;
pub(super) mod imu;
pub(super) mod odometry;
pub(super) mod prediction;
pub(super) mod shutter;
pub(super) mod turning;
mod unseen;
pub(super) mod visibility;
