//! Where a point at rest can be seen again (METHOD 5): on the arc from the direction of its first view, where it is if it is
//! far, to the direction of that view's place, where it is if it is near.

use crate::math::quat;
use crate::observe::POSE_DIM;
use crate::observe::point::CameraPose;
use nalgebra::{RowSVector, SMatrix, Unit, Vector3};

type ByPose = RowSVector<f64, POSE_DIM>;

/// Distance of a direction from the arc between two others, unit vectors all, as a chord.
pub(super) fn from_arc(ray: &Vector3<f64>, far: &Vector3<f64>, near: &Vector3<f64>) -> f64 {
    Place::on_arc(ray, far, near).off(ray).norm()
}

/// By how much a point has left the places of one at rest.
#[derive(Clone, Debug)]
pub struct Leaving {
    /// Chord between its direction and the nearest of those places, rad.
    pub angle: f64,
    /// Derivative by the pose of now, `(r, q)`.
    by_now: ByPose,
    /// Derivative by the pose of the first view.
    by_first: ByPose,
}

impl Leaving {
    /// A point seen along `ray` now, first along `first_ray`: unit vectors, each in its camera.
    pub fn new(
        ray: &Vector3<f64>,
        first_ray: &Vector3<f64>,
        now: &CameraPose,
        first: &CameraPose,
    ) -> Self {
        let r_cw = quat::rotation(&now.q).transpose();
        let rotation = r_cw * quat::rotation(&first.q);
        let far = rotation * first_ray;
        let t = r_cw * (first.r - now.r);
        let distance = t.norm();
        let place = match Unit::try_new(t, 1e-9) {
            Some(near) => Place::on_arc(ray, &far, &near),
            None => Place::far(&far),
        };
        let off = place.off(ray);
        let across = off - place.at * place.at.dot(&off);
        let normal = -across.transpose() / across.norm().max(f64::MIN_POSITIVE);
        let by_far = normal * place.of_far;
        let by_t = if place.of_near > 0.0 {
            normal * (place.of_near / distance)
        } else {
            Default::default()
        };
        let turn = by_far * quat::skew(&far) + by_t * quat::skew(&t);
        let (mut by_now, mut by_first) = (ByPose::zeros(), ByPose::zeros());
        by_now.fixed_columns_mut::<3>(0).copy_from(&(-by_t * r_cw));
        by_now
            .fixed_columns_mut::<4>(3)
            .copy_from(&(turn * quat::tangent(&now.q)));
        by_first.fixed_columns_mut::<3>(0).copy_from(&(by_t * r_cw));
        by_first
            .fixed_columns_mut::<4>(3)
            .copy_from(&(-by_far * rotation * quat::skew(first_ray) * quat::tangent(&first.q)));
        Self {
            angle: off.norm(),
            by_now,
            by_first,
        }
    }

    /// Standard deviation of `angle` by the poses, rad: their covariances, and `between`, of now with the first one.
    pub fn sd(
        &self,
        now: &SMatrix<f64, POSE_DIM, POSE_DIM>,
        between: &SMatrix<f64, POSE_DIM, POSE_DIM>,
        first: &SMatrix<f64, POSE_DIM, POSE_DIM>,
    ) -> f64 {
        let part = |a: &ByPose, p: &SMatrix<f64, POSE_DIM, POSE_DIM>, b: &ByPose| {
            (a * p * b.transpose())[(0, 0)]
        };
        let variance = part(&self.by_now, now, &self.by_now)
            + 2.0 * part(&self.by_now, between, &self.by_first)
            + part(&self.by_first, first, &self.by_first);
        variance.max(0.0).sqrt()
    }
}

/// A place on the arc, as a sum of its ends.
struct Place {
    at: Vector3<f64>,
    of_far: f64,
    of_near: f64,
}

impl Place {
    fn far(far: &Vector3<f64>) -> Self {
        Self {
            at: *far,
            of_far: 1.0,
            of_near: 0.0,
        }
    }

    /// The nearest to a direction.
    fn on_arc(ray: &Vector3<f64>, far: &Vector3<f64>, near: &Vector3<f64>) -> Self {
        let Some(along) = Unit::try_new(near - far * far.dot(near), 1e-9) else {
            return Self::far(far);
        };
        let end = near.dot(&along).atan2(near.dot(far));
        let at = ray.dot(&along).atan2(ray.dot(far)).clamp(0.0, end);
        Self {
            at: far * at.cos() + along.into_inner() * at.sin(),
            of_far: (end - at).sin() / end.sin(),
            of_near: at.sin() / end.sin(),
        }
    }

    fn off(&self, ray: &Vector3<f64>) -> Vector3<f64> {
        ray - self.at
    }
}
