//! A camera that walks round a ring corridor, its eyes on the outer wall, and sees a tenth of the map.

use crate::{camera, normal, settings};
use ekf_core::math::{pose::Pose, quat};
use ekf_core::settings::Value;
use ekf_core::{
    Bearing, Camera, DepthObservation, Filter, MeasurementOutcome, Measurements, UpdateReport,
};
use nalgebra::{Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;
use std::f64::consts::TAU;

/// Radius of the walk, metres.
const RADIUS: f64 = 9.5;
/// Metres per second.
const SPEED: f64 = 1.2;
/// Frames between those in which features are born: some four at once, as in the demo.
const BIRTHS: usize = 5;
/// How far the camera looks outwards from where it goes, radians.
const OUTWARDS: f64 = 0.38;

/// The walk, and the point of each feature of a filter that follows it.
#[derive(Clone, Debug)]
pub struct Loop {
    camera: Camera,
    points: Vec<Vector3<f64>>,
    known: BTreeMap<u64, usize>,
    /// Time now, seconds.
    pub time: f64,
    frame: usize,
    rng: Pcg64,
}

impl Loop {
    /// A corridor with `points` points; the walk has not begun.
    pub fn new(points: usize) -> Self {
        let mut rng = Pcg64::seed_from_u64(2);
        let points = (0..points)
            .map(|i| {
                let angle = TAU * (i as f64 + rng.random_range(0.0..1.0)) / points as f64;
                let radius = RADIUS + rng.random_range(1.5..3.5);
                Vector3::new(
                    RADIUS - radius * angle.cos(),
                    rng.random_range(-1.2..1.2),
                    radius * angle.sin(),
                )
            })
            .collect();
        Self {
            camera: camera(),
            points,
            known: BTreeMap::new(),
            time: 0.0,
            frame: 0,
            rng,
        }
    }

    /// A filter that has its first frame behind it.
    pub fn start(&mut self, changes: &[(&str, Value)]) -> Filter {
        let mut all = vec![("map.max_features", Value::Int(self.points.len() as i64))];
        all.extend_from_slice(changes);
        let mut filter = Filter::new(settings(&all), self.camera.clone(), None);
        filter.predict(self.time).expect("first stamp");
        let z = self.measure();
        let report = filter.update(&z).expect("valid depths");
        self.learn(&report, &z);
        filter
    }

    /// Walks on for `dt` seconds; returns the time.
    pub fn walk(&mut self, dt: f64) -> f64 {
        self.time += dt;
        self.frame += 1;
        self.time
    }

    /// Whether the whole map has been seen, and the camera is back where it began.
    pub fn closed(&self) -> bool {
        self.time * SPEED > 1.05 * TAU * RADIUS
    }

    fn pose(&self) -> Pose {
        let (t, angle) = (self.time, self.time * SPEED / RADIUS);
        let sway = 0.03 * (TAU * 0.9 * t).sin();
        let bob = 0.02 * (TAU * 1.8 * t).sin();
        Pose {
            rotation: quat::rotation(&quat::exp(&Vector3::new(
                0.0,
                angle - OUTWARDS + 0.3 * sway,
                0.0,
            ))),
            translation: Vector3::new(
                RADIUS - (RADIUS + sway) * angle.cos(),
                bob,
                (RADIUS + sway) * angle.sin(),
            ),
        }
    }

    /// What is in view now: known features as bearings, others as depths of new points.
    pub fn measure(&mut self) -> Measurements {
        let from_world = self.pose().inverse();
        let ids: BTreeMap<usize, u64> = self.known.iter().map(|(id, p)| (*p, *id)).collect();
        let mut z = Measurements::default();
        for point in 0..self.points.len() {
            let seen = from_world.apply(&self.points[point]);
            let Some(uv) = self.camera.project(&seen) else {
                continue;
            };
            if seen.z < 0.8 || !self.camera.in_image(&uv, 8.0) {
                continue;
            }
            let uv = uv + Vector2::from_fn(|_, _| normal(&mut self.rng));
            if let Some(&id) = ids.get(&point) {
                z.searched.push(id);
                z.bearings.push(Bearing { id, uv });
            } else if self.frame.is_multiple_of(BIRTHS) {
                let sigma = 0.02 * seen.z;
                z.depths.push(DepthObservation {
                    id: None,
                    uv,
                    depth: seen.z + sigma * normal(&mut self.rng),
                    sigma,
                });
            }
        }
        z.bearings.sort_by_key(|b| b.id);
        z
    }

    /// Notes which features were born of the present frame's measurements.
    pub fn learn(&mut self, report: &UpdateReport, z: &Measurements) {
        let from_world = self.pose().inverse();
        for (outcome, depth) in report.depths.iter().zip(&z.depths) {
            let MeasurementOutcome::Born(id) = outcome else {
                continue;
            };
            if self.known.contains_key(id) {
                continue;
            }
            // The point is the one whose pixel is nearest to that of the depth.
            let off = |point: &Vector3<f64>| {
                let seen = from_world.apply(point);
                let uv = self.camera.project(&seen);
                uv.map_or(f64::INFINITY, |uv| {
                    (uv - depth.uv).norm() + 1e3 * (seen.z / depth.depth - 1.0).abs()
                })
            };
            let free = (0..self.points.len()).filter(|p| !self.known.values().any(|q| q == p));
            let nearest =
                free.min_by(|a, b| off(&self.points[*a]).total_cmp(&off(&self.points[*b])));
            self.known.insert(*id, nearest.expect("a point was seen"));
        }
    }

    /// Notes that these features are gone from the map.
    pub fn forget(&mut self, gone: &[u64]) {
        self.known.retain(|id, _| !gone.contains(id));
    }

    /// Number of features in the map.
    pub fn known(&self) -> usize {
        self.known.len()
    }
}
