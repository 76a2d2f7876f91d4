//! The graph and its solution.

use super::factor::Factor;
use super::marginals::Marginals;
use super::node::{Node, starts};
use super::normal::Normal;
use crate::error::EkfError;
use nalgebra::{DMatrix, DVector};

/// Most steps of a solution: from where a chain of poses stands, some five do.
const MOST_STEPS: usize = 50;
/// Squared length of the last step, in standard deviations of what it moves: no number is off by more than 1e-5 of its own.
const STANDS: f64 = 1e-10;
/// Share by which the diagonal grows at first where a step would lead uphill.
const FIRST_DAMPING: f64 = 1e-6;
/// From there it grows tenfold, until nothing moves any more.
const MOST_DAMPING: f64 = 1e12;

/// Nodes, and factors between them.
#[derive(Clone, Debug, Default)]
pub struct PoseGraph {
    nodes: Vec<Node>,
    factors: Vec<Factor>,
}

/// How a solution ended.
#[derive(Debug)]
pub struct Solved {
    /// Sum of the squared weighted residuals: chi-square where all noise is as it is said to be.
    pub cost: f64,
    /// Steps that were taken.
    pub steps: usize,
    /// What covariances are asked from, linearised before the last step, which moves nothing that counts.
    pub marginals: Marginals,
}

impl PoseGraph {
    /// Of these nodes and factors.
    ///
    /// # Errors
    /// `InvalidInput` if a factor is of a node that is not there, or of one and the same, or of other numbers than the nodes
    /// transfer; `NonFinite`.
    pub fn new(nodes: Vec<Node>, factors: Vec<Factor>) -> Result<Self, EkfError> {
        let what = "factors";
        for (k, factor) in factors.iter().enumerate() {
            if let Err(why) = factor.fits(&nodes) {
                let why = format!("factor {k} {why}");
                return Err(EkfError::InvalidInput { what, why });
            }
            let numbers = factor.weight.iter().chain(&factor.transferred);
            let mut numbers = numbers.chain(&factor.pose.rotation);
            if !numbers.all(|v| v.is_finite())
                || !factor.pose.translation.iter().all(|v| v.is_finite())
            {
                return Err(EkfError::NonFinite { what });
            }
        }
        Ok(Self { nodes, factors })
    }

    /// The nodes.
    pub fn nodes(&self) -> &[Node] {
        &self.nodes
    }

    /// The factors.
    pub fn factors(&self) -> &[Factor] {
        &self.factors
    }

    /// Moves the nodes to where all factors agree best (Levenberg and Marquardt).
    ///
    /// # Errors
    /// `NotPositiveDefinite` if a node is tied to nothing; the nodes stay where they were.
    pub fn solve(&mut self) -> Result<Solved, EkfError> {
        let before = self.nodes.clone();
        let solved = self.descend();
        if solved.is_err() {
            self.nodes = before;
        }
        solved
    }

    fn descend(&mut self) -> Result<Solved, EkfError> {
        let mut normal = Normal::of(&self.nodes, &self.factors);
        let pattern = normal.pattern()?;
        let (mut damping, mut steps) = (0.0, 0);
        while steps < MOST_STEPS && damping <= MOST_DAMPING {
            steps += 1;
            let factored = normal.factored(&pattern, damping)?;
            let mut step =
                DMatrix::from_column_slice(normal.downhill.len(), 1, normal.downhill.as_slice());
            factored.solve(&mut step);
            let step = step.column(0).into_owned();
            if !step.iter().all(|v| v.is_finite()) {
                let what = "the solution of a graph of poses";
                return Err(EkfError::NonFinite { what });
            }
            let nodes = self.moved(&step);
            let old = std::mem::replace(&mut self.nodes, nodes);
            if damping == 0.0 && step.dot(&normal.downhill) < STANDS {
                let (cost, nodes) = (normal.cost, self.nodes.clone());
                let marginals = Marginals::from(factored, nodes);
                return Ok(Solved {
                    cost,
                    steps,
                    marginals,
                });
            }
            let there = Normal::of(&self.nodes, &self.factors);
            // What rounding adds is no way uphill.
            if there.cost <= normal.cost * (1.0 + 1e-12) + 1e-15 {
                damping *= 0.1;
                if damping < FIRST_DAMPING {
                    damping = 0.0;
                }
                normal = there;
            } else {
                self.nodes = old;
                damping = (damping * 10.0).max(FIRST_DAMPING);
            }
        }
        let cost = normal.cost;
        let marginals = Marginals::from(normal.factored(&pattern, 0.0)?, self.nodes.clone());
        Ok(Solved {
            cost,
            steps,
            marginals,
        })
    }

    fn moved(&self, step: &DVector<f64>) -> Vec<Node> {
        let nodes = self.nodes.iter().zip(starts(&self.nodes));
        let moved = |(node, start): (&Node, usize)| Node {
            pose: node.pose.retract(&step.fixed_rows::<6>(start).into_owned()),
            transferred: &node.transferred + step.rows(start + 6, node.transferred.len()),
        };
        nodes.map(moved).collect()
    }

    /// What the covariances of its nodes are asked from, where the nodes stand.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if a node is tied to nothing.
    pub fn marginals(&self) -> Result<Marginals, EkfError> {
        Marginals::of(&self.nodes, &self.factors)
    }

    /// Chi-square of a factor before it is believed: its residual against its own noise and that of its nodes.
    ///
    /// # Errors
    /// `InvalidInput` if it is of no nodes of this graph, `NotPositiveDefinite` if a node is tied to nothing.
    pub fn distance(&self, factor: &Factor, marginals: &Marginals) -> Result<f64, EkfError> {
        if let Err(why) = factor.fits(&self.nodes) {
            let (what, why) = ("factor", format!("it {why}"));
            return Err(EkfError::InvalidInput { what, why });
        }
        let linear = factor.linear(&self.nodes);
        let (by, p) = match factor.first {
            Some(first) => {
                let own = linear.by_first.ncols();
                let both = own + linear.by_second.ncols();
                let mut by = DMatrix::zeros(linear.residual.len(), both);
                by.columns_mut(0, own).copy_from(&linear.by_first);
                by.columns_mut(own, both - own).copy_from(&linear.by_second);
                (by, marginals.of_nodes(&[first, factor.second]))
            }
            None => (linear.by_second, marginals.of_nodes(&[factor.second])),
        };
        let s = DMatrix::identity(by.nrows(), by.nrows()) + &by * p * by.transpose();
        let stage = "distance of a loop";
        let s = s
            .cholesky()
            .ok_or(EkfError::NotPositiveDefinite { stage, pivot: 0 })?;
        Ok(linear.residual.dot(&s.solve(&linear.residual)))
    }
}
