//! What one frame measures, and what an update reports about it.

use crate::error::EkfError;
use crate::math::pose::Pose;
use nalgebra::{Matrix6, Vector2, Vector3, Vector6};

/// A feature found in Cs.
#[derive(Clone, Copy, Debug)]
pub struct Bearing {
    /// Id of the feature.
    pub id: u64,
    /// Its pixel in Cs.
    pub uv: Vector2<f64>,
}

/// A point seen by both cameras, or a feature that Cf alone sees.
#[derive(Clone, Copy, Debug)]
pub struct WornPair {
    /// The feature it is, or `None` for a new point.
    pub id: Option<u64>,
    /// Its pixel in Cs; `None` for a feature whose pixel in Cf says by itself which it is: the tight form measures it, others
    /// do not.
    pub uv: Option<Vector2<f64>>,
    /// Its pixel in Cf.
    pub uv_f: Vector2<f64>,
}

/// When a view of Cf was taken that is not of the frame's own instant (METHOD 21).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Capture {
    /// When it was taken, seconds.
    pub t: f64,
    /// Time of the frame of Cs that it was matched with: the pixels in Cs are of its image. The present one, or one whose
    /// pose is kept.
    pub frame: f64,
}

/// What the worn camera contributes to a frame.
#[derive(Clone, Debug)]
pub struct WornObservation {
    /// The worn camera's number: its place in the list that the filter was made with.
    pub who: usize,
    /// Measured T_CF, at the time that it was taken: maps points of F into C.
    pub t_cf: Pose,
    /// 6x6 covariance of its error, (translation, rotation), right tangent.
    pub covariance: Matrix6<f64>,
    /// The part of that covariance that lasts from frame to frame; `worn.bias_share` of it if `None`.
    pub bias: Option<Matrix6<f64>>,
    /// When it was taken; at the frame's own time if `None`.
    pub capture: Option<Capture>,
    /// Angular velocity of Cf when the middle row was taken, along the axes of F, rad/s, as a gyroscope of its own tells it.
    pub rate: Option<Vector3<f64>>,
    /// Matches between both images.
    pub pairs: Vec<WornPair>,
}

/// A depth from any other source: a range finder, a depth camera.
#[derive(Clone, Copy, Debug)]
pub struct DepthObservation {
    /// The feature it belongs to, or `None` for a new point.
    pub id: Option<u64>,
    /// Pixel in Cs.
    pub uv: Vector2<f64>,
    /// Depth along Cs's optical axis, metres, at least a millimetre.
    pub depth: f64,
    /// Its standard deviation, metres, at least a micrometre.
    pub sigma: f64,
}

/// Points of one image of Cs that were followed into the next.
#[derive(Clone, Debug, Default)]
pub struct Followed {
    /// Time of the first image, seconds: of the frame of the last checkpoint.
    pub since: f64,
    /// Pixels in the first image.
    pub before: Vec<Vector2<f64>>,
    /// Pixels of the same points in the second.
    pub now: Vec<Vector2<f64>>,
}

/// All measurements of one frame.
#[derive(Clone, Debug, Default)]
pub struct Measurements {
    /// Features that were looked for, found or not.
    pub searched: Vec<u64>,
    /// Features found in Cs.
    pub bearings: Vec<Bearing>,
    /// Views of worn cameras: the first is measured together with what Cs found, each other after all before it. A new point
    /// that several have, at the same pixel of the same frame of Cs, is one.
    pub views: Vec<WornObservation>,
    /// Other depths.
    pub depths: Vec<DepthObservation>,
    /// Fewest accepted bearings with which the frame is used: with fewer nothing of it is.
    pub min_inliers: usize,
    /// Greatest speed, m/s, with which the frame is used: if the camera would be faster after it nothing of it is. None for any.
    pub max_speed: Option<f64>,
    /// Points of the image before, if they are to be asked: where the turn that they show excludes the one that the camera would
    /// have made, nothing of the frame is used.
    pub followed: Option<Followed>,
}

impl Measurements {
    /// The view that is measured together with what Cs found.
    pub(crate) fn first_view(&self) -> Option<&WornObservation> {
        self.views.first()
    }

    /// Its pairs.
    pub(crate) fn pairs(&self) -> &[WornPair] {
        self.first_view().map_or(&[], |worn| &worn.pairs)
    }
}

/// What became of one measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeasurementOutcome {
    /// Accepted as two pixel rows.
    Pixel,
    /// Accepted as three metric rows.
    Depth,
    /// A rate, accepted as three rows of how Cf turned while its image was read.
    Rate,
    /// Its feature was measured by a better form of the same match.
    Replaced,
    /// A depth not accurate enough to be worth more than its bearing; a pixel that was predicted no better than somewhere in
    /// the image.
    TooUncertain,
    /// The rays do not meet in front of both cameras, or the feature predicts nothing.
    NotVisible,
    /// Failed its own chi-square gate.
    RejectedGate,
    /// Rejected by the batch test.
    RejectedBatch,
    /// Rejected given the other accepted matches, by the conditional gate.
    RejectedConditional,
    /// A new feature with this id.
    Born(u64),
    /// Not used in this mode.
    Unused,
    /// Refused with the whole frame: the update would have broken the filter.
    Refused,
}

impl MeasurementOutcome {
    /// Whether the match measured its feature, in its own form or in the better one that replaced it.
    pub fn is_accepted(&self) -> bool {
        matches!(self, Self::Pixel | Self::Depth | Self::Replaced)
    }
}

/// Where one worn camera was when its view was taken.
#[derive(Clone, Debug)]
pub struct WornPose {
    /// Its number.
    pub who: usize,
    /// `T_WF`: maps points of F into W.
    pub pose: Pose,
    /// Its covariance, (translation, rotation), right tangent, m^2 and rad^2.
    pub covariance: Matrix6<f64>,
}

/// What one update did.
#[derive(Clone, Debug, Default)]
pub struct UpdateReport {
    /// One per bearing.
    pub bearings: Vec<MeasurementOutcome>,
    /// One list per view, one outcome per pair.
    pub views: Vec<Vec<MeasurementOutcome>>,
    /// One per view: what became of its rate, `Unused` where none was told.
    pub rates: Vec<MeasurementOutcome>,
    /// One per depth.
    pub depths: Vec<MeasurementOutcome>,
    /// Normalised innovation squared of what was accepted.
    pub nis: f64,
    /// Its degrees of freedom.
    pub dof: usize,
    /// Number of matches the batch test left out.
    pub order: usize,
    /// Whether the batch test finished its exact search, each time that the frame asked for it.
    pub exact: bool,
    /// Estimated error of T_CF of the first view after the update, tangent (m, rad).
    pub worn_error: Vector6<f64>,
    /// Covariance that is left of it, as the sharp model has it.
    pub worn_error_covariance: Matrix6<f64>,
    /// Covariance of what the map's lasting errors may have put into it, which that model does not know of (METHOD 20).
    pub worn_error_of_map: Matrix6<f64>,
    /// One per view: where the worn camera was. None before the start, and of a frame of which nothing was used.
    pub worn_poses: Vec<WornPose>,
    /// Why the frame was refused, if it was: the filter is as it was before.
    pub refused: Option<EkfError>,
    /// Whether the frame was used: at least [`Measurements::min_inliers`] bearings were accepted, and the camera moved as
    /// [`Measurements::max_speed`] and [`Measurements::followed`] let it.
    pub accepted: bool,
    /// Whether it was not as the camera would have been faster than [`Measurements::max_speed`].
    pub too_fast: bool,
    /// Whether it was not as [`Measurements::followed`] show another turn.
    pub turn_excluded: bool,
    /// Of a relocalisation: whether prediction excludes where it found the camera, whatever is not known of the map.
    pub jumped: bool,
}

impl UpdateReport {
    /// The report of measurements that [`Filter::update`](crate::filter::Filter::update) refused with `NotPositiveDefinite` or `Unsound`.
    pub fn refused(z: &Measurements, error: EkfError) -> Self {
        let mut report = Self::default();
        report.start(z);
        let rated = z.views.iter().map(|view| view.rate.is_some());
        for (rate, _) in report.rates.iter_mut().zip(rated).filter(|(_, is)| *is) {
            *rate = MeasurementOutcome::Refused;
        }
        let lists = [&mut report.bearings, &mut report.depths].into_iter();
        for list in lists.chain(&mut report.views) {
            list.fill(MeasurementOutcome::Refused);
        }
        report.refused = Some(error);
        report.accepted = false;
        report
    }

    /// Resets the report for these measurements; the lists keep their capacity.
    pub(crate) fn start(&mut self, z: &Measurements) {
        let lists = [&mut self.bearings, &mut self.depths, &mut self.rates];
        let [mut bearings, mut depths, mut rates] = lists.map(std::mem::take);
        refill(&mut rates, MeasurementOutcome::Unused, z.views.len());
        refill(
            &mut bearings,
            MeasurementOutcome::NotVisible,
            z.bearings.len(),
        );
        refill(&mut depths, MeasurementOutcome::NotVisible, z.depths.len());
        let mut views = std::mem::take(&mut self.views);
        views.resize_with(z.views.len(), Vec::new);
        for (list, view) in views.iter_mut().zip(&z.views) {
            refill(list, MeasurementOutcome::Unused, view.pairs.len());
        }
        let mut worn_poses = std::mem::take(&mut self.worn_poses);
        worn_poses.clear();
        *self = Self {
            bearings,
            depths,
            views,
            rates,
            worn_poses,
            exact: true,
            accepted: true,
            ..Self::default()
        };
    }

    /// Outcomes of the first view's pairs.
    pub(crate) fn pairs(&self) -> &[MeasurementOutcome] {
        self.views.first().map_or(&[], Vec::as_slice)
    }

    /// The mask of accepted bearings, in their order: which features were measured in Cs.
    pub fn inliers(&self) -> impl ExactSizeIterator<Item = bool> {
        self.bearings.iter().map(MeasurementOutcome::is_accepted)
    }

    /// How many of [`Self::inliers`] are.
    pub(crate) fn inlier_count(&self) -> usize {
        self.inliers().filter(|&accepted| accepted).count()
    }

    /// Reports a frame of which nothing was used.
    pub(crate) fn reject_all(&mut self, z: &Measurements) {
        let (too_fast, turn_excluded) = (self.too_fast, self.turn_excluded);
        self.start(z);
        (self.too_fast, self.turn_excluded) = (too_fast, turn_excluded);
        self.bearings.fill(MeasurementOutcome::RejectedBatch);
        self.depths.fill(MeasurementOutcome::Unused);
        self.accepted = false;
    }
}

pub(crate) fn refill<T: Clone>(list: &mut Vec<T>, value: T, len: usize) {
    list.clear();
    list.resize(len, value);
}
