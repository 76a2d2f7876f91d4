//! Birth of features (METHOD 5): one two-view geometry for the delayed and the instant case, undelayed births,
//! and births from points of known depth.

pub mod at_rest;
pub mod held;
pub mod new_feature;
pub(crate) mod several_views;
pub mod two_view;

pub use new_feature::NewFeature;
pub use two_view::TwoView;
