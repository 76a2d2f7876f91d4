//! Settings across the border: the schema as a list of dictionaries, values as flat dictionaries.

use crate::errors::to_python;
use ekf_core::EkfError;
use ekf_core::settings::{self, Audience, Settings, Value};
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyString};

/// Every filter setting as a list of dictionaries with the keys `key`, `type`, `default`, `min`, `max`,
/// `unit`, `choices`, `doc` and `when`: the case in which to change it, None for a switch of the lab.
#[pyfunction]
pub(crate) fn settings_schema(py: Python<'_>) -> PyResult<Bound<'_, PyList>> {
    let list = PyList::empty(py);
    for info in settings::schema() {
        let setting = PyDict::new(py);
        setting.set_item("key", info.key)?;
        setting.set_item("type", info.kind)?;
        match info.default {
            Value::Float(x) => setting.set_item("default", x)?,
            Value::Int(i) => setting.set_item("default", i)?,
            Value::Bool(b) => setting.set_item("default", b)?,
            Value::Name(s) => setting.set_item("default", s)?,
        }
        setting.set_item("min", info.min)?;
        setting.set_item("max", info.max)?;
        setting.set_item("unit", info.unit)?;
        let choices = (!info.choices.is_empty()).then(|| info.choices.to_vec());
        setting.set_item("choices", choices)?;
        setting.set_item("doc", info.doc)?;
        let when = match info.audience {
            Audience::User(when) => Some(when),
            Audience::Lab => None,
        };
        setting.set_item("when", when)?;
        list.append(setting)?;
    }
    Ok(list)
}

/// Settings from flat dictionaries over the defaults: a user's settings, and the lab's switches.
pub(crate) fn from_dicts(
    values: Option<&Bound<'_, PyDict>>,
    switches: Option<&Bound<'_, PyDict>>,
) -> PyResult<Settings> {
    let mut settings = Settings::default();
    let known = settings::schema();
    for (values, of_lab) in [(values, false), (switches, true)] {
        if let Some(values) = values {
            set(&mut settings, values, |key| {
                let mut of_key = known.iter().filter(|info| info.key == key);
                of_key.any(|info| (info.audience == Audience::Lab) != of_lab)
            })?;
        }
    }
    Ok(settings)
}

/// Sets the values of a dictionary; keys that are `misplaced` in it are refused.
fn set(
    settings: &mut Settings,
    values: &Bound<'_, PyDict>,
    misplaced: impl Fn(&str) -> bool,
) -> PyResult<()> {
    for (key, value) in values.iter() {
        let key: String = key.extract()?;
        if misplaced(&key) {
            let why = "settings are given as `settings`, switches of the lab as `switches`".into();
            return Err(to_python(EkfError::InvalidSetting { key, why }));
        }
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
    Ok(())
}
