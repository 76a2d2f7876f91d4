//! Times single cases on request, so that another program can measure its own between them: machines that other
//! jobs share are only fair to what runs in turns.
//!
//! Each line of standard input names a case and how often to run it; the answer is a line of nanoseconds per run.
//! `record N FRAMES` answers with a replay instead: a line of numbers for each frame.

use collabslam_benches::sway::Mix;
use collabslam_benches::{Loop, Sway, dense::Dense};
use ekf_core::settings::Value;
use ekf_core::validate::{BatchTest, Workspace};
use ekf_core::{Filter, Measurements};
use std::collections::HashMap;
use std::hint::black_box;
use std::io::{BufRead, Write};
use std::time::Instant;

type Case = Box<dyn FnMut() -> Vec<u64>>;
/// Times and measurements.
type Frames = Vec<(f64, Measurements)>;

fn timed(work: impl FnOnce()) -> u64 {
    let start = Instant::now();
    work();
    start.elapsed().as_nanos() as u64
}

fn mix(features: usize, seen: usize, wrong: usize) -> Mix {
    Mix {
        features,
        seen,
        wrong,
        depth: false,
        at_once: 4,
    }
}

/// The update alone: nothing is wrong, nothing is tested.
fn update(features: usize, seen: usize, at_once: usize) -> Case {
    let changes = [("validate.test", Value::Name("none".into()))];
    let mix = Mix {
        at_once,
        ..mix(features, seen, 0)
    };
    let mut sway = Sway::new(mix, &changes);
    Box::new(move || {
        sway.predict();
        let z = sway.measure();
        let start = Instant::now();
        let report = sway.filter.update(&z).expect("valid measurements");
        black_box(report);
        vec![start.elapsed().as_nanos() as u64]
    })
}

/// Predict, pixels of all features, update with HOHCT.
fn step(features: usize, seen: usize, wrong: usize) -> Case {
    let mut sway = Sway::new(mix(features, seen, wrong), &[]);
    Box::new(move || {
        let t = sway.next_frame();
        let mut total = timed(|| sway.filter.predict(t).expect("later stamp"));
        total += timed(|| {
            black_box(sway.filter.predict_pixels());
        });
        let z = sway.measure();
        let start = Instant::now();
        let report = sway.filter.update(&z).expect("valid measurements");
        total += start.elapsed().as_nanos() as u64;
        vec![total, u64::from(report.exact)]
    })
}

/// HOHCT on the S of a frame of a filter with 100 features, with the budget of the default settings.
fn hohct(seen: usize, wrong: usize) -> Case {
    let mut sway = Sway::new(mix(100, seen, wrong), &[]);
    let mut workspace = Workspace::default();
    Box::new(move || {
        sway.predict();
        let z = sway.measure();
        let test = BatchTest::chosen(&sway.filter.settings().validate);
        let innovation = sway.filter.innovation(&z).expect("valid measurements");
        let batch = innovation.as_batch();
        let start = Instant::now();
        let verdict = test.run(&batch, &mut workspace);
        let time = start.elapsed().as_nanos() as u64;
        sway.filter.update(&z).expect("valid measurements");
        vec![time, verdict.nodes as u64, u64::from(verdict.exact)]
    })
}

fn dense(features: usize, rows: usize) -> Case {
    let mut dense = Dense::new(features, rows);
    Box::new(move || vec![timed(|| dense.update())])
}

/// A walk through a map of `features`, the plain filter and the one with a working set by turns: both times, and how many
/// features were measured.
fn local(features: usize) -> Case {
    let mut corridor = Loop::new(features);
    let local = corridor.clone().start(&[LOCAL]);
    let mut filters = [corridor.start(&[PLAIN]), local];
    let mut dt = 0.1;
    while !corridor.closed() {
        frame(&mut corridor, &mut filters, dt);
    }
    dt = 1.0 / 30.0;
    Box::new(move || frame(&mut corridor, &mut filters, dt))
}

/// A walk through a map of `features` with a working set alone: the times of a whole frame and of its parts (prediction, pixels
/// expected, update, upkeep of the map), and how many features were measured.
fn walk(features: usize) -> Case {
    let mut corridor = Loop::new(features);
    let mut filter = corridor.start(&[LOCAL]);
    let mut dt = 0.1;
    let mut one = move |dt: f64| {
        let t = corridor.walk(dt);
        let z = corridor.measure();
        let predict = timed(|| filter.predict(t).expect("later stamp"));
        let pixels = timed(|| {
            black_box(filter.predict_pixels());
        });
        let start = Instant::now();
        let report = filter.update(&z).expect("valid measurements");
        let update = start.elapsed().as_nanos() as u64;
        let start = Instant::now();
        let gone = filter.manage_map(&[]);
        let upkeep = start.elapsed().as_nanos() as u64;
        corridor.learn(&report, &z);
        corridor.forget(&gone);
        let parts = [predict, pixels, update, upkeep];
        let whole = parts.iter().sum();
        let times = [whole].into_iter().chain(parts);
        let seen = z.bearings.len() as u64;
        (times.chain([seen]).collect(), corridor.closed())
    };
    while !one(dt).1 {}
    dt = 1.0 / 30.0;
    Box::new(move || one(dt).0)
}

const PLAIN: (&str, Value) = ("map.local_from", Value::Int(1_000_000_000));
const LOCAL: (&str, Value) = ("map.local_from", Value::Int(0));

fn frame(corridor: &mut Loop, filters: &mut [Filter; 2], dt: f64) -> Vec<u64> {
    let t = corridor.walk(dt);
    let z = corridor.measure();
    let times = filters.each_mut().map(|filter| {
        let start = Instant::now();
        filter.predict(t).expect("later stamp");
        black_box(filter.predict_pixels());
        let report = filter.update(&z).expect("valid measurements");
        let time = start.elapsed().as_nanos() as u64;
        corridor.learn(&report, &z);
        time
    });
    vec![times[0], times[1], z.bearings.len() as u64]
}

/// A replay: frames with births, then `number` frames without.
fn frames(features: usize, number: usize) -> (Frames, Frames) {
    let (mut sway, births) = Sway::begin(mix(features, 40.min(features), 0), &[]);
    let frames = (0..number).map(|_| {
        sway.predict();
        let z = sway.measure();
        sway.filter.update(&z).expect("valid measurements");
        (sway.time(), z)
    });
    let frames = frames.collect();
    (births, frames)
}

/// The frames as text: `t;u,v,depth,sigma;...;id,u,v;...`, births before matches.
fn record(features: usize, number: usize) -> Vec<String> {
    let line = |(t, z): &(f64, Measurements)| {
        let births = z.depths.iter();
        let births = births.map(|d| format!("{},{},{},{}", d.uv.x, d.uv.y, d.depth, d.sigma));
        let seen = z.bearings.iter();
        let seen = seen.map(|b| format!("{},{},{}", b.id, b.uv.x, b.uv.y));
        let parts: Vec<String> = births.chain(seen).collect();
        format!("{t};{}", parts.join(";"))
    };
    let (births, frames) = frames(features, number);
    births.iter().chain(&frames).map(line).collect()
}

/// One frame of that replay after the other, from the start again when it ends.
fn replay(features: usize, number: usize) -> Case {
    let (_, frames) = frames(features, number);
    let start = Sway::begin(mix(features, 1, 0), &[]).0.filter;
    let (mut filter, mut next) = (start.clone(), 0);
    Box::new(move || {
        if next == frames.len() {
            (filter, next) = (start.clone(), 0);
        }
        let (t, z) = &frames[next];
        next += 1;
        vec![timed(|| {
            filter.predict(*t).expect("later stamp");
            black_box(filter.predict_pixels());
            filter.update(z).expect("valid measurements");
        })]
    })
}

fn make(words: &[&str]) -> Case {
    let number = |i: usize| words[i].parse::<usize>().expect("a whole number");
    match words[0] {
        "update" => update(number(1), number(2), 4),
        "update-single" => update(number(1), number(2), 1),
        "step" => step(number(1), number(2), number(3)),
        "hohct" => hohct(number(1), number(2)),
        "dense" => dense(number(1), number(2)),
        "local" => local(number(1)),
        "walk" => walk(number(1)),
        "replay" => replay(number(1), number(2)),
        other => panic!("there is no case {other}"),
    }
}

fn main() {
    let mut cases: HashMap<String, Case> = HashMap::new();
    let mut out = std::io::stdout().lock();
    for line in std::io::stdin().lock().lines() {
        let line = line.expect("text");
        let words: Vec<&str> = line.split_whitespace().collect();
        let (Some(times), case) = (words.last(), &words[..words.len() - 1]) else {
            continue;
        };
        let answer: Vec<String> = if words[0] == "record" {
            record(
                words[1].parse().expect("N"),
                words[2].parse().expect("FRAMES"),
            )
        } else {
            let run = cases.entry(case.join(" ")).or_insert_with(|| make(case));
            (0..times.parse().expect("how often"))
                .map(|_| {
                    run()
                        .iter()
                        .map(u64::to_string)
                        .collect::<Vec<_>>()
                        .join(",")
                })
                .collect()
        };
        writeln!(out, "{}", answer.join("|"))
            .and_then(|()| out.flush())
            .expect("a reader");
    }
}
