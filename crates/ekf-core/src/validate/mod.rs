//! Validation of a batch of matches before the update (METHOD sections 7 and 8).
//!
//! A batch has `n` *blocks*, each a match that is accepted or rejected as a whole, with 1 to 3 rows (2 for a bearing,
//! 3 with depth). Its innovation `g` (`m` rows) has the covariance `S = H P H^T + R = L L^T`. Every test answers
//! with a [`Verdict`] and leaves the rejected blocks in the [`Workspace`]:
//!
//! - [`hohct`]: highest-order hypothesis compatibility, the fewest matches left out so that the rest is jointly compatible;
//! - [`jcbb`]: joint compatibility branch and bound, the most matches that are jointly compatible;
//! - [`one_point`]: 1-point RANSAC, made exhaustive;
//! - [`individual_gate`]: each match by itself;
//! - [`conditional_gate`]: each match given all the others.
//!
//! Matrices are column-major slices with leading dimension `ld`, of which only the lower triangle is read.
//! Buffers live in the workspace and only grow: a warm call allocates nothing. Every search is bounded by a number of
//! nodes and never by a clock, so equal input gives equal output on every machine.
//!
//! Slices whose sizes disagree are a fault of the caller and panic. The caller also checks the numbers.

mod batch;
mod choice;
mod conditional;
mod distance;
mod gate;
mod hohct;
mod jcbb;
mod one_point;
mod quantiles;
mod subsets;
mod workspace;

pub use batch::{Batch, Blocks, Verdict};
pub use choice::BatchTest;
pub use conditional::conditional_gate;
pub use gate::individual_gate;
pub(crate) use gate::reject_each;
pub(crate) use hohct::MAX_SHARE;
pub use hohct::{HohctSettings, hohct};
pub use jcbb::{JcbbSettings, jcbb};
pub use one_point::{OnePointSettings, one_point};
pub use workspace::Workspace;
