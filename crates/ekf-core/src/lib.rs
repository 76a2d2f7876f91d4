//! An Extended Kalman Filter for collaborative monocular SLAM: a robot's camera Cs maps, a worn camera Cf of
//! uncertain pose lends depth whenever both look at the same place.
//!
//! | thing | convention |
//! |---|---|
//! | units | metre, second, radian, pixel; all arithmetic f64 |
//! | frames | W = Cs's optical frame at the start; C = Cs; F = Cf; axes x right, y down, z forward |
//! | poses | `T_WC` maps points of C into W; `T_CF` maps points of F into C |
//! | quaternions | Hamilton, scalar first `(w, x, y, z)` |
//! | tangent | `T = T_hat Exp(xi)`, `xi = (translation, rotation)`, on the right |
//! | state | `[r(3) q(4) v(3) w(3) | blocks]`, see [`state`] |
//! | feature | `[p(3) theta phi rho]`, point `p + m(theta, phi) / rho` |
//!
//! Nothing here prints, reads a clock or a file, or keeps global state: the same calls give the same bits.

#![forbid(unsafe_code)]

pub mod batch;
pub mod birth;
pub mod camera;
pub mod chi2;
pub mod error;
pub mod filter;
pub mod gauge;
pub mod graph;
mod guard;
mod gyroscope;
mod imu;
mod kernel;
mod local;
mod map_frame;
pub mod math;
mod nis_accumulator;
pub mod observe;
mod odometry;
pub mod overlap;
pub mod performance;
pub mod predict;
mod scale;
pub mod settings;
mod stamps;
pub mod state;
pub mod submap_pnp;
pub mod validate;
pub mod view_planning;

pub use camera::{Camera, Distortion};
pub use error::EkfError;
pub use filter::{
    Bearing, CandidateOutcome, Capture, ConditionalPrediction, ConditioningSet, DepthObservation,
    FEWEST_MATCHES, Filter, Followed, KnownMap, Landmark, MAX_RANGE_RATIO, MOST_KEPT_POSES,
    MeasurementOutcome, Measurements, PredictedFeature, Submap, TOLD_INFORMATION, UNKNOWN_SPEED,
    UNKNOWN_TURN, UpdateReport, ViewTiming, WornObservation, WornPair, WornPose,
};
pub use guard::LARGEST_PIXEL;
pub use imu::{FASTEST_RATE, GYRO_GAP};
pub use odometry::ODOMETRY_GAP;
pub use settings::Settings;
pub use stamps::{LAST_TIME, LONGEST_GAP};
