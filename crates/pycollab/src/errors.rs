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

/// The class `name` of `collabslam.errors` with a message.
pub(crate) fn named(name: &'static str, message: String) -> PyErr {
    Python::attach(|py| match class(py, name) {
        Ok(class) => PyErr::from_type(class, message),
        Err(import) => {
            let fallback = PyRuntimeError::new_err(message);
            fallback.set_cause(py, Some(import));
            fallback
        }
    })
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
        | EkfError::StaleView { .. }
        | EkfError::FutureView { .. }
        | EkfError::RepeatedView { .. }
        | EkfError::UnknownFeature { .. } => "InputError",
    };
    named(name, error.to_string())
}

/// An `InputError` about an argument's value.
pub(crate) fn invalid(what: &'static str, why: impl Into<String>) -> PyErr {
    let why = why.into();
    to_python(EkfError::InvalidInput { what, why })
}

/// An `InputError` about an argument's shape.
pub(crate) fn bad_shape(what: &'static str, expected: &str, got: &[usize]) -> PyErr {
    to_python(EkfError::BadShape {
        what,
        expected: expected.into(),
        got: format!("{got:?}"),
    })
}
