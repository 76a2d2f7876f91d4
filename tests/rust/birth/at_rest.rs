//! Where a point at rest can be seen again, and how sure that is (METHOD 5).

use crate::scene::{normals, rng};
use ekf_core::birth::at_rest::Leaving;
use ekf_core::math::quat;
use ekf_core::observe::point::CameraPose;
use nalgebra::{SMatrix, SVector, Vector3, Vector4};

type Covariance = SMatrix<f64, 7, 7>;

fn pose(r: [f64; 3], turn: [f64; 3]) -> CameraPose {
    let half = Vector3::from(turn) * 0.5;
    let q = Vector4::new(1.0, half.x, half.y, half.z).normalize();
    CameraPose {
        r: Vector3::from(r),
        q,
    }
}

/// Unit ray of a point of W from a camera.
fn ray(point: &Vector3<f64>, from: &CameraPose) -> Vector3<f64> {
    (quat::rotation(&from.q).transpose() * (point - from.r)).normalize()
}

fn angle(ray: &Vector3<f64>, first: &Vector3<f64>, now: &CameraPose, then: &CameraPose) -> f64 {
    Leaving::new(ray, first, now, then).angle
}

#[test]
fn a_point_at_rest_leaves_nothing_at_whatever_distance() {
    let then = pose([0.0; 3], [0.0; 3]);
    let now = pose([0.3, -0.1, 0.2], [0.05, -0.1, 0.02]);
    for depth in [0.5, 2.0, 30.0, 1e6] {
        let point = Vector3::new(0.2, -0.3, 1.0) * depth;
        let leaving = angle(&ray(&point, &now), &ray(&point, &then), &now, &then);
        assert!(leaving < 1e-7, "{depth} m: {leaving}");
    }
}

#[test]
fn what_moves_leaves_across_the_arc_and_beyond_its_ends() {
    let then = pose([0.0; 3], [0.0; 3]);
    let now = pose([0.2, 0.0, 0.0], [0.0; 3]);
    let first = Vector3::z();
    // To the side of a camera that went to the right, near points are further left; none is further right than a far one.
    let seen = |right: f64, down: f64| Vector3::new(right, down, 1.0).normalize();
    for left in [0.001, 0.1, 3.0] {
        assert!(angle(&seen(-left, 0.0), &first, &now, &then) < 1e-9);
    }
    for (right, down) in [(0.05, 0.0), (0.0, 0.05), (-0.1, 0.05)] {
        let leaving = angle(&seen(right, down), &first, &now, &then);
        assert!((leaving - 0.05).abs() < 1e-3, "{right} {down}: {leaving}");
    }
    // Without a baseline only what is far is at rest.
    let leaving = angle(&seen(-0.1, 0.0), &first, &then, &then);
    assert!((leaving - 0.1).abs() < 1e-3, "{leaving}");
}

#[test]
fn the_poses_share_in_it_as_their_covariance_says() {
    let (mut rng, step) = (rng(7), 1e-6);
    for k in 0..20 {
        let n = normals::<12>(&mut rng);
        let then = pose([0.0; 3], [0.0; 3]);
        let now = pose(
            [0.2 * n[0], 0.2 * n[1], 0.2 * n[2]],
            [0.1 * n[3], 0.1 * n[4], 0.1 * n[5]],
        );
        let point = Vector3::new(n[6], n[7], 4.0 + n[8]);
        let first = ray(&point, &then);
        let seen = (ray(&point, &now) + Vector3::new(n[9], n[10], n[11]) * 0.05).normalize();
        let leaving = Leaving::new(&seen, &first, &now, &then);
        let (none, mut numerical) = (Covariance::zeros(), SVector::<f64, 14>::zeros());
        for i in 0..14 {
            let moved = |by: f64| {
                let mut poses = [now, then];
                let pose = &mut poses[i / 7];
                match i % 7 {
                    j @ 0..3 => pose.r[j] += by,
                    j => pose.q[j - 3] += by,
                }
                angle(&seen, &first, &poses[0], &poses[1])
            };
            numerical[i] = (moved(step) - moved(-step)) / (2.0 * step);
            let mut own = Covariance::zeros();
            own[(i % 7, i % 7)] = 1.0;
            let sd = match i / 7 {
                0 => leaving.sd(&own, &none, &none),
                _ => leaving.sd(&none, &none, &own),
            };
            let wanted = numerical[i].abs();
            assert!(
                (sd - wanted).abs() < 2e-3 * (1.0 + wanted),
                "{k} {i}: {sd} {wanted}"
            );
        }
        // Two poses that are wrong together count less, or more, than apart.
        let both = Covariance::identity();
        let wanted = (numerical.fixed_rows::<7>(0) + numerical.fixed_rows::<7>(7)).norm();
        let sd = leaving.sd(&both, &both, &both);
        assert!(
            (sd - wanted).abs() < 2e-3 * (1.0 + wanted),
            "{k}: {sd} {wanted}"
        );
    }
}
