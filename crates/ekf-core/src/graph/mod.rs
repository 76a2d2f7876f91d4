//! A small graph of poses beside the filter (METHOD 25): what was measured of each pose relative to another, and the poses
//! that agree best with all of it, with the covariance of any of them.
//!
//! A node is the pose of a submap and what the submap handed on ([`HandedOn`]): the errors that the filter's estimates before
//! and after it share. A factor ([`Factor`]) says what was measured of two nodes, and how well. Nothing of the graph goes
//! back into the filter.

mod factor;
mod marginals;
mod normal;
mod placed;
mod poses;

pub use factor::{Edge, Factor};
pub use marginals::{Marginals, NodeCovariance};
pub use placed::Placed;
pub use poses::{Node, PoseGraph, Solved};

use nalgebra::SVector;

/// Numbers that a submap hands on: the logarithm of the scale, and the bias of T_CF (right tangent, metres and radians).
pub const HANDED_ON: usize = 7;
/// Numbers of a node: the right tangent of its pose, and what it hands on.
pub const NODE: usize = 6 + HANDED_ON;
/// By how much the filter's estimates of what is handed on are wrong where the submap ends.
pub type HandedOn = SVector<f64, HANDED_ON>;
