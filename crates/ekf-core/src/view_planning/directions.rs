//! Which views are looked at: directions on a grid, places on a ring.

use crate::math::quat;
use nalgebra::{Matrix3, Vector3};
use std::f64::consts::{FRAC_PI_2, TAU};

/// Distance of directions, as parts of a whole turn.
const AROUND: usize = 24;
/// Of them upwards, and as many downwards.
const UPWARDS: i32 = 4;
/// Places around Cf.
const PLACES: usize = 8;

/// Attitudes of Cf along the axes of C, one each 15 degrees around and up to 60 degrees up and down; never rolled against C.
pub(crate) fn directions() -> impl Iterator<Item = Matrix3<f64>> {
    let step = TAU / AROUND as f64;
    (-UPWARDS..=UPWARDS).flat_map(move |up| {
        (0..AROUND).map(move |around| turned(around as f64 * step, f64::from(up) * step))
    })
}

/// The attitude that looks along `ray` (axes of C) and is not rolled against C; `None` straight up and down.
pub(crate) fn attitude(ray: &Vector3<f64>) -> Option<Matrix3<f64>> {
    let level = ray.x.hypot(ray.z);
    let up = (-ray.y).atan2(level);
    (up.abs() < FRAC_PI_2 - 1e-6).then(|| turned(ray.x.atan2(ray.z), up))
}

/// Unit vectors in C's plane of x and z, around its y axis.
pub(crate) fn turns_around() -> impl Iterator<Item = Vector3<f64>> {
    (0..PLACES).map(|k| {
        let angle = k as f64 * TAU / PLACES as f64;
        Vector3::new(angle.sin(), 0.0, angle.cos())
    })
}

/// Turned to the right about C's y axis, then upwards.
fn turned(right: f64, up: f64) -> Matrix3<f64> {
    quat::rotation_exp(&Vector3::new(0.0, right, 0.0))
        * quat::rotation_exp(&Vector3::new(up, 0.0, 0.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_attitude_looks_along_its_ray_and_is_level() {
        for ray in [[0.3, -0.2, 0.9], [-1.0, 0.4, -0.3], [0.0, 0.0, 1.0]] {
            let ray = Vector3::from(ray).normalize();
            let r = attitude(&ray).expect("it is not straight up");
            assert!((r * Vector3::z() - ray).norm() < 1e-12);
            assert!((r * Vector3::x()).y.abs() < 1e-12);
            assert!((r * Vector3::y()).y > 0.0);
        }
        assert!(attitude(&Vector3::y()).is_none());
    }

    #[test]
    fn the_grid_holds_straight_ahead() {
        let ahead = directions().filter(|r| (r - Matrix3::identity()).norm() < 1e-12);
        assert_eq!(ahead.count(), 1);
        assert_eq!(directions().count(), 216);
    }
}
