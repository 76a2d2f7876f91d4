//! A frame's measurements go into the filter.

use super::PyFilter;
use super::measurements::{PyDepthMeasurement, PyWornMeasurement, bearings, followed};
use super::report::PyMapRelocalisation;
use super::report::{PyUpdateReport, to_worn_pose};
use crate::arrays_in::{Argument, ids, matrix, pixels, pose, rows, same_length, square};
use crate::arrays_out::{Table, to_ids};
use ekf_core::Measurements;
use ekf_core::{EkfError, KnownMap, UpdateReport};
use pyo3::prelude::*;

#[pymethods]
impl PyFilter {
    /// Validates a frame's matches, updates once, and starts features that have depth (METHOD 5-8).
    ///
    /// Measurements that would break the filter (S not positive definite, a result that is not finite, a
    /// negative variance) are refused: the report says so and the filter stays as it was.
    ///
    /// Parameters
    /// ----------
    /// searched : (S,) int64
    ///     Features that were looked for.
    /// ids, uv : (N,) int64, (N, 2) float64
    ///     Features found in Cs and their pixels.
    /// views : sequence of WornMeasurement
    ///     Measured pose and matched pixels of each worn camera: the first is measured together with
    ///     what Cs found, each other after all before it. A new point of several of them, at the same
    ///     pixel of the same frame of Cs, is one.
    /// depths : DepthMeasurement, optional
    ///     Depths from any other sensor.
    /// min_inliers : int
    ///     Fewest accepted bearings with which the frame is used; with fewer nothing of it is.
    /// max_speed : float, optional
    ///     Greatest speed, m/s, with which the frame is used: if the camera would be faster after it
    ///     nothing of it is.
    /// followed : (float, (K, 2) float64, (K, 2) float64), optional
    ///     Time of the frame before, seconds, and pixels of points that were followed from there into the
    ///     present one: if the turn that they show excludes the one that the camera would have made (METHOD
    ///     27), nothing of the frame is used.
    ///
    /// Returns
    /// -------
    /// UpdateReport
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, unknown ids, an impossible pose or covariance; the filter stays as it
    ///     was.
    #[expect(clippy::too_many_arguments, reason = "nine names in Python")]
    #[pyo3(signature = (searched, ids, uv, *, views = Vec::new(), depths = None, min_inliers = 0, max_speed = None, followed = None))]
    fn update(
        &self,
        py: Python<'_>,
        searched: Argument<'_>,
        ids: Argument<'_>,
        uv: Argument<'_>,
        views: Vec<PyRef<'_, PyWornMeasurement>>,
        depths: Option<&PyDepthMeasurement>,
        min_inliers: usize,
        max_speed: Option<f64>,
        followed: Option<(f64, Argument<'_>, Argument<'_>)>,
    ) -> PyResult<PyUpdateReport> {
        let measurements = Measurements {
            searched: self::ids("searched", &searched)?,
            bearings: bearings(&ids, &uv)?,
            views: views.iter().map(|worn| worn.0.clone()).collect(),
            depths: depths.map_or_else(Vec::new, |depths| depths.0.clone()),
            min_inliers,
            max_speed,
            followed: followed
                .map(|(since, before, now)| self::followed(since, &before, &now))
                .transpose()?,
        };
        let report = self.write(py, |f| match f.update(&measurements) {
            Err(error @ (EkfError::NotPositiveDefinite { .. } | EkfError::Unsound { .. })) => {
                Ok(UpdateReport::refused(&measurements, error))
            }
            done => done,
        })?;
        PyUpdateReport::new(py, report)
    }

    /// Where a worn camera was, as its stated T_CF and the camera's pose have it: of a view that was not
    /// measured.
    ///
    /// Parameters
    /// ----------
    /// worn : WornMeasurement
    ///     Its matches are not looked at.
    ///
    /// Returns
    /// -------
    /// pose : (4, 4) float64
    ///     T_WF: maps points of F into W, metres.
    /// covariance : (6, 6) float64
    ///     Of it over (translation m, rotation rad), right tangent.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     Before the start, and what `carry_worn` and `check_worn` say.
    fn worn_pose(&self, py: Python<'_>, worn: &PyWornMeasurement) -> PyResult<(Table, Table)> {
        let found = self.read(py, |f| f.worn_pose(&worn.0))?;
        Ok(to_worn_pose(py, &found))
    }

    /// Puts a lost camera where matches with the map say, and forgets what was believed about it.
    ///
    /// The pose gives the point of linearisation only; the covariance is that of the matches and the map.
    /// Velocities start anew. The pose is taken if enough of the matches pass the batch test.
    ///
    /// Parameters
    /// ----------
    /// pose : (4, 4) float64
    ///     T_WC that explains the matches, as PnP gives it, metres.
    /// ids, uv : (N,) int64, (N, 2) float64
    ///     Features and their pixels in Cs.
    /// least : int, optional
    ///     Matches that have to pass, 4 or more; ``lost.min_matches`` if left out.  Fewer do for points that
    ///     say themselves which they are, as the corners of a printed tag.
    /// predicted : bool
    ///     Whether prediction counts for something: where it excludes the pose, either is wrong, and half the
    ///     square of what lies between them joins the covariance of the map's place (METHOD 17).
    ///
    /// Returns
    /// -------
    /// UpdateReport
    ///     ``accepted`` says whether the pose was taken; otherwise the filter is as it was.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, unknown ids, an impossible pose, a ``least`` below 4, or before the start;
    ///     the filter stays as it was.
    #[pyo3(signature = (pose, ids, uv, *, least = None, predicted = false))]
    fn relocalise(
        &self,
        py: Python<'_>,
        pose: Argument<'_>,
        ids: Argument<'_>,
        uv: Argument<'_>,
        least: Option<usize>,
        predicted: bool,
    ) -> PyResult<PyUpdateReport> {
        let pose = self::pose("pose", &pose)?;
        let matches = bearings(&ids, &uv)?;
        let report = self.write(py, |f| f.relocalise(&pose, &matches, least, predicted))?;
        PyUpdateReport::new(py, report)
    }

    /// Starts a new map from a view of Cf, where the camera is predicted to be; the map of before is gone.
    ///
    /// What is left of the pose's certainty becomes that of the new map's place in W: it is part of
    /// `pose_covariance` and of the landmarks' covariance. Take `known_map` before, to come back to the map
    /// with `relocalise_in`.
    ///
    /// Parameters
    /// ----------
    /// worn : WornMeasurement
    ///     All its ids -1.
    /// gone : (3, 3) float64
    ///     Square, in m^2, of the way in W that the camera went in a map that may be of the wrong size: half
    ///     of it joins the covariance of the new map's place.
    ///
    /// Returns
    /// -------
    /// UpdateReport
    ///     ``accepted`` says whether the map was started (``worn.start_births``); otherwise the filter is
    ///     as it was.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For NaN, an id that is not -1, an impossible pose, covariance or square, or before the start; the
    ///     filter stays as it was.
    fn restart(
        &self,
        py: Python<'_>,
        worn: &PyWornMeasurement,
        gone: Argument<'_>,
    ) -> PyResult<PyUpdateReport> {
        let gone = matrix::<3, 3>("gone", &gone)?;
        let report = self.write(py, |f| f.restart(&worn.0, &gone))?;
        PyUpdateReport::new(py, report)
    }

    /// Puts a lost camera into another map, where its matches with that say, and forgets the present one.
    ///
    /// Parameters
    /// ----------
    /// landmarks : (M, 6) float64
    ///     ``x y z theta phi rho`` of each in W (METHOD 2): metres, radians, 1/m.
    /// covariance : (6 M, 6 M) float64
    ///     Their joint covariance.
    /// place : (6, 6) float64
    ///     Covariance of the map's place in W, (translation m, rotation rad).
    /// pose : (4, 4) float64
    ///     T_WC that explains the matches, as PnP gives it, metres.
    /// index, uv : (N,) int64, (N, 2) float64
    ///     Landmarks by their place in the map, and their pixels in Cs.
    /// least, predicted
    ///     As with `relocalise`.
    ///
    /// Returns
    /// -------
    /// MapRelocalisation
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, a covariance that is none, an impossible pose, a ``least`` below 4, or
    ///     before the start; the filter stays as it was.
    #[expect(clippy::too_many_arguments, reason = "seven names in Python")]
    #[pyo3(signature = (landmarks, covariance, place, pose, index, uv, *, least = None, predicted = false))]
    fn relocalise_in(
        &self,
        py: Python<'_>,
        landmarks: Argument<'_>,
        covariance: Argument<'_>,
        place: Argument<'_>,
        pose: Argument<'_>,
        index: Argument<'_>,
        uv: Argument<'_>,
        least: Option<usize>,
        predicted: bool,
    ) -> PyResult<PyMapRelocalisation> {
        let map = KnownMap {
            landmarks: rows::<6>("landmarks", &landmarks)?,
            covariance: square("covariance", &covariance)?,
            place: matrix::<6, 6>("place", &place)?,
        };
        let pose = self::pose("pose", &pose)?;
        let (index, uv) = (self::ids("index", &index)?, pixels("uv", &uv)?);
        same_length("uv", index.len(), uv.len())?;
        let places = index.into_iter().map(|place| place as usize);
        let matches: Vec<_> = places.zip(uv).collect();
        let (report, ids) = self.write(py, |f| {
            f.relocalise_in(&map, &pose, &matches, least, predicted)
        })?;
        PyMapRelocalisation::new(py, report, to_ids(py, ids.into_iter().map(Some)))
    }
}
