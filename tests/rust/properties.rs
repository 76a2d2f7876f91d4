//! Any sequence of calls: the filter does what the plain dense [`Reference`] does, and its state stays in order.

use crate::reference::Reference;
use crate::scene::{camera, name, settings};
use ekf_core::settings::Value;
use ekf_core::state::{Block, BlockKind};
use ekf_core::{
    Bearing, CandidateOutcome, DepthObservation, Filter, MeasurementOutcome, Measurements,
};
use nalgebra::Vector2;
use proptest::prelude::*;
use proptest::test_runner::{Config, RngAlgorithm, TestRng, TestRunner};
use std::collections::BTreeMap;

/// One call, with numbers from 0 to 1 to make its arguments of.
#[derive(Clone, Debug)]
enum Call {
    Predict(f64),
    /// Each feature in view is measured if its number is above a quarter; the first ones by depth if wanted.
    Update(Vec<f64>, bool),
    Undelayed([f64; 2]),
    Depth([f64; 3]),
    Candidates([f64; 2]),
    Observe(Vec<f64>),
    Remove(f64),
    Manage,
}

fn share() -> impl Strategy<Value = f64> {
    (0u32..=1000).prop_map(|k| f64::from(k) / 1000.0)
}

fn call() -> impl Strategy<Value = Call> {
    let shares = || proptest::collection::vec(share(), 24);
    let two = || proptest::array::uniform2(share());
    prop_oneof![
        4 => share().prop_map(Call::Predict),
        4 => (shares(), any::<bool>()).prop_map(|(s, d)| Call::Update(s, d)),
        2 => two().prop_map(Call::Undelayed),
        2 => proptest::array::uniform3(share()).prop_map(Call::Depth),
        3 => two().prop_map(Call::Candidates),
        4 => shares().prop_map(Call::Observe),
        1 => share().prop_map(Call::Remove),
        1 => Just(Call::Manage),
    ]
}

fn pixel(s: &[f64]) -> Vector2<f64> {
    Vector2::new(60.0 + 600.0 * s[0], 60.0 + 360.0 * s[1])
}

struct Pair {
    filter: Filter,
    reference: Reference,
    t: f64,
    /// Clone and first pixel of each candidate.
    first: BTreeMap<u64, (u64, Vector2<f64>)>,
}

impl Pair {
    fn new() -> Self {
        let settings = settings(&[
            ("estimator.consistency", name("none")),
            ("estimator.mode", name("mono")),
            ("validate.test", name("none")),
            ("map.max_features", Value::Int(6)),
            ("birth.undelayed_rho_sd", Value::Float(0.1)),
            ("process.start_velocity_sd", Value::Float(0.3)),
            ("process.start_angular_velocity_sd", Value::Float(0.1)),
        ]);
        let mut filter = Filter::new(settings.clone(), camera(), None);
        filter.predict(0.0).unwrap();
        let mut reference = Reference::new(&settings, &camera());
        let uv = Vector2::new(300.0, 200.0);
        let id = filter.add_undelayed(&[uv]).unwrap()[0].unwrap();
        reference.born_undelayed(id, &uv);
        Self {
            filter,
            reference,
            t: 0.0,
            first: BTreeMap::new(),
        }
    }

    fn play(&mut self, call: &Call) {
        match call {
            Call::Predict(s) => {
                let dt = 0.01 + 0.2 * s;
                self.t += dt;
                let before = self.filter.time().unwrap();
                self.filter.predict(self.t).unwrap();
                self.reference.predict(self.t - before);
            }
            Call::Update(shares, depth) => self.update(shares, *depth),
            Call::Undelayed(s) => {
                // None while the camera hardly knows where it looks.
                if let Some(id) = self.filter.add_undelayed(&[pixel(s)]).unwrap()[0] {
                    self.reference.born_undelayed(id, &pixel(s));
                }
            }
            Call::Depth(s) => {
                let new = DepthObservation {
                    id: None,
                    uv: pixel(s),
                    depth: 2.0 + 4.0 * s[2],
                    sigma: 0.1,
                };
                let z = Measurements {
                    depths: vec![new],
                    ..Measurements::default()
                };
                let report = self.filter.update(&z).unwrap();
                if let MeasurementOutcome::Born(id) = report.depths[0] {
                    self.reference
                        .born_at_depth(id, &new.uv, new.depth, new.sigma);
                }
            }
            Call::Candidates(s) => {
                let candidate = self.filter.add_candidates(&[pixel(s)]).unwrap()[0];
                let clone = self
                    .filter
                    .state()
                    .layout()
                    .of_kind(BlockKind::Clone)
                    .last()
                    .unwrap()
                    .id;
                self.reference.clone_pose(clone);
                self.first.insert(candidate, (clone, pixel(s)));
            }
            Call::Observe(shares) => self.observe(shares),
            Call::Remove(s) => {
                let ids: Vec<u64> = self.features().map(|b| b.id).collect();
                if ids.len() > 1 {
                    let k = (s * (ids.len() - 1) as f64) as usize;
                    self.filter.remove_features(&[ids[k]]).unwrap();
                    assert!(self.filter.remove_features(&[ids[k]]).is_err());
                }
                self.reference.keep(&self.all_ids());
            }
            Call::Manage => {
                self.filter.manage_map(&[]);
                self.reference.keep(&self.all_ids());
            }
        }
    }

    fn update(&mut self, shares: &[f64], depth: bool) {
        let mut z = Measurements::default();
        for (f, s) in self.filter.predict_pixels().iter().zip(shares) {
            z.searched.push(f.id);
            if *s > 0.25 {
                let uv = f.uv + Vector2::new(3.0 * (s - 0.6), 2.0 - 3.0 * s);
                z.bearings.push(Bearing { id: f.id, uv });
                if depth && z.depths.len() < 2 {
                    // Along the axis, from the range along the ray.
                    let ray = camera().unproject(&uv).unwrap();
                    z.depths.push(DepthObservation {
                        id: Some(f.id),
                        uv,
                        depth: ray.z / f.rho * (0.98 + 0.05 * s),
                        sigma: 0.2,
                    });
                }
            }
        }
        let report = self.filter.update(&z).unwrap();
        let pixels = z.bearings.iter().zip(&report.bearings);
        let pixels = pixels.filter(|(_, outcome)| **outcome != MeasurementOutcome::TooUncertain);
        let pixels: Vec<_> = pixels.map(|(b, _)| (b.id, b.uv)).collect();
        let depths: Vec<_> = z
            .depths
            .iter()
            .map(|d| (d.id.unwrap(), d.uv, d.depth, d.sigma))
            .collect();
        self.reference.update(&pixels, &depths);
    }

    fn observe(&mut self, shares: &[f64]) {
        let ids: Vec<u64> = self.filter.candidate_ids().collect();
        let (rotation, r) = self.filter.pose();
        let mut seen = Vec::new();
        for (id, s) in ids.iter().zip(shares) {
            // Where a point on the first ray at some range is now.
            let (clone, uv) = self.first[id];
            let Some(block) = self.filter.state().layout().find(clone).copied() else {
                continue;
            };
            let x = self.filter.state().mean();
            let (at, q) = (
                &x[block.offset..block.offset + 3],
                &x[block.offset + 3..block.offset + 7],
            );
            let q = nalgebra::UnitQuaternion::from_quaternion(nalgebra::Quaternion::new(
                q[0], q[1], q[2], q[3],
            ));
            let ray = camera().unproject(&uv).unwrap() * (1.0 + 2.0 * s);
            let point = q * ray + nalgebra::Vector3::new(at[0], at[1], at[2]);
            if let Some(now) = camera().project(&(rotation.transpose() * (point - r)))
                && camera().in_image(&now, 5.0)
            {
                seen.push((*id, now + Vector2::new(0.3 * s, -0.2)));
            }
        }
        let outcomes = self.filter.observe_candidates(&seen).unwrap();
        for ((id, uv), outcome) in seen.iter().zip(outcomes) {
            if let CandidateOutcome::Born(feature) = outcome {
                let (clone, first) = self.first[id];
                self.reference.born_delayed(feature, clone, uv, &first);
            }
        }
    }

    fn features(&self) -> impl Iterator<Item = &Block> {
        self.filter.state().layout().features()
    }

    fn all_ids(&self) -> Vec<u64> {
        self.filter
            .state()
            .layout()
            .blocks()
            .iter()
            .map(|b| b.id)
            .collect()
    }

    fn check(&self) -> Result<(), TestCaseError> {
        let state = self.filter.state();
        let (x, p) = (state.mean(), state.covariance());
        let ids: Vec<u64> = self.reference.blocks.iter().map(|b| b.id).collect();
        prop_assert_eq!(self.all_ids(), ids);
        prop_assert_eq!(x.len(), self.reference.x.len());
        let least = p.least_scaled_eigenvalue();
        prop_assert!(least > -1e-10, "least eigenvalue {least:e}");
        let sd = |i: usize| p.get(i, i).max(0.0).sqrt();
        for i in 0..x.len() {
            let off = (x[i] - self.reference.x[i]).abs();
            prop_assert!(
                off <= 1e-5 * sd(i) + 1e-7,
                "mean[{i}] {} is off by {off:e}, sd {}",
                x[i],
                sd(i)
            );
            for j in 0..=i {
                let off = (p.get(i, j) - self.reference.p[(i, j)]).abs();
                prop_assert!(
                    off <= 1e-5 * sd(i) * sd(j) + 1e-8,
                    "P[{i}, {j}] {} is off by {off:e}",
                    p.get(i, j)
                );
            }
        }
        Ok(())
    }
}

/// The same sequences in every run.
#[test]
fn any_calls_do_what_the_dense_reference_does() {
    let config = Config {
        cases: 200,
        failure_persistence: None,
        ..Config::default()
    };
    let rng = TestRng::deterministic_rng(RngAlgorithm::ChaCha);
    let mut runner = TestRunner::new_with_rng(config, rng);
    let calls = proptest::collection::vec(call(), 1..25);
    let result = runner.run(&calls, |calls| {
        let mut pair = Pair::new();
        for call in &calls {
            pair.play(call);
            pair.check()?;
        }
        Ok(())
    });
    if let Err(error) = result {
        panic!("{error}");
    }
}

/// The sequences above reach what they are for: births of each kind, depths, removals.
#[test]
fn the_sequences_reach_every_kind_of_birth() {
    use proptest::strategy::ValueTree;
    let mut runner = TestRunner::deterministic();
    let strategy = proptest::collection::vec(call(), 24);
    let (mut delayed, mut removed) = (0, 0);
    for _ in 0..100 {
        let calls = strategy.new_tree(&mut runner).unwrap().current();
        let mut pair = Pair::new();
        for call in &calls {
            let before = pair.features().count();
            pair.play(call);
            let after = pair.features().count();
            delayed += usize::from(matches!(call, Call::Observe(_)) && after > before);
            removed += usize::from(after < before);
        }
    }
    assert!(
        delayed > 5 && removed > 5,
        "{delayed} delayed births, {removed} removals"
    );
}
