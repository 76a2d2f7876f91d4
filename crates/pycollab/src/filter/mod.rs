//! The filter: its state, and the lock that keeps two threads apart. What it does is in the files beside this one.

mod births;
mod imu;
mod late_views;
mod map;
pub(crate) mod measurements;
mod odometry;
mod prediction;
mod report;
mod update;
mod view_planning;

pub(crate) use births::CandidateReport;
pub(crate) use map::{PyKnownMap, PyLandmarks};
pub(crate) use prediction::{PyConditionalPrediction, PyOverlap, PyPrediction};
pub(crate) use report::{PyMapRelocalisation, PyMeasurementOutcomes, PyUpdateReport};
pub(crate) use view_planning::CandidateViews;

use crate::arrays_out::{Column, Table, column, symmetric, to_ids, to_matrix, to_pose};
use crate::camera::PyCamera;
use crate::errors::{invalid, named};
use crate::gate;
use crate::settings::PyFilterSettings;
use ekf_core::math::pose::Pose;
use ekf_core::settings::Settings;
use ekf_core::{EkfError, Filter};
use pyo3::prelude::*;
use pyo3::types::PyBytes;
use std::sync::{RwLock, TryLockError};

/// The Extended Kalman Filter without images: predict, look up what should be seen, update.
///
/// One filter serves one thread at a time; two threads may run two filters.
///
/// Parameters
/// ----------
/// camera : Camera
///     Cs.
/// worn_cameras : Camera or sequence of Camera, optional
///     Cf, one of each person's, numbered from 0; needed to take their pixels.
/// settings : FilterSettings, optional
///     The defaults if left out.
///
/// Raises
/// ------
/// BusyError
///     From every method and attribute, while another thread changes the filter; it stays as it was.
#[pyclass(name = "Filter", module = "collabslam._core", frozen)]
pub(crate) struct PyFilter(RwLock<Filter>);

/// One worn camera, or several.
///
/// Python: Camera | Sequence[Camera]
#[derive(FromPyObject)]
enum WornCameras<'py> {
    One(PyRef<'py, PyCamera>),
    Several(Vec<PyRef<'py, PyCamera>>),
}

/// One block of the state after the camera's.
///
/// Attributes
/// ----------
/// id : int
///     Feature id.
/// kind : str
///     ``Feature``, ``Point`` and the like.
/// offset, size : int
///     Its first row in the mean and in P, and its number of rows.
#[pyclass(module = "collabslam._core", frozen, get_all, eq)]
#[derive(PartialEq)]
pub(crate) struct Block {
    id: u64,
    kind: &'static str,
    offset: usize,
    size: usize,
}

fn unavailable<T>(error: TryLockError<T>) -> PyErr {
    match error {
        TryLockError::WouldBlock => named(
            "BusyError",
            "the filter is at work in another thread; give each thread its own, or let them take turns \
             (threading.Lock)"
                .into(),
        ),
        TryLockError::Poisoned(_) => named(
            "FilterError",
            "an internal fault left the filter half changed; go on from a snapshot, and please report it"
                .into(),
        ),
    }
}

impl PyFilter {
    /// Asks the filter something.
    fn read<T: Send>(
        &self,
        py: Python<'_>,
        ask: impl FnOnce(&Filter) -> Result<T, EkfError> + Send,
    ) -> PyResult<T> {
        let filter = self.0.try_read().map_err(unavailable)?;
        let filter = &*filter;
        gate::enter(py, || ask(filter))
    }

    /// Changes the filter.
    fn write<T: Send>(
        &self,
        py: Python<'_>,
        change: impl FnOnce(&mut Filter) -> Result<T, EkfError> + Send,
    ) -> PyResult<T> {
        let mut filter = self.0.try_write().map_err(unavailable)?;
        let filter = &mut *filter;
        gate::enter(py, || change(filter))
    }

    fn none_of_it<T>() -> PyResult<T> {
        Err(invalid(
            "Filter",
            "it cannot be copied or pickled; use Filter.restore(filter.snapshot())",
        ))
    }
}

#[pymethods]
impl PyFilter {
    #[new]
    #[pyo3(signature = (camera, worn_cameras = None, *, settings = None))]
    fn new(
        camera: &PyCamera,
        worn_cameras: Option<WornCameras<'_>>,
        settings: Option<&PyFilterSettings>,
    ) -> Self {
        let settings = settings.map_or_else(Settings::default, |given| given.0.clone());
        let worn = match &worn_cameras {
            Some(WornCameras::One(camera)) => std::slice::from_ref(camera),
            Some(WornCameras::Several(cameras)) => cameras,
            None => &[],
        };
        let worn = worn.iter().map(|camera| camera.0.clone());
        let filter = Filter::new(settings, camera.0.clone(), worn);
        Self(RwLock::new(filter))
    }

    /// Whether the filter has a map to localise in.
    #[getter]
    fn started(&self, py: Python<'_>) -> PyResult<bool> {
        self.read(py, |f| Ok(f.started()))
    }

    /// Time of the last prediction, seconds, or None.
    #[getter]
    fn time(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        self.read(py, |f| Ok(f.time()))
    }

    /// Number of features in the map.
    #[getter]
    fn map_size(&self, py: Python<'_>) -> PyResult<usize> {
        self.read(py, |f| Ok(f.map_size()))
    }

    /// Ids of the features, (N,) int64, in order.
    #[getter]
    fn features(&self, py: Python<'_>) -> PyResult<Column<i64>> {
        let ids: Vec<u64> = self.read(py, |f| Ok(f.feature_ids().collect()))?;
        Ok(to_ids(py, ids.into_iter().map(Some)))
    }

    /// Number of candidates that wait for parallax.
    #[getter]
    fn candidate_count(&self, py: Python<'_>) -> PyResult<usize> {
        self.read(py, |f| Ok(f.candidate_count()))
    }

    /// Ids of the candidates that are alive, (N,) int64.
    #[getter]
    fn candidates(&self, py: Python<'_>) -> PyResult<Column<i64>> {
        let ids: Vec<u64> = self.read(py, |f| Ok(f.candidate_ids().collect()))?;
        Ok(to_ids(py, ids.into_iter().map(Some)))
    }

    /// T_WC, (4, 4) float64, metres: maps points of Cs into W.
    #[getter]
    fn pose(&self, py: Python<'_>) -> PyResult<Table> {
        let (rotation, translation) = self.read(py, |f| Ok(f.pose()))?;
        let pose = Pose {
            rotation,
            translation,
        };
        Ok(to_pose(py, &pose))
    }

    /// (6, 6) float64, covariance of the pose over (translation m, rotation rad), right tangent of T_WC
    /// (METHOD 1).
    #[getter]
    fn pose_covariance(&self, py: Python<'_>) -> PyResult<Table> {
        let covariance = self.read(py, |f| Ok(f.pose_covariance()))?;
        Ok(to_matrix(py, &covariance))
    }

    /// Relative standard deviation of the scale, or None without a map: by how much all distances from the
    /// camera to the features may be too long or too short together. It is P's word; where the unit is
    /// arbitrary it says how far that has drifted since the start.
    #[getter]
    fn scale_sd(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        self.read(py, |f| Ok(f.scale_sd()))
    }

    /// Time from the first row of an image of Cs to the last one, as far as the filter knows, and the
    /// standard deviation of that, seconds; None for a shutter that is known not to roll (METHOD 4).
    #[getter]
    fn readout(&self, py: Python<'_>) -> PyResult<Option<(f64, f64)>> {
        self.read(py, |f| Ok(f.readout()))
    }

    /// Velocity in W, (3,) float64, m/s.
    #[getter]
    fn velocity(&self, py: Python<'_>) -> PyResult<Column<f64>> {
        let v = self.read(py, |f| Ok(f.velocity()))?;
        Ok(column(py, v.iter().copied()))
    }

    /// Angular velocity in C, (3,) float64, rad/s.
    #[getter]
    fn angular_velocity(&self, py: Python<'_>) -> PyResult<Column<f64>> {
        let w = self.read(py, |f| Ok(f.angular_velocity()))?;
        Ok(column(py, w.iter().copied()))
    }

    /// Velocity of Cs and angular velocity, both along its own axes, (6,) float64, m/s and rad/s.
    #[getter]
    fn twist(&self, py: Python<'_>) -> PyResult<Column<f64>> {
        let twist = self.read(py, |f| Ok(f.twist()))?;
        Ok(column(py, twist.iter().copied()))
    }

    /// (12, 12) float64, covariance of the pose, as in :attr:`pose_covariance`, and of :attr:`twist`.
    #[getter]
    fn pose_and_twist_covariance(&self, py: Python<'_>) -> PyResult<Table> {
        let covariance = self.read(py, |f| Ok(f.pose_and_twist_covariance()))?;
        Ok(to_matrix(py, &covariance))
    }

    /// The whole state vector, (n,) float64: camera (13), then the blocks of :attr:`blocks`.
    #[getter]
    fn mean(&self, py: Python<'_>) -> PyResult<Column<f64>> {
        let mean = self.read(py, |f| Ok(f.state().mean().to_vec()))?;
        Ok(column(py, mean))
    }

    /// The covariance that is told, (n, n) float64, what lasts of errors included (METHOD 20).
    #[getter]
    fn covariance(&self, py: Python<'_>) -> PyResult<Table> {
        let p = self.read(py, |f| Ok(f.state().covariance().to_dense()))?;
        let n = p.nrows();
        Ok(symmetric(py, p.data.into(), n))
    }

    /// Layout of the state after the camera: a list of `Block`, in the state's order.
    #[getter]
    fn blocks(&self, py: Python<'_>) -> PyResult<Vec<Block>> {
        self.read(py, |f| {
            let blocks = f.state().layout().blocks().iter();
            let blocks = blocks.map(|b| Block {
                id: b.id,
                kind: b.kind.name(),
                offset: b.offset,
                size: b.kind.dim(),
            });
            Ok(blocks.collect())
        })
    }

    /// Least eigenvalue of the diagonal-scaled P: P is sound above -1e-10 (METHOD 3). O(n^3).
    fn soundness(&self, py: Python<'_>) -> PyResult<f64> {
        self.read(py, |f| Ok(f.state().covariance().least_scaled_eigenvalue()))
    }

    /// Checks that the filter is sound (METHOD 3): mean and P finite, variances positive, quaternions of
    /// unit length, and `soundness` above -1e-10. O(n^3).
    ///
    /// Raises
    /// ------
    /// FilterError
    ///     Saying what is wrong.
    fn check(&self, py: Python<'_>) -> PyResult<()> {
        self.read(py, Filter::check)
    }

    /// The filter as bytes, for :meth:`restore`: cameras, settings, mean, P, candidates and counters, with
    /// version and checksum. The filter restored goes on bit for bit as this one does.
    fn snapshot<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyBytes>> {
        let bytes = self.read(py, |f| Ok(f.snapshot()))?;
        Ok(PyBytes::new(py, &bytes))
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
        let filter = gate::enter(py, || Filter::restore(data))?;
        Ok(Self(RwLock::new(filter)))
    }

    /// Remembers the filter as it is, for :meth:`rollback`, in memory of its own; an earlier checkpoint is
    /// forgotten. A copy of P's stored triangle, about a hundredth of a frame.
    fn checkpoint(&self, py: Python<'_>) -> PyResult<()> {
        self.write(py, |f| {
            f.checkpoint();
            Ok(())
        })
    }

    /// Makes the filter what it was at the last :meth:`checkpoint`, bit for bit; this may be repeated.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If there has been no checkpoint.
    fn rollback(&self, py: Python<'_>) -> PyResult<()> {
        self.write(py, Filter::rollback)
    }

    fn __copy__(&self) -> PyResult<Self> {
        Self::none_of_it()
    }

    fn __deepcopy__(&self, _memo: &Bound<'_, PyAny>) -> PyResult<Self> {
        Self::none_of_it()
    }

    fn __reduce__(&self) -> PyResult<String> {
        Self::none_of_it()
    }
}
