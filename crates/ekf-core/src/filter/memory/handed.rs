//! What a filter remembers of the views that its map was handed on in (METHOD 20).

use crate::misfit::Misfit;
use crate::observe::point::CameraPose;

/// Where the map was last handed on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Handed {
    /// Landmarks born before this id were there.
    pub(crate) until: u64,
    pub(crate) pose: CameraPose,
    /// Of the updates until then.
    pub(crate) misfit: Misfit,
}

/// What has been handed on so far.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Handover {
    /// `None` before the first frame after a start.
    pub(crate) last: Option<Handed>,
    /// Landmarks before this id are a known map's: they are where W is.
    pub(crate) known: u64,
}
