//! One frame's measurements (METHOD 7, steps 5-7): which rows each match gives in which mode, the batch test,
//! the update, and the births that the worn camera makes possible.

mod births;
mod given;
mod lasting;
mod relocalise;
mod units;

use crate::batch::Workspace;
use crate::error::EkfError;
use crate::filter::Filter;
use crate::guard;
use crate::map::check_pixels;
use crate::math::pose::Pose;
use crate::settings::{BatchTestKind, Mode, WornErrors};
use crate::state::{BlockKind, Mark, POSE_DIM};
use crate::validate::{self, BatchTest};

use nalgebra::{DMatrix, Matrix3, Matrix6, SMatrix, Vector2, Vector6};
use units::Source;

pub use given::Expectation;
pub use lasting::Contradiction;
pub(crate) use lasting::Contradictions;

/// A feature found in Cs.
#[derive(Clone, Copy, Debug)]
pub struct Bearing {
    /// Id of the feature.
    pub id: u64,
    /// Its pixel in Cs.
    pub uv: Vector2<f64>,
}

/// A point seen by both cameras.
#[derive(Clone, Copy, Debug)]
pub struct WornPair {
    /// The feature it is, or `None` for a new point.
    pub id: Option<u64>,
    /// Its pixel in Cs.
    pub uv: Vector2<f64>,
    /// Its pixel in Cf.
    pub uv_f: Vector2<f64>,
}

/// What the worn camera contributes to a frame.
#[derive(Clone, Debug)]
pub struct WornObservation {
    /// Measured T_CF: maps points of F into C.
    pub t_cf: Pose,
    /// 6x6 covariance of its error, (translation, rotation), right tangent.
    pub covariance: Matrix6<f64>,
    /// The part of that covariance that lasts from frame to frame; `worn.bias_share` of it if `None`.
    pub bias: Option<Matrix6<f64>>,
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

/// All measurements of one frame.
#[derive(Clone, Debug, Default)]
pub struct Measurements {
    /// Features that were looked for, found or not.
    pub searched: Vec<u64>,
    /// Features found in Cs.
    pub bearings: Vec<Bearing>,
    /// The worn camera's part.
    pub worn: Option<WornObservation>,
    /// Other depths.
    pub depths: Vec<DepthObservation>,
    /// Fewest accepted bearings with which the frame is believed: with fewer nothing of it is used.
    pub least: usize,
}

/// What became of one measurement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Outcome {
    /// Accepted as two pixel rows.
    Pixel,
    /// Accepted as three metric rows.
    Depth,
    /// Its feature was measured by a better form of the same match.
    Replaced,
    /// Not accurate enough to be worth more than its bearing; of a pixel: predicted no better than somewhere in the image.
    TooUncertain,
    /// The rays do not meet in front of both cameras, or the feature predicts nothing.
    NotVisible,
    /// Failed its own chi-square gate.
    RejectedGate,
    /// Rejected by the batch test.
    RejectedBatch,
    /// Contradicted by the other accepted matches.
    RejectedConditional,
    /// A new feature with this id.
    Born(u64),
    /// Not used in this mode.
    Unused,
    /// Refused with the whole frame: the update would have broken the filter.
    Refused,
}

/// What one update did.
#[derive(Clone, Debug, Default)]
pub struct UpdateReport {
    /// One per bearing.
    pub bearings: Vec<Outcome>,
    /// One per worn pair.
    pub pairs: Vec<Outcome>,
    /// One per depth.
    pub depths: Vec<Outcome>,
    /// Normalised innovation squared of the accepted batch.
    pub nis: f64,
    /// Its degrees of freedom.
    pub dof: usize,
    /// Number of matches the batch test left out.
    pub order: usize,
    /// Whether the batch test finished its exact search.
    pub exact: bool,
    /// Number of linearisations of the update.
    pub iterations: usize,
    /// Estimated error of T_CF after the update, tangent (m, rad).
    pub worn_error: Vector6<f64>,
    /// Why the frame was refused, if it was: the filter is as it was before.
    pub refused: Option<EkfError>,
    /// Whether [`Measurements::least`] bearings were accepted; otherwise nothing of the frame was used.
    pub believed: bool,
}

impl UpdateReport {
    /// What there is to say of measurements that [`Filter::update`] answered with `NotPositiveDefinite` or `Unsound`.
    pub fn refused(z: &Measurements, error: EkfError) -> Self {
        let mut report = Self::default();
        report.start(z);
        for list in [&mut report.bearings, &mut report.pairs, &mut report.depths] {
            list.fill(Outcome::Refused);
        }
        report.refused = Some(error);
        report.believed = false;
        report
    }

    /// As before anything is done with the measurements; the lists keep their room.
    fn start(&mut self, z: &Measurements) {
        let lists = [&mut self.bearings, &mut self.pairs, &mut self.depths].map(std::mem::take);
        let [mut bearings, mut pairs, mut depths] = lists;
        refill(&mut bearings, Outcome::NotVisible, z.bearings.len());
        refill(&mut pairs, Outcome::Unused, z.pairs().len());
        refill(&mut depths, Outcome::NotVisible, z.depths.len());
        *self = Self {
            bearings,
            pairs,
            depths,
            exact: true,
            iterations: 1,
            believed: true,
            ..Self::default()
        };
    }
}

impl Measurements {
    /// The worn camera's pairs, if it contributes.
    fn pairs(&self) -> &[WornPair] {
        self.worn.as_ref().map_or(&[], |worn| &worn.pairs)
    }
}

fn refill<T: Clone>(list: &mut Vec<T>, value: T, len: usize) {
    list.clear();
    list.resize(len, value);
}

/// Finds units of the batch that are to go, and says what to call them.
type Test = fn(&mut Filter, &mut UpdateReport, &mut Vec<usize>) -> Outcome;

/// Lists of an update; they only grow, so that a warm step allocates nothing.
#[derive(Debug, Default)]
pub(crate) struct Scratch {
    /// Where each unit of the batch comes from.
    sources: Vec<Source>,
    wanted: Vec<Source>,
    with_depth: Vec<u64>,
    /// 3D blocks that were rejected and fall back to their bearing.
    demoted: Vec<bool>,
    /// Units that a test rejected.
    gone: Vec<usize>,
    ids: Vec<u64>,
}

impl Clone for Scratch {
    /// Nothing is carried over: a copy starts empty.
    fn clone(&self) -> Self {
        Self::default()
    }
}

/// How the worn camera's pairs are measured in this frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum WornForm {
    Unused,
    BirthsOnly,
    Points,
    Tight,
}

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

    /// As [`Self::update`], into a report of before: a warm filter allocates nothing then.
    ///
    /// # Errors
    /// As there; what the report says is left open.
    pub fn update_into(
        &mut self,
        z: &Measurements,
        report: &mut UpdateReport,
    ) -> Result<(), EkfError> {
        // The lists go back whatever happens.
        let mut scratch = std::mem::take(&mut self.scratch);
        let done = self.update_with(z, report, &mut scratch);
        self.scratch = scratch;
        done
    }

    fn update_with(
        &mut self,
        z: &Measurements,
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) -> Result<(), EkfError> {
        self.check_measurements(z, scratch)?;
        self.changes();
        self.fetch(z, &mut scratch.ids);
        let mark = self.state.mark();
        let form = self.worn_form(z);
        let worn = z.worn.as_ref().filter(|_| form != WornForm::Unused);
        if let Some(worn) = worn
            && self.settings.worn.errors == WornErrors::Shared
        {
            self.open_worn_error(worn);
        }
        report.start(z);
        let newborn = match form {
            WornForm::Tight => self.start_tight_births(z, report),
            _ => Vec::new(),
        };
        let measured = self.measure(z, form, &newborn, &Self::TESTS, report, scratch);
        if !matches!(measured, Ok(true)) {
            // Only blocks at the end were added.
            self.take_back(&mark);
            report.reject_all(z);
            return measured.map(|_| ());
        }
        match form {
            WornForm::Tight => self.settle_tight_births(&newborn, report),
            WornForm::Points | WornForm::BirthsOnly => self.instant_births(z, report),
            WornForm::Unused => {}
        }
        self.depth_births(z, report);
        report.worn_error = self.state.worn_error();
        self.state.remove(|b| b.kind == BlockKind::WornError);
        self.finish(z, report);
        self.choose_working_set(&z.searched);
        Ok(())
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
        self.collect_units(z, WornForm::Unused, &[], &mut report, &mut scratch);
        self.batch.build(&self.state);
        self.batch.factor()?;
        Ok(&self.batch)
    }

    /// Takes away what was appended since `mark`.
    pub(crate) fn take_back(&mut self, mark: &Mark) {
        self.state.take_back(mark);
        self.gauge.forget_from(self.state.layout.next_id());
        let (state, far) = (&self.state, &self.far);
        self.records.retain(|&id, _| {
            state.layout.find(id).is_some() || far.as_ref().is_some_and(|far| far.has(id))
        });
    }

    /// Brings what is measured or was looked for into the working set of the local update.
    fn fetch(&mut self, z: &Measurements, ids: &mut Vec<u64>) {
        let Some(far) = &mut self.far else { return };
        ids.clear();
        ids.extend(z.bearings.iter().map(|b| b.id));
        ids.extend(z.pairs().iter().filter_map(|p| p.id));
        ids.extend(z.depths.iter().filter_map(|d| d.id));
        ids.sort_unstable();
        far.enter(&mut self.state, |id| ids.binary_search(&id).is_ok());
    }

    fn check_measurements(&self, z: &Measurements, scratch: &mut Scratch) -> Result<(), EkfError> {
        let pairs = z.pairs();
        let pixels = z.bearings.iter().map(|b| &b.uv);
        let pixels = pixels.chain(pairs.iter().flat_map(|p| [&p.uv, &p.uv_f]));
        check_pixels(pixels.chain(z.depths.iter().map(|d| &d.uv)))?;
        let bearings = || z.bearings.iter().map(|b| b.id);
        let depths = z.depths.iter().filter_map(|d| d.id);
        let others = || pairs.iter().filter_map(|p| p.id).chain(depths.clone());
        for id in bearings().chain(others()).chain(z.searched.iter().copied()) {
            self.known(id)?;
        }
        check_once("bearings", bearings(), &mut scratch.ids)?;
        check_once("worn pairs and depths", others(), &mut scratch.ids)?;
        for depth in &z.depths {
            guard::depth(depth.depth, depth.sigma)?;
        }
        if let Some(worn) = &z.worn {
            self.check_worn(&worn.t_cf, &worn.covariance, worn.bias.as_ref())?;
        }
        Ok(())
    }

    fn worn_form(&self, z: &Measurements) -> WornForm {
        if z.worn.is_none() {
            return WornForm::Unused;
        }
        let shared = self.settings.worn.errors == WornErrors::Shared;
        match self.settings.estimator.mode {
            // All modes start alike, from the best that the first overlap gives.
            _ if !self.started && shared => WornForm::Tight,
            _ if !self.started => WornForm::BirthsOnly,
            Mode::Mono | Mode::MonoUndelayed => WornForm::Unused,
            Mode::CollabInit => WornForm::BirthsOnly,
            Mode::CollabTight if shared => WornForm::Tight,
            Mode::Collab | Mode::CollabTight => WornForm::Points,
        }
    }

    /// What the matches must stand, in this order.
    pub(super) const TESTS: [Test; 4] = [
        Self::vague,
        Self::gated,
        Self::batch_test,
        Self::contradicted,
    ];

    /// False, and nothing is changed, if too few matches are accepted for the frame to be believed.
    fn measure(
        &mut self,
        z: &Measurements,
        form: WornForm,
        newborn: &[(usize, u64)],
        tests: &[Test],
        report: &mut UpdateReport,
        scratch: &mut Scratch,
    ) -> Result<bool, EkfError> {
        // A match whose 3D block is rejected falls back to its bearing (METHOD 6), in another round.
        let blocks = report.pairs.len() + report.depths.len();
        refill(&mut scratch.demoted, false, blocks);
        for last in [false, false, true] {
            self.collect_units(z, form, newborn, report, scratch);
            self.batch.build(&self.state);
            let mut again = false;
            for test in tests {
                let outcome = test(self, report, &mut scratch.gone);
                again |= scratch.note(outcome, report);
                scratch.leave_out();
                self.batch.leave_out(&scratch.gone);
                // Sooner than the costly tests can tell, and no later than they do.
                if report.located_by() < z.least {
                    return Ok(false);
                }
                if outcome == Outcome::RejectedGate || !scratch.gone.is_empty() {
                    self.batch.factor()?;
                }
            }
            if last || !again {
                break;
            }
        }
        report.nis = self.batch.nis();
        report.dof = self.batch.rows();
        self.iterate(z, &scratch.sources, report)?;
        let carries = self.carries() && report.dof > 0;
        self.batch
            .solve(&self.state, carries.then_some(&mut self.gauge))?;
        let gauge = carries.then_some(&mut self.gauge);
        self.batch.apply(&mut self.state, gauge);
        self.misfit.note(report.nis, report.dof);
        self.note_contradictions();
        self.state.normalise_quaternions();
        if carries {
            self.gauge.settle(&mut self.state);
        }
        Ok(true)
    }

    fn iterate(
        &mut self,
        z: &Measurements,
        sources: &[Source],
        report: &mut UpdateReport,
    ) -> Result<(), EkfError> {
        let prior = self.state.part::<POSE_DIM>(0);
        for iteration in 1..self.settings.estimator.iterations {
            let step = self.batch.pose_step();
            let mut fresh = self.batch.take_fresh();
            self.state.set_part(0, &(prior + step));
            fresh.extend(sources.iter().map_while(|s| self.unit(z, *s).ok()));
            self.state.set_part(0, &prior);
            let tolerance = self.settings.estimator.nonlinearity;
            if !self.batch.relinearise(fresh, &step, tolerance) {
                break;
            }
            report.iterations = iteration + 1;
            self.batch.build(&self.state);
            self.batch.factor()?;
        }
        Ok(())
    }

    /// Matches whose pixel was predicted no better than somewhere in the image, or beyond: no linearisation holds there.
    fn vague(&mut self, _: &mut UpdateReport, gone: &mut Vec<usize>) -> Outcome {
        gone.clear();
        let (s, m) = (self.batch.s(), self.batch.rows());
        let widest = f64::from(self.camera.width.max(self.camera.height)).powi(2);
        for (u, (unit, &at)) in self
            .batch
            .units()
            .iter()
            .zip(self.batch.offsets())
            .enumerate()
        {
            let mut rows = at..at + unit.rows.count;
            if unit.rows.is_pixel() && rows.any(|row| s[row * m + row] > widest) {
                gone.push(u);
            }
        }
        Outcome::TooUncertain
    }

    /// Matches that fail their own gate.
    fn gated(&mut self, _: &mut UpdateReport, gone: &mut Vec<usize>) -> Outcome {
        gone.clear();
        if self.settings.validate.test == BatchTestKind::None {
            return Outcome::RejectedGate;
        }
        let level = self.settings.validate.gate_level;
        validate::reject_each(
            self.batch.s(),
            self.batch.rows(),
            self.batch.g(),
            validate::Units::new(self.batch.offsets()),
            level,
            &mut self.test,
        );
        gone.extend_from_slice(self.test.rejected());
        Outcome::RejectedGate
    }

    /// Matches that the batch test leaves out.
    fn batch_test(&mut self, report: &mut UpdateReport, gone: &mut Vec<usize>) -> Outcome {
        gone.clear();
        let test = BatchTest::chosen(&self.settings.validate);
        let batch = self.batch.as_batch();
        if batch.units.is_empty() {
            return Outcome::RejectedBatch;
        }
        let verdict = test.run(&batch, &mut self.test);
        report.order = verdict.order;
        report.exact = verdict.exact;
        gone.extend_from_slice(self.test.rejected());
        Outcome::RejectedBatch
    }

    fn finish(&mut self, z: &Measurements, report: &mut UpdateReport) {
        let now = self.time.unwrap_or(0.0);
        for id in &z.searched {
            if let Some(record) = self.records.get_mut(id) {
                record.searched += 1;
            }
        }
        for (bearing, outcome) in z.bearings.iter().zip(&report.bearings) {
            if let (Outcome::Pixel | Outcome::Replaced, Some(record)) =
                (outcome, self.records.get_mut(&bearing.id))
            {
                record.found += 1;
                record.last_found = now;
            }
        }
        if self.started {
            return;
        }
        let outcomes = report.pairs.iter_mut().chain(&mut report.depths);
        let born: Vec<&mut Outcome> = outcomes.filter(|o| matches!(o, Outcome::Born(_))).collect();
        if born.len() >= self.settings.worn.start_births {
            self.start();
        } else {
            for outcome in born {
                *outcome = Outcome::TooUncertain;
            }
            self.state.remove(|b| b.kind.is_feature());
            self.records.clear();
        }
    }
}

/// Each feature once.
pub(crate) fn check_once(
    what: &'static str,
    ids: impl Iterator<Item = u64>,
    sorted: &mut Vec<u64>,
) -> Result<(), EkfError> {
    sorted.clear();
    sorted.extend(ids);
    sorted.sort_unstable();
    if sorted.windows(2).all(|w| w[0] != w[1]) {
        return Ok(());
    }
    Err(EkfError::InvalidInput {
        what,
        why: "an id stands twice; give each feature or candidate one measurement".into(),
    })
}

/// A rotation matrix, a position and a symmetric positive semi-definite covariance, all finite.
pub(crate) fn check_pose(pose: &Pose, covariance: &Matrix6<f64>) -> Result<(), EkfError> {
    if !covariance.iter().all(|x| x.is_finite()) {
        return Err(EkfError::NonFinite {
            what: "T_CF or its covariance",
        });
    }
    check_rigid("T_CF", pose)?;
    guard::variances("covariance of T_CF", covariance.iter())?;
    if !is_covariance(covariance) {
        return Err(EkfError::InvalidInput {
            what: "covariance of T_CF",
            why: "it is not symmetric positive semi-definite".into(),
        });
    }
    Ok(())
}

/// A covariance that is a part of that of T_CF: what it leaves has no negative variance beyond rounding.
pub(crate) fn check_bias(bias: &Matrix6<f64>, covariance: &Matrix6<f64>) -> Result<(), EkfError> {
    let what = "bias of T_CF";
    if !bias.iter().all(|x| x.is_finite()) {
        return Err(EkfError::NonFinite { what });
    }
    let rest = covariance - bias;
    let rounding = Matrix6::identity() * (1e-12 * covariance.abs().max());
    if is_covariance(bias) && is_covariance(&((rest + rest.transpose()) * 0.5 + rounding)) {
        return Ok(());
    }
    Err(EkfError::InvalidInput {
        what,
        why: "it must be symmetric positive semi-definite and a part of the covariance, here one of both has a \
              negative variance; give a smaller bias or a larger covariance"
            .into(),
    })
}

/// A rotation matrix and a position, all finite.
pub(crate) fn check_rigid(what: &'static str, pose: &Pose) -> Result<(), EkfError> {
    let mut numbers = pose.rotation.iter().chain(pose.translation.iter());
    if !numbers.all(|x| x.is_finite()) {
        return Err(EkfError::NonFinite { what });
    }
    guard::lengths(what, pose.translation.iter())?;
    let off = pose.rotation * pose.rotation.transpose() - Matrix3::identity();
    if off.abs().max() > 1e-6 || pose.rotation.determinant() < 0.0 {
        return Err(EkfError::InvalidInput {
            what,
            why: "its upper left 3x3 is not a rotation matrix".into(),
        });
    }
    Ok(())
}

/// Whether a finite matrix is symmetric and positive semi-definite, up to rounding.
pub(crate) fn is_covariance<const N: usize>(m: &SMatrix<f64, N, N>) -> bool {
    let scale = m.abs().max();
    let eigenvalues = DMatrix::from_column_slice(N, N, m.as_slice()).symmetric_eigenvalues();
    (m - m.transpose()).abs().max() <= 1e-9 * scale && eigenvalues.min() >= -1e-9 * scale
}
