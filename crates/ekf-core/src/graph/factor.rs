//! What was measured of two nodes.

use super::{HANDED_ON, HandedOn, NODE, Node};
use crate::error::EkfError;
use crate::math::pose::Pose;
use crate::math::quat;
use nalgebra::{Const, DMatrix, DVector, Dyn, Matrix6, OMatrix, SMatrix, SVector};

/// Numbers of a factor's residual before it is weighted: of the relative pose, of what the first node handed on, and of what
/// the second did.
const RESIDUAL: usize = 6 + 2 * HANDED_ON;
/// Standard deviation, metres, radians or of the logarithm of the scale, below which nothing is told apart: it is added
/// where the filter says zero (what it does not estimate, or a camera that has not moved).
const LEAST_SD: f64 = 1e-6;

/// What the filter knows at the end of a submap about how it got there from the beginning.
#[derive(Clone, Debug)]
pub struct Edge {
    /// Pose of the end from the beginning, `T_WA^-1 T_WB`.
    pub pose: Pose,
    /// By how much its estimate of what the beginning handed on has changed since.
    pub revised: HandedOn,
    /// Joint covariance of the pose (right tangent), of what the beginning handed on, and of what the end hands on.
    pub covariance: SMatrix<f64, RESIDUAL, RESIDUAL>,
}

/// A measurement of one or two nodes, weighted: `weight` times its residual is white with unit variance.
#[derive(Clone, Debug)]
pub struct Factor {
    /// The node that it is measured from; `None` is W itself.
    pub first: Option<usize>,
    /// The node that is measured.
    pub second: usize,
    /// Pose of the second from the first.
    pub pose: Pose,
    /// What the first was found to hand on.
    pub handed_on: HandedOn,
    /// `k x 20`.
    pub weight: DMatrix<f64>,
}

/// Derivatives of weighted residuals by a node.
pub(super) type Rows = OMatrix<f64, Dyn, Const<NODE>>;

/// A factor's weighted residual, and its derivatives by its nodes.
pub(super) struct Linear {
    pub(super) residual: DVector<f64>,
    /// `k x 13`.
    pub(super) by_first: Rows,
    pub(super) by_second: Rows,
}

impl Factor {
    /// What the filter says of two submaps that follow one another: of the relative pose and what the first handed on,
    /// given what the second does. Conditioned so, each submap's own data count once along a chain of them.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if the covariance is none.
    pub fn between(first: usize, second: usize, edge: &Edge) -> Result<Self, EkfError> {
        let floor = |i: usize, j: usize| if i == j { LEAST_SD * LEAST_SD } else { 0.0 };
        let p = edge.covariance + SMatrix::from_fn(floor);
        let own = p.fixed_view::<NODE, NODE>(0, 0);
        let with_end = p.fixed_view::<NODE, HANDED_ON>(0, NODE);
        let end = p.fixed_view::<HANDED_ON, HANDED_ON>(NODE, NODE);
        let end = end.into_owned().cholesky().ok_or(NONE)?;
        let gain = end.solve(&with_end.transpose()).transpose();
        let given = own - gain * with_end.transpose();
        let given = ((given + given.transpose()) * 0.5).cholesky().ok_or(NONE)?;
        let mut rows = SMatrix::<f64, NODE, RESIDUAL>::identity();
        rows.fixed_view_mut::<NODE, HANDED_ON>(0, NODE)
            .copy_from(&-gain);
        given.l_dirty().solve_lower_triangular_mut(&mut rows);
        Ok(Self {
            first: Some(first),
            second,
            pose: edge.pose.clone(),
            handed_on: edge.revised,
            weight: DMatrix::from_column_slice(NODE, RESIDUAL, rows.as_slice()),
        })
    }

    /// A pose measured from another one, or from W, with this covariance (right tangent, m^2 and rad^2).
    ///
    /// # Errors
    /// `NotPositiveDefinite` if the covariance is none.
    pub fn pose(
        first: Option<usize>,
        second: usize,
        pose: &Pose,
        covariance: &Matrix6<f64>,
    ) -> Result<Self, EkfError> {
        let given = floored(covariance).cholesky().ok_or(NONE)?;
        let mut rows = SMatrix::<f64, 6, RESIDUAL>::identity();
        given.l_dirty().solve_lower_triangular_mut(&mut rows);
        Ok(Self {
            first,
            second,
            pose: pose.clone(),
            handed_on: HandedOn::zeros(),
            weight: DMatrix::from_column_slice(6, RESIDUAL, rows.as_slice()),
        })
    }

    /// How well the filter knows what a node hands on, where no submap of the same map follows it.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if the covariance is none.
    pub fn handed_on(
        node: usize,
        covariance: &SMatrix<f64, HANDED_ON, HANDED_ON>,
    ) -> Result<Self, EkfError> {
        let given = floored(covariance).cholesky().ok_or(NONE)?;
        let mut rows = SMatrix::<f64, HANDED_ON, RESIDUAL>::zeros();
        rows.fixed_view_mut::<HANDED_ON, HANDED_ON>(0, NODE)
            .fill_with_identity();
        given.l_dirty().solve_lower_triangular_mut(&mut rows);
        Ok(Self {
            first: None,
            second: node,
            pose: Pose::identity(),
            handed_on: HandedOn::zeros(),
            weight: DMatrix::from_column_slice(HANDED_ON, RESIDUAL, rows.as_slice()),
        })
    }

    /// What a sight of an earlier submap's landmarks says: information about the relative pose and what that submap handed
    /// on, which leaves open what it cannot tell.
    ///
    /// # Errors
    /// `NonFinite` if the information has a number that is not finite.
    pub fn sight(
        first: usize,
        second: usize,
        pose: &Pose,
        information: &SMatrix<f64, NODE, NODE>,
    ) -> Result<Self, EkfError> {
        if !information.iter().all(|v| v.is_finite()) {
            let what = "information of a loop";
            return Err(EkfError::NonFinite { what });
        }
        // Numbers of different units are compared in units of their own information.
        let scale = information.diagonal().map(|d| d.max(0.0).sqrt());
        let over = scale.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
        let scaled =
            SMatrix::<f64, NODE, NODE>::from_fn(|i, j| information[(i, j)] * over[i] * over[j]);
        let eigen = scaled.symmetric_eigen();
        let mut weight = DMatrix::zeros(NODE, RESIDUAL);
        for k in 0..NODE {
            let root = eigen.eigenvalues[k].max(0.0).sqrt();
            for i in 0..NODE {
                weight[(k, i)] = root * eigen.eigenvectors[(i, k)] * scale[i];
            }
        }
        Ok(Self {
            first: Some(first),
            second,
            pose: pose.clone(),
            handed_on: HandedOn::zeros(),
            weight,
        })
    }

    /// Linearised where its nodes are.
    pub(super) fn linear(&self, nodes: &[Node]) -> Linear {
        let origin = Node::at(Pose::identity());
        let first = self.first.map_or(&origin, |i| &nodes[i]);
        let second = &nodes[self.second];
        let between = first.pose.inverse().compose(&second.pose);
        let error = self.pose.inverse().compose(&between);
        let xi = error.log();
        let mut residual = SVector::<f64, RESIDUAL>::zeros();
        residual.fixed_rows_mut::<6>(0).copy_from(&xi);
        residual
            .fixed_rows_mut::<HANDED_ON>(6)
            .copy_from(&(first.handed_on - self.handed_on));
        residual
            .fixed_rows_mut::<HANDED_ON>(NODE)
            .copy_from(&second.handed_on);
        let turn = xi.fixed_rows::<3>(3).into_owned();
        let jacobian = quat::right_jacobian(&turn);
        // Beyond half a turn there is none; the residual never is.
        let inverse = jacobian.try_inverse().unwrap_or_default();
        let back = self.pose.rotation.transpose();
        let mut by_first = SMatrix::<f64, RESIDUAL, NODE>::zeros();
        let mut by_second = SMatrix::<f64, RESIDUAL, NODE>::zeros();
        if self.first.is_some() {
            by_first.fixed_view_mut::<3, 3>(0, 0).copy_from(&-back);
            by_first
                .fixed_view_mut::<3, 3>(0, 3)
                .copy_from(&(back * quat::skew(&between.translation)));
            by_first
                .fixed_view_mut::<3, 3>(3, 3)
                .copy_from(&(-inverse * between.rotation.transpose()));
            by_first
                .fixed_view_mut::<HANDED_ON, HANDED_ON>(6, 6)
                .fill_with_identity();
        }
        by_second
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&error.rotation);
        by_second.fixed_view_mut::<3, 3>(3, 3).copy_from(&inverse);
        by_second
            .fixed_view_mut::<HANDED_ON, HANDED_ON>(NODE, 6)
            .fill_with_identity();
        Linear {
            residual: &self.weight * residual,
            by_first: &self.weight * by_first,
            by_second: &self.weight * by_second,
        }
    }
}

const NONE: EkfError = EkfError::NotPositiveDefinite {
    stage: "covariance of a factor",
    pivot: 0,
};

fn floored<const N: usize>(p: &SMatrix<f64, N, N>) -> SMatrix<f64, N, N> {
    (p + p.transpose()) * 0.5 + SMatrix::identity() * (LEAST_SD * LEAST_SD)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;

    fn wave(i: usize) -> f64 {
        ((i * 7919 + 13) % 101) as f64 / 101.0 - 0.5
    }

    fn nodes() -> Vec<Node> {
        let node = |k: usize| Node {
            pose: Pose::exp(&Vector6::from_fn(|i, _| 2.0 * wave(11 * k + i))),
            handed_on: HandedOn::from_fn(|i, _| 0.1 * wave(5 * k + i)),
        };
        (0..2).map(node).collect()
    }

    fn factor(first: Option<usize>) -> Factor {
        Factor {
            first,
            second: 1,
            pose: Pose::exp(&Vector6::new(0.4, -0.1, 1.0, 0.3, 0.2, -0.6)),
            handed_on: HandedOn::from_fn(|i, _| 0.05 * wave(i)),
            weight: DMatrix::from_fn(9, RESIDUAL, |i, j| wave(3 * i + 7 * j)),
        }
    }

    fn moved(nodes: &[Node], which: usize, k: usize, by: f64) -> Vec<Node> {
        let mut nodes = nodes.to_vec();
        if k < 6 {
            let mut xi = Vector6::zeros();
            xi[k] = by;
            nodes[which].pose = nodes[which].pose.retract(&xi);
        } else {
            nodes[which].handed_on[k - 6] += by;
        }
        nodes
    }

    #[test]
    fn its_derivatives_are_those_of_finite_differences() {
        let nodes = nodes();
        for first in [Some(0), None] {
            let factor = factor(first);
            let linear = factor.linear(&nodes);
            for (which, by) in [(0, &linear.by_first), (1, &linear.by_second)] {
                for k in 0..NODE {
                    let e = 1e-6;
                    let [to, from] =
                        [e, -e].map(|e| factor.linear(&moved(&nodes, which, k, e)).residual);
                    let off = ((to - from) / (2.0 * e) - by.column(k)).amax();
                    assert!(off < 1e-8, "{first:?} {which} {k}: {off:e}");
                }
            }
        }
    }

    #[test]
    fn a_sight_weighs_as_its_information_says_and_leaves_open_what_it_cannot_tell() {
        let rows =
            SMatrix::<f64, 5, NODE>::from_fn(|i, j| wave(i + 5 * j) * 10f64.powi(j as i32 % 4));
        let information = rows.transpose() * rows;
        let factor = Factor::sight(0, 1, &Pose::identity(), &information).expect("finite");
        let again = factor.weight.columns(0, NODE).into_owned();
        let off = (again.transpose() * again - information).amax() / information.amax();
        assert!(off < 1e-10, "{off:e}");
        assert_eq!(factor.weight.columns(NODE, HANDED_ON).amax(), 0.0);
    }
}
