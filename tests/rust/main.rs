//! Tests of `ekf_core` from outside: one binary, one module per subject.

#![allow(clippy::unwrap_used, reason = "a test may panic")]
#![allow(clippy::print_stdout, reason = "a test may show its figures")]
#![allow(clippy::needless_range_loop, reason = "indices stand for units")]

mod at_rest;
mod births;
mod cameras;
mod conditional_prediction;
mod error_modes;
mod free_start;
mod gauge;
mod graph;
mod guards;
mod gyro;
mod jacobians;
mod lasting_errors;
mod late_views;
mod layers;
mod local;
mod long_run;
mod map;
mod map_drift;
mod odometry;
mod overlap;
mod persons;
mod poses;
mod properties;
mod reference;
mod relocalise;
mod restart;
mod scale;
mod scene;
mod shutter;
mod snapshot;
mod submap_pnp;
mod submaps;
mod submaps_of_persons;
mod threads;
mod turning;
mod undo;
mod update;
mod validate;
mod view_planning;
mod worn_bias;
mod worn_clock;
mod worn_roll;
