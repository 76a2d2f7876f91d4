//! Births from the camera alone: candidates that wait for parallax, and undelayed births (METHOD 5).

use crate::birth::at_rest::Leaving;
use crate::birth::held::{Held, held};
use crate::birth::new_feature::{FirstPoseCovariance, NewFeature};
use crate::birth::two_view::TwoView;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::memory::candidate::{Candidate, CandidateOutcome, FirstView, RememberedPose};
use crate::guard::{check_once, check_pixels};
use crate::math::pose::Pose;
use crate::math::quat;
use crate::observe::point::CameraPose;
use crate::observe::shutter::MOTION_DIM;
use crate::settings::FirstPose;
use nalgebra::{SMatrix, Vector2};

/// Offset of the readout, and derivative of a pixel by it.
type ByReadout = Option<(usize, Vector2<f64>)>;

impl Filter {
    /// Starts candidates at pixels of the present view; returns their ids.
    ///
    /// With `birth.first_pose = clone` the present pose joins the state once for all of them.
    ///
    /// # Errors
    /// `NonFinite` for a bad pixel, `InvalidInput` before the start.
    pub fn add_candidates(&mut self, pixels: &[Vector2<f64>]) -> Result<Vec<u64>, EkfError> {
        check_pixels(pixels.iter())?;
        self.memory.check_started()?;
        if pixels.is_empty() {
            return Ok(Vec::new());
        }
        self.changes();
        let pose = self.memory.state.camera_pose();
        let first = match self.setup.settings.birth.first_pose {
            FirstPose::Clone => FirstView::Clone(self.memory.clone_pose()),
            FirstPose::Independent => {
                let covariance = self.memory.state.p.block::<7, 7>(0, 0);
                FirstView::Remembered(Box::new(RememberedPose { pose, covariance }))
            }
        };
        let since = self.memory.time.unwrap_or(0.0);
        let ids = self.memory.next_candidate..self.memory.next_candidate + pixels.len() as u64;
        self.memory.next_candidate = ids.end;
        for (id, &uv) in ids.clone().zip(pixels) {
            let (first, roll) = (first.clone(), self.roll(&uv));
            let candidate = Candidate {
                uv,
                roll,
                since,
                first,
            };
            self.memory.candidates.insert(id, candidate);
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
            if !self.memory.candidates.contains_key(id) {
                return Err(EkfError::UnknownFeature { id: *id });
            }
        }
        self.changes();
        let outcomes = seen
            .iter()
            .map(|(id, uv)| {
                let stands = self.stands(*id, uv);
                let outcome = match self.try_delayed_birth(*id, uv) {
                    CandidateOutcome::Waiting if stands => CandidateOutcome::Held,
                    other => other,
                };
                if !outcome.waits() {
                    self.memory.candidates.remove(id);
                }
                outcome
            })
            .collect();
        Ok(outcomes)
    }

    fn try_delayed_birth(&mut self, id: u64, seen: &Vector2<f64>) -> CandidateOutcome {
        let candidate = &self.memory.candidates[&id];
        let now = self.memory.state.camera_pose();
        let Some((first, covariance)) = self.first_pose(candidate) else {
            return CandidateOutcome::Dropped;
        };
        let birth = &self.setup.settings.birth;
        let r_cw = quat::rotation(&now.q).transpose();
        let first_in_c = Pose {
            rotation: r_cw * quat::rotation(&first.q),
            translation: r_cw * (first.r - now.r),
        };
        let sigma = self.setup.settings.pixel.sigma_cs;
        // Four sigma of two pixels, and as much again, at least, for the poses.
        let pixels = 4.0 * std::f64::consts::SQRT_2 * sigma / self.setup.camera.fx;
        let gate = 2.0 * pixels;
        let has_baseline = (first.r - now.r).norm() >= birth.min_baseline;
        match held(
            &self.setup.camera,
            seen,
            &candidate.uv,
            &first_in_c,
            sigma,
            gate,
        ) {
            Some(Held::RigFixed) if has_baseline => return CandidateOutcome::Fixed,
            Some(_) => return CandidateOutcome::Held,
            None if !has_baseline => return CandidateOutcome::Waiting,
            None => {}
        }
        let camera = &self.setup.camera;
        let intersect = |uv: &Vector2<f64>, first_uv: &Vector2<f64>| {
            TwoView::new(camera, uv, camera, first_uv, &first_in_c)
        };
        // How far it is says how much the shutter has moved it; rays that do not meet are those of a far point, if any.
        let rho = intersect(seen, &candidate.uv).map_or(0.0, |raw| raw.rho);
        let unrolled = self.unrolled(seen, rho);
        let uv = unrolled.uv;
        let (first_uv, first_by_readout) = self.first_pixel(candidate, rho);
        // What moves by itself may have no parallax, or a negative one, for as long as it likes.
        let by_readout = unrolled.by_motion.map(|(at, by)| {
            let by_readout = by.column(MOTION_DIM - 1).into_owned();
            (at, by_readout)
        });
        let [roll, first_roll] = [by_readout, first_by_readout].map(|by| self.readout_sd(by));
        let leaving_at = |sds: f64| {
            let ray = camera.unproject(&(uv + roll * sds))?;
            let first_ray = camera.unproject(&(first_uv + first_roll * sds))?;
            Some(Leaving::new(&ray, &first_ray, &now, &first))
        };
        let Some((leaving, rolled)) = leaving_at(0.0).zip(leaving_at(1.0)) else {
            return CandidateOutcome::Waiting;
        };
        let by_poses = self.sd_by_poses(&leaving, &covariance);
        let sd = by_poses.hypot(rolled.angle - leaving.angle);
        let allowed = pixels + pixels.max(4.0 * sd);
        if leaving.angle > allowed {
            return CandidateOutcome::OffArc(leaving.angle / allowed);
        }
        // Once more with the range that the pixels have without the rolling.
        let found = intersect(&uv, &first_uv).and_then(|view| {
            let unrolled = self.unrolled(seen, view.rho);
            let (first_uv, first_by_readout) = self.first_pixel(candidate, view.rho);
            let view = intersect(&unrolled.uv, &first_uv)?;
            Some((view, unrolled, first_uv, first_by_readout))
        });
        let Some((view, unrolled, first_uv, first_by_readout)) = found else {
            return CandidateOutcome::Waiting;
        };
        if view.parallax < birth.min_parallax.to_radians() {
            return CandidateOutcome::Waiting;
        }
        if view.rho_variance_from_pixels(sigma, sigma).sqrt() > birth.max_rho_ratio * view.rho {
            return CandidateOutcome::Waiting;
        }
        let [warp, first_warp] =
            [&unrolled.uv, &first_uv].map(|uv| self.setup.camera.warp_jacobian(uv));
        let mut new = NewFeature::from_two_views(&now, &view, &warp, (sigma, sigma));
        new.share_calibration(&view, &first_warp);
        new.share_motion(&unrolled);
        let mut by_first_pixel = SMatrix::<f64, 6, 2>::zeros();
        by_first_pixel.set_row(5, &view.rho_by_other_pixel);
        new.share_readout(&by_first_pixel, first_by_readout);
        new.depend_on_first_pose(&now, &first, &view, covariance);
        new.follow_own_range(&unrolled);
        match self.append_feature(&new) {
            Some(block) => CandidateOutcome::Born(block.id),
            None => CandidateOutcome::Dropped,
        }
    }

    /// Whether the image has a candidate where it was first seen, within four sigma of two pixels.
    fn stands(&self, id: u64, uv: &Vector2<f64>) -> bool {
        let noise = 4.0 * std::f64::consts::SQRT_2 * self.setup.settings.pixel.sigma_cs;
        self.memory
            .candidates
            .get(&id)
            .is_some_and(|candidate| (uv - candidate.uv).norm() <= noise)
    }

    /// Standard deviation, rad, of where a point at rest can be seen, by the poses of now and of its first view.
    fn sd_by_poses(&self, leaving: &Leaving, first: &FirstPoseCovariance<'_>) -> f64 {
        let p = &self.memory.state.p;
        match *first {
            FirstPoseCovariance::InState(at) => {
                leaving.sd(&p.block(0, 0), &p.block(0, at), &p.block(at, at))
            }
            FirstPoseCovariance::Independent(own) => {
                leaving.sd(&p.block(0, 0), &SMatrix::zeros(), own)
            }
        }
    }

    /// By how much one standard deviation of the readout, as it is stated, moves a pixel: what is left of it once the filter knows
    /// more is a claim that the velocities do not bear, and a candidate that strays does not come back.
    fn readout_sd(&self, by_readout: ByReadout) -> Vector2<f64> {
        by_readout.map_or(Vector2::zeros(), |(_, by)| {
            by * self.setup.settings.calibration.readout_sd
        })
    }

    /// A candidate's first pixel without the shutter's rolling. It depends on the readout alone: the ways that its point's range
    /// and the velocity of then tell of are of one scale, whatever that is.
    pub(super) fn first_pixel(&self, candidate: &Candidate, rho: f64) -> (Vector2<f64>, ByReadout) {
        let Some(shutter) = self.shutter() else {
            return (candidate.uv, None);
        };
        let (uv, by_readout) = candidate.unrolled(shutter.readout, rho);
        (uv, Some((shutter.offset, by_readout)))
    }

    /// Pose of a candidate's first view, and where its uncertainty comes from; None without its clone.
    pub(super) fn first_pose<'a>(
        &self,
        candidate: &'a Candidate,
    ) -> Option<(CameraPose, FirstPoseCovariance<'a>)> {
        match &candidate.first {
            FirstView::Clone(block) => {
                let offset = self.memory.state.layout.find(*block)?.offset;
                let pose = self.memory.state.pose_at(offset);
                Some((pose, FirstPoseCovariance::InState(offset)))
            }
            FirstView::Remembered(first) => {
                let covariance = FirstPoseCovariance::Independent(&first.covariance);
                Some((first.pose, covariance))
            }
        }
    }

    /// Starts features in the view in which they are first seen, with the weak prior of `birth.undelayed_rho` on their
    /// inverse depth (METHOD 5, undelayed).
    ///
    /// Before the start it starts the filter: the prior fixes an arbitrary scale. While the camera has hardly moved this is
    /// linearised where a turn and a step to the side look alike; [`Self::start_from_views`] is not.
    ///
    /// # Errors
    /// `NonFinite` for a bad pixel.
    pub fn add_undelayed(&mut self, pixels: &[Vector2<f64>]) -> Result<Vec<Option<u64>>, EkfError> {
        check_pixels(pixels.iter())?;
        self.changes();
        if !self.memory.started && !pixels.is_empty() {
            self.start();
        }
        let pose = self.memory.state.camera_pose();
        let birth = &self.setup.settings.birth;
        let (rho, sd) = (birth.undelayed_rho, birth.undelayed_rho_sd);
        let sigma = self.setup.settings.pixel.sigma_cs;
        Ok(pixels
            .iter()
            .map(|uv| {
                let unrolled = self.unrolled(uv, rho);
                let (camera, uv) = (&self.setup.camera, &unrolled.uv);
                let mut new = NewFeature::with_prior_depth(camera, &pose, uv, sigma, rho, sd)?;
                new.share_motion(&unrolled);
                new.follow_own_range(&unrolled);
                self.append_feature(&new).map(|block| block.id)
            })
            .collect())
    }

    /// Ids of the waiting candidates, increasing.
    pub fn candidate_ids(&self) -> impl Iterator<Item = u64> {
        self.memory.candidates.keys().copied()
    }

    /// Removes a candidate that was lost; unknown ids are ignored, since a birth removes its candidate too.
    pub fn drop_candidates(&mut self, ids: &[u64]) {
        for id in ids {
            self.memory.candidates.remove(id);
        }
    }
}
