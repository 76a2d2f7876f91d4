//! Who is in an engine.  In Rust, because Ctrl-C comes between any two lines of Python, also between taking a
//! lock and noting that it is taken.

use crate::errors::named;
use pyo3::prelude::*;
use pyo3::types::PyTuple;
use std::sync::atomic::{AtomicBool, Ordering};

/// One at a time, and nobody waits: whoever comes second is told so.
///
/// Used as a context manager.
///
/// Raises
/// ------
/// BusyError
///     On entering, if somebody is inside, another thread or a call further up in the same one.
#[pyclass(frozen, module = "collabslam._core")]
#[derive(Default)]
pub(crate) struct Turn(AtomicBool);

#[pymethods]
impl Turn {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    fn __enter__(&self) -> PyResult<()> {
        if self.0.swap(true, Ordering::AcqRel) {
            return Err(named(
                "BusyError",
                "The engine is at work in another thread; give each thread its own Slam, or let them take \
                 turns (threading.Lock)."
                    .into(),
            ));
        }
        Ok(())
    }

    #[pyo3(signature = (*_error))]
    fn __exit__(&self, _error: &Bound<'_, PyTuple>) {
        self.0.store(false, Ordering::Release);
    }
}
