//! Where the fields of view of Cs and Cf overlap (METHOD section 9).
//!
//! A field of view is a pyramid cut off at a near and a far distance:
//!
//! ```text
//!            far  +-----------+       side planes: the rectangle of x/z, y/z that holds every ray of the image
//!                  \         /                     border, distortion included
//!                   \       /         near plane:  a setting
//!             near   +-----+          far plane:   d_max = |t| / (2 tan(alpha_u / 2)), at most a setting
//!                       ^ camera
//! ```
//!
//! `alpha_u`, the least useful parallax, is `PARALLAX_SIGMAS` standard deviations of the parallax. A point's parallax is the
//! angle between its two rays, so its variance comes from the rotation of T_CF (about an axis at right angles to the baseline;
//! the smaller variance, since `d_max` is an upper bound and each point is gated by itself later) and from one
//! pixel error in each view; the length of `t` does not enter it.
//!
//! The region of interest of a view is the bounding box of its own body cut with the *other* view's body, the
//! latter grown by `GROW_SIGMAS` standard deviations of T_CF: its sides open by the angle and move out by the distance.
//! Both regions are supersets. Two convex bodies are cut by clipping the faces of each with the half-spaces of the other
//! (Sutherland and Hodgman).
//!
//! The covariance of T_CF is over (translation, rotation), tangent on the right: m^2, rad^2, axes of F.

use nalgebra::{Matrix2, Matrix3, Matrix6, SymmetricEigen, Vector2, Vector3};

use crate::camera::Camera;
use crate::math::pose::Pose;
use crate::settings::OverlapSettings;

/// Widest slope `x / z` of a body: 85 degrees off the axis.
const MAX_SLOPE: f64 = 11.43;
/// Least side of a region of interest, pixels.
const MIN_SIDE: f64 = 2.0;
/// Points taken along each side of the image, and along each edge of the common body.
const SAMPLES: usize = 8;

/// The least useful parallax, in standard deviations of the parallax.
const PARALLAX_SIGMAS: f64 = 3.0;
/// By how many standard deviations of T_CF a view is grown.
const GROW_SIGMAS: f64 = 3.0;

/// Overlap of the two views of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Overlap {
    /// Region of interest in Cs, `(u0, v0, u1, v1)`, pixels.
    pub roi_s: [f64; 4],
    /// Region of interest in Cf, `(u0, v0, u1, v1)`, pixels.
    pub roi_f: [f64; 4],
    /// Largest useful depth, metres.
    pub d_max: f64,
    /// Length of the baseline `|t|`, metres.
    pub baseline: f64,
}

/// Predicts where `cs` and `cf` see the same space, or `None` if they do not (usefully).
///
/// `t_cf` maps points of F into C, metres; `sigma_t` is its covariance (see the module's page), `sigma_px` the standard
/// deviation of a pixel coordinate in either view, pixels.
pub fn predict_overlap(
    cs: &Camera,
    cf: &Camera,
    t_cf: &Pose,
    sigma_t: &Matrix6<f64>,
    sigma_px: f64,
    settings: &OverlapSettings,
) -> Option<Overlap> {
    let Pose {
        rotation,
        translation,
    } = t_cf;
    let baseline = translation.norm();
    let rotation_cov: Matrix3<f64> = sigma_t.fixed_view::<3, 3>(3, 3).into_owned();
    let translation_cov: Matrix3<f64> = sigma_t.fixed_view::<3, 3>(0, 0).into_owned();
    // The baseline in F, where the covariance lives.
    let axis = rotation.transpose() * translation;
    let alpha = PARALLAX_SIGMAS * parallax_variance(cs, cf, &axis, &rotation_cov, sigma_px).sqrt();
    let d_max = if alpha > 0.0 {
        (baseline / (2.0 * (0.5 * alpha).tan())).min(settings.far)
    } else {
        settings.far
    };
    if baseline <= 0.0 || alpha >= std::f64::consts::PI || d_max <= settings.near {
        return None;
    }
    let angle = GROW_SIGMAS * largest_deviation(&rotation_cov);
    let offset = GROW_SIGMAS * largest_deviation(&translation_cov);
    let body_s = ViewBody::new(cs, settings.near, d_max)?;
    let body_f = ViewBody::new(cf, settings.near, d_max)?;

    let f_in_c = body_f.grown(angle, offset).moved(rotation, translation);
    let roi_s = region(cs, &body_s, &f_in_c, sigma_px)?;
    // Seen from F the error turns Cs about F, so its apex moves as well.
    let back = rotation.transpose();
    let c_in_f = body_s
        .grown(angle, offset + baseline * angle.min(1.0))
        .moved(&back, &-axis);
    let roi_f = region(cf, &body_f, &c_in_f, sigma_px)?;
    Some(Overlap {
        roi_s,
        roi_f,
        d_max,
        baseline,
    })
}

/// A field of view between two depths, or its grown form: a convex body with 8 corners and 6 faces.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewBody {
    /// Least and largest `x / z`, then `y / z`, of the faces before they are moved outwards.
    slopes: [f64; 4],
    /// Least and largest `z` likewise, metres.
    depths: [f64; 2],
    /// Corners, metres: near face, then far face, each around the axis.
    pub corners: [Vector3<f64>; 8],
    /// Faces as half-spaces `n . p <= d` with unit outward normals `n`.
    pub half_spaces: [(Vector3<f64>, f64); 6],
}

/// Corners of each face, in order around it.
const FACES: [[usize; 4]; 6] = [
    [0, 1, 2, 3],
    [4, 5, 6, 7],
    [0, 3, 7, 4],
    [1, 2, 6, 5],
    [0, 1, 5, 4],
    [3, 2, 6, 7],
];

impl ViewBody {
    /// The view of a camera between the depths `near` and `far` (metres), in the camera's frame.
    ///
    /// `None` if the depths are not `0 < near < far` or no pixel has a ray.
    pub fn new(camera: &Camera, near: f64, far: f64) -> Option<Self> {
        if !(near > 0.0 && far > near && far.is_finite()) {
            return None;
        }
        let (w, h) = (
            f64::from(camera.width) - 1.0,
            f64::from(camera.height) - 1.0,
        );
        let mut slopes = [f64::MAX, f64::MIN, f64::MAX, f64::MIN];
        for k in 0..SAMPLES {
            let s = k as f64 / SAMPLES as f64;
            for uv in [
                Vector2::new(s * w, 0.0),
                Vector2::new(w, s * h),
                Vector2::new(w - s * w, h),
                Vector2::new(0.0, h - s * h),
            ] {
                let ray = border_ray(camera, &uv)?;
                let (x, y) = (ray.x / ray.z, ray.y / ray.z);
                slopes[0] = slopes[0].min(x);
                slopes[1] = slopes[1].max(x);
                slopes[2] = slopes[2].min(y);
                slopes[3] = slopes[3].max(y);
            }
        }
        let slopes = slopes.map(|s| s.clamp(-MAX_SLOPE, MAX_SLOPE));
        Self::from_slopes(slopes, [near, far], 0.0)
    }

    /// The body after turning by up to `angle` (radians) about the camera and moving by up to `offset` (metres), together.
    fn grown(&self, angle: f64, offset: f64) -> Self {
        let open =
            |slope: f64, sign: f64| (slope.atan() + sign * angle).tan_within(-MAX_SLOPE, MAX_SLOPE);
        let [x0, x1, y0, y1] = self.slopes;
        let slopes = [open(x0, -1.0), open(x1, 1.0), open(y0, -1.0), open(y1, 1.0)];
        // Turning moves a point at depth z by up to z * hypot(1, slope) * angle along the axis.
        let reach = self.slopes.iter().map(|s| s * s).sum::<f64>().sqrt() + 1.0;
        let turn = (reach * angle).min(0.9);
        let depths = [self.depths[0] * (1.0 - turn), self.depths[1] * (1.0 + turn)];
        Self::from_slopes(slopes, depths, offset).unwrap_or_else(|| self.clone())
    }

    /// Pyramid frustum whose faces are moved outwards by `offset`; `None` if it is flat.
    fn from_slopes(slopes: [f64; 4], depths: [f64; 2], offset: f64) -> Option<Self> {
        let [x0, x1, y0, y1] = slopes;
        if x1 - x0 < 1e-9 || y1 - y0 < 1e-9 {
            return None;
        }
        // Moving both side planes of an axis out by `offset` moves their common line back along the axis.
        let side = |slope: f64| offset * slope.hypot(1.0);
        let near = depths[0] - offset;
        let far = depths[1] + offset;
        let corner = |x: usize, y: usize, z: f64| {
            let (sx, sy) = (slopes[x], slopes[2 + y]);
            let out = |sign: usize| if sign == 0 { -1.0 } else { 1.0 };
            let at = |slope: f64, sign: usize| slope * z + out(sign) * side(slope);
            Vector3::new(at(sx, x), at(sy, y), z)
        };
        // Where opposite sides meet behind the camera the body ends.
        let apex = [(x0, x1), (y0, y1)]
            .map(|(a, b)| -(side(a) + side(b)) / (b - a))
            .into_iter()
            .fold(f64::MIN, f64::max);
        let near = near.max(apex);
        let around = [(0, 0), (1, 0), (1, 1), (0, 1)];
        let mut corners = [Vector3::zeros(); 8];
        for (k, (x, y)) in around.into_iter().enumerate() {
            corners[k] = corner(x, y, near);
            corners[4 + k] = corner(x, y, far);
        }
        let half_spaces = [
            (Vector3::new(0.0, 0.0, -1.0), -near),
            (Vector3::new(0.0, 0.0, 1.0), far),
            (Vector3::new(-1.0, 0.0, x0).normalize(), offset),
            (Vector3::new(1.0, 0.0, -x1).normalize(), offset),
            (Vector3::new(0.0, -1.0, y0).normalize(), offset),
            (Vector3::new(0.0, 1.0, -y1).normalize(), offset),
        ];
        Some(Self {
            slopes,
            depths,
            corners,
            half_spaces,
        })
    }

    /// The body under `p -> R p + t`.
    pub fn moved(&self, rotation: &Matrix3<f64>, translation: &Vector3<f64>) -> Self {
        let mut moved = self.clone();
        for corner in &mut moved.corners {
            *corner = rotation * *corner + translation;
        }
        for (normal, d) in &mut moved.half_spaces {
            *normal = rotation * *normal;
            *d += normal.dot(translation);
        }
        moved
    }

    /// Whether a point (metres) lies in the body or on its surface.
    pub fn contains(&self, p: &Vector3<f64>) -> bool {
        self.half_spaces
            .iter()
            .all(|(normal, d)| normal.dot(p) <= d + 1e-9 * (1.0 + d.abs()))
    }

    /// Calls `visit` with each face of `self`, as far as it lies in `other`: its corners in order.
    fn clipped_faces(&self, other: &Self, mut visit: impl FnMut(&[Vector3<f64>])) {
        let mut polygon = Vec::with_capacity(12);
        let mut clipped = Vec::with_capacity(12);
        for face in FACES {
            polygon.clear();
            polygon.extend(face.iter().map(|&k| self.corners[k]));
            for (normal, d) in &other.half_spaces {
                clip(&polygon, normal, *d, &mut clipped);
                std::mem::swap(&mut polygon, &mut clipped);
            }
            if !polygon.is_empty() {
                visit(&polygon);
            }
        }
    }
}

/// Tangent of an angle, with the poles and everything past them clamped.
trait TanWithin {
    fn tan_within(self, low: f64, high: f64) -> f64;
}

impl TanWithin for f64 {
    fn tan_within(self, low: f64, high: f64) -> f64 {
        if self <= low.atan() {
            low
        } else if self >= high.atan() {
            high
        } else {
            self.tan()
        }
    }
}

/// Sutherland and Hodgman: the part of a polygon with `normal . p <= d`.
fn clip(polygon: &[Vector3<f64>], normal: &Vector3<f64>, d: f64, out: &mut Vec<Vector3<f64>>) {
    out.clear();
    for (k, a) in polygon.iter().enumerate() {
        let b = &polygon[(k + 1) % polygon.len()];
        let (from, to) = (normal.dot(a) - d, normal.dot(b) - d);
        if from <= 0.0 {
            out.push(*a);
        }
        if (from < 0.0 && to > 0.0) || (from > 0.0 && to < 0.0) {
            out.push(a + (b - a) * (from / (from - to)));
        }
    }
}

/// Bounding box in the image of what lies both in the camera's own body and in the other one.
fn region(camera: &Camera, own: &ViewBody, other: &ViewBody, margin: f64) -> Option<[f64; 4]> {
    let mut roi = [f64::MAX, f64::MAX, f64::MIN, f64::MIN];
    let mut include = |polygon: &[Vector3<f64>]| {
        for (k, a) in polygon.iter().enumerate() {
            let b = &polygon[(k + 1) % polygon.len()];
            // Distortion bends edges outwards, so their inner points count too.
            for s in 0..SAMPLES {
                let p = a + (b - a) * (s as f64 / SAMPLES as f64);
                if let Some(uv) = project_towards_axis(camera, &p) {
                    roi[0] = roi[0].min(uv.x);
                    roi[1] = roi[1].min(uv.y);
                    roi[2] = roi[2].max(uv.x);
                    roi[3] = roi[3].max(uv.y);
                }
            }
        }
    };
    own.clipped_faces(other, &mut include);
    other.clipped_faces(own, &mut include);
    let (w, h) = (
        f64::from(camera.width) - 1.0,
        f64::from(camera.height) - 1.0,
    );
    let roi = [
        (roi[0] - margin).max(0.0),
        (roi[1] - margin).max(0.0),
        (roi[2] + margin).min(w),
        (roi[3] + margin).min(h),
    ];
    (roi[2] - roi[0] >= MIN_SIDE && roi[3] - roi[1] >= MIN_SIDE).then_some(roi)
}

/// Ray of a border pixel, or of the last pixel on the way there from the principal point that has one.
fn border_ray(camera: &Camera, uv: &Vector2<f64>) -> Option<Vector3<f64>> {
    let centre = Vector2::new(camera.cx, camera.cy);
    furthest(|s| camera.unproject(&(centre + (uv - centre) * s)))
}

/// Pixel of a point, or of the last point on the way there from the axis that has one.
fn project_towards_axis(camera: &Camera, p: &Vector3<f64>) -> Option<Vector2<f64>> {
    furthest(|s| camera.project(&Vector3::new(p.x * s, p.y * s, p.z)))
}

/// `f(1)`, or `f(s)` for the largest `s` in `[0, 1]` that has a value, to 1e-6.
fn furthest<T>(f: impl Fn(f64) -> Option<T>) -> Option<T> {
    if let Some(value) = f(1.0) {
        return Some(value);
    }
    let mut best = f(0.0)?;
    let (mut low, mut high) = (0.0, 1.0);
    while high - low > 1e-6 {
        let middle = 0.5 * (low + high);
        match f(middle) {
            Some(value) => {
                best = value;
                low = middle;
            }
            None => high = middle,
        }
    }
    Some(best)
}

/// Variance of a parallax, rad^2: the smaller variance of the rotation about an axis normal to the baseline, and a pixel
/// in each view.
fn parallax_variance(
    cs: &Camera,
    cf: &Camera,
    baseline: &Vector3<f64>,
    rotation_cov: &Matrix3<f64>,
    sigma_px: f64,
) -> f64 {
    let pixel = |camera: &Camera| sigma_px / (camera.fx * camera.fy).sqrt();
    let direction = baseline.normalize();
    let helper = if direction.x.abs() < 0.7 {
        Vector3::x()
    } else {
        Vector3::y()
    };
    let e1 = direction.cross(&helper).normalize();
    let e2 = direction.cross(&e1);
    let cross = e1.dot(&(rotation_cov * e2));
    let across = Matrix2::new(
        e1.dot(&(rotation_cov * e1)),
        cross,
        cross,
        e2.dot(&(rotation_cov * e2)),
    );
    let least = SymmetricEigen::new(across).eigenvalues.min().max(0.0);
    least + pixel(cs).powi(2) + pixel(cf).powi(2)
}

/// Largest standard deviation over all directions.
fn largest_deviation(covariance: &Matrix3<f64>) -> f64 {
    let symmetric = 0.5 * (covariance + covariance.transpose());
    SymmetricEigen::new(symmetric)
        .eigenvalues
        .max()
        .max(0.0)
        .sqrt()
}
