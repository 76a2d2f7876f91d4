//! A pose in the map that a graph makes, and how it goes on from there by what the filter knows (METHOD 25).

use super::factor::Edge;
use super::node::Node;
use super::times;
use crate::error::EkfError;
use crate::math::quat;
use nalgebra::DMatrix;

/// Variance below which what is transferred is taken to be known.
const LEAST_VARIANCE: f64 = 1e-12;

/// A pose in W with what is transferred there, and how well both are known.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedNode {
    /// The pose, and by how much what is transferred there is wrong.
    pub node: Node,
    /// Joint covariance of both, the pose's on the right tangent.
    pub covariance: DMatrix<f64>,
}

impl PosedNode {
    /// Where the way `edge` from here ends: what the graph knows of the errors that were transferred here stands in place of what the
    /// filter does, and corrects the way and what its end transfers.
    ///
    /// # Errors
    /// `BadShape` if the way begins with other numbers transferred, `NotPositiveDefinite` if its covariance is none.
    pub fn onward(&self, edge: &Edge) -> Result<Self, EkfError> {
        let begin = edge.revised.len();
        let node = self.covariance.nrows();
        if node != 6 + begin {
            return Err(EkfError::BadShape {
                what: "way from a submap on",
                expected: format!("{} numbers transferred", node - 6),
                got: begin.to_string(),
            });
        }
        // Of the end, given what was transferred at the beginning.
        let place = |k: usize| if k < 6 { k } else { begin + k };
        let p = &edge.covariance;
        let n = p.nrows() - begin;
        let end = DMatrix::from_fn(n, n, |i, j| p[(place(i), place(j))]);
        let with = DMatrix::from_fn(n, begin, |i, j| p[(place(i), 6 + j)]);
        let handed = p.view((6, 6), (begin, begin));
        let handed = handed + DMatrix::identity(begin, begin) * LEAST_VARIANCE;
        let stage = "covariance of the way from a submap on";
        let handed = handed
            .cholesky()
            .ok_or(EkfError::NotPositiveDefinite { stage, pivot: 0 })?;
        let gain = handed.solve(&with.transpose()).transpose();
        let own = end - times(&gain, &with.transpose());
        let revised = &gain * (&self.node.transferred - &edge.revised);
        let moved = edge.pose.retract(&revised.fixed_rows::<6>(0).into_owned());
        let back = moved.rotation.transpose();
        let mut by = DMatrix::zeros(n, node);
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        by.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-(back * quat::skew(&moved.translation)));
        by.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
        by.columns_mut(6, begin).copy_from(&gain);
        let covariance = times(&times(&by, &self.covariance), &by.transpose()) + own;
        let node = Node {
            pose: self.node.pose.compose(&moved),
            transferred: revised.rows(6, n - 6).into_owned(),
        };
        Ok(Self {
            node,
            covariance: (&covariance + covariance.transpose()) * 0.5,
        })
    }
}
