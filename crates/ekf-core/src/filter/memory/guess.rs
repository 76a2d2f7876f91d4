//! A feature whose depth was a guess when it was born.

use serde::{Deserialize, Serialize};

/// A guess as it was made.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct Guess {
    /// The feature.
    pub(crate) id: u64,
    /// Inverse depth, 1/m.
    pub(crate) rho: f64,
    /// Its standard deviation, 1/m.
    pub(crate) sd: f64,
}
