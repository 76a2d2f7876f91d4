//! What a frame measures, by name.

use crate::arrays_in::{
    Argument, covariance6, ids, numbers, optional_ids, pixels, pose, same_length, vector,
};
use ekf_core::{Bearing, Capture, DepthObservation, Followed, WornObservation, WornPair};
use pyo3::prelude::*;

/// The worn camera's part of a frame: its measured pose, points that both cameras see, and features
/// that it sees alone.
///
/// Parameters
/// ----------
/// t_cf : (4, 4) float64
///     Measured pose of Cf relative to Cs when the view was taken: maps points of F into C, metres.
/// covariance : (6, 6) float64
///     Of it over (translation m, rotation rad), tangent on the right.
/// ids : (M,) int64
///     Feature of each pair, -1 for a new point.
/// uv, uv_f : (M, 2) float64
///     Its pixels in Cs and in Cf. NaN in ``uv`` are features that Cf alone sees, as the corners of a
///     printed tag: the mode ``collab-tight`` measures them.
/// bias : (6, 6) float64, optional
///     The part of the covariance that lasts from frame to frame; ``worn.bias_share`` of it if left
///     out.
/// capture : (t, frame), optional
///     When the view was taken, and the time of the frame of Cs whose image ``uv`` are of (the present one,
///     or one of `Filter.kept_times`), seconds; at the frame's own time if left out (METHOD 21).
/// who : int
///     The worn camera's number: its place in the list that the filter was made with.
///
/// Raises
/// ------
/// InputError
///     For wrong shapes, and ids that are none. `Filter.update` checks the values.
#[pyclass(name = "WornMeasurement", module = "collabslam._core", frozen)]
pub(crate) struct PyWornMeasurement(pub(super) WornObservation);

#[pymethods]
impl PyWornMeasurement {
    #[new]
    #[pyo3(signature = (t_cf, covariance, ids, uv, uv_f, *, bias = None, capture = None, who = 0))]
    #[expect(clippy::too_many_arguments, reason = "eight names in Python")]
    fn new(
        t_cf: Argument<'_>,
        covariance: Argument<'_>,
        ids: Argument<'_>,
        uv: Argument<'_>,
        uv_f: Argument<'_>,
        bias: Option<Argument<'_>>,
        capture: Option<(f64, f64)>,
        who: usize,
    ) -> PyResult<Self> {
        let ids = optional_ids("worn ids", &ids)?;
        let (uv, uv_f) = (pixels("worn uv", &uv)?, pixels("worn uv_f", &uv_f)?);
        same_length("worn uv", ids.len(), uv.len())?;
        same_length("worn uv_f", ids.len(), uv_f.len())?;
        let pairs = ids.into_iter().zip(uv).zip(uv_f);
        Ok(Self(WornObservation {
            who,
            t_cf: pose("t_cf", &t_cf)?,
            covariance: covariance6("covariance", &covariance)?,
            bias: bias.map(|b| covariance6("bias of T_CF", &b)).transpose()?,
            capture: capture.map(|(t, frame)| Capture { t, frame }),
            rate: None,
            pairs: pairs
                .map(|((id, uv), uv_f)| {
                    let alone = id.is_some() && uv.iter().all(|x| x.is_nan());
                    let uv = (!alone).then_some(uv);
                    WornPair { id, uv, uv_f }
                })
                .collect(),
        }))
    }

    /// The same with what a gyroscope of Cf's own tells of how it turned (METHOD 6).
    ///
    /// Parameters
    /// ----------
    /// rate : (3,) float64
    ///     Angular velocity of Cf when the view's middle row was taken, along the axes of F, rad/s.
    ///
    /// Returns
    /// -------
    /// WornMeasurement
    ///
    /// Raises
    /// ------
    /// InputError
    ///     For a wrong shape, and numbers that are not finite. `Filter.update` checks their sizes.
    fn with_rate(&self, rate: Argument<'_>) -> PyResult<Self> {
        let rate = Some(vector("rate of Cf", &rate)?);
        Ok(Self(WornObservation {
            rate,
            ..self.0.clone()
        }))
    }

    fn __len__(&self) -> usize {
        self.0.pairs.len()
    }
}

/// Depths of points in Cs, from any other sensor.
///
/// Parameters
/// ----------
/// ids : (K,) int64
///     Feature of each depth, -1 for a new point.
/// uv : (K, 2) float64
///     Its pixel in Cs.
/// depth, sigma : (K,) float64
///     Depth along the optical axis of Cs and its standard deviation, metres.
///
/// Raises
/// ------
/// InputError
///     For wrong shapes, and ids that are none. `Filter.update` checks the values.
#[pyclass(name = "DepthMeasurement", module = "collabslam._core", frozen)]
pub(crate) struct PyDepthMeasurement(pub(super) Vec<DepthObservation>);

#[pymethods]
impl PyDepthMeasurement {
    #[new]
    fn new(
        ids: Argument<'_>,
        uv: Argument<'_>,
        depth: Argument<'_>,
        sigma: Argument<'_>,
    ) -> PyResult<Self> {
        let (ids, uv) = (optional_ids("depth ids", &ids)?, pixels("depth uv", &uv)?);
        let (depth, sigma) = (numbers("depth", &depth)?, numbers("sigma", &sigma)?);
        same_length("depth uv", ids.len(), uv.len())?;
        same_length("depth", ids.len(), depth.len())?;
        same_length("sigma", ids.len(), sigma.len())?;
        let depths = (0..ids.len()).map(|i| DepthObservation {
            id: ids[i],
            uv: uv[i],
            depth: depth[i],
            sigma: sigma[i],
        });
        Ok(Self(depths.collect()))
    }

    fn __len__(&self) -> usize {
        self.0.len()
    }
}

/// Features and their pixels in Cs.
pub(super) fn bearings(ids: &Argument<'_>, uv: &Argument<'_>) -> PyResult<Vec<Bearing>> {
    let (ids, uv) = (self::ids("ids", ids)?, pixels("uv", uv)?);
    same_length("uv", ids.len(), uv.len())?;
    let found = ids.into_iter().zip(uv);
    Ok(found.map(|(id, uv)| Bearing { id, uv }).collect())
}

/// Points of the image at `since`, seconds, that were followed into the present one.
pub(super) fn followed(
    since: f64,
    before: &Argument<'_>,
    now: &Argument<'_>,
) -> PyResult<Followed> {
    let before = pixels("points of the frame before", before)?;
    let now = pixels("points of the present frame", now)?;
    Ok(Followed { since, before, now })
}
