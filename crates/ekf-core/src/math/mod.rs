//! Small fixed-size mathematics: quaternions, poses, inverse depth.

pub mod inverse_depth;
pub mod pose;
pub mod quat;
