//! Inner loops of the front end: the binding of the crate `frontend`, a file for each of its modules.

pub(crate) mod consensus;
pub(crate) mod corners;
pub(crate) mod describe;
pub(crate) mod pairs;
pub(crate) mod patch;
pub(crate) mod search;
pub(crate) mod warp;
