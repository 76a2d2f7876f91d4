//! Parts of a filter step at N features and m rows: `cargo bench -p collabslam-benches`.
//!
//! A filter stays warm: one call after the other is timed on it, the world moves on in between, untimed. Births are
//! timed on copies. `compare.py` sets the update beside OpenBLAS.

use collabslam_benches::sway::{Mix, Sway};
use collabslam_benches::{dense::Dense, settings};
use criterion::{BatchSize, Criterion, criterion_group, criterion_main};
use ekf_core::settings::Value;
use ekf_core::validate::{BatchTest, Workspace};
use ekf_core::{CandidateOutcome, Filter, Measurements};
use std::hint::black_box;
use std::time::{Duration, Instant};

const SIZES: [usize; 5] = [25, 50, 100, 200, 400];

fn mix(features: usize, seen: usize, wrong: usize, depth: bool) -> Mix {
    Mix {
        features,
        seen,
        wrong,
        depth,
        at_once: 4,
    }
}

/// Times `work` on the next frame again and again.
fn each_frame(
    c: &mut Criterion,
    name: &str,
    sway: &mut Sway,
    mut work: impl FnMut(&mut Sway) -> Duration,
) {
    c.bench_function(name, |b| {
        b.iter_custom(|times| (0..times).map(|_| work(sway)).sum());
    });
}

fn timed<T>(work: impl FnOnce() -> T) -> Duration {
    let start = Instant::now();
    black_box(work());
    start.elapsed()
}

/// A step: predict, pixels of all features, update.
fn step(sway: &mut Sway) -> Duration {
    let t = sway.next_frame();
    let predict = timed(|| sway.filter.predict(t).expect("later stamp"));
    let pixels = timed(|| sway.filter.predict_pixels());
    let z = sway.measure();
    predict + pixels + timed(|| sway.filter.update(&z).expect("valid measurements"))
}

fn update(sway: &mut Sway) -> Duration {
    sway.predict();
    let z = sway.measure();
    timed(|| sway.filter.update(&z).expect("valid measurements"))
}

fn innovation(sway: &mut Sway) -> Duration {
    sway.predict();
    let z = sway.measure();
    let time = timed(|| {
        sway.filter
            .innovation(&z)
            .expect("valid measurements")
            .rows()
    });
    sway.filter.update(&z).expect("valid measurements");
    time
}

fn by_map_size(c: &mut Criterion) {
    for n in SIZES {
        let mut sway = Sway::new(mix(n, 20, 0, false), &[]);
        each_frame(c, &format!("predict/N={n}"), &mut sway, |sway| {
            let t = sway.next_frame();
            let time = timed(|| sway.filter.predict(t).expect("later stamp"));
            let z = sway.measure();
            sway.filter.update(&z).expect("valid measurements");
            time
        });
        each_frame(c, &format!("predict_pixels/N={n}"), &mut sway, |sway| {
            timed(|| sway.filter.predict_pixels())
        });
        births(c, n, &sway);
    }
}

fn births(c: &mut Criterion, n: usize, sway: &Sway) {
    let mut ahead = sway.clone();
    let pixels = ahead.pixels(4);
    let ids = ahead.filter.add_candidates(&pixels).expect("pixels");
    let born = |o: &CandidateOutcome| matches!(o, CandidateOutcome::Born(_));
    let seen = loop {
        ahead.predict();
        let z = ahead.measure();
        ahead.filter.update(&z).expect("valid measurements");
        let seen: Vec<_> = ids.iter().copied().zip(ahead.pixels(4)).collect();
        let outcomes = ahead.filter.clone().observe_candidates(&seen);
        if outcomes.expect("candidates").iter().all(born) {
            break seen;
        }
    };
    c.bench_function(&format!("birth, delayed, 4 at once/N={n}"), |b| {
        b.iter_batched_ref(
            || ahead.filter.clone(),
            |filter: &mut Filter| filter.observe_candidates(&seen).expect("candidates"),
            BatchSize::LargeInput,
        );
    });
    let changes = [("estimator.mode", Value::Name("collab".into()))];
    let mut sway = Sway::new(mix(n, 20, 0, false), &changes);
    sway.predict();
    let z = Measurements {
        views: vec![sway.worn(4)],
        ..Measurements::default()
    };
    c.bench_function(&format!("birth, instant, 4 at once/N={n}"), |b| {
        b.iter_batched_ref(
            || sway.filter.clone(),
            |filter: &mut Filter| filter.update(&z).expect("valid measurements"),
            BatchSize::LargeInput,
        );
    });
}

fn by_rows(c: &mut Criterion) {
    for n in SIZES {
        for m in [40, 80, 160] {
            if m / 2 > n {
                continue;
            }
            let mut sway = Sway::new(mix(n, m / 2, 0, false), &[("validate.test", none())]);
            each_frame(
                c,
                &format!("S and Cholesky/N={n} m={m}"),
                &mut sway,
                innovation,
            );
            each_frame(c, &format!("update/N={n} m={m}"), &mut sway, update);
            let mut sway = Sway::new(mix(n, m / 2, (m / 2).min(3), false), &[]);
            each_frame(c, &format!("step, 3 wrong/N={n} m={m}"), &mut sway, step);
        }
        if n >= 40 {
            let mut sway = Sway::new(mix(n, 40, 0, true), &[("validate.test", none())]);
            each_frame(
                c,
                &format!("update, a third with depth/N={n} 40 seen"),
                &mut sway,
                update,
            );
            let mut sway = Sway::new(mix(n, 40, 3, true), &[]);
            each_frame(
                c,
                &format!("step, 3 wrong, a third with depth/N={n} 40 seen"),
                &mut sway,
                step,
            );
        }
    }
    let mut dense = Dense::new(100, 80);
    c.bench_function("plain dense update/N=100 m=80", |b| {
        b.iter(|| dense.update())
    });
}

fn none() -> Value {
    Value::Name("none".into())
}

fn tests(c: &mut Criterion) {
    for (title, name) in [("HOHCT", "hohct"), ("JCBB", "jcbb")] {
        let mut options = settings(&[("validate.test", Value::Name(name.into()))]);
        if name == "jcbb" {
            // It strikes any bound where ten of 100 are wrong; HOHCT keeps its own.
            options.validate.max_nodes = 2000;
        }
        let test = BatchTest::chosen(&options.validate);
        for n in [40, 100] {
            for wrong in [0, 1, 3, 10] {
                let mut sway = Sway::new(mix(100, n, wrong, false), &[]);
                let mut workspace = Workspace::default();
                let run = |sway: &mut Sway| {
                    sway.predict();
                    let z = sway.measure();
                    let innovation = sway.filter.innovation(&z).expect("valid measurements");
                    let batch = innovation.as_batch();
                    let time = timed(|| test.run(&batch, &mut workspace));
                    sway.filter.update(&z).expect("valid measurements");
                    time
                };
                each_frame(c, &format!("{title}/{wrong} wrong of {n}"), &mut sway, run);
            }
        }
    }
}

/// Short: the figures that are compared come from `compare.py`.
fn short() -> Criterion {
    Criterion::default()
        .sample_size(10)
        .warm_up_time(Duration::from_millis(100))
        .measurement_time(Duration::from_millis(400))
}

criterion_group! {
    name = benches;
    config = short();
    targets = by_map_size, by_rows, tests
}
criterion_main!(benches);
