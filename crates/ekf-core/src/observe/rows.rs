//! Rows of grad H for one measurement: 2 for a pixel, 3 for a point with depth (METHOD 4, 6, 7).
//!
//! A row touches the camera's pose (7 columns), one feature (6) and six numbers that matches share: the
//! error of T_CF for what came through the worn camera, the error of the calibration for a pixel in Cs. All other columns are
//! zero, which makes the update cheap.

use super::feature::FeatureState;
use super::point::{CameraPose, PointInCamera};
use super::shutter::{ByMotion, MOTION_DIM, Shutter};
use crate::camera::Camera;
use crate::math::{pose::Pose, quat};
use nalgebra::{Matrix3, SMatrix, Vector2, Vector3, Vector6};

/// Up to three rows of the innovation and of grad H.
#[derive(Clone, Debug)]
pub struct Rows {
    /// Number of rows in use, 2 or 3.
    pub count: usize,
    /// Measured minus predicted.
    pub innovation: Vector3<f64>,
    /// Noise covariance of the measurement.
    pub noise: Matrix3<f64>,
    /// Derivative of the prediction with respect to `[r q]`.
    pub by_pose: SMatrix<f64, 3, 7>,
    /// Derivative of the prediction with respect to the feature.
    pub by_feature: SMatrix<f64, 3, 6>,
    /// Derivative by the camera's velocities and the readout, where the shutter of Cs may roll.
    pub by_motion: Option<ByMotion>,
    /// Derivative of the prediction with respect to six numbers that matches share: the error of Cs's calibration for a pixel
    /// in Cs, the frame's error of T_CF for what came through the worn camera, how that moved for its rate.
    pub by_shared: Option<SMatrix<f64, 3, 6>>,
    /// How far down the image of Cf its row is, -1/2 to 1/2, where the state has how that camera moved while the image was read,
    /// right after the error of T_CF: the derivative by it is so much of [`Self::by_shared`].
    pub roll: Option<f64>,
}

/// Derivative of the velocity along the camera's own axes by `[q v]`.
pub(crate) type VelocityRows = SMatrix<f64, 3, 7>;

/// Rows of a pixel.
const PIXEL: usize = 2;

impl Rows {
    /// Whether it is a pixel, not a point.
    pub fn is_pixel(&self) -> bool {
        self.count == PIXEL
    }

    fn pixel(
        predicted: Vector2<f64>,
        measured: &Vector2<f64>,
        sigma: f64,
        j: &SMatrix<f64, 2, 3>,
        h: &PointInCamera,
    ) -> Self {
        let mut rows = Self {
            count: PIXEL,
            innovation: Vector3::zeros(),
            noise: Matrix3::from_diagonal(&Vector3::new(sigma * sigma, sigma * sigma, 1.0)),
            by_pose: SMatrix::zeros(),
            by_motion: None,
            by_feature: SMatrix::zeros(),
            by_shared: None,
            roll: None,
        };
        rows.innovation
            .fixed_rows_mut::<2>(0)
            .copy_from(&(measured - predicted));
        rows.by_pose
            .fixed_rows_mut::<2>(0)
            .copy_from(&(j * h.by_pose));
        rows.by_feature
            .fixed_rows_mut::<2>(0)
            .copy_from(&(j * h.by_feature));
        rows
    }

    /// A pixel in Cs (Eq. 7 then 6): `distort(project(h_C))`, from the camera's pose at the time of its row where the shutter
    /// may roll. `None` where the feature predicts nothing.
    pub fn bearing(
        camera: &Camera,
        pose: &CameraPose,
        feature: &FeatureState,
        measured: &Vector2<f64>,
        sigma_px: f64,
        shutter: Option<&Shutter>,
    ) -> Option<Self> {
        let row = shutter.map(|shutter| (shutter.offset, shutter.at(pose, measured)));
        let seen_from = row.as_ref().map_or(pose, |(_, row)| &row.pose);
        let mut h = visible_direction(seen_from, feature)?;
        let (predicted, j) = camera.project_jac(&h.value)?;
        let by_motion = row.map(|(readout, row)| {
            let (by_pose, by_motion) = row.split(&h.by_pose);
            h.by_pose = by_pose;
            let mut by = SMatrix::<f64, 3, MOTION_DIM>::zeros();
            by.fixed_rows_mut::<2>(0).copy_from(&(j * by_motion));
            ByMotion { readout, by }
        });
        let mut rows = Self::pixel(predicted, measured, sigma_px, &j, &h);
        rows.by_motion = by_motion;
        let mut by_calibration = SMatrix::<f64, 3, 6>::zeros();
        by_calibration
            .fixed_rows_mut::<2>(0)
            .copy_from(&camera.warp_jacobian(&predicted));
        rows.by_shared = Some(by_calibration);
        Some(rows)
    }

    /// A 3D point in C (Eq. 5, no projection), metres. `by_error` is the derivative of the measured point with
    /// respect to the error of T_CF, if that error is part of the state.
    pub fn depth(
        pose: &CameraPose,
        feature: &FeatureState,
        measured: &Vector3<f64>,
        noise: &Matrix3<f64>,
        worn: Option<(&Vector6<f64>, &SMatrix<f64, 3, 6>)>,
    ) -> Option<Self> {
        let h = PointInCamera::metric(pose, feature)?;
        // The true point is measured + J e, so the measured one is predicted as h - J e.
        let shift = worn.map_or(Vector3::zeros(), |(e, j)| j * e);
        Some(Self {
            count: 3,
            innovation: measured - (h.value - shift),
            noise: *noise,
            by_pose: h.by_pose,
            by_motion: None,
            by_feature: h.by_feature,
            by_shared: worn.map(|(_, j)| -j),
            roll: None,
        })
    }

    /// The camera's velocity along its own axes, m/s; `noise` are the variances. `readout` is any number of the state, on which it
    /// does not depend.
    pub(crate) fn velocity(
        innovation: Vector3<f64>,
        by: &VelocityRows,
        noise: &Vector3<f64>,
        readout: usize,
    ) -> Self {
        let mut by_pose = SMatrix::<f64, 3, 7>::zeros();
        let mut by_motion = SMatrix::<f64, 3, MOTION_DIM>::zeros();
        by_pose
            .fixed_columns_mut::<4>(3)
            .copy_from(&by.fixed_columns::<4>(0));
        by_motion
            .fixed_columns_mut::<3>(0)
            .copy_from(&by.fixed_columns::<3>(4));
        Self {
            count: 3,
            innovation,
            noise: Matrix3::from_diagonal(noise),
            by_pose,
            by_motion: Some(ByMotion {
                readout,
                by: by_motion,
            }),
            by_feature: SMatrix::zeros(),
            by_shared: None,
            roll: None,
        }
    }

    /// The last three of six numbers that matches share, measured by another sensor.
    pub fn shared_turn(innovation: Vector3<f64>, noise: Matrix3<f64>) -> Self {
        let mut by_shared = SMatrix::<f64, 3, 6>::zeros();
        by_shared.fixed_view_mut::<3, 3>(0, 3).fill_with_identity();
        Self {
            count: 3,
            innovation,
            noise,
            by_pose: SMatrix::zeros(),
            by_motion: None,
            by_feature: SMatrix::zeros(),
            by_shared: Some(by_shared),
            roll: None,
        }
    }

    /// A pixel in Cf (METHOD 6, tight form): `h_F = project_F(R_CF^T (h_C - rho t_CF))`, with T_CF = `measured_t_cf` Exp(`error`).
    pub fn worn_pixel(
        camera: &Camera,
        (measured_t_cf, error): (&Pose, &Vector6<f64>),
        pose: &CameraPose,
        feature: &FeatureState,
        measured: &Vector2<f64>,
        sigma_px: f64,
    ) -> Option<Self> {
        let h = visible_direction(pose, feature)?;
        let t_cf = measured_t_cf.retract(error);
        let r_fc = t_cf.rotation.transpose();
        let value = r_fc * (h.value - t_cf.translation * feature.scale());
        let (predicted, j) = camera.project_jac(&value)?;
        let by_scale = SMatrix::<f64, 1, 6>::from_row_slice(&[0.0, 0.0, 0.0, 0.0, 0.0, 1.0]);
        let in_f = PointInCamera {
            value,
            by_pose: r_fc * h.by_pose,
            by_feature: r_fc * h.by_feature - r_fc * t_cf.translation * by_scale,
        };
        let mut by_error = SMatrix::<f64, 3, 6>::zeros();
        by_error
            .fixed_view_mut::<3, 3>(0, 0)
            .copy_from(&(r_fc * measured_t_cf.rotation * -feature.scale()));
        let turn = error.fixed_rows::<3>(3).into_owned();
        by_error
            .fixed_view_mut::<3, 3>(0, 3)
            .copy_from(&(quat::skew(&value) * quat::right_jacobian(&turn)));
        let mut rows = Self::pixel(predicted, measured, sigma_px, &j, &in_f);
        let mut by_shared = SMatrix::<f64, 3, 6>::zeros();
        by_shared.fixed_rows_mut::<2>(0).copy_from(&(j * by_error));
        rows.by_shared = Some(by_shared);
        Some(rows)
    }
}

/// Direction of the feature from Cs; `None` with `rho <= 0` (METHOD 4: such a feature predicts nothing).
fn visible_direction(pose: &CameraPose, feature: &FeatureState) -> Option<PointInCamera> {
    (feature.scale() > 0.0).then(|| PointInCamera::scaled(pose, feature))
}
