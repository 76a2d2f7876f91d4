//! A filter in use for a very long time: features come and go, the camera sways, and some landmarks stay.

use crate::check_filter;
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::settings::Value;
use ekf_core::{
    Bearing, Camera, DepthObservation, Filter, MeasurementOutcome, Measurements, Settings,
};
use nalgebra::{Vector2, Vector3};
use rand::{Rng, SeedableRng};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;
use std::time::Instant;

/// Seconds between frames.
const DT: f64 = 0.05;
/// Landmarks that stay for ever, so that the frame W does; METHOD 13: nothing else ties the camera to it.
const LASTING: usize = 4;
/// Features in the map.
const FEATURES: usize = 10;
/// Steps between two checks of the whole filter.
const CHECK_EVERY: usize = 1000;

/// What a run has shown.
#[derive(Clone, Debug)]
pub struct Endured {
    /// Steps taken.
    pub steps: usize,
    /// Features born and removed.
    pub born: usize,
    /// Resident memory after a tenth of the steps, and at the end, megabytes; NaN where the system does not tell.
    pub memory_mb: [f64; 2],
    /// Median time of a step in the second and the last tenth, microseconds.
    pub step_us: [f64; 2],
    /// Largest distance between estimated and true position, metres.
    pub largest_error_m: f64,
    /// Bits of the mean at the end, folded.
    pub fingerprint: u64,
}

/// `steps` frames of a camera that sways before points which come and go.
///
/// # Errors
/// The first promise that was broken.
pub fn endure(steps: usize, seed: u64) -> Result<Endured, String> {
    let mut scene = Scene::new(seed);
    let mut endured = Endured {
        steps,
        born: 0,
        memory_mb: [f64::NAN; 2],
        step_us: [f64::NAN; 2],
        largest_error_m: 0.0,
        fingerprint: 0,
    };
    let tenth = (steps / 10).max(1);
    let mut times = Vec::with_capacity(tenth);
    for step in 0..steps {
        let began = Instant::now();
        endured.born += scene.step(step)?;
        times.push(began.elapsed().as_secs_f64() * 1e6);
        let (_, r) = scene.filter.pose();
        let error = (r - Scene::pose(step).translation).norm();
        endured.largest_error_m = endured.largest_error_m.max(error);
        if step.is_multiple_of(CHECK_EVERY) || step + 1 == steps {
            check_filter(&scene.filter).map_err(|broken| format!("step {step}: {broken}"))?;
        }
        if (step + 1).is_multiple_of(tenth) {
            match (step + 1) / tenth {
                1 => endured.memory_mb[0] = resident_mb(),
                2 => endured.step_us[0] = median(&mut times),
                _ => {}
            }
            if step + tenth >= steps {
                endured.step_us[1] = median(&mut times);
                endured.memory_mb[1] = resident_mb();
            }
            times.clear();
        }
    }
    let mean = scene.filter.state().mean().iter();
    endured.fingerprint = mean.fold(0, |h: u64, x| h.rotate_left(7) ^ x.to_bits());
    Ok(endured)
}

struct Scene {
    camera: Camera,
    filter: Filter,
    rng: Pcg64,
    points: BTreeMap<u64, Vector3<f64>>,
    waiting: BTreeMap<u64, Vector3<f64>>,
}

impl Scene {
    fn new(seed: u64) -> Self {
        let camera = Camera::new("pinhole", 640, 480, [400.0, 400.0, 320.0, 240.0], &[]);
        let camera = camera.expect("valid calibration");
        let mut settings = Settings::default();
        for (key, value) in [
            ("map.in_view", Value::Int(8)),
            ("map.max_features", Value::Int(FEATURES as i64)),
            ("process.start_velocity_sd", Value::Float(1.0)),
        ] {
            settings.set(key, &value).expect("within the range");
        }
        Self {
            filter: Filter::new(settings, camera.clone(), None),
            camera,
            rng: Pcg64::seed_from_u64(seed),
            points: BTreeMap::new(),
            waiting: BTreeMap::new(),
        }
    }

    fn pose(step: usize) -> Pose {
        let t = DT * step as f64;
        let turn = Vector3::new(0.05 * (0.7 * t).sin(), 0.1 * (0.3 * t).sin(), 0.0);
        Pose {
            rotation: quat::rotation(&quat::exp(&turn)),
            translation: Vector3::new(
                0.6 * (0.4 * t).sin(),
                0.1 * (0.9 * t).sin(),
                0.5 * (1.0 - (0.25 * t).cos()),
            ),
        }
    }

    fn noise(&mut self) -> f64 {
        let (u, v): (f64, f64) = (self.rng.random_range(1e-300..1.0), self.rng.random());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    fn pixel(&mut self, pose: &Pose, point: &Vector3<f64>) -> Option<Vector2<f64>> {
        let uv = self.camera.project(&pose.inverse().apply(point))?;
        let noise = Vector2::new(self.noise(), self.noise());
        self.camera.in_image(&uv, 1.0).then(|| uv + noise)
    }

    fn new_point(&mut self) -> Vector3<f64> {
        let (x, y) = (
            self.rng.random_range(-1.5..1.5),
            self.rng.random_range(-1.0..1.0),
        );
        Vector3::new(x, y, self.rng.random_range(3.0..6.0))
    }

    /// One frame; returns the number of births.
    fn step(&mut self, step: usize) -> Result<usize, String> {
        let text = |e: ekf_core::EkfError| e.to_string();
        let pose = Self::pose(step);
        self.filter.predict(DT * step as f64).map_err(text)?;
        let mut z = Measurements::default();
        for (id, point) in self.points.clone() {
            z.searched.push(id);
            if let Some(uv) = self.pixel(&pose, &point) {
                z.bearings.push(Bearing { id, uv });
            }
        }
        // Some are born from a depth, the others from parallax.
        let mut born = 0;
        let mut fresh = Vec::new();
        let depths = if step == 0 {
            LASTING + 2
        } else {
            usize::from(step % 50 == 25)
        };
        for _ in 0..depths {
            let point = self.new_point();
            if let Some(uv) = self.pixel(&pose, &point) {
                let depth = pose.inverse().apply(&point).z + 0.02 * self.noise();
                z.depths.push(DepthObservation {
                    id: None,
                    uv,
                    depth,
                    sigma: 0.02,
                });
                fresh.push(point);
            }
        }
        let report = self.filter.update(&z).map_err(text)?;
        for (outcome, point) in report.depths.iter().zip(fresh) {
            if let MeasurementOutcome::Born(id) = outcome {
                self.points.insert(*id, point);
                born += 1;
            }
        }
        if step == 0 {
            // Depths alone start no filter.
            let points: Vec<_> = (0..LASTING + 2).map(|_| self.new_point()).collect();
            let noise = vec![nalgebra::Matrix3::identity() * 1e-4; points.len()];
            let shared = vec![nalgebra::SMatrix::<f64, 3, 6>::zeros(); points.len()];
            let covariance = nalgebra::Matrix6::identity() * 1e-6;
            let ids = self
                .filter
                .add_points(&points, &noise, &shared, &covariance);
            self.points = ids.map_err(text)?.into_iter().zip(points).collect();
            return Ok(self.points.len());
        }
        let mut seen = Vec::new();
        for (id, point) in self.waiting.clone() {
            if let Some(uv) = self.pixel(&pose, &point) {
                seen.push((id, uv));
            }
        }
        let outcomes = self.filter.observe_candidates(&seen).map_err(text)?;
        for ((id, _), outcome) in seen.iter().zip(outcomes) {
            if let ekf_core::CandidateOutcome::Born(feature) = outcome {
                self.points.insert(feature, self.waiting[id]);
                born += 1;
            }
        }
        if step % 20 == 19 && self.points.len() > LASTING + 2 {
            let k = self.rng.random_range(LASTING..self.points.len());
            let id = *self.points.keys().nth(k).expect("within the map");
            self.filter.remove_features(&[id]).map_err(text)?;
            self.points.remove(&id);
        }
        for id in self.filter.manage_map(&[]) {
            self.points.remove(&id);
        }
        if step.is_multiple_of(10) && self.points.len() + self.waiting.len() < FEATURES {
            let point = self.new_point();
            if let Some(uv) = self.pixel(&pose, &point) {
                let ids = self.filter.add_candidates(&[uv]).map_err(text)?;
                self.waiting.insert(ids[0], point);
            }
        }
        let alive: Vec<u64> = self.filter.candidate_ids().collect();
        self.waiting.retain(|id, _| alive.contains(id));
        Ok(born)
    }
}

/// Memory of the process, megabytes; NaN where the system does not tell.
pub fn resident_mb() -> f64 {
    let text = std::fs::read_to_string("/proc/self/statm").unwrap_or_default();
    let pages = text.split(' ').nth(1).and_then(|n| n.parse::<f64>().ok());
    pages.map_or(f64::NAN, |pages| pages * 4096.0 / 1e6)
}

fn median(values: &mut [f64]) -> f64 {
    values.sort_unstable_by(f64::total_cmp);
    values.get(values.len() / 2).copied().unwrap_or(f64::NAN)
}
