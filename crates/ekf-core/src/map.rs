//! Upkeep of the map (METHOD 7, step 8) and the candidates of delayed births (METHOD 5). No matrices of P here.

use crate::birth::new_feature::{FirstPoseCovariance, NewFeature};
use crate::birth::two_view::TwoView;
use crate::error::EkfError;
use crate::filter::{Filter, sight};
use crate::frame::{Contradiction, check_once};
use crate::guard;
use crate::math::pose::Pose;
use crate::math::quat;
use crate::observe::point::CameraPose;
use crate::settings::FirstPose;
use crate::snapshot::bad;
use crate::state::{Block, BlockKind, Layout, LinearPart, POSE_DIM};
use nalgebra::{SMatrix, SVector, Vector2};
use serde::{Deserialize, Serialize};

/// How a feature has done so far.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct FeatureRecord {
    /// Frames in which it was searched.
    pub searched: usize,
    /// Frames in which an accepted match was found.
    pub found: usize,
    /// Time of the last accepted match, seconds.
    pub last_found: f64,
    /// How far it was off what the others say, in the last frames.
    pub contradiction: Contradiction,
}

/// A point that is tracked until its parallax allows a birth.
#[derive(Clone, Debug)]
pub struct Candidate {
    /// Pixel in the first view.
    pub uv: Vector2<f64>,
    /// Time of the first view, seconds.
    pub since: f64,
    first: FirstView,
}

#[derive(Clone, Debug)]
enum FirstView {
    /// The pose is a block of the state.
    Clone(u64),
    /// The pose and its covariance were noted.
    Noted(CameraPose, Box<SMatrix<f64, 7, 7>>),
}

/// A candidate in a snapshot.
#[derive(Serialize, Deserialize)]
pub(crate) struct CandidateImage {
    uv: [f64; 2],
    since: f64,
    /// The block of the first pose, or the pose and its covariance.
    first: Result<u64, Vec<f64>>,
}

impl Candidate {
    pub(crate) fn image(&self) -> CandidateImage {
        let Self { uv, since, first } = self;
        CandidateImage {
            uv: [uv.x, uv.y],
            since: *since,
            first: match first {
                FirstView::Clone(block) => Ok(*block),
                FirstView::Noted(CameraPose { r, q }, covariance) => {
                    let numbers = r.iter().chain(q.iter()).chain(covariance.iter());
                    Err(numbers.copied().collect())
                }
            },
        }
    }

    pub(crate) fn from_image(image: CandidateImage, layout: &Layout) -> Result<Self, EkfError> {
        let CandidateImage { uv, since, first } = image;
        let first = match first {
            Ok(id) => {
                let block = layout.find(id);
                if block.is_some_and(|block| block.kind != BlockKind::Clone) {
                    return Err(bad("a candidate's first pose is something else"));
                }
                FirstView::Clone(id)
            }
            Err(numbers) if numbers.len() == POSE_DIM + POSE_DIM * POSE_DIM => {
                if !numbers.iter().all(|v| v.is_finite()) {
                    return Err(bad("a candidate's first pose is not finite"));
                }
                let (pose, covariance) = numbers.split_at(POSE_DIM);
                let pose = CameraPose {
                    r: SVector::from_column_slice(&pose[..3]),
                    q: SVector::from_column_slice(&pose[3..]),
                };
                FirstView::Noted(pose, Box::new(SMatrix::from_column_slice(covariance)))
            }
            Err(_) => return Err(bad("a candidate's first pose has not 56 numbers")),
        };
        let uv = Vector2::from(uv);
        if !since.is_finite() || check_pixels(std::iter::once(&uv)).is_err() {
            return Err(bad("a candidate's pixel or time is impossible"));
        }
        Ok(Self { uv, since, first })
    }
}

/// What became of an observed candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CandidateOutcome {
    /// Born as this feature.
    Born(u64),
    /// Too little baseline or parallax yet: it waits.
    Waiting,
    /// The two rays contradict each other: it was dropped.
    Dropped,
}

impl Filter {
    /// Starts candidates at pixels of the present view; returns their ids.
    ///
    /// With `birth.first_pose = clone` the present pose joins the state once for all of them.
    ///
    /// # Errors
    /// `NonFinite` for a bad pixel, `InvalidInput` before the start.
    pub fn add_candidates(&mut self, pixels: &[Vector2<f64>]) -> Result<Vec<u64>, EkfError> {
        check_pixels(pixels.iter())?;
        self.check_started()?;
        if pixels.is_empty() {
            return Ok(Vec::new());
        }
        self.changes();
        let pose = self.state.camera_pose();
        let first = match self.settings.birth.first_pose {
            FirstPose::Clone => {
                let identity = SMatrix::<f64, 7, 7>::identity();
                let mean: SVector<f64, 7> = self.state.part::<7>(0);
                let part = LinearPart {
                    offset: 0,
                    width: POSE_DIM,
                    matrix: identity.as_slice(),
                };
                let noise = SMatrix::zeros();
                FirstView::Clone(
                    self.state
                        .append::<7>(BlockKind::Clone, &mean, &[part], &noise)
                        .id,
                )
            }
            FirstPose::Independent => {
                FirstView::Noted(pose, Box::new(self.state.p.block::<7, 7>(0, 0)))
            }
        };
        let since = self.time.unwrap_or(0.0);
        let ids = self.next_candidate..self.next_candidate + pixels.len() as u64;
        self.next_candidate = ids.end;
        for (id, &uv) in ids.clone().zip(pixels) {
            let first = first.clone();
            self.candidates.insert(id, Candidate { uv, since, first });
        }
        Ok(ids.collect())
    }

    /// Observes candidates in the present view; those with enough baseline and parallax are born (DI-D).
    ///
    /// # Errors
    /// `UnknownFeature` for an id that is not a candidate, `NonFinite` for a bad pixel, `InvalidInput` for an id given
    /// twice; nothing changes then.
    pub fn observe_candidates(
        &mut self,
        seen: &[(u64, Vector2<f64>)],
    ) -> Result<Vec<CandidateOutcome>, EkfError> {
        check_once(
            "candidates",
            seen.iter().map(|(id, _)| *id),
            &mut Vec::new(),
        )?;
        for (id, uv) in seen {
            check_pixels(std::iter::once(uv))?;
            if !self.candidates.contains_key(id) {
                return Err(EkfError::UnknownFeature { id: *id });
            }
        }
        self.changes();
        let outcomes = seen
            .iter()
            .map(|(id, uv)| {
                let outcome = self.try_delayed_birth(*id, uv);
                if outcome != CandidateOutcome::Waiting {
                    self.candidates.remove(id);
                }
                outcome
            })
            .collect();
        Ok(outcomes)
    }

    /// Pose of a candidate's first view, and where its uncertainty comes from; None without its clone.
    fn first_pose<'a>(
        &self,
        candidate: &'a Candidate,
    ) -> Option<(CameraPose, FirstPoseCovariance<'a>)> {
        match &candidate.first {
            FirstView::Clone(block) => {
                let offset = self.state.layout.find(*block)?.offset;
                let pose = self.state.pose_at(offset);
                Some((pose, FirstPoseCovariance::InState(offset)))
            }
            FirstView::Noted(pose, cov) => Some((*pose, FirstPoseCovariance::Independent(cov))),
        }
    }

    /// Candidates that shall wait for parallax no longer: each is born as an undelayed feature of its first view (METHOD 5),
    /// with the depth of `birth.vague_rho`, and is no candidate any more; None where that gives no feature.
    ///
    /// # Errors
    /// `UnknownFeature` for an id that is not a candidate, `InvalidInput` for one given twice; nothing changes then.
    pub fn promote_candidates(&mut self, ids: &[u64]) -> Result<Vec<Option<u64>>, EkfError> {
        check_once("candidates", ids.iter().copied(), &mut Vec::new())?;
        if let Some(&id) = ids.iter().find(|id| !self.candidates.contains_key(id)) {
            return Err(EkfError::UnknownFeature { id });
        }
        self.changes();
        let birth = &self.settings.birth;
        let (rho, sd) = (birth.vague_rho, birth.vague_rho_sd);
        let sigma = self.settings.pixel.sigma_cs;
        let mut born = Vec::with_capacity(ids.len());
        let mut view = None;
        for id in ids {
            let candidate = self.candidates.remove(id);
            let clone = candidate.as_ref().and_then(|c| match c.first {
                FirstView::Clone(block) => Some(block),
                FirstView::Noted(..) => None,
            });
            // Only features of one view share an anchor.
            if clone.is_none() || clone != view {
                self.state.camera_moved();
            }
            view = clone;
            born.push(candidate.and_then(|candidate| {
                let (first, covariance) = self.first_pose(&candidate)?;
                let uv = &candidate.uv;
                let mut new =
                    NewFeature::with_prior_depth(&self.camera, &first, uv, sigma, rho, sd)?;
                new.seen_from_first_pose(covariance);
                self.append_feature(&new).map(|block| block.id)
            }));
        }
        self.state.camera_moved();
        Ok(born)
    }

    fn try_delayed_birth(&mut self, id: u64, uv: &Vector2<f64>) -> CandidateOutcome {
        let candidate = &self.candidates[&id];
        let now = self.state.camera_pose();
        let Some((first, covariance)) = self.first_pose(candidate) else {
            return CandidateOutcome::Dropped;
        };
        let birth = &self.settings.birth;
        if (first.r - now.r).norm() < birth.min_baseline {
            return CandidateOutcome::Waiting;
        }
        let r_cw = quat::rotation(&now.q).transpose();
        let first_in_c = Pose {
            rotation: r_cw * quat::rotation(&first.q),
            translation: r_cw * (first.r - now.r),
        };
        let sigma = self.settings.pixel.sigma_cs;
        let Some(view) = TwoView::new(&self.camera, uv, &self.camera, &candidate.uv, &first_in_c)
        else {
            return CandidateOutcome::Waiting;
        };
        if view.parallax < birth.min_parallax.to_radians() {
            return CandidateOutcome::Waiting;
        }
        let normal = first_in_c
            .translation
            .cross(&(view.rotation * view.other_ray));
        let off_plane = view.ray.dot(&normal.normalize()).abs();
        // Four sigma of two pixels, and as much again for the poses.
        if off_plane > 8.0 * std::f64::consts::SQRT_2 * sigma / self.camera.fx {
            return CandidateOutcome::Dropped;
        }
        if view.rho_variance_from_pixels(sigma, sigma).sqrt() > birth.max_rho_ratio * view.rho {
            return CandidateOutcome::Waiting;
        }
        let mut new = NewFeature::from_two_views(&now, &view, sigma, sigma);
        new.depend_on_first_pose(&now, &first, &view, covariance);
        match self.append_feature(&new) {
            Some(block) => CandidateOutcome::Born(block.id),
            None => CandidateOutcome::Dropped,
        }
    }

    /// Starts features at first sight with the vague depth of `birth.undelayed_rho` (METHOD 5, undelayed).
    ///
    /// Before the start this is the scale-free start: the depth prior fixes an arbitrary scale.
    ///
    /// # Errors
    /// `NonFinite` for a bad pixel.
    pub fn add_undelayed(&mut self, pixels: &[Vector2<f64>]) -> Result<Vec<Option<u64>>, EkfError> {
        check_pixels(pixels.iter())?;
        self.changes();
        if !self.started && !pixels.is_empty() {
            self.start();
        }
        let pose = self.state.camera_pose();
        let birth = &self.settings.birth;
        let (rho, sd) = (birth.undelayed_rho, birth.undelayed_rho_sd);
        let sigma = self.settings.pixel.sigma_cs;
        Ok(pixels
            .iter()
            .map(|uv| {
                NewFeature::with_prior_depth(&self.camera, &pose, uv, sigma, rho, sd)
                    .and_then(|new| self.append_feature(&new).map(|block| block.id))
            })
            .collect())
    }

    /// Puts a newborn feature into the state, if its numbers are ones that the state may hold.
    pub(crate) fn append_feature(&mut self, new: &NewFeature) -> Option<Block> {
        if !guard::newborn_is_sane(new) {
            return None;
        }
        let mut parts = vec![LinearPart {
            offset: 0,
            width: POSE_DIM,
            matrix: new.by_pose.as_slice(),
        }];
        if let Some((offset, by, width)) = &new.by_other {
            parts.push(LinearPart {
                offset: *offset,
                width: *width,
                matrix: &by.as_slice()[..6 * width],
            });
        }
        let block = self.state.append_feature(&new.mean, &parts, &new.noise);
        if !guard::newborn_is_located(&self.state, &block) {
            self.state.remove(|b| b.id == block.id);
            return None;
        }
        let record = FeatureRecord {
            last_found: self.time.unwrap_or(0.0),
            ..FeatureRecord::default()
        };
        self.records.insert(block.id, record);
        self.gauge.follow(block.id);
        Some(block)
    }

    /// Ids of the candidates that wait, increasing.
    pub fn candidate_ids(&self) -> impl Iterator<Item = u64> {
        self.candidates.keys().copied()
    }

    /// Removes a candidate that was lost; unknown ids are ignored, since a birth removes its candidate too.
    pub fn drop_candidates(&mut self, ids: &[u64]) {
        for id in ids {
            self.candidates.remove(id);
        }
    }

    /// Removes features at once.
    ///
    /// # Errors
    /// `UnknownFeature`; nothing is removed then.
    pub fn remove_features(&mut self, ids: &[u64]) -> Result<(), EkfError> {
        for &id in ids {
            self.known(id)?;
        }
        self.remove_blocks(ids);
        Ok(())
    }

    pub(crate) fn remove_blocks(&mut self, ids: &[u64]) {
        self.changes();
        if let Some(far) = &mut self.far {
            far.remove(&mut self.state, |id| ids.contains(&id));
        }
        self.state.remove(|b| ids.contains(&b.id));
        for id in ids {
            self.records.remove(id);
        }
    }

    /// Deletes features that keep failing or whose depth went wrong, the longest unseen beyond
    /// `map.max_features`, candidates that are too old and clones that nobody needs. Makes points of features that have
    /// converged, with `map.linearity_index`. Returns the ids of deleted features.
    pub fn manage_map(&mut self) -> Vec<u64> {
        let map = &self.settings.map;
        let now = self.time.unwrap_or(0.0);
        let mut gone: Vec<u64> = Vec::new();
        let mut kept: Vec<(f64, u64)> = Vec::new();
        let near = self.state.layout.features();
        let near = near.map(|block| (*block, self.state.feature(block)));
        let mut features: Vec<_> = near.collect();
        if let Some(far) = &self.far {
            features.extend(far.means(&self.state));
            features.sort_unstable_by_key(|(block, _)| block.id);
        }
        for (block, feature) in features {
            let record = &self.records[&block.id];
            let failing = record.searched >= map.min_searches
                && (record.found as f64) < map.min_found_share * record.searched as f64;
            if failing || feature.point().is_none() {
                gone.push(block.id);
            } else {
                kept.push((record.last_found, block.id));
            }
        }
        if kept.len() > map.max_features {
            kept.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
            let excess = kept.len() - map.max_features;
            gone.extend(kept[..excess].iter().map(|(_, id)| *id));
        }
        let age = map.candidate_age;
        self.candidates.retain(|_, c| now - c.since <= age);
        let mut needed: Vec<u64> = self
            .candidates
            .values()
            .filter_map(|c| match c.first {
                FirstView::Clone(id) => Some(id),
                FirstView::Noted(..) => None,
            })
            .collect();
        needed.dedup();
        self.changes();
        if let Some(far) = &mut self.far {
            far.remove(&mut self.state, |id| gone.contains(&id));
        }
        self.state.remove(|b| match b.kind {
            BlockKind::Feature(_) => gone.contains(&b.id),
            BlockKind::Clone => !needed.contains(&b.id),
            BlockKind::WornBias | BlockKind::WornError | BlockKind::Dual(_) => false,
        });
        for id in &gone {
            self.records.remove(id);
        }
        self.shrink_converged();
        gone
    }

    /// Makes points of the features in view whose depth has converged, with `map.linearity_index`.
    fn shrink_converged(&mut self) {
        let largest = self.settings.map.linearity_index;
        if largest == 0.0 {
            return;
        }
        let (state, pose) = (&self.state, self.state.camera_pose());
        let seen = sight(&self.camera, &pose);
        let has_converged = |block: &Block| {
            let (feature, (_, own)) = (state.feature(block), state.feature_covariance(block));
            let index = feature.linearity_index(&own, &pose.r);
            index.is_some_and(|index| index < largest)
                && feature.point().is_some_and(|point| seen(&point, 0.0))
        };
        // What the gauge follows has its direction at the present mean.
        let blocks = state.layout.features();
        let blocks = blocks.filter(|b| !self.carries() || self.gauge.follows(b.id));
        let mut ids: Vec<u64> = blocks.filter(|b| has_converged(b)).map(|b| b.id).collect();
        if ids.is_empty() {
            return;
        }
        ids.sort_unstable();
        if let Some(far) = &mut self.far {
            far.fetch_twins(&mut self.state, |id| ids.binary_search(&id).is_ok());
        }
        self.state.shrink(&ids);
    }

    pub(crate) fn feature_block(&self, id: u64) -> Result<Block, EkfError> {
        match self.state.layout.find(id) {
            Some(block) if block.kind.is_feature() => Ok(*block),
            _ => Err(EkfError::UnknownFeature { id }),
        }
    }

    pub(crate) fn check_started(&self) -> Result<(), EkfError> {
        if self.started {
            return Ok(());
        }
        Err(EkfError::InvalidInput {
            what: "filter",
            why: "it has not started; give it a worn camera's overlap, known points or undelayed \
                  features first"
                .into(),
        })
    }
}

pub(crate) fn check_pixels<'a>(
    mut pixels: impl Iterator<Item = &'a Vector2<f64>>,
) -> Result<(), EkfError> {
    pixels.try_for_each(guard::pixel)
}
