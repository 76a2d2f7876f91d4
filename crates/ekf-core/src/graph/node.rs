//! What a graph is of: the poses of submaps, with what these transferred.

use crate::math::pose::Pose;
use nalgebra::DVector;

/// By how much the filter's estimates of what is transferred are wrong where the submap ends: the logarithm of the scale, and the
/// time-correlated error of each T_CF, metres and radians. A graph does not ask what they are; nodes of different runs differ in number.
pub type Transferred = DVector<f64>;

/// The pose of a submap in W, and by how much what it transferred is wrong.
#[derive(Clone, Debug, PartialEq)]
pub struct Node {
    /// `T_WX`.
    pub pose: Pose,
    /// See [`Transferred`].
    pub transferred: Transferred,
}

impl Node {
    /// At a pose, with nothing wrong of so many numbers that it transfers.
    pub fn at(pose: Pose, transferred: usize) -> Self {
        let transferred = Transferred::zeros(transferred);
        Self { pose, transferred }
    }

    /// Numbers of it: the right tangent of its pose, and what it transfers.
    pub fn dim(&self) -> usize {
        6 + self.transferred.len()
    }
}

/// Where the numbers of each node begin among those of all.
pub(super) fn starts(nodes: &[Node]) -> Vec<usize> {
    let dims = nodes.iter().map(Node::dim);
    let ends = dims.scan(0, |end, dim| {
        *end += dim;
        Some(*end - dim)
    });
    ends.collect()
}
