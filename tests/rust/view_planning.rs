//! Where to look (METHOD 24): what is foretold of a view is what its update does.

use crate::scene::{camera, settings, worn_covariance};
use ekf_core::math::pose::Pose;
use ekf_core::settings::Value;
use ekf_core::view_planning::{CandidateView, ViewPlan};
use ekf_core::{Bearing, EkfError, Filter, Measurements, WornObservation, WornPair};
use nalgebra::{Matrix3, Matrix6, SMatrix, Vector3};

/// Points in the view of Cs, not all at one depth.
fn points() -> Vec<Vector3<f64>> {
    let grid = (0..30).map(|i| (i % 6, i / 6));
    grid.map(|(a, b)| {
        let z = 3.0 + f64::from((a * 5 + b * 3) % 7) * 0.4;
        Vector3::new(
            (f64::from(a) - 2.5) * 0.2 * z,
            (f64::from(b) - 2.0) * 0.15 * z,
            z,
        )
    })
    .collect()
}

/// A filter that knows these points but for a common scale of 5 % and 2 cm each, and has measured a frame.
fn filter() -> Filter {
    let rolls = settings(&[("worn.readout", Value::Float(0.02))]);
    let (points, camera) = (points(), camera());
    let mut filter = Filter::new(rolls, camera.clone(), Some(camera.clone()));
    filter.predict(0.0).expect("first frame");
    let noise = vec![Matrix3::identity() * 4e-4; points.len()];
    let shared: Vec<_> = points.iter().map(by_scale).collect();
    let covariance = Matrix6::identity() * 0.05_f64.powi(2);
    let ids = filter
        .add_points(&points, &noise, &shared, &covariance)
        .expect("good points");
    filter.predict(0.1).expect("time goes on");
    let pixels = filter.predict_pixels();
    assert!(pixels.len() == ids.len(), "all are in view");
    let bearings = pixels.iter().map(|p| Bearing { id: p.id, uv: p.uv });
    let z = Measurements {
        bearings: bearings.collect(),
        ..Measurements::default()
    };
    filter.update(&z).expect("good measurements");
    filter
}

fn by_scale(point: &Vector3<f64>) -> SMatrix<f64, 3, 6> {
    let mut by = SMatrix::<f64, 3, 6>::zeros();
    by.set_column(0, point);
    by
}

/// 3 mm and a twentieth of a degree.
fn precise() -> Matrix6<f64> {
    worn_covariance() * 0.01
}

/// A hand's breadth beside Cs, so that all points are seen at less than 2.5 degrees.
fn beside() -> Pose {
    Pose {
        rotation: Matrix3::identity(),
        translation: Vector3::new(0.1, 0.0, 0.0),
    }
}

/// The view among those of a place that looks as Cs does.
fn ahead(plan: &ViewPlan) -> &CandidateView {
    let same = |view: &&CandidateView| (view.t_cf.rotation - Matrix3::identity()).norm() < 1e-9;
    plan.here.iter().find(same).expect("it is on the grid")
}

/// By how much an update with all landmarks that Cf sees lowers `ln det / 2`.
fn realised(filter: &mut Filter, view: &CandidateView, bias: Option<Matrix6<f64>>) -> f64 {
    let before = log_det(filter);
    let camera = camera();
    let (r_wc, r) = filter.pose();
    let pairs = filter.landmarks().into_iter().filter_map(|landmark| {
        let in_c = r_wc.transpose() * (landmark.point - r);
        let uv = camera.project(&in_c)?;
        let uv_f = camera.project(&view.t_cf.inverse().apply(&in_c))?;
        camera.in_image(&uv_f, 0.0).then_some(WornPair {
            id: Some(landmark.id),
            uv: Some(uv),
            uv_f,
        })
    });
    let worn = WornObservation {
        who: 0,
        t_cf: view.t_cf.clone(),
        covariance: precise(),
        bias,
        capture: None,
        rate: None,
        pairs: pairs.collect(),
    };
    let z = Measurements {
        views: vec![worn],
        ..Measurements::default()
    };
    let report = filter.update(&z).expect("good measurements");
    assert!(report.dof >= 2 * 20, "{} rows", report.dof);
    0.5 * (before - log_det(filter))
}

fn log_det(filter: &Filter) -> f64 {
    let covariance = filter.pose_and_scale_covariance().expect("a map");
    let scaled = covariance.cholesky().expect("positive definite").l();
    2.0 * scaled.diagonal().map(f64::ln).sum()
}

#[test]
fn what_is_foretold_is_what_the_update_does() {
    for bias in [None, Some(precise() * 0.7)] {
        let mut filter = filter();
        // The second view meets the bias that the first has left in the state.
        for view in 0..2 {
            let plan = filter
                .next_best_view(&beside(), &precise(), bias.as_ref(), 0, 0)
                .expect("a good pose");
            let best = ViewPlan::best(&plan.here).expect("something is gained");
            let (foretold, best) = (ahead(&plan).gain, plan.here[best].gain);
            let real = realised(&mut filter, ahead(&plan), bias);
            assert!(real > 0.02, "view {view} gains {real}");
            // Nine matches of ten are foretold, all of them came.
            let share = foretold / real;
            assert!(
                (0.9..1.01).contains(&share),
                "view {view}: {foretold} of {real}"
            );
            assert!(best >= foretold);
        }
    }
}

#[test]
fn a_view_of_unknown_place_tells_little_of_the_scale() {
    let filter = filter();
    let gain = |factor: f64| {
        let covariance = worn_covariance() * factor;
        let plan = filter.next_best_view(&beside(), &covariance, None, 0, 0);
        ahead(&plan.expect("a good pose")).gain
    };
    assert!(gain(1e-4) > gain(1.0) && gain(1.0) > gain(1e4));
    assert!(gain(1e4) < 0.05 * gain(1e-4));
}

#[test]
fn too_few_matches_and_no_start_gain_nothing() {
    let filter = filter();
    let plan = filter.next_best_view(&beside(), &worn_covariance(), None, 1000, 0);
    let plan = plan.expect("a good pose");
    assert!(plan.here.iter().all(|view| view.gain < 1e-9));
    let fresh = Filter::new(settings(&[]), camera(), Some(camera()));
    let plan = fresh.next_best_view(&beside(), &worn_covariance(), None, 0, 0);
    assert_eq!(plan.expect("a good pose"), ViewPlan::default());
    assert_eq!(fresh.pose_and_scale_covariance(), None);
    let without = Filter::new(settings(&[]), camera(), None);
    let refused = without.next_best_view(&beside(), &worn_covariance(), None, 0, 0);
    assert!(matches!(refused, Err(EkfError::InvalidInput { .. })));
}

#[test]
fn asking_changes_nothing() {
    let filter = filter();
    let before = filter.snapshot();
    filter
        .next_best_view(&beside(), &worn_covariance(), None, 8, 0)
        .expect("a good pose");
    assert!(filter.snapshot() == before);
}
