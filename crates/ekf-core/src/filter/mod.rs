//! The filter: what a frame loop calls, in the order of METHOD 7.
//!
//! ```text
//! predict(t) -> predict_pixels() -> [search, match outside] -> update(measurements)
//!            -> observe_candidates() -> manage_map() -> add_candidates() / add_undelayed()
//! ```
//!
//! [`Filter`] is one struct; each file beside this one holds the calls of one subject.

mod births;
mod candidate;
mod checkpoint;
mod checks;
mod conditional_prediction;
mod ekf;
mod free_start;
mod further_views;
mod handed;
mod handover;
mod kept_poses;
mod known_map;
mod landmarks;
mod map;
mod measurement;
mod measurements;
mod metric_births;
mod odometry;
mod odometry_image;
mod other_time;
mod pose_ring;
mod pose_then;
mod predicted_features;
mod prediction;
mod record;
mod relinearised;
mod relocalisation;
mod restart;
mod scale;
mod shutter;
pub mod snapshot;
mod snapshot_image;
mod sources;
mod submap;
mod turning;
mod undo;
mod update;
mod validation;
mod visibility;
mod wheels;
mod where_to_look;
mod working_set;
mod worn_clock;
mod worn_error;
mod worn_pose;

pub use candidate::CandidateOutcome;
pub use conditional_prediction::{ConditionalPrediction, ToldByFound};
pub use ekf::Filter;
pub use kept_poses::ViewTiming;
pub use known_map::KnownMap;
pub use landmarks::Landmark;
pub use measurements::{
    Bearing, Capture, DepthObservation, Measurements, Outcome, UpdateReport, WornObservation,
    WornPair, WornPose,
};
pub use predicted_features::PredictedFeature;
pub use submap::Submap;
