//! Buffers of a step.

use super::input::sources::Scratch;
use super::input::told_error::ToldError;
use crate::gauge::Gauge;
use crate::local::Buffers;
use crate::state::State;
use crate::{batch, validate};
use std::sync::OnceLock;

/// Buffers, which only grow, so that a warm step allocates nothing; nothing in them outlives a step.
#[derive(Debug, Default)]
pub(crate) struct Workspace {
    pub(crate) batch: batch::Workspace,
    pub(crate) test: validate::Workspace,
    pub(crate) gauge: Gauge,
    pub(crate) scratch: Scratch,
    /// Room for the next list of features that are followed.
    pub(crate) in_view: Vec<u64>,
    /// Room for the next working set.
    pub(crate) buffers: Buffers,
    /// The state before P was carried to where rows are taken.
    pub(crate) before: State,
    /// The whole state, if it was asked for since the last change.
    pub(crate) shown: OnceLock<Box<State>>,
    /// Where the view at hand is linearised, if not at the means.
    pub(crate) told: Option<ToldError>,
    /// While a camera that was lost is put somewhere: nothing tells its speed.
    pub(crate) found_again: bool,
}

impl Clone for Workspace {
    /// Nothing is carried over: a copy starts empty.
    fn clone(&self) -> Self {
        Self::default()
    }
}
