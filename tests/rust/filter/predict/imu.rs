//! A gyroscope in place of constant angular velocity (METHOD 28): how well its errors are known, what it is worth, what is refused.

use crate::scene::{DT, Scene, Trajectory, adopt, normal, normals, rng, settings};
use ekf_core::math::pose::Pose;
use ekf_core::math::quat;
use ekf_core::settings::Value;
use ekf_core::state::BlockKind;
use ekf_core::{Bearing, EkfError, Filter};
use nalgebra::{Matrix3, SVector, Vector3, Vector6};
use rand_pcg::Pcg64;
use std::collections::BTreeMap;

const RATE: f64 = 200.0;
const BIAS_SD: f64 = 0.01;
const NOISE: f64 = 0.001;
const OFFSET_SD: f64 = 0.005;
const MOUNT_SD: f64 = 0.0087;

/// How a sensor sits, but for its errors.
fn r_ci() -> Matrix3<f64> {
    quat::rotation_exp(&Vector3::new(1.2, -0.7, 0.4))
}

/// A sensor whose errors are drawn from the sizes that the filter is told.
struct Sensor {
    bias: Vector3<f64>,
    scale: f64,
    mount: Vector3<f64>,
    /// To be added to its stamps.
    offset: f64,
    rng: Pcg64,
    given: i32,
}

impl Sensor {
    fn drawn(seed: u64) -> Self {
        let mut rng = rng(seed);
        Self {
            bias: normals::<3>(&mut rng) * BIAS_SD,
            scale: 0.005 * normal(&mut rng),
            mount: normals::<3>(&mut rng) * MOUNT_SD,
            offset: OFFSET_SD * normal(&mut rng),
            rng,
            given: -20,
        }
    }

    /// The rate along its axes at a time of the frames' clock.
    fn rate(&mut self, scene: &Scene, t: f64) -> Vector3<f64> {
        let h = 1e-4;
        let [before, after] = [-h, h].map(|h| scene.pose(t + h).rotation);
        let true_rate = quat::rotation_log(&(before.transpose() * after)) / (2.0 * h);
        let seen = (quat::rotation_exp(&self.mount) * r_ci()).transpose() * true_rate;
        let noise = normals::<3>(&mut self.rng) * (NOISE * RATE.sqrt());
        seen / (1.0 + self.scale) + self.bias + noise
    }

    /// Gives a filter all samples up to a time, and the one after it.
    fn give(&mut self, filter: &mut Filter, scene: &Scene, until: f64) {
        loop {
            let t = f64::from(self.given) / RATE;
            let rate = self.rate(scene, t + self.offset);
            filter.add_gyro(t, &rate).expect("in order");
            self.given += 1;
            if t > until + 0.03 {
                return;
            }
        }
    }
}

fn sizes() -> Vec<(&'static str, Value)> {
    vec![
        ("imu.gyro_bias_sd", Value::Float(BIAS_SD)),
        ("imu.gyro_noise", Value::Float(NOISE)),
        ("imu.time_offset_sd", Value::Float(OFFSET_SD)),
        ("imu.mount_sd", Value::Float(MOUNT_SD)),
    ]
}

pub(super) struct Run {
    scene: Scene,
    pub(super) filter: Filter,
    sensor: Sensor,
    known: BTreeMap<u64, usize>,
    frame: u32,
}

impl Run {
    pub(super) fn new(seed: u64, way: Trajectory) -> Self {
        let mut scene = Scene::new(seed, 60);
        scene.trajectory = way;
        let mut filter = scene.filter(settings(&sizes()));
        filter.set_imu(&r_ci(), 0.0).expect("a rotation");
        Self {
            sensor: Sensor::drawn(seed + 500),
            scene,
            filter,
            known: BTreeMap::new(),
            frame: 0,
        }
    }

    pub(super) fn predict(&mut self) {
        let t = DT * f64::from(self.frame);
        self.sensor.give(&mut self.filter, &self.scene, t);
        self.filter.predict(t).expect("increasing time");
        self.frame += 1;
    }

    pub(super) fn step(&mut self, with_worn: bool) {
        self.step_of(with_worn, 0.0);
    }

    /// A frame that shows the scene some seconds after its stamp.
    fn step_of(&mut self, with_worn: bool, late: f64) {
        self.predict();
        let t = DT * f64::from(self.frame - 1) + late;
        let (z, points) = self.scene.measure(t, &self.known, with_worn);
        let report = self.filter.update(&z).expect("good measurements");
        adopt(&mut self.known, &report, &points);
        for id in self.filter.manage_map(&[]) {
            self.known.remove(&id);
        }
    }

    fn off(&self) -> Vector6<f64> {
        let (rotation, translation) = self.filter.pose();
        let estimate = Pose {
            rotation,
            translation,
        };
        let truth = self.scene.pose(DT * f64::from(self.frame - 1));
        estimate.inverse().compose(&truth).log()
    }
}

fn nees<const N: usize>(off: &SVector<f64, N>, p: &nalgebra::SMatrix<f64, N, N>) -> f64 {
    let inverse = p.try_inverse().expect("definite");
    off.dot(&(inverse * off))
}

#[test]
fn bias_clock_and_attitude_are_known_as_well_as_claimed() {
    let runs = 40_u32;
    let (mut of_bias, mut of_attitude, mut of_clock) = (0.0, 0.0, 0.0);
    let (mut inside, mut frames, mut learned) = (0, 0, 0.0);
    for seed in 0..runs {
        let mut run = Run::new(u64::from(seed), Trajectory::Shaken);
        for frame in 0..60 {
            run.step(frame < 5);
            let (bias, p) = run.filter.gyro_bias().expect("a gyroscope");
            let off = run.sensor.bias - bias;
            frames += 3;
            inside += (0..3)
                .filter(|&i| off[i].abs() < 3.0 * p[(i, i)].sqrt())
                .count();
        }
        let share = 1.0 / f64::from(runs);
        let (bias, p) = run.filter.gyro_bias().expect("a gyroscope");
        of_bias += nees(&(run.sensor.bias - bias), &p) * share;
        learned += (p.trace() / 3.0).sqrt() * share;
        let turn = run.off().fixed_rows::<3>(3).into_owned();
        let p = run.filter.pose_covariance();
        of_attitude += nees(&turn, &p.fixed_view::<3, 3>(3, 3).into_owned()) * share;
        let (clock, sd) = run.filter.gyro_clock().expect("a gyroscope");
        of_clock += ((run.sensor.offset - clock) / sd).powi(2) * share;
        assert!(sd < 0.8 * OFFSET_SD, "the motion tells the clock: {sd}");
        run.filter.check().expect("sound");
    }
    println!(
        "NEES bias {of_bias:.2} attitude {of_attitude:.2} clock {of_clock:.2}; sd {learned:.5}"
    );
    // 3 and 1 +- 4 sd of a mean over the runs.
    let band = |dof: f64| 4.0 * (2.0 * dof / f64::from(runs)).sqrt();
    assert!(of_bias < 3.0 + band(3.0), "{of_bias}");
    assert!(of_attitude < 3.0 + band(3.0), "{of_attitude}");
    assert!(of_clock < 1.0 + band(1.0), "{of_clock}");
    assert!(learned < 0.4 * BIAS_SD, "{learned}");
    assert!(
        f64::from(inside as u32) > 0.985 * f64::from(frames),
        "{inside} of {frames}"
    );
}

/// Exposures change, and what is blurred is found where it was brightest: a hand's quick turns teach no wrong bias by that.
#[test]
fn frames_that_stray_from_their_stamps_teach_no_wrong_bias() {
    let runs = 40_u32;
    let mut of_bias = 0.0;
    for seed in 0..runs {
        let mut run = Run::new(u64::from(seed), Trajectory::Shaken);
        let mut rng = rng(u64::from(seed) + 900);
        for frame in 0..30 {
            run.step_of(frame < 5, 1e-3 * normal(&mut rng));
        }
        let (bias, p) = run.filter.gyro_bias().expect("a gyroscope");
        of_bias += nees(&(run.sensor.bias - bias), &p) / f64::from(runs);
    }
    println!("NEES of the bias {of_bias:.2}");
    // 3 is ideal. Taken to be where their stamps say, it is 4.3.
    assert!(of_bias < 3.0, "{of_bias}");
}

#[test]
fn in_the_dark_the_turn_is_the_gyroscopes() {
    let (runs, mut of_turn, mut claimed) = (60_u32, 0.0, 0.0);
    for seed in 0..runs {
        let mut run = Run::new(u64::from(seed) + 100, Trajectory::Lively);
        for frame in 0..20 {
            run.step(frame < 5);
        }
        for _ in 0..20 {
            run.predict();
            assert!(run.filter.followed_gyro());
        }
        let turn = run.off().fixed_rows::<3>(3).into_owned();
        let p = run.filter.pose_covariance();
        let p = p.fixed_view::<3, 3>(3, 3).into_owned();
        of_turn += nees(&turn, &p) / f64::from(runs);
        claimed += (p.trace() / 3.0).sqrt() / f64::from(runs);
    }
    println!("NEES {of_turn:.2}, sd {claimed:.4}");
    // What the map's drift adds is more than these images err; it is never less than they do.
    let band = 4.0 * (6.0 / f64::from(runs)).sqrt();
    assert!(of_turn > 0.8 && of_turn < 3.0 + band, "{of_turn}");
    // Half a degree after two seconds; constant velocity claims a radian and more.
    assert!(claimed < 0.02, "{claimed}");
}

#[test]
fn wheels_tell_the_way_and_the_gyroscope_the_turn() {
    let mut run = Run::new(7, Trajectory::Round);
    run.sensor.mount = Vector3::zeros();
    for frame in 0..5 {
        run.step(frame < 5);
    }
    let mut k = 0;
    for _ in 0..30 {
        let t = DT * f64::from(run.frame);
        while 0.02 * f64::from(k) <= t + 0.02 {
            let at = 0.02 * f64::from(k);
            let [before, after] = [at - 0.02, at].map(|t| run.scene.pose(t));
            let mut twist = before.inverse().compose(&after).log() / 0.02;
            // Wheels that skid: half of the turn is missing.
            twist.fixed_rows_mut::<3>(3).scale_mut(0.5);
            let covariance = nalgebra::Matrix6::identity() * 1e-4;
            run.filter
                .add_odometry(at, &twist, &covariance)
                .expect("in order");
            k += 1;
        }
        run.predict();
        assert!(run.filter.followed_gyro() && run.filter.followed_odometry());
    }
    let off = run.off();
    assert!(off.fixed_rows::<3>(3).norm() < 0.03, "{off}");
    assert!(off.fixed_rows::<3>(0).norm() < 0.15, "{off}");
    let p = run.filter.pose_covariance();
    assert!(nees(&off, &p) < 25.0, "{}", nees(&off, &p));
}

#[test]
fn a_snapshot_goes_on_as_the_filter_does() {
    let mut run = Run::new(3, Trajectory::Lively);
    for frame in 0..10 {
        run.step(frame < 3);
    }
    run.sensor.give(&mut run.filter, &run.scene, 1.2);
    let mut other = Filter::restore(&run.filter.snapshot()).expect("a snapshot");
    for t in [1.0, 1.1, 1.2, 1.4] {
        run.filter.predict(t).expect("in order");
        other.predict(t).expect("in order");
    }
    assert_eq!(run.filter.state().mean(), other.state().mean());
    assert_eq!(run.filter.pose_covariance(), other.pose_covariance());
    assert_eq!(run.filter.snapshot(), other.snapshot());
}

#[test]
fn where_samples_lack_the_rate_stays_and_nobody_claims_to_know() {
    let mut run = Run::new(4, Trajectory::Lively);
    for frame in 0..10 {
        run.step(frame < 3);
    }
    run.predict();
    let turn_sd = |filter: &Filter| filter.pose_covariance()[(4, 4)].sqrt();
    let known = turn_sd(&run.filter);
    // Samples end 0.03 s after the last frame.
    run.filter.predict(1.4).expect("in order");
    assert!(!run.filter.followed_gyro());
    assert!(turn_sd(&run.filter) > 10.0 * known);
    run.filter.check().expect("sound");
}

#[test]
fn a_sensor_that_is_stuck_says_nothing() {
    let mut run = Run::new(6, Trajectory::Lively);
    for frame in 0..10 {
        run.step(frame < 3);
    }
    let rate = Vector3::new(0.3, -0.2, 0.1);
    for k in run.sensor.given..run.sensor.given + 200 {
        run.filter
            .add_gyro(f64::from(k) / RATE, &rate)
            .expect("in order");
    }
    assert_eq!(
        run.filter.gyro_time(),
        Some(f64::from(run.sensor.given + 199) / RATE)
    );
    run.filter.predict(1.0).expect("in order");
    run.filter.predict(1.2).expect("in order");
    assert!(!run.filter.followed_gyro());
}

#[test]
fn what_is_refused_leaves_the_filter_as_it_was() {
    let scene = Scene::new(1, 10);
    let mut filter = scene.filter(settings(&[]));
    let rate = Vector3::new(0.1, 0.0, 0.0);
    let is = |e: Result<(), EkfError>, text: &str| {
        let message = e.expect_err("refused").to_string();
        assert!(message.contains(text), "{message}");
    };
    is(filter.add_gyro(0.0, &rate), "made without one");
    is(
        filter.set_imu(&(Matrix3::identity() * 2.0), 0.0),
        "rotation matrix",
    );
    is(filter.set_imu(&Matrix3::identity(), 1e3), "one clock");
    is(filter.set_imu(&Matrix3::identity(), f64::NAN), "NaN");
    filter.set_imu(&r_ci(), 0.01).expect("good");
    filter.add_gyro(0.0, &rate).expect("good");
    let before = filter.snapshot();
    is(filter.add_gyro(0.0, &rate), "must increase");
    is(filter.add_gyro(1e18, &rate), "nanoseconds");
    is(filter.add_gyro(f64::NAN, &rate), "NaN");
    is(filter.add_gyro(1.0, &(rate * 1e3)), "not degrees");
    is(filter.add_gyro(1.0, &(rate * f64::NAN)), "NaN");
    is(filter.add_gyro(4000.0, &rate), "start a new filter");
    is(filter.set_imu(&r_ci(), 0.0), "once");
    assert_eq!(before, filter.snapshot());
}

/// After a second in the dark: where it really is, it is found; turned by 6 degrees and elsewhere, only without a gyroscope that is
/// believed, as for points that say themselves which they are.
#[test]
fn where_it_would_be_turned_otherwise_it_is_not_found() {
    let mut run = Run::new(7, Trajectory::Lively);
    for frame in 0..30 {
        run.step(frame < 5);
    }
    (0..10).for_each(|_| run.predict());
    let truth = run.scene.pose(DT * f64::from(run.frame - 1));
    let elsewhere = truth.retract(&Vector6::new(0.5, 0.0, 0.3, 0.0, 0.1, 0.0));
    let known: Vec<(u64, usize)> = run.known.iter().map(|(id, at)| (*id, *at)).collect();
    let mut found = |pose: &Pose, predicted: bool| {
        let seen =
            |&(id, at): &(u64, usize)| run.scene.pixel(pose, at).map(|uv| Bearing { id, uv });
        let matches: Vec<Bearing> = known.iter().filter_map(seen).collect();
        let mut filter = run.filter.clone();
        let report = filter.relocalise(pose, &matches, None, predicted);
        report.expect("good matches").accepted
    };
    assert!(found(&truth, true) && found(&elsewhere, false));
    assert!(!found(&elsewhere, true));
}

#[test]
fn another_map_keeps_what_is_known_of_it() {
    let mut run = Run::new(5, Trajectory::Lively);
    for frame in 0..30 {
        run.step(frame < 3);
    }
    let bias = run.filter.gyro_bias().expect("a gyroscope");
    run.predict();
    let t = DT * f64::from(run.frame - 1);
    let (z, _) = run.scene.measure(t, &BTreeMap::new(), true);
    let report = run.filter.restart(&z.views[0], &Matrix3::zeros());
    let report = report.expect("good measurements");
    assert!(!report.views[0].is_empty());
    let (mean, p) = run.filter.gyro_bias().expect("a gyroscope");
    assert!((mean - bias.0).norm() < 3.0 * BIAS_SD);
    assert!(p.trace() < 2.0 * bias.1.trace());
    let kinds = run.filter.state().layout().blocks().iter();
    assert_eq!(kinds.filter(|b| b.kind == BlockKind::GyroFrame).count(), 1);
}
