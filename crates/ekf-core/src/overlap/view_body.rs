//! A field of view as a convex body, and two of them cut by Sutherland and Hodgman.

use crate::camera::Camera;
use nalgebra::{Matrix3, Vector2, Vector3};

/// Points taken along each side of the image, and along each edge of the common body.
pub(super) const SAMPLES: usize = 8;
/// Widest slope `x / z` of a body: 85 degrees off the axis.
const MAX_SLOPE: f64 = 11.43;

/// A field of view between two depths, possibly grown: a convex body with 8 corners and 6 faces.
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

    /// A body that holds this one turned by up to `angle` (radians) about the camera and moved by up to
    /// `offset` (metres).
    pub(super) fn grown(&self, angle: f64, offset: f64) -> Self {
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
        // The body ends where opposite sides meet behind the camera.
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

    /// Calls `visit` with the part of each face of `self` that lies in `other`, as its corners in order.
    pub(super) fn clipped_faces(&self, other: &Self, mut visit: impl FnMut(&[Vector3<f64>])) {
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

/// Ray of a border pixel, or of the last pixel on the way there from the principal point that has one.
fn border_ray(camera: &Camera, uv: &Vector2<f64>) -> Option<Vector3<f64>> {
    let centre = Vector2::new(camera.cx, camera.cy);
    furthest(|s| camera.unproject(&(centre + (uv - centre) * s)))
}

/// `f(1)`, or `f(s)` for the largest `s` in `[0, 1]` that has a value, to 1e-6.
pub(super) fn furthest<T>(f: impl Fn(f64) -> Option<T>) -> Option<T> {
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
