//! Camera models: Jacobians against differences, round trips, OpenCV's values, folds.

use ekf_core::camera::{Camera, Distortion};
use ekf_core::error::EkfError;
use nalgebra::{Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;

/// One camera of every kind, barrel and pincushion.
fn cameras() -> Vec<Camera> {
    let radtan = [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0.01];
    let fisheye = [
        0.0034823894022493434,
        0.0007150348452162257,
        -0.0020532361418706202,
        0.00020293673591811182,
    ];
    let euroc = [458.654, 457.296, 367.215, 248.375];
    let tum_vi = [190.97847715, 190.9733071, 254.93170606, 256.8974428];
    let davison = [195.0, 196.0, 162.0, 125.0];
    let kinect = [608.0, 608.5, 638.0, 366.0];
    let rational = [0.536, -2.62, 8e-4, -1.4e-4, 1.52, 0.414, -2.45, 1.45];
    [
        ("pinhole", 752, 480, euroc, &[][..]),
        ("radtan", 752, 480, euroc, &radtan[..]),
        (
            "radtan",
            640,
            480,
            euroc,
            &[0.2, -0.5, 0.003, -0.002, 0.6][..],
        ),
        ("radtan", 640, 480, euroc, &[-0.3, 0.1, 0.002, 0.001][..]),
        ("fisheye", 512, 512, tum_vi, &fisheye[..]),
        ("fisheye", 512, 512, tum_vi, &[-0.05, 0.01, -0.003, 0.0][..]),
        ("wideangle", 320, 240, davison, &[6e-6][..]),
        ("wideangle", 320, 240, davison, &[-2e-6][..]),
        ("radtan", 1280, 720, kinect, &rational[..]),
    ]
    .into_iter()
    .map(|(model, width, height, intrinsics, distortion)| {
        Camera::new(model, width, height, intrinsics, distortion).unwrap()
    })
    .collect()
}

/// A pixel somewhere in the image, by preference not in a corner nobody can see.
fn random_pixel(camera: &Camera, rng: &mut Pcg64) -> Vector2<f64> {
    Vector2::new(
        rng.random_range(0.0..f64::from(camera.width) - 1.0),
        rng.random_range(0.0..f64::from(camera.height) - 1.0),
    )
}

#[test]
fn projection_jacobian_matches_differences() {
    let mut rng = Pcg64::seed_from_u64(1);
    for camera in cameras() {
        for trial in 0..300 {
            let ray = if trial < 10 {
                // On and near the axis, where the models divide by the radius.
                let r = [0.0, 1e-12, 1e-8, 1e-6, 3e-5, 1e-4, 1.1e-4, 1e-3, 1e-2, 0.05][trial];
                Vector3::new(r, -0.3 * r, 1.0)
            } else {
                match camera.unproject(&random_pixel(&camera, &mut rng)) {
                    Some(ray) => ray,
                    None => continue,
                }
            };
            let p = ray * rng.random_range(0.3..20.0);
            let (uv, jac) = camera.project_jac(&p).unwrap();
            assert!((uv - camera.project(&p).unwrap()).norm() < 1e-10);
            let scale = jac.amax();
            for axis in 0..3 {
                let h = 1e-5 * p.norm();
                let mut e = Vector3::zeros();
                e[axis] = h;
                // Fourth-order central difference.
                let f = |k: f64| camera.project(&(p + e * k)).unwrap();
                let numeric = ((f(1.0) - f(-1.0)) * 8.0 - (f(2.0) - f(-2.0))) / (12.0 * h);
                let error = (numeric - jac.column(axis)).amax();
                assert!(error < 1e-6 * scale, "{camera:?} {p:?} {error} {scale}");
            }
        }
    }
}

#[test]
fn unprojection_jacobian_matches_differences() {
    let mut rng = Pcg64::seed_from_u64(2);
    for camera in cameras() {
        for trial in 0..300 {
            let uv = if trial == 0 {
                Vector2::new(camera.cx, camera.cy)
            } else {
                random_pixel(&camera, &mut rng)
            };
            let Some((ray, jac)) = camera.unproject_jac(&uv) else {
                continue;
            };
            assert!((ray.norm() - 1.0).abs() < 1e-14);
            for axis in 0..2 {
                let h = 1e-2;
                let mut e = Vector2::zeros();
                e[axis] = h;
                let at = |k: f64| camera.unproject(&(uv + e * k)).unwrap();
                let numeric = ((at(1.0) - at(-1.0)) * 8.0 - (at(2.0) - at(-2.0))) / (12.0 * h);
                let error = (numeric - jac.column(axis)).amax();
                assert!(error < 1e-6 * jac.amax(), "{camera:?} {uv:?} {error}");
            }
        }
    }
}

#[test]
fn round_trip_to_a_billionth_of_a_pixel() {
    let mut rng = Pcg64::seed_from_u64(3);
    for camera in cameras() {
        let mut reached = 0;
        for _ in 0..1000 {
            let uv = random_pixel(&camera, &mut rng);
            let Some(ray) = camera.unproject(&uv) else {
                continue;
            };
            reached += 1;
            let back = camera.project(&(ray * 3.7)).unwrap();
            assert!((back - uv).norm() < 1e-9, "{camera:?} {uv:?} {back:?}");
            let again = camera.unproject(&back).unwrap();
            assert!((again - ray).norm() < 1e-9);
        }
        assert!(reached > 800, "{camera:?} reached only {reached}");
    }
}

/// cv2.projectPoints and cv2.fisheye.projectPoints of `points`, zero rvec and tvec, with the parameters below.
#[test]
fn agrees_with_opencv() {
    let points = [
        [0.0, 0.0, 1.0],
        [0.3, -0.2, 1.1],
        [-1.2, 0.7, 2.0],
        [0.05, 0.9, 1.5],
        [1e-6, -2e-6, 1.0],
    ];
    let radtan = [
        [367.215, 248.375],
        [488.5952945708791, 167.70448352641358],
        [124.57862788470266, 389.5387954763813],
        [381.09995151435254, 497.5437258452116],
        [367.2154586539997, 248.37408540800112],
    ];
    let fisheye = [
        [254.93170606, 256.8974428],
        [305.2810082787542, 223.33215000406307],
        [154.65295630856588, 315.39179658953856],
        [260.6697961685053, 360.1802686692761],
        [254.93189703847716, 256.8970608533858],
    ];
    let rational = [
        [638.0, 366.0],
        [805.5776710200198, 254.23587799353407],
        [260.3915075148547, 586.663668605767],
        [658.8233684942825, 741.8583974380281],
        [638.0006079999974, 365.99878300000665],
    ];
    let all = cameras();
    for (camera, expected) in [(&all[1], radtan), (&all[4], fisheye), (&all[8], rational)] {
        for (point, pixel) in points.iter().zip(expected) {
            let uv = camera.project(&Vector3::from(*point)).unwrap();
            assert!(
                (uv - Vector2::from(pixel)).norm() < 1e-9,
                "{point:?} {uv:?}"
            );
        }
    }
}

#[test]
fn davison_relation_holds() {
    let camera = &cameras()[6];
    let p = Vector3::new(0.4, -0.3, 0.8);
    let uv = camera.project(&p).unwrap();
    let undistorted = Vector2::new(camera.fx * 0.5, camera.fy * -0.375);
    let centred = uv - Vector2::new(camera.cx, camera.cy);
    let (ru2, rd2) = (undistorted.norm_squared(), centred.norm_squared());
    assert!((ru2 * (1.0 - 2.0 * 6e-6 * rd2) - rd2).abs() < 1e-9 * ru2);
}

#[test]
fn points_without_an_image_give_none() {
    let barrel = Camera::new(
        "radtan",
        640,
        480,
        [400.0, 400.0, 320.0, 240.0],
        &[-0.3, 0.0, 0.0, 0.0],
    )
    .unwrap();
    // r - 0.3 r^3 turns at r = 1 / sqrt(0.9) = 1.0541, where it reaches 0.7027: pixel 320 + 281.1.
    assert!(barrel.project(&Vector3::new(1.054, 0.0, 1.0)).is_some());
    assert!(barrel.project(&Vector3::new(1.055, 0.0, 1.0)).is_none());
    assert!(barrel.project_jac(&Vector3::new(1.5, 0.0, 1.0)).is_none());
    assert!(barrel.unproject(&Vector2::new(601.0, 240.0)).is_some());
    assert!(barrel.unproject(&Vector2::new(601.2, 240.0)).is_none());
    // theta - 0.2 theta^3 turns at theta = 1 / sqrt(0.6) = 1.291.
    let fish = Camera::new(
        "fisheye",
        640,
        480,
        [200.0, 200.0, 320.0, 240.0],
        &[-0.2, 0.0, 0.0, 0.0],
    )
    .unwrap();
    assert!(
        fish.project(&Vector3::new(1.29_f64.tan(), 0.0, 1.0))
            .is_some()
    );
    assert!(
        fish.project(&Vector3::new(1.292_f64.tan(), 0.0, 1.0))
            .is_none()
    );
    // No real root beyond r_u = 1 / sqrt(-2 K) = 500 px; no pixel beyond r_d = 1 / sqrt(2 K).
    let wide = Camera::new(
        "wideangle",
        320,
        240,
        [200.0, 200.0, 160.0, 120.0],
        &[-2e-6],
    )
    .unwrap();
    assert!(wide.project(&Vector3::new(2.49, 0.0, 1.0)).is_some());
    assert!(wide.project(&Vector3::new(2.51, 0.0, 1.0)).is_none());
    let wide = Camera::new("wideangle", 320, 240, [200.0, 200.0, 160.0, 120.0], &[2e-5]).unwrap();
    assert!(
        wide.unproject(&Vector2::new(160.0 + 158.0, 120.0))
            .is_some()
    );
    assert!(
        wide.unproject(&Vector2::new(160.0 + 158.2, 120.0))
            .is_none()
    );
    for camera in cameras() {
        for p in [
            [0.1, 0.1, 0.0],
            [0.0, 0.0, -1.0],
            [0.0, 0.0, 1e-7],
            [f64::NAN, 0.0, 1.0],
        ] {
            assert!(camera.project(&Vector3::from(p)).is_none());
            assert!(camera.project_jac(&Vector3::from(p)).is_none());
        }
        assert!(camera.unproject(&Vector2::new(f64::NAN, 0.0)).is_none());
    }
}

#[test]
fn image_border_and_margin() {
    let camera = &cameras()[0];
    assert!(camera.in_image(&Vector2::new(0.0, 0.0), 0.0));
    assert!(camera.in_image(&Vector2::new(751.0, 479.0), 0.0));
    assert!(!camera.in_image(&Vector2::new(751.1, 100.0), 0.0));
    assert!(!camera.in_image(&Vector2::new(4.9, 100.0), 5.0));
    assert!(!camera.in_image(&Vector2::new(f64::NAN, 100.0), 0.0));
}

#[test]
fn bad_calibrations_are_refused() {
    let k = [400.0, 400.0, 320.0, 240.0];
    assert!(matches!(
        Camera::new("kannala", 640, 480, k, &[]),
        Err(EkfError::InvalidInput { .. })
    ));
    assert!(matches!(
        Camera::new("radtan", 640, 480, k, &[0.1; 3]),
        Err(EkfError::BadShape { .. })
    ));
    assert!(matches!(
        Camera::new("pinhole", 640, 480, k, &[0.1]),
        Err(EkfError::BadShape { .. })
    ));
    assert!(matches!(
        Camera::new("fisheye", 640, 480, k, &[f64::NAN; 4]),
        Err(EkfError::NonFinite { .. })
    ));
    assert!(matches!(
        Camera::new("pinhole", 0, 480, k, &[]),
        Err(EkfError::InvalidInput { .. })
    ));
    assert!(matches!(
        Camera::new("pinhole", 640, 480, [0.0, 1.0, 0.0, 0.0], &[]),
        Err(EkfError::InvalidInput { .. })
    ));
    let camera = Camera::new("wideangle", 320, 240, k, &[6e-6]).unwrap();
    assert_eq!(camera.distortion, Distortion::WideAngle(6e-6));
    assert_eq!(
        (camera.model(), camera.distortion_parameters()),
        ("wideangle", &[6e-6][..])
    );
}
