//! Where the worn camera should look (METHOD 24): of the views of Cf that a person could offer next, the one that leaves
//! camera and scale best known.
//!
//! ```text
//! Known     the points in Cs's view, the error of T_CF, and what is wanted (pose and log-scale), with their joint covariance
//!   .from() the same as one place of Cf sees it: each point relative to Cf, and how probable its match is
//!   .gain() of a direction there: which points are in the image, S of their pixels, log det of what is wanted
//! ```
//!
//! What does not change with the direction is worked out once for a place, and what does not change with the place once.

mod directions;
mod known;
mod matching;
mod place;

pub(crate) use directions::{attitude, directions, turns_around};
pub(crate) use known::{Known, wanted};
pub(crate) use place::Place;

use crate::math::pose::Pose;

/// A view that Cf could offer.
#[derive(Clone, Debug, PartialEq)]
pub struct CandidateView {
    /// T_CF there.
    pub t_cf: Pose,
    /// Matches to be expected.
    pub matches: f64,
    /// Expected decrease of `ln det / 2` of the covariance of the camera's pose and the scale's logarithm, nats.
    pub gain: f64,
}

/// The views that were looked at, and what they would give.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ViewPlan {
    /// From where Cf is, by direction.
    pub here: Vec<CandidateView>,
    /// From places around, each looking at the middle of what Cs sees.
    pub elsewhere: Vec<CandidateView>,
}

impl ViewPlan {
    /// Place in a list of the view with the largest gain; `None` if no view gains anything.
    pub fn best(views: &[CandidateView]) -> Option<usize> {
        let gaining = views.iter().enumerate().filter(|(_, view)| view.gain > 0.0);
        let best = gaining.max_by(|(_, a), (_, b)| a.gain.total_cmp(&b.gain));
        best.map(|(index, _)| index)
    }
}
