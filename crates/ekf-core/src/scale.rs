//! The scale of camera and map, as the state tells it.
//!
//! Its logarithm is estimated as best as the features allow by themselves: the mean of the logarithms of their ranges from the
//! camera, each weighted with the inverse of its variance. With `b` its derivative by the state, `b^T N = 1` along the scale's
//! direction `N(x)` (see [`gauge`](crate::gauge)), the variance is `b^T P b`. An error that all features share is in it as it
//! is; errors of single depths average out.

use crate::observe::FeatureState;
use crate::state::{Block, State};
use nalgebra::{SMatrix, SVector, Vector3};

/// How the estimate of the scale's logarithm depends on the state.
pub(crate) struct ScaleEstimate {
    /// Its covariance with the state, `P b`, row by row as P is stored.
    pub(crate) along: Vec<f64>,
    /// `b^T P b`.
    pub(crate) variance: f64,
}

/// Derivatives of the logarithm of a range by the camera's position and by the feature.
pub(crate) struct LogRange {
    pub(crate) by_camera: Vector3<f64>,
    pub(crate) by_feature: SVector<f64, 6>,
}

impl LogRange {
    /// `None` of a feature without a point.
    pub(crate) fn of(camera: &Vector3<f64>, feature: &FeatureState) -> Option<Self> {
        let ray = feature.point()? - camera;
        let by_point = ray / ray.norm_squared();
        Some(Self {
            by_camera: -by_point,
            by_feature: feature.point_jacobian().tr_mul(&by_point),
        })
    }

    fn variance(&self, state: &State, block: &Block) -> f64 {
        let (cross, own) = state.feature_covariance(block);
        let with_camera: SMatrix<f64, 3, 6> = cross.fixed_view::<3, 6>(0, 0).into_owned();
        let camera = state.covariance().block::<3, 3>(0, 0);
        let mixed = (with_camera.tr_mul(&self.by_camera)).dot(&self.by_feature);
        (camera * self.by_camera).dot(&self.by_camera)
            + (own * self.by_feature).dot(&self.by_feature)
            + 2.0 * mixed
    }
}

/// Derivative of the estimate of the scale's logarithm by the state; `None` where no feature has a depth.
pub(crate) fn by_state(state: &State) -> Option<Vec<f64>> {
    let camera = state.camera_pose().r;
    let mut b = vec![0.0; state.mean().len()];
    let mut total = 0.0;
    for block in state.layout().features() {
        let Some(range) = LogRange::of(&camera, &state.feature(block)) else {
            continue;
        };
        let weight = 1.0 / range.variance(state, block);
        if !(weight.is_finite() && weight > 0.0) {
            continue;
        }
        total += weight;
        for (b, value) in b[..3].iter_mut().zip(range.by_camera.iter()) {
            *b += weight * value;
        }
        for (b, value) in b[block.range()].iter_mut().zip(range.by_feature.iter()) {
            *b += weight * value;
        }
    }
    if total == 0.0 {
        return None;
    }
    b.iter_mut().for_each(|b| *b /= total);
    Some(b)
}

/// Variance of the estimate by the covariance that is told; `None` where no feature has a depth.
pub(crate) fn told_variance(state: &State) -> Option<f64> {
    let time_correlated = state.told().time_correlated_variance(&by_state(state)?);
    ScaleEstimate::of(state).map(|scale| scale.variance + time_correlated)
}

impl ScaleEstimate {
    /// `None` where no feature has a depth.
    pub(crate) fn of(state: &State) -> Option<Self> {
        let b = by_state(state)?;
        // A row that several features share tells the sum of what they tell.
        let stored = state.covariance().stored();
        let mut by_row = vec![0.0; stored.n];
        for (b, &slot) in b.iter().zip(stored.slots) {
            by_row[slot] += b;
        }
        let mut along = vec![0.0; stored.n];
        state.covariance().times(&by_row, &[], &mut along);
        let sum: f64 = by_row.iter().zip(&along).map(|(b, p)| b * p).sum();
        Some(Self {
            along,
            variance: sum.max(0.0),
        })
    }
}
