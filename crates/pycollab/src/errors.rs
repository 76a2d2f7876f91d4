//! The one table from core errors to Python exceptions.

use ekf_core::EkfError;
use pyo3::exceptions::PyRuntimeError;
use pyo3::prelude::*;
use pyo3::sync::PyOnceLock;
use pyo3::types::PyType;

fn class<'py>(py: Python<'py>, name: &'static str) -> PyResult<Bound<'py, PyType>> {
    static ERRORS: PyOnceLock<Py<PyModule>> = PyOnceLock::new();
    let module = ERRORS.get_or_try_init(py, || {
        PyModule::import(py, "collabslam.errors").map(Bound::unbind)
    })?;
    Ok(module.bind(py).getattr(name)?.cast_into::<PyType>()?)
}

/// The Python exception of a core error.
pub(crate) fn to_python(error: EkfError) -> PyErr {
    let name = match &error {
        EkfError::InvalidSetting { .. } => "SettingsError",
        EkfError::NotPositiveDefinite { .. } | EkfError::Unsound { .. } => "FilterError",
        EkfError::BadSnapshot { .. } => "DataError",
        EkfError::BadShape { .. }
        | EkfError::NonFinite { .. }
        | EkfError::InvalidInput { .. }
        | EkfError::BadTime { .. }
        | EkfError::LongGap { .. }
        | EkfError::UnknownFeature { .. } => "InputError",
    };
    Python::attach(|py| match class(py, name) {
        Ok(class) => PyErr::from_type(class, error.to_string()),
        Err(import) => {
            let fallback = PyRuntimeError::new_err(error.to_string());
            fallback.set_cause(py, Some(import));
            fallback
        }
    })
}

/// An `InputError` about an argument's shape.
pub(crate) fn bad_shape(what: &'static str, expected: &str, got: &[usize]) -> PyErr {
    to_python(EkfError::BadShape {
        what,
        expected: expected.into(),
        got: format!("{got:?}"),
    })
}
