//! What a patch looks like from another view.
//!
//! A patch is taken to be a small plane through its landmark that faces the camera which captured it. The warp to
//! another view is affine: its matrix maps pixel offsets in the reference image to those in the other one.

use crate::Image;
use ekf_core::Camera;
use nalgebra::{Matrix2, Matrix3, Vector2, Vector3};

const PROBE: f64 = 4.0; // pixels from the patch's centre at which the warp is measured
const NEAREST: f64 = 1e-6; // metres (or units of the range) in front of the camera that can be seen
const SHRINK: f64 = 0.75; // linear scale below which a template is averaged from 2 x 2 samples a pixel

/// Predicted pixel in another view, and the affine map of pixel offsets into it.
#[derive(Clone, Copy, Debug)]
pub struct Warp {
    /// `None` where the landmark is not in front of the camera.
    pub uv: Option<Vector2<f64>>,
    /// `offset_now = affine * offset_ref`; `None` also where the map would mirror the patch.
    pub affine: Option<Matrix2<f64>>,
}

/// Warp of the patch at `uv_ref`; `rotation` and `translation` map points of the reference camera into the camera
/// now, and `inverse_range` (1/m) is from the reference camera: not positive or not finite means infinitely far.
pub fn affine_map(
    camera_ref: &Camera,
    uv_ref: Vector2<f64>,
    camera_now: &Camera,
    (rotation, translation): (&Matrix3<f64>, &Vector3<f64>),
    inverse_range: f64,
) -> Warp {
    let nothing = Warp {
        uv: None,
        affine: None,
    };
    let known = inverse_range.is_finite() && inverse_range > 0.0;
    let rho = if known { inverse_range } else { 0.0 };
    let probes = [[0.0, 0.0], [PROBE, 0.0], [0.0, PROBE]];
    let Some(axis) = camera_ref.unproject(&uv_ref) else {
        return nothing;
    };
    let mut places = [Vector2::zeros(); 3];
    for (place, probe) in places.iter_mut().zip(probes) {
        let Some(ray) = camera_ref.unproject(&(uv_ref + Vector2::from(probe))) else {
            return nothing;
        };
        // Where the ray meets the plane through the landmark that faces the reference camera, over the range.
        let on_plane = ray / ray.dot(&axis).max(1e-6);
        let seen = rotation * on_plane + rho * translation;
        if seen.z <= NEAREST {
            return nothing;
        }
        let Some(uv) = camera_now.project(&seen) else {
            return nothing;
        };
        *place = uv;
    }
    let affine = Matrix2::from_columns(&[places[1] - places[0], places[2] - places[0]]) / PROBE;
    Warp {
        uv: Some(places[0]),
        affine: (affine.determinant() > 0.0).then_some(affine),
    }
}

/// A template of `side * side` pixels sampled around a point of an image, appended to `out`; returns the largest
/// distance in u and v between a sample and the centre, pixels of the image.
///
/// `affine` maps offsets in the image to offsets in the template. Where it shrinks, each pixel is the mean of
/// 2 x 2 samples. `None`, and nothing appended, if it has no inverse.
pub fn sample(
    image: &Image<'_>,
    centre: Vector2<f64>,
    affine: &Matrix2<f64>,
    side: usize,
    out: &mut Vec<u8>,
) -> Option<Vector2<f64>> {
    let inverse = affine.try_inverse()?;
    let factor = if largest_scale(&inverse) > 1.0 / SHRINK {
        2
    } else {
        1
    };
    let place = |i: usize| (i as f64 + 0.5) / factor as f64 - 0.5 * side as f64;
    let step = inverse.column(0) / factor as f64;
    let share = 1.0 / (factor * factor) as f32;
    let mut line = vec![0.0_f32; side * factor];
    let mut sums = vec![0.0_f32; side];
    for y in 0..side {
        sums.fill(0.0);
        for v in factor * y..factor * (y + 1) {
            let start = inverse * Vector2::new(place(0), place(v)) + centre;
            image.sample_line(start, step, &mut line);
            for (sum, values) in sums.iter_mut().zip(line.chunks_exact(factor)) {
                *sum += values.iter().sum::<f32>();
            }
        }
        out.extend(sums.iter().map(|sum| (sum * share + 0.5) as u8));
    }
    Some(inverse.abs() * Vector2::repeat(0.5 * (side - 1) as f64))
}

/// Largest singular value.
fn largest_scale(m: &Matrix2<f64>) -> f64 {
    let squares = m.norm_squared();
    let spread = (squares * squares - 4.0 * m.determinant().powi(2)).max(0.0);
    (0.5 * (squares + spread.sqrt())).sqrt()
}
