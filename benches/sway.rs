//! A camera that sways before a cloud of points.

use crate::{camera, normal, settings};
use ekf_core::math::{pose::Pose, quat};
use ekf_core::settings::Value;
use ekf_core::{
    Bearing, Camera, DepthObservation, Filter, MeasurementOutcome, Measurements, WornObservation,
    WornPair,
};
use nalgebra::{Matrix3, Matrix6, Vector2, Vector3};
use rand::{Rng, SeedableRng, seq::index};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;

/// Seconds between frames.
const DT: f64 = 1.0 / 30.0;

/// What the frames are made of.
#[derive(Clone, Copy, Debug)]
pub struct Mix {
    /// Features in the map, all of them in view.
    pub features: usize,
    /// Features measured in each frame.
    pub seen: usize,
    /// Matches of them that are wrong, uniform in the 3-sigma ellipse of their prediction.
    pub wrong: usize,
    /// Whether every third one is measured with its depth (3 rows).
    pub depth: bool,
    /// Features born in a frame, and so from one position. (The demo's map holds 120 features with 28 to 33 anchors.)
    pub at_once: usize,
}

/// A warm filter and its world.
#[derive(Clone, Debug)]
pub struct Sway {
    /// The filter.
    pub filter: Filter,
    mix: Mix,
    camera: Camera,
    points: Vec<Vector3<f64>>,
    ids: Vec<u64>,
    frame: usize,
    rng: Pcg64,
}

impl Sway {
    /// A filter after its start and ten good frames.
    pub fn new(mix: Mix, changes: &[(&str, Value)]) -> Self {
        let (mut sway, _) = Self::begin(mix, changes);
        for _ in 0..10 {
            sway.predict();
            let z = sway.measure_all();
            sway.filter.update(&z).expect("valid measurements");
        }
        sway
    }

    /// A filter that has its map, and the frames it was born in.
    pub fn begin(mix: Mix, changes: &[(&str, Value)]) -> (Self, Vec<(f64, Measurements)>) {
        let mut all = vec![("map.max_features", Value::Int(mix.features.max(4) as i64))];
        all.extend_from_slice(changes);
        let camera = camera();
        let mut rng = Pcg64::seed_from_u64(1);
        let points: Vec<Vector3<f64>> = (0..mix.features)
            .map(|_| {
                let z = rng.random_range(2.0..8.0);
                let (x, y) = (rng.random_range(-0.5..0.5), rng.random_range(-0.3..0.3));
                Vector3::new(x * z, y * z, z)
            })
            .collect();
        let worn = Some(camera.clone());
        let filter = Filter::new(settings(&all), camera.clone(), worn);
        let mut sway = Self {
            filter,
            mix,
            camera,
            points,
            ids: Vec::new(),
            frame: 0,
            rng,
        };
        let mut births = Vec::new();
        while sway.ids.len() < mix.features {
            let known = sway.ids.len();
            let number = mix.at_once.max(if known == 0 { 8 } else { 1 });
            let t = if known == 0 { 0.0 } else { sway.next_frame() };
            sway.filter.predict(t).expect("later stamp");
            let mut z = sway.measure_some(known.min(40), 0);
            let new = known..mix.features.min(known + number);
            z.depths.extend(new.map(|i| sway.depth(i, None)));
            let report = sway.filter.update(&z).expect("valid measurements");
            sway.ids.extend(report.depths.iter().filter_map(born));
            births.push((t, z));
        }
        (sway, births)
    }

    fn pose(&self) -> Pose {
        let t = self.frame as f64 * DT;
        let turn = Vector3::new(0.02 * (1.3 * t).sin(), 0.03 * (0.9 * t).sin(), 0.0);
        let (a, b, c) = ((0.8 * t).sin(), (1.1 * t).sin(), (0.5 * t).sin());
        Pose {
            rotation: quat::rotation(&quat::exp(&turn)),
            translation: Vector3::new(0.15 * a, 0.06 * b, 0.08 * c),
        }
    }

    /// Time of the present frame, seconds.
    pub fn time(&self) -> f64 {
        self.frame as f64 * DT
    }

    /// Goes to the next frame, whose time is returned; the filter is not told.
    pub fn next_frame(&mut self) -> f64 {
        self.frame += 1;
        self.time()
    }

    /// Predicts to the next frame.
    pub fn predict(&mut self) {
        let t = self.next_frame();
        self.filter.predict(t).expect("later stamp");
    }

    /// Measurements of the present frame, to which the filter has been predicted.
    pub fn measure(&mut self) -> Measurements {
        self.measure_some(self.mix.seen, self.mix.wrong)
    }

    /// The same of all features.
    pub fn measure_all(&mut self) -> Measurements {
        self.measure_some(self.mix.features, 0)
    }

    /// Pixels in Cs of the first `number` points, as of new ones.
    pub fn pixels(&mut self, number: usize) -> Vec<Vector2<f64>> {
        (0..number).map(|i| self.depth(i, None).uv).collect()
    }

    /// What a worn camera half a metre to the right sees of the first `number` points, as of new ones.
    pub fn worn(&mut self, number: usize) -> WornObservation {
        let t_cf = Pose {
            rotation: Matrix3::identity(),
            translation: Vector3::new(0.5, 0.0, 0.0),
        };
        let pairs = self.pixels(number).into_iter().enumerate().map(|(i, uv)| {
            let seen = self.pose().inverse().apply(&self.points[i]) - t_cf.translation;
            let uv_f = self.camera.project(&seen).expect("in front");
            WornPair {
                id: None,
                uv: Some(uv),
                uv_f,
            }
        });
        WornObservation {
            who: 0,
            capture: None,
            rate: None,
            bias: None,
            pairs: pairs.collect(),
            covariance: Matrix6::identity() * 1e-4,
            t_cf,
        }
    }

    fn measure_some(&mut self, seen: usize, wrong: usize) -> Measurements {
        let mut chosen = index::sample(&mut self.rng, self.ids.len(), seen).into_vec();
        chosen.sort_unstable();
        let mut z = Measurements::default();
        for (k, &point) in chosen.iter().enumerate() {
            let depth = self.depth(point, Some(self.ids[point]));
            let (id, uv) = (self.ids[point], depth.uv);
            z.searched.push(id);
            z.bearings.push(Bearing { id, uv });
            if self.mix.depth && self.ids.len() == self.points.len() && k % 3 == 0 {
                z.depths.push(depth);
            }
        }
        if wrong == 0 {
            return z;
        }
        let expected = self.filter.predict_pixels();
        let expected: BTreeMap<u64, _> = expected.iter().map(|f| (f.id, (f.uv, f.s))).collect();
        for k in index::sample(&mut self.rng, seen, wrong) {
            let Some((uv, s)) = expected.get(&z.bearings[k].id) else {
                continue;
            };
            let l = s.cholesky().expect("S_i is positive definite").l();
            let inside = loop {
                let v = Vector2::from_fn(|_, _| self.rng.random_range(-1.0..1.0));
                if v.norm() <= 1.0 {
                    break v;
                }
            };
            z.bearings[k].uv = uv + l * inside * 3.0;
            for depth in z
                .depths
                .iter_mut()
                .filter(|d| d.id == Some(z.bearings[k].id))
            {
                depth.uv = z.bearings[k].uv;
            }
        }
        z
    }

    fn depth(&mut self, point: usize, id: Option<u64>) -> DepthObservation {
        let seen = self.pose().inverse().apply(&self.points[point]);
        let uv = self.camera.project(&seen).expect("in front");
        let noise = Vector2::from_fn(|_, _| normal(&mut self.rng));
        // Births far from the truth would make the first frames nonlinear.
        let sigma = 0.02 * seen.z;
        DepthObservation {
            id,
            uv: uv + noise,
            depth: seen.z + sigma * normal(&mut self.rng),
            sigma,
        }
    }
}

fn born(outcome: &MeasurementOutcome) -> Option<u64> {
    match outcome {
        MeasurementOutcome::Born(id) => Some(*id),
        _ => None,
    }
}
