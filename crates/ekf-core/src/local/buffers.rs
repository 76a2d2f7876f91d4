//! Storage of before, and the product that works in it.

use crate::state::{Covariance, State};
use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};
use std::sync::Arc;

/// Storage of before, megabytes whose pages are mapped already. Every entry is written before it is read.
#[derive(Debug, Default)]
pub(crate) struct Buffers {
    pub(super) whole: Option<Covariance>,
    pub(super) working: Option<Covariance>,
    /// `R`, and that of a renewal.
    pub(super) r: Vec<f64>,
    pub(super) kept_r: Vec<f64>,
    pub(super) psi_r: Vec<f64>,
}

impl Clone for Buffers {
    /// Nothing is carried over: a copy starts empty.
    fn clone(&self) -> Self {
        Self::default()
    }
}

impl Buffers {
    /// Takes back the covariance of a working state that is not needed any more.
    pub(crate) fn take_working(&mut self, working: State) {
        self.working = Some(working.p);
    }

    pub(super) fn take_whole(&mut self, whole: Arc<State>) {
        if let Some(State { p, .. }) = Arc::into_inner(whole) {
            self.whole = Some(p);
        }
    }
}

pub(super) fn product(to: MatMut<'_, f64>, a: MatRef<'_, f64>, b: MatRef<'_, f64>) {
    matmul(to, Accum::Replace, a, b, 1.0, Par::Seq);
}
