//! Covariances of nodes.

use super::factor::Factor;
use super::node::{Node, starts};
use super::normal::{Factored, Normal};
use super::posed_node::PosedNode;
use crate::error::EkfError;
use crate::math::pose::Pose;
use nalgebra::{DMatrix, Matrix6, SMatrix};

/// The factored information of a graph, from which covariances are read when they are asked for.
#[derive(Debug)]
pub struct Marginals {
    factored: Factored,
    nodes: Vec<Node>,
    /// Where the numbers of each node begin.
    starts: Vec<usize>,
}

impl Marginals {
    pub(super) fn of(nodes: &[Node], factors: &[Factor]) -> Result<Self, EkfError> {
        let normal = Normal::of(nodes, factors);
        let factored = normal.factored(&normal.pattern()?, 0.0)?;
        Ok(Self::from(factored, nodes.to_vec()))
    }

    pub(super) fn from(factored: Factored, nodes: Vec<Node>) -> Self {
        let starts = starts(&nodes);
        Self {
            factored,
            nodes,
            starts,
        }
    }

    /// Joint covariance of some nodes in their order, of each its pose (right tangent), then what it transfers.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn of_nodes(&self, which: &[usize]) -> DMatrix<f64> {
        let rows = which.iter().flat_map(|&i| {
            assert!(i < self.nodes.len(), "there is no node {i}");
            self.starts[i]..self.starts[i] + self.nodes[i].dim()
        });
        let rows: Vec<usize> = rows.collect();
        let (n, k) = (self.nodes.iter().map(Node::dim).sum(), rows.len());
        let mut columns = DMatrix::zeros(n, k);
        for (c, &row) in rows.iter().enumerate() {
            columns[(row, c)] = 1.0;
        }
        self.factored.solve(&mut columns);
        let p = DMatrix::from_fn(k, k, |r, c| columns[(rows[r], c)]);
        (&p + p.transpose()) * 0.5
    }

    /// Covariance of one node.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn of_node(&self, node: usize) -> DMatrix<f64> {
        self.of_nodes(&[node])
    }

    /// A node, and its covariance.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn posed_node(&self, node: usize) -> PosedNode {
        PosedNode {
            node: self.nodes[node].clone(),
            covariance: self.of_node(node),
        }
    }

    /// Pose of one node from another, and its covariance (right tangent, m^2 and rad^2).
    ///
    /// # Panics
    /// If there is no such node.
    pub fn relative(&self, from: usize, to: usize) -> (Pose, Matrix6<f64>) {
        let pose = self.nodes[from]
            .pose
            .inverse()
            .compose(&self.nodes[to].pose);
        if from == to {
            return (pose, Matrix6::zeros());
        }
        let p = self.of_nodes(&[from, to]);
        let second = self.nodes[from].dim();
        let row = |k: usize| if k < 6 { k } else { second + k - 6 };
        let p = SMatrix::<f64, 12, 12>::from_fn(|i, j| p[(row(i), row(j))]);
        let mut by = SMatrix::<f64, 6, 12>::zeros();
        // d = A^-1 B: a moves it by -Ad(d^-1) a, b by b; METHOD 1's tangent keeps both halves apart.
        let back = pose.rotation.transpose();
        by.fixed_view_mut::<3, 3>(0, 0).copy_from(&-back);
        by.fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(back * crate::math::quat::skew(&pose.translation)));
        by.fixed_view_mut::<3, 3>(3, 3).copy_from(&-back);
        by.fixed_view_mut::<6, 6>(0, 6).fill_with_identity();
        let p = by * p * by.transpose();
        (pose, (p + p.transpose()) * 0.5)
    }
}
