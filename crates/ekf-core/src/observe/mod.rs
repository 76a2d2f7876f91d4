//! Observation models: what a feature looks like from the estimated camera, with analytic derivatives.

pub mod point;
pub mod rows;

pub use point::{FeatureState, PointInCamera};
pub use rows::{Rows, WornView};
