//! Covariances of nodes.

use super::normal::{Factored, Normal};
use super::{HANDED_ON, NODE, PoseGraph};
use crate::error::EkfError;
use crate::math::pose::Pose;
use nalgebra::{DMatrix, Matrix6, SMatrix};

/// Covariance of a node: of its pose (right tangent), then of what it hands on.
pub type NodeCovariance = SMatrix<f64, NODE, NODE>;

/// The factored information of a graph, from which covariances are read when they are asked for.
#[derive(Debug)]
pub struct Marginals {
    factored: Factored,
    poses: Vec<Pose>,
}

impl Marginals {
    pub(super) fn of(graph: &PoseGraph) -> Result<Self, EkfError> {
        Ok(Self {
            factored: Normal::of(graph).factored(0.0)?,
            poses: graph.nodes().iter().map(|n| n.pose.clone()).collect(),
        })
    }

    /// Joint covariance of some nodes, 13 rows each, in their order.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn of_nodes(&self, which: &[usize]) -> DMatrix<f64> {
        let (n, k) = (NODE * self.poses.len(), NODE * which.len());
        let mut columns = DMatrix::zeros(n, k);
        for (b, &i) in which.iter().enumerate() {
            assert!(i < self.poses.len(), "there is no node {i}");
            for c in 0..NODE {
                columns[(NODE * i + c, NODE * b + c)] = 1.0;
            }
        }
        self.factored.solve(&mut columns);
        let row = |r: usize| NODE * which[r / NODE] + r % NODE;
        let p = DMatrix::from_fn(k, k, |r, c| columns[(row(r), c)]);
        (&p + p.transpose()) * 0.5
    }

    /// Covariance of one node.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn of_node(&self, node: usize) -> NodeCovariance {
        let p = self.of_nodes(&[node]);
        SMatrix::from_column_slice(p.as_slice())
    }

    /// Pose of one node from another, and its covariance (right tangent, m^2 and rad^2).
    ///
    /// # Panics
    /// If there is no such node.
    pub fn relative(&self, from: usize, to: usize) -> (Pose, Matrix6<f64>) {
        let pose = self.poses[from].inverse().compose(&self.poses[to]);
        if from == to {
            return (pose, Matrix6::zeros());
        }
        let p = self.of_nodes(&[from, to]);
        let mut by = SMatrix::<f64, 6, { 2 * NODE }>::zeros();
        // d = A^-1 B: a moves it by -Ad(d^-1) a, b by b; METHOD 1's tangent keeps both halves apart.
        let back = pose.rotation.transpose();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&-back);
        by.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(back * crate::math::quat::skew(&pose.translation)));
        by.fixed_view_mut::<3, 3>(3, 3).copy_from(&-back);
        by.fixed_view_mut::<6, 6>(0, NODE).fill_with_identity();
        let p: SMatrix<f64, { 2 * NODE }, { 2 * NODE }> = SMatrix::from_column_slice(p.as_slice());
        let p = by * p * by.transpose();
        (pose, (p + p.transpose()) * 0.5)
    }

    /// A pose that the filter knows from a node on, in W: the node's pose with `edge` appended, corrected by what the node is
    /// now known to have handed on wrongly, and its covariance (right tangent).
    ///
    /// `edge.covariance` is read for the pose and what the node handed on only.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if the edge's covariance is none.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn onward(
        &self,
        graph: &PoseGraph,
        node: usize,
        edge: &super::Edge,
    ) -> Result<(Pose, Matrix6<f64>), EkfError> {
        let least = SMatrix::<f64, HANDED_ON, HANDED_ON>::identity() * 1e-12;
        let handed = edge.covariance.fixed_view::<HANDED_ON, HANDED_ON>(6, 6) + least;
        let with = edge.covariance.fixed_view::<6, HANDED_ON>(0, 6);
        let stage = "covariance of the way from a submap on";
        let handed = handed
            .cholesky()
            .ok_or(EkfError::NotPositiveDefinite { stage, pivot: 0 })?;
        let gain = handed.solve(&with.transpose()).transpose();
        let own = edge.covariance.fixed_view::<6, 6>(0, 0) - gain * with.transpose();
        let from = &graph.nodes()[node];
        let moved = edge.pose.retract(&(gain * (from.handed_on - edge.revised)));
        let back = moved.rotation.transpose();
        let mut by = SMatrix::<f64, 6, NODE>::zeros();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&back);
        by.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&-(back * crate::math::quat::skew(&moved.translation)));
        by.fixed_view_mut::<3, 3>(3, 3).copy_from(&back);
        by.fixed_view_mut::<6, HANDED_ON>(0, 6).copy_from(&gain);
        let p = by * self.of_node(node) * by.transpose() + own;
        Ok((from.pose.compose(&moved), (p + p.transpose()) * 0.5))
    }
}
