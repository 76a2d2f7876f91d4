//! What a snapshot holds: setup, state, what is outside of the working set, and all else that is remembered, as
//! [`Memory`] lists it.

use super::snapshot::{open, seal};
use crate::camera::Camera;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::memory::Memory;
use crate::filter::memory::last_view::LastView;
use crate::filter::setup::Setup;
use crate::guard;
use crate::imu::Imu;
use crate::local::{OutsideSet, OutsideSetImage};
use crate::settings::{Settings, Value};
use crate::stamps::{self, LAST_TIME};
use crate::state::{BlockKind, State, StateImage, transferred_dim};
use serde::{Deserialize, Serialize};
use std::collections::BTreeSet;

/// Of a filter; the last one is borrowed when it is written.
type Image<M> = (SetupImage, StateImage, Option<OutsideSetImage>, M);

impl Filter {
    /// The filter as bytes, for [`Self::restore`].
    pub fn snapshot(&self) -> Vec<u8> {
        let Memory { state, outside, .. } = &self.memory;
        let outside = outside.as_ref().map(|outside| outside.image(state));
        let setup = SetupImage::of(&self.setup);
        let image: Image<&Memory> = (setup, state.image(), outside, &self.memory);
        seal(&postcard::to_stdvec(&image).expect("lists of numbers and names"))
    }

    /// The filter of a snapshot.
    ///
    /// # Errors
    /// `BadSnapshot` if the bytes are cut short, altered or of another version, or describe no filter.
    pub fn restore(bytes: &[u8]) -> Result<Self, EkfError> {
        let read = postcard::take_from_bytes::<Image<Memory>>(open(bytes)?);
        let ((setup, state, outside, mut memory), rest) = read.map_err(|error| {
            EkfError::bad_snapshot(format!("its body is not readable ({error})"))
        })?;
        if !rest.is_empty() {
            return Err(EkfError::bad_snapshot(
                "its body has bytes that mean nothing",
            ));
        }
        let setup = setup.restored()?;
        memory.state = State::from_image(&state)?;
        memory.outside = outside
            .map(|outside| OutsideSet::from_image(outside, &memory.state))
            .transpose()?;
        check(&memory, &setup)?;
        Ok(Self::of(setup, memory))
    }
}

#[derive(Serialize, Deserialize)]
struct SetupImage {
    settings: Vec<(String, Value)>,
    camera: CameraImage,
    worn_cameras: Vec<CameraImage>,
}

impl SetupImage {
    fn of(setup: &Setup) -> Self {
        Self {
            settings: setup.settings.values(),
            camera: CameraImage::of(&setup.camera),
            worn_cameras: setup.worn_cameras.iter().map(CameraImage::of).collect(),
        }
    }

    fn restored(&self) -> Result<Setup, EkfError> {
        let settings = Settings::from_values(&self.settings).map_err(|error| {
            EkfError::bad_snapshot(format!("its settings are not this program's ({error})"))
        })?;
        let worn_cameras = self.worn_cameras.iter().map(CameraImage::camera);
        Ok(Setup {
            settings,
            camera: self.camera.camera()?,
            worn_cameras: worn_cameras.collect::<Result<_, _>>()?,
        })
    }
}

#[derive(Serialize, Deserialize)]
struct CameraImage {
    model: String,
    size: (u32, u32),
    intrinsics: [f64; 4],
    distortion: Vec<f64>,
}

impl CameraImage {
    pub(crate) fn of(camera: &Camera) -> Self {
        Self {
            model: camera.model().into(),
            size: (camera.width, camera.height),
            intrinsics: [camera.fx, camera.fy, camera.cx, camera.cy],
            distortion: camera.distortion_parameters().to_vec(),
        }
    }

    pub(crate) fn camera(&self) -> Result<Camera, EkfError> {
        let (width, height) = self.size;
        let made = Camera::new(
            &self.model,
            width,
            height,
            self.intrinsics,
            &self.distortion,
        );
        made.map_err(|error| {
            EkfError::bad_snapshot(format!("a camera in it is impossible ({error})"))
        })
    }
}

/// Whether what was read agrees with itself and with the cameras.
fn check(memory: &Memory, setup: &Setup) -> Result<(), EkfError> {
    let bad = |why| Err(EkfError::bad_snapshot(why));
    let (state, outside) = (&memory.state, memory.outside.as_ref());
    let persons = setup.worn_cameras.len();
    let layout = &state.layout;
    let transferred = transferred_dim(persons);
    if layout.submap().is_some_and(|(_, n)| n != transferred) {
        return bad("what its submap was handed is of other worn cameras");
    }
    if ![0, persons].contains(&state.clocks.len()) {
        return bad("its clocks are of other worn cameras");
    }
    if outside.is_some() != state.auxiliary_blocks().next().is_some() {
        return bad("its working set and its state disagree");
    }
    if !memory.followed.is_sane(layout.next_id()) {
        return bad("the features that it follows are impossible");
    }
    let mut guesses = memory.guesses.iter();
    if !guesses.all(|guess| guess.is_sane(layout.next_id())) {
        return bad("its guesses of depth are impossible");
    }
    let mut doubted = memory.length_sds.values();
    if !doubted.all(|sd| (0.0..=1.0).contains(sd)) {
        return Err(EkfError::bad_snapshot(
            "it doubts lengths by no number from 0 to 1",
        ));
    }
    if !memory.time.is_none_or(stamps::is_sane) || !memory.moved_by.is_finite() {
        return bad("its time is impossible");
    }
    check_records(memory)?;
    for (&id, candidate) in &memory.candidates {
        candidate.check(layout)?;
        if id >= memory.next_candidate {
            return bad("a candidate's id is impossible");
        }
    }
    memory.kept_poses.check(layout, memory.time, LAST_TIME)?;
    memory.nis.check(&memory.nis)?;
    memory.map_transfer.check(&memory.nis)?;
    memory.last_views.iter().try_for_each(LastView::check)?;
    memory.odometry.check()?;
    check_imu(memory)?;
    guard::state_is_sane(state).map_err(EkfError::bad_snapshot)?;
    guard::attitude_is_sane(state).map_err(EkfError::bad_snapshot)
}

/// Each feature has its record, and nothing else has one.
fn check_records(memory: &Memory) -> Result<(), EkfError> {
    let outside = memory.outside.iter();
    let outside: BTreeSet<u64> = outside.flat_map(|outside| outside.ids()).collect();
    let inside: BTreeSet<u64> = memory.state.layout.features().map(|b| b.id).collect();
    let records = &memory.records;
    let known = |id: &u64| inside.contains(id) != outside.contains(id);
    if !records.values().all(|record| record.last_found.is_finite())
        || records.len() != inside.len() + outside.len()
        || !records.keys().all(known)
    {
        return Err(EkfError::bad_snapshot(
            "its features and their records disagree",
        ));
    }
    Ok(())
}

/// A gyroscope has its blocks, and none has them without.
fn check_imu(memory: &Memory) -> Result<(), EkfError> {
    let count = |kind| memory.state.layout.of_kind(kind).count();
    let kinds = [
        BlockKind::GyroBias,
        BlockKind::GyroFrame,
        BlockKind::GyroClock,
    ];
    let there = usize::from(memory.imu.is_some());
    if kinds.into_iter().any(|kind| count(kind) != there) {
        return Err(EkfError::bad_snapshot(
            "its gyroscope and its state disagree",
        ));
    }
    memory.imu.as_ref().map_or(Ok(()), Imu::check)
}
