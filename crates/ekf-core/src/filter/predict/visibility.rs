//! What the camera should see: which features are in front of it and in its image.

use crate::camera::Camera;
use crate::math::quat;
use crate::observe::point::CameraPose;
use crate::observe::{ByMotion, FeatureState, PointInCamera, Shutter};
use nalgebra::{SMatrix, Vector2, Vector3};

/// With a working set: how far out of the image a feature's point of some frames ago may lie, pixels, while the feature itself
/// may be in view.
pub(super) const MAYBE: f64 = 200.0;

/// When a feature in view joins the working set, those join with it that are no farther than this outside of the image,
/// pixels.
pub(crate) const SOON: f64 = 60.0;

/// A feature in view: its point in C, its pixel, and the pixel's derivative by that point.
pub(crate) struct Appearance {
    pub(crate) point: PointInCamera,
    pub(crate) uv: Vector2<f64>,
    pub(super) by_point: SMatrix<f64, 2, 3>,
    /// Derivative of the point by the motion under the shutter, where that may roll.
    pub(crate) by_motion: Option<ByMotion>,
}

/// How a feature looks, if it should be visible: in front, `margin` pixels inside of the image, rho > 0.
pub(super) fn appearance(
    camera: &Camera,
    pose: &CameraPose,
    feature: &FeatureState,
    margin: f64,
) -> Option<Appearance> {
    let point = PointInCamera::metric(pose, feature)?;
    let (uv, by_point) = camera.project_jac(&point.value)?;
    camera.in_image(&uv, margin).then_some(Appearance {
        point,
        uv,
        by_point,
        by_motion: None,
    })
}

/// As [`appearance`], from the pose at the time of the row in which it is seen.
pub(super) fn rolled_appearance(
    camera: &Camera,
    pose: &CameraPose,
    feature: &FeatureState,
    shutter: Option<&Shutter>,
) -> Option<Appearance> {
    let seen = appearance(camera, pose, feature, 0.0)?;
    let Some(shutter) = shutter else {
        return Some(seen);
    };
    // The row in which it is seen follows from where it is seen.
    let first = shutter.at(pose, &seen.uv);
    let row = shutter.at(pose, &appearance(camera, &first.pose, feature, 0.0)?.uv);
    let mut seen = appearance(camera, &row.pose, feature, 0.0)?;
    let (by_pose, by) = row.split(&seen.point.by_pose);
    seen.point.by_pose = by_pose;
    seen.by_motion = Some(ByMotion {
        readout: shutter.offset,
        by,
    });
    Some(seen)
}

/// Whether a point is in front of the camera and in the image, by a margin in pixels.
pub(crate) fn visibility(
    camera: &Camera,
    pose: &CameraPose,
) -> impl Fn(&Vector3<f64>, f64) -> bool {
    let (r, r_cw) = (pose.r, quat::rotation(&pose.q).transpose());
    move |point, margin| {
        let seen = r_cw * (point - r);
        let uv = camera.project(&seen);
        uv.is_some_and(|uv| camera.in_image(&uv, margin))
    }
}
