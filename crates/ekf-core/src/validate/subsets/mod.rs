//! HOHCT's search for the smallest set whose leaving out makes the rest jointly compatible: the page of
//! [`hohct`](crate::validate::hohct) says how.

mod best_set;
mod greedy;
mod level;
pub(super) mod pigeonhole;
pub(super) mod scratch;
pub(super) mod search;
mod thresholds;
