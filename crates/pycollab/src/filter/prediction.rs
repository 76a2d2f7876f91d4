//! Where the filter expects features, and the worn camera's view.

use super::PyFilter;
use super::measurements::{bearings, followed};
use crate::arrays_in::{Argument, RowsArgument, covariance6, ids, numbers, pose, same_length};
use crate::arrays_out::{Column, Stack, Table, chosen, column, stacked, to_ids, vectors};
use crate::gate;
use ekf_core::{ConditionalPrediction, Filter};
use nalgebra::{Matrix2, Vector2};
use pyo3::prelude::*;

/// Features that should be visible in Cs.
///
/// Attributes
/// ----------
/// ids : (N,) int64
/// uv : (N, 2) float64
///     Pixels where they are expected.
/// s : (N, 2, 2) float64
///     Innovation covariance of those, measurement noise included, px^2.
/// points : (N, 3) float64
///     In W, metres.
/// rho, rho_sd : (N,) float64
///     Inverse distance from Cs now and its standard deviation, 1/m.
#[pyclass(name = "Prediction", module = "collabslam._core", frozen, get_all)]
pub(crate) struct PyPrediction {
    ids: Column<i64>,
    uv: Table,
    s: Stack<f64>,
    points: Table,
    rho: Column<f64>,
    rho_sd: Column<f64>,
}

#[pymethods]
impl PyPrediction {
    /// Some of the features.
    ///
    /// Parameters
    /// ----------
    /// which : (N,) bool, (M,) int64 or slice
    ///     A mask, or rows.
    ///
    /// Returns
    /// -------
    /// Prediction
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If it is none of these, or there is no such row.
    fn subset(&self, which: RowsArgument<'_>) -> PyResult<Self> {
        Ok(Self {
            ids: chosen(&self.ids, &which)?,
            uv: chosen(&self.uv, &which)?,
            s: chosen(&self.s, &which)?,
            points: chosen(&self.points, &which)?,
            rho: chosen(&self.rho, &which)?,
            rho_sd: chosen(&self.rho_sd, &which)?,
        })
    }

    fn __len__(&self, py: Python<'_>) -> PyResult<usize> {
        self.ids.bind(py).len()
    }
}

/// Where features are expected once others of the frame have been found.
///
/// Attributes
/// ----------
/// uv : (M, 2) float64
///     Pixels in Cs; NaN where nothing is expected of a feature.
/// s : (M, 2, 2) float64
///     Their covariances, measurement noise included, px^2.
/// agree : (N,) bool
///     Of those found: the feature agrees with the others.
#[pyclass(
    name = "ConditionalPrediction",
    module = "collabslam._core",
    frozen,
    get_all
)]
pub(crate) struct PyConditionalPrediction {
    agree: Column<bool>,
    uv: Table,
    s: Stack<f64>,
}

/// Where the views of Cs and Cf overlap (METHOD 9).
///
/// Attributes
/// ----------
/// roi_s, roi_f : (u0, v0, u1, v1) floats
///     Region of interest in Cs and in Cf, pixels.
/// d_max : float
///     Largest depth at which a match is of use, metres.
/// baseline : float
///     Distance of the cameras, metres.
#[pyclass(
    name = "OverlapPrediction",
    module = "collabslam._core",
    frozen,
    get_all
)]
pub(crate) struct PyOverlap {
    roi_s: (f64, f64, f64, f64),
    roi_f: (f64, f64, f64, f64),
    d_max: f64,
    baseline: f64,
}

#[pymethods]
impl PyFilter {
    /// Predicts to time ``t`` (seconds). Before the start only the time is noted.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     If ``t`` does not follow the last time (a step of zero is none), or is more than an hour after
    ///     it.
    fn predict(&self, py: Python<'_>, t: f64) -> PyResult<()> {
        self.write(py, |f| f.predict(t))
    }

    /// Predicts the present frame again, from the checkpoint of the frame before, with the turn that is
    /// seen in the images (METHOD 27).
    ///
    /// To be asked where the frame has measured nothing: what was done since the checkpoint is undone.
    ///
    /// Parameters
    /// ----------
    /// since : float
    ///     Time of the frame before, seconds.
    /// before, now : (N, 2) float64
    ///     Pixels of points that were followed, there and in the present frame.
    ///
    /// Returns
    /// -------
    /// bool
    ///     False, and nothing changed, where the images do not tell the turn, the last checkpoint is not of
    ///     that frame, or odometry told the motion.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes or NaN; nothing changes then.
    fn predict_again(
        &self,
        py: Python<'_>,
        since: f64,
        before: Argument<'_>,
        now: Argument<'_>,
    ) -> PyResult<bool> {
        let followed = followed(since, &before, &now)?;
        self.write(py, |f| f.predict_again(&followed))
    }

    /// Every feature that should be visible in Cs.
    ///
    /// Returns
    /// -------
    /// Prediction
    fn predict_pixels(&self, py: Python<'_>) -> PyResult<PyPrediction> {
        let seen = self.read(py, |f| Ok(f.predict_pixels()))?;
        Ok(PyPrediction {
            ids: to_ids(py, seen.iter().map(|f| Some(f.id))),
            uv: vectors(py, seen.iter().map(|f| f.uv)),
            s: stacked(py, seen.iter().map(|f| f.s)),
            points: vectors(py, seen.iter().map(|f| f.point)),
            rho: column(py, seen.iter().map(|f| f.rho)),
            rho_sd: column(py, seen.iter().map(|f| f.rho_sd)),
        })
    }

    /// Where features are expected once others of the same frame have been found (METHOD 7).
    ///
    /// Those found tell the camera's motion since the last frame, which is most of what a prediction does
    /// not know. Those that contradict most of the others do not count. The filter stays as it is.
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
    /// ConditionalPrediction
    ///     One row for each of ``ids``.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, unknown ids, an id given twice.
    fn predict_conditional(
        &self,
        py: Python<'_>,
        found: Argument<'_>,
        uv: Argument<'_>,
        ids: Argument<'_>,
    ) -> PyResult<PyConditionalPrediction> {
        let (found, ids) = (bearings(&found, &uv)?, self::ids("ids", &ids)?);
        let told = self.write(py, |f| f.predict_conditional(&found, &ids))?;
        let nothing = ConditionalPrediction {
            uv: Vector2::repeat(f64::NAN),
            s: Matrix2::identity(),
        };
        let expected = told.expected.into_iter();
        let expected: Vec<_> = expected.map(|e| e.unwrap_or(nothing)).collect();
        Ok(PyConditionalPrediction {
            agree: column(py, told.agree),
            uv: vectors(py, expected.iter().map(|e| e.uv)),
            s: stacked(py, expected.iter().map(|e| e.s)),
        })
    }

    /// Predicts whether Cs and Cf overlap (METHOD 9).
    ///
    /// Parameters
    /// ----------
    /// t_cf : (4, 4) float64
    ///     Measured pose of Cf relative to Cs: maps points of F into C, metres.
    /// covariance : (6, 6) float64
    ///     Of it over (translation m, rotation rad), tangent on the right.
    /// who : int
    ///     The worn camera's number.
    ///
    /// Returns
    /// -------
    /// OverlapPrediction or None
    ///     None where they do not.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For wrong shapes, NaN, a pose or a covariance that is none, or a filter without a worn camera.
    #[pyo3(signature = (t_cf, covariance, *, who = 0))]
    fn predict_overlap(
        &self,
        py: Python<'_>,
        t_cf: Argument<'_>,
        covariance: Argument<'_>,
        who: usize,
    ) -> PyResult<Option<PyOverlap>> {
        let t_cf = pose("t_cf", &t_cf)?;
        let covariance = covariance6("covariance", &covariance)?;
        let overlap = self.read(py, |f| f.overlap(&t_cf, &covariance, who))?;
        Ok(overlap.map(|o| PyOverlap {
            roi_s: o.roi_s.into(),
            roi_f: o.roi_f.into(),
            d_max: o.d_max,
            baseline: o.baseline,
        }))
    }

    /// Checks that a view of Cf with this pose can be measured.
    ///
    /// Parameters
    /// ----------
    /// t_cf, covariance
    ///     As for :meth:`predict_overlap`.
    /// bias : (6, 6) float64, optional
    ///     The part of the covariance that lasts from frame to frame.
    /// who : int
    ///     The worn camera's number.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     Saying why it cannot.
    #[pyo3(signature = (t_cf, covariance, bias = None, *, who = 0))]
    fn check_worn(
        &self,
        py: Python<'_>,
        t_cf: Argument<'_>,
        covariance: Argument<'_>,
        bias: Option<Argument<'_>>,
        who: usize,
    ) -> PyResult<()> {
        let t_cf = pose("t_cf", &t_cf)?;
        let covariance = covariance6("covariance of T_CF", &covariance)?;
        let bias = bias.map(|b| covariance6("bias of T_CF", &b)).transpose()?;
        self.read(py, |f| f.check_worn(&t_cf, &covariance, bias.as_ref(), who))
    }

    /// Takes it that all lengths of T_CF of a worn camera may be off, for good (METHOD 22).
    ///
    /// So may what is in view, which follows them.  It is told in covariances; the estimate stays as it is.
    ///
    /// Parameters
    /// ----------
    /// who : int
    ///     The worn camera's number.
    /// sd : float
    ///     Standard deviation of the logarithm of its lengths, from 0 to 1; less than before says nothing.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For an unknown worn camera, or no such number.
    fn doubt_length(&self, py: Python<'_>, who: usize, sd: f64) -> PyResult<()> {
        self.write(py, |f| f.doubt_length(who, sd))
    }

    /// Checks that depths can be measured.
    ///
    /// Parameters
    /// ----------
    /// depth, sigma : (N,) float64
    ///     Along the optical axis of Cs, and their standard deviations, metres.
    ///
    /// Raises
    /// ------
    /// InputError
    ///     Saying why one cannot.
    #[staticmethod]
    fn check_depths(py: Python<'_>, depth: Argument<'_>, sigma: Argument<'_>) -> PyResult<()> {
        let (depth, sigma) = (numbers("depth", &depth)?, numbers("sigma", &sigma)?);
        same_length("sigma", depth.len(), sigma.len())?;
        let mut pairs = depth.into_iter().zip(sigma);
        gate::enter(py, || {
            pairs.try_for_each(|(z, sd)| Filter::check_depth(z, sd))
        })
    }
}
