//! What fuzzing does with the core: strings of bytes become calls, and after each call the promises are checked.
//!
//! The same targets serve libFuzzer (`fuzz_targets`), the seeded driver without coverage (`fuzz`, which counts
//! executions) and, with few inputs, the tests.

mod bytes;
mod camera;
pub mod drive;
pub mod endurance;
mod filter;
mod snapshot;
mod sound;

pub use camera::camera;
pub use filter::{Calls, filter};
pub use snapshot::snapshot;
pub use sound::check_filter;

/// Which promise was broken, and by which call.
pub type Broken = String;
