//! Where one camera has been, and where the points that it has followed are, from several views of them (METHOD 5).
//!
//! The scale-free start. While the camera has hardly moved, a turn and a step to the side look alike, and a filter that is
//! linearised there takes one for the other and is sure of it. So nothing is linearised before the views tell them apart:
//! all of them are fitted at once (Gauss-Newton, damped, by the Schur complement over the points), from several first
//! guesses of the direction of motion, and an answer is one only if no other fits nearly as well.
//!
//! Unknown are the poses of all views but the first, `T_0k = T_hat Exp(xi)`, and `(theta, phi, rho)` of each point from the
//! first view. Nothing tells the scale: it is chosen such that the mean of rho is what the caller says.

mod answers;
mod fit;
mod normal;
mod unit;

use crate::camera::Camera;
use crate::math::pose::Pose;
use fit::Fit;
use nalgebra::{DMatrix, Vector2, Vector3};

/// Steps of one fit at most: of a first guess from two views, and of all views.
const STEPS: (usize, usize) = (12, 20);
/// By how many variances of the residuals another answer must fit worse: chi-square of two numbers at 0.999.
const DISTINCT: f64 = 13.8;
/// Rows of the two poses in [`Structure::covariance`].
pub(crate) const POSES: usize = 12;

/// What the views say.
#[derive(Clone, Debug)]
pub(crate) struct Structure {
    /// Poses of the last view and of the one before it, in the first.
    pub last: [Pose; 2],
    /// Which track each point is.
    pub tracks: Vec<usize>,
    /// `(theta, phi, rho)` of each point, from the first view.
    pub points: Vec<Vector3<f64>>,
    /// Joint covariance: both poses' tangents (6 and 6; zeros where the one before is the first), then the points (3 each).
    pub covariance: DMatrix<f64>,
}

impl Structure {
    /// Fits the views: `views[k][i]` is the pixel of track i in view k. None if they do not tell it yet: fewer than
    /// `least` points, or than half of all, whose rho is known to `max_rho_ratio`, or two answers that fit alike.
    pub(crate) fn of(
        camera: &Camera,
        views: &[Vec<Vector2<f64>>],
        sigma: f64,
        (rho, max_rho_ratio, least): (f64, f64, usize),
    ) -> Option<Self> {
        let all: Vec<usize> = (0..views.first()?.len()).collect();
        let mut fit = Fit::new(camera, views, sigma, all)?;
        let least = least.max(fit.tracks.len() / 2);
        let (best, next) = fit.answers();
        let mut best = best?;
        if let Some(next) = next {
            let variance = best.cost / fit.freedom();
            if next.cost - best.cost < DISTINCT * variance {
                return None;
            }
        }
        let right = fit.right(&best);
        if right.len() < fit.tracks.len() {
            let fewer = Fit::new(
                camera,
                views,
                sigma,
                right.iter().map(|&i| fit.tracks[i]).collect(),
            )?;
            best.points = right.iter().map(|&i| best.points[i]).collect();
            best = fewer.settle(best, STEPS.1)?;
            fit = fewer;
        }
        fit.structure(best, rho, max_rho_ratio, least)
    }
}
