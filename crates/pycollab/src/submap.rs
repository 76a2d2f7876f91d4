//! Submaps, and an earlier one in sight (METHOD 25).

use crate::arrays_in::{Argument, ids, pixels, rigid, rows, same_length, square, table};
use crate::arrays_out::{
    Column, Table, column, symmetric, to_ids, to_matrix, to_pose, to_table, vectors,
};
use crate::camera::PyCamera;
use crate::gate;
use ekf_core::Submap;
use ekf_core::graph::Edge;
use ekf_core::submap_pnp::{Landmarks, Noise, SubmapPnp, submap_pnp as core_submap_pnp};
use nalgebra::{DMatrix, Vector3};
use pyo3::prelude::*;

/// The way from where a submap began, as the filter knows it; of :meth:`Filter.since_submap`.
///
/// Attributes
/// ----------
/// pose : (4, 4) float64
///     Of its end from its beginning, metres.
/// revised : (K,) float64
///     By how much the estimate of what the beginning transferred has changed since.
/// covariance : (6 + K + L, 6 + K + L) float64
///     Joint, of the pose (right tangent, m and rad), the K numbers that the beginning transferred
///     and the L that the end transfers, where it has ended.
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
/// transferred : (K, K) float64
///     Covariance of what it transfers: the logarithm of the scale, and of each worn camera the
///     time-correlated error of T_CF, m and rad along the axes of C.
/// ids : (N,) int64
///     Landmarks in view.
/// points : (N, 3) float64
///     From the camera, metres.
/// covariance : (3 N, 3 N) float64
///     Their joint covariance as they stand to the camera, m^2.
/// with_transferred : (3 N, K) float64
///     Their covariance with what is transferred.
/// map_drift : float
///     Standard deviation of map drift while all that is in view is exchanged once, radians.
#[pyclass(name = "Submap", module = "collabslam._core", frozen, get_all)]
pub(crate) struct PySubmap {
    edge: Option<Py<PyEdge>>,
    pose: Table,
    pose_covariance: Table,
    transferred: Table,
    ids: Column<i64>,
    points: Table,
    covariance: Table,
    with_transferred: Table,
    map_drift: f64,
}

impl PySubmap {
    pub(crate) fn new(py: Python<'_>, submap: Submap) -> PyResult<Self> {
        let n = submap.covariance.nrows();
        Ok(Self {
            edge: submap.edge.map(|e| Py::new(py, PyEdge(e))).transpose()?,
            pose: to_pose(py, &submap.pose),
            pose_covariance: to_matrix(py, &submap.pose_covariance),
            transferred: to_table(py, &submap.transferred),
            ids: to_ids(py, submap.ids.into_iter().map(Some)),
            points: vectors(py, submap.points.into_iter()),
            covariance: symmetric(py, submap.covariance.data.into(), n),
            with_transferred: to_table(py, &submap.with_transferred),
            map_drift: submap.map_drift,
        })
    }
}

/// Where the camera is in an earlier submap; of :meth:`SubmapLandmarks.pnp`.
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
#[pyclass(name = "SubmapPnp", module = "collabslam._core", frozen)]
pub(crate) struct PySubmapPnp(pub(crate) SubmapPnp);

#[pymethods]
impl PySubmapPnp {
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
/// points, covariance, with_transferred, transferred : ndarray
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
    with_transferred: DMatrix<f64>,
    transferred: DMatrix<f64>,
}

#[pymethods]
impl PySubmapLandmarks {
    #[new]
    fn new(
        points: Argument<'_>,
        covariance: Argument<'_>,
        with_transferred: Argument<'_>,
        transferred: Argument<'_>,
    ) -> PyResult<Self> {
        Ok(Self {
            points: rows::<3>("points", &points)?,
            covariance: square("covariance", &covariance)?,
            with_transferred: table("with_transferred", &with_transferred)?,
            transferred: square("transferred", &transferred)?,
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
    /// map_drift : float
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
    /// SubmapPnp or None
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
    fn pnp(
        &self,
        py: Python<'_>,
        camera: &PyCamera,
        sigma: f64,
        map_drift: f64,
        landmarks: Argument<'_>,
        uv: Argument<'_>,
        guess: Argument<'_>,
        least: usize,
    ) -> PyResult<Option<PySubmapPnp>> {
        let (which, uv) = (ids("landmarks", &landmarks)?, pixels("uv", &uv)?);
        same_length("uv", which.len(), uv.len())?;
        let guess = rigid("guess", &guess)?;
        let matches: Vec<_> = which.iter().map(|&k| k as usize).zip(uv).collect();
        let camera = &camera.0;
        let found = gate::enter(py, || {
            let submap = Landmarks {
                points: &self.points,
                covariance: &self.covariance,
                with_transferred: &self.with_transferred,
                transferred: &self.transferred,
            };
            core_submap_pnp(
                camera,
                Noise { sigma, map_drift },
                &submap,
                &matches,
                &guess,
                least,
            )
        })?;
        Ok(found.map(PySubmapPnp))
    }
}
