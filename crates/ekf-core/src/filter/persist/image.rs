//! What a snapshot holds. Every struct is destructured field by field, so a new field does not compile until somebody decides
//! here whether it is kept.

use super::odometry_image::OdometryImage;
use super::snapshot::{open, seal};
use crate::batch::Workspace;
use crate::camera::Camera;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::sources::Scratch;
use crate::filter::memory::candidate::{Candidate, CandidateImage};
use crate::filter::memory::handed::{Handed, Handover};
use crate::filter::memory::pose_ring::KeptPoses;
use crate::filter::memory::record::FeatureRecord;
use crate::filter::memory::undo::Undo;
use crate::gauge::Gauge;
use crate::guard::LAST_TIME;
use crate::local::{Buffers, OutsideSet, OutsideSetImage};
use crate::math::quat;
use crate::misfit::Misfit;
use crate::observe::point::CameraPose;
use crate::placed::Placed;
use crate::settings::{Settings, Value};
use crate::state::{Layout, State, StateImage, handed_on_dim};
use crate::{guard, validate};
use nalgebra::{Matrix6, Vector3};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::sync::OnceLock;

impl Filter {
    /// The filter as bytes, for [`Self::restore`].
    pub fn snapshot(&self) -> Vec<u8> {
        let body = postcard::to_stdvec(&self.image()).expect("lists of numbers and names");
        seal(&body)
    }

    /// The filter of a snapshot.
    ///
    /// # Errors
    /// `BadSnapshot` if the bytes are cut short, altered or of another version, or describe no filter.
    pub fn restore(bytes: &[u8]) -> Result<Self, EkfError> {
        let (image, rest) = postcard::take_from_bytes(open(bytes)?).map_err(|error| {
            EkfError::bad_snapshot(format!("its body is not readable ({error})"))
        })?;
        if !rest.is_empty() {
            return Err(EkfError::bad_snapshot(
                "its body has bytes that mean nothing",
            ));
        }
        Self::from_image(image)
    }
}

#[derive(Serialize, Deserialize)]
struct FilterImage {
    settings: Vec<(String, Value)>,
    camera: CameraImage,
    worn_cameras: Vec<CameraImage>,
    state: StateImage,
    time: Option<f64>,
    started: bool,
    records: Vec<(u64, FeatureRecord)>,
    candidates: Vec<(u64, CandidateImage)>,
    next_candidate: u64,
    kept_poses: KeptPoses,
    /// Covariance of the map's place in W.
    placed: Vec<f64>,
    /// Where the map was last handed on; up to which id landmarks are a known map's.
    handed: Option<HandedImage>,
    known: u64,
    /// NIS of all updates, and their degrees of freedom.
    misfit: (f64, f64),
    odometry: OdometryImage,
    moved_by: f64,
    /// Features that the gauge follows.
    followed: Vec<u64>,
    outside: Option<OutsideSetImage>,
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

impl Filter {
    fn image(&self) -> FilterImage {
        let Self {
            settings,
            camera,
            worn_cameras,
            state,
            time,
            started,
            records,
            candidates,
            next_candidate,
            kept_poses,
            batch,
            placed,
            handover,
            misfit,
            odometry,
            wheels,
            gauge,
            outside,
            // Buffers, and what is worked out again when it is asked for.
            test: _,
            in_view: _,
            scratch: _,
            buffers: _,
            undo: _,
            shown: _,
        } = self;
        FilterImage {
            settings: settings.values(),
            camera: CameraImage::of(camera),
            worn_cameras: worn_cameras.iter().map(CameraImage::of).collect(),
            state: state.image(),
            time: *time,
            started: *started,
            records: records.iter().map(|(&id, r)| (id, r.clone())).collect(),
            candidates: candidates.iter().map(|(&id, c)| (id, c.image())).collect(),
            next_candidate: *next_candidate,
            kept_poses: kept_poses.clone(),
            placed: placed.0.as_slice().to_vec(),
            handed: handover.last.as_ref().map(handed_image),
            known: handover.known,
            misfit: (misfit.nis, misfit.dof),
            odometry: OdometryImage::of(odometry, wheels),
            moved_by: batch.moved_by(),
            followed: gauge.followed().to_vec(),
            outside: outside.as_ref().map(|outside| outside.image(state)),
        }
    }

    fn from_image(image: FilterImage) -> Result<Self, EkfError> {
        let FilterImage {
            settings,
            camera,
            worn_cameras,
            state,
            time,
            started,
            records,
            candidates,
            next_candidate,
            kept_poses,
            placed,
            handed,
            known,
            misfit: (nis, dof),
            odometry,
            moved_by,
            followed,
            outside,
        } = image;
        let settings = Settings::from_values(&settings).map_err(|error| {
            EkfError::bad_snapshot(format!("its settings are not this program's ({error})"))
        })?;
        let worn_cameras = worn_cameras.iter().map(CameraImage::camera);
        let worn_cameras = worn_cameras.collect::<Result<Vec<_>, _>>()?;
        let state = State::from_image(&state)?;
        let handed_on = handed_on_dim(worn_cameras.len());
        if state.layout.submap().is_some_and(|(_, n)| n != handed_on) {
            return Err(EkfError::bad_snapshot(
                "what its submap was handed is of other worn cameras",
            ));
        }
        if ![0, worn_cameras.len()].contains(&state.clocks.len()) {
            return Err(EkfError::bad_snapshot(
                "its clocks are of other worn cameras",
            ));
        }
        let outside = outside
            .map(|outside| OutsideSet::from_image(outside, &state))
            .transpose()?;
        if outside.is_some() != state.auxiliary_blocks().next().is_some() {
            return Err(EkfError::bad_snapshot(
                "its working set and its state disagree",
            ));
        }
        let increasing = followed.windows(2).all(|w| w[0] < w[1]);
        if !increasing
            || followed
                .last()
                .is_some_and(|&id| id >= state.layout.next_id())
        {
            return Err(EkfError::bad_snapshot(
                "the features that it follows are impossible",
            ));
        }
        if time.is_some_and(|t| !t.is_finite() || t.abs() > LAST_TIME) || !moved_by.is_finite() {
            return Err(EkfError::bad_snapshot("its time is impossible"));
        }
        let records = records_of(records, &state.layout, outside.as_ref())?;
        let candidates = candidates_of(candidates, next_candidate, &state.layout)?;
        kept_poses.check(&state.layout, time, LAST_TIME)?;
        let placed = of_frame(placed, "its map's place is no 6x6 matrix")?;
        if ![nis, dof].iter().all(|v| v.is_finite() && *v >= 0.0) {
            return Err(EkfError::bad_snapshot(
                "its normalised innovations are impossible",
            ));
        }
        let misfit = Misfit { nis, dof };
        let last = handed.map(|last| handed_of(last, &misfit)).transpose()?;
        let (odometry, wheels) = odometry.restored()?;
        let mut batch = Workspace::default();
        batch.remember_move(moved_by);
        let filter = Self {
            camera: camera.camera()?,
            worn_cameras,
            settings,
            state,
            time,
            started,
            records,
            candidates,
            next_candidate,
            kept_poses,
            batch,
            test: validate::Workspace::default(),
            placed: Placed(placed),
            handover: Handover { last, known },
            misfit,
            odometry,
            wheels,
            gauge: Gauge::following(followed),
            in_view: Vec::new(),
            scratch: Scratch::default(),
            outside,
            buffers: Buffers::default(),
            undo: Undo::default(),
            shown: OnceLock::new(),
        };
        guard::state_is_sane(&filter.state).map_err(EkfError::bad_snapshot)?;
        guard::attitude_is_sane(&filter.state).map_err(EkfError::bad_snapshot)?;
        Ok(filter)
    }
}

/// The next id, the pose `[r q]`, and NIS and degrees of freedom of the updates until then.
type HandedImage = (u64, [f64; 7], (f64, f64));

fn handed_image(handed: &Handed) -> HandedImage {
    let CameraPose { r, q } = handed.pose;
    let Misfit { nis, dof } = handed.misfit;
    (
        handed.until,
        [r.x, r.y, r.z, q[0], q[1], q[2], q[3]],
        (nis, dof),
    )
}

/// `now` is the misfit of all updates: those until then are among them.
fn handed_of((until, pose, (nis, dof)): HandedImage, now: &Misfit) -> Result<Handed, EkfError> {
    let q = quat::Quat::from_column_slice(&pose[3..]);
    if !pose.iter().all(|v| v.is_finite()) || (q.norm() - 1.0).abs() > 1e-6 {
        return Err(EkfError::bad_snapshot("its last view is impossible"));
    }
    let r = Vector3::from_column_slice(&pose[..3]);
    let pose = CameraPose { r, q };
    if !(0.0..=now.nis).contains(&nis) || !(0.0..=now.dof).contains(&dof) {
        return Err(EkfError::bad_snapshot(
            "its normalised innovations were more before",
        ));
    }
    let misfit = Misfit { nis, dof };
    Ok(Handed {
        until,
        pose,
        misfit,
    })
}

fn of_frame(entries: Vec<f64>, why: &str) -> Result<Matrix6<f64>, EkfError> {
    match <[f64; 36]>::try_from(entries) {
        Ok(entries) if entries.iter().all(|v| v.is_finite()) => {
            Ok(Matrix6::from_column_slice(&entries))
        }
        _ => Err(EkfError::bad_snapshot(why)),
    }
}

/// Each feature has its record, and nothing else has one.
fn records_of(
    records: Vec<(u64, FeatureRecord)>,
    layout: &Layout,
    outside: Option<&OutsideSet>,
) -> Result<BTreeMap<u64, FeatureRecord>, EkfError> {
    let outside: BTreeSet<u64> = outside.iter().flat_map(|outside| outside.ids()).collect();
    let inside: BTreeSet<u64> = layout.features().map(|b| b.id).collect();
    let count = records.len();
    let mut records_alone = records.iter().map(|(_, r)| r);
    let sane = records_alone.all(|r| r.last_found.is_finite());
    let records: BTreeMap<u64, FeatureRecord> = records.into_iter().collect();
    let known = |id: &u64| inside.contains(id) != outside.contains(id);
    if !sane
        || records.len() != count
        || count != inside.len() + outside.len()
        || !records.keys().all(known)
    {
        return Err(EkfError::bad_snapshot(
            "its features and their records disagree",
        ));
    }
    Ok(records)
}

fn candidates_of(
    candidates: Vec<(u64, CandidateImage)>,
    next: u64,
    layout: &Layout,
) -> Result<BTreeMap<u64, Candidate>, EkfError> {
    let mut out = BTreeMap::new();
    for (id, image) in candidates {
        let candidate = Candidate::from_image(image, layout)?;
        if id >= next || out.insert(id, candidate).is_some() {
            return Err(EkfError::bad_snapshot("a candidate's id is impossible"));
        }
    }
    Ok(out)
}
