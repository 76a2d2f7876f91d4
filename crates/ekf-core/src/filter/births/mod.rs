//! How features come into the map: by parallax, by a depth, by several views of a start (METHOD 5, 10).

pub(super) mod free_start;
pub(super) mod metric;
pub(super) mod parallax;
pub(super) mod vague;
