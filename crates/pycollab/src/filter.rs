//! The filter.

use crate::camera::PyCamera;
use crate::convert::{
    Argument, covariance6, ids, matrix, numbers, optional_ids, pixels, pose, rows, same_length,
    square, stack, stacked, to_ids, to_matrix, to_pose, vectors,
};
use crate::errors::to_python;
use crate::settings;
use ekf_core::{Bearing, DepthObservation, Measurements, WornObservation, WornPair};
use ekf_core::{
    CandidateOutcome, ConditionalPrediction, EkfError, Filter, KnownMap, Outcome, PredictedFeature,
    UpdateReport,
};
use nalgebra::{Matrix2, Vector2};
use numpy::{PyArray1, PyArray2, PyArray3, PyArrayMethods};
use pyo3::intern;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyDict};

/// ``(t_cf (4, 4), covariance (6, 6), ids (M,), uv (M, 2), uv_f (M, 2))``
type WornArgument<'py> = (
    Argument<'py>,
    Argument<'py>,
    Argument<'py>,
    Argument<'py>,
    Argument<'py>,
);

/// ``(ids (K,), uv (K, 2), depth (K,), sigma (K,))``
type DepthArgument<'py> = (Argument<'py>, Argument<'py>, Argument<'py>, Argument<'py>);

/// What one update did.
#[pyclass(name = "UpdateReport", module = "collabslam._core", frozen)]
pub(crate) struct PyUpdateReport(UpdateReport);

fn outcome_name(outcome: &Outcome) -> &'static str {
    match outcome {
        Outcome::Pixel => "pixel",
        Outcome::Depth => "depth",
        Outcome::Replaced => "replaced",
        Outcome::TooUncertain => "too-uncertain",
        Outcome::NotVisible => "not-visible",
        Outcome::RejectedGate => "rejected-gate",
        Outcome::RejectedBatch => "rejected-batch",
        Outcome::RejectedConditional => "rejected-conditional",
        Outcome::Born(_) => "born",
        Outcome::Unused => "unused",
        Outcome::Refused => "refused",
    }
}

fn names(outcomes: &[Outcome]) -> Vec<&'static str> {
    outcomes.iter().map(outcome_name).collect()
}

fn born_ids<'py>(py: Python<'py>, outcomes: &[Outcome]) -> Bound<'py, PyArray1<i64>> {
    to_ids(
        py,
        outcomes.iter().map(|o| match o {
            Outcome::Born(id) => Some(*id),
            _ => None,
        }),
    )
}

#[pymethods]
impl PyUpdateReport {
    /// What became of each bearing: ``pixel``, ``replaced`` (by its depth rows), ``too-uncertain`` (predicted no
    /// better than somewhere in the image), ``not-visible``, ``rejected-gate``, ``rejected-batch``,
    /// ``rejected-conditional``.
    #[getter]
    fn bearings(&self) -> Vec<&'static str> {
        names(&self.0.bearings)
    }

    /// What became of each worn pair: ``pixel``, ``depth``, ``born``, ``too-uncertain``, ``not-visible``,
    /// ``rejected-gate``, ``rejected-batch``, ``unused``.
    #[getter]
    fn pairs(&self) -> Vec<&'static str> {
        names(&self.0.pairs)
    }

    /// What became of each depth: ``depth``, ``born``, ``not-visible``, ``rejected-gate``, ``rejected-batch``.
    #[getter]
    fn depths(&self) -> Vec<&'static str> {
        names(&self.0.depths)
    }

    /// Feature id born from each worn pair, -1 for none.
    #[getter]
    fn pair_births<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        born_ids(py, &self.0.pairs)
    }

    /// Feature id born from each depth, -1 for none.
    #[getter]
    fn depth_births<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        born_ids(py, &self.0.depths)
    }

    /// Why the whole frame was refused, or None: its update would have broken the filter, which is as it was before.
    #[getter]
    fn refused(&self) -> Option<String> {
        self.0.refused.as_ref().map(ToString::to_string)
    }

    /// Number of linearisations of the update.
    #[getter]
    fn iterations(&self) -> usize {
        self.0.iterations
    }

    /// Normalised innovation squared of the accepted batch.
    #[getter]
    fn nis(&self) -> f64 {
        self.0.nis
    }

    /// Its degrees of freedom.
    #[getter]
    fn dof(&self) -> usize {
        self.0.dof
    }

    /// Number of matches that the batch test left out.
    #[getter]
    fn order(&self) -> usize {
        self.0.order
    }

    /// Whether the batch test finished its exact search.
    #[getter]
    fn exact(&self) -> bool {
        self.0.exact
    }

    /// Whether the frame was used: False if fewer bearings than asked for were accepted.
    #[getter]
    fn believed(&self) -> bool {
        self.0.accepted
    }

    /// Estimated error of T_CF after the update, (translation m, rotation rad), right tangent.
    #[getter]
    fn worn_error<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.worn_error.as_slice())
    }
}

/// The Extended Kalman Filter. One filter per thread; two threads may run two filters.
///
/// Parameters
/// ----------
/// camera : Camera
///     Cs.
/// worn_camera : Camera, optional
///     Cf; needed to take its pixels.
/// settings : dict, optional
///     Dotted key to value, over the defaults of :func:`settings_schema`.
/// switches : dict, optional
///     The same of the lab's switches, which take parts of the method away to compare with.
///
/// Raises
/// ------
/// SettingsError
///     For an unknown key or an impossible value.
#[pyclass(name = "Filter", module = "collabslam._core")]
pub(crate) struct PyFilter(Filter);

#[pymethods]
impl PyFilter {
    #[new]
    #[pyo3(signature = (camera, worn_camera = None, *, settings = None, switches = None))]
    fn new(
        camera: &PyCamera,
        worn_camera: Option<PyRef<'_, PyCamera>>,
        settings: Option<&Bound<'_, PyDict>>,
        switches: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Self> {
        let settings = settings::from_dicts(settings, switches)?;
        let worn = worn_camera.map(|c| c.0.clone());
        Ok(Self(Filter::new(settings, camera.0.clone(), worn)))
    }

    /// Whether the filter has a map to localise in.
    #[getter]
    fn started(&self) -> bool {
        self.0.started()
    }

    /// Time of the last prediction, seconds, or None.
    #[getter]
    fn time(&self) -> Option<f64> {
        self.0.time()
    }

    /// Number of features in the map.
    #[getter]
    fn map_size(&self) -> usize {
        self.0.map_size()
    }

    /// Number of candidates that wait for parallax.
    #[getter]
    fn candidate_count(&self) -> usize {
        self.0.candidate_count()
    }

    /// T_WC, (4, 4) float64, metres.
    #[getter]
    fn pose<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let (rotation, translation) = self.0.pose();
        to_pose(py, &rotation, &translation)
    }

    /// (6, 6) covariance of the pose, (translation m, rotation rad), right tangent of T_WC (METHOD 1).
    #[getter]
    fn pose_covariance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        to_matrix(py, &self.0.pose_covariance())
    }

    /// Velocity in W, (3,) m/s.
    #[getter]
    fn velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.velocity().as_slice())
    }

    /// Angular velocity in C, (3,) rad/s.
    #[getter]
    fn angular_velocity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, self.0.angular_velocity().as_slice())
    }

    /// The whole state vector, (n,) float64: camera (13), then the blocks of :attr:`blocks`.
    #[getter]
    fn mean<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_slice(py, py.detach(|| self.0.state()).mean())
    }

    /// The whole covariance P, (n, n) float64, cross-covariances included.
    #[getter]
    fn covariance<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        let p = py.detach(|| self.0.state().covariance().to_dense());
        let n = p.nrows();
        // Symmetric: by column or by row is the same.
        let flat = PyArray1::from_vec(py, p.data.into());
        flat.reshape([n, n]).expect("n * n entries")
    }

    /// Layout of the state after the camera: a list of ``(id, kind, offset, size)``.
    #[getter]
    fn blocks(&self, py: Python<'_>) -> Vec<(u64, String, usize, usize)> {
        let blocks = py.detach(|| self.0.state()).layout().blocks();
        blocks
            .iter()
            .map(|b| (b.id, b.kind.name().into(), b.offset, b.kind.dim()))
            .collect()
    }

    /// Least eigenvalue of the diagonal-scaled P: P is sound above -1e-10 (METHOD 3). O(n^3).
    fn soundness(&self, py: Python<'_>) -> f64 {
        py.detach(|| self.0.state().covariance().least_scaled_eigenvalue())
    }

    /// Checks that the filter is sound (METHOD 3): mean and P finite, variances positive, quaternions of unit length,
    /// and `soundness` above -1e-10. O(n^3).
    ///
    /// Raises
    /// ------
    /// FilterError
    ///     Saying what is wrong.
    fn check(&self, py: Python<'_>) -> PyResult<()> {
        py.detach(|| self.0.check()).map_err(to_python)
    }

    /// The filter as bytes, for :meth:`restore`: cameras, settings, mean, P, candidates and counters, with version and
    /// checksum. The filter restored goes on bit for bit as this one does.
    fn snapshot<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        let bytes = py.detach(|| self.0.snapshot());
        PyBytes::new(py, &bytes)
    }

    /// A new filter from the bytes of :meth:`snapshot`.
    ///
    /// Parameters
    /// ----------
    /// data : bytes
    ///
    /// Raises
    /// ------
    /// DataError
    ///     If the bytes are cut short, altered or of another version.
    #[staticmethod]
    fn restore(py: Python<'_>, data: &[u8]) -> PyResult<Self> {
        let filter = py.detach(|| Filter::restore(data));
        filter.map(Self).map_err(to_python)
    }

    /// Predicts to time ``t`` (seconds). Before the start only the time is noted.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If ``t`` does not follow the last time (a step of zero is none), or is more than an hour after it.
    fn predict(&mut self, py: Python<'_>, t: f64) -> PyResult<()> {
        let filter = &mut self.0;
        py.detach(|| filter.predict(t)).map_err(to_python)
    }

    /// Every feature that should be visible in Cs.
    ///
    /// Returns
    /// -------
    /// dict
    ///     ``ids`` (N,) int64; ``uv`` (N, 2) px; ``s`` (N, 2, 2) innovation covariance px^2;
    ///     ``points`` (N, 3) metres in W; ``rho`` (N,) inverse range now, 1/m; ``rho_sd`` (N,).
    fn predict_pixels<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let seen = py.detach(|| self.0.predict_pixels());
        let n = seen.len();
        let out = PyDict::new(py);
        let ids = to_ids(py, seen.iter().map(|f| Some(f.id)));
        let numbers = |of: fn(&PredictedFeature) -> f64| {
            PyArray1::from_vec(py, seen.iter().map(of).collect())
        };
        let points = vectors(py, seen.iter().map(|f| f.point), n);
        out.set_item(intern!(py, "ids"), ids)?;
        out.set_item(intern!(py, "uv"), vectors(py, seen.iter().map(|f| f.uv), n))?;
        out.set_item(intern!(py, "s"), stacked(py, seen.iter().map(|f| f.s), n))?;
        out.set_item(intern!(py, "points"), points)?;
        out.set_item(intern!(py, "rho"), numbers(|f| f.rho))?;
        out.set_item(intern!(py, "rho_sd"), numbers(|f| f.rho_sd))?;
        Ok(out)
    }

    /// Where features are expected once others of the same frame have been found (METHOD 7).
    ///
    /// Those found tell the camera's motion since the last frame, which is most of what a prediction does not know. Some
    /// that contradict the most do no harm. The filter stays as it is.
    ///
    /// Parameters
    /// ----------
    /// found, uv : (N,) int64, (N, 2) float64
    ///     Features found in Cs and their pixels.
    /// ids : (M,) int64
    ///     Others.
    ///
    /// Returns
    /// -------
    /// uv : (M, 2) float64
    ///     Pixels in Cs; NaN where nothing is expected of a feature.
    /// s : (M, 2, 2) float64
    ///     Their covariances, measurement noise included, px^2.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, unknown ids, an id given twice.
    fn predict_given<'py>(
        &mut self,
        py: Python<'py>,
        found: Argument<'py>,
        uv: Argument<'py>,
        ids: Argument<'py>,
    ) -> PyResult<(Bound<'py, PyArray2<f64>>, Bound<'py, PyArray3<f64>>)> {
        let (found, ids) = (bearings(&found, &uv)?, self::ids("ids", &ids)?);
        let filter = &mut self.0;
        let expected = py
            .detach(|| filter.predict_conditional(&found, &ids))
            .map_err(to_python)?;
        let nothing = ConditionalPrediction {
            uv: Vector2::repeat(f64::NAN),
            s: Matrix2::identity(),
        };
        let expected: Vec<_> = expected.into_iter().map(|e| e.unwrap_or(nothing)).collect();
        Ok((
            vectors(py, expected.iter().map(|e| e.uv), expected.len()),
            stacked(py, expected.iter().map(|e| e.s), expected.len()),
        ))
    }

    /// Validates a frame's matches, updates once, and starts features that have depth (METHOD 5-8).
    ///
    /// Measurements that would break the filter (S not positive definite, a result that is not finite, a negative
    /// variance) are refused: the report says so and the filter stays as it was.
    ///
    /// Parameters
    /// ----------
    /// searched : (S,) int64
    ///     Features that were looked for.
    /// ids, uv : (N,) int64, (N, 2) float64
    ///     Features found in Cs and their pixels.
    /// worn : tuple, optional
    ///     ``(t_cf (4, 4), covariance (6, 6), ids (M,), uv (M, 2), uv_f (M, 2))``: the worn camera's measured pose
    ///     and matched pixels; id -1 is a new point.
    /// worn_bias : (6, 6) float64, optional
    ///     The part of that covariance that lasts from frame to frame; ``worn.bias_share`` of it if left out.
    /// depths : tuple, optional
    ///     ``(ids (K,), uv (K, 2), depth (K,), sigma (K,))``: depth along the optical axis from any other sensor,
    ///     metres; id -1 is a new point.
    /// least : int
    ///     Fewest accepted bearings with which the frame is believed; with fewer nothing of it is used.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, unknown ids, an impossible pose or covariance; the filter stays as it was.
    #[pyo3(signature = (searched, ids, uv, *, worn = None, worn_bias = None, depths = None, least = 0))]
    #[expect(clippy::too_many_arguments, reason = "keywords in Python")]
    fn update(
        &mut self,
        py: Python<'_>,
        searched: Argument<'_>,
        ids: Argument<'_>,
        uv: Argument<'_>,
        worn: Option<WornArgument<'_>>,
        worn_bias: Option<Argument<'_>>,
        depths: Option<DepthArgument<'_>>,
        least: usize,
    ) -> PyResult<PyUpdateReport> {
        let measurements = Measurements {
            searched: self::ids("searched", &searched)?,
            bearings: bearings(&ids, &uv)?,
            worn: worn
                .map(|w| worn_observation(&w, worn_bias.as_ref()))
                .transpose()?,
            depths: depths.map_or(Ok(Vec::new()), |d| depth_observations(&d))?,
            min_inliers: least,
        };
        let filter = &mut self.0;
        match py.detach(|| filter.update(&measurements)) {
            Ok(report) => Ok(PyUpdateReport(report)),
            Err(error @ (EkfError::NotPositiveDefinite { .. } | EkfError::Unsound { .. })) => {
                Ok(PyUpdateReport(UpdateReport::refused(&measurements, error)))
            }
            Err(error) => Err(to_python(error)),
        }
    }

    /// Puts a lost camera where matches with the map say, and forgets what was believed about it.
    ///
    /// The pose gives the point of linearisation only; the covariance is that of the matches and the map. Velocities start
    /// anew. The pose is taken if ``lost.min_matches`` of the matches pass the batch test.
    ///
    /// Parameters
    /// ----------
    /// pose : (4, 4) float64
    ///     T_WC that explains the matches, as PnP gives it.
    /// ids, uv : (N,) int64, (N, 2) float64
    ///     Features and their pixels in Cs.
    ///
    /// Returns
    /// -------
    /// UpdateReport
    ///     ``believed`` says whether the pose was taken; otherwise the filter is as it was.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, unknown ids, an impossible pose, or before the start; the filter stays as it was.
    fn relocalise(
        &mut self,
        py: Python<'_>,
        pose: Argument<'_>,
        ids: Argument<'_>,
        uv: Argument<'_>,
    ) -> PyResult<PyUpdateReport> {
        let pose = self::pose("pose", &pose)?;
        let matches = bearings(&ids, &uv)?;
        let filter = &mut self.0;
        py.detach(|| filter.relocalise(&pose, &matches))
            .map(PyUpdateReport)
            .map_err(to_python)
    }

    /// Starts a new map from a view of Cf, where the camera is predicted to be; the map of before is gone.
    ///
    /// What is left of the pose's certainty becomes that of the new map's place in W: it is part of `pose_covariance` and of
    /// the landmarks' covariance. Take `known_map` before, to come back to the map with `relocalise_in`.
    ///
    /// Parameters
    /// ----------
    /// worn : tuple
    ///     As for `update`, all ids -1.
    /// worn_bias : (6, 6) float64, optional
    ///     As for `update`.
    ///
    /// Returns
    /// -------
    /// UpdateReport
    ///     ``believed`` says whether the map was started (``worn.start_births``); otherwise the filter is as it was.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, an id that is not -1, an impossible pose or covariance, or before the start; the filter
    ///     stays as it was.
    #[pyo3(signature = (worn, worn_bias = None))]
    fn restart(
        &mut self,
        py: Python<'_>,
        worn: WornArgument<'_>,
        worn_bias: Option<Argument<'_>>,
    ) -> PyResult<PyUpdateReport> {
        let worn = worn_observation(&worn, worn_bias.as_ref())?;
        let filter = &mut self.0;
        py.detach(|| filter.restart(&worn))
            .map(PyUpdateReport)
            .map_err(to_python)
    }

    /// Puts a lost camera into another map, where its matches with that say, and forgets the map that it is in.
    ///
    /// Parameters
    /// ----------
    /// landmarks, covariance, drift
    ///     As `known_map` gives them.
    /// pose : (4, 4) float64
    ///     T_WC that explains the matches, as PnP gives it.
    /// index, uv : (N,) int64, (N, 2) float64
    ///     Landmarks by their place in the map, and their pixels in Cs.
    ///
    /// Returns
    /// -------
    /// report : UpdateReport
    ///     ``believed`` says whether the pose was taken; otherwise the filter is as it was.
    /// ids : (M,) int64
    ///     The new feature ids of the map's landmarks, in its order; none where the pose was not taken.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, a covariance that is none, an impossible pose, or before the start; the filter stays as
    ///     it was.
    #[expect(clippy::too_many_arguments, reason = "a map is three arrays")]
    fn relocalise_in<'py>(
        &mut self,
        py: Python<'py>,
        landmarks: Argument<'py>,
        covariance: Argument<'py>,
        drift: Argument<'py>,
        pose: Argument<'py>,
        index: Argument<'py>,
        uv: Argument<'py>,
    ) -> PyResult<(PyUpdateReport, Bound<'py, PyArray1<i64>>)> {
        let map = KnownMap {
            landmarks: rows::<6>("landmarks", &landmarks)?,
            covariance: square("covariance", &covariance)?,
            drift: matrix::<6, 6>("drift", &drift)?,
        };
        let pose = self::pose("pose", &pose)?;
        let matches = bearings(&index, &uv)?;
        let matches: Vec<_> = matches.iter().map(|b| (b.id as usize, b.uv)).collect();
        let filter = &mut self.0;
        let (report, ids) = py
            .detach(|| filter.relocalise_in(&map, &pose, &matches))
            .map_err(to_python)?;
        Ok((
            PyUpdateReport(report),
            to_ids(py, ids.into_iter().map(Some)),
        ))
    }

    /// The map to start another filter in.
    ///
    /// Returns
    /// -------
    /// dict
    ///     ``ids`` (N,) int64; ``landmarks`` (N, 6) float64, ``x y z theta phi rho`` in W; ``covariance`` (6 N, 6 N), joint;
    ///     ``drift`` (6, 6), covariance of W's drift, (translation m, rotation rad).
    fn known_map<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let (ids, map) = py.detach(|| self.0.known_map());
        let n = ids.len();
        let out = PyDict::new(py);
        out.set_item("ids", to_ids(py, ids.into_iter().map(Some)))?;
        out.set_item("landmarks", vectors(py, map.landmarks.into_iter(), n))?;
        let flat = PyArray1::from_vec(py, map.covariance.data.into());
        out.set_item("covariance", flat.reshape([6 * n, 6 * n])?)?;
        out.set_item("drift", to_matrix(py, &map.drift))?;
        Ok(out)
    }

    /// Starts in a map, not knowing where the camera is; :meth:`relocalise` is to follow.
    ///
    /// Parameters
    /// ----------
    /// landmarks, covariance, drift
    ///     As :meth:`known_map` gives them.
    ///
    /// Returns
    /// -------
    /// (N,) int64
    ///     Feature ids, in the map's order.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, a covariance that is none, or a filter that has started; it stays as it was.
    fn start_from_map<'py>(
        &mut self,
        py: Python<'py>,
        landmarks: Argument<'py>,
        covariance: Argument<'py>,
        drift: Argument<'py>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let map = KnownMap {
            landmarks: rows::<6>("landmarks", &landmarks)?,
            covariance: square("covariance", &covariance)?,
            drift: matrix::<6, 6>("drift", &drift)?,
        };
        let filter = &mut self.0;
        let ids = py
            .detach(|| filter.start_from_map(&map))
            .map_err(to_python)?;
        Ok(to_ids(py, ids.into_iter().map(Some)))
    }

    /// Starts candidates for delayed births at pixels of the present view; returns their ids, (N,) int64.
    fn add_candidates<'py>(
        &mut self,
        py: Python<'py>,
        uv: Argument<'py>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let uv = pixels("uv", &uv)?;
        let filter = &mut self.0;
        let ids = py
            .detach(|| filter.add_candidates(&uv))
            .map_err(to_python)?;
        Ok(to_ids(py, ids.into_iter().map(Some)))
    }

    /// Observes candidates (METHOD 5, delayed).
    ///
    /// Returns
    /// -------
    /// outcome : list of str
    ///     ``born``, ``waiting`` or ``dropped`` for each.
    /// ids : (N,) int64
    ///     Feature id where born, -1 elsewhere.
    fn observe_candidates<'py>(
        &mut self,
        py: Python<'py>,
        ids: Argument<'py>,
        uv: Argument<'py>,
    ) -> PyResult<(Vec<&'static str>, Bound<'py, PyArray1<i64>>)> {
        let uv = pixels("uv", &uv)?;
        let ids = self::ids("ids", &ids)?;
        same_length("uv", ids.len(), uv.len())?;
        let seen: Vec<_> = ids.into_iter().zip(uv).collect();
        let filter = &mut self.0;
        let outcomes = py
            .detach(|| filter.observe_candidates(&seen))
            .map_err(to_python)?;
        let names = outcomes.iter().map(|o| match o {
            CandidateOutcome::Born(_) => "born",
            CandidateOutcome::Waiting => "waiting",
            CandidateOutcome::Dropped => "dropped",
        });
        let born = outcomes.iter().map(|o| match o {
            CandidateOutcome::Born(id) => Some(*id),
            _ => None,
        });
        Ok((names.collect(), to_ids(py, born)))
    }

    /// Candidates that shall wait for parallax no longer are born with a vague depth, as features of their first view;
    /// ids (N,) int64, -1 where that gives no feature.
    fn promote_candidates<'py>(
        &mut self,
        py: Python<'py>,
        ids: Argument<'py>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let ids = self::ids("ids", &ids)?;
        let filter = &mut self.0;
        let born = py.detach(|| filter.promote_candidates(&ids));
        Ok(to_ids(py, born.map_err(to_python)?.into_iter()))
    }

    /// Forgets candidates that were lost.
    fn drop_candidates(&mut self, ids: Argument<'_>) -> PyResult<()> {
        self.0.drop_candidates(&self::ids("ids", &ids)?);
        Ok(())
    }

    /// Ids of the candidates that are alive, (N,) int64.
    #[getter]
    fn candidates<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        to_ids(py, self.0.candidate_ids().map(Some))
    }

    /// Starts features with a vague depth at pixels of the present view; ids (N,) int64, -1 where the pixel has no
    /// ray. Before the start this is the scale-free start.
    fn add_undelayed<'py>(
        &mut self,
        py: Python<'py>,
        uv: Argument<'py>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let uv = pixels("uv", &uv)?;
        let filter = &mut self.0;
        let ids = py.detach(|| filter.add_undelayed(&uv)).map_err(to_python)?;
        Ok(to_ids(py, ids.into_iter()))
    }

    /// Starts from points of known position in C (METHOD 10).
    ///
    /// Parameters
    /// ----------
    /// points : (N, 3) float64
    ///     Metres in C.
    /// noise : (N, 3, 3) float64
    ///     Covariance of each point by itself.
    /// shared : (N, 3, 6) float64
    ///     Derivative of each point by the 6-number error of the target's pose.
    /// covariance : (6, 6) float64
    ///     Covariance of that error.
    ///
    /// Returns
    /// -------
    /// (N,) int64
    ///     Feature ids.
    fn start_from_points<'py>(
        &mut self,
        py: Python<'py>,
        points: Argument<'py>,
        noise: Argument<'py>,
        shared: Argument<'py>,
        covariance: Argument<'py>,
    ) -> PyResult<Bound<'py, PyArray1<i64>>> {
        let points = rows::<3>("points", &points)?;
        let noise = stack::<3, 3>("noise", &noise)?;
        let shared = stack::<3, 6>("shared", &shared)?;
        let covariance = covariance6("covariance", &covariance)?;
        let filter = &mut self.0;
        let ids = py.detach(|| filter.start_from_points(&points, &noise, &shared, &covariance));
        Ok(to_ids(py, ids.map_err(to_python)?.into_iter().map(Some)))
    }

    /// Deletes failing features, candidates that are too old, and clones nobody needs; returns the deleted
    /// features' ids, (N,) int64.
    fn manage_map<'py>(&mut self, py: Python<'py>) -> Bound<'py, PyArray1<i64>> {
        let filter = &mut self.0;
        let gone = py.detach(|| filter.manage_map());
        to_ids(py, gone.into_iter().map(Some))
    }

    /// Removes features.
    fn remove_features(&mut self, py: Python<'_>, ids: Argument<'_>) -> PyResult<()> {
        let ids = self::ids("ids", &ids)?;
        let filter = &mut self.0;
        py.detach(|| filter.remove_features(&ids))
            .map_err(to_python)
    }

    /// The map: ``ids`` (N,) int64, ``points`` (N, 3) metres in W, ``covariance`` (N, 3, 3) m^2,
    /// ``rho_ratio`` (N,) sd(rho)/rho.
    fn landmarks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let landmarks = py.detach(|| self.0.landmarks());
        let n = landmarks.len();
        let out = PyDict::new(py);
        out.set_item("ids", to_ids(py, landmarks.iter().map(|l| Some(l.id))))?;
        out.set_item("points", vectors(py, landmarks.iter().map(|l| l.point), n))?;
        out.set_item(
            "covariance",
            stacked(py, landmarks.iter().map(|l| l.covariance), n),
        )?;
        out.set_item(
            "rho_ratio",
            PyArray1::from_iter(py, landmarks.iter().map(|l| l.rho_ratio)),
        )?;
        Ok(out)
    }

    /// Raises InputError if a view of Cf with this pose cannot be measured; ``bias`` is the part of the covariance
    /// that lasts from frame to frame.
    #[pyo3(signature = (t_cf, covariance, bias = None))]
    fn check_worn(
        &self,
        py: Python<'_>,
        t_cf: Argument<'_>,
        covariance: Argument<'_>,
        bias: Option<Argument<'_>>,
    ) -> PyResult<()> {
        let t_cf = pose("t_cf", &t_cf)?;
        let covariance = covariance6("covariance of T_CF", &covariance)?;
        let bias = bias.map(|b| covariance6("bias of T_CF", &b)).transpose()?;
        py.detach(|| self.0.check_worn(&t_cf, &covariance, bias.as_ref()))
            .map_err(to_python)
    }

    /// Predicts whether Cs and Cf overlap (METHOD 9).
    ///
    /// Returns
    /// -------
    /// dict or None
    ///     ``roi_s``, ``roi_f`` (u0, v0, u1, v1) px, ``d_max`` and ``baseline`` metres.
    fn predict_overlap<'py>(
        &self,
        py: Python<'py>,
        t_cf: Argument<'py>,
        covariance: Argument<'py>,
    ) -> PyResult<Option<Bound<'py, PyDict>>> {
        let t_cf = pose("t_cf", &t_cf)?;
        let covariance = covariance6("covariance", &covariance)?;
        let overlap = py.detach(|| self.0.overlap(&t_cf, &covariance));
        let Some(overlap) = overlap.map_err(to_python)? else {
            return Ok(None);
        };
        let out = PyDict::new(py);
        out.set_item("roi_s", overlap.roi_s)?;
        out.set_item("roi_f", overlap.roi_f)?;
        out.set_item("d_max", overlap.d_max)?;
        out.set_item("baseline", overlap.baseline)?;
        Ok(Some(out))
    }
}

fn bearings(ids: &Argument<'_>, uv: &Argument<'_>) -> PyResult<Vec<Bearing>> {
    let uv = pixels("uv", uv)?;
    let ids = self::ids("ids", ids)?;
    same_length("uv", ids.len(), uv.len())?;
    Ok(ids
        .into_iter()
        .zip(uv)
        .map(|(id, uv)| Bearing { id, uv })
        .collect())
}

fn worn_observation(
    (t_cf, covariance, ids, uv, uv_f): &WornArgument<'_>,
    bias: Option<&Argument<'_>>,
) -> PyResult<WornObservation> {
    let ids = optional_ids("worn ids", ids)?;
    let uv = pixels("worn uv", uv)?;
    let uv_f = pixels("worn uv_f", uv_f)?;
    same_length("worn uv", ids.len(), uv.len())?;
    same_length("worn uv_f", ids.len(), uv_f.len())?;
    let pairs = ids.into_iter().zip(uv).zip(uv_f);
    Ok(WornObservation {
        bias: bias.map(|b| covariance6("bias of T_CF", b)).transpose()?,
        t_cf: pose("t_cf", t_cf)?,
        covariance: covariance6("covariance", covariance)?,
        pairs: pairs
            .map(|((id, uv), uv_f)| WornPair { id, uv, uv_f })
            .collect(),
    })
}

fn depth_observations(
    (ids, uv, depth, sigma): &DepthArgument<'_>,
) -> PyResult<Vec<DepthObservation>> {
    let ids = optional_ids("depth ids", ids)?;
    let uv = pixels("depth uv", uv)?;
    let (depth, sigma) = (numbers("depth", depth)?, numbers("sigma", sigma)?);
    same_length("depth uv", ids.len(), uv.len())?;
    same_length("depth", ids.len(), depth.len())?;
    same_length("sigma", ids.len(), sigma.len())?;
    Ok((0..ids.len())
        .map(|i| DepthObservation {
            id: ids[i],
            uv: uv[i],
            depth: depth[i],
            sigma: sigma[i],
        })
        .collect())
}
