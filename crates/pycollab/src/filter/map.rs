//! The map: its landmarks, its upkeep, and maps of earlier runs.

use super::PyFilter;
use crate::arrays_in::{Argument, ids, matrix, rows, square};
use crate::arrays_out::{
    Column, Stack, Table, column, stacked, symmetric, to_ids, to_matrix, vectors,
};
use crate::submap::{PyEdge, PySubmap};
use ekf_core::KnownMap;
use pyo3::prelude::*;

/// The map with the uncertainty of each landmark.
///
/// Attributes
/// ----------
/// ids : (N,) int64
/// points : (N, 3) float64
///     In W, metres.
/// covariance : (N, 3, 3) float64
///     Of each point, m^2.
/// rho_ratio : (N,) float64
///     Relative standard deviation of its inverse range, sd(rho) / rho.
#[pyclass(name = "Landmarks", module = "collabslam._core", frozen, get_all)]
pub(crate) struct PyLandmarks {
    ids: Column<i64>,
    points: Table,
    covariance: Stack<f64>,
    rho_ratio: Column<f64>,
}

/// A map for another filter to start in; see :meth:`Filter.start_from_map`.
///
/// Attributes
/// ----------
/// ids : (N,) int64
///     Features of the filter that made it.
/// landmarks : (N, 6) float64
///     ``x y z theta phi rho`` of each in W (METHOD 2): metres, radians, 1/m.
/// covariance : (6 N, 6 N) float64
///     Their joint covariance.
/// place : (6, 6) float64
///     Covariance of the map's place in W, (translation m, rotation rad).
#[pyclass(name = "KnownMap", module = "collabslam._core", frozen, get_all)]
pub(crate) struct PyKnownMap {
    ids: Column<i64>,
    landmarks: Table,
    covariance: Table,
    place: Table,
}

#[pymethods]
impl PyFilter {
    /// The map, without features that have no point yet (rho <= 0).
    ///
    /// Returns
    /// -------
    /// Landmarks
    fn landmarks(&self, py: Python<'_>) -> PyResult<PyLandmarks> {
        let landmarks = self.read(py, |f| Ok(f.landmarks()))?;
        Ok(PyLandmarks {
            ids: to_ids(py, landmarks.iter().map(|l| Some(l.id))),
            points: vectors(py, landmarks.iter().map(|l| l.point)),
            covariance: stacked(py, landmarks.iter().map(|l| l.covariance)),
            rho_ratio: column(py, landmarks.iter().map(|l| l.rho_ratio)),
        })
    }

    /// Deletes failing features, the longest unseen of too many, candidates that are too old, and clones
    /// nobody needs.
    ///
    /// Parameters
    /// ----------
    /// keep : (K,) int64, optional
    ///     Features that stay, however long they were not seen, if they do not fail: landmarks that are known
    ///     again for certain. They do not count for ``map.max_features``.
    ///
    /// Returns
    /// -------
    /// (N,) int64
    ///     The deleted features.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For a wrong shape, or ids that are none.
    #[pyo3(signature = (keep = None))]
    fn manage_map(&self, py: Python<'_>, keep: Option<Argument<'_>>) -> PyResult<Column<i64>> {
        let keep = keep.map_or_else(|| Ok(Vec::new()), |keep| ids("keep", &keep))?;
        let gone = self.write(py, |f| Ok(f.manage_map(&keep)))?;
        Ok(to_ids(py, gone.into_iter().map(Some)))
    }

    /// Removes features.
    ///
    /// Parameters
    /// ----------
    /// ids : (N,) int64
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For unknown ids; the filter stays as it was.
    fn remove_features(&self, py: Python<'_>, ids: Argument<'_>) -> PyResult<()> {
        let ids = self::ids("ids", &ids)?;
        self.write(py, |f| f.remove_features(&ids))
    }

    /// Ends the present submap and begins the next one; no estimate changes.
    ///
    /// Parameters
    /// ----------
    /// seen : (N,) int64
    ///     Features measured in this frame; those of good depth are taken down.
    ///
    /// Returns
    /// -------
    /// Submap
    ///
    /// Raises
    /// ------
    /// InputError
    ///     Before the start, or for unknown ids; the filter stays as it was.
    fn end_submap(&self, py: Python<'_>, seen: Argument<'_>) -> PyResult<PySubmap> {
        let seen = ids("seen", &seen)?;
        let submap = self.write(py, |f| f.end_submap(&seen))?;
        PySubmap::new(py, submap)
    }

    /// The way since the last submap ended, or None where none has in this map.
    ///
    /// Returns
    /// -------
    /// Edge or None
    fn since_submap(&self, py: Python<'_>) -> PyResult<Option<PyEdge>> {
        let edge = self.read(py, |f| Ok(f.since_submap()))?;
        Ok(edge.map(PyEdge))
    }

    /// The map to start another filter in.
    ///
    /// Returns
    /// -------
    /// KnownMap
    fn known_map(&self, py: Python<'_>) -> PyResult<PyKnownMap> {
        let (ids, map) = self.read(py, |f| Ok(f.known_map()))?;
        let n = 6 * ids.len();
        Ok(PyKnownMap {
            ids: to_ids(py, ids.into_iter().map(Some)),
            landmarks: vectors(py, map.landmarks.into_iter()),
            covariance: symmetric(py, map.covariance.data.into(), n),
            place: to_matrix(py, &map.place),
        })
    }

    /// Starts in a map, not knowing where the camera is; :meth:`relocalise` is to follow.
    ///
    /// Parameters
    /// ----------
    /// landmarks : (N, 6) float64
    ///     ``x y z theta phi rho`` of each in W (METHOD 2): metres, radians, 1/m.
    /// covariance : (6 N, 6 N) float64
    ///     Their joint covariance.
    /// place : (6, 6) float64
    ///     Covariance of the map's place in W, (translation m, rotation rad).
    ///
    /// Returns
    /// -------
    /// (N,) int64
    ///     Feature ids, in the map's order.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, a covariance that is none, or a filter that has started; it stays as it
    ///     was.
    fn start_from_map(
        &self,
        py: Python<'_>,
        landmarks: Argument<'_>,
        covariance: Argument<'_>,
        place: Argument<'_>,
    ) -> PyResult<Column<i64>> {
        let map = KnownMap {
            landmarks: rows::<6>("landmarks", &landmarks)?,
            covariance: square("covariance", &covariance)?,
            place: matrix::<6, 6>("place", &place)?,
        };
        let ids = self.write(py, |f| f.start_from_map(&map))?;
        Ok(to_ids(py, ids.into_iter().map(Some)))
    }
}
