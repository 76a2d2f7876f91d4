//! The view that starts a map (METHOD 6): births that follow its error of T_CF, which goes on in the views after it.

use crate::scene::{DT, camera, normals, rng, settings, worn_covariance};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::settings::Value;
use ekf_core::state::{BlockKind, ErrorOwner};
use ekf_core::{Bearing, Filter, MeasurementOutcome, Measurements, WornObservation, WornPair};
use nalgebra::{Vector2, Vector3};
use rand::Rng;
use rand_pcg::Pcg64;

/// Cf a third of a metre ahead, which all frames measure with one error: 3 cm and half a degree.
struct Ahead {
    points: Vec<Vector3<f64>>,
    error: Pose,
    filter: Filter,
    ids: Vec<Option<u64>>,
    frame: usize,
    rng: Pcg64,
}

impl Ahead {
    fn new(seed: u64) -> Self {
        let mut rng = rng(seed);
        let point = |rng: &mut Pcg64| {
            let depth = rng.random_range(1.5..5.0);
            let side = Vector2::new(rng.random_range(-0.5..0.5), rng.random_range(-0.33..0.33));
            Vector3::new(side.x * depth, side.y * depth, depth)
        };
        let points: Vec<_> = (0..60).map(|_| point(&mut rng)).collect();
        let root = worn_covariance().cholesky().expect("positive definite").l();
        let error = Pose::identity().retract(&-(root * normals::<6>(&mut rng)));
        let lasts = [("worn.bias_share", Value::Float(0.9))];
        Self {
            ids: vec![None; points.len()],
            points,
            error,
            filter: Filter::new(settings(&lasts), camera(), [camera()]),
            frame: 0,
            rng,
        }
    }

    fn pixel(&mut self, pose: &Pose, point: usize) -> Option<Vector2<f64>> {
        let uv = camera().project(&pose.inverse().apply(&self.points[point]))?;
        let noisy = uv + normals::<2>(&mut self.rng);
        camera().in_image(&uv, 5.0).then_some(noisy)
    }

    /// Cs goes ahead slowly, Cf somewhat faster; returns the id of the block of what lasts of the error.
    fn step(&mut self) -> u64 {
        let t = self.frame as f64 * DT;
        let ahead = |z: f64| Pose {
            rotation: quat::rotation(&quat::exp(&Vector3::new(0.01 * t, 0.0, 0.0))),
            translation: Vector3::new(0.0, 0.0, z),
        };
        let (cs, cf) = (ahead(0.03 * t), ahead(0.33 + 0.1 * t));
        self.filter.predict(t).expect("time goes on");
        let mut z = Measurements::default();
        let mut pairs = Vec::new();
        let mut of = Vec::new();
        for point in 0..self.points.len() {
            let (uv, uv_f) = (self.pixel(&cs, point), self.pixel(&cf, point));
            let id = self.ids[point];
            if let (Some(id), Some(uv)) = (id, uv) {
                z.searched.push(id);
                z.bearings.push(Bearing { id, uv });
            }
            let begins = id.is_none() && self.frame > 0;
            if let (Some(_), Some(uv_f), false) = (uv, uv_f, begins) {
                pairs.push(WornPair { id, uv, uv_f });
                of.push(point);
            }
        }
        let measured = cs.inverse().compose(&cf).compose(&self.error);
        z.views.push(WornObservation {
            who: 0,
            capture: None,
            rate: None,
            bias: None,
            t_cf: measured,
            covariance: worn_covariance(),
            pairs,
        });
        let report = self.filter.update(&z).expect("good measurements");
        for (point, outcome) in of.iter().zip(&report.views[0]) {
            if let MeasurementOutcome::Born(id) = outcome {
                self.ids[*point] = Some(*id);
            }
        }
        self.frame += 1;
        let state = self.filter.state();
        let kind = BlockKind::WornBias(ErrorOwner::Of(0));
        state.layout().of_kind(kind).next().expect("a bias").id
    }

    /// By how much the map is too large, logarithm, each landmark by how well its range is known.
    fn too_large(&self) -> f64 {
        let state = self.filter.state();
        let (mut sum, mut total) = (0.0, 0.0);
        for (point, id) in self.points.iter().zip(&self.ids) {
            let Some(block) = id.and_then(|id| state.layout().find(id)) else {
                continue;
            };
            let feature = state.feature(block);
            let at = block.offset + 5;
            let variance = state.covariance().get(at, at) / feature.scale().powi(2);
            if let Some(range) = feature.point().filter(|_| variance < 1.0) {
                sum += (range.norm() / point.norm()).ln() / variance;
                total += 1.0 / variance;
            }
        }
        sum / total
    }
}

/// Where both cameras look along the line through them, 3 cm beside it are 5 degrees of its direction, and a landmark 10 degrees from
/// it is half as far again. The scale of such a map is known to a tenth, and not better after five views of one error.
#[test]
fn a_baseline_straight_ahead_gives_the_scale_that_it_claims() {
    let (mut sum, runs) = (0.0, 60);
    for seed in 0..runs {
        let mut ahead = Ahead::new(seed);
        for _ in 0..6 {
            ahead.step();
        }
        let sd = ahead.filter.scale_sd().expect("a map");
        assert!((0.04..0.15).contains(&sd), "seed {seed}: {sd}");
        sum += (ahead.too_large() / sd).powi(2);
    }
    // chi2 with 60 degrees of freedom: 99.9 % lie below 99.6.
    assert!(sum < 99.6, "{}", sum / runs as f64);
}

#[test]
fn the_overlap_of_the_first_view_goes_on() {
    let mut ahead = Ahead::new(1);
    let first = ahead.step();
    let known = ahead.filter.scale_sd().expect("a map");
    for _ in 0..4 {
        assert_eq!(ahead.step(), first, "another error");
    }
    let later = ahead.filter.scale_sd().expect("a map");
    assert!(later > 0.75 * known, "{later} of {known}");
}
