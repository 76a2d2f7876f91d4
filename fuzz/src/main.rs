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

use collabslam_fuzz::{drive, endurance};
use std::process::ExitCode;
use std::time::Instant;

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

fn inputs(count: u64, seed: u64, threads: u64) -> bool {
    std::panic::set_hook(Box::new(|_| {}));
    let began = Instant::now();
    let tally = drive::inputs(count, seed, threads);
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

fn again(target: &str, bytes: &[u8]) -> bool {
    let done = drive::run(target, bytes);
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
