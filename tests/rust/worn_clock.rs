//! The worn camera's clock (METHOD 21, 26): found where Cs changes its motion, left alone where it does not.

use crate::scene::{DT, Scene, Way, adopt, normals, rng, settings, worn_covariance};
use ekf_core::Filter;
use ekf_core::settings::Value;
use nalgebra::{Matrix6, Vector3, Vector6};
use rand::Rng;
use std::collections::BTreeMap;

const SD: f64 = 0.05;
const DRAWS: u32 = 8;

/// A scene in which Cf's clock is off, and what lasts of the error of T_CF along C's axes.
struct Draw {
    scene: Scene,
    lasting: Vector6<f64>,
    stated: Matrix6<f64>,
}

impl Draw {
    fn new(seed: u64, way: Way, clock: f64) -> Self {
        let mut scene = Scene::new(seed, 40);
        if way == Way::Straight {
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
        scene.way = way;
        scene.goes_about = way == Way::Lively;
        scene.clock = clock;
        scene.worn_covariance = worn_covariance() * 0.1;
        let (shift, turn) = (0.03, 1.0_f64.to_radians());
        let sds = Vector6::new(shift, shift, shift, turn, turn, turn) / 3.0_f64.sqrt();
        Self {
            scene,
            lasting: sds.component_mul(&normals::<6>(&mut rng(seed + 1000))),
            stated: Matrix6::from_diagonal(&sds.component_mul(&sds)),
        }
    }

    /// The filter after that many frames, each with a view.
    fn run(&mut self, frames: u32) -> Filter {
        let told = [
            ("worn.bias_time", Value::Float(1e5)),
            ("worn.clock_sd", Value::Float(SD)),
        ];
        let mut filter = self.scene.filter(settings(&told));
        let mut known = BTreeMap::new();
        for k in 0..frames {
            let t = DT * f64::from(k);
            filter.predict(t).expect("increasing time");
            let (mut z, points) = self.scene.measure(t, &known, true);
            let worn = z.worn.as_mut().expect("a worn view");
            let into_f = worn.t_cf.rotation.transpose();
            let mut error = Vector6::zeros();
            for at in [0, 3] {
                let along_f = into_f * self.lasting.fixed_rows::<3>(at);
                error.fixed_rows_mut::<3>(at).copy_from(&along_f);
            }
            worn.t_cf = worn.t_cf.retract(&-error);
            worn.covariance += self.stated;
            worn.bias = Some(self.stated);
            let report = filter.update(&z).expect("good measurements");
            adopt(&mut known, &report, &points);
            for id in filter.manage_map() {
                known.remove(&id);
            }
        }
        filter.check().expect("sound");
        filter
    }
}

#[test]
fn it_is_found_on_a_lively_way_as_well_as_is_claimed() {
    let mut squares = 0.0;
    for seed in 0..u64::from(DRAWS) {
        let clock = if seed % 2 == 0 { SD } else { -SD };
        let (mean, sd) = Draw::new(seed, Way::Lively, clock)
            .run(100)
            .worn_clock(0)
            .expect("a clock");
        println!(
            "{seed}: {clock} found {mean:.4} sd {sd:.4} off {:.2} sd",
            (mean - clock) / sd
        );
        assert!(sd < SD / 3.0, "{seed}: it is known to {sd}");
        assert!((mean - clock).abs() < 0.01, "{seed}: {mean} of {clock}");
        squares += ((mean - clock) / sd).powi(2);
    }
    let nees = squares / f64::from(DRAWS);
    // 8 degrees of freedom: 0.15 to 3.3 is where 99.9 of 100 lie.
    assert!(nees < 3.3, "NEES {nees}");
}

#[test]
fn it_is_left_alone_where_motion_does_not_tell_it() {
    for way in [Way::Straight, Way::Round] {
        for seed in 0..4 {
            let clock = if seed % 2 == 0 { SD } else { -SD };
            let filter = Draw::new(seed, way, clock).run(80);
            let (mean, sd) = filter.worn_clock(0).expect("a clock");
            println!("{way:?} {seed}: {clock} found {mean:.4} sd {sd:.4}");
            assert!(mean.abs() < 0.01, "{way:?}, {seed}: {mean}");
            assert!(sd > 0.9 * SD, "{way:?}, {seed}: {sd}");
        }
    }
}
