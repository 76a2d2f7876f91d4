//! A lost camera found again: a pose from matches with the map and from nothing else.
//!
//! The camera's estimate is discarded: its rows of P are cut off from the map, which leaves the map's own marginal as it
//! was. The pose that the matches gave becomes the point of linearisation, with a prior so weak that it hardly matters; the
//! ordinary update with those matches (METHOD 7, 8) then gives pose, covariance and the correlation with the map, whose
//! uncertainty is part of S.
//!
//! The prior is [`WIDE`] times as wide as what the matches say, `C = (H_p^T S_f^-1 H_p)^-1`, with `H_p` the derivative by
//! the pose's tangent and `S_f = H_f P_ff H_f^T + R` the innovation covariance if the pose were known: so it is wide in
//! every direction, whatever the scale of the scene, and never so wide that digits are lost.
//!
//! Where walls repeat, matches may put the camera one door further on, and no residual tells. Prediction may: where it
//! excludes the pose, either is wrong and nothing tells which, so half the square of what lies between them joins
//! the covariance of the map's place in W.

use crate::chi2;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{Bearing, Measurements, UpdateReport, refill};
use crate::filter::input::sources::{Scratch, WornForm};
use crate::filter::map::carried_velocity::{correct_by_pose, difference};
use crate::guard::check_rigid;
use crate::math::pose::{Pose, tangent_map};
use crate::math::quat;
use crate::observe::POSE_DIM;
use crate::observe::point::CameraPose;
use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix};

/// Standard deviation of the prior over that of the matches: it takes part of one in [`WIDE`]^2 in the result.
const WIDE: f64 = 100.0;

/// Share of the image's width within which of its prediction a match is linear.
const NEAR: f64 = 0.05;

/// Standard deviation of a map's own bends about each axis, rad, against which a gyroscope's turn is held.
const BENDS: f64 = 0.02;

/// Largest condition number, after scaling by the diagonal, of what the matches say about the pose.
const MAX_CONDITION: f64 = 1e10;

/// Fewest matches that tell one pose.
pub const FEWEST_MATCHES: usize = 4;

impl Filter {
    /// Puts a lost camera where its matches with the map say, and discards its former estimate.
    ///
    /// `pose` is a first T_WC that explains `matches` to within the range of the linear model, as PnP with the
    /// landmarks' means gives it; it counts for nothing but as the point of linearisation. Velocities start anew from the
    /// settings' `process.start_*`, the speed from its second moment before where that is less. The matches pass the batch test;
    /// the pose is taken if `least` of them do, which is `lost.min_matches` unless given: [`UpdateReport::accepted`] says so.
    /// Otherwise the filter is as it was. Fewer do for points that say themselves which they are, as the corners of a printed
    /// tag. Such ones cannot be mistaken: where they are used and prediction does not exclude the pose, what lies between the
    /// two tells the velocities, as it does in any update.
    ///
    /// Where prediction excludes the pose and what is `predicted` counts for something, as it does not for such corners, either
    /// may be wrong, and half the square of what lies between them joins the covariance of the map's place in W.
    ///
    /// # Errors
    /// `NonFinite`, `UnknownFeature`, `InvalidInput` (before the start, an id given twice, no rotation matrix, a `least`
    /// below [`FEWEST_MATCHES`]); the filter stays as it was.
    pub fn relocalise(
        &mut self,
        pose: &Pose,
        matches: &[Bearing],
        least: Option<usize>,
        predicted: bool,
    ) -> Result<UpdateReport, EkfError> {
        self.memory.check_started()?;
        check_rigid("pose", pose)?;
        let identified = least.is_some();
        let least = least.unwrap_or(self.setup.settings.lost.min_matches);
        if least < FEWEST_MATCHES {
            return Err(EkfError::InvalidInput {
                what: "least",
                why: format!(
                    "{least} points may leave several poses; give {FEWEST_MATCHES} or more"
                ),
            });
        }
        let z = Measurements {
            searched: matches.iter().map(|b| b.id).collect(),
            bearings: matches.to_vec(),
            min_inliers: least,
            ..Measurements::default()
        };
        self.check_measurements(&z, &mut Scratch::default())?;
        let mut report = UpdateReport::default();
        if predicted && self.confirm(&z, &mut report) {
            return Ok(report);
        }
        for carried in [true, false].into_iter().skip(usize::from(!identified)) {
            let mut trial = self.clone();
            report.start(&z);
            // A covariance that cannot be factored says that these matches are no good, as a failed test does.
            if trial.put_at(pose, &z, [predicted, carried], &mut report) == Ok(true) {
                self.become_other(trial);
                return Ok(report);
            }
        }
        report.reject_all(&z);
        Ok(report)
    }

    /// The ordinary update with these matches, where they are as near to their prediction as that is linear and pass its tests:
    /// what the camera knew of its pose and its velocity was right, and stays. False, and the filter as it was, if not.
    fn confirm(&mut self, z: &Measurements, report: &mut UpdateReport) -> bool {
        let mut trial = self.clone();
        trial.make_whole();
        let mut scratch = Scratch::default();
        report.start(z);
        let measured = trial.measure(z, WornForm::Unused, &[], &Self::TESTS, report, &mut scratch);
        let near = NEAR * f64::from(self.setup.camera.width);
        let off = trial.workspace.batch.g().iter().map(|g| g.abs());
        let taken = matches!(measured, Ok(true)) && off.fold(0.0, f64::max) <= near;
        if taken {
            trial.finish(z, report);
            trial.choose_working_set(&z.searched);
            self.become_other(trial);
        }
        taken
    }

    fn put_at(
        &mut self,
        pose: &Pose,
        z: &Measurements,
        [predicted, carried]: [bool; 2],
        report: &mut UpdateReport,
    ) -> Result<bool, EkfError> {
        self.make_whole();
        // They are where the lost camera was believed to be.
        self.memory.forget_poses();
        let before = self.memory.clone_pose();
        let speed = self.memory.state.squared_speed();
        let pose = CameraPose {
            r: pose.translation,
            q: quat::from_rotation(&pose.rotation),
        };
        if carried {
            self.memory.state.reset_pose(&pose);
        } else {
            self.memory.state.reset_camera(&pose);
        }
        self.follow_view(&pose);
        let Some(prior) = self.prior_of_matches(&pose, z, report)? else {
            return Ok(false);
        };
        let lift = by_tangent(&pose);
        let prior = lift * prior * lift.transpose();
        self.memory
            .state
            .p
            .set_block(0, 0, &((prior + prior.transpose()) * 0.5));
        self.in_new_place();
        if !carried {
            self.start_velocities();
            for i in POSE_DIM..POSE_DIM + 3 {
                let known = self.memory.state.p.get(i, i).min(speed);
                self.memory.state.p.set(i, i, known);
            }
        }
        let mut scratch = Scratch::default();
        report.start(z);
        // The prior is weak on purpose, so the test of badly predicted pixels does not apply.
        let tests = &Self::TESTS[1..];
        self.workspace.found_again = true;
        let taken = self.measure(z, WornForm::Unused, &[], tests, report, &mut scratch);
        self.workspace.found_again = false;
        let taken = taken?;
        if taken {
            let at = self.memory.state.layout.find(before);
            let at = at.map(|block| block.offset);
            if carried && !at.is_some_and(|at| correct_by_pose(&mut self.memory.state, at)) {
                return Ok(false);
            }
            if !self.compare_with(before, predicted, report) {
                return Ok(false);
            }
            self.finish(z, report);
            self.choose_working_set(&z.searched);
        }
        Ok(taken)
    }

    /// Compares the camera's pose with that of a clone, which was predicted and is removed. Both hang on the same map, so what
    /// is not known of that does not count. False where a gyroscope has told how the camera turned since, and excludes it.
    fn compare_with(&mut self, before: u64, predicted: bool, report: &mut UpdateReport) -> bool {
        let state = &self.memory.state;
        let Some(at) = state.layout.find(before).map(|block| block.offset) else {
            return true;
        };
        let told = state.told();
        let p = |a: usize, b: usize| {
            let map = |at| tangent_map(&state.part::<4>(at + 3));
            map(a) * told.block::<POSE_DIM, POSE_DIM>(a, b) * map(b).transpose()
        };
        let poses =
            [0, at].map(|at| Pose::from_quat(state.part::<3>(at), &state.part::<4>(at + 3)));
        let covariances = [p(0, 0), p(at, at), p(0, at)];
        let turned_otherwise = self.is_turned_otherwise(&poses, at);
        self.memory.state.remove(|b| b.id == before);
        self.half_believe(&poses, &covariances, predicted, report);
        !(predicted && turned_otherwise)
    }

    /// Whether a gyroscope has told how the camera turned, and excludes how it was found turned against a clone of it at `at`, which was
    /// predicted. What a map drifts by is not in it: only its bends are.
    fn is_turned_otherwise(&self, [found, before]: &[Pose; 2], at: usize) -> bool {
        if self.memory.wheels.turned.is_none() {
            return false;
        }
        let state = &self.memory.state;
        let p = |a: usize, b: usize| {
            let map = |at| {
                tangent_map(&state.part::<4>(at + 3))
                    .fixed_rows::<3>(3)
                    .into_owned()
            };
            map(a) * state.p.block::<POSE_DIM, POSE_DIM>(a, b) * map(b).transpose()
        };
        // To first order: R dw_before - dw_found.
        let away = found.rotation.transpose() * before.rotation;
        let both = p(0, at) * away.transpose();
        let apart = p(0, 0) + away * p(at, at) * away.transpose() - both - both.transpose();
        let apart = (apart + apart.transpose()) * 0.5 + Matrix3::identity() * BENDS.powi(2);
        let turn = quat::log(&quat::from_rotation(&away));
        let distance = apart.cholesky().map(|c| turn.dot(&c.solve(&turn)));
        distance.is_some_and(|d| d > chi2::quantile(chi2::SURE_LEVEL, 3.0))
    }

    /// Whether prediction excludes where the camera was found; if that counts, the map's place is as uncertain then. It is a jump
    /// if even what both do not know of the map does not explain it. `covariances` are those of the pose found and of the one
    /// predicted, and of the first with the second, right tangents.
    pub(super) fn half_believe(
        &mut self,
        [found, before]: &[Pose; 2],
        [of_found, of_before, of_both]: &[Matrix6<f64>; 3],
        predicted: bool,
        report: &mut UpdateReport,
    ) {
        let (away, [here, there]) = difference(found, before);
        let both = -here * of_both * there.transpose();
        let apart = there * of_before * there.transpose() + here * of_found * here.transpose();
        let excludes = |covariance: Matrix6<f64>| {
            let distance = covariance.cholesky().map(|c| away.dot(&c.solve(&away)));
            distance.is_some_and(|d| d > chi2::quantile(chi2::SURE_LEVEL, 6.0))
        };
        report.jumped = excludes(apart);
        if excludes(apart - both - both.transpose()) && predicted {
            self.memory.map_frame = self.memory.map_frame.or_there(found, &away);
        }
    }

    /// [`WIDE`]^2 times the covariance of the pose's tangent that the matches give, the map's own included; `None` where
    /// they leave the pose open. The camera's rows of P must be zero.
    fn prior_of_matches(
        &mut self,
        pose: &CameraPose,
        z: &Measurements,
        report: &mut UpdateReport,
    ) -> Result<Option<Matrix6<f64>>, EkfError> {
        let mut scratch = Scratch::default();
        refill(&mut scratch.demoted, false, 0);
        self.collect_blocks(z, WornForm::Unused, &[], report, &mut scratch);
        if self.workspace.batch.blocks().len() < z.min_inliers {
            return Ok(None);
        }
        self.workspace.batch.build(&self.memory.state);
        self.workspace.batch.factor()?;
        let lift = by_tangent(pose);
        let m = self.workspace.batch.rows();
        let mut by_pose = DMatrix::<f64>::zeros(m, 6);
        let blocks = self.workspace.batch.blocks().iter();
        for (block, &at) in blocks.zip(self.workspace.batch.offsets()) {
            let rows = block.rows.by_pose * lift;
            for r in 0..block.rows.count {
                by_pose.set_row(at + r, &rows.row(r));
            }
        }
        let l = DMatrix::from_column_slice(m, m, self.workspace.batch.l());
        let Some(whitened) = l.solve_lower_triangular(&by_pose) else {
            return Ok(None);
        };
        let information: Matrix6<f64> = whitened.tr_mul(&whitened).fixed_view::<6, 6>(0, 0).into();
        Ok(inverse(&information).map(|c| c * (WIDE * WIDE)))
    }
}

/// Increment of `(r, q)` from the right tangent of the pose.
fn by_tangent(pose: &CameraPose) -> SMatrix<f64, 7, 6> {
    let mut lift = SMatrix::<f64, 7, 6>::zeros();
    lift.fixed_view_mut::<3, 3>(0, 0)
        .copy_from(&quat::rotation(&pose.q));
    lift.fixed_view_mut::<4, 3>(3, 3)
        .copy_from(&quat::lift(&pose.q));
    lift
}

/// Inverse of a symmetric matrix that is well conditioned once scaled by its diagonal.
fn inverse(information: &Matrix6<f64>) -> Option<Matrix6<f64>> {
    let scale = information.diagonal().map(|d| 1.0 / d.sqrt());
    if !scale.iter().all(|s| s.is_finite()) {
        return None;
    }
    let scale = Matrix6::from_diagonal(&scale);
    let scaled = scale * information * scale;
    let eigenvalues = scaled.symmetric_eigenvalues();
    if eigenvalues.min() * MAX_CONDITION < eigenvalues.max() {
        return None;
    }
    let inverse = scaled.cholesky()?.inverse();
    Some(scale * inverse * scale)
}
