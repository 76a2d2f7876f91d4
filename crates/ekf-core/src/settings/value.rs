//! What a setting's value may be.

use serde::{Deserialize, Serialize};

/// A setting's value on its way in or out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Value {
    /// A real number.
    Float(f64),
    /// A whole number.
    Int(i64),
    /// A switch.
    Bool(bool),
    /// One of a list of names.
    Name(String),
}

/// What there is to know about one setting.
#[derive(Clone, Debug)]
pub struct SettingInfo {
    /// Dotted key, e.g. `process.acceleration_density`.
    pub key: String,
    /// `float`, `int`, `bool` or `enum`.
    pub kind: &'static str,
    /// The default.
    pub default: Value,
    /// Least allowed value (numbers).
    pub min: Option<f64>,
    /// Largest allowed value (numbers).
    pub max: Option<f64>,
    /// Unit, empty for pure numbers.
    pub unit: &'static str,
    /// Allowed names (enums).
    pub choices: &'static [&'static str],
    /// What it is, in a sentence or two.
    pub doc: String,
    /// Who may have a reason to change it.
    pub audience: Audience,
}

/// Who may have a reason to change a setting.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Audience {
    /// Anybody who runs the filter; the sentence says when.
    User(&'static str),
    /// Only the lab, for the ablation and the paper's comparisons: it switches a part of the method off or to an alternative.
    Lab,
}

/// A type that a setting can have.
pub(super) trait Setting: Sized {
    const KIND: &'static str;
    const CHOICES: &'static [&'static str] = &[];
    fn to_value(&self) -> Value;
    fn from_value(value: &Value, min: Option<f64>, max: Option<f64>) -> Result<Self, String>;
}

fn in_range(x: f64, min: Option<f64>, max: Option<f64>) -> Result<(), String> {
    let (lo, hi) = (
        min.unwrap_or(f64::NEG_INFINITY),
        max.unwrap_or(f64::INFINITY),
    );
    if x.is_finite() && (lo..=hi).contains(&x) {
        Ok(())
    } else {
        Err(format!("{x} is outside the range {lo} to {hi}"))
    }
}

impl Setting for f64 {
    const KIND: &'static str = "float";
    fn to_value(&self) -> Value {
        Value::Float(*self)
    }
    fn from_value(value: &Value, min: Option<f64>, max: Option<f64>) -> Result<Self, String> {
        let x = match value {
            Value::Float(x) => *x,
            Value::Int(i) => *i as f64,
            _ => return Err("a number is needed".into()),
        };
        in_range(x, min, max).map(|()| x)
    }
}

impl Setting for usize {
    const KIND: &'static str = "int";
    fn to_value(&self) -> Value {
        Value::Int(*self as i64)
    }
    fn from_value(value: &Value, min: Option<f64>, max: Option<f64>) -> Result<Self, String> {
        let whole = match value {
            Value::Int(i) => *i as f64,
            Value::Float(x) if x.fract() == 0.0 => *x,
            _ => return Err("a whole number is needed".into()),
        };
        in_range(whole, Some(min.unwrap_or(0.0).max(0.0)), max).map(|()| whole as usize)
    }
}

impl Setting for bool {
    const KIND: &'static str = "bool";
    fn to_value(&self) -> Value {
        Value::Bool(*self)
    }
    fn from_value(value: &Value, _: Option<f64>, _: Option<f64>) -> Result<Self, String> {
        match value {
            Value::Bool(on) => Ok(*on),
            _ => Err("true or false is needed".into()),
        }
    }
}
