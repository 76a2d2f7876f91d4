//! Settings across the border: what there is, and values as flat dictionaries.

use crate::errors::to_python;
use ekf_core::EkfError;
use ekf_core::settings::{self, Audience, Settings, Value};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};

/// Values by their dotted keys.
///
/// Python: Mapping[str, bool | int | float | str]
pub(crate) type Values<'py> = Bound<'py, PyDict>;

/// The value of a setting.
///
/// Python: bool | int | float | str
type AnyValue = Py<PyAny>;

/// A setting of the filter.
///
/// Attributes
/// ----------
/// key : str
///     Dotted name.
/// type : str
///     ``float``, ``int``, ``bool`` or ``enum``.
/// default : bool, int, float or str
/// min, max : float or None
///     Its range, ends included.
/// unit : str
/// choices : list of str
///     The values of an ``enum``; none of others.
/// doc : str
///     What it does.
/// when : str or None
///     The case in which to change it; None for a switch of the lab.
#[pyclass(module = "collabslam._core", frozen, get_all)]
pub(crate) struct SettingInfo {
    key: String,
    r#type: &'static str,
    default: AnyValue,
    min: Option<f64>,
    max: Option<f64>,
    unit: &'static str,
    choices: Vec<&'static str>,
    doc: String,
    when: Option<&'static str>,
}

fn to_value(py: Python<'_>, value: Value) -> PyResult<AnyValue> {
    match value {
        Value::Float(x) => x.into_py_any(py),
        Value::Int(i) => i.into_py_any(py),
        Value::Bool(b) => b.into_py_any(py),
        Value::Name(s) => s.into_py_any(py),
    }
}

/// Every setting of the filter, and every switch of the lab.
///
/// Returns
/// -------
/// list of SettingInfo
#[pyfunction]
pub(crate) fn settings_schema(py: Python<'_>) -> PyResult<Vec<SettingInfo>> {
    let all = settings::schema().into_iter();
    all.map(|info| {
        Ok(SettingInfo {
            key: info.key,
            r#type: info.kind,
            default: to_value(py, info.default)?,
            min: info.min,
            max: info.max,
            unit: info.unit,
            choices: info.choices.to_vec(),
            doc: info.doc,
            when: match info.audience {
                Audience::User(when) => Some(when),
                Audience::Lab => None,
            },
        })
    })
    .collect()
}

/// A Python value; None if no setting can have it.
fn of_python(value: &Bound<'_, PyAny>) -> Option<Value> {
    if value.is_instance_of::<PyBool>() {
        value.extract().ok().map(Value::Bool)
    } else if value.is_instance_of::<PyInt>() {
        value.extract().ok().map(Value::Int)
    } else if value.is_instance_of::<PyFloat>() {
        value.extract().ok().map(Value::Float)
    } else {
        let text = value.cast::<PyString>().ok()?;
        text.extract().ok().map(Value::Name)
    }
}

/// A value as the filter takes it for a setting or a switch.
///
/// Parameters
/// ----------
/// key : str
///     Dotted name.
/// value : object
///
/// Returns
/// -------
/// bool, int, float, str or None
///     None if the setting cannot have this value, or there is no such setting.
#[pyfunction]
pub(crate) fn accepted_value(
    py: Python<'_>,
    key: &str,
    value: &Bound<'_, PyAny>,
) -> PyResult<Option<AnyValue>> {
    let accepted = of_python(value).and_then(|value| Settings::accepted(key, &value).ok());
    accepted.map(|value| to_value(py, value)).transpose()
}

/// Settings from flat dictionaries over the defaults: a user's settings, and the lab's switches.
pub(crate) fn from_dicts(
    values: Option<&Values<'_>>,
    switches: Option<&Values<'_>>,
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
    values: &Values<'_>,
    misplaced: impl Fn(&str) -> bool,
) -> PyResult<()> {
    for (key, value) in values.iter() {
        let key: String = key.extract()?;
        if misplaced(&key) {
            let why = "settings are given as `settings`, switches of the lab as `switches`".into();
            return Err(to_python(EkfError::InvalidSetting { key, why }));
        }
        let Some(value) = of_python(&value) else {
            return Err(to_python(EkfError::InvalidSetting {
                key,
                why: "a number, a switch or a name is needed".into(),
            }));
        };
        settings.set(&key, &value).map_err(to_python)?;
    }
    Ok(())
}
