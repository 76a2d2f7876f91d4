//! The filter: what a frame loop calls, in the order of METHOD 7.
//!
//! ```text
//! predict(t) -> predict_pixels() -> [search, match outside] -> update(measurements)
//!            -> observe_candidates() -> manage_map() -> add_candidates() / add_undelayed()
//! ```

use crate::batch::Workspace;
use crate::camera::Camera;
use crate::drift::{FrameDrift, Misfit};
use crate::error::EkfError;
use crate::frame::{self, check_bias, check_pose};
use crate::gauge::Gauge;
use crate::guard;
use crate::kernel::Panels;
use crate::local::{Far, Spare};
use crate::map::{Candidate, FeatureRecord};
use crate::math::pose::Pose;
use crate::math::quat;
use crate::observe::point::CameraPose;
use crate::observe::{FeatureState, PointInCamera};
use crate::overlap::{self, Overlap};
use crate::predict;
use crate::settings::{Consistency, Settings};
use crate::state::{Block, CAMERA_DIM, State};
use crate::validate;
use nalgebra::{Matrix2, Matrix3, Matrix6, SMatrix, Vector2, Vector3};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// Largest time stamp, seconds: some thousand years; nanoseconds since 1970 are far beyond.
pub(crate) const LAST_TIME: f64 = 1e11;
/// Shortest time between two frames, seconds: the steps of f64 time stamps since 1970 are a quarter of it.
const SHORTEST_STEP: f64 = 1e-6;
/// Longest time that one prediction bridges, seconds; beyond it the stamps are taken to be wrong.
const LONGEST_GAP: f64 = 3600.0;
/// Longest motion that is predicted, seconds. After it nothing is known of the attitude any more (its sd is several
/// turns with the default process noise), so that more of it would only drown the map's digits in P.
const LONGEST_MOTION: f64 = 20.0;

/// An Extended Kalman Filter over one camera and its map. One filter serves one thread at a time.
#[derive(Clone, Debug)]
pub struct Filter {
    pub(crate) settings: Settings,
    pub(crate) camera: Camera,
    pub(crate) worn_camera: Option<Camera>,
    pub(crate) state: State,
    pub(crate) time: Option<f64>,
    pub(crate) started: bool,
    pub(crate) records: BTreeMap<u64, FeatureRecord>,
    pub(crate) candidates: BTreeMap<u64, Candidate>,
    pub(crate) next_candidate: u64,
    pub(crate) batch: Workspace,
    pub(crate) test: validate::Workspace,
    pub(crate) drift: FrameDrift,
    pub(crate) misfit: Misfit,
    pub(crate) gauge: Gauge,
    pub(crate) contradictions: frame::Contradictions,
    pub(crate) scratch: frame::Scratch,
    /// Room for the next list of features that the gauge follows.
    pub(crate) in_view: Vec<u64>,
    /// What is outside of the working state `state`, with `map.local`.
    pub(crate) far: Option<Far>,
    /// Room for the next working set of `map.local`.
    pub(crate) spare: Spare,
    /// The whole state, if it was asked for since the last change.
    pub(crate) shown: OnceLock<Box<State>>,
}

/// Features for which there is room before the first one is born.
const AT_FIRST: usize = 500;
/// With `map.local`: pixels out of the image within which a feature's mean of some frames ago may be while it is in view...
const MAYBE: f64 = 200.0;
/// ...unless an update has moved the camera by as much (metres or quaternion entries): the map may have moved as well.
const JUMP: f64 = 0.02;
/// Pixels out of the image within which features join the working set when one in view does.
const SOON: f64 = 60.0;

/// What a feature is expected to look like (METHOD 7, step 2).
#[derive(Clone, Debug)]
pub struct PredictedFeature {
    /// Its id.
    pub id: u64,
    /// Predicted pixel in Cs.
    pub uv: Vector2<f64>,
    /// Innovation covariance of that pixel, measurement noise included, px^2.
    pub s: Matrix2<f64>,
    /// Point in W, metres.
    pub point: Vector3<f64>,
    /// Inverse range from the camera now, 1/m.
    pub rho: f64,
    /// Its standard deviation, 1/m.
    pub rho_sd: f64,
}

/// A landmark of the map.
#[derive(Clone, Debug)]
pub struct Landmark {
    /// Its id.
    pub id: u64,
    /// Point in W, metres.
    pub point: Vector3<f64>,
    /// 3x3 covariance of the point, m^2.
    pub covariance: Matrix3<f64>,
    /// sd(rho) / rho, the relative error of its depth: from its anchor, of a feature that has become a point from the camera now.
    pub rho_ratio: f64,
}

impl Filter {
    /// A filter that has not started: camera at the origin of W, no map.
    ///
    /// `worn_camera` is the model of Cf, needed only to take its pixels.
    pub fn new(settings: Settings, camera: Camera, worn_camera: Option<Camera>) -> Self {
        // More is taken when it is needed.
        let features = settings.map.max_features.min(AT_FIRST);
        let capacity = crate::state::CAMERA_DIM + 6 * features + 64;
        Self {
            state: State::at_origin(capacity),
            settings,
            camera,
            worn_camera,
            time: None,
            started: false,
            records: BTreeMap::new(),
            candidates: BTreeMap::new(),
            next_candidate: 0,
            batch: Workspace::default(),
            test: validate::Workspace::default(),
            drift: FrameDrift::default(),
            misfit: Misfit::default(),
            gauge: Gauge::default(),
            contradictions: frame::Contradictions::default(),
            scratch: frame::Scratch::default(),
            in_view: Vec::new(),
            far: None,
            spare: Spare::default(),
            shown: OnceLock::new(),
        }
    }

    /// The settings in force.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The state: mean, covariance, layout. With `map.local` it is put together when asked for, in O(n^2).
    pub fn state(&self) -> &State {
        match &self.far {
            Some(far) => self
                .shown
                .get_or_init(|| Box::new(far.settle(&self.state, &mut Spare::default()))),
            None => &self.state,
        }
    }

    /// To be called before anything changes.
    pub(crate) fn changes(&mut self) {
        self.shown.take();
    }

    /// Whether the filter is sound (METHOD 3): mean and P finite, quaternions of unit length, the least eigenvalue of the
    /// diagonal-scaled P above -1e-10. O(n^3): a monitor, not part of a step.
    ///
    /// # Errors
    /// `Unsound`, saying what is wrong.
    pub fn check(&self) -> Result<(), EkfError> {
        let unsound = |why: String| EkfError::Unsound { why };
        let state = self.state();
        guard::state_is_sane(state).map_err(unsound)?;
        guard::attitude_is_sane(&self.state).map_err(unsound)?;
        let least = state.p.least_scaled_eigenvalue();
        if least.is_nan() || least < -guard::ROUNDING {
            let why = format!("the least eigenvalue of the scaled P is {least:e}");
            return Err(unsound(why));
        }
        Ok(())
    }

    /// `v_W`, m/s.
    pub fn velocity(&self) -> Vector3<f64> {
        self.state.velocity()
    }

    /// `w_C`, rad/s.
    pub fn angular_velocity(&self) -> Vector3<f64> {
        self.state.angular_velocity()
    }

    /// Time of the last prediction, seconds.
    pub fn time(&self) -> Option<f64> {
        self.time
    }

    /// Whether there is a metric (or scale-free) start.
    pub fn started(&self) -> bool {
        self.started
    }

    /// Number of features in the map.
    pub fn map_size(&self) -> usize {
        let outside = self.far.as_ref().map_or(0, Far::len);
        self.state.layout.features().count() + outside
    }

    /// Number of candidates that wait for parallax.
    pub fn candidate_count(&self) -> usize {
        self.candidates.len()
    }

    /// Predicts to time `t`, seconds. Before the start only the time is noted. A gap of more than 20 s is predicted as
    /// one of 20 s, after which the pose is as good as unknown: find it again in the map.
    ///
    /// # Errors
    /// `NonFinite`; `InvalidInput` if `t` cannot be in seconds; `BadTime` if it is not a microsecond after the last frame;
    /// `LongGap` if it is more than an hour after it, `InvalidInput` if P would leave all bounds (after years of gaps
    /// without a measurement). Nothing changes then.
    pub fn predict(&mut self, t: f64) -> Result<(), EkfError> {
        if !t.is_finite() {
            return Err(EkfError::NonFinite { what: "time" });
        }
        if t.abs() > LAST_TIME {
            let why = format!("{t} s is no time stamp in seconds; are these nanoseconds?");
            return Err(EkfError::InvalidInput { what: "time", why });
        }
        if let Some(last) = self.time {
            if t - last < SHORTEST_STEP {
                return Err(EkfError::BadTime { t, last });
            }
            if self.started {
                if t - last > LONGEST_GAP {
                    return Err(EkfError::LongGap { t, last });
                }
                let dt = (t - last).min(LONGEST_MOTION);
                guard::prediction(&self.state, dt, &self.settings.process)?;
                self.predict_by(dt);
            }
        }
        self.time = Some(t);
        Ok(())
    }

    fn predict_by(&mut self, dt: f64) {
        self.changes();
        let process = &self.settings.process;
        let before = self.state.camera_pose().r;
        predict::predict(&mut self.state, dt, process, &self.settings.worn);
        let pose = self.state.camera_pose();
        let distance = (pose.r - before).norm();
        let misfit = self.misfit.share();
        self.drift.grow(&pose, dt, distance, misfit, process);
        if let Some(far) = &mut self.far {
            // What comes into view joins the working set, and what is about to come with it: to join costs a pass over R.
            far.look_about(&self.state, self.batch.moved_by() > JUMP);
            let look = |y: &FeatureState, margin| appearance(&self.camera, &pose, y, margin);
            let seen = sight(&self.camera, &pose);
            let close = far.maybe_in_view(&self.state, |point| seen(point, -MAYBE));
            let mut any = false;
            let close = close.filter(|(_, y)| {
                any |= look(y, 0.0).is_some();
                look(y, -SOON).is_some()
            });
            let close: Vec<u64> = close.map(|(block, _)| block.id).collect();
            if any {
                far.enter(&mut self.state, |id| close.binary_search(&id).is_ok());
            }
            far.note_clear(&pose);
        }
        if self.carries() {
            self.follow_view(&pose);
        }
    }

    /// Whether P moves with the directions that no camera can see.
    pub(crate) fn carries(&self) -> bool {
        self.settings.estimator.consistency == Consistency::Gauge
    }

    /// Features that the gauge transport follows: those in view, and those that were in view and are still close to it,
    /// increasing.
    pub fn followed(&self) -> &[u64] {
        self.gauge.followed()
    }

    /// Chooses which features the gauge transport follows; those that come back are carried to the present mean.
    pub(crate) fn follow_view(&mut self, pose: &CameraPose) {
        let State { reference, x, .. } = &mut self.state;
        reference[..CAMERA_DIM].copy_from_slice(&x[..CAMERA_DIM]);
        let seen = sight(&self.camera, pose);
        let (mut stay, mut back) = (std::mem::take(&mut self.in_view), false);
        stay.clear();
        for block in self.state.layout.features() {
            let followed = self.gauge.follows(block.id);
            let margin = if followed { -SOON } else { 0.0 };
            let point = self.state.feature(block).point();
            if point.is_some_and(|point| seen(&point, margin)) {
                stay.push(block.id);
                back |= !followed;
            }
        }
        stay.sort_unstable();
        if back {
            self.gauge.note(&self.state);
        }
        self.gauge.swap_followed(&mut stay);
        self.in_view = stay;
        if back {
            let change = self.gauge.change(&self.state, None);
            self.state.p.downdate(&Panels::default(), Some(change));
            self.gauge.settle(&mut self.state);
        }
    }

    /// Gives the camera its uncertain velocity at the start.
    pub(crate) fn start(&mut self) {
        let process = &self.settings.process;
        for i in 0..3 {
            self.state
                .p
                .set(7 + i, 7 + i, process.start_velocity_sd.powi(2));
            self.state
                .p
                .set(10 + i, 10 + i, process.start_angular_velocity_sd.powi(2));
        }
        self.started = true;
    }

    /// Pixel, S and point of every feature that should be visible in Cs (METHOD 4: in front, in the image, rho > 0).
    pub fn predict_pixels(&self) -> Vec<PredictedFeature> {
        let mut seen = Vec::with_capacity(self.map_size());
        self.predict_pixels_into(&mut seen);
        seen
    }

    /// As [`Self::predict_pixels`], in place of what a list of before holds: a warm filter allocates nothing then.
    pub fn predict_pixels_into(&self, seen: &mut Vec<PredictedFeature>) {
        seen.clear();
        let pose = self.state.camera_pose();
        let p_pose = self.state.p.block::<7, 7>(0, 0);
        for block in self.state.layout.features() {
            let feature = self.state.feature(block);
            if let Some(view) = appearance(&self.camera, &pose, &feature, 0.0) {
                let (p_cross, p_own) = self.state.feature_covariance(block);
                seen.push(self.expect(block.id, &feature, &view, (&p_pose, &p_cross, &p_own)));
            }
        }
        if let Some(far) = self.far.as_ref().filter(|far| !far.is_clear(&pose)) {
            let seen_at = sight(&self.camera, &pose);
            let may_be = far.maybe_in_view(&self.state, |point| seen_at(point, -MAYBE));
            for (block, feature) in may_be {
                if let Some(view) = appearance(&self.camera, &pose, &feature, 0.0) {
                    let (p_cross, p_own) = far.covariance(&self.state, &block);
                    seen.push(self.expect(block.id, &feature, &view, (&p_pose, &p_cross, &p_own)));
                }
            }
            seen.sort_unstable_by_key(|f| f.id);
        }
    }

    /// Pixel and uncertainty of a feature that is in view, from its covariance with the pose and its own.
    fn expect(
        &self,
        id: u64,
        feature: &FeatureState,
        view: &Appearance,
        (p_pose, p_cross, p_own): Covariances<'_>,
    ) -> PredictedFeature {
        let Appearance {
            point,
            uv,
            by_point,
        } = view;
        let point_cov = point.by_pose * p_pose * point.by_pose.transpose()
            + point.by_feature * p_own * point.by_feature.transpose()
            + sym(point.by_pose * p_cross * point.by_feature.transpose());
        let range = point.value.norm();
        let along = point.value / range;
        let range_var = (along.transpose() * point_cov * along)[(0, 0)].max(0.0);
        let sigma2 = self.settings.pixel.sigma_cs.powi(2);
        PredictedFeature {
            id,
            uv: *uv,
            s: by_point * point_cov * by_point.transpose() + Matrix2::identity() * sigma2,
            point: feature.point().unwrap_or_default(),
            rho: 1.0 / range,
            rho_sd: range_var.sqrt() / (range * range),
        }
    }

    /// Keeps the working set of `map.local` small: chooses it anew when dual rows have gathered.
    pub(crate) fn choose_working_set(&mut self, searched: &[u64]) {
        let choose = match &self.far {
            Some(far) => far.is_full(&self.state),
            None => self.started && (4..self.map_size() / 3).contains(&searched.len()),
        };
        if !self.settings.map.local || !choose {
            return;
        }
        let mut near: Vec<u64> = self.predict_pixels().iter().map(|f| f.id).collect();
        near.extend_from_slice(searched);
        if self.carries() {
            near.extend_from_slice(self.followed());
        }
        near.sort_unstable();
        let (state, spare) = (State::at_origin(0), &mut self.spare);
        let state = std::mem::replace(&mut self.state, state);
        let whole = match self.far.take() {
            Some(far) => far.into_whole(state, spare),
            None => state,
        };
        let is_near = |block: &Block| near.binary_search(&block.id).is_ok();
        let (state, far) = Far::split(whole, is_near, spare);
        (self.state, self.far) = (state, Some(far));
    }

    /// Puts the whole state together, without a working set of `map.local`.
    pub(crate) fn make_whole(&mut self) {
        self.changes();
        if let Some(far) = self.far.take() {
            self.state = far.settle(&self.state, &mut self.spare);
        }
    }

    /// Whether there is a feature with this id.
    pub(crate) fn known(&self, id: u64) -> Result<(), EkfError> {
        if self.far.as_ref().is_some_and(|far| far.has(id)) {
            return Ok(());
        }
        self.feature_block(id).map(|_| ())
    }

    /// All landmarks with their covariance in W. Features with rho <= 0 have no point and are left out.
    pub fn landmarks(&self) -> Vec<Landmark> {
        let state = self.state();
        let camera = state.camera_pose().r;
        let p_camera = state.p.block::<3, 3>(0, 0);
        let landmark = |block: &Block| {
            let feature = state.feature(block);
            let point = feature.point()?;
            let j = feature.point_jacobian();
            let (cross, own) = state.feature_covariance(block);
            let covariance = j * own * j.transpose();
            let rho_ratio = match feature {
                FeatureState::InverseDepth(y) => own[(5, 5)].max(0.0).sqrt() / y[5],
                FeatureState::Point(_) => {
                    let with_camera = cross.fixed_view::<3, 6>(0, 0) * j.transpose();
                    let ray = point - camera;
                    let relative = covariance + p_camera - sym(with_camera);
                    let variance = (ray.transpose() * relative * ray)[(0, 0)];
                    variance.max(0.0).sqrt() / ray.norm_squared()
                }
            };
            Some(Landmark {
                id: block.id,
                point,
                covariance: sym(covariance) * 0.5,
                rho_ratio,
            })
        };
        state.layout.features().filter_map(landmark).collect()
    }

    /// Whether Cs and Cf look at the same place, and where in both images (METHOD 9).
    ///
    /// # Errors
    /// `InvalidInput` without a camera model of Cf or for an impossible pose or covariance, `NonFinite`.
    pub fn overlap(
        &self,
        t_cf: &Pose,
        covariance: &Matrix6<f64>,
    ) -> Result<Option<Overlap>, EkfError> {
        let worn = self.worn_model()?;
        check_pose(t_cf, covariance)?;
        let options = &self.settings.overlap;
        let settings = overlap::OverlapSettings {
            near_m: options.near,
            max_far_m: options.far,
            sigma_px: self.settings.pixel.sigma_cf,
            parallax_sigmas: options.parallax_sigmas,
            grow_sigmas: options.grow_sigmas,
        };
        let pose = (&t_cf.rotation, &t_cf.translation);
        Ok(overlap::predict_overlap(
            &self.camera,
            worn,
            pose,
            covariance,
            &settings,
        ))
    }

    /// Whether a view of Cf can be measured; what is refused here is refused by [`Filter::update`].
    ///
    /// `covariance` is that of `t_cf`, 6x6, (translation, rotation), m^2 and rad^2, right tangent; `bias` the part of it
    /// that lasts from frame to frame.
    ///
    /// # Errors
    /// [`EkfError`] if the filter has no camera model of Cf, or if a number cannot be what it stands for.
    pub fn check_worn(
        &self,
        t_cf: &Pose,
        covariance: &Matrix6<f64>,
        bias: Option<&Matrix6<f64>>,
    ) -> Result<(), EkfError> {
        self.worn_model()?;
        check_pose(t_cf, covariance)?;
        bias.map_or(Ok(()), |bias| check_bias(bias, covariance))
    }

    fn worn_model(&self) -> Result<&Camera, EkfError> {
        self.worn_camera.as_ref().ok_or(EkfError::InvalidInput {
            what: "worn camera",
            why: "the filter was made without a camera model of Cf; give one".into(),
        })
    }

    /// T_WC as rotation matrix and position.
    pub fn pose(&self) -> (Matrix3<f64>, Vector3<f64>) {
        let pose = self.state.camera_pose();
        (quat::rotation(&pose.q), pose.r)
    }

    /// 6x6 covariance of the pose, (translation, rotation), right tangent: the state's, and the drift of W.
    pub fn pose_covariance(&self) -> SMatrix<f64, 6, 6> {
        self.state.pose_covariance() + self.drift.of_pose(&self.state.camera_pose())
    }
}

fn sym(a: Matrix3<f64>) -> Matrix3<f64> {
    a + a.transpose()
}

/// Covariance of the camera's pose, of the pose with a feature, and of the feature.
type Covariances<'a> = (
    &'a SMatrix<f64, 7, 7>,
    &'a SMatrix<f64, 7, 6>,
    &'a SMatrix<f64, 6, 6>,
);

/// A feature in view: its point in C, its pixel, and the pixel's derivative by that point.
struct Appearance {
    point: PointInCamera,
    uv: Vector2<f64>,
    by_point: SMatrix<f64, 2, 3>,
}

/// How a feature looks, if it should be visible: in front, `margin` pixels inside of the image, rho > 0.
fn appearance(
    camera: &Camera,
    pose: &CameraPose,
    feature: &FeatureState,
    margin: f64,
) -> Option<Appearance> {
    let point = PointInCamera::metric(pose, feature)?;
    let (uv, by_point) = camera.project_jac(&point.value)?;
    camera.in_image(&uv, margin).then_some(Appearance {
        point,
        uv,
        by_point,
    })
}

/// Whether a point is in front of the camera and in the image, by a margin in pixels.
pub(crate) fn sight(camera: &Camera, pose: &CameraPose) -> impl Fn(&Vector3<f64>, f64) -> bool {
    let (r, r_cw) = (pose.r, quat::rotation(&pose.q).transpose());
    move |point, margin| {
        let seen = r_cw * (point - r);
        let uv = camera.project(&seen);
        uv.is_some_and(|uv| camera.in_image(&uv, margin))
    }
}
