//! What a filter remembers from step to step, and its last checkpoint.

pub(super) mod candidate;
pub(super) mod followed;
pub(super) mod guess;
pub(super) mod last_view;
pub(super) mod map_transfer;
pub(super) mod pose_ring;
pub(super) mod record;
pub(super) mod undo;
pub(super) mod wheels;

use crate::error::EkfError;
use crate::imu::Imu;
use crate::local::OutsideSet;
use crate::map_frame::MapFrame;
use crate::nis_accumulator::NisAccumulator;
use crate::observe::POSE_DIM;
use crate::odometry::Odometry;
use crate::state::{Block, BlockKind, LinearPart, Mark, State};
use candidate::Candidate;
use followed::Followed;
use guess::Guess;
use last_view::LastView;
use map_transfer::MapTransfer;
use nalgebra::{DMatrix, SMatrix, SVector};
use pose_ring::KeptPoses;
use record::FeatureRecord;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use wheels::Wheels;

/// All that outlives a step: what a checkpoint copies and a snapshot writes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub(crate) struct Memory {
    /// Mean, covariance, layout; in a large map those of the working set. A snapshot has them in a form of their own.
    #[serde(skip)]
    pub(crate) state: State,
    /// What is outside of the working set, in a large map.
    #[serde(skip)]
    pub(crate) outside: Option<OutsideSet>,
    pub(crate) time: Option<f64>,
    pub(crate) started: bool,
    pub(crate) records: BTreeMap<u64, FeatureRecord>,
    pub(crate) candidates: BTreeMap<u64, Candidate>,
    pub(crate) next_candidate: u64,
    /// Poses of the last second, for views of Cf that come late.
    pub(crate) kept_poses: KeptPoses,
    pub(crate) map_frame: MapFrame,
    pub(crate) map_transfer: MapTransfer,
    /// The last view of each worn camera.
    pub(crate) last_views: Vec<LastView>,
    pub(crate) nis: NisAccumulator,
    pub(crate) odometry: Odometry,
    pub(crate) wheels: Wheels,
    /// The gyroscope's samples, where there is one.
    pub(crate) imu: Option<Imu>,
    /// Features that P is carried along with.
    pub(crate) followed: Followed,
    /// Largest change that the last update made to a number of the camera's pose.
    pub(crate) moved_by: f64,
    /// Frames predicted since the last one that was used.
    pub(crate) unused: u32,
    /// Features born with a vague depth of late.
    pub(crate) guesses: Vec<Guess>,
    /// How well the logarithm of the lengths of worn cameras' T_CF is known that have been doubted, standard deviations.
    pub(crate) length_sds: BTreeMap<usize, f64>,
}

impl Memory {
    /// Adds error modes, columns of as many numbers as the state's P has stored rows, in standard deviations.
    pub(crate) fn add_error_modes(&mut self, columns: &[f64]) {
        let outside = self.outside.as_ref();
        self.state
            .add_error_modes(columns, |state, modes| match outside {
                Some(outside) => outside.modes_of_some(state, modes),
                None => DMatrix::zeros(modes.kind.dim(), modes.kind.dim()),
            });
    }

    /// Copies another one into the storage of this one, but for what is outside of the working set.
    pub(crate) fn copy_from(&mut self, other: &Self) {
        let Self {
            state,
            outside: _,
            time,
            started,
            records,
            candidates,
            next_candidate,
            kept_poses,
            map_frame,
            map_transfer,
            last_views,
            nis,
            odometry,
            wheels,
            imu,
            followed,
            moved_by,
            unused,
            guesses,
            length_sds,
        } = other;
        self.state.copy_from(state);
        self.time = *time;
        self.started = *started;
        self.records.clone_from(records);
        self.candidates.clone_from(candidates);
        self.next_candidate = *next_candidate;
        self.kept_poses.clone_from(kept_poses);
        self.map_frame = *map_frame;
        self.map_transfer = *map_transfer;
        self.last_views.clone_from(last_views);
        self.nis = *nis;
        self.odometry.clone_from(odometry);
        self.wheels = *wheels;
        self.imu.clone_from(imu);
        self.followed.clone_from(followed);
        self.moved_by = *moved_by;
        self.unused = *unused;
        self.guesses.clone_from(guesses);
        self.length_sds.clone_from(length_sds);
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

    pub(crate) fn feature_block(&self, id: u64) -> Result<Block, EkfError> {
        match self.state.layout.find(id) {
            Some(block) if block.kind.is_feature() => Ok(*block),
            _ => Err(EkfError::UnknownFeature { id }),
        }
    }

    /// Whether there is a feature with this id.
    pub(crate) fn known(&self, id: u64) -> Result<(), EkfError> {
        if self.outside.as_ref().is_some_and(|outside| outside.has(id)) {
            return Ok(());
        }
        self.feature_block(id).map(|_| ())
    }

    /// Number of features in the map.
    pub(crate) fn map_size(&self) -> usize {
        let outside = self.outside.as_ref().map_or(0, OutsideSet::len);
        self.state.layout.features().count() + outside
    }

    /// Takes away what was appended since `mark`.
    pub(crate) fn take_back(&mut self, mark: &Mark) {
        self.state.take_back(mark);
        self.followed.forget_from(self.state.layout.next_id());
        let (state, outside) = (&self.state, &self.outside);
        self.records.retain(|&id, _| {
            state.layout.find(id).is_some()
                || outside.as_ref().is_some_and(|outside| outside.has(id))
        });
    }

    /// Appends the camera's present pose to the state; returns its block.
    pub(crate) fn clone_pose(&mut self) -> u64 {
        let identity = SMatrix::<f64, 7, 7>::identity();
        let mean: SVector<f64, 7> = self.state.part::<7>(0);
        let part = LinearPart {
            offset: 0,
            width: POSE_DIM,
            matrix: identity.as_slice(),
        };
        let noise = SMatrix::zeros();
        let block = self.state.append(BlockKind::Clone, &mean, &[part], &noise);
        block.id
    }

    /// Forgets the poses that were kept.
    pub(crate) fn forget_poses(&mut self) {
        let ids: Vec<u64> = self.kept_poses.ids().collect();
        self.state.remove(|b| ids.contains(&b.id));
        self.kept_poses.poses.clear();
    }

    /// Where the pose of the frame at `t` is in the state.
    pub(crate) fn offset_of_frame(&self, t: f64) -> Result<usize, EkfError> {
        if self.time == Some(t) {
            return Ok(0);
        }
        let kept = self.kept_poses.poses.iter().find(|(at, _)| *at == t);
        let block = kept.and_then(|(_, id)| self.state.layout.find(*id));
        let why = || format!("no pose is kept of a frame at {t} s; take one of kept_times");
        let what = "frame";
        let offset = block.map(|block| block.offset);
        offset.ok_or_else(|| EkfError::InvalidInput { what, why: why() })
    }
}
