//! The filter itself: its parts, and what can be read from it at any time.

use super::memory::Memory;
use super::memory::undo::Undo;
use super::setup::Setup;
use super::workspace::Workspace;
use crate::camera::Camera;
use crate::error::EkfError;
use crate::guard;
use crate::local::Buffers;
use crate::math::quat;
use crate::settings::Settings;
use crate::state::{BlockKind, CAMERA_DIM, State};
use nalgebra::{Matrix3, SMatrix, Vector3, Vector6};

/// An Extended Kalman Filter over one camera and its map. One filter serves one thread at a time.
#[derive(Clone, Debug)]
pub struct Filter {
    pub(super) setup: Setup,
    pub(super) memory: Memory,
    pub(super) workspace: Workspace,
    /// What was remembered at the last checkpoint.
    pub(super) undo: Undo,
}

/// Features for which there is room before the first one is born.
const AT_FIRST: usize = 500;

/// Largest speed that a camera of which nothing is known is held to have, in median ranges of what it sees per second (one
/// standard deviation): 3 m/s over a desk that is 0.3 m away. What is faster shows each image something else.
const RANGES_PER_SECOND: f64 = 10.0;

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
        Self::of(
            Setup {
                settings,
                camera,
                worn_cameras,
            },
            Memory {
                state,
                ..Memory::default()
            },
        )
    }

    pub(super) fn of(setup: Setup, memory: Memory) -> Self {
        Self {
            setup,
            memory,
            workspace: Workspace::default(),
            undo: Undo::default(),
        }
    }

    /// The settings in force.
    pub fn settings(&self) -> &Settings {
        &self.setup.settings
    }

    /// The state: mean, layout, and the covariance that is told, what lasts of all errors included (METHOD 20). Put together
    /// when asked for, in O(n^2), in a large map, and where something lasts.
    pub fn state(&self) -> &State {
        if self.memory.outside.is_none() && self.memory.state.error_modes().is_none() {
            return &self.memory.state;
        }
        self.workspace.shown.get_or_init(|| {
            let whole = match &self.memory.outside {
                Some(outside) => outside.assemble(&self.memory.state, &mut Buffers::default()),
                None => self.memory.state.clone(),
            };
            Box::new(whole.into_told())
        })
    }

    /// Forgets the assembled whole state; to be called before the state changes.
    pub(super) fn changes(&mut self) {
        self.workspace.shown.take();
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
        guard::attitude_is_sane(&self.memory.state).map_err(unsound)?;
        let least = state.p.least_scaled_eigenvalue();
        if least.is_nan() || least < -guard::ROUNDING {
            let why = format!("the least eigenvalue of the scaled P is {least:e}");
            return Err(unsound(why));
        }
        Ok(())
    }

    /// `v_W`, m/s.
    pub fn velocity(&self) -> Vector3<f64> {
        self.memory.state.velocity()
    }

    /// `w_C`, rad/s.
    pub fn angular_velocity(&self) -> Vector3<f64> {
        self.memory.state.angular_velocity()
    }

    /// Time of the last prediction, seconds.
    pub fn time(&self) -> Option<f64> {
        self.memory.time
    }

    /// Whether there is a metric (or scale-free) start.
    pub fn started(&self) -> bool {
        self.memory.started
    }

    /// Number of features in the map.
    pub fn map_size(&self) -> usize {
        self.memory.map_size()
    }

    /// Ids of the features, in order.
    pub fn feature_ids(&self) -> impl Iterator<Item = u64> {
        self.memory.records.keys().copied()
    }

    /// Number of candidates that wait for parallax.
    pub fn candidate_count(&self) -> usize {
        self.memory.candidates.len()
    }

    /// T_WC as rotation matrix and position.
    pub fn pose(&self) -> (Matrix3<f64>, Vector3<f64>) {
        let pose = self.memory.state.camera_pose();
        (quat::rotation(&pose.q), pose.r)
    }

    /// 6x6 covariance of the pose, (translation, rotation), right tangent: the state's, and that of the map's place in W.
    pub fn pose_covariance(&self) -> SMatrix<f64, 6, 6> {
        let pose = self.memory.state.camera_pose();
        self.memory.state.told().pose_covariance() + self.memory.map_frame.of_pose(&pose)
    }

    /// Velocity and angular velocity of Cs along its own axes, m/s and rad/s.
    pub fn twist(&self) -> Vector6<f64> {
        let state = &self.memory.state;
        let back = quat::rotation(&state.camera_pose().q).transpose();
        let (v, w) = (back * state.velocity(), state.angular_velocity());
        Vector6::new(v.x, v.y, v.z, w.x, w.y, w.z)
    }

    /// 12x12 covariance of the pose, as [`Self::pose_covariance`] has it, and of the twist.
    pub fn pose_and_twist_covariance(&self) -> SMatrix<f64, 12, 12> {
        let mut all = self.memory.state.told().pose_and_twist_covariance();
        let pose = self.memory.state.camera_pose();
        let of_map = self.memory.map_frame.of_pose(&pose);
        let mut own = all.fixed_view_mut::<6, 6>(0, 0);
        own += of_map;
        all
    }

    /// Features that the gauge transport follows: those in view, and those that were in view and are still close to it,
    /// increasing.
    pub fn followed(&self) -> &[u64] {
        self.memory.followed.ids()
    }

    /// Gives the camera its uncertain velocity at the start.
    pub(super) fn start(&mut self) {
        self.start_velocities();
        self.in_new_place();
    }

    /// The camera is where nothing that was kept of the frames before holds.
    pub(super) fn in_new_place(&mut self) {
        // The map was looked at in the middle of an update.
        self.changes();
        self.memory.started = true;
        self.memory.map_transfer.last = None;
    }

    /// Velocities of which nothing is known (METHOD 3).
    pub(super) fn start_velocities(&mut self) {
        let speed = self.start_speed_sd();
        let turning = self.setup.settings.process.start_angular_velocity_sd;
        for i in 0..3 {
            self.memory.state.p.set(7 + i, 7 + i, speed.powi(2));
            self.memory.state.p.set(10 + i, 10 + i, turning.powi(2));
        }
    }

    /// Standard deviation of each component of a velocity of which nothing is known, m/s (METHOD 3).
    fn start_speed_sd(&self) -> f64 {
        let most = self.setup.settings.process.start_velocity_sd;
        match self.median_landmark() {
            Some((rho, _)) => most.min(RANGES_PER_SECOND / rho),
            None => most,
        }
    }
}
