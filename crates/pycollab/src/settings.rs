//! Settings across the border: what there is, and the filter's values as one frozen object.

use crate::errors::to_python;
use ekf_core::EkfError;
use ekf_core::settings::{
    self, Audience, BatchTestKind, Consistency, FirstPose, Mode, MotionModel, Settings, Value,
    WornErrors,
};
use pyo3::IntoPyObjectExt;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString, PyTuple};

/// Values by their dotted keys.
///
/// Python: Mapping[str, bool | int | float | str]
type Values<'py> = Bound<'py, PyDict>;

/// The value of a setting.
///
/// Python: bool | int | float | str
type AnyValue = Py<PyAny>;

/// All settings of the filter and all switches of the lab, checked; nothing of it can be changed.
///
/// A group is an attribute, and a setting one of its group: ``settings.worn.late`` has the key
/// ``worn.late``.
///
/// Parameters
/// ----------
/// values : dict, optional
///     Dotted key to value, over the defaults.
///
/// Raises
/// ------
/// SettingsError
///     For an unknown key or an impossible value.
#[pyclass(name = "FilterSettings", module = "collabslam._core", frozen, eq)]
#[derive(Clone, PartialEq)]
pub(crate) struct PyFilterSettings(pub(crate) Settings);

#[pymethods]
impl PyFilterSettings {
    #[new]
    #[pyo3(signature = (values = None))]
    fn new(values: Option<&Values<'_>>) -> PyResult<Self> {
        let mut settings = Settings::default();
        for (key, value) in values.into_iter().flatten() {
            let key: String = key.extract()?;
            let Some(value) = of_python(&value) else {
                let why = "a number, a switch or a name is needed".into();
                return Err(to_python(EkfError::InvalidSetting { key, why }));
            };
            settings.set(&key, &value).map_err(to_python)?;
        }
        Ok(Self(settings))
    }

    /// The same settings with one value changed.
    ///
    /// Parameters
    /// ----------
    /// key : str
    ///     Dotted key.
    /// value : object
    ///
    /// Returns
    /// -------
    /// FilterSettings or None
    ///     None if the setting cannot have this value, or there is no such setting.
    fn changed(&self, key: &str, value: &Bound<'_, PyAny>) -> Option<Self> {
        let mut settings = self.0.clone();
        settings.set(key, &of_python(value)?).ok()?;
        Some(Self(settings))
    }

    /// Every value by its dotted key.
    fn values<'py>(&self, py: Python<'py>) -> PyResult<OwnValues<'py>> {
        let values = PyDict::new(py);
        for (key, value) in self.0.values() {
            values.set_item(key, to_value(py, value)?)?;
        }
        Ok(values)
    }

    fn __getnewargs__<'py>(&self, py: Python<'py>) -> PyResult<(OwnValues<'py>,)> {
        Ok((self.values(py)?,))
    }
}

/// Values as they are handed out.
///
/// Python: dict[str, bool | int | float | str]
type OwnValues<'py> = Bound<'py, PyDict>;

/// A setting's type in Python.
trait Plain {
    type Python;
    fn plain(&self) -> Self::Python;
}

macro_rules! plain {
    ($($number:ty),*; $($choice:ty),*) => {
        $(impl Plain for $number {
            type Python = Self;
            fn plain(&self) -> Self { *self }
        })*
        $(impl Plain for $choice {
            type Python = &'static str;
            fn plain(&self) -> &'static str { self.name() }
        })*
    };
}

plain!(f64, usize; BatchTestKind, Consistency, FirstPose, Mode, MotionModel, WornErrors);

/// A class for each group, with a property for each setting of it.
macro_rules! classes {
    ($( $(#[doc = $gdoc:literal])+ $group:ident: $gtype:ident {
        $( $(#[doc = $doc:literal])+ $field:ident: $ty:ty = $default:expr, $unit:literal, $min:expr, $max:expr, $audience:expr; )*
    } )*) => {
        $(
            $(#[doc = $gdoc])+
            #[pyclass(module = "collabslam._core", frozen)]
            pub(crate) struct $gtype(settings::$gtype);

            #[pymethods]
            impl $gtype {
                $(
                    $(#[doc = $doc])+
                    #[getter]
                    fn $field(&self) -> <$ty as Plain>::Python { self.0.$field.plain() }
                )*
            }
        )*

        #[pymethods]
        impl PyFilterSettings {
            $(
                $(#[doc = $gdoc])+
                #[getter]
                fn $group(&self) -> $gtype { $gtype(self.0.$group.clone()) }
            )*
        }
    };
}

ekf_core::filter_settings!(classes);

/// A row of `settings_schema`.
///
/// Python: tuple[str, str, bool | int | float | str, float | None, float | None, str, tuple[str, ...], str, str]
type Row<'py> = Bound<'py, PyTuple>;

/// What there is to know of every setting of the filter, and of every switch of the lab.
///
/// Returns
/// -------
/// list of tuple
///     The arguments of `collabslam.settings.setting.Setting`, in its order.
#[pyfunction]
pub(crate) fn settings_schema(py: Python<'_>) -> PyResult<Vec<Row<'_>>> {
    let row = |info: settings::SettingInfo| {
        let when = match info.audience {
            Audience::User(when) => when,
            Audience::Lab => "",
        };
        (
            info.key,
            info.kind,
            to_value(py, info.default)?,
            info.min,
            info.max,
            info.unit,
            PyTuple::new(py, info.choices)?,
            info.doc,
            when,
        )
            .into_pyobject(py)
    };
    settings::schema().into_iter().map(row).collect()
}

fn to_value(py: Python<'_>, value: Value) -> PyResult<AnyValue> {
    match value {
        Value::Float(x) => x.into_py_any(py),
        Value::Int(i) => i.into_py_any(py),
        Value::Bool(b) => b.into_py_any(py),
        Value::Name(s) => s.into_py_any(py),
    }
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
