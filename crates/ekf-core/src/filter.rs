//! The filter: what a frame loop calls, in the order of METHOD 7.
//!
//! ```text
//! predict(t) -> predict_pixels() -> [search, match outside] -> update(measurements)
//!            -> observe_candidates() -> manage_map() -> add_candidates() / add_undelayed()
//! ```

use crate::batch::Workspace;
use crate::camera::Camera;
use crate::drift::FrameDrift;
use crate::error::EkfError;
use crate::frame::check_pose;
use crate::map::{Candidate, FeatureRecord};
use crate::math::pose::Pose;
use crate::math::quat;
use crate::observe::point::PointInCamera;
use crate::overlap::{self, Overlap};
use crate::predict;
use crate::settings::Settings;
use crate::state::{BlockKind, State};
use crate::validate;
use nalgebra::{Matrix2, Matrix3, Matrix6, SMatrix, Vector2, Vector3};
use std::collections::BTreeMap;

/// Largest time stamp, seconds: some thousand years; nanoseconds since 1970 are far beyond.
const LAST_TIME: f64 = 1e11;
/// Longest time that one prediction bridges, seconds.
const LONGEST_GAP: f64 = 3600.0;

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
}

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
    /// sd(rho) / rho.
    pub rho_ratio: f64,
}

impl Filter {
    /// A filter that has not started: camera at the origin of W, no map.
    ///
    /// `worn_camera` is the model of Cf, needed only to take its pixels.
    pub fn new(settings: Settings, camera: Camera, worn_camera: Option<Camera>) -> Self {
        let capacity = crate::state::CAMERA_DIM + 6 * settings.map.max_features + 64;
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
        }
    }

    /// The settings in force.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The state: mean, covariance, layout.
    pub fn state(&self) -> &State {
        &self.state
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
        self.state.layout.of_kind(BlockKind::Feature).count()
    }

    /// Number of candidates that wait for parallax.
    pub fn candidate_count(&self) -> usize {
        self.candidates.len()
    }

    /// Predicts to time `t`, seconds. Before the start only the time is noted.
    ///
    /// # Errors
    /// `NonFinite`; `InvalidInput` if `t` cannot be in seconds; `BadTime` if it is not after the last frame;
    /// `LongGap` if it is more than an hour after it.
    pub fn predict(&mut self, t: f64) -> Result<(), EkfError> {
        if !t.is_finite() {
            return Err(EkfError::NonFinite { what: "time" });
        }
        if t.abs() > LAST_TIME {
            let why = format!("{t} s is no time stamp in seconds; are these nanoseconds?");
            return Err(EkfError::InvalidInput { what: "time", why });
        }
        if let Some(last) = self.time {
            if t <= last {
                return Err(EkfError::BadTime { t, last });
            }
            if self.started {
                if t - last > LONGEST_GAP {
                    return Err(EkfError::LongGap { t, last });
                }
                self.predict_by(t - last);
            }
        }
        self.time = Some(t);
        Ok(())
    }

    fn predict_by(&mut self, dt: f64) {
        let process = &self.settings.process;
        let before = self.state.camera_pose().r;
        predict::predict(&mut self.state, dt, process, &self.settings.worn);
        let pose = self.state.camera_pose();
        let distance = (pose.r - before).norm();
        self.drift.grow(&pose, dt, distance, process);
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
        let pose = self.state.camera_pose();
        let sigma2 = self.settings.pixel.sigma_cs.powi(2);
        let p_pose = self.state.p.block::<7, 7>(0, 0);
        let mut seen = Vec::with_capacity(self.map_size());
        for block in self.state.layout.of_kind(BlockKind::Feature) {
            let feature = self.state.feature(block);
            let Some(metric) = PointInCamera::metric(&pose, &feature) else {
                continue;
            };
            let Some((uv, j)) = self.camera.project_jac(&metric.value) else {
                continue;
            };
            if !self.camera.in_image(&uv, 0.0) {
                continue;
            }
            let p_cross = self.state.p.block::<7, 6>(0, block.offset);
            let p_own = self.state.p.block::<6, 6>(block.offset, block.offset);
            let point_cov = metric.by_pose * p_pose * metric.by_pose.transpose()
                + metric.by_feature * p_own * metric.by_feature.transpose()
                + sym(metric.by_pose * p_cross * metric.by_feature.transpose());
            let range = metric.value.norm();
            let along = metric.value / range;
            let range_var = (along.transpose() * point_cov * along)[(0, 0)].max(0.0);
            seen.push(PredictedFeature {
                id: block.id,
                uv,
                s: j * point_cov * j.transpose() + Matrix2::identity() * sigma2,
                point: feature.point().unwrap_or_default(),
                rho: 1.0 / range,
                rho_sd: range_var.sqrt() / (range * range),
            });
        }
        seen
    }

    /// All landmarks with their covariance in W. Features with rho <= 0 have no point and are left out.
    pub fn landmarks(&self) -> Vec<Landmark> {
        let blocks = self.state.layout.of_kind(BlockKind::Feature);
        blocks
            .filter_map(|block| {
                let feature = self.state.feature(block);
                let point = feature.point()?;
                let j = feature.point_jacobian();
                let p = self.state.p.block::<6, 6>(block.offset, block.offset);
                let covariance = j * p * j.transpose();
                Some(Landmark {
                    id: block.id,
                    point,
                    covariance: (covariance + covariance.transpose()) * 0.5,
                    rho_ratio: p[(5, 5)].max(0.0).sqrt() / feature.rho(),
                })
            })
            .collect()
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
        let worn = self.worn_camera.as_ref().ok_or(EkfError::InvalidInput {
            what: "worn camera",
            why: "the filter was made without a camera model of Cf; give one".into(),
        })?;
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
