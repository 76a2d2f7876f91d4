//! Random inputs at a high rate, without coverage, and long runs: figures as one line of JSON.
//!
//! ```text
//! fuzz inputs <count> <seed> [threads]   inputs to the targets; what breaks a promise is printed with its bytes
//! fuzz input <target> <hex>              one input again
//! fuzz endure <steps> <seed>             one long run, then two filters in two threads, then 100 of them one by one
//! ```

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "a program speaks to its user"
)]

use collabslam_fuzz::{camera, endurance, filter, snapshot};
use rand::Rng;
use rand_pcg::Pcg64;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;
use std::time::Instant;

/// Targets, in turn: most inputs go to the filter.
const TURNS: [&str; 8] = [
    "filter", "filter", "filter", "camera", "filter", "filter", "snapshot", "camera",
];
/// Findings that are printed.
const MOST_PRINTED: usize = 20;

fn main() -> ExitCode {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    let number = |text: &str| text.parse::<u64>().ok();
    let done = match words.as_slice() {
        ["inputs", count, seed] => number(count)
            .zip(number(seed))
            .map(|(n, s)| inputs(n, s, 1)),
        ["inputs", count, seed, threads] => {
            let numbers = number(count).zip(number(seed)).zip(number(threads));
            numbers.map(|((n, s), k)| inputs(n, s, k.clamp(1, 256)))
        }
        ["input", target, hex] => bytes_of(hex).map(|bytes| again(target, &bytes)),
        ["endure", steps, seed] => number(steps).zip(number(seed)).map(|(n, s)| endure(n, s)),
        _ => None,
    };
    match done {
        Some(true) => ExitCode::SUCCESS,
        Some(false) => ExitCode::from(1),
        None => {
            eprintln!(
                "usage: fuzz inputs COUNT SEED [THREADS] | fuzz input TARGET HEX | fuzz endure STEPS SEED"
            );
            ExitCode::from(2)
        }
    }
}

#[derive(Default)]
struct Tally {
    calls: u64,
    refused: u64,
    slowest_ms: f64,
    findings: Vec<String>,
    found: u64,
}

impl Tally {
    fn add(&mut self, other: Self) {
        self.calls += other.calls;
        self.refused += other.refused;
        self.slowest_ms = self.slowest_ms.max(other.slowest_ms);
        self.findings.extend(other.findings);
        self.found += other.found;
    }
}

fn run(target: &str, bytes: &[u8]) -> Result<(u64, u64), String> {
    let done = catch_unwind(AssertUnwindSafe(|| match target {
        "filter" => filter(bytes).map(|calls| (calls.made, calls.refused)),
        "snapshot" => snapshot(bytes).map(|()| (1, 0)),
        _ => camera(bytes).map(|()| (1, 0)),
    }));
    done.unwrap_or_else(|panic| {
        let text = panic.downcast_ref::<String>().cloned();
        let text = text.or_else(|| panic.downcast_ref::<&str>().map(ToString::to_string));
        Err(format!("panic: {}", text.unwrap_or_default()))
    })
}

fn inputs(count: u64, seed: u64, threads: u64) -> bool {
    std::panic::set_hook(Box::new(|_| {}));
    let began = Instant::now();
    let mut tally = Tally::default();
    let workers: Vec<_> = (0..threads)
        .map(|k| {
            let share = count / threads + u64::from(k < count % threads);
            std::thread::spawn(move || some_inputs(share, seed, k))
        })
        .collect();
    for worker in workers {
        tally.add(worker.join().expect("a worker catches every panic"));
    }
    for finding in tally.findings.iter().take(MOST_PRINTED) {
        eprintln!("{finding}");
    }
    println!(
        "{{\"executions\": {count}, \"calls\": {}, \"refused\": {}, \"findings\": {}, \"slowest_ms\": {:.3}, \"seconds\": {:.1}}}",
        tally.calls,
        tally.refused,
        tally.found,
        tally.slowest_ms,
        began.elapsed().as_secs_f64()
    );
    tally.found == 0
}

fn some_inputs(count: u64, seed: u64, thread: u64) -> Tally {
    let mut rng = Pcg64::new(u128::from(seed), u128::from(thread));
    let mut tally = Tally::default();
    let mut bytes = Vec::with_capacity(256);
    for k in 0..count {
        let target = TURNS[(k % TURNS.len() as u64) as usize];
        let length = if target == "camera" {
            48
        } else {
            rng.random_range(16..160)
        };
        bytes.resize(length, 0);
        rng.fill(bytes.as_mut_slice());
        let began = Instant::now();
        match run(target, &bytes) {
            Ok((made, refused)) => {
                tally.calls += made;
                tally.refused += refused;
            }
            Err(broken) => {
                tally.found += 1;
                if tally.findings.len() < MOST_PRINTED {
                    let hex: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
                    tally.findings.push(format!("{target} {hex}: {broken}"));
                }
            }
        }
        tally.slowest_ms = tally.slowest_ms.max(began.elapsed().as_secs_f64() * 1e3);
    }
    tally
}

fn again(target: &str, bytes: &[u8]) -> bool {
    let done = run(target, bytes);
    println!("{done:?}");
    done.is_ok()
}

fn bytes_of(hex: &str) -> Option<Vec<u8>> {
    let pairs = (0..hex.len()).step_by(2);
    pairs
        .map(|i| u8::from_str_radix(hex.get(i..i + 2)?, 16).ok())
        .collect()
}

fn endure(steps: u64, seed: u64) -> bool {
    let steps = steps as usize;
    let long = endurance::endure(steps, seed);
    // Two at once do what each does alone.
    let short = (steps / 20).max(10);
    let alone = endurance::endure(short, seed + 1).map(|e| e.fingerprint);
    let both: Vec<_> = (0..2)
        .map(|_| {
            std::thread::spawn(move || endurance::endure(short, seed + 1).map(|e| e.fingerprint))
        })
        .collect();
    let equal = both
        .into_iter()
        .all(|t| t.join().is_ok_and(|f| f == alone && f.is_ok()));
    let some = |n: usize| (0..n).all(|k| endurance::endure(50, k as u64).is_ok());
    let first = some(10);
    let before = endurance::resident_mb();
    let hundred = first && some(100);
    let grown = endurance::resident_mb() - before;
    match long {
        Ok(e) => {
            println!(
                "{{\"steps\": {}, \"born\": {}, \"memory_growth_mb\": {:.3}, \"step_time_ratio\": {:.3}, \"largest_error_m\": {:.3}, \"threads_equal\": {equal}, \"filters_dropped\": 100, \"dropped_growth_mb\": {grown:.3}}}",
                e.steps,
                e.born,
                e.memory_mb[1] - e.memory_mb[0],
                e.step_us[1] / e.step_us[0],
                e.largest_error_m
            );
            equal && hundred
        }
        Err(broken) => {
            eprintln!("endurance: {broken}");
            false
        }
    }
}
