//! Tests of `ekf_core` from outside: one binary, one module per subject.

#![allow(clippy::unwrap_used, reason = "a test may panic")]

mod births;
mod cameras;
mod jacobians;
mod long_run;
mod overlap;
mod scene;
mod update;
mod validate;
