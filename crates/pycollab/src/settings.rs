//! Settings across the border: the schema as JSON, values as a flat dictionary.

use crate::errors::to_python;
use ekf_core::EkfError;
use ekf_core::settings::{self, Settings, Value};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString};

/// Every filter setting as a list of dictionaries with the keys `key`, `type`, `default`, `min`, `max`, `unit`,
/// `choices` and `doc`.
#[pyfunction]
pub(crate) fn settings_schema(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let list = PyList::empty(py);
    for info in settings::schema() {
        let entry = PyDict::new(py);
        entry.set_item("key", info.key)?;
        entry.set_item("type", info.kind)?;
        match info.default {
            Value::Float(x) => entry.set_item("default", x)?,
            Value::Int(i) => entry.set_item("default", i)?,
            Value::Bool(b) => entry.set_item("default", b)?,
            Value::Name(s) => entry.set_item("default", s)?,
        }
        entry.set_item("min", info.min)?;
        entry.set_item("max", info.max)?;
        entry.set_item("unit", info.unit)?;
        let choices = (!info.choices.is_empty()).then(|| info.choices.to_vec());
        entry.set_item("choices", choices)?;
        entry.set_item("doc", info.doc)?;
        list.append(entry)?;
    }
    Ok(list)
}

/// Settings from a flat dictionary over the defaults.
pub(crate) fn from_dict(values: Option<&Bound<'_, PyDict>>) -> PyResult<Settings> {
    let mut settings = Settings::default();
    let Some(values) = values else {
        return Ok(settings);
    };
    for (key, value) in values.iter() {
        let key: String = key.extract()?;
        let value = if value.is_instance_of::<PyBool>() {
            Value::Bool(value.extract()?)
        } else if value.is_instance_of::<PyInt>() {
            Value::Int(value.extract()?)
        } else if value.is_instance_of::<PyFloat>() {
            Value::Float(value.extract()?)
        } else if value.is_instance_of::<PyString>() {
            Value::Name(value.extract()?)
        } else {
            return Err(to_python(EkfError::InvalidSetting {
                key,
                why: "a number, a switch or a name is needed".into(),
            }));
        };
        settings.set(&key, &value).map_err(to_python)?;
    }
    Ok(settings)
}
