//! Odometry in place of the motion model (METHOD 23).

use super::PyFilter;
use super::measurements::bearings;
use crate::arrays_in::{Argument, covariance6, pose, vector};
use crate::arrays_out::{Column, Table, column, to_matrix};
use crate::gate;
use ekf_core::Filter;
use pyo3::prelude::*;

#[pymethods]
impl PyFilter {
    /// Says where Cs sits in the odometry's frame, before there is any; the identity unless told.
    ///
    /// Parameters
    /// ----------
    /// t_bc : (4, 4) float64
    ///     Maps points of C into the odometry's frame B, metres.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For an impossible pose, or once there was odometry.
    fn set_odometry_frame(&self, py: Python<'_>, t_bc: Argument<'_>) -> PyResult<()> {
        let t_bc = pose("odometry frame", &t_bc)?;
        self.write(py, |f| f.set_odometry_frame(&t_bc))
    }

    /// Gives the mean twist of the odometry's frame since the sample before, for predictions to follow.
    ///
    /// Parameters
    /// ----------
    /// t : float
    ///     Its end, seconds, later than the last one's.
    /// twist : (6,) float64
    ///     Velocity and angular velocity along the axes of the odometry's frame, m/s and rad/s.
    /// covariance : (6, 6) float64
    ///     Of it, as independent from sample to sample; positive definite.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For NaN, impossible numbers, a time that does not follow, or if too many samples wait for a
    ///     frame; nothing is kept then.
    fn add_odometry(
        &self,
        py: Python<'_>,
        t: f64,
        twist: Argument<'_>,
        covariance: Argument<'_>,
    ) -> PyResult<()> {
        let twist = vector::<6>("odometry", &twist)?;
        let covariance = covariance6("covariance of the odometry", &covariance)?;
        self.write(py, |f| f.add_odometry(t, &twist, &covariance))
    }

    /// Checks that a sample could be given to :meth:`add_odometry`, but for its time.
    ///
    /// Parameters
    /// ----------
    /// twist, covariance
    ///     As there.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     Saying why it could not.
    #[staticmethod]
    fn check_odometry(
        py: Python<'_>,
        twist: Argument<'_>,
        covariance: Argument<'_>,
    ) -> PyResult<()> {
        let twist = vector::<6>("odometry", &twist)?;
        let covariance = covariance6("covariance of the odometry", &covariance)?;
        gate::enter(py, || Filter::check_odometry(&twist, &covariance))
    }

    /// Stamp of the last sample, seconds, or None.
    #[getter]
    fn odometry_time(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        self.read(py, |f| Ok(f.odometry_time()))
    }

    /// Errors of the odometry's scales as they are estimated, of translation and of turns, relative, and
    /// their covariance: (2,) and (2, 2) float64.  None before the first motion that odometry told, and where
    /// the settings take the scales as exact.
    #[getter]
    fn odometry_scale(&self, py: Python<'_>) -> PyResult<Option<(Column<f64>, Table)>> {
        let scale = self.read(py, |f| Ok(f.odometry_scale()))?;
        Ok(scale.map(|(mean, p)| (column(py, mean.iter().copied()), to_matrix(py, &p))))
    }

    /// Whether the last prediction followed odometry, for most of its time; until a frame is measured.
    #[getter]
    fn followed_odometry(&self, py: Python<'_>) -> PyResult<bool> {
        self.read(py, |f| Ok(f.followed_odometry()))
    }

    /// Whether what Cs shows contradicts the odometry that the last prediction followed.
    ///
    /// Parameters
    /// ----------
    /// found, uv : (N,) int64, (N, 2) float64
    ///     Features found in Cs and their pixels.
    /// least : int
    ///     Fewer than these contradict it, too.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, unknown ids, an id given twice.
    fn contradicts_odometry(
        &self,
        py: Python<'_>,
        found: Argument<'_>,
        uv: Argument<'_>,
        least: usize,
    ) -> PyResult<bool> {
        let found = bearings(&found, &uv)?;
        self.write(py, |f| f.contradicts_odometry(&found, least))
    }

    /// Takes the last motion as if the wheels may have slipped: P reaches from what odometry tells to what
    /// the camera's own velocity does, and features are looked for in wider places.
    fn distrust_odometry(&self, py: Python<'_>) -> PyResult<()> {
        self.write(py, |f| {
            f.distrust_odometry();
            Ok(())
        })
    }

    /// Takes `distrust_odometry` back, before anything was measured.
    fn trust_odometry(&self, py: Python<'_>) -> PyResult<()> {
        self.write(py, |f| {
            f.trust_odometry();
            Ok(())
        })
    }
}
