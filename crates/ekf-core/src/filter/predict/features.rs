//! Where the features of the map should appear in the image, and how well that is known (METHOD 7, step 2).

use super::visibility::{Appearance, MAYBE, rolled_appearance, visibility};
use crate::filter::ekf::Filter;
use crate::math::plus_transpose;
use crate::observe::shutter::MOTION_DIM;
use crate::observe::{ByMotion, FeatureState, POSE_DIM, PointInCamera};
use nalgebra::{Matrix2, Matrix3, SMatrix, Vector2, Vector3};

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

/// Covariance of the camera's pose, of the pose with a feature, and of the feature.
type Covariances<'a> = (
    &'a SMatrix<f64, 7, 7>,
    &'a SMatrix<f64, 7, 6>,
    &'a SMatrix<f64, 6, 6>,
);

/// Covariance of the calibration's error with the camera's pose and with a feature, and its own.
type WarpCovariances = (SMatrix<f64, 6, 7>, SMatrix<f64, 6, 6>, SMatrix<f64, 6, 6>);

impl Filter {
    /// Pixel, S and point of every feature that should be visible in Cs (METHOD 4: in front, in the image, rho > 0).
    pub fn predict_pixels(&self) -> Vec<PredictedFeature> {
        let mut seen = Vec::with_capacity(self.map_size());
        self.predict_pixels_into(&mut seen);
        seen
    }

    /// As [`Self::predict_pixels`], into a list that is reused: a warm filter allocates nothing then.
    pub fn predict_pixels_into(&self, seen: &mut Vec<PredictedFeature>) {
        seen.clear();
        let pose = self.memory.state.camera_pose();
        let shutter = self.shutter();
        let shutter = shutter.as_ref();
        let p_pose = self.memory.state.p.block::<7, 7>(0, 0);
        for block in self.memory.state.layout.features() {
            let feature = self.memory.state.feature(block);
            if let Some(view) = rolled_appearance(&self.setup.camera, &pose, &feature, shutter) {
                let (p_cross, p_own) = self.memory.state.feature_covariance(block);
                let with = |at| self.memory.state.covariance_with(at, block);
                let known = (&p_pose, &p_cross, &p_own);
                seen.push(self.expect(block.id, &feature, &view, known, &with));
            }
        }
        if let Some(outside) = self
            .memory
            .outside
            .as_ref()
            .filter(|outside| !outside.is_clear(&pose))
        {
            let seen_at = visibility(&self.setup.camera, &pose);
            let may_be = outside.maybe_in_view(&self.memory.state, |point| seen_at(point, -MAYBE));
            for (block, feature) in may_be {
                if let Some(view) = rolled_appearance(&self.setup.camera, &pose, &feature, shutter)
                {
                    let (p_cross, p_own) = outside.covariance(&self.memory.state, &block);
                    let with = |at| outside.covariance_with(&self.memory.state, at, &block);
                    let known = (&p_pose, &p_cross, &p_own);
                    seen.push(self.expect(block.id, &feature, &view, known, &with));
                }
            }
        }
        if self.memory.outside.is_some() {
            // A working set is in the order in which its features came into it.
            seen.sort_unstable_by_key(|f| f.id);
        }
    }

    /// What the calibration's error has to do with camera and feature, if it is considered; `with` says it of the feature.
    fn warp_covariances(
        &self,
        with: &dyn Fn(usize) -> SMatrix<f64, 6, 6>,
    ) -> Option<WarpCovariances> {
        let at = self.memory.state.calibration()?;
        let p = &self.memory.state.p;
        Some((p.block(at, 0), with(at), p.block(at, at)))
    }

    /// Covariance of six numbers from `at` on with the motion under the shutter.
    fn with_motion(&self, at: usize, motion: &ByMotion) -> SMatrix<f64, 6, MOTION_DIM> {
        let entries = motion
            .columns()
            .flat_map(|column| (at..at + 6).map(move |row| self.memory.state.p.get(row, column)));
        SMatrix::from_iterator(entries)
    }

    /// What the motion under the shutter adds to the covariance of a point in C; `with` says the feature's covariance with six
    /// numbers of the state.
    fn motion_covariance(
        &self,
        point: &PointInCamera,
        motion: &ByMotion,
        with: &dyn Fn(usize) -> SMatrix<f64, 6, 6>,
    ) -> Matrix3<f64> {
        let (p, at) = (&self.memory.state.p, motion.readout);
        let mut own = SMatrix::<f64, MOTION_DIM, MOTION_DIM>::zeros();
        own.fixed_view_mut::<6, 6>(0, 0)
            .copy_from(&p.block::<6, 6>(POSE_DIM, POSE_DIM));
        let of_both = p.block::<6, 1>(POSE_DIM, at);
        own.fixed_view_mut::<6, 1>(0, 6).copy_from(&of_both);
        own.fixed_view_mut::<1, 6>(6, 0)
            .copy_from(&of_both.transpose());
        own[(6, 6)] = p.get(at, at);
        let mut with_pose = SMatrix::<f64, MOTION_DIM, 7>::zeros();
        with_pose
            .fixed_view_mut::<6, 7>(0, 0)
            .copy_from(&p.block::<6, 7>(POSE_DIM, 0));
        with_pose
            .fixed_view_mut::<1, 7>(6, 0)
            .copy_from(&p.block::<1, 7>(at, 0));
        let mut with_feature = SMatrix::<f64, MOTION_DIM, 6>::zeros();
        with_feature
            .fixed_view_mut::<6, 6>(0, 0)
            .copy_from(&with(POSE_DIM));
        // The readout is the last of the six numbers that end with it.
        with_feature.set_row(6, &with(at - 5).row(5));
        let with_point =
            with_pose * point.by_pose.transpose() + with_feature * point.by_feature.transpose();
        motion.by * own * motion.by.transpose() + plus_transpose(motion.by * with_point)
    }

    /// Pixel and uncertainty of a feature that is in view, from its covariance with the pose and its own.
    pub(crate) fn expect(
        &self,
        id: u64,
        feature: &FeatureState,
        view: &Appearance,
        (p_pose, p_cross, p_own): Covariances<'_>,
        with: &dyn Fn(usize) -> SMatrix<f64, 6, 6>,
    ) -> PredictedFeature {
        let Appearance {
            point,
            uv,
            by_point,
            by_motion,
        } = view;
        let mut point_cov = point.by_pose * p_pose * point.by_pose.transpose()
            + point.by_feature * p_own * point.by_feature.transpose()
            + plus_transpose(point.by_pose * p_cross * point.by_feature.transpose());
        if let Some(motion) = by_motion {
            point_cov += self.motion_covariance(point, motion, with);
        }
        let range = point.value.norm();
        let along = point.value / range;
        let range_var = (along.transpose() * point_cov * along)[(0, 0)].max(0.0);
        let sigma2 = self.setup.settings.pixel.sigma_cs.powi(2);
        let mut s = by_point * point_cov * by_point.transpose() + Matrix2::identity() * sigma2;
        if let Some((with_pose, with_feature, own)) = self.warp_covariances(with) {
            let by_warp = self.setup.camera.warp_jacobian(uv);
            let mut by_state =
                with_pose * point.by_pose.transpose() + with_feature * point.by_feature.transpose();
            if let (Some(motion), Some(at)) = (by_motion, self.memory.state.calibration()) {
                by_state += self.with_motion(at, motion) * motion.by.transpose();
            }
            let both = by_warp * by_state * by_point.transpose();
            s += by_warp * own * by_warp.transpose() + both + both.transpose();
        }
        PredictedFeature {
            id,
            uv: *uv,
            s,
            point: feature.point().unwrap_or_default(),
            rho: 1.0 / range,
            rho_sd: range_var.sqrt() / (range * range),
        }
    }
}
