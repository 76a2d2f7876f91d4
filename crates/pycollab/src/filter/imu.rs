//! A gyroscope as motion input (METHOD 28).

use super::PyFilter;
use super::measurements::followed;
use crate::arrays_in::{Argument, matrix, vector};
use crate::arrays_out::{Column, Table, column, to_matrix};
use crate::gate;
use ekf_core::Filter;
use pyo3::prelude::*;

#[pymethods]
impl PyFilter {
    /// Says that there is a gyroscope and how it sits, before the start; the settings say how good it is.
    ///
    /// Parameters
    /// ----------
    /// r_ci : (3, 3) float64
    ///     Maps the axes of the sensor into those of C.
    /// time_offset : float
    ///     To be added to its stamps for those of the frames, seconds.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If that is not a rotation or no offset, once the filter has started, or if there is one already.
    fn set_imu(&self, py: Python<'_>, r_ci: Argument<'_>, time_offset: f64) -> PyResult<()> {
        let r_ci = matrix::<3, 3>("r_ci of the IMU", &r_ci)?;
        self.write(py, |f| f.set_imu(&r_ci, time_offset))
    }

    /// Gives a rate of the gyroscope, for predictions to follow.
    ///
    /// Parameters
    /// ----------
    /// t : float
    ///     Seconds by its own clock, later than the last one's.
    /// rate : (3,) float64
    ///     Along its axes, rad/s.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For NaN, an impossible rate, a time that does not follow, if too many samples wait for a frame, or
    ///     without :meth:`set_imu`; nothing is kept then.
    fn add_gyro(&self, py: Python<'_>, t: f64, rate: Argument<'_>) -> PyResult<()> {
        let rate = vector::<3>("gyroscope", &rate)?;
        self.write(py, |f| f.add_gyro(t, &rate))
    }

    /// Checks that a rate could be given to :meth:`add_gyro`, but for its time.
    ///
    /// Parameters
    /// ----------
    /// rate : (3,) float64
    ///     As there.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     Saying why it could not.
    #[staticmethod]
    fn check_gyro(py: Python<'_>, rate: Argument<'_>) -> PyResult<()> {
        let rate = vector::<3>("gyroscope", &rate)?;
        gate::enter(py, || Filter::check_gyro(&rate))
    }

    /// Stamp of the last rate by the gyroscope's clock, seconds, or None.
    #[getter]
    fn gyro_time(&self, py: Python<'_>) -> PyResult<Option<f64>> {
        self.read(py, |f| Ok(f.gyro_time()))
    }

    /// The gyroscope's bias as it is estimated, along its axes, rad/s, and its covariance: (3,) and (3, 3)
    /// float64.  None without a gyroscope.
    #[getter]
    fn gyro_bias(&self, py: Python<'_>) -> PyResult<Option<(Column<f64>, Table)>> {
        let bias = self.read(py, |f| Ok(f.gyro_bias()))?;
        Ok(bias.map(|(mean, p)| (column(py, mean.iter().copied()), to_matrix(py, &p))))
    }

    /// What is to be added to the gyroscope's stamps for those of the frames, as it is estimated, and the
    /// standard deviation of that, seconds.  None without a gyroscope.
    #[getter]
    fn gyro_clock(&self, py: Python<'_>) -> PyResult<Option<(f64, f64)>> {
        self.read(py, |f| Ok(f.gyro_clock()))
    }

    /// Whether the gyroscope told how the camera turned in the last prediction, for most of its time;
    /// until a frame is measured.
    #[getter]
    fn followed_gyro(&self, py: Python<'_>) -> PyResult<bool> {
        self.read(py, |f| Ok(f.followed_gyro()))
    }

    /// Says how the camera usually goes.  What is known less well than that is measured, to be known as
    /// well, where the map in view does not tell it (METHOD 28).
    ///
    /// Parameters
    /// ----------
    /// velocity, sd : (3,) array
    ///     Along its own axes, m/s, and the standard deviation of each.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     Before the start, and for numbers that are no velocity.
    fn expect_velocity(
        &self,
        py: Python<'_>,
        velocity: Argument<'_>,
        sd: Argument<'_>,
    ) -> PyResult<()> {
        let velocity = vector::<3>("velocity", &velocity)?;
        let sd = vector::<3>("sd", &sd)?;
        self.write(py, |f| f.expect_velocity(&velocity, &sd))
    }

    /// Whether the gyroscope is followed where it says something; False once it was dropped.  None without
    /// one.
    #[getter]
    fn follows_gyro(&self, py: Python<'_>) -> PyResult<Option<bool>> {
        self.read(py, |f| Ok(f.follows_gyro()))
    }

    /// Stops following the gyroscope, for good: its rates are not the camera's.
    fn drop_gyro(&self, py: Python<'_>) -> PyResult<()> {
        self.write(py, |f| {
            f.drop_gyro();
            Ok(())
        })
    }

    /// Whether the turn that the last two images show is what the gyroscope told of it; None if they show
    /// none, or no gyroscope told one.
    ///
    /// To be asked before the frame is measured.
    ///
    /// Parameters
    /// ----------
    /// since : float
    ///     Time of the first of the images, seconds: the frame of the last checkpoint.
    /// before, now : (N, 2) float64
    ///     Where points were in it and are now, pixels of Cs.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes or NaN.
    fn gyro_agrees(
        &self,
        py: Python<'_>,
        since: f64,
        before: Argument<'_>,
        now: Argument<'_>,
    ) -> PyResult<Option<bool>> {
        let followed = followed(since, &before, &now)?;
        self.read(py, |f| f.gyro_agrees(&followed))
    }
}
