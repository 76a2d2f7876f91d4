//! Submaps, and an earlier one in sight (METHOD 25).

use crate::arrays_in::{Argument, ids, pixels, rigid, rows, same_length, square, table};
use crate::arrays_out::{
    Column, Table, column, symmetric, to_ids, to_matrix, to_pose, to_table, vectors,
};
use crate::camera::PyCamera;
use crate::gate;
use ekf_core::Submap;
use ekf_core::graph::Edge;
use ekf_core::sight::{Landmarks, Noise, Sight, sight as core_sight};
use nalgebra::{DMatrix, Vector3};
use pyo3::prelude::*;

/// The way from where a submap began, as the filter knows it; of :meth:`Filter.since_submap`.
///
/// Attributes
/// ----------
/// pose : (4, 4) float64
///     Of its end from its beginning, metres.
/// revised : (K,) float64
///     By how much the estimate of what the beginning handed on has changed since.
/// covariance : (6 + K + L, 6 + K + L) float64
///     Joint, of the pose (right tangent, m and rad), the K numbers that the beginning handed on
///     and the L that the end hands on, where it has ended.
#[pyclass(name = "Edge", module = "collabslam._core", frozen)]
pub(crate) struct PyEdge(pub(crate) Edge);

#[pymethods]
impl PyEdge {
    #[getter]
    fn pose(&self, py: Python<'_>) -> Table {
        to_pose(py, &self.0.pose)
    }
    #[getter]
    fn revised(&self, py: Python<'_>) -> Column<f64> {
        column(py, self.0.revised.iter().copied())
    }
    #[getter]
    fn covariance(&self, py: Python<'_>) -> Table {
        to_table(py, &self.0.covariance)
    }
}

/// A submap that has ended; of :meth:`Filter.end_submap`.
///
/// Attributes
/// ----------
/// edge : Edge or None
///     The way since the last one ended; None of the first one in a map.
/// pose : (4, 4) float64
///     T_WC where it ended, metres.
/// pose_covariance : (6, 6) float64
///     Right tangent, m^2 and rad^2.
/// handed_on : (K, K) float64
///     Covariance of what it hands on: the logarithm of the scale, and of each worn camera the
///     lasting error of T_CF, m and rad along the axes of C.
/// ids : (N,) int64
///     Landmarks in view.
/// points : (N, 3) float64
///     From the camera, metres.
/// covariance : (3 N, 3 N) float64
///     Their joint covariance as they stand to the camera, m^2.
/// with_handed_on : (3 N, K) float64
///     Their covariance with what is handed on.
/// slip : float
///     Standard deviation of a slip while all that is in view is exchanged once, radians.
#[pyclass(name = "Submap", module = "collabslam._core", frozen, get_all)]
pub(crate) struct PySubmap {
    edge: Option<Py<PyEdge>>,
    pose: Table,
    pose_covariance: Table,
    handed_on: Table,
    ids: Column<i64>,
    points: Table,
    covariance: Table,
    with_handed_on: Table,
    slip: f64,
}

impl PySubmap {
    pub(crate) fn new(py: Python<'_>, submap: Submap) -> PyResult<Self> {
        let n = submap.covariance.nrows();
        Ok(Self {
            edge: submap.edge.map(|e| Py::new(py, PyEdge(e))).transpose()?,
            pose: to_pose(py, &submap.pose),
            pose_covariance: to_matrix(py, &submap.pose_covariance),
            handed_on: to_table(py, &submap.handed_on),
            ids: to_ids(py, submap.ids.into_iter().map(Some)),
            points: vectors(py, submap.points.into_iter()),
            covariance: symmetric(py, submap.covariance.data.into(), n),
            with_handed_on: to_table(py, &submap.with_handed_on),
            slip: submap.slip,
        })
    }
}

/// Where the camera is in an earlier submap; of :meth:`SubmapLandmarks.sight`.
///
/// Attributes
/// ----------
/// pose : (4, 4) float64
///     Of the camera in the frame of the submap's end, metres.
/// accepted : (N,) bool
///     The matches that it rests on.
/// chi2 : float
///     Their squared residual against all noise.
/// dof : int
///     Its degrees of freedom.
#[pyclass(name = "Sight", module = "collabslam._core", frozen)]
pub(crate) struct PySight(pub(crate) Sight);

#[pymethods]
impl PySight {
    #[getter]
    fn pose(&self, py: Python<'_>) -> Table {
        to_pose(py, &self.0.pose)
    }
    #[getter]
    fn accepted(&self, py: Python<'_>) -> Column<bool> {
        column(py, self.0.accepted.iter().copied())
    }
    #[getter]
    fn chi2(&self) -> f64 {
        self.0.chi2
    }
    #[getter]
    fn dof(&self) -> usize {
        self.0.dof
    }
}

/// The landmarks of a submap, to be seen again.
///
/// Parameters
/// ----------
/// points, covariance, with_handed_on, handed_on : ndarray
///     As :class:`Submap` has them.
///
/// Raises
/// ------
/// InputError
///     For wrong shapes.
#[pyclass(name = "SubmapLandmarks", module = "collabslam._core", frozen)]
pub(crate) struct PySubmapLandmarks {
    points: Vec<Vector3<f64>>,
    covariance: DMatrix<f64>,
    with_handed_on: DMatrix<f64>,
    handed_on: DMatrix<f64>,
}

#[pymethods]
impl PySubmapLandmarks {
    #[new]
    fn new(
        points: Argument<'_>,
        covariance: Argument<'_>,
        with_handed_on: Argument<'_>,
        handed_on: Argument<'_>,
    ) -> PyResult<Self> {
        Ok(Self {
            points: rows::<3>("points", &points)?,
            covariance: square("covariance", &covariance)?,
            with_handed_on: table("with_handed_on", &with_handed_on)?,
            handed_on: square("handed_on", &handed_on)?,
        })
    }

    /// Pose of a camera that sees the submap, from matches with its landmarks and their covariance.
    ///
    /// The worst match is taken out until each agrees with the others and all together pass, by chi-square.
    ///
    /// Parameters
    /// ----------
    /// camera : Camera
    /// sigma : float
    ///     Standard deviation of a pixel.
    /// slip : float
    ///     Of what all matches share, radians, as :class:`Submap` has it.
    /// landmarks : (N,) int64
    ///     Of each match, by its place among the points.
    /// uv : (N, 2) float64
    ///     Its pixel.
    /// guess : (4, 4) float64
    ///     The pose to begin with, as PnP gives it.
    /// least : int
    ///     Fewest matches that must be left.
    ///
    /// Returns
    /// -------
    /// Sight or None
    ///     None if too few matches agree.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, numbers that are not finite, or a landmark that is not there.
    #[allow(
        clippy::too_many_arguments,
        reason = "a match has a landmark and a pixel"
    )]
    fn sight(
        &self,
        py: Python<'_>,
        camera: &PyCamera,
        sigma: f64,
        slip: f64,
        landmarks: Argument<'_>,
        uv: Argument<'_>,
        guess: Argument<'_>,
        least: usize,
    ) -> PyResult<Option<PySight>> {
        let (which, uv) = (ids("landmarks", &landmarks)?, pixels("uv", &uv)?);
        same_length("uv", which.len(), uv.len())?;
        let guess = rigid("guess", &guess)?;
        let matches: Vec<_> = which.iter().map(|&k| k as usize).zip(uv).collect();
        let camera = &camera.0;
        let found = gate::enter(py, || {
            let submap = Landmarks {
                points: &self.points,
                covariance: &self.covariance,
                with_handed_on: &self.with_handed_on,
                handed_on: &self.handed_on,
            };
            core_sight(
                camera,
                Noise { sigma, slip },
                &submap,
                &matches,
                &guess,
                least,
            )
        })?;
        Ok(found.map(PySight))
    }
}
