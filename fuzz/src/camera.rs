//! A string of bytes as a calibration: cameras of any numbers are refused or work.

use crate::Broken;
use crate::bytes::Bytes;
use ekf_core::Camera;
use nalgebra::{Vector2, Vector3};

/// Makes a camera of the bytes; what it projects comes back, and no derivative is NaN.
///
/// # Errors
/// The first promise that was broken.
pub fn camera(bytes: &[u8]) -> Result<(), Broken> {
    let mut bytes = Bytes::new(bytes);
    bytes.rough = bytes.coin();
    let (model, parameters) = [
        ("pinhole", 0),
        ("radtan", 4),
        ("radtan", 5),
        ("fisheye", 4),
        ("wideangle", 1),
        ("fisheye", 3),
        ("radtan", 8),
    ][bytes.below(7)];
    let size = (16 * u32::from(bytes.byte()), 16 * u32::from(bytes.byte()));
    let (w, h) = (f64::from(size.0), f64::from(size.1));
    let intrinsics = [
        bytes.near(w, 0.6 * w),
        bytes.near(w, 0.6 * w),
        bytes.near(0.5 * w, 0.1 * w),
        bytes.near(0.5 * h, 0.1 * h),
    ];
    let strength = if model == "wideangle" { 1e-6 } else { 0.4 };
    let distortion: Vec<f64> = (0..parameters).map(|_| bytes.near(0.0, strength)).collect();
    let Ok(camera) = Camera::new(model, size.0, size.1, intrinsics, &distortion) else {
        return Ok(());
    };
    for _ in 0..4 {
        let uv = Vector2::new(bytes.near(0.5 * w, 0.6 * w), bytes.near(0.5 * h, 0.6 * h));
        if let Some((ray, by_uv)) = camera.unproject_jac(&uv) {
            if (ray.norm() - 1.0).abs() > 1e-9 || !by_uv.iter().all(|v| v.is_finite()) {
                return Err(format!(
                    "{camera:?} unprojects {uv:?} to {ray:?}, {by_uv:?}"
                ));
            }
            let back = camera.project(&ray);
            let close = |b: &Vector2<f64>| (b - uv).norm() <= 1e-6 * (1.0 + uv.norm() + w + h);
            if !bytes.rough && camera.in_image(&uv, 0.0) && !back.as_ref().is_some_and(close) {
                return Err(format!("{camera:?}: {uv:?} comes back as {back:?}"));
            }
        }
        let p = Vector3::new(
            bytes.near(0.0, 2.0),
            bytes.near(0.0, 2.0),
            bytes.near(2.0, 2.5),
        );
        if let Some((uv, by_point)) = camera.project_jac(&p) {
            let finite = uv.iter().chain(by_point.iter()).all(|v| v.is_finite());
            if !finite && p.iter().all(|v| v.is_finite() && v.abs() < 1e9) && !bytes.rough {
                return Err(format!("{camera:?} projects {p:?} to {uv:?}, {by_point:?}"));
            }
        }
    }
    Ok(())
}
