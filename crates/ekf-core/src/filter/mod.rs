//! The filter: what a frame loop calls, in the order of METHOD 7.
//!
//! ```text
//! predict(t) -> predict_pixels() -> [search, match outside] -> update(measurements)
//!            -> observe_candidates() -> manage_map() -> add_candidates() / add_undelayed()
//! ```
//!
//! [`Filter`] is three values: what never changes (`setup`), what it remembers (`memory`), and buffers (`workspace`). Each
//! folder beside this file holds the calls of one subject.

mod births;
mod checks;
mod ekf;
mod input;
mod map;
mod memory;
mod persist;
mod predict;
mod setup;
mod update;
mod workspace;
mod worn;

pub use ekf::Filter;
pub use input::measurements::{
    Bearing, Capture, DepthObservation, Followed, MeasurementOutcome, Measurements, UpdateReport,
    WornObservation, WornPair, WornPose,
};
pub use map::known_map::KnownMap;
pub use map::landmarks::Landmark;
pub use map::relocalisation::FEWEST_MATCHES;
pub use map::submap::{MAX_RANGE_RATIO, Submap};
pub use memory::candidate::CandidateOutcome;
pub use memory::pose_ring::MOST_KEPT_POSES;
pub use persist::snapshot;
pub use predict::conditional::{ConditionalPrediction, ConditioningSet};
pub use predict::features::PredictedFeature;
pub use worn::clock::TOLD_INFORMATION;
pub use worn::kept_poses::ViewTiming;
pub use worn::other_time::{UNKNOWN_SPEED, UNKNOWN_TURN};
