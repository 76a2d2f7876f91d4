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
//! angle between its two rays. Its variance comes from the rotation of T_CF about an axis normal to the baseline, and from one
//! pixel error in each view; the length of `t` does not enter it. Of the rotations about such axes the one with the smallest
//! variance is taken, because `d_max` is an upper bound: each point is gated by itself later.
//!
//! The region of interest of a view is the bounding box of its own body cut with the *other* view's body, the
//! latter grown by `GROW_SIGMAS` standard deviations of T_CF: its sides open by the angle and move out by the distance.
//! Both regions are supersets. Two convex bodies are cut by clipping the faces of each with the half-spaces of the other
//! (Sutherland and Hodgman).
//!
//! The covariance of T_CF is over (translation, rotation), tangent on the right: m^2, rad^2, axes of F.

mod view_body;

pub use view_body::ViewBody;

use crate::camera::Camera;
use crate::math::pose::Pose;
use crate::settings::OverlapSettings;
use nalgebra::{Matrix2, Matrix3, Matrix6, SymmetricEigen, Vector2, Vector3};
use view_body::{SAMPLES, furthest};

/// Least side of a region of interest, pixels.
const MIN_SIDE: f64 = 2.0;

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

/// Pixel of a point, or of the last point on the way there from the axis that has one.
fn project_towards_axis(camera: &Camera, p: &Vector3<f64>) -> Option<Vector2<f64>> {
    furthest(|s| camera.project(&Vector3::new(p.x * s, p.y * s, p.z)))
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
