//! Tests of `ekf_core` from outside: one binary, in the folders of the crate.

#![allow(clippy::unwrap_used, reason = "a test may panic")]
#![allow(clippy::print_stdout, reason = "a test may show its figures")]
#![allow(clippy::needless_range_loop, reason = "indices stand for units")]

mod birth {
    mod at_rest;
}
mod camera;
pub(crate) mod filter {
    mod births {
        mod first_view;
        mod free_start;
        mod parallax;
        mod vague;
    }
    pub(crate) mod map {
        pub(crate) mod map_drift;
        mod relocalisation;
        mod restart;
        mod submap;
        mod submaps_of_persons;
        mod upkeep;
    }
    mod memory {
        mod undo;
    }
    mod persist {
        mod snapshot;
    }
    mod predict {
        mod conditional;
        mod imu;
        mod odometry;
        mod shutter;
        mod turning;
        mod unseen;
    }
    pub(crate) mod update;
    mod worn {
        mod bias;
        mod clock;
        mod late_views;
        mod length;
        mod persons;
        mod roll;
    }
}
mod gauge;
mod graph;
mod guard;
mod layers;
mod local;
mod long_run;
mod math {
    mod pose;
}
mod observe;
mod overlap;
mod properties;
mod reference;
mod scale;
mod scene;
mod state {
    mod error_modes;
    mod time_correlated;
}
mod submap_pnp;
mod threads;
mod validate;
mod view_planning;
