//! A filter saved and restored goes on bit for bit; bytes that were spoilt are refused, whatever was done to them.

use crate::scene::{Scene, adopt, name, rng, settings};
use ekf_core::filter::snapshot::{VERSION, open, seal};
use ekf_core::settings::Value;
use ekf_core::{EkfError, Filter, Measurements};
use nalgebra::Vector2;
use rand::Rng;
use std::collections::BTreeMap;

/// A walk through a scene: births from Cf, candidates, deletions.
struct Walk {
    scene: Scene,
    filter: Filter,
    known: BTreeMap<u64, usize>,
    pixels: BTreeMap<u64, usize>,
}

const STEP: f64 = 0.05;

impl Walk {
    fn new(changes: &[(&str, Value)]) -> Self {
        let scene = Scene::new(11, 90);
        let camera = scene.camera.clone();
        let filter = Filter::new(settings(changes), camera.clone(), Some(camera));
        Self {
            scene,
            filter,
            known: BTreeMap::new(),
            pixels: BTreeMap::new(),
        }
    }

    /// The measurements of frame `k`; they do not depend on the filter but for ids.
    fn frame(&mut self, k: usize) -> (Measurements, Vec<usize>) {
        let t = k as f64 * STEP;
        self.scene.measure(t, &self.known, k % 4 < 2)
    }

    fn step(&mut self, k: usize) {
        let t = k as f64 * STEP;
        self.filter.predict(t).expect("time goes on");
        let (z, points) = self.frame(k);
        let report = self.filter.update(&z).expect("good measurements");
        adopt(&mut self.known, &report, &points);
        if self.filter.started() {
            self.candidates(k);
        }
        if self.filter.started() && k % 6 == 4 {
            let seen: Vec<u64> = self.known.keys().copied().collect();
            self.filter.end_submap(&seen).expect("known");
        }
        for id in self.filter.manage_map(&[]) {
            self.known.remove(&id);
        }
        if k % 7 == 6
            && let Some(&id) = self.known.keys().next()
        {
            self.filter.remove_features(&[id]).expect("known");
            self.known.remove(&id);
        }
    }

    fn candidates(&mut self, k: usize) {
        let pose = self.scene.pose(k as f64 * STEP);
        let waiting: Vec<u64> = self.filter.candidate_ids().collect();
        let seen: Vec<(u64, Vector2<f64>)> = waiting
            .iter()
            .filter_map(|id| Some((*id, self.scene.pixel(&pose, *self.pixels.get(id)?)?)))
            .collect();
        self.filter.observe_candidates(&seen).expect("candidates");
        if k.is_multiple_of(3) {
            let points: Vec<usize> = (0..5).map(|i| (7 * k + i) % 90).collect();
            let some: Vec<(usize, Vector2<f64>)> = points
                .into_iter()
                .filter_map(|p| Some((p, self.scene.pixel(&pose, p)?)))
                .collect();
            let uv: Vec<_> = some.iter().map(|(_, uv)| *uv).collect();
            let ids = self.filter.add_candidates(&uv).expect("started");
            self.pixels
                .extend(ids.into_iter().zip(some.iter().map(|(p, _)| *p)));
        }
    }
}

fn kinds() -> Vec<Vec<(&'static str, Value)>> {
    vec![
        vec![],
        vec![
            ("birth.first_pose", name("independent")),
            ("worn.bias_share", Value::Float(0.4)),
        ],
        vec![
            ("estimator.mode", name("collab")),
            ("estimator.consistency", name("none")),
        ],
        vec![
            ("calibration.focal_sd", Value::Float(0.005)),
            ("worn.bias_share", Value::Float(0.4)),
        ],
    ]
}

#[test]
fn a_restored_filter_goes_on_bit_for_bit() {
    for changes in kinds() {
        let mut walk = Walk::new(&changes);
        for k in 0..24 {
            walk.step(k);
            let bytes = walk.filter.snapshot();
            let copy = Filter::restore(&bytes).expect("what was just written");
            // Every frame goes on with the copy: what is forgotten once is missing for good.
            assert!(copy.snapshot() == bytes, "{changes:?}, frame {k}");
            if k % 5 == 4 {
                walk.filter = copy;
            }
        }
        let mut straight = Walk::new(&changes);
        (0..24).for_each(|k| straight.step(k));
        assert!(walk.filter.map_size() > 20);
        assert!(
            straight.filter.snapshot() == walk.filter.snapshot(),
            "{changes:?}"
        );
    }
}

fn a_snapshot() -> Vec<u8> {
    let mut walk = Walk::new(&[]);
    (0..6).for_each(|k| walk.step(k));
    walk.filter.snapshot()
}

fn is_refused(bytes: &[u8], why: &str) {
    match Filter::restore(bytes) {
        Err(EkfError::BadSnapshot { why: said }) => assert!(said.contains(why), "{said}"),
        other => panic!("{why}: {other:?}"),
    }
}

#[test]
fn spoilt_bytes_are_refused() {
    let good = a_snapshot();
    is_refused(&[], "cut short");
    is_refused(b"something else, and long enough", "not a snapshot");
    for cut in [10, good.len() / 2, good.len() - 1] {
        is_refused(&good[..cut], "cut short");
    }
    is_refused(&[good.clone(), vec![0]].concat(), "bytes too many");
    let mut newer = good.clone();
    newer[8] = VERSION as u8 + 1;
    is_refused(&newer, &format!("reads version {VERSION}"));
    let mut rng = rng(1);
    for _ in 0..50 {
        let mut altered = good.clone();
        let at = rng.random_range(20..altered.len());
        altered[at] ^= 1 << rng.random_range(0..8);
        is_refused(&altered, "checksum");
    }
}

#[test]
fn a_body_that_makes_no_filter_is_refused_or_one_that_works() {
    let good = a_snapshot();
    let body = open(&good).expect("good");
    let mut rng = rng(2);
    let mut survived = 0;
    for round in 0..400 {
        let mut altered = body.to_vec();
        // Early bytes are names, counts and ids; the rest is numbers.
        let reach = if round % 2 == 0 {
            altered.len().min(3000)
        } else {
            altered.len()
        };
        for _ in 0..=round % 3 {
            let at = rng.random_range(0..reach);
            altered[at] = rng.random();
        }
        if round % 10 == 9 {
            altered.truncate(rng.random_range(0..altered.len()));
        }
        let Ok(mut filter) = Filter::restore(&seal(&altered)) else {
            continue;
        };
        survived += 1;
        // Whatever passed is a filter: nothing below panics.
        let t = filter.time().unwrap_or(0.0) + 0.1;
        let _ = filter.predict(t);
        let seen = filter.predict_pixels();
        let mut z = Measurements::default();
        for f in seen.iter().filter(|f| f.uv.iter().all(|v| v.is_finite())) {
            z.bearings.push(ekf_core::Bearing { id: f.id, uv: f.uv });
        }
        let _ = filter.update(&z);
        let pixels = [100.0, 140.0, 180.0].map(|u| Vector2::new(u, 100.0));
        if let Ok(candidates) = filter.add_candidates(&pixels) {
            let _ = filter.promote_candidates(&candidates, true);
        }
        filter.manage_map(&[]);
        filter.landmarks();
    }
    assert!(
        survived > 20,
        "only {survived} of 400 got through: the test sees too little"
    );
}
