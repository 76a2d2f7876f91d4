//! One frame's measurements (METHOD 7, steps 5-7): which rows each match gives in which mode, the batch test,
//! the update, and the births that the worn camera makes possible.

use crate::batch::Unit;
use crate::birth::new_feature::NewFeature;
use crate::birth::two_view::TwoView;
use crate::error::EkfError;
use crate::filter::Filter;
use crate::math::pose::Pose;
use crate::observe::{PointInCamera, Rows, WornView};
use crate::settings::{BatchTestKind, Mode, WornErrors};
use crate::state::{Block, BlockKind, LinearPart, POSE_DIM};
use crate::validate::{self, BatchTest, HohctSettings, JcbbSettings, OnePointSettings};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector2, Vector3, Vector6};

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
    /// Depth along Cs's optical axis, metres.
    pub depth: f64,
    /// Its standard deviation, metres.
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
    /// Not accurate enough to be worth more than its bearing.
    TooUncertain,
    /// The rays do not meet in front of both cameras, or the feature predicts nothing.
    NotVisible,
    /// Failed its own chi-square gate.
    RejectedGate,
    /// Rejected by the batch test.
    RejectedBatch,
    /// A new feature with this id.
    Born(u64),
    /// Not used in this mode.
    Unused,
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
}

/// How the worn camera's pairs are measured in this frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum WornForm {
    Unused,
    BirthsOnly,
    Points,
    Tight,
}

/// Where in [`Measurements`] a unit of the batch comes from, and which form it takes.
#[derive(Clone, Copy, Debug)]
enum Source {
    /// Two rows: a pixel in Cs.
    Bearing(usize),
    /// Three rows: a worn pair as a 3D point.
    Point(usize),
    /// Two rows: a worn pair's pixel in Cf, of the feature with this id.
    WornPixel(usize, u64),
    /// Three rows: a depth from another sensor.
    Depth(usize),
}

impl Filter {
    /// Validates the frame's matches, updates the state once and starts features that have depth.
    ///
    /// # Errors
    /// Bad input (`NonFinite`, `UnknownFeature`, `InvalidInput`, `NotPositiveDefinite`): the filter stays as it was.
    pub fn update(&mut self, z: &Measurements) -> Result<UpdateReport, EkfError> {
        self.check(z)?;
        let before = self.state.layout.dim();
        let form = self.worn_form(z);
        let worn = z.worn.as_ref().filter(|_| form != WornForm::Unused);
        if let Some(worn) = worn
            && self.settings.worn.errors == WornErrors::Shared
        {
            self.open_worn_error(&worn.covariance);
        }
        let mut report = UpdateReport {
            bearings: vec![Outcome::NotVisible; z.bearings.len()],
            pairs: vec![Outcome::Unused; z.worn.as_ref().map_or(0, |w| w.pairs.len())],
            depths: vec![Outcome::NotVisible; z.depths.len()],
            exact: true,
            iterations: 1,
            ..UpdateReport::default()
        };
        let newborn = match form {
            WornForm::Tight => self.start_tight_births(z, &mut report),
            _ => Vec::new(),
        };
        if let Err(error) = self.measure(z, form, &newborn, &mut report) {
            // Only blocks at the end were added: taking them away restores the state.
            self.state.remove(|b| b.offset >= before);
            let state = &self.state;
            self.records
                .retain(|id, _| state.layout.find(*id).is_some());
            return Err(error);
        }
        match form {
            WornForm::Tight => self.settle_tight_births(&newborn, &mut report),
            WornForm::Points | WornForm::BirthsOnly => self.instant_births(z, &mut report),
            WornForm::Unused => {}
        }
        self.depth_births(z, &mut report);
        report.worn_error = self.state.worn_error();
        self.state.remove(|b| b.kind == BlockKind::WornError);
        self.finish(z, &mut report);
        Ok(report)
    }

    fn check(&self, z: &Measurements) -> Result<(), EkfError> {
        let pairs = z.worn.as_ref().map_or(&[][..], |w| &w.pairs);
        let mut pixels: Vec<Vector2<f64>> = z.bearings.iter().map(|b| b.uv).collect();
        pixels.extend(pairs.iter().flat_map(|p| [p.uv, p.uv_f]));
        pixels.extend(z.depths.iter().map(|d| d.uv));
        self.check_pixels(&pixels)?;
        let ids = z.bearings.iter().map(|b| b.id).chain(
            pairs
                .iter()
                .filter_map(|p| p.id)
                .chain(z.depths.iter().filter_map(|d| d.id))
                .chain(z.searched.iter().copied()),
        );
        for id in ids {
            self.feature_block(id)?;
        }
        let mut seen: Vec<u64> = z.bearings.iter().map(|b| b.id).collect();
        seen.sort_unstable();
        if seen.windows(2).any(|w| w[0] == w[1]) {
            return Err(EkfError::InvalidInput {
                what: "bearings",
                why: "a feature is measured twice; give each feature one pixel".into(),
            });
        }
        for depth in &z.depths {
            let good = |x: f64| x.is_finite() && x > 0.0;
            if !good(depth.depth) || !good(depth.sigma) {
                return Err(EkfError::InvalidInput {
                    what: "depth",
                    why: "depth and its standard deviation must be positive metres".into(),
                });
            }
        }
        if let Some(worn) = &z.worn {
            check_pose(&worn.t_cf, &worn.covariance)?;
            if self.worn_camera.is_none() {
                return Err(EkfError::InvalidInput {
                    what: "worn camera",
                    why: "the filter was made without a camera model of Cf; give one".into(),
                });
            }
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

    /// Appends the frame's error of T_CF: the bias plus white noise (METHOD 6).
    fn open_worn_error(&mut self, covariance: &Matrix6<f64>) {
        let share = self.settings.worn.bias_share;
        if share > 0.0 && self.state.layout.of_kind(BlockKind::WornBias).count() == 0 {
            let stationary = covariance * share;
            self.state.bias_stationary = stationary;
            self.state
                .append::<6>(BlockKind::WornBias, &Vector6::zeros(), &[], &stationary);
        }
        let bias = self.state.layout.of_kind(BlockKind::WornBias).next().copied();
        let identity = Matrix6::<f64>::identity();
        let parts: Vec<LinearPart<'_>> = bias
            .iter()
            .map(|b| LinearPart {
                offset: b.offset,
                width: 6,
                matrix: identity.as_slice(),
            })
            .collect();
        let mean = bias.map_or(Vector6::zeros(), |b| self.state.part::<6>(b.offset));
        self.state.append::<6>(
            BlockKind::WornError,
            &mean,
            &parts,
            &(covariance * (1.0 - share)),
        );
    }

    fn worn_error_offset(&self) -> Option<usize> {
        self.state
            .layout
            .of_kind(BlockKind::WornError)
            .next()
            .map(|b| b.offset)
    }

    /// The intersection of a pair's rays under the present estimate of T_CF.
    fn intersect(&self, worn: &WornObservation, uv: &Vector2<f64>, uv_f: &Vector2<f64>) -> Option<TwoView> {
        let worn_camera = self.worn_camera.as_ref()?;
        let t_cf = worn.t_cf.retract(&self.state.worn_error());
        TwoView::new(&self.camera, uv, worn_camera, uv_f, &t_cf)
    }

    /// Covariance of T_CF's error for this frame: the state's where it is shared, else the stated one.
    fn worn_covariance(&self, worn: &WornObservation) -> Matrix6<f64> {
        self.worn_error_offset()
            .map_or(worn.covariance, |o| self.state.p.block::<6, 6>(o, o))
    }

    /// METHOD 6, tight form: new points enter with a vague rho around their triangulated one, from Cs alone; their
    /// Cf pixel is then measured with everybody else's. Returns (pair, feature id).
    fn start_tight_births(
        &mut self,
        z: &Measurements,
        report: &mut UpdateReport,
    ) -> Vec<(usize, u64)> {
        let Some(worn) = &z.worn else {
            return Vec::new();
        };
        let ratio = self.settings.birth.tight_rho_ratio;
        let sigma = self.settings.pixel.sigma_cs;
        let pose = self.state.camera_pose();
        let mut newborn = Vec::new();
        for (i, pair) in worn.pairs.iter().enumerate() {
            if pair.id.is_some() {
                continue;
            }
            let new = self
                .intersect(worn, &pair.uv, &pair.uv_f)
                .and_then(|view| {
                    let sd = ratio * view.rho;
                    NewFeature::with_prior_depth(
                        &self.camera,
                        &pose,
                        &pair.uv,
                        sigma,
                        view.rho,
                        sd,
                    )
                });
            report.pairs[i] = Outcome::NotVisible;
            if let Some(new) = new {
                let id = self.append_feature(&new).id;
                newborn.push((i, id));
                report.pairs[i] = Outcome::Born(id);
            }
        }
        newborn
    }

    /// Takes away newborns whose pixel in Cf was rejected or whose depth is still too vague.
    fn settle_tight_births(&mut self, newborn: &[(usize, u64)], report: &mut UpdateReport) {
        let largest = self.settings.birth.max_rho_ratio;
        let mut gone = Vec::new();
        for &(i, id) in newborn {
            if report.pairs[i] != Outcome::Born(id) {
                gone.push(id);
            } else if let Ok(block) = self.feature_block(id) {
                let rho = self.state.feature(&block).rho();
                let variance = self.state.p.get(block.offset + 5, block.offset + 5);
                if rho <= 0.0 || variance.max(0.0).sqrt() > largest * rho {
                    gone.push(id);
                    report.pairs[i] = Outcome::TooUncertain;
                }
            }
        }
        self.remove_blocks(&gone);
    }

    /// Steps 5-7: build, validate, update.
    fn measure(
        &mut self,
        z: &Measurements,
        form: WornForm,
        newborn: &[(usize, u64)],
        report: &mut UpdateReport,
    ) -> Result<(), EkfError> {
        let n = self.state.p.dim();
        // A match whose 3D block is rejected falls back to its bearing (METHOD 6), in another round.
        let mut demoted = vec![false; report.pairs.len() + report.depths.len()];
        let mut sources = Vec::new();
        for last in [false, false, true] {
            sources = self.collect_units(z, form, newborn, &demoted, report);
            self.batch.build(&self.state);
            let gated = self.gated();
            let mut again = note(
                &sources,
                &gated,
                Outcome::RejectedGate,
                report,
                &mut demoted,
            );
            leave_out(&mut sources, &gated);
            self.batch.leave_out(n, &gated);
            self.batch.factor()?;
            let rejected = self.batch_test(report);
            again |= note(
                &sources,
                &rejected,
                Outcome::RejectedBatch,
                report,
                &mut demoted,
            );
            if again && !last {
                continue;
            }
            if !rejected.is_empty() {
                leave_out(&mut sources, &rejected);
                self.batch.leave_out(n, &rejected);
                self.batch.factor()?;
            }
            break;
        }
        report.nis = self.batch.nis();
        report.dof = self.batch.rows();
        self.iterate(z, &sources, report)?;
        self.batch.apply(&mut self.state);
        Ok(())
    }

    /// Relinearises the accepted batch at the camera pose that it implies, until the measurements agree with their
    /// linear model: a plain step is biased where the motion of one frame is a good part of the depth.
    ///
    /// Only the pose is iterated. Depths and the error of T_CF stay at their prior: their product is what is
    /// measured, and the joint mode of both is pulled to large scales (the noise of the prediction grows with the
    /// estimated baseline), where the linear step is not.
    fn iterate(
        &mut self,
        z: &Measurements,
        sources: &[Source],
        report: &mut UpdateReport,
    ) -> Result<(), EkfError> {
        let prior = self.state.x.clone();
        for iteration in 1..self.settings.estimator.iterations {
            let mut moved = prior.clone();
            self.batch.add_gain_times_innovation(&mut moved);
            self.state.x[..POSE_DIM].copy_from_slice(&moved[..POSE_DIM]);
            let units: Vec<Option<Unit>> =
                sources.iter().map(|s| self.unit(z, *s).ok()).collect();
            let point = std::mem::replace(&mut self.state.x, prior.clone());
            if !self.batch.relinearise(units, &prior, &point, self.settings.estimator.nonlinearity) {
                break;
            }
            report.iterations = iteration + 1;
            self.batch.build(&self.state);
            self.batch.factor()?;
        }
        Ok(())
    }

    /// One unit of the batch, linearised at the present mean.
    fn unit(&self, z: &Measurements, source: Source) -> Result<Unit, Outcome> {
        match (source, &z.worn) {
            (Source::Bearing(i), _) => self.bearing(&z.bearings[i]),
            (Source::Point(i), Some(worn)) => self.worn_point(worn, &worn.pairs[i]),
            (Source::WornPixel(i, id), Some(worn)) => self.worn_pixel(worn, &worn.pairs[i], id),
            (Source::Depth(i), _) => self.other_depth(&z.depths[i]),
            (Source::Point(_) | Source::WornPixel(..), None) => Err(Outcome::Unused),
        }
    }

    /// Which rows each match gives (METHOD 7, step 5), and where they come from.
    fn collect_units(
        &mut self,
        z: &Measurements,
        form: WornForm,
        newborn: &[(usize, u64)],
        demoted: &[bool],
        report: &mut UpdateReport,
    ) -> Vec<Source> {
        let mut wanted = Vec::new();
        for (i, pair) in z.worn.iter().flat_map(|w| &w.pairs).enumerate() {
            let born = newborn.iter().find(|(j, _)| *j == i).map(|(_, id)| *id);
            match (form, pair.id.or(born)) {
                (WornForm::Points, Some(_)) if pair.id.is_some() => wanted.push(Source::Point(i)),
                (WornForm::Tight, Some(id)) => wanted.push(Source::WornPixel(i, id)),
                _ => {}
            }
        }
        let known_depths = (0..z.depths.len()).filter(|&i| z.depths[i].id.is_some());
        wanted.extend(known_depths.map(Source::Depth));
        wanted.extend((0..z.bearings.len()).map(Source::Bearing));
        self.batch.clear();
        let mut with_depth: Vec<u64> = Vec::new();
        let mut sources = Vec::new();
        for source in wanted {
            let slot = source.slot(report.pairs.len());
            if slot.is_some_and(|k| demoted[k]) {
                continue; // keeps the outcome of its rejection
            }
            // Its 3 rows stand INSTEAD of these 2: both would use (u1, v1).
            if let Source::Bearing(i) = source
                && with_depth.contains(&z.bearings[i].id)
            {
                report.bearings[i] = Outcome::Replaced;
                continue;
            }
            let unit = self.unit(z, source);
            let outcome = match (&unit, source) {
                (Err(outcome), _) => *outcome,
                (Ok(_), Source::Bearing(_)) => Outcome::Pixel,
                (Ok(_), Source::Point(_) | Source::Depth(_)) => Outcome::Depth,
                (Ok(_), Source::WornPixel(i, id)) => {
                    let known = z.worn.as_ref().is_some_and(|w| w.pairs[i].id.is_some());
                    if known { Outcome::Pixel } else { Outcome::Born(id) }
                }
            };
            *source.outcome(report) = outcome;
            if let Ok(unit) = unit {
                if outcome == Outcome::Depth {
                    with_depth.push(unit.id);
                }
                self.batch.push(unit);
                sources.push(source);
            }
        }
        sources
    }

    /// A feature's pixel in Cs.
    fn bearing(&self, bearing: &Bearing) -> Result<Unit, Outcome> {
        let block = self.feature_block(bearing.id).map_err(|_| Outcome::NotVisible)?;
        let rows = Rows::bearing(
            &self.camera,
            &self.state.camera_pose(),
            &self.state.feature(&block),
            &bearing.uv,
            self.settings.pixel.sigma_cs,
        );
        Unit::new(rows, &block, None)
    }

    /// A known feature's match as a 3D point (METHOD 6), where its range is worth it.
    fn worn_point(&self, worn: &WornObservation, pair: &WornPair) -> Result<Unit, Outcome> {
        let id = pair.id.ok_or(Outcome::Unused)?;
        let block = self.feature_block(id).map_err(|_| Outcome::NotVisible)?;
        let view = self
            .intersect(worn, &pair.uv, &pair.uv_f)
            .ok_or(Outcome::NotVisible)?;
        let (pose, feature) = (self.state.camera_pose(), self.state.feature(&block));
        let predicted = PointInCamera::metric(&pose, &feature).ok_or(Outcome::NotVisible)?;
        // Taken at the predicted range: at the measured one, near errors would weigh more than far ones.
        let view = view.at_range(predicted.value.norm());
        let (sigma, sigma_f) = (self.settings.pixel.sigma_cs, self.settings.pixel.sigma_cf);
        if self.rho_variance(worn, &view).sqrt() > self.settings.worn.max_range_ratio * view.rho {
            return Err(Outcome::TooUncertain);
        }
        let j = view.point_by_tangent();
        let mut noise = view.point_noise(sigma, sigma_f);
        let error = self.worn_error_offset();
        if error.is_none() {
            noise += j * worn.covariance * j.transpose();
        }
        let mean = self.state.worn_error();
        // The point was triangulated at the estimated error, so only its deviation from there counts.
        let measured = view.point() - j * mean;
        let rows = Rows::depth(
            &pose,
            &feature,
            &measured,
            &noise,
            error.map(|_| (&mean, &j)),
        );
        Unit::new(rows, &block, error)
    }

    /// A match's pixel in Cf (METHOD 6, tight form).
    fn worn_pixel(&self, worn: &WornObservation, pair: &WornPair, id: u64) -> Result<Unit, Outcome> {
        let block = self.feature_block(id).map_err(|_| Outcome::NotVisible)?;
        let camera = self.worn_camera.as_ref().ok_or(Outcome::NotVisible)?;
        let view = WornView {
            camera,
            measured: worn.t_cf.clone(),
            error: self.state.worn_error(),
        };
        let rows = Rows::worn_pixel(
            &view,
            &self.state.camera_pose(),
            &self.state.feature(&block),
            &pair.uv_f,
            self.settings.pixel.sigma_cf,
        );
        Unit::new(rows, &block, self.worn_error_offset())
    }

    /// A known feature's depth from another sensor.
    fn other_depth(&self, depth: &DepthObservation) -> Result<Unit, Outcome> {
        let id = depth.id.ok_or(Outcome::Unused)?;
        let block = self.feature_block(id).map_err(|_| Outcome::NotVisible)?;
        let (point, noise) = self.point_at_depth(depth).ok_or(Outcome::NotVisible)?;
        let (pose, feature) = (self.state.camera_pose(), self.state.feature(&block));
        Unit::new(
            Rows::depth(&pose, &feature, &point, &noise, None),
            &block,
            None,
        )
    }

    /// Point in C at a pixel and a depth along the optical axis, and its covariance.
    fn point_at_depth(&self, depth: &DepthObservation) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let (ray, by_uv) = self.camera.unproject_jac(&depth.uv)?;
        if ray.z < 1e-3 {
            return None;
        }
        // p = depth * ray / ray_z
        let unit = ray / ray.z;
        let by_pixel =
            (by_uv - unit * by_uv.fixed_view::<1, 2>(2, 0)) * (depth.depth / ray.z);
        let noise = by_pixel * by_pixel.transpose() * self.settings.pixel.sigma_cs.powi(2)
            + unit * unit.transpose() * depth.sigma.powi(2);
        Some((unit * depth.depth, noise))
    }

    fn rho_variance(&self, worn: &WornObservation, view: &TwoView) -> f64 {
        let j = view.rho_by_tangent();
        let pixels = view
            .rho_variance_from_pixels(self.settings.pixel.sigma_cs, self.settings.pixel.sigma_cf);
        pixels + (j * self.worn_covariance(worn) * j.transpose())[(0, 0)].max(0.0)
    }

    /// Units that fail their own chi-square gate: gross errors, which the batch test need not look at.
    fn gated(&mut self) -> Vec<usize> {
        if self.settings.validate.test == BatchTestKind::None {
            return Vec::new();
        }
        let level = self.settings.validate.gate_level;
        validate::individual_gate(
            self.batch.s(),
            self.batch.rows(),
            self.batch.g(),
            validate::Units::new(self.batch.offsets()),
            level,
            &mut self.test,
        );
        self.test.rejected().to_vec()
    }

    /// The batch test of METHOD 8 on the factored batch; returns the units to leave out.
    fn batch_test(&mut self, report: &mut UpdateReport) -> Vec<usize> {
        let options = &self.settings.validate;
        let test = match options.test {
            BatchTestKind::Hohct => BatchTest::Hohct(HohctSettings {
                level: options.level,
                max_nodes: options.max_nodes,
                max_share: options.max_share,
            }),
            BatchTestKind::Jcbb => BatchTest::Jcbb(JcbbSettings {
                level: options.level,
                max_nodes: options.max_nodes,
            }),
            BatchTestKind::OnePoint => BatchTest::OnePoint(OnePointSettings {
                low_sigmas: options.low_sigmas,
                level: options.level,
            }),
            BatchTestKind::Individual => BatchTest::Individual(options.level),
            BatchTestKind::None => BatchTest::None,
        };
        let batch = validate::Batch {
            s: self.batch.s(),
            l: self.batch.l(),
            ld: self.batch.rows(),
            g: self.batch.g(),
            noise: self.batch.noise(),
            units: validate::Units::new(self.batch.offsets()),
        };
        if batch.units.is_empty() {
            return Vec::new();
        }
        let verdict = test.run(&batch, &mut self.test);
        report.order = verdict.order;
        report.exact = verdict.exact;
        self.test.rejected().to_vec()
    }

    /// METHOD 5, instant: matches without a feature become features together, sharing the error of T_CF.
    fn instant_births(&mut self, z: &Measurements, report: &mut UpdateReport) {
        let Some(worn) = &z.worn else { return };
        let pose = self.state.camera_pose();
        let (sigma, sigma_f) = (self.settings.pixel.sigma_cs, self.settings.pixel.sigma_cf);
        for (i, pair) in worn.pairs.iter().enumerate() {
            if pair.id.is_some() {
                continue;
            }
            let Some(view) = self.intersect(worn, &pair.uv, &pair.uv_f) else {
                report.pairs[i] = Outcome::NotVisible;
                continue;
            };
            if self.rho_variance(worn, &view).sqrt()
                > self.settings.birth.max_rho_ratio * view.rho
            {
                report.pairs[i] = Outcome::TooUncertain;
                continue;
            }
            let mut new = NewFeature::from_two_views(&pose, &view, sigma, sigma_f);
            let by_error = view.rho_by_tangent();
            match self.worn_error_offset() {
                Some(offset) => new.share_worn_error(offset, &by_error),
                None => {
                    new.noise[(5, 5)] +=
                        (by_error * worn.covariance * by_error.transpose())[(0, 0)];
                }
            }
            report.pairs[i] = Outcome::Born(self.append_feature(&new).id);
        }
    }

    /// Depths without a feature start one.
    fn depth_births(&mut self, z: &Measurements, report: &mut UpdateReport) {
        let pose = self.state.camera_pose();
        for (i, depth) in z.depths.iter().enumerate() {
            if depth.id.is_some() {
                continue;
            }
            if let Some((point, noise)) = self.point_at_depth(depth) {
                let new = NewFeature::from_point(&pose, &point, &noise, None);
                report.depths[i] = Outcome::Born(self.append_feature(&new).id);
            }
        }
    }

    /// Starts the filter from points of known position in C (METHOD 10): `shared` holds the derivative of each
    /// point by the 6-number error of the target's pose, whose covariance is `covariance`; `noise` is each point's
    /// own. Returns the features' ids.
    ///
    /// # Errors
    /// `BadShape` if the lists differ in length, `NonFinite`, `InvalidInput` if the filter has started already.
    pub fn start_from_points(
        &mut self,
        points: &[Vector3<f64>],
        noise: &[Matrix3<f64>],
        shared: &[SMatrix<f64, 3, 6>],
        covariance: &Matrix6<f64>,
    ) -> Result<Vec<u64>, EkfError> {
        if points.len() != noise.len() || points.len() != shared.len() {
            return Err(EkfError::BadShape {
                what: "noise and shared",
                expected: format!("{} entries, one per point", points.len()),
                got: format!("{} and {}", noise.len(), shared.len()),
            });
        }
        if self.started {
            return Err(EkfError::InvalidInput {
                what: "start",
                why: "the filter has started already; make a new one".into(),
            });
        }
        if !points.iter().all(|p| p.iter().all(|x| x.is_finite())) {
            return Err(EkfError::NonFinite { what: "points" });
        }
        check_pose(&Pose::identity(), covariance)?;
        let error =
            self.state
                .append::<6>(BlockKind::WornError, &Vector6::zeros(), &[], covariance);
        let pose = self.state.camera_pose();
        let ids = (0..points.len())
            .map(|i| {
                let shared = Some((error.offset, &shared[i]));
                let new = NewFeature::from_point(&pose, &points[i], &noise[i], shared);
                self.append_feature(&new).id
            })
            .collect();
        self.state.remove(|b| b.kind == BlockKind::WornError);
        self.start();
        Ok(ids)
    }

    /// Book-keeping of searches and finds, and the start.
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
        let born: Vec<&mut Outcome> = outcomes
            .filter(|o| matches!(o, Outcome::Born(_)))
            .collect();
        if born.len() >= self.settings.worn.start_births {
            self.start();
        } else {
            for outcome in born {
                *outcome = Outcome::TooUncertain;
            }
            self.state.remove(|b| b.kind == BlockKind::Feature);
            self.records.clear();
        }
    }
}

impl Source {
    /// Place in the list of 3D blocks that may be demoted to a bearing, `pairs` pairs coming first.
    fn slot(self, pairs: usize) -> Option<usize> {
        match self {
            Self::Point(i) => Some(i),
            Self::Depth(i) => Some(pairs + i),
            Self::Bearing(_) | Self::WornPixel(..) => None,
        }
    }

    fn outcome(self, report: &mut UpdateReport) -> &mut Outcome {
        match self {
            Self::Bearing(i) => &mut report.bearings[i],
            Self::Point(i) | Self::WornPixel(i, _) => &mut report.pairs[i],
            Self::Depth(i) => &mut report.depths[i],
        }
    }
}

impl Unit {
    fn new(rows: Option<Rows>, block: &Block, worn: Option<usize>) -> Result<Self, Outcome> {
        let rows = rows.ok_or(Outcome::NotVisible)?;
        Ok(Self {
            rows,
            id: block.id,
            feature: block.offset,
            worn,
        })
    }
}

/// Marks rejected units in the report; a rejected 3D block is demoted to its bearing. Returns whether any was.
fn note(
    sources: &[Source],
    rejected: &[usize],
    outcome: Outcome,
    report: &mut UpdateReport,
    demoted: &mut [bool],
) -> bool {
    let mut any = false;
    for &u in rejected {
        *sources[u].outcome(report) = outcome;
        if let Some(slot) = sources[u].slot(report.pairs.len()) {
            demoted[slot] = true;
            any = true;
        }
    }
    any
}

fn leave_out(sources: &mut Vec<Source>, gone: &[usize]) {
    let mut u = 0;
    sources.retain(|_| {
        u += 1;
        gone.binary_search(&(u - 1)).is_err()
    });
}

fn check_pose(pose: &Pose, covariance: &Matrix6<f64>) -> Result<(), EkfError> {
    let finite = pose
        .rotation
        .iter()
        .chain(pose.translation.iter())
        .chain(covariance.iter())
        .all(|x| x.is_finite());
    if !finite {
        return Err(EkfError::NonFinite {
            what: "T_CF or its covariance",
        });
    }
    let off = pose.rotation * pose.rotation.transpose() - Matrix3::identity();
    if off.abs().max() > 1e-6 || pose.rotation.determinant() < 0.0 {
        return Err(EkfError::InvalidInput {
            what: "T_CF",
            why: "its upper left 3x3 is not a rotation matrix".into(),
        });
    }
    let asymmetry = (covariance - covariance.transpose()).abs().max();
    let scale = covariance.abs().max();
    let least = covariance.symmetric_eigenvalues().min();
    if asymmetry > 1e-9 * scale || least < -1e-9 * scale {
        return Err(EkfError::InvalidInput {
            what: "covariance of T_CF",
            why: "it is not symmetric positive semi-definite".into(),
        });
    }
    Ok(())
}
