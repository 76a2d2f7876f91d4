//! The joint covariance of all that a view of Cf depends on and of what it is to tell.

use crate::math::pose::{Pose, tangent_map};
use crate::observe::PointInCamera;
use crate::scale::ScaleEstimate;
use crate::state::{Block, State};
use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix, Vector3};

/// What is wanted: the camera's pose (tangent, 6) and the logarithm of the scale.
pub(super) const WANTED: usize = 7;
/// Most points that are looked at: those of a larger number are taken evenly.
const MOST_POINTS: usize = 40;

pub(crate) type Wanted = SMatrix<f64, WANTED, WANTED>;
pub(crate) type WantedWith<const C: usize> = SMatrix<f64, WANTED, C>;

/// What the filter knows after a frame.
pub(crate) struct Known {
    /// Points in C, metres.
    pub(super) points: Vec<Vector3<f64>>,
    /// Their joint covariance, 3 rows each; the blocks on and below the diagonal.
    pub(super) covariance: DMatrix<f64>,
    /// Error of the next T_CF, along the axes of C: (translation, rotation).
    pub(super) error: Matrix6<f64>,
    /// Covariance of each point with it.
    pub(super) with_error: Vec<SMatrix<f64, 3, 6>>,
    /// Covariance of what is wanted.
    pub(super) wanted: Wanted,
    pub(super) wanted_with_points: Vec<WantedWith<3>>,
    pub(super) wanted_with_error: WantedWith<6>,
}

/// Covariance of the camera's pose, (translation, rotation), right tangent, and of the logarithm of the scale; `None` where
/// nothing has a depth.
pub(crate) fn wanted(state: &State) -> Option<Wanted> {
    ScaleEstimate::of(state).map(|scale| covariance_of_wanted(state, &scale))
}

fn covariance_of_wanted(state: &State, scale: &ScaleEstimate) -> Wanted {
    let slots = state.covariance().stored().slots;
    let tangent = tangent_map(&state.camera_pose().q);
    let with_scale = SMatrix::<f64, 7, 1>::from_fn(|r, _| scale.along[slots[r]]);
    let with_scale = tangent * with_scale;
    let mut out = Wanted::zeros();
    out.fixed_view_mut::<6, 6>(0, 0)
        .copy_from(&state.pose_covariance());
    out.fixed_view_mut::<6, 1>(0, 6).copy_from(&with_scale);
    out.fixed_view_mut::<1, 6>(6, 0)
        .copy_from(&with_scale.transpose());
    out[(6, 6)] = scale.variance;
    out
}

/// A point in view: its block and its derivatives.
struct VisibleLandmark {
    block: Block,
    point: PointInCamera,
}

impl Known {
    /// From the state, for features that are in view and a view like the one with `t_cf`; `bias` is the part of its
    /// `covariance` that lasts; the worn camera is `who`. `None` where nothing has a depth.
    pub(crate) fn new(
        state: &State,
        in_view: impl Fn(&Vector3<f64>) -> bool,
        (t_cf, covariance, bias): (&Pose, &Matrix6<f64>, &Matrix6<f64>),
        who: usize,
    ) -> Option<Self> {
        let scale = ScaleEstimate::of(state)?;
        let seen = seen(state, in_view);
        if seen.is_empty() {
            return None;
        }
        let p = state.covariance();
        let slots = p.stored().slots;
        let with_pose: Vec<SMatrix<f64, 7, 3>> = seen
            .iter()
            .map(|s| {
                p.block::<7, 7>(0, 0) * s.point.by_pose.transpose()
                    + state.feature_covariance(&s.block).0 * s.point.by_feature.transpose()
            })
            .collect();
        let tangent = tangent_map(&state.camera_pose().q);
        let scale_with = |at: usize| scale.along[slots[at]];
        let scale_with_pose = SMatrix::<f64, 1, 7>::from_fn(|_, c| scale_with(c));
        let wanted_with_points = seen.iter().zip(&with_pose).map(|(s, with_pose)| {
            let numbers = s.block.range();
            let own = SMatrix::<f64, 1, 6>::from_fn(|_, c| {
                numbers.clone().nth(c).map_or(0.0, scale_with)
            });
            let by_scale = scale_with_pose * s.point.by_pose.transpose()
                + own * s.point.by_feature.transpose();
            stack(&(tangent * with_pose), &by_scale)
        });
        // The white part in C's axes; the bias is along them in the state, if it is there, else it is as new.
        let time_correlated: Vec<(usize, Matrix6<f64>)> =
            state.time_correlated_error(who).collect();
        let white = if time_correlated.is_empty() {
            *covariance
        } else {
            covariance - bias
        };
        let mut error = t_cf.covariance_along_fixed_axes(&white);
        let mut with_error = vec![SMatrix::<f64, 3, 6>::zeros(); seen.len()];
        let mut wanted_with_error = WantedWith::<6>::zeros();
        error += state.time_correlated_covariance(who);
        for (at, by) in time_correlated {
            for (with, s) in with_error.iter_mut().zip(&seen) {
                let with_block = s.point.by_pose * p.block::<7, 6>(0, at)
                    + s.point.by_feature * state.covariance_with(at, &s.block).transpose();
                *with += with_block * by.transpose();
            }
            let by_scale = SMatrix::<f64, 1, 6>::from_fn(|_, c| scale_with(at + c));
            let with_block = stack(&(tangent * p.block::<7, 6>(0, at)), &by_scale);
            wanted_with_error += with_block * by.transpose();
        }
        Some(Self {
            wanted_with_points: wanted_with_points.collect(),
            covariance: covariance_of(state, &seen, &with_pose),
            points: seen.into_iter().map(|s| s.point.value).collect(),
            error,
            with_error,
            wanted: covariance_of_wanted(state, &scale),
            wanted_with_error,
        })
    }

    /// Middle of the points, and the median of their ranges from C, metres.
    pub(crate) fn middle(&self) -> (Vector3<f64>, f64) {
        let mut ranges: Vec<f64> = self.points.iter().map(Vector3::norm).collect();
        ranges.sort_unstable_by(f64::total_cmp);
        let median = ranges[ranges.len() / 2];
        let rays = self.points.iter().map(Vector3::normalize);
        (rays.sum::<Vector3<f64>>().normalize() * median, median)
    }
}

fn seen(state: &State, in_view: impl Fn(&Vector3<f64>) -> bool) -> Vec<VisibleLandmark> {
    let camera = state.camera_pose();
    let seen = state.layout().features().filter_map(|block| {
        let point = PointInCamera::metric(&camera, &state.feature(block))?;
        in_view(&point.value).then_some(VisibleLandmark {
            block: *block,
            point,
        })
    });
    let seen: Vec<VisibleLandmark> = seen.collect();
    let (n, kept) = (seen.len(), seen.len().min(MOST_POINTS));
    let chosen = |i: usize| (i * kept) / n != ((i + 1) * kept) / n;
    let numbered = seen.into_iter().enumerate();
    numbered
        .filter(|(i, _)| chosen(*i))
        .map(|(_, s)| s)
        .collect()
}

/// Joint covariance of points in C, the blocks on and below the diagonal.
fn covariance_of(
    state: &State,
    seen: &[VisibleLandmark],
    with_pose: &[SMatrix<f64, 7, 3>],
) -> DMatrix<f64> {
    let mut out = DMatrix::zeros(3 * seen.len(), 3 * seen.len());
    for (j, b) in seen.iter().enumerate() {
        for (i, a) in seen.iter().enumerate().skip(j) {
            let cross = state.feature_covariance(&a.block).0.transpose();
            let own: SMatrix<f64, 6, 6> = state.covariance().block(a.block.offset, b.block.offset);
            let with_b = cross * b.point.by_pose.transpose() + own * b.point.by_feature.transpose();
            let block: Matrix3<f64> = a.point.by_pose * with_pose[j] + a.point.by_feature * with_b;
            out.fixed_view_mut::<3, 3>(3 * i, 3 * j).copy_from(&block);
        }
    }
    out
}

fn stack<const C: usize>(pose: &SMatrix<f64, 6, C>, scale: &SMatrix<f64, 1, C>) -> WantedWith<C> {
    let mut out = WantedWith::<C>::zeros();
    out.fixed_rows_mut::<6>(0).copy_from(pose);
    out.fixed_rows_mut::<1>(6).copy_from(scale);
    out
}
