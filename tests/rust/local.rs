//! The local update against the plain one, over a walk in which the working set changes all the time.

use crate::scene::{camera, name, normals, rng, settings};
use ekf_core::math::{pose::Pose, quat};
use ekf_core::settings::Value;
use ekf_core::{Bearing, DepthObservation, Filter, MeasurementOutcome, Measurements};
use nalgebra::Vector3;
use rand::Rng;
use std::collections::BTreeMap;

/// Both filters on the same measurements: a camera turns round and round on a small circle, among points on all sides.
pub(crate) struct Pair {
    pub(crate) plain: Filter,
    pub(crate) local: Filter,
    points: Vec<Vector3<f64>>,
    pub(crate) known: BTreeMap<u64, usize>,
    pub(crate) rng: rand_pcg::Pcg64,
    pub(crate) t: f64,
}

impl Pair {
    pub(crate) fn new(seed: u64, points: usize, consistency: &str, map_drift: f64) -> Self {
        let mut rng = rng(seed);
        let points = (0..points).map(|_| {
            let (angle, distance) = (
                rng.random_range(0.0..std::f64::consts::TAU),
                rng.random_range(2.5..6.0_f64),
            );
            let height = rng.random_range(-1.0..1.0);
            Vector3::new(
                distance * f64::sin(angle),
                height,
                distance * f64::cos(angle),
            )
        });
        let points = points.collect();
        let many = ("map.max_features", Value::Int(150));
        let filter = |local: bool| {
            let changes = [
                many.clone(),
                (
                    "map.local_from",
                    Value::Int(if local { 0 } else { 1_000_000 }),
                ),
                ("estimator.consistency", name(consistency)),
                ("process.map_drift", Value::Float(map_drift)),
            ];
            Filter::new(settings(&changes), camera(), None)
        };
        Self {
            plain: filter(false),
            local: filter(true),
            points,
            known: BTreeMap::new(),
            rng,
            t: 0.0,
        }
    }

    fn pose(&self) -> Pose {
        let angle = 0.5 * self.t;
        Pose {
            rotation: quat::rotation(&quat::exp(&Vector3::new(0.0, angle, 0.0))),
            translation: Vector3::new(0.5 * angle.sin(), 0.0, 0.5 * (1.0 - angle.cos())),
        }
    }

    /// One frame; every seventh match is far off.
    pub(crate) fn step(&mut self, frame: usize) {
        self.t = frame as f64 * 0.1;
        let from_world = self.pose().inverse();
        let mut z = Measurements::default();
        let of_point: BTreeMap<usize, u64> = self.known.iter().map(|(id, p)| (*p, *id)).collect();
        let mut new = Vec::new();
        for (i, point) in self.points.iter().enumerate() {
            let seen = from_world.apply(point);
            let Some(uv) = camera()
                .project(&seen)
                .filter(|uv| camera().in_image(uv, 5.0))
            else {
                continue;
            };
            let uv = uv + normals::<2>(&mut self.rng);
            match of_point.get(&i) {
                Some(&id) => {
                    z.searched.push(id);
                    if !(frame + i).is_multiple_of(7) {
                        z.bearings.push(Bearing { id, uv });
                    } else if frame.is_multiple_of(2) {
                        let uv = uv.map(|x| x + 12.0);
                        z.bearings.push(Bearing { id, uv });
                    }
                }
                None if frame == 0 || (frame + i).is_multiple_of(5) => {
                    new.push(i);
                    let (depth, sigma) = (seen.z, 0.03 * seen.z);
                    z.depths.push(DepthObservation {
                        id: None,
                        uv,
                        depth,
                        sigma,
                    });
                }
                None => {}
            }
        }
        let pixels: Vec<_> = z.bearings.iter().take(2).map(|b| b.uv).collect();
        let mut born = Vec::new();
        for filter in [&mut self.plain, &mut self.local] {
            filter.predict(self.t).unwrap();
            let report = filter.update(&z).unwrap();
            born.push(report.depths.clone());
            if frame % 12 == 11 {
                filter.add_candidates(&pixels).unwrap();
            }
            if frame % 12 == 3 {
                let waiting: Vec<u64> = filter.candidate_ids().take(1).collect();
                assert!(frame < 12 || !waiting.is_empty());
                filter.promote_candidates(&waiting, false).unwrap();
            }
            if frame % 20 == 19 {
                let ids: Vec<(u64, _)> = filter.candidate_ids().zip(pixels.clone()).collect();
                filter.observe_candidates(&ids).unwrap();
            }
            if frame % 9 == 8 {
                filter.manage_map(&[]);
            }
            if frame % 31 == 30 {
                // One in view, one that is not.
                let ids: Vec<u64> = self
                    .known
                    .keys()
                    .copied()
                    .filter(|id| id % 13 == 5)
                    .collect();
                let _ = filter.remove_features(&ids[..ids.len().min(2)]);
            }
        }
        assert_eq!(born[0], born[1], "frame {frame}");
        for (outcome, &point) in born[0].iter().zip(&new) {
            if let MeasurementOutcome::Born(id) = outcome {
                self.known.insert(*id, point);
            }
        }
        let layout = self.plain.state().layout();
        self.known.retain(|id, _| layout.find(*id).is_some());
    }

    /// Largest difference, in standard deviations.
    pub(crate) fn difference(&self) -> f64 {
        let (a, b) = (self.plain.state(), self.local.state());
        assert_eq!(a.layout().blocks(), b.layout().blocks());
        let (p, q) = (a.covariance().to_dense(), b.covariance().to_dense());
        let sd = |i: usize| p[(i, i)].sqrt().max(1e-12);
        let mut worst: f64 = 0.0;
        assert!(p.iter().chain(q.iter()).all(|v| v.is_finite()));
        for i in 0..p.nrows() {
            worst = worst.max((a.mean()[i] - b.mean()[i]).abs() / sd(i));
            for j in 0..p.nrows() {
                worst = worst.max((p[(i, j)] - q[(i, j)]).abs() / (sd(i) * sd(j)));
            }
        }
        worst
    }

    /// What is expected to be in view, with S_i.
    fn views_agree(&self) {
        let (a, b) = (self.plain.predict_pixels(), self.local.predict_pixels());
        let ids =
            |seen: &[ekf_core::PredictedFeature]| seen.iter().map(|f| f.id).collect::<Vec<_>>();
        assert_eq!(ids(&a), ids(&b));
        for (a, b) in a.iter().zip(&b) {
            assert!((a.uv - b.uv).norm() < 1e-8 * a.s.trace().sqrt());
            assert!((a.s - b.s).norm() < 1e-8 * a.s.norm());
            assert!((a.rho_sd - b.rho_sd).abs() < 1e-8 * a.rho_sd);
        }
    }
}

#[test]
fn the_local_update_is_the_plain_one() {
    walk("none");
}

#[test]
fn the_local_update_is_the_plain_one_with_the_gauge_transport() {
    walk("gauge");
}

fn walk(consistency: &str) {
    // White errors: which error modes are put together hangs on what is inside.
    let mut pair = Pair::new(31, 120, consistency, 0.0);
    let (mut worst, mut apart): (f64, usize) = (0.0, 0);
    for frame in 0..400 {
        pair.step(frame);
        pair.views_agree();
        assert_eq!(pair.plain.map_size(), pair.local.map_size());
        if frame % 10 == 9 || frame > 390 {
            worst = worst.max(pair.difference());
            apart += 1;
        }
    }
    println!(
        "{} features, {apart} comparisons, {worst:.1e} sd apart",
        pair.plain.map_size()
    );
    assert!(pair.plain.map_size() > 80);
    assert!(worst > 0.0, "the local update was at work");
    assert!(worst < 1e-8, "{worst:e}");
}

#[test]
fn a_restored_working_set_goes_on_bit_for_bit() {
    for consistency in ["none", "gauge"] {
        let (mut straight, mut restored) = (
            Pair::new(5, 160, consistency, 10.0),
            Pair::new(5, 160, consistency, 10.0),
        );
        let mut worked = 0;
        for frame in 0..90 {
            straight.step(frame);
            restored.step(frame);
            if frame % 4 == 3 {
                restored.local = Filter::restore(&restored.local.snapshot()).unwrap();
            }
            // Another length: rows that only a working set has.
            let local = straight.local.snapshot();
            worked += usize::from(local.len() != straight.plain.snapshot().len());
            assert!(local == restored.local.snapshot(), "{consistency} {frame}");
        }
        assert!(
            worked > 20,
            "the local update hardly came to work: {worked} frames"
        );
    }
}
