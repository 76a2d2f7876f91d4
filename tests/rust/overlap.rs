//! Overlap of two views: configurations that can be checked by hand.

use ekf_core::camera::Camera;
use ekf_core::math::pose::Pose;
use ekf_core::overlap::{Overlap, ViewBody, predict_overlap};
use ekf_core::settings::OverlapSettings;
use nalgebra::{Matrix3, Matrix6, Rotation3, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use std::f64::consts::{FRAC_PI_2, PI};

/// 90 degrees wide, 2 atan(0.75) high.
fn camera() -> Camera {
    Camera::new("pinhole", 641, 481, [320.0, 320.0, 320.0, 240.0], &[]).unwrap()
}

/// What a prediction goes by: the settings, and the standard deviation of a pixel.
struct Options {
    settings: OverlapSettings,
    sigma_px: f64,
}

/// Views from half a metre to `far`, parallax as sharp as `sigma_px`.
fn options(far: f64, sigma_px: f64) -> Options {
    let settings = OverlapSettings { near: 0.5, far };
    Options { settings, sigma_px }
}

/// Ten metres and sharp parallax: the bodies as they are.
fn sharp() -> Options {
    options(10.0, 0.0)
}

fn predict(
    cs: &Camera,
    cf: &Camera,
    (rotation, t): (&Matrix3<f64>, &Vector3<f64>),
    sigma_t: &Matrix6<f64>,
    options: &Options,
) -> Option<Overlap> {
    let t_cf = Pose {
        rotation: *rotation,
        translation: *t,
    };
    predict_overlap(cs, cf, &t_cf, sigma_t, options.sigma_px, &options.settings)
}

fn sigma(translation: f64, rotation: f64) -> Matrix6<f64> {
    let (t, r) = (translation.powi(2), rotation.powi(2));
    Matrix6::from_diagonal(&nalgebra::Vector6::new(t, t, t, r, r, r))
}

fn close(a: [f64; 4], b: [f64; 4], tolerance: f64) -> bool {
    a.iter().zip(b).all(|(a, b)| (a - b).abs() <= tolerance)
}

#[test]
fn parallel_offset() {
    // F one metre to the right, same direction: in C its left border is x = 1 - z, which at the far end (10 m)
    // is at -0.9 z: u = 320 - 288 = 32. Mirrored in F.
    let camera = camera();
    let t = Vector3::new(1.0, 0.0, 0.0);
    let view = (&Matrix3::identity(), &t);
    let overlap = predict(&camera, &camera, view, &Matrix6::zeros(), &sharp()).unwrap();
    assert!(close(overlap.roi_s, [32.0, 0.0, 640.0, 480.0], 1e-9));
    assert!(close(overlap.roi_f, [0.0, 0.0, 608.0, 480.0], 1e-9));
    assert_eq!((overlap.d_max, overlap.baseline), (10.0, 1.0));
}

#[test]
fn useful_depth_follows_from_the_parallax() {
    // sd^2 = 2 (1/320)^2 + 0.01^2, alpha_u = 3 sd, d = 1 / (2 tan(alpha_u / 2)).
    let camera = camera();
    let settings = options(100.0, 1.0);
    let t = Vector3::new(1.0, 0.0, 0.0);
    let view = (&Matrix3::identity(), &t);
    let overlap = predict(&camera, &camera, view, &sigma(0.0, 0.01), &settings).unwrap();
    let alpha = 3.0 * (2.0 / 320.0_f64.powi(2) + 1e-4).sqrt();
    assert!((overlap.d_max - 1.0 / (2.0 * (alpha / 2.0).tan())).abs() < 1e-12);
    // Rotation about the baseline makes no parallax; the smaller of the other two counts.
    let mut about = Matrix6::zeros();
    about[(3, 3)] = 1e-4;
    about[(4, 4)] = 1e-4;
    let overlap = predict(&camera, &camera, view, &about, &settings).unwrap();
    let alpha = 3.0 * (2.0 / 320.0_f64.powi(2)).sqrt();
    assert!((overlap.d_max - 1.0 / (2.0 * (alpha / 2.0).tan())).abs() < 1e-12);
    // A baseline too short to be useful beyond the near distance.
    let t = Vector3::new(0.01, 0.0, 0.0);
    let view = (&Matrix3::identity(), &t);
    assert!(predict(&camera, &camera, view, &sigma(0.0, 0.01), &settings).is_none());
    let t = Vector3::zeros();
    let view = (&Matrix3::identity(), &t);
    assert!(predict(&camera, &camera, view, &sigma(0.0, 0.01), &settings).is_none());
}

#[test]
fn facing_each_other() {
    // F 4 m ahead, turned by 180 degrees about y, both see 3 m deep: they share z from 1 to 3 m in C. F's cross-section at z
    // has half width 4 - z, C's z: the shared part covers all directions up to |x| = z at z <= 2.
    let camera = camera();
    let turned = Rotation3::from_axis_angle(&Vector3::y_axis(), PI).into_inner();
    let t = Vector3::new(0.0, 0.0, 4.0);
    let near = options(3.0, 0.0);
    let overlap = predict(&camera, &camera, (&turned, &t), &Matrix6::zeros(), &near).unwrap();
    assert!(close(overlap.roi_s, [0.0, 0.0, 640.0, 480.0], 1e-9));
    assert!(close(overlap.roi_f, [0.0, 0.0, 640.0, 480.0], 1e-9));
    // At a distance of 5 m with 3 m of depth they share z from 2 to 3 m, where F reaches to x = 3 at z = 2
    // and C to x = 2: still the whole image. At 5.9 m the slice from 2.9 to 3 is left.
    let t = Vector3::new(0.0, 0.0, 5.9);
    assert!(predict(&camera, &camera, (&turned, &t), &Matrix6::zeros(), &near).is_some());
    let t = Vector3::new(0.0, 0.0, 6.1);
    assert!(predict(&camera, &camera, (&turned, &t), &Matrix6::zeros(), &near).is_none());
}

#[test]
fn side_by_side_looking_apart_and_back_to_back() {
    let camera = camera();
    let none = Matrix6::zeros();
    // F to the right, turned right by 90 degrees: C's right border and F's left border are parallel, 1 m apart.
    let right = Rotation3::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2).into_inner();
    let t = Vector3::new(1.0, 0.0, 0.0);
    assert!(predict(&camera, &camera, (&right, &t), &none, &sharp()).is_none());
    // To the left instead, the strip between the borders is shared: x from z - 1 to z in C, so at 10 m only
    // u >= 320 + 288, and from 0.5 m on everything: F's left border x = z - 1 passes C's left border at z = 0.5.
    let t = Vector3::new(-1.0, 0.0, 0.0);
    let overlap = predict(&camera, &camera, (&right, &t), &none, &sharp()).unwrap();
    assert!((overlap.roi_s[2] - 640.0).abs() < 1e-9);
    assert!(overlap.roi_s[0] < 320.0);
    // Back to back, with and without distance.
    let turned = Rotation3::from_axis_angle(&Vector3::y_axis(), PI).into_inner();
    for z in [-0.1, -3.0] {
        let t = Vector3::new(0.0, 0.0, z);
        assert!(predict(&camera, &camera, (&turned, &t), &none, &sharp()).is_none());
    }
}

#[test]
fn growth_opens_the_view() {
    let camera = camera();
    let right = Rotation3::from_axis_angle(&Vector3::y_axis(), FRAC_PI_2 + 0.05).into_inner();
    let t = Vector3::new(0.05, 0.0, 0.0);
    let settings = options(100.0, 0.0);
    let at = |cov: &Matrix6<f64>| predict(&camera, &camera, (&right, &t), cov, &settings);
    // Looking apart; with a sharp baseline axis (no useful limit) only the uncertainty makes them meet.
    let mut turn = Matrix6::zeros();
    assert!(at(&turn).is_none());
    turn[(4, 4)] = 0.05_f64.powi(2);
    assert!(at(&turn).is_some());
    // More uncertainty never makes a region smaller.
    let t = Vector3::new(0.8, 0.1, 0.2);
    let tilt = Rotation3::from_euler_angles(0.1, 0.3, -0.2).into_inner();
    let mut last: Option<[f64; 8]> = None;
    for scale in [0.0, 0.2, 0.5, 1.0] {
        let cov = sigma(0.1 * scale, 0.0);
        let o = predict(&camera, &camera, (&tilt, &t), &cov, &sharp()).unwrap();
        let now = [
            -o.roi_s[0],
            -o.roi_s[1],
            o.roi_s[2],
            o.roi_s[3],
            -o.roi_f[0],
            -o.roi_f[1],
            o.roi_f[2],
            o.roi_f[3],
        ];
        if let Some(last) = last {
            assert!(now.iter().zip(last).all(|(now, last)| *now >= last - 1e-9));
        }
        last = Some(now);
    }
}

/// Every point that both cameras see, under any pose within the growth, lies in both regions.
#[test]
fn regions_hold_every_common_point() {
    let mut rng = Pcg64::seed_from_u64(21);
    let fisheye = Camera::new(
        "fisheye",
        512,
        512,
        [190.0, 190.0, 255.0, 257.0],
        &[0.003, 0.001, -0.002, 0.0002],
    )
    .unwrap();
    let radtan = Camera::new(
        "radtan",
        752,
        480,
        [458.0, 457.0, 367.0, 248.0],
        &[-0.283, 0.074, 0.0002, 0.00002],
    )
    .unwrap();
    let mut hits = 0;
    for trial in 0..60 {
        let (cs, cf) = match trial % 3 {
            0 => (&radtan, &radtan),
            1 => (&fisheye, &radtan),
            _ => (&radtan, &fisheye),
        };
        let mut vector = |scale: f64| {
            Vector3::new(
                rng.random_range(-scale..scale),
                rng.random_range(-scale..scale),
                rng.random_range(-scale..scale),
            )
        };
        let (t, turn) = (vector(1.0), vector(0.8));
        let rotation = Rotation3::from_scaled_axis(turn).into_inner();
        let (st, sr) = (0.02, 0.01);
        let settings = Options {
            settings: OverlapSettings {
                far: 8.0,
                ..OverlapSettings::default()
            },
            sigma_px: 1.0,
        };
        let overlap = predict(cs, cf, (&rotation, &t), &sigma(st, sr), &settings);
        let far = overlap.map_or(2.0, |o| o.d_max);
        for _ in 0..3000 {
            let mut unit = |s: f64| {
                let v: Vector3<f64> = Vector3::new(
                    rng.random_range(-1.0..1.0),
                    rng.random_range(-1.0..1.0),
                    rng.random_range(-1.0..1.0),
                );
                v / v.norm().max(1.0) * s
            };
            let (dt, dr) = (unit(3.0 * st), unit(3.0 * sr));
            let true_rotation = rotation * Rotation3::from_scaled_axis(dr).into_inner();
            let true_t = t + rotation * dt;
            let pixel = nalgebra::Vector2::new(
                rng.random_range(0.0..f64::from(cs.width - 1)),
                rng.random_range(0.0..f64::from(cs.height - 1)),
            );
            let Some(ray) = cs.unproject(&pixel) else {
                continue;
            };
            let p_c = ray / ray.z * rng.random_range(0.3..far);
            let p_f = true_rotation.transpose() * (p_c - true_t);
            if p_f.z < 0.3 || p_f.z > far {
                continue;
            }
            let Some(seen) = cf.project(&p_f).filter(|uv| cf.in_image(uv, 0.0)) else {
                continue;
            };
            let Some(overlap) = overlap else { continue };
            hits += 1;
            let inside = |roi: [f64; 4], uv: nalgebra::Vector2<f64>| {
                uv.x >= roi[0] - 0.5
                    && uv.y >= roi[1] - 0.5
                    && uv.x <= roi[2] + 0.5
                    && uv.y <= roi[3] + 0.5
            };
            assert!(inside(overlap.roi_s, pixel), "{overlap:?} {pixel:?}");
            assert!(inside(overlap.roi_f, seen), "{overlap:?} {seen:?}");
        }
    }
    assert!(hits > 10_000, "{hits}");
}

#[test]
fn body_of_a_view() {
    let body = ViewBody::new(&camera(), 0.5, 10.0).unwrap();
    assert!(body.contains(&Vector3::new(0.0, 0.0, 1.0)));
    assert!(body.contains(&Vector3::new(0.99, 0.74, 1.0)));
    assert!(!body.contains(&Vector3::new(1.01, 0.0, 1.0)));
    assert!(!body.contains(&Vector3::new(0.0, 0.0, 0.49)));
    assert!(!body.contains(&Vector3::new(0.0, 0.0, 10.01)));
    for corner in &body.corners {
        assert!(body.contains(corner));
    }
    let t = Vector3::new(0.0, 2.0, 0.0);
    let moved = body.moved(&Matrix3::identity(), &t);
    assert!(moved.contains(&Vector3::new(0.0, 2.0, 1.0)));
    assert!(!moved.contains(&Vector3::new(0.0, 0.5, 1.0)));
    assert!(ViewBody::new(&camera(), 1.0, 0.5).is_none());
}
