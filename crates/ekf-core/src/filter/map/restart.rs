//! A lost camera goes on (METHOD 19): in a new map that the worn camera starts, or in one of before that it recognises.

use super::known_map::KnownMap;
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{Bearing, Measurements, UpdateReport, WornObservation};
use crate::filter::input::sources::Scratch;
use crate::guard::{check_rigid, is_covariance};
use crate::map_frame::MapFrame;
use crate::math::pose::Pose;
use nalgebra::{Matrix3, Matrix6, Vector2};

impl Filter {
    /// Starts a new map from a view of Cf, where the camera is predicted to be.
    ///
    /// What is known of the pose, which is what prediction has left of it, becomes the place of the new map in W: camera
    /// and landmarks are as certain among each other as after any start, and all are off by that one unknown motion. So they are
    /// by a way in W that the camera has `gone` in a map that may be of the wrong size, its square in m^2: half of that joins. The
    /// map of before is gone: take it with [`Self::known_map`] first to come back to it with [`Self::relocalise_in`]. Ids go
    /// on, velocities start anew. The report's `accepted` says whether there were births enough for a start
    /// (`worn.start_births`); if not, the filter is as it was.
    ///
    /// # Errors
    /// `InvalidInput` before the start, for a pair that is of a feature or a square that is none, `NonFinite` for that, and what
    /// [`Self::update`] says of its input; the filter stays as it was.
    pub fn restart(
        &mut self,
        worn: &WornObservation,
        gone: &Matrix3<f64>,
    ) -> Result<UpdateReport, EkfError> {
        self.memory.check_started()?;
        if worn.pairs.iter().any(|pair| pair.id.is_some()) {
            return Err(EkfError::InvalidInput {
                what: "worn pairs",
                why: "a new map has no features yet; give new points only".into(),
            });
        }
        let z = Measurements {
            views: vec![worn.clone()],
            ..Measurements::default()
        };
        self.check_measurements(&z, &mut Scratch::default())?;
        let what = "square of the way gone";
        if !gone.iter().all(|x| x.is_finite()) {
            return Err(EkfError::NonFinite { what });
        }
        if !is_covariance(gone) {
            let why = "it is not symmetric positive semi-definite".into();
            return Err(EkfError::InvalidInput { what, why });
        }
        let mut trial = self.clone();
        trial.leave_map(gone);
        let mut report = UpdateReport::default();
        let done = trial.update_into(&z, &mut report);
        if done.is_ok() && trial.memory.started {
            self.become_other(trial);
        } else {
            report.reject_all(&z);
        }
        Ok(report)
    }

    /// A camera at the pose of before that knows it exactly, in a frame that is as uncertain as that pose was.
    fn leave_map(&mut self, gone: &Matrix3<f64>) {
        self.make_whole();
        let pose = self.memory.state.camera_pose();
        self.memory.map_frame = MapFrame::by_pose(&pose, &self.pose_covariance()).or_gone(gone);
        self.memory.map_transfer = Default::default();
        self.memory.state.remove(|b| !b.kind.is_of_device());
        self.memory.state.reset_camera(&pose);
        self.memory.followed = Default::default();
        self.memory.records.clear();
        self.memory.candidates.clear();
        self.memory.kept_poses = Default::default();
        self.memory.started = false;
    }

    /// Puts a lost camera into another map, where its matches with that say, and forgets the map that it is in.
    ///
    /// `matches` are landmarks by their place in `map`, with their pixels in Cs; `pose`, `least`, `predicted` and the rest is as
    /// with [`Self::relocalise`]. Returns the report and the new ids of the map's landmarks, in its order; they are none where
    /// the pose was not taken, and the filter is as it was then.
    ///
    /// # Errors
    /// As [`Self::start_from_map`] and [`Self::relocalise`]; the filter stays as it was.
    pub fn relocalise_in(
        &mut self,
        map: &KnownMap,
        pose: &Pose,
        matches: &[(usize, Vector2<f64>)],
        least: Option<usize>,
        predicted: bool,
    ) -> Result<(UpdateReport, Vec<u64>), EkfError> {
        self.memory.check_started()?;
        check_rigid("pose", pose)?;
        let mut trial = Self::new(
            self.setup.settings.clone(),
            self.setup.camera.clone(),
            self.setup.worn_cameras.iter().cloned(),
        );
        trial.memory.time = self.memory.time;
        trial.memory.nis = self.memory.nis;
        trial.set_worn_clocks(self);
        trial.memory.odometry = self.memory.odometry.clone();
        trial.take_gyro_of(self);
        trial.memory.next_candidate = self.memory.next_candidate;
        let ids = trial.start_from_map_after(map, self.memory.state.layout.next_id())?;
        let bearing = |&(landmark, uv): &(usize, Vector2<f64>)| {
            let id = ids.get(landmark).ok_or(EkfError::InvalidInput {
                what: "matches",
                why: format!("there is no landmark {landmark} in a map of {}", ids.len()),
            });
            id.map(|&id| Bearing { id, uv })
        };
        let bearings: Vec<Bearing> = matches.iter().map(bearing).collect::<Result<_, _>>()?;
        let mut report = trial.relocalise(pose, &bearings, least, false)?;
        if !report.accepted {
            return Ok((report, Vec::new()));
        }
        let poses = [&trial, &*self].map(|f| {
            let (rotation, translation) = f.pose();
            Pose {
                rotation,
                translation,
            }
        });
        let covariances = [
            trial.pose_covariance(),
            self.pose_covariance(),
            Matrix6::zeros(),
        ];
        trial.half_believe(&poses, &covariances, predicted, &mut report);
        self.become_other(trial);
        Ok((report, ids))
    }
}
