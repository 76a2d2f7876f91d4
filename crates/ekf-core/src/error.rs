//! The crate's one error type. Ordinary outcomes (a feature out of view, a rejected match) are values, not errors.

use thiserror::Error;

/// Everything that can be wrong with a call. A call that fails leaves the filter as it was.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum EkfError {
    /// An array has the wrong shape.
    #[error("{what} has shape {got}, expected {expected}")]
    BadShape {
        /// The argument.
        what: &'static str,
        /// The shape it should have.
        expected: String,
        /// The shape it has.
        got: String,
    },
    /// A value is NaN or infinite.
    #[error("{what} has a value that is NaN or infinite; leave such a measurement out")]
    NonFinite {
        /// The argument.
        what: &'static str,
    },
    /// A value is finite but makes no sense.
    #[error("{what}: {why}")]
    InvalidInput {
        /// The argument.
        what: &'static str,
        /// What is wrong and how to fix it.
        why: String,
    },
    /// A matrix that should be positive definite is not.
    #[error("{stage}: the matrix is not positive definite (pivot {pivot})")]
    NotPositiveDefinite {
        /// The computation that needed it.
        stage: &'static str,
        /// The row at which the factorisation failed.
        pivot: usize,
    },
    /// A measurement that would break the filter, or a filter that is broken.
    #[error("the filter would not be sound: {why}")]
    Unsound {
        /// What is wrong.
        why: String,
    },
    /// Bytes that are not a snapshot of a filter.
    #[error("the snapshot cannot be used: {why}")]
    BadSnapshot {
        /// What is wrong with it.
        why: String,
    },
    /// A time stamp does not follow its predecessor.
    #[error("time {t} s does not follow the last one, {last} s; time stamps must increase")]
    BadTime {
        /// The offending stamp, seconds.
        t: f64,
        /// The stamp before it, seconds.
        last: f64,
    },
    /// A time stamp is so far from its predecessor that no motion model bridges the gap.
    #[error(
        "time {t} s is {} s after the last one; give stamps in seconds, or start a new filter after such a gap",
        t - last
    )]
    LongGap {
        /// The offending stamp, seconds.
        t: f64,
        /// The stamp before it, seconds.
        last: f64,
    },
    /// A view of Cf that is older than the poses that are kept.
    #[error(
        "the worn view of {t} s is stale: poses are kept from {oldest} s on; send views sooner, or raise worn.late"
    )]
    StaleView {
        /// When it was taken, seconds.
        t: f64,
        /// Time of the oldest pose, seconds.
        oldest: f64,
    },
    /// A view of Cf that was taken after the present frame.
    #[error(
        "the worn view of {t} s lies in the future of the frame at {now} s; give it with a later frame, and check that \
         both cameras use one clock"
    )]
    FutureView {
        /// When it was taken, seconds.
        t: f64,
        /// Time of the frame, seconds.
        now: f64,
    },
    /// A view of Cf that was measured before.
    #[error("the worn view of {t} s was measured before; give each view once")]
    RepeatedView {
        /// When it was taken, seconds.
        t: f64,
    },
    /// An id that is not in the map.
    #[error("there is no feature or candidate with id {id}")]
    UnknownFeature {
        /// The id.
        id: u64,
    },
    /// A setting has an impossible value.
    #[error("setting {key}: {why}")]
    InvalidSetting {
        /// The dotted key.
        key: String,
        /// What is wrong and how to fix it.
        why: String,
    },
}

impl EkfError {
    /// A snapshot that cannot be used.
    pub(crate) fn bad_snapshot(why: impl Into<String>) -> Self {
        Self::BadSnapshot { why: why.into() }
    }
}
