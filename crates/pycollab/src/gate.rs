//! The one way from Python into the core: Python runs on meanwhile, and the core's errors become exceptions.

use crate::errors::to_python;
use ekf_core::EkfError;
use pyo3::prelude::*;

/// Does `work` without holding up Python's other threads.
pub(crate) fn enter<T: Send>(
    py: Python<'_>,
    work: impl FnOnce() -> Result<T, EkfError> + Send,
) -> PyResult<T> {
    py.detach(work).map_err(to_python)
}

/// As [`enter`], for work that cannot fail.
pub(crate) fn compute<T: Send>(py: Python<'_>, work: impl FnOnce() -> T + Send) -> T {
    py.detach(work)
}
