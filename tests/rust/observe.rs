//! Every analytic Jacobian against central differences at random states, to 1e-6 relative, by one checker.

use crate::scene::{camera, normals, rng};
use ekf_core::Camera;
use ekf_core::birth::new_feature::{FirstPoseCovariance, NewFeature};
use ekf_core::birth::two_view::TwoView;
use ekf_core::math::{inverse_depth, pose::Pose, quat};
use ekf_core::observe::point::CameraPose;
use ekf_core::observe::{FeatureState, PointInCamera, Rows, Shutter};
use ekf_core::predict;
use ekf_core::settings::{MotionModel, ProcessSettings};
use nalgebra::{
    DMatrix, DVector, Matrix2, Matrix3, SMatrix, SVector, Vector2, Vector3, Vector4, Vector6,
};
use rand::Rng;
use rand_pcg::Pcg64;

/// Compares `analytic` with central differences of `f` at `x`, relative to the largest entry.
fn check<const R: usize, const C: usize>(
    what: &str,
    x: &SMatrix<f64, C, 1>,
    analytic: &SMatrix<f64, R, C>,
    f: impl Fn(&SMatrix<f64, C, 1>) -> SMatrix<f64, R, 1>,
) {
    let mut numeric = SMatrix::<f64, R, C>::zeros();
    for c in 0..C {
        // Fourth-order differences: truncation and rounding both stay below 1e-9.
        let h = 1e-3 * x[c].abs().max(0.1);
        let at = |k: f64| {
            let mut y = *x;
            y[c] += k * h;
            f(&y)
        };
        let column = (at(-2.0) - at(2.0) + (at(1.0) - at(-1.0)) * 8.0) / (12.0 * h);
        numeric.set_column(c, &column);
    }
    let scale = numeric.abs().max().max(1e-9);
    let worst = (analytic - numeric).abs().max() / scale;
    assert!(
        worst < 1e-6,
        "{what}: off by {worst:e}\nanalytic {analytic}numeric {numeric}"
    );
}

fn random_quat(rng: &mut Pcg64) -> Vector4<f64> {
    normals::<4>(rng).normalize()
}

/// A camera and a feature some metres in front of it.
fn random_view(rng: &mut Pcg64) -> (CameraPose, FeatureState) {
    let pose = CameraPose {
        r: normals::<3>(rng),
        q: random_quat(rng),
    };
    let in_c = Vector3::new(
        rng.random_range(-1.0..1.0),
        rng.random_range(-0.7..0.7),
        rng.random_range(2.0..6.0),
    );
    let point = quat::rotation(&pose.q) * in_c + pose.r;
    let anchor = pose.r + normals::<3>(rng) * 0.3;
    let (angles, _) = inverse_depth::angles(&(point - anchor));
    let rho = 1.0 / (point - anchor).norm();
    let numbers = Vector6::new(anchor.x, anchor.y, anchor.z, angles[0], angles[1], rho);
    (pose, FeatureState(numbers))
}

/// As [`check`], of what depends on the numbers of a feature.
fn check_by_feature<const R: usize>(
    what: &str,
    feature: &FeatureState,
    analytic: &SMatrix<f64, R, 6>,
    f: impl Fn(&FeatureState) -> SMatrix<f64, R, 1>,
) {
    check(what, &feature.0, analytic, |y| f(&FeatureState(*y)));
}

fn pose_of(x: &SMatrix<f64, 7, 1>) -> CameraPose {
    CameraPose {
        r: x.fixed_rows::<3>(0).into_owned(),
        q: x.fixed_rows::<4>(3).into_owned(),
    }
}

fn vector_of(pose: &CameraPose) -> SMatrix<f64, 7, 1> {
    let mut x = SMatrix::<f64, 7, 1>::zeros();
    x.fixed_rows_mut::<3>(0).copy_from(&pose.r);
    x.fixed_rows_mut::<4>(3).copy_from(&pose.q);
    x
}

#[test]
fn quaternions() {
    let mut rng = rng(1);
    for _ in 0..50 {
        // Away from unit length too: R(q) normalises.
        let q = normals::<4>(&mut rng) * 1.3;
        let v = normals::<3>(&mut rng);
        check("R v", &q, &quat::rotate_jacobian(&q, &v), |q| {
            quat::rotation(q) * v
        });
        check("R^T v", &q, &quat::rotate_inverse_jacobian(&q, &v), |q| {
            quat::rotation(q).transpose() * v
        });
        check("q / |q|", &q, &quat::normalise_jacobian(&q), |q| {
            q / q.norm()
        });
        let w = normals::<3>(&mut rng);
        check("exp", &w, &quat::exp_jacobian(&w), quat::exp);
        let tiny = w * 1e-7;
        check(
            "exp near zero",
            &tiny,
            &quat::exp_jacobian(&tiny),
            quat::exp,
        );
        let unit = random_quat(&mut rng);
        check("lift", &Vector3::zeros(), &quat::lift(&unit), |w| {
            quat::left(&unit) * quat::exp(w)
        });
        check("right Jacobian", &w, &quat::right_jacobian(&w), |x| {
            // Exp(w)^-1 Exp(x), as a rotation vector near zero.
            let mut back = quat::exp(&w);
            back.fixed_rows_mut::<3>(1).neg_mut();
            quat::log(&(quat::left(&back) * quat::exp(x)))
        });
    }
}

/// Where the closed form would lose its digits, `d(sin(a/2)/a)/da / a` is its limit but for a share of a^2 / 40.
#[test]
fn a_small_turns_curvature_keeps_its_digits() {
    for angle in [1e-6, 1e-5, 9.9e-5] {
        let w = Vector3::new(0.6, 0.8, 0.0) * angle;
        let curvature = quat::exp_jacobian(&w)[(1, 1)] / (w.x * w.y);
        let off = -24.0 * curvature - 1.0;
        assert!(
            (off + angle * angle / 40.0).abs() < 1e-12,
            "{angle}: {off:e}"
        );
    }
}

#[test]
fn hamilton_products() {
    let (i, j, k) = (
        Vector4::new(0.0, 1.0, 0.0, 0.0),
        Vector4::new(0.0, 0.0, 1.0, 0.0),
        Vector4::new(0.0, 0.0, 0.0, 1.0),
    );
    assert_eq!(quat::left(&i) * j, k);
    assert_eq!(quat::right(&j) * i, k);
    let mut rng = rng(2);
    for _ in 0..20 {
        let (a, b) = (random_quat(&mut rng), random_quat(&mut rng));
        let product = quat::rotation(&(quat::left(&a) * b));
        assert!(
            (product - quat::rotation(&a) * quat::rotation(&b))
                .abs()
                .max()
                < 1e-12
        );
        let back = quat::from_rotation(&quat::rotation(&a));
        let sign = if a[0] < 0.0 { -1.0 } else { 1.0 };
        assert!((back - a * sign).abs().max() < 1e-12);
    }
}

#[test]
fn ray_conventions() {
    // theta = atan2(x, z), phi = atan2(-y, hypot(x, z)); y points down, so a ray upwards has phi > 0.
    let (angles, _) = inverse_depth::angles(&Vector3::new(0.0, -2.0, 2.0));
    assert!((angles - Vector2::new(0.0, std::f64::consts::FRAC_PI_4)).norm() < 1e-15);
    let mut rng = rng(3);
    for _ in 0..50 {
        let h = normals::<3>(&mut rng);
        let (angles, jacobian) = inverse_depth::angles(&h);
        check("angles", &h, &jacobian, |h| inverse_depth::angles(h).0);
        assert!((inverse_depth::ray(angles[0], angles[1]) - h.normalize()).norm() < 1e-12);
        let (by_theta, by_phi) = inverse_depth::ray_jacobian(angles[0], angles[1]);
        check(
            "ray",
            &angles,
            &SMatrix::<f64, 3, 2>::from_columns(&[by_theta, by_phi]),
            |a| inverse_depth::ray(a[0], a[1]),
        );
    }
}

#[test]
fn observations() {
    let mut rng = rng(4);
    let camera = camera();
    for _ in 0..100 {
        let (pose, feature) = random_view(&mut rng);
        let x = vector_of(&pose);
        let scaled = PointInCamera::scaled(&pose, &feature);
        check("Eq. 7 by pose", &x, &scaled.by_pose, |x| {
            PointInCamera::scaled(&pose_of(x), &feature).value
        });
        check_by_feature("Eq. 7 by feature", &feature, &scaled.by_feature, |y| {
            PointInCamera::scaled(&pose, y).value
        });
        let metric = PointInCamera::metric(&pose, &feature).expect("rho > 0");
        check("Eq. 5 by pose", &x, &metric.by_pose, |x| {
            PointInCamera::metric(&pose_of(x), &feature)
                .expect("rho > 0")
                .value
        });
        check_by_feature("Eq. 5 by feature", &feature, &metric.by_feature, |y| {
            PointInCamera::metric(&pose, y).expect("rho > 0").value
        });
        check_by_feature("point", &feature, &feature.point_jacobian(), |y| {
            y.point().expect("rho > 0")
        });
        let zero = Vector2::zeros();
        // The innovation is measured minus predicted, so with a measurement of zero it is minus the prediction.
        let predicted = |pose: &CameraPose, feature: &FeatureState| -> Vector2<f64> {
            let rows = Rows::bearing(&camera, pose, feature, &zero, 1.0, None).expect("visible");
            -rows.innovation.fixed_rows::<2>(0).into_owned()
        };
        let rows = Rows::bearing(&camera, &pose, &feature, &zero, 1.0, None).expect("visible");
        let by_pose = rows.by_pose.fixed_rows::<2>(0).into_owned();
        check("bearing by pose", &x, &by_pose, |x| {
            predicted(&pose_of(x), &feature)
        });
        let by_feature = rows.by_feature.fixed_rows::<2>(0).into_owned();
        check_by_feature("bearing by feature", &feature, &by_feature, |y| {
            predicted(&pose, y)
        });
        rolling_bearing(&camera, &pose, &feature, &normals::<6>(&mut rng));
    }
}

/// A pixel of a shutter that rolls, by pose, velocities, readout and feature.
fn rolling_bearing(
    camera: &Camera,
    pose: &CameraPose,
    feature: &FeatureState,
    twist: &Vector6<f64>,
) {
    let at = Vector2::new(200.0, 400.0);
    let motion: SVector<f64, 7> = twist.push(0.03);
    let predicted = |pose: &CameraPose, motion: &SVector<f64, 7>, feature: &FeatureState| {
        let shutter = Shutter {
            offset: 13,
            readout: motion[6],
            height: 480.0,
            velocity: motion.fixed_rows::<3>(0).into_owned(),
            turning: motion.fixed_rows::<3>(3).into_owned(),
            is_speed_known: true,
        };
        Rows::bearing(camera, pose, feature, &at, 1.0, Some(&shutter)).expect("visible")
    };
    let pixel = |rows: Rows| -> Vector2<f64> { -rows.innovation.fixed_rows::<2>(0).into_owned() };
    let rows = predicted(pose, &motion, feature);
    let by_motion = rows.by_motion.expect("a shutter").by;
    let by_motion = by_motion.fixed_rows::<2>(0).into_owned();
    check("rolling bearing by motion", &motion, &by_motion, |motion| {
        pixel(predicted(pose, motion, feature))
    });
    let by_pose = rows.by_pose.fixed_rows::<2>(0).into_owned();
    check("rolling bearing by pose", &vector_of(pose), &by_pose, |x| {
        pixel(predicted(&pose_of(x), &motion, feature))
    });
    let by_feature = rows.by_feature.fixed_rows::<2>(0).into_owned();
    check_by_feature("rolling bearing by feature", feature, &by_feature, |y| {
        pixel(predicted(pose, &motion, y))
    });
}

fn random_worn(rng: &mut Pcg64) -> Pose {
    Pose {
        rotation: quat::rotation(&quat::exp(&(normals::<3>(rng) * 0.15))),
        translation: Vector3::new(0.6, -0.2, 0.1) + normals::<3>(rng) * 0.1,
    }
}

#[test]
fn a_pixel_is_as_noisy_as_is_said() {
    let (pose, feature) = random_view(&mut rng(6));
    for sigma in [0.3, 2.0] {
        let rows = Rows::bearing(&camera(), &pose, &feature, &Vector2::zeros(), sigma, None);
        let noise = rows.expect("visible").noise;
        assert!(
            (noise.fixed_view::<2, 2>(0, 0) - Matrix2::identity() * sigma.powi(2)).amax() < 1e-15
        );
    }
}

#[test]
fn worn_pixel_rows() {
    let mut rng = rng(5);
    let camera = camera();
    for _ in 0..100 {
        let (pose, feature) = random_view(&mut rng);
        let t_cf = random_worn(&mut rng);
        let error = normals::<6>(&mut rng) * 0.02;
        let rows = |pose: &CameraPose, feature: &FeatureState, error: &Vector6<f64>| {
            let t_cf = (&t_cf, error);
            Rows::worn_pixel(&camera, t_cf, pose, feature, &Vector2::zeros(), 1.0).expect("visible")
        };
        let predicted =
            |rows: Rows| -> Vector2<f64> { -rows.innovation.fixed_rows::<2>(0).into_owned() };
        let at = rows(&pose, &feature, &error);
        let two = |m: &SMatrix<f64, 3, 6>| m.fixed_rows::<2>(0).into_owned();
        check(
            "Cf pixel by pose",
            &vector_of(&pose),
            &at.by_pose.fixed_rows::<2>(0).into_owned(),
            |x| predicted(rows(&pose_of(x), &feature, &error)),
        );
        check_by_feature("Cf pixel by feature", &feature, &two(&at.by_feature), |y| {
            predicted(rows(&pose, y, &error))
        });
        let by_error = at.by_shared.expect("depends on T_CF");
        check("Cf pixel by T_CF", &error, &two(&by_error), |e| {
            predicted(rows(&pose, &feature, e))
        });
    }
}

/// A pixel pair of one point, in general position (not exactly on the epipolar plane).
fn random_pair(rng: &mut Pcg64, camera: &Camera, other: &Pose) -> (Vector2<f64>, Vector2<f64>) {
    let point = Vector3::new(
        rng.random_range(-1.0..1.0),
        rng.random_range(-0.7..0.7),
        rng.random_range(2.0..5.0),
    );
    let uv = camera.project(&point).expect("in front");
    let uv_other = camera
        .project(&other.inverse().apply(&point))
        .expect("in front");
    (uv, uv_other + normals::<2>(rng) * 0.5)
}

#[test]
fn two_view_by_pixels_and_pose() {
    let mut rng = rng(6);
    let camera = camera();
    for _ in 0..50 {
        let other = random_worn(&mut rng);
        let (uv, uv2) = random_pair(&mut rng, &camera, &other);
        let view = TwoView::new(&camera, &uv, &camera, &uv2, &other).expect("they meet");
        // Eq. 8's order: (u2, v2, u1, v1).
        let pixels = SMatrix::<f64, 4, 1>::new(uv2.x, uv2.y, uv.x, uv.y);
        let mut by = SMatrix::<f64, 1, 4>::zeros();
        by.fixed_view_mut::<1, 2>(0, 0)
            .copy_from(&view.rho_by_other_pixel);
        by.fixed_view_mut::<1, 2>(0, 2)
            .copy_from(&view.rho_by_pixel);
        check("rho by 4 pixel coordinates", &pixels, &by, |x| {
            let (uv2, uv) = (x.fixed_rows::<2>(0).into(), x.fixed_rows::<2>(2).into());
            let there = TwoView::new(&camera, &uv, &camera, &uv2, &other).expect("they meet");
            SMatrix::<f64, 1, 1>::new(there.rho)
        });
        let tangent = |xi: &Vector6<f64>| {
            TwoView::new(&camera, &uv, &camera, &uv2, &other.retract(xi)).expect("they meet")
        };
        let zero = Vector6::zeros();
        check("rho by tangent", &zero, &view.rho_by_tangent(), |xi| {
            SMatrix::<f64, 1, 1>::new(tangent(xi).rho)
        });
        check("point by tangent", &zero, &view.point_by_tangent(), |xi| {
            tangent(xi).point()
        });
        // Law of sines, as METHOD 5 writes it.
        let (a, b) = (view.ray, other.rotation * view.other_ray);
        let t = other.translation;
        let beta = a.angle(&t);
        let gamma = b.angle(&-t);
        let alpha = std::f64::consts::PI - beta - gamma;
        let law = alpha.sin() / (t.norm() * gamma.sin());
        assert!((law / view.rho - 1.0).abs() < 1e-9);
    }
}

#[test]
fn delayed_birth_depends_on_both_poses() {
    let mut rng = rng(7);
    let camera = camera();
    for _ in 0..30 {
        let now = CameraPose {
            r: normals::<3>(&mut rng),
            q: random_quat(&mut rng),
        };
        let offset = random_worn(&mut rng);
        let rotation = quat::rotation(&now.q);
        let first = CameraPose {
            r: rotation * offset.translation + now.r,
            q: quat::from_rotation(&(rotation * offset.rotation)),
        };
        let (uv, uv_first) = random_pair(&mut rng, &camera, &offset);
        let born = |now: &CameraPose, first: &CameraPose| {
            let r_cw = quat::rotation(&now.q).transpose();
            let relative = Pose {
                rotation: r_cw * quat::rotation(&first.q),
                translation: r_cw * (first.r - now.r),
            };
            let view =
                TwoView::new(&camera, &uv, &camera, &uv_first, &relative).expect("they meet");
            let warp = camera.warp_jacobian(&uv);
            let mut new = NewFeature::from_two_views(now, &view, &warp, (1.0, 1.0));
            new.depend_on_first_pose(now, first, &view, FirstPoseCovariance::InState(13));
            new
        };
        let new = born(&now, &first);
        check("birth by pose now", &vector_of(&now), &new.by_pose, |x| {
            born(&pose_of(x), &first).mean
        });
        let by_first = new.by_others[0].by;
        check("birth by first pose", &vector_of(&first), &by_first, |x| {
            born(&now, &pose_of(x)).mean
        });
    }
}

#[test]
fn birth_from_a_point() {
    let mut rng = rng(8);
    for _ in 0..30 {
        let pose = CameraPose {
            r: normals::<3>(&mut rng),
            q: random_quat(&mut rng),
        };
        let point = Vector3::new(0.3, -0.2, 3.0) + normals::<3>(&mut rng) * 0.3;
        let noise = Matrix3::zeros();
        let identity = SMatrix::<f64, 3, 6>::identity();
        let new = NewFeature::from_point(&pose, &point, &noise, Some((0, &identity)));
        check(
            "point birth by pose",
            &vector_of(&pose),
            &new.by_pose,
            |x| NewFeature::from_point(&pose_of(x), &point, &noise, None).mean,
        );
        let by = new.by_others[0].by;
        let by_point = by.fixed_view::<6, 3>(0, 0).into_owned();
        check("point birth by point", &point, &by_point, |p| {
            NewFeature::from_point(&pose, p, &noise, None).mean
        });
    }
}

#[test]
fn motion_model() {
    let mut rng = rng(9);
    for k in 0..60 {
        let model = [MotionModel::World, MotionModel::Body][k % 2];
        let mut x = normals::<13>(&mut rng);
        x.fixed_rows_mut::<4>(3).normalize_mut();
        let dt = rng.random_range(0.02..0.2);
        let mut moved = x;
        let f = predict::transition(moved.as_mut_slice(), dt, model);
        check("transition", &x, &f, |x| {
            let mut y = *x;
            predict::transition(y.as_mut_slice(), dt, model);
            y
        });
    }
}

#[test]
fn process_noise_does_not_depend_on_the_frame_rate() {
    // From rest the attitude part is linear, so ten steps of 0.01 s add up to one of 0.1 s.
    let settings = ProcessSettings::default();
    let q = quat::identity();
    let whole = predict::process_noise(&q, 0.1, &settings);
    let mut x = SMatrix::<f64, 13, 1>::zeros();
    x[3] = 1.0;
    let f = predict::transition(x.as_mut_slice(), 0.01, settings.velocity);
    let mut sum = predict::CameraMatrix::zeros();
    for _ in 0..10 {
        sum = f * sum * f.transpose() + predict::process_noise(&q, 0.01, &settings);
    }
    assert!((whole - sum).abs().max() < 1e-12 * whole.abs().max());
    let eigenvalues = DMatrix::from_column_slice(13, 13, whole.as_slice()).symmetric_eigenvalues();
    assert!(eigenvalues.min() > -1e-12);
    assert_eq!(DVector::from_column_slice(&[0.0; 1])[0], whole[(3, 3)]);
}

/// The camera whose calibration is off by those six numbers. Without distortion of its own: the warp's radial terms are in
/// the pixels, those of the model in the rays.
fn warped(by: &Vector6<f64>) -> Camera {
    let (fx, fy) = (600.0 * (1.0 + by[0]), 605.0 * (1.0 + by[0]) * (1.0 + by[1]));
    let intrinsics = [fx, fy, 362.0 + by[2], 238.0 + by[3]];
    let radial = [by[4], by[5], 0.0, 0.0];
    Camera::new("radtan", 720, 480, intrinsics, &radial).expect("valid calibration")
}

#[test]
fn pixels_and_births_by_the_calibration() {
    let mut rng = rng(14);
    let (zero, camera) = (Vector6::zeros(), warped(&Vector6::zeros()));
    for _ in 0..30 {
        let (pose, feature) = random_view(&mut rng);
        let offset = random_worn(&mut rng);
        let (uv, uv_first) = random_pair(&mut rng, &camera, &offset);
        let seen = PointInCamera::metric(&pose, &feature)
            .expect("in front")
            .value;
        let at = camera.project(&seen).expect("in front");
        let rows = Rows::bearing(&camera, &pose, &feature, &at, 1.0, None).expect("visible");
        let by = rows.by_shared.expect("depends on the calibration");
        check(
            "bearing by calibration",
            &zero,
            &by.fixed_rows::<2>(0).into_owned(),
            |by| warped(by).project(&seen).expect("in front"),
        );
        let vague = |by: &Vector6<f64>| {
            NewFeature::with_prior_depth(&warped(by), &pose, &uv, 1.0, 0.5, 0.1).expect("a ray")
        };
        check(
            "birth by calibration",
            &zero,
            &vague(&zero).by_calibration,
            |by| vague(by).mean,
        );
        let born = |by: &Vector6<f64>| {
            let camera = warped(by);
            let view = TwoView::new(&camera, &uv, &camera, &uv_first, &offset).expect("they meet");
            let [warp, first] = [&uv, &uv_first].map(|uv| camera.warp_jacobian(uv));
            let mut new = NewFeature::from_two_views(&pose, &view, &warp, (1.0, 1.0));
            new.share_calibration(&view, &first);
            new
        };
        check(
            "birth of two views",
            &zero,
            &born(&zero).by_calibration,
            |by| born(by).mean,
        );
    }
}
