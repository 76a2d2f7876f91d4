//! What an update reports.

use crate::arrays_out::{Column, Table, column, to_ids, to_matrix, to_pose};
use ekf_core::{MeasurementOutcome, UpdateReport, WornPose};
use pyo3::prelude::*;
use std::collections::BTreeMap;

/// What became of one kind of measurement in a frame.
///
/// ``names`` says it of each: ``pixel`` (accepted as two pixel rows), ``depth`` (as three metric rows),
/// ``rate`` (a worn camera's rate was), ``replaced`` (its feature was measured by a better form of the
/// same match), ``born``, ``too-uncertain`` (a pixel predicted no better than somewhere in the image; a
/// pair not worth more than its bearing), ``not-visible``, ``rejected-gate`` (its own chi-square),
/// ``rejected-batch`` (the batch test), ``rejected-conditional`` (contradicted by the others), ``unused``
/// (in this mode), ``refused`` (with the whole frame).
#[pyclass(name = "MeasurementOutcomes", module = "collabslam._core", frozen)]
pub(crate) struct PyMeasurementOutcomes(Vec<MeasurementOutcome>);

impl PyMeasurementOutcomes {
    fn count(&self, outcome: MeasurementOutcome) -> usize {
        self.0.iter().filter(|&&o| o == outcome).count()
    }
}

#[pymethods]
impl PyMeasurementOutcomes {
    /// (N,) bool: the measurement of a known feature was used, as rows of its own or of a better form of
    /// the same match.
    #[getter]
    fn accepted(&self, py: Python<'_>) -> Column<bool> {
        column(py, self.0.iter().map(MeasurementOutcome::is_accepted))
    }

    /// (N,) int64: id of the feature born from each, -1 for none.
    #[getter]
    fn born(&self, py: Python<'_>) -> Column<i64> {
        let id = |o: &MeasurementOutcome| match o {
            MeasurementOutcome::Born(id) => Some(*id),
            _ => None,
        };
        to_ids(py, self.0.iter().map(id))
    }

    /// (N,) list of str: see the class.
    #[getter]
    fn names(&self) -> Vec<&'static str> {
        self.0.iter().map(name).collect()
    }

    /// How many were accepted as two pixel rows.
    #[getter]
    fn pixel_rows(&self) -> usize {
        self.count(MeasurementOutcome::Pixel)
    }

    /// How many were accepted as three metric rows.
    #[getter]
    fn depth_rows(&self) -> usize {
        self.count(MeasurementOutcome::Depth)
    }

    /// How many were too uncertain to say anything.
    #[getter]
    fn too_uncertain(&self) -> usize {
        self.count(MeasurementOutcome::TooUncertain)
    }

    /// How many failed their own chi-square gate.
    #[getter]
    fn rejected_gate(&self) -> usize {
        self.count(MeasurementOutcome::RejectedGate)
    }

    /// How many the batch test left out.
    #[getter]
    fn rejected_batch(&self) -> usize {
        self.count(MeasurementOutcome::RejectedBatch)
    }

    /// How many contradicted the other accepted ones.
    #[getter]
    fn rejected_conditional(&self) -> usize {
        self.count(MeasurementOutcome::RejectedConditional)
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }
}

fn name(outcome: &MeasurementOutcome) -> &'static str {
    match outcome {
        MeasurementOutcome::Pixel => "pixel",
        MeasurementOutcome::Depth => "depth",
        MeasurementOutcome::Rate => "rate",
        MeasurementOutcome::Replaced => "replaced",
        MeasurementOutcome::TooUncertain => "too-uncertain",
        MeasurementOutcome::NotVisible => "not-visible",
        MeasurementOutcome::RejectedGate => "rejected-gate",
        MeasurementOutcome::RejectedBatch => "rejected-batch",
        MeasurementOutcome::RejectedConditional => "rejected-conditional",
        MeasurementOutcome::Born(_) => "born",
        MeasurementOutcome::Unused => "unused",
        MeasurementOutcome::Refused => "refused",
    }
}

/// T_WF of worn cameras by their numbers, each with its covariance.
///
/// Python: dict[int, tuple[NDArray[np.float64], NDArray[np.float64]]]
type WornPoses = BTreeMap<usize, (Table, Table)>;

/// T_WF of a worn camera and its covariance.
pub(super) fn to_worn_pose(py: Python<'_>, found: &WornPose) -> (Table, Table) {
    (to_pose(py, &found.pose), to_matrix(py, &found.covariance))
}

/// What one update did.
///
/// Attributes
/// ----------
/// bearings, depths : MeasurementOutcomes
///     What became of the pixels in Cs and of the depths, in the order they were given.
/// views : list of MeasurementOutcomes
///     What became of the pairs of each view.
/// rates : MeasurementOutcomes
///     What became of the rate of each view, ``unused`` where none was told.
/// accepted : bool
///     Whether the frame was used: False if fewer bearings than asked for passed the tests.
/// refused : str or None
///     Why the whole frame was refused: its update would have broken the filter, which is as it was
///     before.
/// nis : float
///     Normalised innovation squared of the accepted batch.
/// dof : int
///     Its degrees of freedom.
/// order : int
///     Matches that the batch test left out.
/// exact : bool
///     Whether the batch test finished its exact search.
/// worn_error : (6,) float64
///     Estimated error of T_CF of the first view after the update, (translation m, rotation rad), right
///     tangent.
/// worn_error_covariance : (6, 6) float64
///     What is left of its covariance after the update, in the filter's own model.
/// worn_error_of_map : (6, 6) float64
///     Covariance of what errors of the map that last may have put into it, which that model does not know of
///     (METHOD 20).
/// worn_poses : dict of int to (pose, covariance)
///     Where the worn cameras were whose views were measured, by their numbers: T_WF (4, 4), metres, and
///     its covariance (6, 6) over (translation m, rotation rad), right tangent.
/// too_fast : bool
///     Whether it was not used as the camera would have been faster than it may be.
/// turn_excluded : bool
///     Whether it was not used as the images show another turn.
/// jumped : bool
///     Of a relocalisation: whether prediction excludes where it found the camera, whatever is not known of
///     the map.
#[pyclass(name = "UpdateReport", module = "collabslam._core", frozen, get_all)]
pub(crate) struct PyUpdateReport {
    bearings: Py<PyMeasurementOutcomes>,
    depths: Py<PyMeasurementOutcomes>,
    views: Vec<Py<PyMeasurementOutcomes>>,
    rates: Py<PyMeasurementOutcomes>,
    accepted: bool,
    refused: Option<String>,
    nis: f64,
    dof: usize,
    order: usize,
    exact: bool,
    worn_error: Column<f64>,
    worn_error_covariance: Table,
    worn_error_of_map: Table,
    worn_poses: WornPoses,
    too_fast: bool,
    turn_excluded: bool,
    jumped: bool,
}

impl PyUpdateReport {
    pub(super) fn new(py: Python<'_>, report: UpdateReport) -> PyResult<Self> {
        let views = report.views.into_iter();
        let views = views.map(|outcomes| Py::new(py, PyMeasurementOutcomes(outcomes)));
        let worn_poses = report.worn_poses.iter();
        let worn_poses = worn_poses.map(|found| (found.who, to_worn_pose(py, found)));
        Ok(Self {
            bearings: Py::new(py, PyMeasurementOutcomes(report.bearings))?,
            depths: Py::new(py, PyMeasurementOutcomes(report.depths))?,
            views: views.collect::<PyResult<_>>()?,
            rates: Py::new(py, PyMeasurementOutcomes(report.rates))?,
            accepted: report.accepted,
            too_fast: report.too_fast,
            turn_excluded: report.turn_excluded,
            jumped: report.jumped,
            refused: report.refused.as_ref().map(ToString::to_string),
            nis: report.nis,
            dof: report.dof,
            order: report.order,
            exact: report.exact,
            worn_error: column(py, report.worn_error.iter().copied()),
            worn_error_covariance: to_matrix(py, &report.worn_error_covariance),
            worn_error_of_map: to_matrix(py, &report.worn_error_of_map),
            worn_poses: worn_poses.collect(),
        })
    }
}

/// Whether a camera was put into another map.
///
/// Attributes
/// ----------
/// report : UpdateReport
///     ``accepted`` says whether the pose was taken; otherwise the filter is as it was.
/// ids : (M,) int64
///     The new feature ids of the map's landmarks, in its order; none where the pose was not taken.
#[pyclass(
    name = "MapRelocalisation",
    module = "collabslam._core",
    frozen,
    get_all
)]
pub(crate) struct PyMapRelocalisation {
    report: Py<PyUpdateReport>,
    ids: Column<i64>,
}

impl PyMapRelocalisation {
    pub(super) fn new(py: Python<'_>, report: UpdateReport, ids: Column<i64>) -> PyResult<Self> {
        let report = Py::new(py, PyUpdateReport::new(py, report)?)?;
        Ok(Self { report, ids })
    }
}
