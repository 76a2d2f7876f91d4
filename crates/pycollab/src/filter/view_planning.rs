//! Where the worn camera should look (METHOD 24).

use super::PyFilter;
use crate::arrays_in::{Argument, covariance6, pose};
use crate::arrays_out::{Column, Stack, Table, column, homogeneous, stacked, to_matrix};
use ekf_core::view_planning::{CandidateView, ViewPlan};
use pyo3::prelude::*;

/// Views that Cf could offer.
///
/// Attributes
/// ----------
/// t_cf : (N, 4, 4) float64
///     Pose of Cf relative to Cs: maps points of F into C, metres.
/// matches : (N,) float64
///     Matches to be expected.
/// gain : (N,) float64
///     Expected decrease of half the logarithm of the determinant of the covariance of the pose and the
///     scale's logarithm, nats.
/// best : int or None
///     The view of the largest gain; None where nothing is gained.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct CandidateViews {
    t_cf: Stack<f64>,
    matches: Column<f64>,
    gain: Column<f64>,
    best: Option<usize>,
}

impl CandidateViews {
    fn new(py: Python<'_>, views: &[CandidateView]) -> Self {
        Self {
            t_cf: stacked(py, views.iter().map(|view| homogeneous(&view.t_cf))),
            matches: column(py, views.iter().map(|view| view.matches)),
            gain: column(py, views.iter().map(|view| view.gain)),
            best: ViewPlan::best(views),
        }
    }
}

#[pymethods]
impl PyFilter {
    /// (7, 7) float64, covariance of the pose over (translation m, rotation rad), right tangent of T_WC,
    /// and of the scale's logarithm, as `scale_sd` has it; None without a map.
    #[getter]
    fn pose_and_scale_covariance(&self, py: Python<'_>) -> PyResult<Option<Table>> {
        let covariance = self.read(py, |f| Ok(f.pose_and_scale_covariance()))?;
        Ok(covariance.map(|covariance| to_matrix(py, &covariance)))
    }

    /// Views of Cf that a person could offer next, and how much each would tell (METHOD 24).
    ///
    /// Parameters
    /// ----------
    /// t_cf : (4, 4) float64
    ///     Where the person is and looks: maps points of F into C, metres.
    /// covariance : (6, 6) float64
    ///     Of the next measured T_CF over (translation m, rotation rad), tangent on the right; along the axes
    ///     of Cs it is taken to be the same whichever way Cf looks.
    /// bias : (6, 6) float64, optional
    ///     The part of it that lasts from frame to frame; ``worn.bias_share`` of it if left out.
    /// least : int
    ///     Fewest matches with which a view is used.
    /// who : int
    ///     The worn camera's number.
    ///
    /// Returns
    /// -------
    /// here : CandidateViews
    ///     From where Cf is, by direction, those with the most matches first.
    /// elsewhere : CandidateViews
    ///     From places around, each looking at the middle of what Cs sees. None of both before the start, and
    ///     where Cs sees nothing of known depth.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     As `check_worn`.
    #[pyo3(signature = (t_cf, covariance, bias = None, *, least = 0, who = 0))]
    fn next_best_view(
        &self,
        py: Python<'_>,
        t_cf: Argument<'_>,
        covariance: Argument<'_>,
        bias: Option<Argument<'_>>,
        least: usize,
        who: usize,
    ) -> PyResult<(CandidateViews, CandidateViews)> {
        let t_cf = pose("t_cf", &t_cf)?;
        let covariance = covariance6("covariance of T_CF", &covariance)?;
        let bias = bias.map(|b| covariance6("bias of T_CF", &b)).transpose()?;
        let plan = self.read(py, |f| {
            f.next_best_view(&t_cf, &covariance, bias.as_ref(), least, who)
        })?;
        Ok((
            CandidateViews::new(py, &plan.here),
            CandidateViews::new(py, &plan.elsewhere),
        ))
    }
}
