//! What was measured of two nodes.

use super::node::{Node, Transferred};
use super::times;
use crate::error::EkfError;
use crate::math::pose::Pose;
use crate::math::quat;
use nalgebra::{DMatrix, DVector, Matrix6};

/// Standard deviation, metres, radians or of the logarithm of the scale, below which nothing is told apart: it is added
/// where the filter says zero (what it does not estimate, or a camera that has not moved).
const LEAST_SD: f64 = 1e-6;

/// What the filter knows at the end of a submap about how it got there from the beginning.
#[derive(Clone, Debug)]
pub struct Edge {
    /// Pose of the end from the beginning, `T_WA^-1 T_WB`.
    pub pose: Pose,
    /// By how much its estimate of what the beginning transferred has changed since.
    pub revised: Transferred,
    /// Joint covariance of the pose (right tangent), of what the beginning transferred, and of what the end transfers, if it does.
    pub covariance: DMatrix<f64>,
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
    /// What the first was found to transfer; nothing where the factor does not speak of it.
    pub transferred: Transferred,
    /// Columns: of the relative pose, of what the first transferred, and of what the second does, if the factor speaks of that.
    pub weight: DMatrix<f64>,
}

/// A factor's weighted residual, and its derivatives by its nodes.
pub(super) struct Linear {
    pub(super) residual: DVector<f64>,
    pub(super) by_first: DMatrix<f64>,
    pub(super) by_second: DMatrix<f64>,
}

impl Factor {
    /// What the filter says of two submaps that follow one another: of the relative pose and what the first transferred,
    /// given what the second does. Conditioned so, each submap's own data count once along a chain of them.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if the covariance is none.
    pub fn between(first: usize, second: usize, edge: &Edge) -> Result<Self, EkfError> {
        let (all, begin) = (edge.covariance.nrows(), 6 + edge.revised.len());
        let after = all - begin;
        let p = &edge.covariance + DMatrix::identity(all, all) * (LEAST_SD * LEAST_SD);
        let own = p.view((0, 0), (begin, begin));
        let with_end = p.view((0, begin), (begin, after));
        let end = p.view((begin, begin), (after, after));
        let end = end.into_owned().cholesky().ok_or(NONE)?;
        let gain = end.solve(&with_end.transpose()).transpose();
        let given = own - times(&gain, &with_end.transpose());
        let given = (&given + given.transpose()) * 0.5;
        let given = given.cholesky().ok_or(NONE)?;
        let mut weight = DMatrix::identity(begin, all);
        weight.columns_mut(begin, after).copy_from(&-gain);
        given.l_dirty().solve_lower_triangular_mut(&mut weight);
        Ok(Self {
            first: Some(first),
            second,
            pose: edge.pose.clone(),
            transferred: edge.revised.clone(),
            weight,
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
        let covariance = DMatrix::from_column_slice(6, 6, covariance.as_slice());
        let given = floored(&covariance).cholesky().ok_or(NONE)?;
        let mut weight = DMatrix::identity(6, 6);
        given.l_dirty().solve_lower_triangular_mut(&mut weight);
        Ok(Self {
            first,
            second,
            pose: pose.clone(),
            transferred: Transferred::zeros(0),
            weight,
        })
    }

    /// How well the filter knows what a node transfers, where no submap of the same map follows it.
    ///
    /// # Errors
    /// `NotPositiveDefinite` if the covariance is none.
    pub fn transferred(node: usize, covariance: &DMatrix<f64>) -> Result<Self, EkfError> {
        let given = floored(covariance).cholesky().ok_or(NONE)?;
        let n = covariance.nrows();
        let mut weight = DMatrix::zeros(n, 6 + n);
        weight.columns_mut(6, n).fill_with_identity();
        given.l_dirty().solve_lower_triangular_mut(&mut weight);
        Ok(Self {
            first: None,
            second: node,
            pose: Pose::identity(),
            transferred: Transferred::zeros(0),
            weight,
        })
    }

    /// What submap PnP says: information about the relative pose and what that submap transferred
    /// , which leaves open what it cannot tell.
    ///
    /// # Errors
    /// `NonFinite` if the information has a number that is not finite.
    pub fn submap_pnp(
        first: usize,
        second: usize,
        pose: &Pose,
        information: &DMatrix<f64>,
    ) -> Result<Self, EkfError> {
        if !information.iter().all(|v| v.is_finite()) {
            let what = "information of a loop";
            return Err(EkfError::NonFinite { what });
        }
        // Numbers of different units are compared in units of their own information.
        let scale = information.diagonal().map(|d| d.max(0.0).sqrt());
        let over = scale.map(|s| if s > 0.0 { 1.0 / s } else { 0.0 });
        let n = information.nrows();
        let scaled = DMatrix::from_fn(n, n, |i, j| information[(i, j)] * over[i] * over[j]);
        let eigen = scaled.symmetric_eigen();
        let mut weight = DMatrix::zeros(n, n);
        for k in 0..n {
            let root = eigen.eigenvalues[k].max(0.0).sqrt();
            for i in 0..n {
                weight[(k, i)] = root * eigen.eigenvectors[(i, k)] * scale[i];
            }
        }
        Ok(Self {
            first: Some(first),
            second,
            pose: pose.clone(),
            transferred: Transferred::zeros(n - 6),
            weight,
        })
    }

    /// Whether it is of two of these nodes and of what they transfer; if not, what it is instead.
    pub(super) fn fits(&self, nodes: &[Node]) -> Result<(), String> {
        let (first, second) = (self.first, self.second);
        let dim = |i: usize| nodes.get(i).map(Node::dim);
        let (from, to) = (first.map_or(Some(6), dim), dim(second));
        let (Some(from), Some(to), false) = (from, to, first == Some(second)) else {
            let count = nodes.len();
            return Err(format!(
                "is of the nodes {first:?} and {second}; give two of {count}"
            ));
        };
        let own = 6 + self.transferred.len();
        let with_end = [own, own + to - 6];
        if [6, from].contains(&own) && with_end.contains(&self.weight.ncols()) {
            return Ok(());
        }
        Err(format!(
            "speaks of {} numbers that were transferred and has a weight of {} columns; \
             its nodes transfer {} and {}, the columns are 6 and one for each of those that it speaks of",
            own - 6,
            self.weight.ncols(),
            from - 6,
            to - 6,
        ))
    }

    /// Linearised where its nodes are, which it [fits](Self::fits).
    pub(super) fn linear(&self, nodes: &[Node]) -> Linear {
        let origin = Node::at(Pose::identity(), 0);
        let first = self.first.map_or(&origin, |i| &nodes[i]);
        let second = &nodes[self.second];
        let between = first.pose.inverse().compose(&second.pose);
        let error = self.pose.inverse().compose(&between);
        let xi = error.log();
        let (all, of_first) = (self.weight.ncols(), self.transferred.len());
        let of_second = all - 6 - of_first;
        let mut residual = DVector::zeros(all);
        residual.fixed_rows_mut::<6>(0).copy_from(&xi);
        for k in 0..of_first {
            residual[6 + k] = first.transferred[k] - self.transferred[k];
        }
        for k in 0..of_second {
            residual[6 + of_first + k] = second.transferred[k];
        }
        let turn = xi.fixed_rows::<3>(3).into_owned();
        let jacobian = quat::right_jacobian(&turn);
        // Beyond half a turn there is none; the residual never is.
        let inverse = jacobian.try_inverse().unwrap_or_default();
        let back = self.pose.rotation.transpose();
        let mut by_first = DMatrix::zeros(all, first.dim());
        let mut by_second = DMatrix::zeros(all, second.dim());
        if self.first.is_some() {
            by_first.fixed_view_mut::<3, 3>(0, 0).copy_from(&-back);
            by_first
                .fixed_view_mut::<3, 3>(0, 3)
                .copy_from(&(back * quat::skew(&between.translation)));
            by_first
                .fixed_view_mut::<3, 3>(3, 3)
                .copy_from(&(-inverse * between.rotation.transpose()));
            by_first
                .view_mut((6, 6), (of_first, of_first))
                .fill_with_identity();
        }
        by_second
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&error.rotation);
        by_second.fixed_view_mut::<3, 3>(3, 3).copy_from(&inverse);
        by_second
            .view_mut((6 + of_first, 6), (of_second, of_second))
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

fn floored(p: &DMatrix<f64>) -> DMatrix<f64> {
    let n = p.nrows();
    (p + p.transpose()) * 0.5 + DMatrix::identity(n, n) * (LEAST_SD * LEAST_SD)
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector6;

    /// Of the two nodes: of runs with one worn camera and with two.
    const TRANSFERRED: [usize; 2] = [7, 13];

    fn wave(i: usize) -> f64 {
        ((i * 7919 + 13) % 101) as f64 / 101.0 - 0.5
    }

    fn nodes() -> Vec<Node> {
        let node = |k: usize| Node {
            pose: Pose::exp(&Vector6::from_fn(|i, _| 2.0 * wave(11 * k + i))),
            transferred: Transferred::from_fn(TRANSFERRED[k], |i, _| 0.1 * wave(5 * k + i)),
        };
        (0..2).map(node).collect()
    }

    fn factor(first: Option<usize>, of_first: usize, of_second: usize) -> Factor {
        Factor {
            first,
            second: 1,
            pose: Pose::exp(&Vector6::new(0.4, -0.1, 1.0, 0.3, 0.2, -0.6)),
            transferred: Transferred::from_fn(of_first, |i, _| 0.05 * wave(i)),
            weight: DMatrix::from_fn(9, 6 + of_first + of_second, |i, j| wave(3 * i + 7 * j)),
        }
    }

    fn moved(nodes: &[Node], which: usize, k: usize, by: f64) -> Vec<Node> {
        let mut nodes = nodes.to_vec();
        if k < 6 {
            let mut xi = Vector6::zeros();
            xi[k] = by;
            nodes[which].pose = nodes[which].pose.retract(&xi);
        } else {
            nodes[which].transferred[k - 6] += by;
        }
        nodes
    }

    #[test]
    fn its_derivatives_are_those_of_finite_differences() {
        let nodes = nodes();
        let [of_first, of_second] = TRANSFERRED;
        for (first, of_first, of_second) in [
            (Some(0), of_first, of_second),
            (Some(0), of_first, 0),
            (Some(0), 0, 0),
            (None, 0, of_second),
        ] {
            let factor = factor(first, of_first, of_second);
            factor.fits(&nodes).expect("of these nodes");
            let linear = factor.linear(&nodes);
            let sides = [(first, &linear.by_first), (Some(1), &linear.by_second)];
            for (which, by) in sides
                .into_iter()
                .filter_map(|(i, by)| i.map(|which| (which, by)))
            {
                for k in 0..nodes[which].dim() {
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
    fn submap_pnp_weighs_as_its_information_says_and_leaves_open_what_it_cannot_tell() {
        let rows = DMatrix::from_fn(5, 13, |i, j| wave(i + 5 * j) * 10f64.powi(j as i32 % 4));
        let information = rows.transpose() * rows;
        let factor = Factor::submap_pnp(0, 1, &Pose::identity(), &information).expect("finite");
        let again = factor.weight.transpose() * &factor.weight;
        let off = (again - &information).amax() / information.amax();
        assert!(off < 1e-10, "{off:e}");
        assert_eq!(factor.transferred, Transferred::zeros(7));
    }

    #[test]
    fn a_factor_of_other_numbers_than_its_nodes_hand_on_is_told() {
        let nodes = nodes();
        for (first, of_first, of_second) in [(Some(0), 6, 13), (Some(0), 7, 7), (None, 7, 0)] {
            let why = factor(first, of_first, of_second)
                .fits(&nodes)
                .expect_err("of others");
            assert!(why.contains("transfer"), "{why}");
        }
        let mut short = factor(Some(0), 7, 0);
        short.weight = DMatrix::zeros(9, 6);
        assert!(
            short
                .fits(&nodes)
                .expect_err("of others")
                .contains("6 columns")
        );
    }
}
