//! What a patch looks like from another view.
//!
//! A patch is taken to be a small plane through its landmark that faces the camera which captured it. The warp to
//! another view is affine: its matrix maps pixel offsets in the reference image to those in the other one.

use crate::Image;
use ekf_core::Camera;
use ekf_core::math::pose::Pose;
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

/// How far a patch may be warped.
#[derive(Clone, Copy, Debug)]
pub struct Limits {
    /// Least and largest change of area.
    pub area: [f64; 2],
    /// Largest ratio of the two scales.
    pub stretch: f64,
}

impl Limits {
    /// Whether a warp is within the bounds.
    pub fn allow(&self, affine: &Matrix2<f64>) -> bool {
        let area = affine.determinant();
        let (squares, spread) = squared_scales(affine);
        let stretched = ((squares + spread) / (squares - spread).max(1e-12)).sqrt();
        area >= self.area[0] && area <= self.area[1] && stretched <= self.stretch
    }
}

/// Affine map at an inverse range; without one that is allowed there, the map of the rotation alone, or none at all.
pub fn affine_at(
    camera_ref: &Camera,
    uv_ref: Vector2<f64>,
    camera_now: &Camera,
    motion: (&Matrix3<f64>, &Vector3<f64>),
    inverse_range: f64,
    limits: &Limits,
) -> Matrix2<f64> {
    let at = |rho: f64| {
        let warp = affine_map(camera_ref, uv_ref, camera_now, motion, rho);
        warp.affine.filter(|affine| limits.allow(affine))
    };
    at(inverse_range)
        .or_else(|| at(0.0))
        .unwrap_or_else(Matrix2::identity)
}

/// An image window around a landmark, from the pose that captured it.
#[derive(Clone, Debug)]
pub struct Patch<'a> {
    /// Its middle pixel is `uv_ref` rounded to whole pixels.
    pub window: Image<'a>,
    /// The landmark in the image that the window was cut from.
    pub uv_ref: Vector2<f64>,
    /// Pose at capture, `T_WC`.
    pub pose: Pose,
    /// First column and row of the window that hold image, and the last ones.
    pub inside: [Vector2<f64>; 2],
}

/// From where patches are looked at.
#[derive(Clone, Copy, Debug)]
pub struct View<'a> {
    /// The camera that captured them and that looks now.
    pub camera: &'a Camera,
    /// Its pose, `T_WC`.
    pub pose: &'a Pose,
}

impl Patch<'_> {
    /// Appends the template of `side * side` pixels as the patch should look now, and returns the map of its pixel offsets;
    /// zeros, and `None`, where the map is not allowed or leaves the window.
    ///
    /// `point` is the landmark in W; if it is not finite, only the rotation between the poses counts.
    pub fn template(
        &self,
        view: &View<'_>,
        point: &Vector3<f64>,
        side: usize,
        limits: &Limits,
        out: &mut Vec<u8>,
    ) -> Option<Matrix2<f64>> {
        let begin = out.len();
        let affine = self.sampled(view, point, side, limits, out);
        if affine.is_none() {
            out.truncate(begin);
            out.resize(begin + side * side, 0);
        }
        affine
    }

    fn sampled(
        &self,
        view: &View<'_>,
        point: &Vector3<f64>,
        side: usize,
        limits: &Limits,
        out: &mut Vec<u8>,
    ) -> Option<Matrix2<f64>> {
        let back = view.pose.rotation.transpose();
        let rotation = back * self.pose.rotation;
        let translation = back * (self.pose.translation - view.pose.translation);
        let distance = (point - self.pose.translation).norm();
        let rho = if distance.is_finite() {
            1.0 / distance.max(NEAREST)
        } else {
            0.0
        };
        let motion = (&rotation, &translation);
        let warp = affine_map(view.camera, self.uv_ref, view.camera, motion, rho);
        let affine = warp.affine.filter(|affine| limits.allow(affine))?;
        let middle = 0.5 * (self.window.width() - 1) as f64;
        let local = self.uv_ref - self.uv_ref.map(f64::round_ties_even) + Vector2::repeat(middle);
        let reach = sample(&self.window, local, &affine, side, out)?;
        let [first, last] = self.inside;
        let low = (local - reach - first).min() >= -0.5;
        let high = (last - local - reach).min() >= -0.5;
        (low && high).then_some(affine)
    }
}

/// A window of `2 half + 1` pixels a side around a point rounded to whole pixels, appended to `out`: the first column
/// and row that hold image, and the last ones. Beyond the image its edge repeats.
pub fn capture(
    image: &Image<'_>,
    uv: Vector2<f64>,
    half: usize,
    out: &mut Vec<u8>,
) -> [Vector2<f64>; 2] {
    let side = 2 * half + 1;
    let size = [image.width() as i64, image.height() as i64];
    let corner = [uv.x, uv.y].map(|x| x.round_ties_even() as i64 - half as i64);
    let first = corner.map(|c| (-c).clamp(0, side as i64 - 1) as usize);
    let last = [0, 1].map(|k| (size[k] - 1 - corner[k]).clamp(0, side as i64 - 1) as usize);
    for y in 0..side {
        let v = (corner[1] + y as i64).clamp(0, size[1] - 1) as usize;
        if first[0] == 0 && last[0] == side - 1 {
            out.extend_from_slice(image.run(corner[0] as usize, v, side));
        } else {
            let column = |x: usize| (corner[0] + x as i64).clamp(0, size[0] - 1) as usize;
            out.extend((0..side).map(|x| image.run(column(x), v, 1)[0]));
        }
    }
    [first, last].map(|at| Vector2::new(at[0] as f64, at[1] as f64))
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
    let (squares, spread) = squared_scales(m);
    (0.5 * (squares + spread)).sqrt()
}

/// Sum and difference of the squared singular values.
fn squared_scales(m: &Matrix2<f64>) -> (f64, f64) {
    let squares = m.norm_squared();
    let spread = squares * squares - 4.0 * m.determinant().powi(2);
    (squares, spread.max(0.0).sqrt())
}
