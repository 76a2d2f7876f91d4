//! The scale-free start: from several views of one camera that has moved (METHOD 5).

use crate::birth::new_feature::NewFeature;
use crate::birth::several_views::{POSES, Structure};
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::guard::check_pixels;
use crate::math::{pose::Pose, quat};
use crate::observe::point::CameraPose;
use crate::state::CAMERA_DIM;
use nalgebra::{SMatrix, Vector2};

/// Points and views at most.
const MOST: (usize, usize) = (500, 20);

impl Filter {
    /// Starts at the last of several views, if they tell how the camera has moved: `views[k][i]` is the pixel of point i at
    /// `times[k]`, seconds. W is the first view; the unit is such that the mean inverse depth is `birth.undelayed_rho`.
    ///
    /// Returns the features' ids, None for a point that gives none; all are None where the views do not tell it yet, and
    /// the filter has not started then.
    ///
    /// # Errors
    /// `BadShape`, `NonFinite`, `InvalidInput` (fewer than two views, more than 20, more than 500 points, times that do not
    /// increase, a filter that has started); nothing changes then.
    pub fn start_from_views(
        &mut self,
        times: &[f64],
        views: &[Vec<Vector2<f64>>],
    ) -> Result<Vec<Option<u64>>, EkfError> {
        let count = self.check_views(times, views)?;
        let birth = &self.setup.settings.birth;
        let sigma = self.setup.settings.pixel.sigma_cs;
        let wanted = (
            birth.undelayed_rho,
            birth.max_rho_ratio,
            self.setup.settings.lost.min_matches,
        );
        let mut ids = vec![None; count];
        let Some(found) = Structure::of(&self.setup.camera, views, sigma, wanted) else {
            return Ok(ids);
        };
        self.changes();
        let origin = self.memory.state.camera_pose();
        let mut born = Vec::with_capacity(found.points.len());
        for (k, (&track, y)) in found.tracks.iter().zip(&found.points).enumerate() {
            let at = POSES + 3 * k;
            let own = found.covariance.fixed_view::<3, 3>(at, at).into_owned();
            let block = NewFeature::with_prior_depth(
                &self.setup.camera,
                &origin,
                &views[0][track],
                sigma,
                y.z,
                0.0,
            )
            .and_then(|mut new| {
                new.mean.fixed_rows_mut::<3>(3).copy_from(y);
                new.noise.fixed_view_mut::<3, 3>(3, 3).copy_from(&own);
                self.append_feature(&new)
            });
            if let Some(block) = block {
                ids[track] = Some(block.id);
                born.push((block.offset + 3, at));
            }
        }
        self.start();
        let n = times.len();
        self.place_camera(&found, times[n - 1] - times[n - 2], &born);
        Ok(ids)
    }

    /// Puts the camera where the last view was, moving as between the last two, with what P says of it and of the points
    /// `born`: their rows in the state, and in the structure's covariance.
    fn place_camera(&mut self, found: &Structure, dt: f64, born: &[(usize, usize)]) {
        let [last, before] = &found.last;
        let pose = CameraPose {
            r: last.translation,
            q: quat::from_rotation(&last.rotation),
        };
        let velocity = (last.translation - before.translation) / dt;
        let turn = quat::rotation_log(&(before.rotation.transpose() * last.rotation)) / dt;
        self.memory.state.set_part(0, &pose.r);
        self.memory.state.set_part(3, &pose.q);
        self.memory.state.set_part(7, &velocity);
        self.memory.state.set_part(10, &turn);
        self.memory.state.reference[..CAMERA_DIM]
            .copy_from_slice(&self.memory.state.x[..CAMERA_DIM]);
        let by_poses = by_poses(&pose, last, before, dt);
        let whole = &found.covariance;
        let own = by_poses * whole.fixed_view::<POSES, POSES>(0, 0) * by_poses.transpose();
        let process = &self.setup.settings.process;
        let drift = [
            process.acceleration_density,
            process.angular_acceleration_density,
        ];
        for i in 0..CAMERA_DIM {
            for j in 0..=i {
                // The mean of white noise's integral over the interval is off its end by a third of its variance.
                let white = if i == j && i >= 7 {
                    drift[(i - 7) / 3].powi(2) * dt / 3.0
                } else {
                    0.0
                };
                self.memory.state.p.set(i, j, own[(i, j)] + white);
            }
        }
        for (a, &(row, at)) in born.iter().enumerate() {
            let cross = by_poses * whole.fixed_view::<POSES, 3>(0, at);
            for j in 0..3 {
                for i in 0..CAMERA_DIM {
                    self.memory.state.p.set(i, row + j, cross[(i, j)]);
                }
            }
            for &(other_row, other_at) in &born[..a] {
                for (i, j) in (0..3).flat_map(|i| (0..3).map(move |j| (i, j))) {
                    // They share the calibration's error already.
                    let shared = self.memory.state.p.get(row + i, other_row + j);
                    let own = whole[(at + i, other_at + j)];
                    self.memory
                        .state
                        .p
                        .set(row + i, other_row + j, shared + own);
                }
            }
        }
        self.memory.state.camera_moved();
    }

    fn check_views(&self, times: &[f64], views: &[Vec<Vector2<f64>>]) -> Result<usize, EkfError> {
        let invalid = |what, why: &str| {
            Err(EkfError::InvalidInput {
                what,
                why: why.into(),
            })
        };
        if self.memory.started || self.map_size() > 0 {
            return invalid("start", "the filter has started already; make a new one");
        }
        let count = views.first().map_or(0, Vec::len);
        if count > MOST.0 || views.len() > MOST.1 {
            return invalid(
                "views",
                "there may be 500 points in 20 views at most; leave some out",
            );
        }
        if times.len() != views.len() || views.iter().any(|view| view.len() != count) {
            return Err(EkfError::BadShape {
                what: "views",
                expected: format!("{} views of {count} points", times.len()),
                got: format!(
                    "{} views of {:?}",
                    views.len(),
                    views.iter().map(Vec::len).collect::<Vec<_>>()
                ),
            });
        }
        check_pixels(views.iter().flatten())?;
        let follow = times.iter().all(|t| t.is_finite()) && times.windows(2).all(|w| w[1] > w[0]);
        if times.len() < 2 || !follow {
            return invalid(
                "times",
                "there must be at least two views, each later than the one before",
            );
        }
        Ok(count)
    }
}

/// Derivative of `[r q v w]` by the tangents of the last pose and of the one before.
fn by_poses(
    pose: &CameraPose,
    last: &Pose,
    before: &Pose,
    dt: f64,
) -> SMatrix<f64, CAMERA_DIM, POSES> {
    let mut by = SMatrix::<f64, CAMERA_DIM, POSES>::zeros();
    by.fixed_view_mut::<3, 3>(0, 0).copy_from(&last.rotation);
    by.fixed_view_mut::<4, 3>(3, 3)
        .copy_from(&quat::lift(&pose.q));
    by.fixed_view_mut::<3, 3>(7, 0)
        .copy_from(&(last.rotation / dt));
    by.fixed_view_mut::<3, 3>(7, 6)
        .copy_from(&(-before.rotation / dt));
    let step = before.rotation.transpose() * last.rotation;
    let unbend = quat::right_jacobian(&quat::rotation_log(&step))
        .try_inverse()
        .unwrap_or_else(nalgebra::Matrix3::identity);
    by.fixed_view_mut::<3, 3>(10, 3).copy_from(&(unbend / dt));
    by.fixed_view_mut::<3, 3>(10, 9)
        .copy_from(&(-unbend * step.transpose() / dt));
    by
}
