//! A pose in the map that a graph makes, and how it goes on from there by what the filter knows (METHOD 25).

use super::{Edge, HANDED_ON, HandedOn, NODE, Node, NodeCovariance};
use crate::error::EkfError;
use crate::math::quat;
use nalgebra::SMatrix;

/// Variance below which what is handed on is taken to be known.
const LEAST_VARIANCE: f64 = 1e-12;

/// A pose in W with what is handed on there, and how well both are known.
#[derive(Clone, Debug, PartialEq)]
pub struct Placed {
    /// The pose, and by how much what is handed on there is wrong.
    pub node: Node,
    /// Joint covariance of both, the pose's on the right tangent.
    pub covariance: NodeCovariance,
}

impl Placed {
    /// Where the way `edge` from here ends: what the graph knows of the errors that were handed on here stands in place of what the
    /// filter does, and corrects the way and what its end hands on.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if the covariance of the way is none.
    pub fn onward(&self, edge: &Edge) -> Result<Self, EkfError> {
        // Of the end, given what was handed on at the beginning.
        let place = |k: usize| if k < 6 { k } else { HANDED_ON + k };
        let p = &edge.covariance;
        let end = SMatrix::<f64, NODE, NODE>::from_fn(|i, j| p[(place(i), place(j))]);
        let with = SMatrix::<f64, NODE, HANDED_ON>::from_fn(|i, j| p[(place(i), 6 + j)]);
        let mut handed = p.fixed_view::<HANDED_ON, HANDED_ON>(6, 6).into_owned();
        handed += SMatrix::<f64, HANDED_ON, HANDED_ON>::identity() * LEAST_VARIANCE;
        let stage = "covariance of the way from a submap on";
        let handed = handed
            .cholesky()
            .ok_or(EkfError::NotPositiveDefinite { stage, pivot: 0 })?;
        let gain = handed.solve(&with.transpose()).transpose();
        let own = end - gain * with.transpose();
        let revised = gain * (self.node.handed_on - edge.revised);
        let moved = edge.pose.retract(&revised.fixed_rows::<6>(0).into_owned());
        let back = moved.rotation.transpose();
        let mut by = SMatrix::<f64, NODE, NODE>::zeros();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        by.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-(back * quat::skew(&moved.translation)));
        by.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
        by.fixed_view_mut::<NODE, HANDED_ON>(0, 6).copy_from(&gain);
        let covariance = by * self.covariance * by.transpose() + own;
        let node = Node {
            pose: self.node.pose.compose(&moved),
            handed_on: HandedOn::from(revised.fixed_rows::<HANDED_ON>(6)),
        };
        Ok(Self {
            node,
            covariance: (covariance + covariance.transpose()) * 0.5,
        })
    }
}
