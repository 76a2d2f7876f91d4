//! Observation models: what a feature looks like from the estimated camera, with analytic derivatives.

pub mod block;
pub mod feature;
pub mod point;
pub mod rows;
pub mod shutter;

pub use feature::{FEATURE_DIM, FeatureState};
pub(crate) use point::ATTITUDE;
pub use point::{POSE_DIM, PointInCamera};
pub use rows::Rows;
pub(crate) use rows::VelocityRows;
pub use shutter::{ByMotion, Shutter};
