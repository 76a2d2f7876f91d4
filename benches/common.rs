//! Benchmarks of the filter core live beside this file; run them with `cargo bench -p collabslam-benches`.
