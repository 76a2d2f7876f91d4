//! Random inputs for the targets, seeded, without coverage.

use crate::{camera, filter, snapshot};
use rand::Rng;
use rand_pcg::Pcg64;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::time::Instant;

/// Targets, in turn: most inputs go to the filter.
const TURNS: [&str; 8] = [
    "filter", "filter", "filter", "camera", "filter", "filter", "snapshot", "camera",
];
/// Findings of a thread whose bytes are kept.
const MOST_KEPT: usize = 20;

/// What came of some inputs.
#[derive(Debug, Default)]
pub struct Tally {
    /// Calls made.
    pub calls: u64,
    /// Calls that returned an error.
    pub refused: u64,
    /// Time of the slowest input, milliseconds.
    pub slowest_ms: f64,
    /// The first of those that broke a promise: target, bytes in hexadecimal, and which.
    pub findings: Vec<String>,
    /// How many did.
    pub found: u64,
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

/// Runs one input; a panic is a broken promise too.
///
/// # Errors
/// The promise that was broken.
pub fn run(target: &str, bytes: &[u8]) -> Result<(u64, u64), String> {
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

/// So many inputs to the targets, spread over threads.
///
/// # Panics
/// If a thread cannot be started.
pub fn inputs(count: u64, seed: u64, threads: u64) -> Tally {
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
    tally
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
                if tally.findings.len() < MOST_KEPT {
                    let hex: String = bytes.iter().map(|b| format!("{b:02x}")).collect();
                    tally.findings.push(format!("{target} {hex}: {broken}"));
                }
            }
        }
        tally.slowest_ms = tally.slowest_ms.max(began.elapsed().as_secs_f64() * 1e3);
    }
    tally
}
