//! What one frame hands in, and what an update reports about it.

pub(super) mod measurements;
pub(super) mod sources;
pub(super) mod told_error;
