//! Births that the worn camera or another source of depth makes possible (METHOD 5, 6, 10).

use crate::birth::new_feature::{FirstPoseCovariance, NewFeature};
use crate::error::EkfError;
use crate::filter::ekf::Filter;
use crate::filter::input::measurements::{
    DepthObservation, MeasurementOutcome, Measurements, UpdateReport, WornObservation,
};
use crate::guard;
use crate::guard::{check_pose, is_covariance};
use crate::math::pose::Pose;
use crate::observe::point::CameraPose;
use crate::state::{Block, BlockKind, Covariance, ErrorOwner};
use nalgebra::{Cholesky, Const, Matrix3, Matrix6, SMatrix, Vector3, Vector6};

/// Standard deviation, as a share of rho, with which the tight form starts a matched feature before its pixel in Cf is
/// measured.
const TIGHT_RHO_RATIO: f64 = 2.0;

/// A frame's error of T_CF, which all births of its view share.
struct SharedError {
    at: usize,
    inverse: Cholesky<f64, Const<6>>,
}

impl SharedError {
    /// That at an offset in the state; `None` where it is exact in some direction.
    fn of(p: &Covariance, at: usize) -> Option<Self> {
        let inverse = p.block::<6, 6>(at, at).cholesky()?;
        Some(Self { at, inverse })
    }

    /// How much of the variance of a number of the state comes from it.
    fn explains(&self, p: &Covariance, number: usize) -> f64 {
        let with = Vector6::from_fn(|i, _| p.get(number, self.at + i));
        with.dot(&self.inverse.solve(&with))
    }
}

impl Filter {
    pub(crate) fn start_tight_births(
        &mut self,
        z: &Measurements,
        report: &mut UpdateReport,
    ) -> Vec<(usize, u64)> {
        let Some(worn) = z.first_view() else {
            return Vec::new();
        };
        // The frame that the pairs are of, whose pose is a clone if it is an earlier one.
        let frame = worn
            .capture
            .and_then(|c| self.memory.offset_of_frame(c.frame).ok());
        let frame = frame.unwrap_or(0);
        let pose = self.memory.state.pose_at(frame);
        let beside = WornObservation {
            t_cf: self.seen_from(&pose, &worn.t_cf),
            pairs: Vec::new(),
            ..worn.clone()
        };
        if frame > 0 {
            // Only features of one view share an anchor.
            self.memory.state.camera_moved();
        }
        let sigma = self.setup.settings.pixel.sigma_cs;
        let mut newborn = Vec::new();
        for (i, pair) in worn.pairs.iter().enumerate() {
            let (None, Some(uv)) = (pair.id, pair.uv) else {
                continue;
            };
            let new = self.intersect(&beside, &uv, &pair.uv_f).and_then(|view| {
                let sd = TIGHT_RHO_RATIO * view.rho;
                let camera = &self.setup.camera;
                // How the camera moved in an earlier frame is not known any more.
                let unrolled = (frame == 0).then(|| self.unrolled(&uv, view.rho));
                let uv = unrolled.as_ref().map_or(uv, |unrolled| unrolled.uv);
                let mut new =
                    NewFeature::with_prior_depth(camera, &pose, &uv, sigma, view.rho, sd)?;
                if frame > 0 {
                    new.seen_from_first_pose(FirstPoseCovariance::InState(frame));
                }
                if let Some(offset) = self.worn_error_offset(worn.who) {
                    let roll = self.worn_roll(worn.who, &pair.uv_f);
                    new.share_worn_error(offset, &view.rho_by_tangent(), roll);
                }
                if let Some(unrolled) = &unrolled {
                    new.share_motion(unrolled);
                    new.follow_own_range(unrolled);
                }
                Some((new, view.rho_by_tangent()))
            });
            report.views[0][i] = MeasurementOutcome::NotVisible;
            let born = new.and_then(|(new, by_error)| Some((self.append_feature(&new)?, by_error)));
            if let Some((Block { id, offset, .. }, by_error)) = born {
                if let Some(told) = &mut self.workspace.told {
                    told.follows(offset + 5, &by_error);
                }
                newborn.push((i, id));
                report.views[0][i] = MeasurementOutcome::Born(id);
            }
        }
        if frame > 0 {
            self.memory.state.camera_moved();
        }
        newborn
    }

    /// A pose relative to the camera's present one, as it is relative to another pose of the state.
    fn seen_from(&self, other: &CameraPose, relative: &Pose) -> Pose {
        let now = self.memory.state.camera_pose();
        if *other == now {
            return relative.clone();
        }
        let [other, now] = [other, &now].map(|pose| Pose::from_quat(pose.r, &pose.q));
        other.inverse().compose(&now.compose(relative))
    }

    pub(crate) fn judge_tight_births(
        &mut self,
        newborn: &[(usize, u64)],
        z: &Measurements,
        report: &mut UpdateReport,
    ) {
        let largest = self.setup.settings.birth.max_rho_ratio;
        let worn = z.first_view();
        let error = worn.and_then(|worn| self.worn_error_offset(worn.who));
        let shared = error.and_then(|at| SharedError::of(&self.memory.state.p, at));
        let mut gone = Vec::new();
        for &(i, id) in newborn {
            if report.views[0][i] != MeasurementOutcome::Born(id) {
                gone.push(id);
            } else if let Ok(block) = self.memory.feature_block(id) {
                let rho = self.memory.state.feature(&block).scale();
                let p = &self.memory.state.p;
                let variance = p.get(block.offset + 5, block.offset + 5).max(0.0);
                let explained = shared.as_ref().map(|e| e.explains(p, block.offset + 5));
                let own = (variance - explained.unwrap_or(0.0)).max(0.0);
                if rho <= 0.0 || own.sqrt() > largest * rho {
                    gone.push(id);
                    report.views[0][i] = MeasurementOutcome::TooUncertain;
                }
            }
        }
        self.remove_blocks(&gone);
    }

    pub(crate) fn instant_births(&mut self, z: &Measurements, report: &mut UpdateReport) {
        let Some(worn) = z.first_view() else { return };
        let pose = self.memory.state.camera_pose();
        let (sigma, sigma_f) = (
            self.setup.settings.pixel.sigma_cs,
            self.setup.settings.pixel.sigma_cf,
        );
        for (i, pair) in worn.pairs.iter().enumerate() {
            if pair.id.is_some() {
                continue;
            }
            let Some((view, unrolled)) = self.intersect_unrolled(worn, pair) else {
                report.views[0][i] = MeasurementOutcome::NotVisible;
                continue;
            };
            let variance = self.rho_variance(worn, &view, &pair.uv_f);
            if variance.sqrt() > self.setup.settings.birth.max_rho_ratio * view.rho {
                report.views[0][i] = MeasurementOutcome::TooUncertain;
                continue;
            }
            let warp = self.setup.camera.warp_jacobian(&unrolled.uv);
            let mut new = NewFeature::from_two_views(&pose, &view, &warp, (sigma, sigma_f));
            new.share_motion(&unrolled);
            let by_error = view.rho_by_tangent();
            match self.worn_error_offset(worn.who) {
                Some(offset) => {
                    let roll = self.worn_roll(worn.who, &pair.uv_f);
                    new.share_worn_error(offset, &by_error, roll);
                }
                None => {
                    let own = by_error * self.worn_covariance(worn) * by_error.transpose();
                    new.noise[(5, 5)] += own[(0, 0)];
                }
            }
            new.follow_own_range(&unrolled);
            let born = self.append_feature(&new);
            report.views[0][i] = born.map_or(MeasurementOutcome::NotVisible, |block| {
                MeasurementOutcome::Born(block.id)
            });
        }
    }

    pub(crate) fn depth_births(&mut self, z: &Measurements, report: &mut UpdateReport) {
        let pose = self.memory.state.camera_pose();
        for (i, depth) in z.depths.iter().enumerate() {
            if depth.id.is_some() {
                continue;
            }
            if let Some((point, noise)) = self.point_at_depth(depth) {
                let new = NewFeature::from_point(&pose, &point, &noise, None);
                let born = self.append_feature(&new);
                report.depths[i] = born.map_or(MeasurementOutcome::NotVisible, |block| {
                    MeasurementOutcome::Born(block.id)
                });
            }
        }
    }

    pub(crate) fn point_at_depth(
        &self,
        depth: &DepthObservation,
    ) -> Option<(Vector3<f64>, Matrix3<f64>)> {
        let range = self.setup.camera.unproject(&depth.uv)?.z / depth.depth;
        let uv = self.unrolled(&depth.uv, range).uv;
        let (ray, by_uv) = self.setup.camera.unproject_jac(&uv)?;
        if ray.z < 1e-3 {
            return None;
        }
        // p = depth * ray / ray_z
        let unit = ray / ray.z;
        let by_pixel = (by_uv - unit * by_uv.fixed_view::<1, 2>(2, 0)) * (depth.depth / ray.z);
        let noise = by_pixel * by_pixel.transpose() * self.setup.settings.pixel.sigma_cs.powi(2)
            + unit * unit.transpose() * depth.sigma.powi(2);
        Some((unit * depth.depth, noise))
    }

    /// Adds points of known position in C, of a rigid target in view, to the map (METHOD 10); a filter that has not started does so
    /// from them. Their places relative to each other are known as well as `noise` says, whatever becomes of the error that they
    /// share, so that later bearings of them are metric.
    ///
    /// `points` are metres in C, `noise` is the covariance of each by itself, `shared` its derivative by the 6-number error
    /// of the target's pose, whose covariance is `covariance`. Returns the features' ids.
    ///
    /// # Errors
    /// `BadShape` if the lists differ in length, `NonFinite`, `InvalidInput` for no points, one at the camera's centre, or a
    /// covariance that is none; nothing changes then.
    pub fn add_points(
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
        let all = points.iter().flat_map(|p| p.iter());
        let all = all.chain(noise.iter().flat_map(|m| m.iter()));
        let mut all = all.chain(shared.iter().flat_map(|m| m.iter()));
        if !all.all(|x| x.is_finite()) {
            return Err(EkfError::NonFinite {
                what: "points, noise or shared",
            });
        }
        if points.is_empty() || points.iter().any(|p| p.norm() < 1e-6) {
            return Err(EkfError::InvalidInput {
                what: "points",
                why: "there must be at least one, none of them at the camera's centre".into(),
            });
        }
        if !noise.iter().all(is_covariance) {
            return Err(EkfError::InvalidInput {
                what: "noise",
                why: "each must be symmetric positive semi-definite".into(),
            });
        }
        guard::lengths("points", points.iter().flat_map(|p| p.iter()))?;
        guard::variances("noise", noise.iter().flat_map(|m| m.iter()))?;
        guard::variances("shared", shared.iter().flat_map(|m| m.iter()))?;
        check_pose(&Pose::identity(), covariance)?;
        self.changes();
        let mark = self.memory.state.mark();
        let error = self.memory.state.append(
            BlockKind::WornError(ErrorOwner::Common),
            &Vector6::zeros(),
            &[],
            covariance,
        );
        let pose = self.memory.state.camera_pose();
        let born: Option<Vec<u64>> = (0..points.len())
            .map(|i| {
                let shared = Some((error.offset, &shared[i]));
                let new = NewFeature::from_point(&pose, &points[i], &noise[i], shared);
                self.append_feature(&new).map(|block| block.id)
            })
            .collect();
        let born = born.filter(|_| guard::state_is_sane(&self.memory.state).is_ok());
        let Some(ids) = born else {
            self.memory.take_back(&mark);
            return Err(EkfError::InvalidInput {
                what: "noise, shared or covariance",
                why: "its numbers are out of all bounds; give metres".into(),
            });
        };
        self.memory.state.remove(|b| b.id == error.id);
        if !self.memory.started {
            self.start();
        }
        Ok(ids)
    }
}
