//! Poses that are kept, and views of Cf of another time than the frame's (METHOD 21).

use super::PyFilter;
use crate::arrays_in::{Argument, covariance6, pose, vector};
use crate::arrays_out::{Column, Table, column, symmetric, to_pose};
use ekf_core::{Capture, ViewTiming};
use pyo3::prelude::*;

#[pymethods]
impl PyFilter {
    /// Keeps the camera's pose for views of Cf that come up to ``lateness`` seconds late, at most
    /// ``worn.late``; True if it did.
    ///
    /// To be called at the end of a frame. It does nothing before the start, and so soon after the last pose
    /// that there is none to gain.
    fn keep_pose(&self, py: Python<'_>, lateness: f64) -> PyResult<bool> {
        self.write(py, |f| Ok(f.keep_pose(lateness)))
    }

    /// Times of the frames whose poses are kept, (K,) float64, seconds, increasing.
    #[getter]
    fn kept_times(&self, py: Python<'_>) -> PyResult<Column<f64>> {
        let times: Vec<f64> = self.read(py, |f| Ok(f.kept_times().collect()))?;
        Ok(column(py, times))
    }

    /// T_WC of a frame whose pose is kept, or of the present one, as it is known now, (4, 4) float64.
    ///
    /// Parameters
    /// ----------
    /// t : float
    ///     The frame's time, seconds.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If no pose of that time is kept.
    fn kept_pose(&self, py: Python<'_>, t: f64) -> PyResult<Table> {
        let pose = self.read(py, |f| f.kept_pose(t))?;
        Ok(to_pose(py, &pose))
    }

    /// What can be done with a view of Cf that was taken at ``t`` (seconds), now that the filter is at its
    /// frame's time.
    ///
    /// Parameters
    /// ----------
    /// t : float
    /// who : int
    ///     The worn camera's number.
    ///
    /// Returns
    /// -------
    /// str
    ///     ``present`` (of the frame's instant, within ``worn.tolerance``), ``late`` (between poses that are
    ///     kept), ``reordered`` (late, and older than one that was measured); or why it is refused:
    ///     ``repeated`` (measured before), ``stale`` (older than what is kept), ``future`` (after the frame).
    #[pyo3(signature = (t, *, who = 0))]
    fn view_timing(&self, py: Python<'_>, t: f64, who: usize) -> PyResult<&'static str> {
        let timing = self.read(py, |f| Ok(f.view_timing(t, who)))?;
        Ok(match timing {
            ViewTiming::Present => "present",
            ViewTiming::Late => "late",
            ViewTiming::Reordered => "reordered",
            ViewTiming::Repeated => "repeated",
            ViewTiming::Stale => "stale",
            ViewTiming::Future => "future",
        })
    }

    /// T_CF of a view carried to a frame of another time: what matching the two images starts from.
    ///
    /// Parameters
    /// ----------
    /// t_cf : (4, 4) float64
    ///     Measured pose of Cf relative to Cs when the view was taken: maps points of F into C, metres.
    /// covariance : (6, 6) float64
    ///     Of it over (translation m, rotation rad), tangent on the right.
    /// t, frame : float
    ///     When the view was taken; the frame's time, which is the present one or one of `kept_times`.
    ///     Seconds.
    /// who : int
    ///     The worn camera's number.
    ///
    /// Returns
    /// -------
    /// t_cf : (4, 4) float64
    ///     Maps points of F, when the view was taken, into C at the frame's time.
    /// covariance : (6, 6) float64
    ///     Of it, that of the motion of Cs between included.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For a view that `view_timing` refuses, a frame whose pose is not kept, or an impossible pose.
    #[pyo3(signature = (t_cf, covariance, t, frame, *, who = 0))]
    fn carry_worn(
        &self,
        py: Python<'_>,
        t_cf: Argument<'_>,
        covariance: Argument<'_>,
        t: f64,
        frame: f64,
        who: usize,
    ) -> PyResult<(Table, Table)> {
        let t_cf = pose("t_cf", &t_cf)?;
        let covariance = covariance6("covariance of T_CF", &covariance)?;
        let capture = Capture { t, frame };
        let carried = self.read(py, |f| f.carry_worn(&t_cf, &covariance, capture, who))?;
        let entries = carried.1.as_slice().to_vec();
        Ok((to_pose(py, &carried.0), symmetric(py, entries, 6)))
    }

    /// How late the images of a worn camera were taken, as far as the filter knows (METHOD 26).
    ///
    /// Parameters
    /// ----------
    /// who : int
    ///     The worn camera's number.
    ///
    /// Returns
    /// -------
    /// tuple of (float, float) or None
    ///     Seconds after their stamps by the clock of Cs, and the standard deviation of that; None where
    ///     the clock is exact (``worn.clock_sd`` is 0), or there is no such camera.
    #[pyo3(signature = (*, who = 0))]
    fn worn_clock(&self, py: Python<'_>, who: usize) -> PyResult<Option<(f64, f64)>> {
        self.read(py, |f| Ok(f.worn_clock(who)))
    }

    /// Forgets the time before the start, which nothing depends on: a filter may start from an old frame.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If the filter has started.
    fn forget_time(&self, py: Python<'_>) -> PyResult<()> {
        self.write(py, ekf_core::Filter::forget_time)
    }

    /// Lets a camera that is lost go on at a velocity, without turning; what it was taken to do before may
    /// be right, too, so the square of what lies between them joins the covariance (METHOD 3).
    ///
    /// Parameters
    /// ----------
    /// velocity : (3,) array
    ///     In W, m/s.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For numbers that are not finite, and before the start.
    fn go_on_at(&self, py: Python<'_>, velocity: Argument<'_>) -> PyResult<()> {
        let velocity = vector::<3>("velocity", &velocity)?;
        self.write(py, |f| f.go_on_at(&velocity))
    }
}
