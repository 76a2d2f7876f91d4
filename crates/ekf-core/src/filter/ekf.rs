//! The filter itself: its parts, and what can be read from it at any time.

use super::input::sources::Scratch;
use super::memory::candidate::Candidate;
use super::memory::handed::Handover;
use super::memory::pose_ring::KeptPoses;
use super::memory::record::FeatureRecord;
use super::memory::undo::Undo;
use super::memory::wheels::Wheels;
use crate::batch::Workspace;
use crate::camera::Camera;
use crate::error::EkfError;
use crate::gauge::Gauge;
use crate::local::{Buffers, OutsideSet};
use crate::math::quat;
use crate::misfit::Misfit;
use crate::odometry::Odometry;
use crate::placed::Placed;
use crate::settings::{Consistency, Settings};
use crate::state::{BlockKind, CAMERA_DIM, Mark, State};
use crate::{guard, validate};
use nalgebra::{Matrix3, SMatrix, Vector3, Vector6};
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// An Extended Kalman Filter over one camera and its map. One filter serves one thread at a time.
#[derive(Clone, Debug)]
pub struct Filter {
    pub(super) settings: Settings,
    pub(super) camera: Camera,
    pub(super) worn_cameras: Vec<Camera>,
    pub(super) state: State,
    pub(super) time: Option<f64>,
    pub(super) started: bool,
    pub(super) records: BTreeMap<u64, FeatureRecord>,
    pub(super) candidates: BTreeMap<u64, Candidate>,
    pub(super) next_candidate: u64,
    /// Poses of the last second, for views of Cf that come late.
    pub(super) kept_poses: KeptPoses,
    pub(super) batch: Workspace,
    pub(super) test: validate::Workspace,
    pub(super) placed: Placed,
    pub(super) handover: Handover,
    pub(super) misfit: Misfit,
    pub(super) odometry: Odometry,
    pub(super) wheels: Wheels,
    pub(super) gauge: Gauge,
    pub(super) scratch: Scratch,
    /// Room for the next list of features that the gauge follows.
    pub(super) in_view: Vec<u64>,
    /// What is outside of the working state `state`, in a large map.
    pub(super) outside: Option<OutsideSet>,
    /// Room for the next working set.
    pub(super) buffers: Buffers,
    /// The last checkpoint.
    pub(super) undo: Undo,
    /// The whole state, if it was asked for since the last change.
    pub(super) shown: OnceLock<Box<State>>,
}

/// Features for which there is room before the first one is born.
const AT_FIRST: usize = 500;

impl Filter {
    /// A filter that has not started: camera at the origin of W, no map.
    ///
    /// `worn_cameras` are the models of Cf, one of each person's, numbered from 0; needed only to take their pixels.
    pub fn new(
        settings: Settings,
        camera: Camera,
        worn_cameras: impl IntoIterator<Item = Camera>,
    ) -> Self {
        // More is taken when it is needed.
        let features = settings.map.max_features.min(AT_FIRST);
        let capacity = CAMERA_DIM + 6 * features + 64;
        let mut state = State::at_origin(capacity);
        if let Some(covariance) = settings.calibration.covariance() {
            state.append(BlockKind::Calibration, &Vector6::zeros(), &[], &covariance);
        }
        if let Some(readout) = settings.calibration.readout() {
            state.append_readout(readout);
        }
        let worn_cameras: Vec<Camera> = worn_cameras.into_iter().collect();
        if settings.worn.clock_sd > 0.0 {
            let prior = (0.0, settings.worn.clock_sd);
            worn_cameras
                .iter()
                .for_each(|_| state.append_worn_clock(prior));
        }
        Self {
            state,
            settings,
            camera,
            worn_cameras,
            time: None,
            started: false,
            records: BTreeMap::new(),
            candidates: BTreeMap::new(),
            next_candidate: 0,
            kept_poses: KeptPoses::default(),
            batch: Workspace::default(),
            test: validate::Workspace::default(),
            placed: Placed::default(),
            handover: Handover::default(),
            misfit: Misfit::default(),
            odometry: Odometry::default(),
            wheels: Wheels::default(),
            gauge: Gauge::default(),
            scratch: Scratch::default(),
            in_view: Vec::new(),
            outside: None,
            buffers: Buffers::default(),
            undo: Undo::default(),
            shown: OnceLock::new(),
        }
    }

    /// The settings in force.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }

    /// The state: mean, layout, and the covariance that is told, what lasts of all errors included (METHOD 20). Put together
    /// when asked for, in O(n^2), in a large map, and where something lasts.
    pub fn state(&self) -> &State {
        if self.outside.is_none() && self.state.error_modes().is_none() {
            return &self.state;
        }
        self.shown.get_or_init(|| {
            let whole = match &self.outside {
                Some(outside) => outside.assemble(&self.state, &mut Buffers::default()),
                None => self.state.clone(),
            };
            Box::new(whole.into_told())
        })
    }

    /// Forgets the assembled whole state; to be called before the state changes.
    pub(super) fn changes(&mut self) {
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
        let outside = self.outside.as_ref().map_or(0, OutsideSet::len);
        self.state.layout.features().count() + outside
    }

    /// Ids of the features, in order.
    pub fn feature_ids(&self) -> impl Iterator<Item = u64> {
        self.records.keys().copied()
    }

    /// Number of candidates that wait for parallax.
    pub fn candidate_count(&self) -> usize {
        self.candidates.len()
    }

    /// T_WC as rotation matrix and position.
    pub fn pose(&self) -> (Matrix3<f64>, Vector3<f64>) {
        let pose = self.state.camera_pose();
        (quat::rotation(&pose.q), pose.r)
    }

    /// 6x6 covariance of the pose, (translation, rotation), right tangent: the state's, and that of the map's place in W.
    pub fn pose_covariance(&self) -> SMatrix<f64, 6, 6> {
        let pose = self.state.camera_pose();
        self.state.told().pose_covariance() + self.placed.of_pose(&pose)
    }

    /// Whether P moves with the directions that no camera can see.
    pub(super) fn carries(&self) -> bool {
        self.settings.estimator.consistency == Consistency::Gauge
    }

    /// Features that the gauge transport follows: those in view, and those that were in view and are still close to it,
    /// increasing.
    pub fn followed(&self) -> &[u64] {
        self.gauge.followed()
    }

    /// Gives the camera its uncertain velocity at the start.
    pub(super) fn start(&mut self) {
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
        self.handover.last = None;
    }

    /// Takes away what was appended since `mark`.
    pub(super) fn take_back(&mut self, mark: &Mark) {
        self.state.take_back(mark);
        self.gauge.forget_from(self.state.layout.next_id());
        let (state, outside) = (&self.state, &self.outside);
        self.records.retain(|&id, _| {
            state.layout.find(id).is_some()
                || outside.as_ref().is_some_and(|outside| outside.has(id))
        });
    }
}
