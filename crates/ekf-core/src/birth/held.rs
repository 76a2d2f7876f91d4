//! Candidates that the image holds where they were first seen (METHOD 5): far points of a camera that does not turn, points that
//! a step to the side happens to hold there while it turns, or what is fixed to the camera.

use super::at_rest::from_arc;
use crate::camera::Camera;
use crate::math::pose::Pose;
use nalgebra::{Unit, Vector2};

/// What a point may be that the image holds in its place. It is not a birth: what parallax it seems to have is all of the turn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Held {
    /// A point at rest, far or at some distance, would be there, too.
    Perhaps,
    /// No point at rest would be there, at whatever distance.
    RigFixed,
}

/// Whether the image holds a point, and what that may be.
///
/// `uv` and `first_uv` are pixels of now and of the first view, `first_in_c` maps points of
/// the first view into C, `sigma` is a pixel's sd, and `gate` the angle, rad, beyond which nothing counts as noise. `None` if the
/// point moves, or a pixel has no ray.
pub fn held(
    camera: &Camera,
    uv: &Vector2<f64>,
    first_uv: &Vector2<f64>,
    first_in_c: &Pose,
    sigma: f64,
    gate: f64,
) -> Option<Held> {
    if (uv - first_uv).norm() > sigma {
        return None;
    }
    let ray = camera.unproject(uv)?;
    let far = first_in_c.rotation * camera.unproject(first_uv)?;
    match Unit::try_new(first_in_c.translation, 1e-9) {
        Some(near) if from_arc(&ray, &far, &near) > gate => Some(Held::RigFixed),
        _ => Some(Held::Perhaps),
    }
}
