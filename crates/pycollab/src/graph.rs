//! The graph of submaps' poses (METHOD 25).

use crate::arrays_in::{
    Argument, Arguments, ROUNDING, finite, finite_numbers, finite_square, matrix, rigid,
    same_length, table,
};
use crate::arrays_out::{Column, Stack, Table, column, stacked, to_matrix, to_pose, to_table};
use crate::errors::{invalid, to_python};
use crate::gate;
use crate::submap::{PyEdge, PySubmapPnp};
use ekf_core::EkfError;
use ekf_core::graph::{Factor, Marginals, Node, PoseGraph, PosedNode, Transferred};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use nalgebra::SMatrix;
use pyo3::prelude::*;
use std::sync::OnceLock;

/// What was measured of one or two submaps' poses, weighted by its covariance.
///
/// Parameters
/// ----------
/// first : int
///     Submap that it is measured from; -1 is W.
/// second : int
///     Submap that is measured.
/// pose : (4, 4) float64
///     Of the second from the first, metres.
/// transferred : (K,) float64
///     What the first was found to transfer; none where the factor does not speak of it.
/// weight : (R, 6 + K + L) float64
///     Makes the residual white: of the pose, of what the first transferred, and of the L numbers that
///     the second transfers, if the factor speaks of them.
///
/// Raises
/// ------
/// InputError
///     For wrong shapes, or a pose that is none.
#[pyclass(name = "Factor", module = "collabslam._core", frozen)]
pub(crate) struct PyFactor(Factor);

#[pymethods]
impl PyFactor {
    #[new]
    fn new(
        first: i64,
        second: usize,
        pose: Argument<'_>,
        transferred: Argument<'_>,
        weight: Argument<'_>,
    ) -> PyResult<Self> {
        Ok(Self(Factor {
            first: usize::try_from(first).ok(),
            second,
            pose: rigid("pose", &pose)?,
            transferred: finite_numbers("transferred", &transferred)?,
            weight: table("weight", &weight)?,
        }))
    }

    /// What the filter says of two submaps that follow one another.
    ///
    /// Parameters
    /// ----------
    /// first, second : int
    /// edge : Edge
    ///
    /// Returns
    /// -------
    /// Factor
    ///
    /// Raises
    /// ------
    /// FilterError
    ///     If its covariance is none.
    #[staticmethod]
    fn between(first: usize, second: usize, edge: &PyEdge) -> PyResult<Self> {
        let made = Factor::between(first, second, &edge.0);
        made.map(Self).map_err(to_python)
    }

    /// A pose measured by itself.
    ///
    /// Parameters
    /// ----------
    /// first : int
    ///     -1 is W.
    /// second : int
    /// pose : (4, 4) float64
    /// covariance : (6, 6) float64
    ///     Right tangent, m^2 and rad^2.
    ///
    /// Returns
    /// -------
    /// Factor
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, or a pose that is none.
    /// FilterError
    ///     If the covariance is none.
    #[staticmethod]
    fn of_pose(
        first: i64,
        second: usize,
        pose: Argument<'_>,
        covariance: Argument<'_>,
    ) -> PyResult<Self> {
        let pose = rigid("pose", &pose)?;
        let covariance = finite("covariance", matrix::<6, 6>("covariance", &covariance)?)?;
        let made = Factor::pose(usize::try_from(first).ok(), second, &pose, &covariance);
        made.map(Self).map_err(to_python)
    }

    /// How well the filter knows what a submap transfers, where none of the same map follows it.
    ///
    /// Parameters
    /// ----------
    /// submap : int
    /// covariance : (K, K) float64
    ///
    /// Returns
    /// -------
    /// Factor
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For a wrong shape.
    /// FilterError
    ///     If the covariance is none.
    #[staticmethod]
    fn of_transferred(submap: usize, covariance: Argument<'_>) -> PyResult<Self> {
        let covariance = finite_square("covariance", &covariance)?;
        let made = Factor::transferred(submap, &covariance);
        made.map(Self).map_err(to_python)
    }

    /// What PnP in an earlier submap says.
    ///
    /// Parameters
    /// ----------
    /// first : int
    ///     The submap that is seen.
    /// second : int
    ///     The submap at whose end it is seen.
    /// pnp : SubmapPnp
    ///
    /// Returns
    /// -------
    /// Factor
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If its information is not finite.
    #[staticmethod]
    fn of_submap_pnp(first: usize, second: usize, pnp: &PySubmapPnp) -> PyResult<Self> {
        let made = Factor::submap_pnp(first, second, &pnp.0.pose, &pnp.0.information);
        made.map(Self).map_err(to_python)
    }

    #[getter]
    fn first(&self) -> i64 {
        self.0.first.map_or(-1, |first| first as i64)
    }
    #[getter]
    fn second(&self) -> usize {
        self.0.second
    }
    #[getter]
    fn pose(&self, py: Python<'_>) -> Table {
        to_pose(py, &self.0.pose)
    }
    #[getter]
    fn transferred(&self, py: Python<'_>) -> Column<f64> {
        column(py, self.0.transferred.iter().copied())
    }
    #[getter]
    fn weight(&self, py: Python<'_>) -> Table {
        to_table(py, &self.0.weight)
    }
}

/// A graph of submaps' poses.
///
/// Parameters
/// ----------
/// poses : (N, 4, 4) float64
///     Of each submap in W, metres.
/// transferred : sequence of N (K,) float64
///     By how much what each transferred is wrong, as many numbers as it transferred.
/// factors : list of Factor
///
/// Raises
/// ------
/// InputError
///     For wrong shapes, numbers that are not finite, or a factor of a submap that is not there or hands
///     on other numbers.
#[pyclass(name = "PoseGraph", module = "collabslam._core", frozen)]
pub(crate) struct PyPoseGraph {
    graph: PoseGraph,
    marginals: OnceLock<Result<Marginals, EkfError>>,
}

impl PyPoseGraph {
    fn of(graph: PoseGraph) -> Self {
        Self {
            graph,
            marginals: OnceLock::new(),
        }
    }

    fn marginals(&self) -> Result<&Marginals, EkfError> {
        let made = self.marginals.get_or_init(|| self.graph.marginals());
        made.as_ref().map_err(Clone::clone)
    }

    fn check(&self, submap: usize) -> PyResult<()> {
        let count = self.graph.nodes().len();
        if submap < count {
            return Ok(());
        }
        let why = format!("there is no submap {submap} among {count}");
        Err(invalid("submap", why))
    }
}

#[pymethods]
impl PyPoseGraph {
    #[new]
    fn new(
        poses: Argument<'_>,
        transferred: Arguments<'_>,
        factors: Vec<PyRef<'_, PyFactor>>,
    ) -> PyResult<Self> {
        let poses = crate::arrays_in::stack::<4, 4>("poses", &poses)?;
        let wrong = |_| invalid("transferred", "a sequence of arrays is needed");
        let transferred = transferred.try_iter().map_err(wrong)?;
        let transferred: Vec<Transferred> = transferred
            .map(|one| finite_numbers("transferred", &one?))
            .collect::<PyResult<_>>()?;
        same_length("transferred", poses.len(), transferred.len())?;
        let node = |(m, transferred): (&SMatrix<f64, 4, 4>, Transferred)| {
            let rotation = m.fixed_view::<3, 3>(0, 0).into_owned();
            let good = m.iter().all(|v| v.is_finite()) && quat::is_rotation(&rotation, ROUNDING);
            let pose = Pose {
                rotation,
                translation: m.fixed_view::<3, 1>(0, 3).into_owned(),
            };
            let why = "one is no 4x4 rigid transform";
            let node = good.then_some(Node { pose, transferred });
            node.ok_or_else(|| invalid("poses", why))
        };
        let nodes: Vec<Node> = poses
            .iter()
            .zip(transferred)
            .map(node)
            .collect::<PyResult<_>>()?;
        let factors = factors.iter().map(|f| f.0.clone()).collect();
        let graph = PoseGraph::new(nodes, factors).map_err(to_python)?;
        Ok(Self::of(graph))
    }

    /// The graph whose poses all factors agree with best.
    ///
    /// Returns
    /// -------
    /// PoseGraph
    ///
    /// Raises
    /// ------
    /// FilterError
    ///     If a submap is tied to nothing.
    fn solved(&self, py: Python<'_>) -> PyResult<Self> {
        let mut graph = self.graph.clone();
        gate::enter(py, || {
            let marginals = graph.solve()?.marginals;
            Ok(Self {
                graph,
                marginals: OnceLock::from(Ok(marginals)),
            })
        })
    }

    /// (N, 4, 4) float64, see the class.
    #[getter]
    fn poses(&self, py: Python<'_>) -> Stack<f64> {
        let nodes = self.graph.nodes().iter();
        let matrix = |node: &Node| {
            let mut m = SMatrix::<f64, 4, 4>::identity();
            m.fixed_view_mut::<3, 3>(0, 0)
                .copy_from(&node.pose.rotation);
            m.fixed_view_mut::<3, 1>(0, 3)
                .copy_from(&node.pose.translation);
            m
        };
        stacked(py, nodes.map(matrix))
    }

    /// List of N (K,) float64, see the class.
    #[getter]
    fn transferred(&self, py: Python<'_>) -> Vec<Column<f64>> {
        let nodes = self.graph.nodes().iter();
        nodes
            .map(|node| column(py, node.transferred.iter().copied()))
            .collect()
    }

    /// A submap in W, as all factors have it.
    ///
    /// Parameters
    /// ----------
    /// submap : int
    ///
    /// Returns
    /// -------
    /// PosedNode
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If there is no such submap.
    /// FilterError
    ///     If a submap is tied to nothing.
    fn posed_node(&self, py: Python<'_>, submap: usize) -> PyResult<PyPosedNode> {
        self.check(submap)?;
        let posed_node = gate::enter(py, || Ok(self.marginals()?.posed_node(submap)))?;
        Ok(PyPosedNode(posed_node))
    }

    /// Pose of one submap from another, and its covariance (right tangent, m^2 and rad^2).
    ///
    /// Parameters
    /// ----------
    /// first, second : int
    ///
    /// Returns
    /// -------
    /// pose : (4, 4) float64
    /// covariance : (6, 6) float64
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If there is no such submap.
    /// FilterError
    ///     If a submap is tied to nothing.
    fn relative(&self, py: Python<'_>, first: usize, second: usize) -> PyResult<(Table, Table)> {
        self.check(first)?;
        self.check(second)?;
        let (pose, p) = gate::enter(py, || Ok(self.marginals()?.relative(first, second)))?;
        Ok((to_pose(py, &pose), to_matrix(py, &p)))
    }

    /// Chi-square of a factor before it is believed, of as many degrees of freedom as it measures.
    ///
    /// Parameters
    /// ----------
    /// factor : Factor
    ///
    /// Returns
    /// -------
    /// float
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If it is of a submap that is not there, or of other numbers than the submaps transfer.
    /// FilterError
    ///     If a submap is tied to nothing.
    fn distance(&self, py: Python<'_>, factor: &PyFactor) -> PyResult<f64> {
        let factor = &factor.0;
        gate::enter(py, || self.graph.distance(factor, self.marginals()?))
    }
}

/// A pose in W with what is transferred there, and how well both are known.
///
/// Parameters
/// ----------
/// pose : (4, 4) float64
///     Metres.
/// transferred : (K,) float64
///     By how much what is transferred there is wrong.
/// covariance : (6 + K, 6 + K) float64
///     Joint, of the pose (right tangent, m and rad) and what is transferred.
///
/// Raises
/// ------
/// InputError
///     For wrong shapes, or a pose that is none.
#[pyclass(name = "PosedNode", module = "collabslam._core", frozen)]
pub(crate) struct PyPosedNode(PosedNode);

#[pymethods]
impl PyPosedNode {
    #[new]
    fn new(
        pose: Argument<'_>,
        transferred: Argument<'_>,
        covariance: Argument<'_>,
    ) -> PyResult<Self> {
        let node = Node {
            pose: rigid("pose", &pose)?,
            transferred: finite_numbers("transferred", &transferred)?,
        };
        let covariance = finite_square("covariance", &covariance)?;
        same_length("covariance", node.dim(), covariance.nrows())?;
        Ok(Self(PosedNode { node, covariance }))
    }

    #[getter]
    fn pose(&self, py: Python<'_>) -> Table {
        to_pose(py, &self.0.node.pose)
    }
    #[getter]
    fn transferred(&self, py: Python<'_>) -> Column<f64> {
        column(py, self.0.node.transferred.iter().copied())
    }
    #[getter]
    fn covariance(&self, py: Python<'_>) -> Table {
        to_table(py, &self.0.covariance)
    }

    /// Where the way from here ends, corrected by what the errors transferred here are now known to be.
    ///
    /// Parameters
    /// ----------
    /// edge : Edge
    ///
    /// Returns
    /// -------
    /// PosedNode
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If other numbers were transferred where the way begins.
    /// FilterError
    ///     If the covariance of the way is none.
    fn onward(&self, edge: &PyEdge) -> PyResult<Self> {
        self.0.onward(&edge.0).map(Self).map_err(to_python)
    }
}
