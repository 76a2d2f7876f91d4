//! The scale-free start from several views of one camera.

use crate::scene::{camera, normals, rng};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::{Camera, Filter, Settings};
use nalgebra::{DMatrix, DVector, Matrix6, Vector2, Vector3, Vector6};
use rand::Rng;

const TIMES: [f64; 4] = [0.0, 0.1, 0.25, 0.3];
const POINTS: usize = 40;

/// Pixels, view by view.
type Views = Vec<Vec<Vector2<f64>>>;

/// Views of random points, nearer and farther, by a camera that moves at a constant velocity and turns at a constant rate.
fn views(
    seed: u64,
    velocity: Vector3<f64>,
    rate: Vector3<f64>,
    sigma: f64,
) -> (Vec<Pose>, Vec<Vector3<f64>>, Views) {
    let (mut rng, camera) = (rng(seed), camera());
    let poses: Vec<Pose> = TIMES
        .iter()
        .map(|t| Pose {
            rotation: quat::rotation_exp(&(rate * *t)),
            translation: velocity * *t,
        })
        .collect();
    let seen = |camera: &Camera, p: &Vector3<f64>| {
        poses.iter().all(|pose| {
            let uv = camera.project(&pose.inverse().apply(p));
            uv.is_some_and(|uv| camera.in_image(&uv, 5.0))
        })
    };
    let mut points = Vec::new();
    while points.len() < POINTS {
        let depth = rng.random_range(3.0..20.0);
        let p = Vector3::new(
            rng.random_range(-0.6..0.6),
            rng.random_range(-0.4..0.4),
            1.0,
        ) * depth;
        if seen(&camera, &p) {
            points.push(p);
        }
    }
    let pixels = poses
        .iter()
        .map(|pose| {
            let of = |p: &Vector3<f64>| camera.project(&pose.inverse().apply(p)).expect("seen");
            points
                .iter()
                .map(|p| of(p) + normals::<2>(&mut rng) * sigma)
                .collect()
        })
        .collect();
    (poses, points, pixels)
}

fn fresh() -> Filter {
    let mut filter = Filter::new(Settings::default(), camera(), None);
    filter.predict(TIMES[3]).expect("a time");
    filter
}

/// Error of pose and inverse depths over what P says of them, per number; of a filter that has started.
fn nees(filter: &Filter, ids: &[Option<u64>], truth: &Pose, points: &[Vector3<f64>]) -> (f64, f64) {
    let state = filter.state();
    let born: Vec<(usize, usize)> = ids
        .iter()
        .enumerate()
        .filter_map(|(i, id)| Some((i, state.layout().find((*id)?)?.offset + 5)))
        .collect();
    let inverse = |i: usize| 1.0 / points[i].norm();
    let mean_rho = born.iter().map(|&(i, _)| inverse(i)).sum::<f64>() / born.len() as f64;
    let scale = Settings::default().birth.undelayed_rho / mean_rho;
    let (rotation, translation) = filter.pose();
    let estimate = Pose {
        rotation,
        translation,
    };
    let true_pose = Pose {
        translation: truth.translation / scale,
        rotation: truth.rotation,
    };
    let xi: Vector6<f64> = estimate.inverse().compose(&true_pose).log();
    let p: Matrix6<f64> = filter.pose_covariance();
    let pose = (xi.transpose() * p.try_inverse().expect("regular") * xi)[(0, 0)] / 6.0;
    let error = DVector::from_iterator(
        born.len(),
        born.iter()
            .map(|&(i, at)| inverse(i) * scale - state.mean()[at]),
    );
    // Their mean is the unit: one number less.
    let n = born.len();
    let contrast = DMatrix::from_fn(n - 1, n, |r, c| {
        f64::from(u8::from(r == c)) - f64::from(u8::from(r + 1 == c))
    });
    let joint = DMatrix::from_fn(n, n, |r, c| state.covariance().get(born[r].1, born[c].1));
    let (e, joint) = (&contrast * error, &contrast * joint * contrast.transpose());
    let solved = joint.cholesky().expect("positive").solve(&e);
    (pose, e.dot(&solved) / (n - 1) as f64)
}

fn consistent(velocity: Vector3<f64>, rate: Vector3<f64>) {
    let mut sums = [0.0, 0.0];
    let runs = 40;
    for seed in 0..runs {
        let (poses, points, pixels) = views(seed, velocity, rate, 1.0);
        let mut filter = fresh();
        let ids = filter.start_from_views(&TIMES, &pixels).expect("views");
        assert!(filter.started(), "seed {seed}");
        assert!(ids.iter().flatten().count() > POINTS * 3 / 4);
        filter.check().expect("sound");
        let (pose, rho) = nees(&filter, &ids, &poses[3], &points);
        sums[0] += pose / runs as f64;
        sums[1] += rho / runs as f64;
    }
    assert!((0.6..1.5).contains(&sums[0]), "pose: {}", sums[0]);
    assert!((0.7..1.4).contains(&sums[1]), "inverse depths: {}", sums[1]);
}

#[test]
fn a_start_while_driving_ahead_errs_as_it_says() {
    consistent(Vector3::new(0.3, 0.0, 6.0), Vector3::new(0.0, 0.1, 0.0));
}

#[test]
fn a_start_to_the_side_in_a_turn_errs_as_it_says() {
    consistent(Vector3::new(4.0, 0.5, 1.0), Vector3::new(0.1, -0.5, 0.3));
}

#[test]
fn velocities_are_those_between_the_last_views() {
    let (velocity, rate) = (Vector3::new(4.0, 0.5, 1.0), Vector3::new(0.1, -0.5, 0.3));
    let (_, _, pixels) = views(1, velocity, rate, 1e-3);
    let mut filter = fresh();
    filter.start_from_views(&TIMES, &pixels).expect("views");
    let state = filter.state();
    let scale = velocity.norm() / state.velocity().norm();
    assert!((state.velocity() * scale - velocity).norm() < 0.02);
    assert!((state.angular_velocity() - rate).norm() < 0.01);
    let mark = filter.state().covariance().get(7, 7);
    assert!(mark > 0.0 && mark.is_finite());
}

#[test]
fn wrong_tracks_are_left_out() {
    let (_, _, mut pixels) = views(2, Vector3::new(3.0, 0.0, 4.0), Vector3::zeros(), 0.3);
    for (k, view) in pixels.iter_mut().enumerate() {
        for uv in view.iter_mut().take(6) {
            *uv += Vector2::new(25.0, -15.0) * k as f64;
        }
    }
    let mut filter = fresh();
    let ids = filter.start_from_views(&TIMES, &pixels).expect("views");
    assert!(filter.started());
    assert!(ids[..6].iter().all(Option::is_none));
    assert!(ids[6..].iter().flatten().count() > 30);
}

#[test]
fn a_camera_that_only_turns_or_stands_starts_nothing() {
    for (seed, rate) in [Vector3::new(0.0, 0.8, 0.1), Vector3::zeros()]
        .into_iter()
        .enumerate()
    {
        for sigma in [0.05, 1.0] {
            let (_, _, pixels) = views(seed as u64, Vector3::zeros(), rate, sigma);
            let mut filter = fresh();
            let ids = filter.start_from_views(&TIMES, &pixels).expect("views");
            assert!(
                !filter.started() && ids.iter().all(Option::is_none),
                "rate {rate}, sigma {sigma}"
            );
            assert_eq!(filter.map_size(), 0);
        }
    }
}

#[test]
fn bad_views_change_nothing() {
    let (_, _, pixels) = views(3, Vector3::new(4.0, 0.5, 1.0), Vector3::zeros(), 1.0);
    let mut filter = fresh();
    let mut nan = pixels.clone();
    nan[2][5].x = f64::NAN;
    let mut ragged = pixels.clone();
    ragged[1].pop();
    assert!(filter.start_from_views(&TIMES, &nan).is_err());
    assert!(filter.start_from_views(&TIMES, &ragged).is_err());
    assert!(filter.start_from_views(&TIMES[..3], &pixels).is_err());
    assert!(filter.start_from_views(&TIMES[..1], &pixels[..1]).is_err());
    assert!(
        filter
            .start_from_views(&[0.0, 0.2, 0.2, 0.3], &pixels)
            .is_err()
    );
    assert!(filter.start_from_views(&[], &[]).is_err());
    assert!(!filter.started() && filter.map_size() == 0);
    let many = vec![vec![Vector2::new(10.0, 10.0); 501]; 4];
    assert!(filter.start_from_views(&TIMES, &many).is_err());
    let none = vec![Vec::new(); 4];
    assert_eq!(filter.start_from_views(&TIMES, &none), Ok(Vec::new()));
    filter.start_from_views(&TIMES, &pixels).expect("views");
    assert!(filter.start_from_views(&TIMES, &pixels).is_err());
}
