//! One frame's update (METHOD 7, steps 5-7): measurement blocks, their tests, the update, and the births that depth makes
//! possible.

mod first_view;
mod guessed_depth;
mod measurement;
mod validation;

use super::ekf::Filter;
use super::input::measurements::{MeasurementOutcome, Measurements, UpdateReport, refill};
use super::input::sources::{Scratch, WornForm};
use super::worn::other_time::TimeCompensated;
use crate::batch::Workspace;
use crate::error::EkfError;
use crate::math::pose::Pose;
use crate::math::quat::{self, Quat};
use crate::observe::{ATTITUDE, POSE_DIM};
use crate::settings::{Mode, WornErrors};
use nalgebra::{Matrix3, Vector3, Vector6};
use validation::Test;

impl Filter {
    /// Validates a frame's measurements, updates once, and starts the features that its matches allow.
    ///
    /// # Errors
    /// Bad input (`NonFinite`, `UnknownFeature`, `InvalidInput`), or measurements that would break the filter
    /// (`NotPositiveDefinite`, `Unsound`): the filter stays as it was.
    pub fn update(&mut self, z: &Measurements) -> Result<UpdateReport, EkfError> {
        let mut report = UpdateReport::default();
        self.update_into(z, &mut report)?;
        Ok(report)
    }

    /// As [`Self::update`], into a report that is reused: a warm filter allocates nothing then.
    ///
    /// # Errors
    /// As there; the report is then unspecified.
    pub fn update_into(
        &mut self,
        z: &Measurements,
        report: &mut UpdateReport,
    ) -> Result<(), EkfError> {
        // The lists go back whatever happens.
        let mut scratch = std::mem::take(&mut self.workspace.scratch);
        let done = self.update_with(z, report, &mut scratch);
        self.workspace.scratch = scratch;
        done
    }

    fn update_with(
        &mut self,
        z: &Measurements,
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) -> Result<(), EkfError> {
        self.check_measurements(z, scratch)?;
        let followed = z.followed.as_ref();
        scratch.shown = followed.and_then(|points| self.turn_from_checkpoint(points));
        let first = z.first_view().map(|worn| self.time_compensated(worn));
        let first = first.transpose()?.flatten();
        if first.is_none() && z.views.len() < 2 {
            return self.update_at_present(z, None, z, report, scratch);
        }
        let (views, compensated) = match first {
            Some(_) if self.is_measured_apart(z) => (Vec::new(), None),
            Some((here, compensated)) => (vec![here], Some(compensated)),
            None => (vec![z.views[0].clone()], None),
        };
        let together = Measurements { views, ..z.clone() };
        self.update_at_present(&together, compensated.as_ref(), z, report, scratch)
    }

    /// Whether a frame's view is measured after what Cs found, instead of together with it: it hangs on the velocity where the
    /// clock is uncertain, and the frame's own pixels tell that better than its prediction, which lags behind it.
    fn is_measured_apart(&self, z: &Measurements) -> bool {
        let clock = |who| self.memory.state.worn_clock_block(who).is_some();
        let tight = self.worn_form(z, false) == WornForm::Tight;
        let by_clock = z.first_view().is_some_and(|worn| clock(worn.who));
        self.memory.started && by_clock && tight && !z.bearings.is_empty()
    }

    /// The update with what is measured `together`, and then with the other views of `z`, one after another; `compensated` is how
    /// T_CF of the first view came here from another time.
    fn update_at_present(
        &mut self,
        together: &Measurements,
        compensated: Option<&TimeCompensated>,
        z: &Measurements,
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) -> Result<(), EkfError> {
        self.changes();
        self.fetch(z, &mut scratch.ids);
        let pairs = z.views.iter().flat_map(|worn| &worn.pairs);
        let out_of_view = self.follow_too(pairs.filter_map(|pair| pair.id));
        let done = self.measure_all(together, compensated, z, report, scratch);
        self.memory.followed.remove(&out_of_view);
        if done? {
            self.choose_working_set(&z.searched);
        }
        Ok(())
    }

    /// False if too little of the frame passes the tests.
    fn measure_all(
        &mut self,
        together: &Measurements,
        compensated: Option<&TimeCompensated>,
        z: &Measurements,
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) -> Result<bool, EkfError> {
        let mut used = Vec::new();
        if !self.measure_view(together, compensated, &mut used, report, scratch)? {
            report.reject_all(z);
            return Ok(false);
        }
        self.settle_odometry();
        self.measure_later(together, z, &mut used, report, scratch);
        if let Some(worn) = z.first_view() {
            report.worn_error = self.memory.state.worn_error(worn.who);
            report.worn_error_covariance = self.worn_covariance(worn);
            report.worn_error_of_map = self.worn_error_of_map(worn, compensated);
        }
        if self.memory.started {
            let poses = used
                .iter()
                .map(|(who, t_cf)| self.measured_worn_pose(*who, t_cf));
            report.worn_poses.extend(poses);
        }
        self.memory.state.end_worn_errors();
        Ok(true)
    }

    /// One batch: what Cs found and the first view, whose worn camera then joins those `used`. False, with the state
    /// unchanged, if too little of it passes the tests. The error of T_CF stays in the state until the frame ends.
    pub(super) fn measure_view(
        &mut self,
        z: &Measurements,
        compensated: Option<&TimeCompensated>,
        used: &mut Vec<(usize, Pose)>,
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) -> Result<bool, EkfError> {
        let form = self.worn_form(z, !used.is_empty());
        let told = self.told_by_first_view(z, compensated, form);
        self.measure_view_at(z, compensated, told, used, report, scratch)
    }

    /// The same, linearised at an error of the view's T_CF that is told.
    pub(super) fn measure_view_at(
        &mut self,
        z: &Measurements,
        compensated: Option<&TimeCompensated>,
        told: Option<Vector6<f64>>,
        used: &mut Vec<(usize, Pose)>,
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) -> Result<bool, EkfError> {
        let form = self.worn_form(z, !used.is_empty());
        let worn = z.first_view().filter(|_| form != WornForm::Unused);
        if let Some(worn) = worn {
            self.begin_overlap(worn);
        }
        let mark = self.memory.state.mark();
        if let Some(worn) = worn
            && (self.setup.settings.worn.errors == WornErrors::Shared
                || compensated.is_some()
                || !used.is_empty())
        {
            self.open_worn_error(worn, compensated);
            if let Some(told) = &told {
                self.linearise_at(told, worn.who);
            }
        }
        report.start(z);
        let newborn = match form {
            WornForm::Tight => self.start_tight_births(z, report),
            _ => Vec::new(),
        };
        scratch.learned.of.clear();
        self.learn_gyro_clock(&mut scratch.learned);
        let mut before = None;
        if let Some(worn) = worn {
            self.learn(worn, compensated, &mut scratch.learned);
            before = self.view_prior(worn, compensated);
            self.learn_clock(worn, compensated, before.as_ref(), &mut scratch.learned);
        }
        let measured = self.measure(z, form, &newborn, &Self::TESTS, report, scratch);
        self.workspace.told = None;
        if !matches!(measured, Ok(true)) {
            // Only blocks at the end were added.
            self.memory.take_back(&mark);
            return measured;
        }
        if let (Some(worn), Some(compensated), Some(before)) = (worn, compensated, &before) {
            self.count_for_clock(worn, compensated, before);
        }
        match form {
            WornForm::Tight => self.judge_tight_births(&newborn, z, report),
            WornForm::Points | WornForm::BirthsOnly => self.instant_births(z, report),
            WornForm::Unused => {}
        }
        self.depth_births(z, report);
        if let Some(worn) = worn {
            used.push((worn.who, worn.t_cf.clone()));
        }
        if let Some((worn, capture)) = z.first_view().and_then(|w| Some((w, w.capture?))) {
            self.memory.kept_poses.remember(worn.who, capture.t);
        }
        self.finish(z, report);
        if let Some(worn) = worn {
            self.go_on_overlapping(worn.who);
        }
        Ok(true)
    }

    /// How the view's pairs are measured; `again` if a view of another worn camera was measured in this frame before.
    fn worn_form(&self, z: &Measurements, again: bool) -> WornForm {
        let Some(worn) = z.first_view() else {
            return WornForm::Unused;
        };
        let shared = self.setup.settings.worn.errors == WornErrors::Shared;
        let earlier = worn
            .capture
            .is_some_and(|c| self.memory.time != Some(c.frame));
        match self.setup.settings.estimator.mode {
            // The pixels in Cs of an earlier frame were measured then, and those of this frame with the first view.
            mode if (earlier || again) && mode.uses_worn() => WornForm::Tight,
            // All modes start alike, from the best that the first overlap gives.
            _ if !self.memory.started && shared => WornForm::Tight,
            _ if !self.memory.started => WornForm::BirthsOnly,
            Mode::Mono | Mode::MonoUndelayed => WornForm::Unused,
            Mode::CollabInit => WornForm::BirthsOnly,
            Mode::CollabTight if shared => WornForm::Tight,
            Mode::Collab | Mode::CollabTight => WornForm::Points,
        }
    }

    /// False, with the state unchanged, if fewer than `min_inliers` bearings pass the tests, or the camera would move as it may
    /// not.
    pub(super) fn measure(
        &mut self,
        z: &Measurements,
        form: WornForm,
        newborn: &[(usize, u64)],
        tests: &[Test],
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) -> Result<bool, EkfError> {
        // A match whose 3D block is rejected falls back to its bearing (METHOD 6), in another round.
        let blocks = report.pairs().len() + report.depths.len();
        refill(&mut scratch.demoted, false, blocks);
        for last in [false, false, true] {
            self.collect_blocks(z, form, newborn, report, scratch);
            self.workspace.batch.build(&self.memory.state);
            let mut again = false;
            for test in tests {
                let outcome = test(self, report, &mut scratch.gone);
                again |= scratch.record(outcome, report);
                scratch.leave_out();
                self.workspace.batch.leave_out(&scratch.gone);
                // Asked after each test, so that a hopeless frame never reaches the costly ones.
                if report.inlier_count() < z.min_inliers {
                    return Ok(false);
                }
                if outcome == MeasurementOutcome::RejectedGate || !scratch.gone.is_empty() {
                    self.workspace.batch.factor()?;
                }
            }
            if last || !again {
                break;
            }
        }
        let carries = self.setup.carries() && self.workspace.batch.rows() > 0;
        let carried = carries && self.carry_to_told_depths()?;
        let done = self.use_batch(z, form, carries, report, scratch);
        if carried && !matches!(done, Ok(true)) {
            self.take_back_carried();
        }
        done
    }

    /// Updates with the rows that passed the tests. False, with the state unchanged, if the camera would move as it may not.
    fn use_batch(
        &mut self,
        z: &Measurements,
        form: WornForm,
        carries: bool,
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) -> Result<bool, EkfError> {
        if carries {
            let followed = self.memory.followed.ids();
            self.workspace.gauge.prepare(&self.memory.state, followed);
        }
        if form == WornForm::Tight {
            self.linearise_at_told_error(z, scratch)?;
        }
        report.nis = self.workspace.batch.nis();
        report.dof = self.workspace.batch.rows();
        let gauge = carries.then_some(&self.workspace.gauge);
        self.workspace.batch.solve(&self.memory.state, gauge)?;
        let excludes = |shown| Self::excludes_turn(shown, &self.attitude_after());
        report.too_fast = z.max_speed.is_some_and(|most| self.speed_after() > most);
        report.turn_excluded = scratch.shown.as_ref().is_some_and(excludes);
        if report.too_fast || report.turn_excluded {
            return Ok(false);
        }
        if report.dof > 0 {
            self.memory.moved_by = self.workspace.batch.moved_by();
            self.keep_readout_possible(&mut scratch.learned);
        }
        let scales = self.considered_scales();
        let followed = self.memory.followed.ids();
        let gauge = carries.then_some((&mut self.workspace.gauge, followed));
        self.workspace
            .batch
            .apply(&mut self.memory.state, gauge, &scratch.learned);
        self.take_back_told();
        self.keep_scales(scales);
        self.memory.nis.add(report.nis, report.dof);
        self.memory.state.normalise_quaternions();
        if carries {
            self.workspace.gauge.mark_carried(&mut self.memory.state);
        }
        Ok(true)
    }

    /// Attitude that the update at hand gives the camera.
    fn attitude_after(&self) -> Matrix3<f64> {
        let moved = Quat::from_fn(|i, _| self.workspace.batch.moved_at(ATTITUDE + i));
        let q = self.memory.state.part::<4>(ATTITUDE) + moved;
        quat::rotation(&(q / q.norm()))
    }

    /// Speed that the update at hand gives the camera, m/s.
    fn speed_after(&self) -> f64 {
        let moved = Vector3::from_fn(|i, _| self.workspace.batch.moved_at(POSE_DIM + i));
        (self.memory.state.velocity() + moved).norm()
    }

    pub(super) fn finish(&mut self, z: &Measurements, report: &mut UpdateReport) {
        let now = self.memory.time.unwrap_or(0.0);
        for id in &z.searched {
            if let Some(record) = self.memory.records.get_mut(id) {
                record.searched += 1;
            }
        }
        let found = z.bearings.iter().zip(report.inliers());
        for (bearing, _) in found.filter(|(_, accepted)| *accepted) {
            if let Some(record) = self.memory.records.get_mut(&bearing.id) {
                record.found += 1;
                record.last_found = now;
            }
        }
        if report.inlier_count() > 0 {
            self.memory.unused = 0;
        }
        // What Cf alone sees is in use, too.
        let pairs = z.pairs().iter().zip(report.pairs());
        for (pair, _) in pairs.filter(|(pair, is)| pair.uv.is_none() && is.is_accepted()) {
            if let Some(record) = pair.id.and_then(|id| self.memory.records.get_mut(&id)) {
                record.last_found = now;
            }
        }
        if self.memory.started {
            return;
        }
        let pairs = report.views.iter_mut().flatten();
        let outcomes = pairs.chain(&mut report.depths);
        let born: Vec<&mut MeasurementOutcome> = outcomes
            .filter(|o| matches!(o, MeasurementOutcome::Born(_)))
            .collect();
        if born.len() >= self.setup.settings.worn.start_births {
            self.start();
        } else {
            for outcome in born {
                *outcome = MeasurementOutcome::TooUncertain;
            }
            self.memory.state.remove(|b| b.kind.is_feature());
            self.memory.records.clear();
        }
    }

    /// Innovation, S and its factor for the bearings and known depths of a frame, without an update.
    ///
    /// # Errors
    /// As [`Self::update`]; the state stays as it is in any case.
    pub fn innovation(&mut self, z: &Measurements) -> Result<&Workspace, EkfError> {
        let mut scratch = Scratch::default();
        self.check_measurements(z, &mut scratch)?;
        self.changes();
        self.fetch(z, &mut scratch.ids);
        let mut report = UpdateReport::default();
        report.start(z);
        refill(
            &mut scratch.demoted,
            false,
            z.pairs().len() + z.depths.len(),
        );
        self.collect_blocks(z, WornForm::Unused, &[], &mut report, &mut scratch);
        self.workspace.batch.build(&self.memory.state);
        self.workspace.batch.factor()?;
        Ok(&self.workspace.batch)
    }
}
