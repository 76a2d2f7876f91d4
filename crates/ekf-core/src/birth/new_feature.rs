//! A feature that is about to enter the state: `y = f(x_v, other parts of x, new noise)`, linearised (Eq. 8).

use super::two_view::TwoView;
use crate::camera::Camera;
use crate::math::{inverse_depth, quat};
use crate::observe::point::{CameraPose, POSE_DIM};
use crate::observe::shutter::Unrolled;
use crate::scale::LogRange;
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector2, Vector3, Vector6};

/// Mean, derivatives and noise of a newborn feature `[p(3) theta phi rho]`.
#[derive(Clone, Debug)]
pub struct NewFeature {
    /// The six numbers.
    pub mean: Vector6<f64>,
    /// Derivative by the camera's `[r q]`.
    pub by_pose: SMatrix<f64, 6, 7>,
    /// Derivatives by other parts of the state.
    pub by_others: Vec<ByPart>,
    /// Derivative by its pixel in Cs.
    pub by_pixel: SMatrix<f64, 6, 2>,
    /// Derivative by the error of Cs's calibration.
    pub by_calibration: SMatrix<f64, 6, 6>,
    /// Covariance of everything that is not in the state (pixels, and T_CF where it is independent).
    pub noise: SMatrix<f64, 6, 6>,
}

/// Derivative of a newborn feature by a part of the state.
#[derive(Clone, Copy, Debug)]
pub struct ByPart {
    /// Where the part begins.
    pub offset: usize,
    /// Its numbers.
    pub width: usize,
    /// As many columns.
    pub by: SMatrix<f64, 6, 7>,
}

impl NewFeature {
    /// Anchor and direction from a ray `h` in C; rho and its derivatives are filled in by the caller.
    fn along(pose: &CameraPose, ray: &Vector3<f64>, by_ray: &mut SMatrix<f64, 2, 3>) -> Self {
        let rotation = quat::rotation(&pose.q);
        let (angles, by_world) = inverse_depth::angles(&(rotation * ray));
        *by_ray = by_world * rotation;
        let mut mean = Vector6::zeros();
        mean.fixed_rows_mut::<3>(0).copy_from(&pose.r);
        mean.fixed_rows_mut::<2>(3).copy_from(&angles);
        let mut by_pose = SMatrix::<f64, 6, 7>::zeros();
        by_pose.fixed_view_mut::<3, 3>(0, 0).fill_with_identity();
        by_pose
            .fixed_view_mut::<2, 4>(3, 3)
            .copy_from(&(by_world * quat::rotate_jacobian(&pose.q, ray)));
        Self {
            mean,
            by_pose,
            by_others: Vec::new(),
            by_pixel: SMatrix::zeros(),
            by_calibration: SMatrix::zeros(),
            noise: SMatrix::zeros(),
        }
    }

    /// A feature seen in two views (METHOD 5). `warp` is [`Camera::warp_jacobian`] at the present pixel. The caller adds how
    /// `rho` depends on the rest of the state: on both poses in a delayed birth, on the error of T_CF in an instant one.
    pub fn from_two_views(
        pose: &CameraPose,
        view: &TwoView,
        warp: &SMatrix<f64, 2, 6>,
        (sigma_px, other_sigma_px): (f64, f64),
    ) -> Self {
        let mut by_ray = SMatrix::zeros();
        let mut new = Self::along(pose, &view.ray, &mut by_ray);
        new.mean[5] = view.rho;
        let mut by_pixel = SMatrix::<f64, 6, 2>::zeros();
        by_pixel
            .fixed_view_mut::<2, 2>(3, 0)
            .copy_from(&(by_ray * view.ray_by_pixel));
        by_pixel
            .fixed_view_mut::<1, 2>(5, 0)
            .copy_from(&view.rho_by_pixel);
        new.by_pixel = by_pixel;
        new.by_calibration = -by_pixel * warp;
        new.noise = by_pixel * by_pixel.transpose() * (sigma_px * sigma_px);
        new.noise[(5, 5)] +=
            view.rho_by_other_pixel.norm_squared() * other_sigma_px * other_sigma_px;
        new
    }

    /// One view and a prior on rho (undelayed, and the start of the tight form).
    pub fn with_prior_depth(
        camera: &Camera,
        pose: &CameraPose,
        uv: &Vector2<f64>,
        sigma_px: f64,
        rho: f64,
        rho_sd: f64,
    ) -> Option<Self> {
        let (ray, ray_by_pixel) = camera.unproject_jac(uv)?;
        let mut by_ray = SMatrix::zeros();
        let mut new = Self::along(pose, &ray, &mut by_ray);
        new.mean[5] = rho;
        let by_pixel = by_ray * ray_by_pixel;
        new.by_pixel
            .fixed_view_mut::<2, 2>(3, 0)
            .copy_from(&by_pixel);
        new.by_calibration
            .fixed_view_mut::<2, 6>(3, 0)
            .copy_from(&(-by_pixel * camera.warp_jacobian(uv)));
        new.noise
            .fixed_view_mut::<2, 2>(3, 3)
            .copy_from(&(by_pixel * by_pixel.transpose() * (sigma_px * sigma_px)));
        new.noise[(5, 5)] = rho_sd * rho_sd;
        Some(new)
    }

    /// A point of known position in C, metres, with its 3x3 covariance. `shared` is the offset in the state of an error of six
    /// numbers on which the point depends, and the point's derivative by it.
    pub fn from_point(
        pose: &CameraPose,
        point: &Vector3<f64>,
        noise: &Matrix3<f64>,
        shared: Option<(usize, &SMatrix<f64, 3, 6>)>,
    ) -> Self {
        let mut by_ray = SMatrix::zeros();
        let mut new = Self::along(pose, point, &mut by_ray);
        let rho = 1.0 / point.norm();
        new.mean[5] = rho;
        let mut by_point = SMatrix::<f64, 6, 3>::zeros();
        by_point.fixed_view_mut::<2, 3>(3, 0).copy_from(&by_ray);
        by_point
            .fixed_view_mut::<1, 3>(5, 0)
            .copy_from(&(-point.transpose() * rho.powi(3)));
        new.noise = by_point * noise * by_point.transpose();
        if let Some((offset, j)) = shared {
            new.depend_on(offset, &(by_point * j));
        }
        new
    }

    fn depend_on<const C: usize>(&mut self, offset: usize, by: &SMatrix<f64, 6, C>) {
        let mut part = ByPart {
            offset,
            width: C,
            by: SMatrix::zeros(),
        };
        part.by.fixed_view_mut::<6, C>(0, 0).copy_from(by);
        self.by_others.push(part);
    }

    pub(crate) fn rho_depends_on<const C: usize>(
        &mut self,
        offset: usize,
        by: &SMatrix<f64, 1, C>,
    ) {
        let mut all = SMatrix::<f64, 6, C>::zeros();
        all.set_row(5, by);
        self.depend_on(offset, &all);
    }

    /// Lets rho depend on the 6-number error of T_CF that sits in the state at `offset`, and on the roll that follows it, where
    /// there is one, by that share.
    pub fn share_worn_error(
        &mut self,
        offset: usize,
        rho_by_error: &SMatrix<f64, 1, 6>,
        roll: Option<f64>,
    ) {
        self.rho_depends_on(offset, rho_by_error);
        if let Some(share) = roll {
            self.rho_depends_on(offset + 6, &(rho_by_error * share));
        }
    }

    /// Lets rho depend on the error of Cs's calibration through the other view's pixel too, where that view is one of Cs.
    pub fn share_calibration(&mut self, view: &TwoView, other_warp: &SMatrix<f64, 2, 6>) {
        let mut rho = self.by_calibration.fixed_view_mut::<1, 6>(5, 0);
        rho -= view.rho_by_other_pixel * other_warp;
    }

    /// Lets the feature depend on the camera's motion under the shutter, and on its attitude, as its pixel does.
    pub fn share_motion(&mut self, unrolled: &Unrolled) {
        let by_attitude = self.by_pixel * unrolled.by_attitude;
        let mut by_pose = self.by_pose.fixed_view_mut::<6, 4>(0, 3);
        by_pose += by_attitude;
        if let Some((readout, by)) = unrolled.by_motion {
            let by = self.by_pixel * by;
            self.depend_on::<6>(POSE_DIM, &by.fixed_columns::<6>(0).into_owned());
            self.depend_on::<1>(readout, &by.fixed_columns::<1>(6).into_owned());
        }
    }

    /// Lets the feature depend on the readout as the pixel of a candidate's first view does, `by_pixel` the derivative by that.
    pub fn share_readout(
        &mut self,
        by_pixel: &SMatrix<f64, 6, 2>,
        by_readout: Option<(usize, Vector2<f64>)>,
    ) {
        if let Some((readout, by)) = by_readout {
            self.depend_on::<1>(readout, &(by_pixel * by));
        }
    }

    /// Lets rho, a share of the inverse range of a landmark from the camera as it is now, depend on both: the share is a guess, which
    /// says nothing of how large the scene is. `offset` is the landmark's in the state.
    pub(crate) fn keep_ratio(&mut self, offset: usize, range: &LogRange) {
        let rho = self.mean[5];
        let mut by_camera = self.by_pose.fixed_view_mut::<1, 3>(5, 0);
        by_camera -= range.by_camera.transpose() * rho;
        self.rho_depends_on(offset, &(range.by_feature.transpose() * -rho));
    }

    /// How far the point is says by how much the shutter has moved its pixel: lets the feature depend on its own inverse range
    /// through that, `y = f(.., uv(rho))` with rho the last of y, by all that it depends on already. So a map that grows, and the
    /// camera's velocity with it, leaves the pixel where it is. Last of all.
    pub fn follow_own_range(&mut self, unrolled: &Unrolled) {
        let through = self.by_pixel * unrolled.by_rho;
        let own = 1.0 - through[5];
        if own < 0.5 {
            // As much of rho as that from the shutter alone: there is no telling.
            return;
        }
        let closed = |by: &mut SMatrix<f64, 6, 7>| {
            let by_rho = by.row(5).into_owned();
            *by += through * by_rho / own;
        };
        closed(&mut self.by_pose);
        self.by_others
            .iter_mut()
            .for_each(|part| closed(&mut part.by));
        let rest = self.by_calibration.row(5).into_owned();
        self.by_calibration += through * rest / own;
        let mut all = Matrix6::identity();
        let mut last = all.fixed_columns_mut::<1>(5);
        last += through / own;
        self.noise = all * self.noise * all.transpose();
        self.by_pixel = all * self.by_pixel;
    }

    /// Makes a feature seen in one view depend on the pose of the candidate's first view, not on the present pose.
    pub fn seen_from_first_pose(&mut self, first_pose: FirstPoseCovariance<'_>) {
        let by = std::mem::replace(&mut self.by_pose, SMatrix::zeros());
        match first_pose {
            FirstPoseCovariance::InState(offset) => self.depend_on(offset, &by),
            FirstPoseCovariance::Independent(cov) => self.noise += by * cov * by.transpose(),
        }
    }

    /// Lets rho depend on the poses of a delayed birth's two views: `T = T_WC(now)^-1 T_WC(first)`. The first pose
    /// sits in the state at `clone_offset`, or is remembered with an independent 7x7 covariance.
    pub fn depend_on_first_pose(
        &mut self,
        now: &CameraPose,
        first: &CameraPose,
        view: &TwoView,
        first_pose: FirstPoseCovariance<'_>,
    ) {
        let r_cw = quat::rotation(&now.q).transpose();
        let t = r_cw * (first.r - now.r);
        let b_c = view.rotation * view.other_ray;
        let turn_now = view.rho_by_t * quat::skew(&t) + view.rho_by_ray * quat::skew(&b_c);
        let mut now_row = self.by_pose.fixed_view_mut::<1, 7>(5, 0);
        now_row
            .fixed_view_mut::<1, 3>(0, 0)
            .copy_from(&(-view.rho_by_t * r_cw));
        now_row
            .fixed_view_mut::<1, 4>(0, 3)
            .copy_from(&(turn_now * quat::tangent(&now.q)));
        let mut by_first = SMatrix::<f64, 1, 7>::zeros();
        by_first
            .fixed_view_mut::<1, 3>(0, 0)
            .copy_from(&(view.rho_by_t * r_cw));
        by_first.fixed_view_mut::<1, 4>(0, 3).copy_from(
            &(-view.rho_by_ray
                * view.rotation
                * quat::skew(&view.other_ray)
                * quat::tangent(&first.q)),
        );
        match first_pose {
            FirstPoseCovariance::InState(offset) => self.rho_depends_on(offset, &by_first),
            FirstPoseCovariance::Independent(cov) => {
                self.noise[(5, 5)] += (by_first * cov * by_first.transpose())[(0, 0)];
            }
        }
    }
}

/// Where the uncertainty of a delayed candidate's first pose comes from.
#[derive(Clone, Copy, Debug)]
pub enum FirstPoseCovariance<'a> {
    /// A clone in the state at this offset.
    InState(usize),
    /// A stored 7x7 covariance, as if independent.
    Independent(&'a SMatrix<f64, 7, 7>),
}
