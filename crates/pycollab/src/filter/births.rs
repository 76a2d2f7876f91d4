//! New features: known points at the start, candidates that wait for parallax, and features of vague depth.

use super::PyFilter;
use crate::arrays_in::{
    Argument, covariance6, ids, numbers, pixels, rows, same_length, stack, views as views_of,
};
use crate::arrays_out::{Column, column, to_ids};
use ekf_core::CandidateOutcome;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};
use pyo3::prelude::*;

/// What became of candidates that were observed.
///
/// Attributes
/// ----------
/// born : (N,) int64
///     Feature id of those that became features, -1 elsewhere.
/// off_arc : (N,) float64
///     Of those that were given up as they are where no point at rest would be: by how many times as much
///     as noise and the poses allow; 0 elsewhere.
/// held : (N,) bool
///     Those that wait where they were first seen: they may be fixed to the camera.
/// fixed : (N,) bool
///     Those that were given up as they are fixed to the camera.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct CandidateReport {
    born: Column<i64>,
    off_arc: Column<f64>,
    held: Column<bool>,
    fixed: Column<bool>,
}

/// Points of known position in C, with the error that they share.
struct KnownPoints {
    points: Vec<Vector3<f64>>,
    noise: Vec<Matrix3<f64>>,
    shared: Vec<SMatrix<f64, 3, 6>>,
    covariance: Matrix6<f64>,
}

impl KnownPoints {
    fn parse(
        points: &Argument<'_>,
        noise: &Argument<'_>,
        shared: &Argument<'_>,
        covariance: &Argument<'_>,
    ) -> PyResult<Self> {
        Ok(Self {
            points: rows::<3>("points", points)?,
            noise: stack::<3, 3>("noise", noise)?,
            shared: stack::<3, 6>("shared", shared)?,
            covariance: covariance6("covariance", covariance)?,
        })
    }
}

#[pymethods]
impl PyFilter {
    /// Starts candidates for delayed births at pixels of the present view.
    ///
    /// Parameters
    /// ----------
    /// uv : (N, 2) float64
    ///     Pixels in Cs.
    ///
    /// Returns
    /// -------
    /// (N,) int64
    ///     Their ids.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For a wrong shape, NaN, or before the start.
    fn add_candidates(&self, py: Python<'_>, uv: Argument<'_>) -> PyResult<Column<i64>> {
        let uv = pixels("uv", &uv)?;
        let ids = self.write(py, |f| f.add_candidates(&uv))?;
        Ok(to_ids(py, ids.into_iter().map(Some)))
    }

    /// Observes candidates (METHOD 5, delayed).
    ///
    /// Parameters
    /// ----------
    /// ids, uv : (N,) int64, (N, 2) float64
    ///     Candidates found in Cs and their pixels.
    ///
    /// Returns
    /// -------
    /// CandidateReport
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, unknown ids, an id given twice; the filter stays as it was.
    fn observe_candidates(
        &self,
        py: Python<'_>,
        ids: Argument<'_>,
        uv: Argument<'_>,
    ) -> PyResult<CandidateReport> {
        let (ids, uv) = (self::ids("ids", &ids)?, pixels("uv", &uv)?);
        same_length("uv", ids.len(), uv.len())?;
        let seen: Vec<_> = ids.into_iter().zip(uv).collect();
        let outcomes = self.write(py, |f| f.observe_candidates(&seen))?;
        let born = |o: &CandidateOutcome| match o {
            CandidateOutcome::Born(id) => Some(*id),
            _ => None,
        };
        let off_arc = |o: &CandidateOutcome| match o {
            CandidateOutcome::OffArc(by) => *by,
            _ => 0.0,
        };
        let which = |outcome| column(py, outcomes.iter().map(|o| *o == outcome));
        Ok(CandidateReport {
            born: to_ids(py, outcomes.iter().map(born)),
            off_arc: column(py, outcomes.iter().map(off_arc)),
            held: which(CandidateOutcome::Held),
            fixed: which(CandidateOutcome::Fixed),
        })
    }

    /// Candidates that shall wait for parallax no longer are born with a vague depth, as features of their
    /// first view.
    ///
    /// Parameters
    /// ----------
    /// ids : (N,) int64
    /// alike : bool
    ///     Whether half of the variance of their depths is common to all: then their number does not tell
    ///     how large the scene is.
    ///
    /// Returns
    /// -------
    /// (N,) int64
    ///     Feature ids, -1 where that gives no feature.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For unknown ids, or an id given twice.
    #[pyo3(signature = (ids, *, alike = false))]
    fn promote_candidates(
        &self,
        py: Python<'_>,
        ids: Argument<'_>,
        alike: bool,
    ) -> PyResult<Column<i64>> {
        let ids = self::ids("ids", &ids)?;
        let born = self.write(py, |f| f.promote_candidates(&ids, alike))?;
        Ok(to_ids(py, born))
    }

    /// Forgets candidates that were lost.
    ///
    /// Parameters
    /// ----------
    /// ids : (N,) int64
    ///     Those that are not candidates any more do not count.
    fn drop_candidates(&self, py: Python<'_>, ids: Argument<'_>) -> PyResult<()> {
        let ids = self::ids("ids", &ids)?;
        self.write(py, |f| {
            f.drop_candidates(&ids);
            Ok(())
        })
    }

    /// Starts features with a vague depth at pixels of the present view; the filter too, in an arbitrary
    /// unit, if it has not started.
    ///
    /// Parameters
    /// ----------
    /// uv : (N, 2) float64
    ///     Pixels in Cs.
    ///
    /// Returns
    /// -------
    /// (N,) int64
    ///     Feature ids, -1 where the pixel has no ray.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For a wrong shape or NaN.
    fn add_undelayed(&self, py: Python<'_>, uv: Argument<'_>) -> PyResult<Column<i64>> {
        let uv = pixels("uv", &uv)?;
        let ids = self.write(py, |f| f.add_undelayed(&uv))?;
        Ok(to_ids(py, ids))
    }

    /// The scale-free start: at the last of several views of one camera, if they tell how it has moved
    /// (METHOD 5).
    ///
    /// W is the first view; the unit is such that the mean inverse depth is ``birth.undelayed_rho``.
    ///
    /// Parameters
    /// ----------
    /// times : (K,) float64
    ///     Of the views, seconds, increasing.
    /// views : (K, N, 2) float64
    ///     Pixels in Cs of the same N points in each of them.
    ///
    /// Returns
    /// -------
    /// (N,) int64
    ///     Feature ids, -1 for a point that gives none; all are -1 where the views do not tell it yet: the
    ///     filter has not started then.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, fewer than two views or more than 20, more than 500 points, times that do
    ///     not increase, or a filter that has
    ///     started; it stays as it was.
    fn start_from_views(
        &self,
        py: Python<'_>,
        times: Argument<'_>,
        views: Argument<'_>,
    ) -> PyResult<Column<i64>> {
        let (times, views) = (numbers("times", &times)?, views_of("views", &views)?);
        let ids = self.write(py, |f| f.start_from_views(&times, &views))?;
        Ok(to_ids(py, ids))
    }

    /// Adds a rigid target in view: points of known position in C (METHOD 10). A filter that has not
    /// started does so from them.
    ///
    /// Later bearings of them are metric: what they do not share is all that their distances can be wrong by.
    ///
    /// Parameters
    /// ----------
    /// points : (N, 3) float64
    ///     Metres in C.
    /// noise : (N, 3, 3) float64
    ///     Covariance of each point by itself, m^2.
    /// shared : (N, 3, 6) float64
    ///     Derivative of each point by the 6-number error of the target's pose.
    /// covariance : (6, 6) float64
    ///     Covariance of that error.
    ///
    /// Returns
    /// -------
    /// (N,) int64
    ///     Feature ids.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, a covariance that is none, or a point at the camera.
    fn add_points(
        &self,
        py: Python<'_>,
        points: Argument<'_>,
        noise: Argument<'_>,
        shared: Argument<'_>,
        covariance: Argument<'_>,
    ) -> PyResult<Column<i64>> {
        let k = KnownPoints::parse(&points, &noise, &shared, &covariance)?;
        let ids = self.write(py, |f| {
            f.add_points(&k.points, &k.noise, &k.shared, &k.covariance)
        })?;
        Ok(to_ids(py, ids.into_iter().map(Some)))
    }
}
