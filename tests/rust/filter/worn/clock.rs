//! The worn camera's clock (METHOD 21, 26): found where Cs changes its motion, left alone where it does not, and kept whatever
//! happens to the map.

use crate::scene::{DT, Scene, Trajectory, adopt, normals, rng, settings, worn_covariance};
use ekf_core::settings::Value;
use ekf_core::state::{BlockKind, transferred_dim};
use ekf_core::{Capture, Filter, Measurements, WornObservation};
use nalgebra::{Matrix3, Matrix6, Vector3, Vector6};
use rand::Rng;
use std::collections::BTreeMap;

const SD: f64 = 0.05;
const DRAWS: u32 = 8;
/// A view comes that long after its stamp, with a frame of then.
const LATE: f64 = 0.07;

/// A scene in which Cf's clock is off, what lasts of the error of T_CF along C's axes, and a filter that was told of both.
#[derive(Clone)]
struct Draw {
    scene: Scene,
    time_correlated: Vector6<f64>,
    stated: Option<Matrix6<f64>>,
    filter: Filter,
    known: BTreeMap<u64, usize>,
    frame: u32,
}

impl Draw {
    fn new(seed: u64, trajectory: Trajectory, clock: f64) -> Self {
        Self::with(seed, trajectory, clock, &[])
    }

    fn with(seed: u64, trajectory: Trajectory, clock: f64, changes: &[(&str, Value)]) -> Self {
        let mut scene = Scene::new(seed, 40);
        if trajectory == Trajectory::Straight {
            let mut rng = rng(seed + 2000);
            let more = (0..80).map(|_| {
                Vector3::new(
                    rng.random_range(4.0..14.0),
                    rng.random_range(-2.0..2.5),
                    rng.random_range(3.0..9.0),
                )
            });
            scene.points.extend(more);
        }
        scene.trajectory = trajectory;
        scene.goes_about = trajectory == Trajectory::Lively;
        scene.clock = clock - LATE;
        scene.worn_covariance = worn_covariance() * 0.1;
        let (shift, turn) = (0.03, 1.0_f64.to_radians());
        let sds = Vector6::new(shift, shift, shift, turn, turn, turn) / 3.0_f64.sqrt();
        let mut told = settings(&[
            ("worn.bias_time", Value::Float(1e5)),
            ("worn.clock_sd", Value::Float(SD)),
        ]);
        for (key, value) in changes {
            told.set(key, value).expect("valid setting");
        }
        Self {
            time_correlated: sds.component_mul(&normals::<6>(&mut rng(seed + 1000))),
            stated: Some(Matrix6::from_diagonal(&sds.component_mul(&sds))),
            filter: scene.filter(told),
            scene,
            known: BTreeMap::new(),
            frame: 0,
        }
    }

    /// As drawn, without an error that lasts, and none stated.
    fn with_exact_poses(mut self) -> Self {
        self.time_correlated = Vector6::zeros();
        self.stated = None;
        self
    }

    fn now(&self) -> f64 {
        DT * f64::from(self.frame)
    }

    /// What the frame sees of what is `known`.
    fn measure(&mut self, known: &BTreeMap<u64, usize>) -> (Measurements, Vec<usize>) {
        let (mut z, points) = self.scene.measure(self.now(), known, true);
        let worn = &mut z.views[0];
        let into_f = worn.t_cf.rotation.transpose();
        let mut error = Vector6::zeros();
        for at in [0, 3] {
            let along_f = into_f * self.time_correlated.fixed_rows::<3>(at);
            error.fixed_rows_mut::<3>(at).copy_from(&along_f);
        }
        worn.t_cf = worn.t_cf.retract(&-error);
        worn.covariance += self.stated.unwrap_or_default();
        worn.bias = self.stated;
        worn.capture = Some(Capture {
            t: self.now() - LATE,
            frame: self.now(),
        });
        (z, points)
    }

    fn step(&mut self) {
        self.filter.predict(self.now()).expect("increasing time");
        let (z, points) = self.measure(&self.known.clone());
        let report = self.filter.update(&z).expect("good measurements");
        adopt(&mut self.known, &report, &points);
        for id in self.filter.manage_map(&[]) {
            self.known.remove(&id);
        }
        self.filter.keep_pose(1.0);
        self.frame += 1;
    }

    /// That many frames, each with a view.
    fn run(mut self, frames: u32) -> Self {
        for _ in 0..frames {
            self.step();
        }
        self.filter.check().expect("sound");
        self
    }

    fn clock(&self) -> (f64, f64) {
        self.filter.worn_clock(0).expect("a clock")
    }
}

/// `SD`, early in one half of the draws and late in the other.
fn off(seed: u64) -> f64 {
    if seed.is_multiple_of(2) { SD } else { -SD }
}

/// The clocks of eight draws are found, each as far off as is claimed.
fn are_found(draw: impl Fn(u64) -> Draw) {
    let (mut squares, mut variances) = (0.0, 0.0);
    for seed in 0..u64::from(DRAWS) {
        let (mean, sd) = draw(seed).run(150).clock();
        squares += ((mean - off(seed)) / sd).powi(2) / f64::from(DRAWS);
        variances += (sd / SD).powi(2) / f64::from(DRAWS);
    }
    assert!(
        variances.sqrt() < 0.33,
        "known to {} of what was possible",
        variances.sqrt()
    );
    // Of 8 degrees of freedom 0.1 to 3.3 is where 99.9 of 100 lie.
    assert!((0.1..3.3).contains(&squares), "NEES {squares}");
}

#[test]
fn it_is_found_on_a_lively_way_as_well_as_is_claimed() {
    are_found(|seed| Draw::new(seed, Trajectory::Lively, off(seed)));
}

#[test]
fn it_is_found_where_nothing_else_lasts() {
    are_found(|seed| Draw::new(seed, Trajectory::Lively, off(seed)).with_exact_poses());
}

#[test]
fn it_is_left_alone_where_motion_does_not_tell_it() {
    for trajectory in [Trajectory::Straight, Trajectory::Round] {
        for seed in 0..4 {
            let (mean, sd) = Draw::new(seed, trajectory, off(seed)).run(80).clock();
            assert!(mean.abs() < 0.1 * SD, "{trajectory:?}, {seed}: {mean}");
            assert!(sd > 0.9 * SD, "{trajectory:?}, {seed}: {sd}");
        }
    }
}

#[test]
fn it_is_each_cameras_own_and_there_only_where_it_is_uncertain() {
    let draw = Draw::new(1, Trajectory::Lively, off(1)).run(70);
    assert!(draw.clock().1 < 0.5 * SD);
    assert_eq!(draw.filter.worn_clock(1), Some((0.0, SD)));
    assert_eq!(draw.filter.worn_clock(3), None);
    let exact = Scene::new(1, 40).filter(settings(&[]));
    assert_eq!(exact.worn_clock(0), None);
}

#[test]
fn a_snapshot_a_checkpoint_and_a_local_update_keep_it() {
    let mut draw = Draw::new(3, Trajectory::Lively, off(3)).run(25);
    let mut restored = draw.clone();
    restored.filter = Filter::restore(&draw.filter.snapshot()).expect("its own");
    draw.filter.checkpoint();
    let before = draw.filter.snapshot();
    draw = draw.run(30);
    assert!(draw.clock().1 < 0.5 * SD);
    let restored = restored.run(30);
    assert!(restored.filter.snapshot() == draw.filter.snapshot());
    draw.filter.rollback().expect("there is one");
    assert!(draw.filter.snapshot() == before);

    let by = |from| {
        Draw::with(
            3,
            Trajectory::Lively,
            off(3),
            &[("map.local_from", Value::Int(from))],
        )
    };
    let [local, full] = [4, 1_000_000].map(|from| by(from).run(55).clock());
    assert!((local.0 - full.0).abs() < 1e-8 && (local.1 - full.1).abs() < 1e-8);
}

#[test]
fn a_new_map_begins_with_what_is_known_of_it() {
    let mut draw = Draw::new(4, Trajectory::Lively, off(4)).run(60);
    let known = draw.clock();
    assert!(known.1 < 0.5 * SD);
    let (_, map) = draw.filter.known_map();
    let matches: Vec<_> = {
        let t = draw.now();
        draw.filter.predict(t).expect("increasing time");
        let (ids, _) = draw.filter.known_map();
        let (z, _) = draw.measure(&draw.known.clone());
        let found = z.bearings.iter();
        found
            .filter_map(|b| Some((ids.iter().position(|id| *id == b.id)?, b.uv)))
            .collect()
    };
    let mut elsewhere = draw.filter.clone();
    let truth = draw.scene.pose(draw.now());
    let (report, _) = elsewhere
        .relocalise_in(&map, &truth, &matches, None, false)
        .expect("its own map");
    assert!(report.accepted);
    assert_eq!(elsewhere.worn_clock(0), Some(known));

    let (z, _) = draw.measure(&BTreeMap::new());
    let worn: WornObservation = z.views[0].clone();
    let report = draw
        .filter
        .restart(&worn, &Matrix3::zeros())
        .expect("new points");
    assert!(report.accepted);
    assert_eq!(draw.filter.worn_clock(0), Some(known));
}

#[test]
fn a_submap_hands_on_what_it_does_in_all_views_alike() {
    let mut draw = Draw::new(2, Trajectory::Straight, off(2)).run(20);
    let seen: Vec<u64> = draw.known.keys().copied().collect();
    let transferred = draw.filter.end_submap(&seen).expect("known").transferred;
    assert_eq!(transferred.nrows(), transferred_dim(3));
    let state = draw.filter.state();
    let find = |kind| state.layout().of_kind(kind).next().expect("there").offset;
    let bias = find(BlockKind::WornBias(ekf_core::state::ErrorOwner::Of(0)));
    let clock = find(BlockKind::WornClock(0));
    let p = state.covariance();
    // Along the way it is the shift and the way in the clock's error together.
    let v = Vector3::new(0.8, 0.1, 0.0);
    for i in 0..2 {
        let expected = p.get(bias + i, bias + i)
            + 2.0 * v[i] * p.get(bias + i, clock)
            + v[i] * v[i] * p.get(clock, clock);
        let off = transferred[(1 + i, 1 + i)] / expected - 1.0;
        assert!(off.abs() < 0.2, "{i}: {off}");
    }
}
