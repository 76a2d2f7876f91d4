//! Covariances of nodes.

use super::normal::{Factored, Normal};
use super::{NODE, Node, Placed, PoseGraph};
use crate::error::EkfError;
use crate::math::pose::Pose;
use nalgebra::{DMatrix, Matrix6, SMatrix};

/// Covariance of a node: of its pose (right tangent), then of what it hands on.
pub type NodeCovariance = SMatrix<f64, NODE, NODE>;

/// The factored information of a graph, from which covariances are read when they are asked for.
#[derive(Debug)]
pub struct Marginals {
    factored: Factored,
    nodes: Vec<Node>,
}

impl Marginals {
    pub(super) fn of(graph: &PoseGraph) -> Result<Self, EkfError> {
        let normal = Normal::of(graph);
        Ok(Self {
            factored: normal.factored(&normal.pattern()?, 0.0)?,
            nodes: graph.nodes().to_vec(),
        })
    }

    /// Joint covariance of some nodes, 13 rows each, in their order.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn of_nodes(&self, which: &[usize]) -> DMatrix<f64> {
        let (n, k) = (NODE * self.nodes.len(), NODE * which.len());
        let mut columns = DMatrix::zeros(n, k);
        for (b, &i) in which.iter().enumerate() {
            assert!(i < self.nodes.len(), "there is no node {i}");
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

    /// A node, and its covariance.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn placed(&self, node: usize) -> Placed {
        Placed {
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
}
