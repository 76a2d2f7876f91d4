//! A checkpoint of the filter in memory, and the filter as bytes.

pub(super) mod checkpoint;
pub(super) mod image;
pub mod snapshot;
